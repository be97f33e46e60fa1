# SPDX-License-Identifier: BSD-2-Clause
"""Convex problem of the relay approach, whose optimum is the least impulse. The
problem contains translation only and begins with the start of a run. The range must be at most 60 m
in the last 100 s, and the servicer must be at rest relative to the target at the end.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from harness.results.result import Result

from ..shared import bounds
from ..shared.convex import Cone, Problem
from ..shared.least_impulse import Bound

ENGINES = slice(8, 13)
"""Indices, from 0, of the thrusters for translation; the other thrusters turn the servicer."""
ARRIVAL, RANGE, REST = 39_900.0, 60.0, 0.002
"""Instant [s] from which the requirement `arrival` limits the range, this limit [m], and the
largest relative speed that counts as rest [m/s].
"""


def problem(result: Result, grid: float) -> Problem:
    """Return the convex problem of a run; grid: time step [s]."""
    found = bounds.problem(result, grid, np.zeros(3))
    count = len(found.time)
    one, nothing = np.eye(3)[None], np.zeros((1, 3))
    rest = Cone("rest", np.array([count - 1]), 0 * one, one, nothing, nothing, np.array([REST]))
    arrival = bounds.within("arrival", found.time >= ARRIVAL, np.zeros((count, 3)), RANGE)
    return replace(found, cones=(arrival, rest))


def spent(result: Result) -> float:
    """Return the impulse of the thrusters for translation in a run [N s]."""
    return float(result[bounds.IMPULSE][-1, ENGINES].sum())


BOUND = Bound(
    (*bounds.BODIES, bounds.IMPULSE),
    ("propulsion.thruster_position",),
    problem,
    (bounds.BODIES[4], bounds.BODIES[0]),
    bounds.BODIES[6],
    "propulsion.F_S",
    grid=100.0,
    every=10,
    spent=spent,
)
