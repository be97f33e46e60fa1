# SPDX-License-Identifier: BSD-2-Clause
"""The replay of an approach: servicers about their target, zones and axes, plumes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from harness.report.arrays import Arrays
from harness.report.scene import Body, Part, Scene, instants, scene
from harness.report.story import event, of_run
from harness.results.result import Array, Result, Rows

from . import approach_marks as marks
from . import bodies, flexible
from .relative_motion import SERVICER, TARGET, VELOCITIES, release_time
from .sky import frames, in_orbit, sky

PAIR = (SERVICER, TARGET, *VELOCITIES, "servicer.q_SN", "target.q_TN")


class Outfit(NamedTuple):
    """What a mission mounts on servicer and target in place of the sign of an arm and a ring.

    servicer, target: parts; links: what moves on the servicer, reach: as far from S [m]; root,
    seat: points on the hulls of servicer and target [m], where nothing else says how large they
    are; numbers, phases, events: what runs along; course: the history of the phases, with their
    words and those that are alarms; paths: name, position and attitude of points that leave one;
    spot: what the seat is called.
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
"""The outfit of a result at these rows; None if it does not hold what says it."""


def bare(_: Result, __: Rows, ___: Arrays) -> None:
    """No outfit."""


def pair(result: Result, arrays: Arrays, fit: Fit = bare) -> Scene:
    """A servicer about its target."""
    rows = instants(result, "servicer.q_SN", "target.q_TN")
    outfit = fit(result, rows, arrays)
    r, v = result[TARGET][rows], result[VELOCITIES[1]][rows]
    orbit = in_orbit(r)
    centre = r if orbit else np.zeros_like(r)
    chaser, size = _servicer(result, rows, arrays, centre, outfit)
    client = _target(result, rows, centre, not orbit, outfit)
    return scene(
        arrays,
        result.time[rows],
        "target" if orbit else "origin of N",
        [chaser, *_points(result, rows, centre, outfit), client],
        **frames(arrays, r, v),
        **(sky(result, arrays, rows, r, _planet(result)) if orbit else {}),
        centre="target",
        marks=marks.marks(result, rows, arrays, centre),
        rules=marks.rules(result, rows, arrays),
        sensors=marks.sensors(result),
        spots=_spots(result, outfit),
        plumes=_plumes(result, rows, arrays, size),
        range=arrays.keep(np.linalg.norm((result[SERVICER] - result[TARGET])[rows], axis=1)),
        speed=arrays.keep(
            np.linalg.norm((result[VELOCITIES[0]] - result[VELOCITIES[1]])[rows], axis=1)
        ),
        numbers=list(outfit.numbers) if outfit else [],
        **_course(result, outfit),
    )


def _course(result: Result, outfit: Outfit | None) -> Scene:
    """Phases and events: those of the outfit, when the attitude is released, when a rule aborts."""
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
    """The point of the target that shall be reached."""
    if outfit is not None:
        at, title, text = outfit.seat, "", outfit.spot
    elif (axis := marks.grasp_axis(result)) is not None:
        at, title, text = (
            axis * _target_face(result),
            marks.meaning(result, "guidance.p_T"),
            "grasp point",
        )
    else:
        return []
    return [{"body": "target", "at": np.asarray(at).tolist(), "text": text, "title": title}]


INERTIAS = {
    "servicer": ("servicer.mass_0", "servicer.J_S"),
    "target": ("target.mass", "target.J_T"),
}


def _servicer(
    result: Result, rows: Rows, arrays: Arrays, centre: Array, outfit: Outfit | None
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
    r, q = (result[name][rows] for name in (SERVICER, "servicer.q_SN"))
    return Body("servicer", r - centre, q, parts, 0, radius, links, reach=reach), size


def _points(result: Result, rows: Rows, centre: Array, outfit: Outfit | None) -> list[Body]:
    """What has a path and axes of its own and is drawn as a part of something else."""
    paths = outfit.paths if outfit else ()
    return [
        Body(name, result[r][rows] - centre, result[q][rows], [], 2, 0.1) for name, r, q in paths
    ]


def _size(result: Result, body: str, mount: Array | None) -> Array:
    """Edges of the hull of a body; of one with a mount, of the box that has it on its surface."""
    if mount is None:
        return bodies.edges(result, *INERTIAS[body])
    return bodies.edges_through(result, *INERTIAS[body], mount)


def _target_face(result: Result) -> float:
    """Distance of the grasp point from the centre of the target [m]."""
    axis, size = marks.grasp_axis(result), _size(result, "target", None)
    return float(0.5 / np.max(np.abs(axis) / size)) if axis is not None else float(size.max() / 2)


def _target(result: Result, rows: Rows, centre: Array, trail: bool, outfit: Outfit | None) -> Body:
    size = _size(result, "target", outfit.seat if outfit else None)
    parts = [bodies.box(size), *bodies.wings(size)]
    if outfit is not None:
        parts += outfit.target
    elif (axis := marks.grasp_axis(result)) is not None:
        parts.append(bodies.ring(axis, size, 0.18 * float(size.min())))
    r, q = result[TARGET][rows] - centre, result["target.q_TN"][rows]
    return Body("target", r, q, parts, 1, float(np.linalg.norm(size) / 2), trail=trail)


def pairs(results: Mapping[str, Result], arrays: Arrays, fit: Fit = bare) -> Scene | None:
    """The servicers of several runs, by label, about the target of the longest one; None if they
    are no such runs. A run that ended early stays where it was.
    """
    moving = {n: r for n, r in results.items() if len(r.time) > 1 and r.holds(*PAIR)}
    if not moving:
        return None
    longest = max(moving.values(), key=lambda result: float(result.time[-1]))
    rows = instants(longest, "target.q_TN")
    time, r, v = longest.time[rows], longest[TARGET][rows], longest[VELOCITIES[1]][rows]
    orbit = in_orbit(r)
    centre = r if orbit else np.zeros_like(r)
    found, numbers = [], []
    told: dict[str, list[Scene]] = {"events": [], "phases": [], "rules": []}
    for k, (label, result) in enumerate(moving.items()):
        own = np.minimum(np.searchsorted(result.time, time - INSTANT), len(result.time) - 1)
        about = result[TARGET][own] if orbit else centre
        outfit = fit(result, own, arrays)
        body, _ = _servicer(result, own, arrays, about, outfit)
        found.append(body._replace(name=label, colour=k))
        apart = np.linalg.norm((result[SERVICER] - result[TARGET])[own], axis=1)
        numbers.append({"name": label, "unit": "m", "factor": 1.0, "values": arrays.keep(apart)})
        course = _course(result, outfit)
        told["events"] += of_run(label, course["events"])
        told["phases"] += [phase | {"run": label} for phase in course["phases"]]
        told["rules"] += marks.overall(label, result, own, arrays)
    outfit = fit(longest, rows, arrays)
    client = _target(longest, rows, centre, False, outfit)._replace(colour=NEUTRAL)
    return scene(
        arrays,
        time,
        "target" if orbit else "origin of N",
        [*found, client],
        **frames(arrays, r, v),
        **(sky(longest, arrays, rows, r, _planet(longest)) if orbit else {}),
        centre="target",
        marks=marks.marks(longest, rows, arrays, centre, judged=False),
        spots=_spots(longest, outfit),
        numbers=numbers,
        **told,
    )


INSTANT = 1e-6
"""Times closer than this [s] are the same."""
NEUTRAL = 7
"""Colour of what belongs to no run."""


def _planet(result: Result) -> float:
    """Radius of the planet [m], 0 if no parameter says it."""
    return max(marks.parameter(result, "target.R_E"), marks.parameter(result, "monitor.R_E"))


# ---- plumes

COMMANDS = ("allocation.throttle", "controller.throttle")
FORCES = ("controller.F_cmd_S", "propulsion.F_S")


def _plumes(result: Result, rows: Rows, arrays: Arrays, size: Array) -> list[Scene]:
    """What the thrusters are commanded, as parts of the nominal thrust; without thrusters the
    commanded force along the body axes, as parts of its largest element.
    """
    unit = thrusters(result)
    command = next((name for name in COMMANDS if name in result), None)
    if unit is not None and command is not None:
        share = _mean_between(result[command], rows)
        places, directions, nominal = unit
        return [
            _plume(arrays, places[k], directions[k], share[:, k], command)
            for k in np.flatnonzero(nominal > 0)
        ]
    force = next((name for name in FORCES if name in result), None)
    if force is None or not (largest := np.nanmax(np.abs(result[force]))):
        return []
    share = _mean_between(result[force], rows) / largest
    return [
        _plume(
            arrays, -side * axis * size / 2, side * axis, np.maximum(side * share[:, k], 0), force
        )
        for k, axis in enumerate(np.eye(3))
        for side in (1, -1)
    ]


def _plume(arrays: Arrays, at: Array, force: Array, share: Array, source: str) -> Scene:
    return {
        "body": "servicer",
        "at": np.asarray(at, dtype=float).tolist(),
        "out": (-np.asarray(force, dtype=float)).tolist(),
        "share": arrays.keep(np.clip(share, 0, 1)),
        "source": source,
    }


def _mean_between(values: Array, rows: Rows) -> Array:
    """Mean of the rows from one instant to the next: a pulse is seen however short it is."""
    counts = np.diff(np.append(rows, len(values)))
    return np.asarray(np.add.reduceat(values, rows, axis=0) / counts[:, None])


# ---- thrusters

THRUSTERS = ("thruster_position", "thruster_direction", "thrust_nominal", "centre_of_mass")


def thrusters(result: Result, component: str = "propulsion") -> tuple[Array, Array, Array] | None:
    """Places from the centre of mass (n, 3) [m], directions of the force (n, 3) and nominal thrusts
    (n,) [N]; None without thrusters.
    """
    names = [f"{component}.{name}" for name in THRUSTERS]
    if not result.holds(parameters=names):
        return None
    position, direction, nominal, centre = (result.parameter(name) for name in names)
    return position - centre, direction, nominal
