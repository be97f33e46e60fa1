# SPDX-License-Identifier: BSD-2-Clause
"""Convex problems of the phases of a mission before the capture, whose optima are the least
impulses.

Each problem begins at the state at which the run began the phase. It ends, within the tolerances of
the mission manager, at the position at which the run left the phase, at rest as seen in H or in the
axes of the target; "mating" ends at the position and velocity of the contact. In "hold 1" the
range must remain near R_1 of the manager, in the other holds the servicer must remain near the hold
point, within the tolerances. In all phases before the final approach except "hold 2", the range
must not fall below a least range, which is not a convex constraint. A stricter convex one replaces
it: the coordinate along the direction from the target to the position on a known path must exceed
the least range. In the first solution this path is the path of the run, in later ones the last
optimum.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from harness.results.result import Array, Result

from ..shared import bounds
from ..shared.convex import Cone, Problem
from ..shared.phase_impulses import Phase, PhaseBounds
from .events import NEEDS, stays

BOX = np.array([2.0, 1.0, 1.0])
"""Largest force along each axis of the servicer [N]: four thrusters of 0.5 N along x, two along y
and two along z.
"""
GRIDS = {"far": 4.0, "hold 1": 2.0, "closing": 2.0, "hold 2": 1.0, "fly-around": 1.0, "final": 1.0,
         "hold 3": 0.5, "mating": 0.5}  # fmt: skip
"""Time step of the convex problem of each phase [s]."""
HALF_ANGLE, ZONE = "monitor.corridor_half_angle", "monitor.keep_out_half"
ENDS = {"far": ("tol_1", "v_1"), "hold 1": ("tol_1", "v_1"), "closing": ("tol_2", "v_2"),
        "hold 2": ("tol_2", "v_2"), "fly-around": ("tol_2", "v_2"), "final": ("tol_3", "v_3"),
        "hold 3": ("tol_3", "v_3")}  # fmt: skip
"""Names of the parameters of the manager with the tolerances of position and speed at the end of
each phase. The phase "mating" ends exactly at the position and velocity of the contact in the run.
"""
WITH_TARGET = ("fly-around", "final", "hold 3", "mating")
"""Phases whose end is described in the axes of the target: they end at rest as seen in these axes,
except "mating", which ends with the contact. The other phases end at rest as seen in H.
"""
IN_CORRIDOR = ("final", "hold 3", "mating")


def rows(result: Result, phase: str) -> slice:
    """Return the slice of the rows from the beginning of the first stay in a phase to the first row
    of the next phase (included).
    """
    found = stays(result)
    at = [s.phase for s in found].index(phase)
    last = found[at + 1].row + 1 if at + 1 < len(found) else len(result.time)
    return slice(found[at].row, last)


def phases(result: Result, grid: float | None) -> Mapping[str, Phase]:
    """Return the convex problems of the phases that a run has completed, by name; grid: time step
    [s] (None: as in GRIDS).
    """
    done = {s.phase for s in stays(result)[:-1]}
    return {name: phase(result, name, grid or GRIDS[name]) for name in GRIDS if name in done}


def phase(result: Result, name: str, grid: float) -> Phase:
    """Return a phase of a run, with its convex problem and the impulse [N s] that the run spent in
    it; grid: time step of the problem [s].
    """
    cut = rows(result, name)
    part = replace(result, time=result.time[cut], values=result.values[cut])
    spent = part[bounds.IMPULSE][-1] - part[bounds.IMPULSE][0]
    given = problem(part, name, grid)
    again = along if given.cones[0].name in {"keep_out", "range"} else None
    return Phase(given, float(spent.sum()), start(part), again)


def start(part: Result) -> Mapping[str, Any]:
    """Return the parameters of servicer and target with which a simulation starts at the first row
    of `part`, the rows of one phase of a run. The attitude of the servicer is frozen in this
    simulation.
    """
    found: dict[str, Any] = {
        "servicer.t_att": 1e9,
        "servicer.mass_0": float(part["servicer.mass"][0]),
    }
    for body, axes in (("target", "TN"), ("servicer", "SN")):
        found[f"{body}.a"] = 0.0
        for x in ("r", "v"):
            found[f"{body}.{x}_0_N"] = part[f"{body}.{x}_{axes}_N"][0].tolist()
    return found


def problem(part: Result, phase: str, grid: float) -> Problem:
    """Return the convex problem of a phase, with all its constraints; part: rows of the run in this
    phase; grid: time step [s].
    """
    found = bounds.problem(part, grid, BOX)
    return replace(found, cones=(*way(part, found.time, phase), *_ends(part, found.time, phase)))


def way(part: Result, time: Array, phase: str) -> Iterator[Cone]:
    """Yield the constraints on the path between start and end of a phase; part: rows of the run in
    this phase; time: instants of the grid (n + 1,) [s].
    """
    given = {name: float(part.parameter(f"manager.{name}")) for name in ("R_1", "R_2", "L_3")}
    tol_1, tol_2, tol_3 = (float(part.parameter(f"manager.tol_{k}")) for k in (1, 2, 3))
    inside, zone = time > time[0], float(np.min(part.parameter(ZONE)))
    axis = bounds.target_axis(part, time, np.asarray(part.parameter("manager.p_T")))
    toward = _directions(_relative(part, time))
    if phase in IN_CORRIDOR:
        yield bounds.about("corridor", inside, axis, float(part.parameter(HALF_ANGLE)))
    elif phase == "hold 1":
        yield bounds.beyond("range", inside, toward, given["R_1"] - 2 * tol_1)
        yield bounds.within("hold", inside, 0 * axis, given["R_1"] + 2 * tol_1)
    elif phase != "hold 2":
        yield bounds.beyond("keep_out", inside, toward, zone)
    if phase == "hold 2":
        yield bounds.within("hold", inside, given["R_2"] * _line(part, time), tol_2)
    if phase == "hold 3":
        yield bounds.beside("hold", inside, axis, tol_3)
        yield bounds.between("hold", inside, axis, given["L_3"] - tol_3, given["L_3"] + tol_3)


def _line(part: Result, time: Array) -> Array:
    """Return unit vectors from the target along the line on which "hold 2" lies, in N axes
    (n + 1, 3).
    """
    psi = float(part.parameter("manager.line_angle"))
    r, v = (bounds.at(part, bounds.BODIES[k], time) for k in (0, 1))
    return np.asarray(bounds.hill(r, v)[0] @ [np.cos(psi), np.sin(psi), 0])


def along(problem: Problem, way: Array) -> Problem:
    """Return the problem with its first constraint, the least range, replaced by one for the
    directions from the target to the positions of another path; way: these positions relative to
    the target (n + 1, 3) [m].
    """
    inside = np.arange(len(problem.time)) > 0
    name, least = problem.cones[0].name, -float(problem.cones[0].limit[0])
    rule = bounds.beyond(name, inside, _directions(way), least)
    return replace(problem, cones=(rule, *problem.cones[1:]))


def _relative(result: Result, time: Array) -> Array:
    own, other = (bounds.at(result, bounds.BODIES[k], time) for k in (4, 0))
    return own - other


def _directions(way: Array) -> Array:
    return np.asarray(way / np.linalg.norm(way, axis=1)[:, None])


def _ends(result: Result, time: Array, phase: str) -> Iterator[Cone]:
    """Yield the constraints at the end of a phase: the distance from the position at which the run
    left the phase, and the speed as seen in H or T, are within the tolerances ENDS. The end of the
    phase "mating" is exactly the position and velocity of the run.
    """
    last, one, nothing = np.arange(len(time)) == len(time) - 1, np.eye(3)[None], np.zeros((1, 3))
    r, v = (bounds.at(result, bounds.BODIES[k], time[-1:]) for k in (0, 1))
    if phase == "mating":
        contact = r - bounds.at(result, bounds.BODIES[4], time[-1:])
        striking = v - bounds.at(result, bounds.BODIES[5], time[-1:])
        node, zero = np.flatnonzero(last), np.zeros(1)
        yield Cone("end", node, one, 0 * one, contact, nothing, zero)
        yield Cone("speed", node, 0 * one, one, striking, nothing, zero)
        return
    near, slow = (float(result.parameter(f"manager.{name}")) for name in ENDS[phase])
    rate = bounds.hill(r, v)[1][0]
    if phase in WITH_TARGET:
        q = bounds.quaternions(result, bounds.BODIES[2], time[-1:])
        rate = bounds.axes(q)[0] @ result[bounds.BODIES[3]][-1]
    turning = -np.cross(rate, np.eye(3)).T[None]  # -(rate x rho)
    yield bounds.within("end", last, _relative(result, time), near)
    yield Cone("speed", np.flatnonzero(last), turning, one, nothing, nothing, np.array([slow]))


BOUND = PhaseBounds(
    (*bounds.BODIES, bounds.IMPULSE, *NEEDS),
    (HALF_ANGLE, ZONE, "manager.p_T"),
    phases,
    (bounds.BODIES[4], bounds.BODIES[0]),
    (bounds.BODIES[5], bounds.BODIES[1]),
    bounds.BODIES[6],
    "propulsion.F_S",
    every=10,
)
