# SPDX-License-Identifier: BSD-2-Clause
"""Convex problem of the rendezvous benchmark without an abort; its optimum is the least impulse
with which the servicer can meet the constraints.

From the instant at which the run began its rendezvous attempt, the servicer must stay within the
line-of-sight cone and below the speed limit, both in the Hill frame. At the end it must be at least
as near and as slow as in the run.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from harness.errors import UsageError
from harness.results.result import Array, Result, Rows

from ..shared import bounds
from ..shared.convex import Cone, Problem

ATTEMPT, ABORT = "controller.approaching", "controller.t_abort"
AXIS, HALF_ANGLE, SPEED = (
    f"monitor.{name}" for name in ("corridor_axis", "corridor_half_angle", "speed_at_zero")
)


def problem(result: Result, grid: float) -> Problem:
    """Return the convex problem of a run on a grid with the time step `grid` [s]; raise UsageError
    for a run with an abort.
    """
    if float(result.parameter(ABORT)) < result.time[-1]:
        raise UsageError(
            f"{result.system}: bound needs a run without an abort; "
            f"set {ABORT} to the stop time or later"
        )
    found = bounds.problem(result, grid, np.zeros(3))
    time = found.time
    r, v = (bounds.at(result, bounds.BODIES[k], time) for k in (0, 1))
    axes, rate = bounds.hill(r, v)
    begun = float(result.time[np.argmax(result[ATTEMPT] > 0)])
    attempt = (time >= begun) & (time > time[0]) & bool(result[ATTEMPT].any())
    axis = np.asarray(axes @ np.asarray(result.parameter(AXIS)))
    rho, drho = (result[bounds.BODIES[4 + k]][-1] - result[bounds.BODIES[k]][-1] for k in (0, 1))
    last = np.arange(len(time)) == len(time) - 1
    slow = float(np.linalg.norm(drho - np.cross(rate[-1], rho)))
    cones = (
        bounds.about("corridor", attempt, axis, float(result.parameter(HALF_ANGLE))),
        speed("closing", np.flatnonzero(attempt), rate, float(result.parameter(SPEED))),
        bounds.within("end", last, 0 * axis, float(np.linalg.norm(rho))),
        speed("rest", np.flatnonzero(last), rate, slow),
    )
    return replace(found, cones=cones)


def speed(name: str, nodes: Rows, rate: Array, most: float) -> Cone:
    """Return the constraint |v - rate x rho| <= most: the speed of the servicer relative to the
    target, seen in a rotating frame, is at most `most`.

    name: name of the constraint; nodes: indices of the grid points at which the constraint applies;
    rate: angular velocity of the frame at all grid points, N axes, (n + 1, 3) [rad/s]; most:
    largest speed [m/s].
    """
    turning = np.cross(np.eye(3), rate[nodes][:, None, :]).swapaxes(1, 2)  # -(rate x e)
    still = np.broadcast_to(np.eye(3), turning.shape)
    zero = np.zeros((len(nodes), 3))
    return Cone(name, nodes, turning, still, zero, zero, np.full(len(nodes), most))


BOUND = bounds.bound((ATTEMPT,), (AXIS, HALF_ANGLE, SPEED, ABORT), problem, grid=60.0)
