# SPDX-License-Identifier: BSD-2-Clause
"""Tables of the safety filter: runs without a filter, with two simplex filters and with the filter
of least change, first behind several controllers, then with a guidance that aims at the target.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from results import Column, of_runs

FILTERS = ("none", "explicit simplex", "implicit simplex", "least change")
"""Names of the filters by the value of the parameter `filter.filter`, 0 to 3."""
CONTROLLERS = ("ppc_controller", "pid_controller", "theta_d_controller", "adaptive_controller")
AIMING = "sync_approach_thrusters_filtered --set guidance.rho_M=0.5 --set guidance.beta=0.05"
SPHERE = 3.9
"""Radius of the keep-out sphere in the system that AIMING runs [m]."""
WORK = [
    Column("changed [%]", "filter changes", "{:.1f}"),
    Column("impulse of the change [N s]", "filter impulse", "{:.3g}"),
]


def _least_range(result: Any) -> float:
    from ssp.shared.relative_motion import range_

    return float(range_(result).min())


def _impulse(result: Any) -> float:
    """Return the impulse of the force that the filter commands [N s]."""
    from ssp.shared.filtering import passed

    return passed(result)


def _arrival(result: Any) -> float:
    """Return the first time at which the servicer is within 10 cm of the keep-out sphere [s]; NaN
    if it never is.
    """
    from ssp.shared.relative_motion import range_

    near = range_(result) < SPHERE + 0.1
    return float(result.time[np.argmax(near)]) if near.any() else float("nan")


def controllers() -> str:
    """Return a table with a row per pair of a controller and the filter behind it, for the
    parameter set `limited`.
    """
    base = "ppc_tracking_filtered --params limited"
    runs = {
        f"`{controller}`, {name}": f"{base} --swap controller={controller} --set filter.filter={k}"
        for controller in CONTROLLERS
        for k, name in enumerate(FILTERS)
    }
    return of_runs(
        "controller, filter",
        runs,
        [
            *WORK,
            Column("delta-v [m/s]", "delta-v", "{:.1f}"),
            Column("least range [m]", _least_range, "{:.3f}"),
            Column("least gap to the sphere after braking [m]", "keep-out barrier", "{:.2f}"),
        ],
    )


def aiming() -> str:
    """Return a table with a row per filter, for a guidance that leads the servicer to 0.5 m from
    the centre of the target.
    """
    runs = {name: f"{AIMING} --set filter.filter={k}" for k, name in enumerate(FILTERS)}
    return of_runs(
        "filter",
        runs,
        [
            Column("least range [m]", _least_range, "{:.3f}"),
            Column("least gap to the sphere after braking [m]", "keep-out barrier", "{:.3f}"),
            Column("least margin of the speed limit [m/s]", "speed barrier", "{:.4f}"),
            *WORK,
            Column("impulse [N s]", _impulse, "{:.0f}"),
            Column("at the sphere after [s]", _arrival, "{:.0f}"),
        ],
    )


VALUES = {"filter_controllers": controllers, "filter_aiming": aiming}
