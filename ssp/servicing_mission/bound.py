# SPDX-License-Identifier: BSD-2-Clause
"""Convex problems of the phases of a mission: each from where the run began it to where the run
left it, within the tolerances of the manager.

Outside the final approach the keep-out sphere is convexified from inside: range along a way, first
the way of the run, then the way of the last optimum (`along`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from harness.mission.optimum import Cone, Phase, PhaseBounds, Problem
from harness.results.result import Array, Result

from ..shared import bounds
from .events import NEEDS, stays

BOX = np.array([2.0, 1.0, 1.0])
"""Thrust along the axes of the servicer: four thrusters of 0.5 N along x, two along y and z [N]."""
GRIDS = {"far": 4.0, "closing": 2.0, "fly-around": 1.0, "final": 1.0}
"""Phases and the steps of their grids [s]."""
HALF_ANGLE, ZONE = "monitor.corridor_half_angle", "monitor.keep_out_half"
ENDS = {"far": ("tol_1", "v_1"), "closing": ("tol_2", "v_2"), "fly-around": ("tol_2", "v_2"),
        "final": ("tol_3", "v_3")}  # fmt: skip
"""Parameters of the manager: tolerances of position and speed at the end of a phase."""


def rows(result: Result, phase: str) -> slice:
    """Return the rows of the first stay in a phase, with the first row of the next phase."""
    found = stays(result)
    at = [s.phase for s in found].index(phase)
    last = found[at + 1].row + 1 if at + 1 < len(found) else len(result.time)
    return slice(found[at].row, last)


def phases(result: Result, grid: float | None) -> Mapping[str, Phase]:
    """Return the phases that a run has completed; all force of the thrusters counts."""
    done = {s.phase for s in stays(result)[:-1]}
    return {name: phase(result, name, grid or GRIDS[name]) for name in GRIDS if name in done}


def phase(result: Result, name: str, grid: float) -> Phase:
    """Return one phase of a run."""
    cut = rows(result, name)
    part = replace(result, time=result.time[cut], values=result.values[cut])
    spent = part[bounds.IMPULSE][-1] - part[bounds.IMPULSE][0]
    return Phase(problem(part, name, grid), float(spent.sum()), None if name == "final" else along)


def problem(part: Result, phase: str, grid: float) -> Problem:
    """Return the convex problem of the rows of a phase."""
    found = bounds.problem(part, grid, BOX)
    zone = float(np.min(part.parameter(ZONE)))
    axis = bounds.target_axis(part, found.time, np.asarray(part.parameter("manager.p_T")))
    inside = found.time > found.time[0]
    rule = bounds.beyond("keep_out", inside, _directions(_relative(part, found.time)), zone)
    if phase == "final":
        rule = bounds.about("corridor", inside, axis, float(part.parameter(HALF_ANGLE)))
    return replace(found, cones=(rule, *_ends(part, found.time, phase)))


def along(problem: Problem, way: Array) -> Problem:
    """Return the problem with the range along another way (n + 1, 3)."""
    inside = np.arange(len(problem.time)) > 0
    zone = -float(problem.cones[0].limit[0])
    rule = bounds.beyond("keep_out", inside, _directions(way), zone)
    return replace(problem, cones=(rule, *problem.cones[1:]))


def _relative(result: Result, time: Array) -> Array:
    own, other = (bounds.at(result, bounds.BODIES[k], time) for k in (4, 0))
    return own - other


def _directions(way: Array) -> Array:
    return np.asarray(way / np.linalg.norm(way, axis=1)[:, None])


def _ends(result: Result, time: Array, phase: str) -> tuple[Cone, Cone]:
    """Return the end of a phase: near the place where the run left it, slow as seen in the frame of
    the phase, H or T.
    """
    near, slow = (float(result.parameter(f"manager.{name}")) for name in ENDS[phase])
    last = np.arange(len(time)) == len(time) - 1
    r, v = (bounds.at(result, bounds.BODIES[k], time[-1:]) for k in (0, 1))
    rate = bounds.hill(r, v)[1][0]
    if phase in {"fly-around", "final"}:
        q = bounds.quaternions(result, bounds.BODIES[2], time[-1:])
        rate = bounds.axes(q)[0] @ result[bounds.BODIES[3]][-1]
    turning = -np.cross(rate, np.eye(3)).T[None]  # -(rate x rho)
    nothing, one = np.zeros((1, 3)), np.eye(3)[None]
    speed = Cone("speed", np.flatnonzero(last), turning, one, nothing, nothing, np.array([slow]))
    return bounds.within("end", last, _relative(result, time), near), speed


BOUND = PhaseBounds(
    (*bounds.BODIES, bounds.IMPULSE, *NEEDS), (HALF_ANGLE, ZONE, "manager.p_T"), phases, every=10
)
