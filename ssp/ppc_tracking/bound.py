# SPDX-License-Identifier: BSD-2-Clause
"""Convex problem of the tracking with prescribed performance, whose optimum is the least impulse.

From the instant of arrival() on, the servicer must stay within BAND of the hovering point. After
the start it must be at least LEAST from the target and obey the speed law of the monitor, in both
directions along the line of sight.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from harness.results.result import Array, Result

from ..shared import bounds
from ..shared.convex import Cone, Problem

BOX, AXIS, HOVER = "propulsion.F_max", "guidance.p_T", "guidance.rho_f"
LAW = ("monitor.speed_at_zero", "monitor.speed_slope")
BAND, LEAST = 0.5, 19.0
"""Largest distance from the hovering point after the arrival, and least distance from the target
after the start [m], as in the requirements of system.toml.
"""


def arrival(result: Result) -> float:
    """Return the instant from which the run stays within BAND of the hovering point [s], the last
    one if it ends outside.
    """
    hover = float(result.parameter(HOVER))
    axis = bounds.target_axis(result, result.time, np.asarray(result.parameter(AXIS)))
    rho = result[bounds.BODIES[4]] - result[bounds.BODIES[0]]
    outside = np.flatnonzero(np.linalg.norm(rho - hover * axis, axis=1) > BAND)
    return float(result.time[min(outside[-1] + 1, len(result.time) - 1)]) if len(outside) else 0.0


def problem(result: Result, grid: float) -> Problem:
    """Return the convex problem of a run. The speed law limits the speed along the simulated line
    of sight, both towards the target and away from it. grid: time step [s].
    """
    found = bounds.problem(result, grid, np.asarray(result.parameter(BOX)))
    time = found.time
    axis = bounds.target_axis(result, time, np.asarray(result.parameter(AXIS)))
    rho = bounds.at(result, bounds.BODIES[4], time) - bounds.at(result, bounds.BODIES[0], time)
    way = rho / np.linalg.norm(rho, axis=1)[:, None]
    there = time >= arrival(result)
    cones = (
        bounds.beyond("distance", time > 0, way, LEAST),
        bounds.within("range", there, float(result.parameter(HOVER)) * axis, BAND),
        closing(way[1:], *(float(result.parameter(name)) for name in LAW)),
    )
    return replace(found, cones=cones)


def closing(way: Array, at_zero: float, slope: float) -> Cone:
    """Return the speed limit as the constraint |way . v| <= at_zero + slope way . rho at all grid
    points after the start; way: unit vectors along the line of sight (n, 3).
    """
    nodes = np.arange(1, len(way) + 1)
    rate = way[:, None, :]
    limit = np.full(len(way), at_zero)
    return Cone("closing", nodes, 0 * rate, rate, np.zeros((len(way), 1)), slope * way, limit)


BOUND = bounds.bound((), (BOX, AXIS, HOVER, *LAW), problem, grid=0.5)
