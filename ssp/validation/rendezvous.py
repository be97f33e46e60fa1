# SPDX-License-Identifier: BSD-2-Clause
"""Values of the rendezvous benchmark SPRE from a run of the system arch_rendezvous.

Units of the benchmark: m, min, kg; a gain is kg/min2 on positions and kg/min on velocities.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from harness.results.result import Array

from .library import Library, run_system

if TYPE_CHECKING:
    from .case import Case

SYSTEM = "arch_rendezvous"
MINUTE = 60.0
EVERY, INTERVAL = 1500, 300.0
"""Number of macro steps between two recorded rows, and the time between these rows [s]."""
HALF_ANGLE = np.radians(30)
SPEED_LIMIT, BOX = 3.3, 0.2
"""Largest speed during the attempt [m/min]; half the side of the square target [m]."""


def rendezvous(case: Case, library: Library) -> list[dict[str, Array]]:
    """Return a dict for each row of the case, with the values of this list that the row names.

    xy, vxy: position [m] and velocity [m/min] in the Hill frame at the time of the row. Extreme
    values of the run: los: least -x tan 30 deg - |y| in the attempt [m]; speed: largest speed in
    the attempt [m/min]; box: least max(|x|, |y|) after the abort [m].
    """
    del library  # argument of all SIMULATIONS, unused here because the master loads the FMUs
    stop = case.rows[-1]["t"]
    result = run_system(SYSTEM, stop=stop, every=EVERY, set=_changes(case))
    keep_out, corridor, speed = result["monitor.least_margin"][-1][:3]
    answer = []
    for row in case.rows:
        k = round(row["t"] / INTERVAL)
        bounds = {
            "los": np.array([corridor / np.cos(HALF_ANGLE)]),
            "speed": np.array([SPEED_LIMIT - speed * MINUTE]),
            "box": np.array([BOX + keep_out]),
        }
        motion = {
            "xy": result["controller.rho_H"][k, :2],
            "vxy": result["controller.drho_H"][k, :2] * MINUTE,
        }
        answer.append({name: (bounds | motion)[name] for name in row if name != "t"})
    return answer


def _changes(case: Case) -> dict[str, Any]:
    own = ("mass_0", "rho_0_H", "drho_0_H")
    changes: dict[str, Any] = {f"servicer.{name}": case.setup["parameters"][name] for name in own}
    for phase in (1, 2):
        K = np.array(case.setup[f"K{phase}"])
        changes[f"controller.K_rho_{phase}"] = _in_three(K[:, :2] / MINUTE**2)
        changes[f"controller.K_drho_{phase}"] = _in_three(K[:, 2:] / MINUTE)
    changes["controller.t_abort"] = case.setup["abort_min"] * MINUTE
    return changes | {"monitor.passive_time": 0}


def _in_three(K: Array) -> list[list[float]]:
    full = np.zeros((3, 3))
    full[:2, :2] = K
    return [[float(k) for k in row] for row in full]
