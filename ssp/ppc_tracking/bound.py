# SPDX-License-Identifier: BSD-2-Clause
"""Convex problem of the tracking with prescribed performance: arrival at the instant of the run,
from then on within the band of the range about the hover; the law of the monitor for closing.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from harness.mission.optimum import Cone, Problem
from harness.results.result import Array, Result

from ..shared import bounds

BOX, AXIS, HOVER = "propulsion.F_max", "guidance.p_T", "guidance.rho_f"
LAW = ("monitor.speed_at_zero", "monitor.speed_slope")
BAND, LEAST = 0.5, 19.0
"""Band of the range about the hover, and least range [m], see system.toml."""


def arrival(result: Result) -> float:
    """Return the instant from which the run stays within the band about the hover [s]."""
    hover = float(result.parameter(HOVER))
    axis = bounds.target_axis(result, result.time, np.asarray(result.parameter(AXIS)))
    rho = result[bounds.BODIES[4]] - result[bounds.BODIES[0]]
    outside = np.flatnonzero(np.linalg.norm(rho - hover * axis, axis=1) > BAND)
    return float(result.time[min(outside[-1] + 1, len(result.time) - 1)]) if len(outside) else 0.0


def problem(result: Result, grid: float) -> Problem:
    """Return the convex problem of a run. The line of sight of the speed law is the simulated one;
    the law counts in both directions.
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
    """Return |way . v| <= at_zero + slope way . rho at all nodes after the start."""
    nodes = np.arange(1, len(way) + 1)
    rate = way[:, None, :]
    limit = np.full(len(way), at_zero)
    return Cone("closing", nodes, 0 * rate, rate, np.zeros((len(way), 1)), slope * way, limit)


BOUND = bounds.bound((), (BOX, AXIS, HOVER, *LAW), problem, grid=0.5)
