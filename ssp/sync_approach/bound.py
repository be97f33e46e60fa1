# SPDX-License-Identifier: BSD-2-Clause
"""Convex problem of the synchronised approach, whose optimum is the least impulse that meets the
requirements of the system and the corridor.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from harness.results.result import Result

from ..shared import bounds
from ..shared.convex import Problem

HALF_ANGLE, KEEP_OUT = "monitor.corridor_half_angle", "monitor.keep_out_half"
REFERENCE, BOX, AXIS = "guidance.rho_ref_N", "propulsion.F_max", "guidance.p_T"
TRACKED, POINTED = 1200.0, 600.0
"""Instants from which tracking and pointing are required [s], see system.toml."""


def problem(result: Result, grid: float) -> Problem:
    """Return the convex problem of a run; grid: time step [s]. The requirement on the range is
    replaced by a stricter one: the distance along the grasp axis, which is never larger than the
    range, must not be below the limit of the range.
    """
    found = bounds.problem(result, grid, np.asarray(result.parameter(BOX)))
    time, sample = found.time, result.time[1] - result.time[0]
    axis = bounds.target_axis(result, time, np.asarray(result.parameter(AXIS)))
    # the guidance publishes one sample late: the reference of time t is in the row of t + sample
    centre = bounds.at(result, REFERENCE, time + sample)
    later, half_angle = time > 0, float(result.parameter(HALF_ANGLE))
    cones = (
        bounds.about("corridor", later, axis, half_angle),
        bounds.beyond("distance", later, axis, float(np.min(result.parameter(KEEP_OUT)))),
        bounds.within("tracking", time >= TRACKED, centre, 0.05),
        bounds.about("pointing", time >= POINTED, axis, np.radians(1.0)),
    )
    return replace(found, cones=cones)


BOUND = bounds.bound((REFERENCE,), (HALF_ANGLE, KEEP_OUT, BOX, AXIS), problem)
