# SPDX-License-Identifier: BSD-2-Clause
"""3D replay of an approach: one or more servicers about the target, zones, axes, plumes, plans."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from harness.report.arrays import Arrays
from harness.report.timeline import event, of_run
from harness.results.result import Array, Result, Rows

from . import approach_zones as zones
from . import bodies, flexible
from .plan_figures import PLANNERS
from .relative_motion import DISTANCE, SERVICER, SPEED, TARGET, VELOCITIES, release_time
from .scene import Body, Part, Scene, instants, scene
from .sky import frames, in_orbit, sky

PAIR = (SERVICER, TARGET, *VELOCITIES, "servicer.q_SN", "target.q_TN")


class Outfit(NamedTuple):
    """Parts and values that a mission adds to the replay of an approach, instead of a symbolic arm
    and ring.

    servicer, target: parts drawn on these bodies; links: moving parts of the servicer; reach:
    largest distance of the links from S [m]; root, seat: points on the surfaces of servicer and
    target [m], from which the sizes of the drawn bodies follow (for a servicer with thrusters, the
    size follows from their positions instead); numbers: values shown during the replay; phases,
    events: entries of its timeline; course: time series of the phase of the mission, the names of
    the phases, and the names of the phases that are alarms; paths: for each point whose path is
    drawn, its name and the variables of its position and attitude; spot: label of the seat.
    """

    servicer: list[Part]
    target: list[Part]
    seat: Array
    links: tuple[Scene, ...] = ()
    reach: float = 0.0
    root: Array | None = None
    numbers: tuple[Scene, ...] = ()
    events: tuple[Scene, ...] = ()
    paths: tuple[tuple[str, str, str], ...] = ()
    phases: tuple[Scene, ...] = ()
    spot: str = "grasp point"
    course: Scene | None = None


Fit = Callable[[Result, Rows, Arrays], Outfit | None]
"""Function of a result, the rows that the replay shows and the store of the arrays of the page; it
returns the Outfit, or None if the result lacks data.
"""


def bare(_: Result, __: Rows, ___: Arrays) -> None:
    """Return no Outfit, for a mission that adds no parts."""


def pair(result: Result, arrays: Arrays, fit: Fit = bare) -> Scene:
    """Return the scene of one run: a servicer about its target; fit: function that returns the
    parts of the mission.
    """
    rows = instants(result, "servicer.q_SN", "target.q_TN")
    outfit = fit(result, rows, arrays)
    orbit = in_orbit(result[TARGET][rows])
    chaser, size = _servicer(result, rows, arrays, orbit, outfit)
    client = _target(result, rows, arrays, orbit, not orbit, outfit)
    return scene(
        arrays,
        result.time[rows],
        "target" if orbit else "origin of N",
        [chaser, *_points(result, rows, arrays, orbit, outfit), client],
        **frames(result, arrays, rows, TARGET, VELOCITIES[1]),
        **(sky(result, arrays, rows, TARGET, _planet(result)) if orbit else {}),
        centre="target",
        zones=zones.zones(result, rows, arrays, orbit),
        rules=zones.rules(result, rows, arrays),
        sensors=zones.sensors(result),
        spots=_spots(result, outfit),
        plumes=_plumes(result, rows, arrays, size),
        plans=plans(result, rows, arrays),
        range=arrays.sample(result, rows, DISTANCE),
        speed=arrays.sample(result, rows, SPEED),
        numbers=list(outfit.numbers) if outfit else [],
        **_course(result, outfit),
    )


def _course(result: Result, outfit: Outfit | None) -> Scene:
    """Return the entries of a scene for the phases and events of a run. The start of the
    attitude control and an abort by the monitor are events in addition to those in the outfit.
    """
    events = list(outfit.events) if outfit else []
    phases = list(outfit.phases) if outfit else []
    begin, end, released = float(result.time[0]), float(result.time[-1]), release_time(result)
    if begin < released < end:
        events.append(event(released, "attitude control on", "phase"))
        phases = phases or [
            {"begin": begin, "end": released, "text": "attitude frozen"},
            {"begin": released, "end": end, "text": "attitude tracked"},
        ]
    if ABORT in result and len(aborted := np.flatnonzero(result[ABORT] > 0)):
        events.append(event(result.time[aborted[0]], "abort ordered by the monitor", "abort"))
    course = {"course": outfit.course} if outfit and outfit.course else {}
    return {"events": events, "phases": phases, **course}


ABORT = "monitor.abort"


def _spots(result: Result, outfit: Outfit | None) -> list[Scene]:
    """Return the labelled point of the target that the servicer is to reach, in a list, or []."""
    if outfit is not None:
        at, title, text = outfit.seat, "", outfit.spot
    elif (axis := zones.grasp_axis(result)) is not None:
        at, title, text = (
            axis * _target_face(result),
            zones.meaning(result, "guidance.p_T"),
            "grasp point",
        )
    else:
        return []
    return [{"body": "target", "at": np.asarray(at).tolist(), "text": text, "title": title}]


INERTIAS = {
    "servicer": ("servicer.mass_0", "servicer.J_S"),
    "target": ("target.mass", "target.J_T"),
}


def _place(
    result: Result, rows: Rows, arrays: Arrays, names: tuple[str, str], orbit: bool
) -> tuple[str, str]:
    """Return the names of the scene's arrays with the position and the attitude of a body; names:
    variables with position and attitude; orbit: whether the target is in orbit, so that positions
    are relative to it.
    """
    r, q = names
    relative = f"{r} - {TARGET}" if orbit else r
    return arrays.sample(result, rows, relative), arrays.sample(result, rows, q)


def _servicer(
    result: Result, rows: Rows, arrays: Arrays, orbit: bool, outfit: Outfit | None
) -> tuple[Body, Array]:
    size, middle = _size(result, "servicer", outfit.root if outfit else None), np.zeros(3)
    unit = thrusters(result)
    parts = []
    if unit is not None:
        fitted = np.flatnonzero(unit[2] > 0)
        size, middle = bodies.hull_of(unit[0][fitted])
        parts = [bodies.nozzle(unit[0][k], unit[1][k], 0.08 * size.max()) for k in fitted]
    moves = flexible.moves(result)
    parts += (
        [bodies.box(size, middle, "shell")]
        if moves
        else [
            bodies.box(size, middle),
            *bodies.wings(size),
        ]
    )
    links = flexible.links(result, rows, arrays) if moves else ()
    radius = reach = float(np.linalg.norm(size) / 2)
    if outfit is not None:
        parts, links = [*parts, *outfit.servicer], (*links, *outfit.links)
        reach = max(reach, outfit.reach)
    elif result.holds(parameters=("guidance.rho_M",)):
        face = size[0] / 2 + middle[0]
        far = float(result.parameter("guidance.rho_M")) - face - _target_face(result)
        parts += bodies.arm(max(far, 0.2 * face), face, 0.04 * size.max())
    place = _place(result, rows, arrays, (SERVICER, "servicer.q_SN"), orbit)
    return Body("servicer", *place, parts, 0, radius, links, reach=reach), size


def _points(
    result: Result, rows: Rows, arrays: Arrays, orbit: bool, outfit: Outfit | None
) -> list[Body]:
    """Return one body without parts for each point of the outfit whose path is drawn, such as an
    end effector.
    """
    paths = outfit.paths if outfit else ()
    return [
        Body(name, *_place(result, rows, arrays, (r, q), orbit), [], 2, 0.1) for name, r, q in paths
    ]


def _size(result: Result, body: str, mount: Array | None) -> Array:
    """Return the edges of the box that represents a body [m]; mount: point that must be on its
    surface (None: no such point).
    """
    if mount is None:
        return bodies.edges(result, *INERTIAS[body])
    return bodies.edges_through(result, *INERTIAS[body], mount)


def _target_face(result: Result) -> float:
    """Return the distance of the grasp point from the centre of the target [m]."""
    axis, size = zones.grasp_axis(result), _size(result, "target", None)
    return float(0.5 / np.max(np.abs(axis) / size)) if axis is not None else float(size.max() / 2)


def _target(  # noqa: PLR0913, PLR0917 - data and settings of the drawing
    result: Result, rows: Rows, arrays: Arrays, orbit: bool, trail: bool, outfit: Outfit | None
) -> Body:
    size = _size(result, "target", outfit.seat if outfit else None)
    parts = [bodies.box(size), *bodies.wings(size)]
    if outfit is not None:
        parts += outfit.target
    elif (axis := zones.grasp_axis(result)) is not None:
        parts.append(bodies.ring(axis, size, 0.18 * float(size.min())))
    place = _place(result, rows, arrays, (TARGET, "target.q_TN"), orbit)
    return Body("target", *place, parts, 1, float(np.linalg.norm(size) / 2), trail=trail)


def pairs(results: Mapping[str, Result], arrays: Arrays, fit: Fit = bare) -> Scene | None:
    """Return the scene of several runs: the servicer of each run about the target of the longest
    run; None if no run is an approach. After the end of a shorter run, its servicer stays at its
    last position. results: results of the runs, by label.
    """
    moving = {n: r for n, r in results.items() if len(r.time) > 1 and r.holds(*PAIR)}
    if not moving:
        return None
    longest = max(moving.values(), key=lambda result: float(result.time[-1]))
    rows = instants(longest, "target.q_TN")
    time, orbit = longest.time[rows], in_orbit(longest[TARGET][rows])
    found, numbers = [], []
    timeline: dict[str, list[Scene]] = {"events": [], "phases": [], "rules": [], "plans": []}
    for k, (label, result) in enumerate(moving.items()):
        own = np.minimum(np.searchsorted(result.time, time - INSTANT), len(result.time) - 1)
        outfit = fit(result, own, arrays)
        body, _ = _servicer(result, own, arrays, orbit, outfit)
        found.append(body._replace(name=label, colour=k))
        apart = arrays.sample(result, own, DISTANCE)
        numbers.append({"name": label, "unit": "m", "factor": 1.0, "values": apart})
        course = _course(result, outfit)
        timeline["events"] += of_run(label, course["events"])
        timeline["phases"] += [phase | {"run": label} for phase in course["phases"]]
        timeline["rules"] += zones.overall(label, result, own, arrays)
        timeline["plans"] += plans(result, own, arrays, label)
    outfit = fit(longest, rows, arrays)
    client = _target(longest, rows, arrays, orbit, False, outfit)._replace(colour=NEUTRAL)
    return scene(
        arrays,
        time,
        "target" if orbit else "origin of N",
        [*found, client],
        **frames(longest, arrays, rows, TARGET, VELOCITIES[1]),
        **(sky(longest, arrays, rows, TARGET, _planet(longest)) if orbit else {}),
        centre="target",
        zones=zones.zones(longest, rows, arrays, orbit, checked=False),
        spots=_spots(longest, outfit),
        numbers=numbers,
        **timeline,
    )


INSTANT = 1e-6
"""Difference of times up to which they count as equal [s]."""
NEUTRAL = 7
"""Index of the colour of parts that belong to no run."""


def _planet(result: Result) -> float:
    """Return the radius of the planet [m], 0 if no parameter defines it."""
    return max(zones.parameter(result, "target.R_E"), zones.parameter(result, "monitor.R_E"))


# ---- plans


def plans(result: Result, rows: Rows, arrays: Arrays, body: str = "servicer") -> list[Scene]:
    """Return an entry per planner with the names of two arrays: `points`, the positions of its plan
    relative to the target in N axes (rows, 3 columns per point), and `mode` (0: the force follows
    the present plan, 1: an older plan, other values: no plan). body: name of the body
    that is to follow the plan.
    """
    return [
        {
            "body": body,
            "points": arrays.sample(result, rows, f"{name}.plan_rho_N"),
            "mode": arrays.sample(result, rows, f"{name}.mode"),
        }
        for name in PLANNERS
        if result.holds(f"{name}.plan_rho_N", f"{name}.mode")
    ]


# ---- plumes

COMMANDS = ("allocation.throttle", "controller.throttle")
FORCES = ("controller.F_cmd_S", "propulsion.F_S")


def _plumes(result: Result, rows: Rows, arrays: Arrays, size: Array) -> list[Scene]:
    """Return the plumes of the replay: one per thruster with its command as share of the nominal
    thrust; without thrusters, one per direction of the body axes with the force in this direction
    (commanded or, if the result has no command, applied) as share of the largest component of the
    force in the run.
    """
    unit = thrusters(result)
    command = next((name for name in COMMANDS if name in result), None)
    if unit is not None and command is not None:
        places, directions, nominal = unit
        return [
            _plume(places[k], directions[k], _share(result, rows, arrays, f"{command}[{k + 1}]"))
            | {"source": command}
            for k in np.flatnonzero(nominal > 0)
        ]
    force = next((name for name in FORCES if name in result), None)
    if force is None or not np.nanmax(np.abs(result[force])):
        return []
    text = f"{{}} * {force}[{{}}] / max(abs({force}))"
    return [
        _plume(-side * axis * size / 2, side * axis,
               _share(result, rows, arrays, text.format(side, k + 1))) | {"source": force}
        for k, axis in enumerate(np.eye(3))
        for side in (1, -1)
    ]  # fmt: skip


def _plume(at: Array, force: Array, share: str) -> Scene:
    return {
        "body": "servicer",
        "at": np.asarray(at, dtype=float).tolist(),
        "out": (-np.asarray(force, dtype=float)).tolist(),
        "share": share,
    }


def _share(result: Result, rows: Rows, arrays: Arrays, text: str) -> str:
    """Return the name of the array with the mean of an expression from one instant of the replay to
    the next, so that even a short pulse is visible. Negative values are drawn as 0.
    """
    return arrays.sample(result, rows, text, over="mean")


# ---- thrusters

THRUSTERS = ("thruster_position", "thruster_direction", "thrust_nominal", "centre_of_mass")


def thrusters(result: Result, component: str = "propulsion") -> tuple[Array, Array, Array] | None:
    """Return positions from the centre of mass (n, 3) [m], directions of the force (n, 3) and
    nominal thrusts (n,) [N] of the thrusters; None if the component has none.
    """
    names = [f"{component}.{name}" for name in THRUSTERS]
    if not result.holds(parameters=names):
        return None
    position, direction, nominal, centre = (result.parameter(name) for name in names)
    return position - centre, direction, nominal
