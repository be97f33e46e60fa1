# SPDX-License-Identifier: BSD-2-Clause
"""The whole synchronised approach with a zero-order hold, as one program.

Software samples at t_k; force (servicer body axes), torque and wheel acceleration are held on [t_k,
t_k+1); both plants take one RK4 step. Row k of a history holds the plant states at t_k and what the
software computed at t_k-1: row 0 holds the law at the initial states with the estimates at their
start values.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from . import adaptive, guidance, paper_case, servicer, target
from .attitude import Array

History = dict[str, Array]


@dataclass(frozen=True)
class System:
    target: target.Parameters = paper_case.TARGET
    servicer: servicer.Parameters = paper_case.SERVICER
    guidance: guidance.Parameters = paper_case.GUIDANCE
    controller: adaptive.Parameters = paper_case.CONTROLLER


class Recorder:
    """Columns `component.port`, one row per macro step."""

    def __init__(self) -> None:
        self.columns: dict[str, list[Any]] = {}

    def add(self, component: str, values: Mapping[str, Any]) -> None:
        for name, value in values.items():
            self.columns.setdefault(f"{component}.{name}", []).append(np.array(value, dtype=float))

    def history(self, step: float) -> History:
        out = {name: np.array(rows) for name, rows in self.columns.items()}
        return {"time": step * np.arange(len(out["target.r_TN_N"])), **out}


def software(
    t: float, yT: Array, yS: Array, held: Array | None, x: adaptive.Estimate, s: System, h: float
) -> Any:
    """Guidance and controller at t: both output dictionaries and their next states."""
    plant = servicer.outputs(t, yS, s.servicer)
    T, S = target.body(yT), servicer.body(yS, servicer.is_active(s.servicer, t))
    ref, held = guidance.sample(t, T, S, s.guidance, held)
    command, x = adaptive.sample(t, T, S, plant["wheel_speed"], ref, x, s.controller, h)
    return ref, command, held, x


def run(s: System = System(), stop: float = paper_case.STOP, h: float = paper_case.STEP) -> History:
    """Histories named `component.port`, each of shape (steps + 1, ...), and `time`."""
    rec = Recorder()
    yT, yS = target.initial_state(s.target), servicer.initial_state(s.servicer)
    held, x = None, adaptive.initial_estimate(s.controller)
    ref, command, _, _ = software(0.0, yT, yS, held, x, s, h)
    record(rec, 0.0, yT, yS, ref, {**command, "m_hat": x.m_hat, "eta_hat": x.eta_hat}, s)
    for k in range(round(stop / h)):
        t, t_next = k * h, (k + 1) * h
        ref, command, held, x = software(t, yT, yS, held, x, s, h)
        u = servicer.Input(
            F_S=command["F_cmd_S"],
            M_S=command["M_cmd_S"],
            wheel_accel_cmd=command["wheel_accel_cmd"],
        )
        yS = servicer.step(s.servicer, yS, t, t_next, u)
        yT = target.step(s.target, yT, t, t_next)
        record(rec, t_next, yT, yS, ref, command, s)
    return rec.history(h)


def record(
    rec: Recorder, t: float, yT: Array, yS: Array, ref: Any, command: Any, s: System
) -> None:
    rec.add("target", target.outputs(yT, s.target))
    rec.add("servicer", servicer.outputs(t, yS, s.servicer))
    rec.add("guidance", ref)
    rec.add("controller", command)
