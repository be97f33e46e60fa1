# SPDX-License-Identifier: BSD-2-Clause
"""Runs of sync_approach, by the FMUs under the master and by the independent reference program,
case by case.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from math import radians
from typing import Any

import numpy as np

from harness import load
from harness.master.changes import apply
from harness.master.isolated import simulate
from harness.results.result import Result
from harness.system.model import System

from ..reference import closed_loop

SYSTEM = "sync_approach"
STEP = 0.1


@dataclass(frozen=True, eq=False)
class Case:
    """Parameters `component.parameter` in which a run differs from the paper's, and its duration
    [s].
    """

    name: str
    stop: float
    changes: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return self.name


PAPER = Case("paper", 1800.0)

_J_T = [[100, 4, -3], [4, 150, 5], [-3, 5, 90]]
_M_DIST_T = {
    f"{component}.M_dist_T.{name}": value
    for component in ("target", "guidance")
    for name, value in {
        "amplitude": [0.02, -0.03, 0.01],
        "frequency": [0.04, 0.07, 0.11],
        "phase": [1, 2, 3],
    }.items()
}
GYROSCOPIC = Case(
    "gyroscopic",
    200.0,
    _M_DIST_T
    | {
        "target.J_T": _J_T,
        "target.omega_TN_T_0": [0.02, 0.01, -0.02],
        "guidance.J_T": _J_T,
        "guidance.know_M_dist": 1,
        "guidance.p_T": [0.6, -0.48, 0.64],
        "servicer.J_S": [[200, 8, -6], [8, 250, 10], [-6, 10, 150]],
        "servicer.A_w": [[12, 1, -0.5], [1, 15, 0.8], [-0.5, 0.8, 10]],
        "servicer.sigma_SN_0": [0.2, -0.2, 0.55],
        "servicer.omega_SN_S_0": [0.01, -0.02, 0.015],
        "servicer.wheel_speed_0": [3, -2, 2.5],
        "servicer.t_att": 60,
        "servicer.use_gravity_gradient": 1,
        "servicer.M_dist_S.bias": [0.01, 0.02, -0.01],
        "servicer.M_dist_S.start": 60,
        "servicer.a_dist.amplitude": [1e-3, 2e-3, -1e-3],
        "servicer.a_dist.frequency": [0.1, 0.07, 0.05],
        "controller.t_att": 60,
        "controller.K_rho": [2e-3, 3e-3, 1e-3],
        "controller.P_rho": [5e-2, 6e-2, 7e-2],
        "controller.K_att": [40, 50, 60],
        "controller.P_att": [60, 70, 50],
        "controller.eta_hat_0": [180, 5, -5, 240, 8, 160, 14, 0.5, 0, 16, 0.5, 12],
        "controller.Gamma_scale": 0.01,
    },
)
"""Nothing is zero or symmetric, wheels and bodies spin before the attitude is released after a
minute.
"""
THRUSTERS = Case(
    "thrusters",
    200.0,
    GYROSCOPIC.changes
    | {
        "controller.use_wheels": 0,
        "controller.projection": 1,
        "controller.damping_in_regressor": 1,
        "controller.m_hat_range": 1e-4,
        "controller.eta_hat_range": 0.01,
        "controller.eta_hat_0": [180, 0, 0, 240, 0, 160, 14, 0, 0, 16, 0, 12],
        "controller.J_offdiag_max": 0.2,
        "controller.Gamma_scale": 0.1,
        "guidance.guard_angle": radians(50.0),
    },
)
"""The same with torque by thrusters and the other options of the law: estimates at their limits,
guard in action.
"""


# ---- FMUs under the master


@contextmanager
def system(case: Case, **options: Any) -> Iterator[System]:
    """The system of a case, ready to be changed further or to be run; it takes the options of
    harness.api.
    """
    with load(SYSTEM) as found:
        yield apply(found, set=case.changes, **({"stop": case.stop} | options))


@lru_cache(maxsize=12)
def recording(case: Case, executor: str = "c", every: int = 1, **options: Any) -> Result:
    """Return the master's recording of a case. Cached for other tests (20 MB each), hence not to be
    changed.
    """
    with system(case, **options) as changed:
        result = simulate(changed, executor=executor, every=every)
    result.values.flags.writeable = False
    return result


def identical(a: Result, b: Result) -> bool:
    """Whether two results hold the same variables (in any order) with the same bits."""
    if set(a.columns) != set(b.columns) or a.time.tobytes() != b.time.tobytes():
        return False
    return (
        a.values.tobytes() == b.values[:, [b.columns.index(name) for name in a.columns]].tobytes()
    )


# ---- the independent program


@cache
def reference_run(case: Case, h: float = STEP) -> closed_loop.History:
    """History of the reference program, and the ports of the propulsion unit, which passes commands
    on.
    """
    history = closed_loop.run(reference_system(case), case.stop, h)
    omega = history["servicer.omega_SN_S"]
    margin = np.pi / case.changes.get("servicer.max_step", 0.1) - np.linalg.norm(omega, axis=1)
    return history | propulsion(history, h) | {"servicer.rate_margin": margin}


def reference_system(case: Case) -> closed_loop.System:
    parts = {
        name: getattr(closed_loop.System(), name)
        for name in ("target", "servicer", "guidance", "controller")
    }
    for port, value in case.changes.items():
        component, _, name = port.partition(".")
        parts[component] = _changed(parts[component], name, value)
    return closed_loop.System(**parts)


def _changed(parameters: Any, name: str, value: Any) -> Any:
    name, _, member = name.partition(".")
    return replace(
        parameters,
        **{name: replace(getattr(parameters, name), **{member: value}) if member else value},
    )


def propulsion(history: closed_loop.History, h: float) -> closed_loop.History:
    """Ideal: neither limits nor lag, no propellant; row 0 is before the first step."""
    F, M = history["controller.F_cmd_S"], history["controller.M_cmd_S"]
    none = np.zeros_like(F)
    outputs = {"F_S": F, "M_S": M, "mdot": none[:, 0], "F_saturated": none, "M_saturated": none}
    impulses = {"impulse": _integral(F, h), "torque_impulse": _integral(M, h)}
    return {f"propulsion.{name}": values for name, values in (outputs | impulses).items()}


def _integral(force: np.ndarray, h: float) -> np.ndarray:
    held = np.abs(force) * h
    held[0] = 0.0
    return np.cumsum(held, axis=0)


# ---- comparison


def deviation(name: str, ours: np.ndarray, expected: np.ndarray) -> np.ndarray:
    """Largest difference of each row; attitudes are the same rotation with either sign of q and in
    either MRP set.
    """
    difference = _largest(ours - expected)
    variable = name.partition(".")[2]
    if variable.startswith("q_"):
        return np.minimum(difference, _largest(ours + expected))
    if variable.startswith("sigma_") or variable == "epsilon":
        shadow = -expected / np.maximum((expected**2).sum(axis=1, keepdims=True), 1e-300)
        return np.minimum(difference, _largest(ours - shadow))
    return difference


def _largest(x: np.ndarray) -> np.ndarray:
    return np.abs(x).reshape(len(x), -1).max(axis=1)
