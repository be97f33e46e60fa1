# SPDX-License-Identifier: BSD-2-Clause
"""The replay of an approach: servicers about their target, zones and axes, plumes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from harness.report import bodies
from harness.report.arrays import Arrays
from harness.report.scene import Array, Body, Rows, Scene, frames, in_orbit, instants, scene
from harness.results.result import Result

from . import flexible
from .relative_motion import SERVICER, TARGET, VELOCITIES

PAIR = (SERVICER, TARGET, *VELOCITIES, "servicer.q_SN", "target.q_TN")


class Outfit(NamedTuple):
    """What a mission mounts on servicer and target in place of the sign of an arm and a ring.

    servicer, target: parts; links: what moves on the servicer, reach: as far from S [m]; root,
    seat: points on the hulls of servicer and target [m], where nothing else says how large they
    are; numbers, events: what runs along; paths: name, position and attitude of points that
    leave one.
    """

    servicer: list[bodies.Part]
    target: list[bodies.Part]
    seat: Array
    links: tuple[Scene, ...] = ()
    reach: float = 0.0
    root: Array | None = None
    numbers: tuple[Scene, ...] = ()
    events: tuple[Scene, ...] = ()
    paths: tuple[tuple[str, str, str], ...] = ()


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
        **frames(arrays, r, v, _planet(result)),
        marks=_marks(result, rows, arrays, centre),
        plumes=_plumes(result, rows, arrays, size),
        range=arrays.keep(np.linalg.norm((result[SERVICER] - result[TARGET])[rows], axis=1)),
        speed=arrays.keep(
            np.linalg.norm((result[VELOCITIES[0]] - result[VELOCITIES[1]])[rows], axis=1)
        ),
        **({"numbers": list(outfit.numbers), "events": list(outfit.events)} if outfit else {}),
    )


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
    axis, size = _grasp_axis(result), _size(result, "target", None)
    return float(0.5 / np.max(np.abs(axis) / size)) if axis is not None else float(size.max() / 2)


def _grasp_axis(result: Result) -> Array | None:
    if not result.holds(parameters=("guidance.p_T",)):
        return None
    axis = np.asarray(result.parameter("guidance.p_T"))
    return np.asarray(axis / np.linalg.norm(axis))


def _target(result: Result, rows: Rows, centre: Array, trail: bool, outfit: Outfit | None) -> Body:
    size = _size(result, "target", outfit.seat if outfit else None)
    parts = [bodies.box(size), *bodies.wings(size)]
    if outfit is not None:
        parts += outfit.target
    elif (axis := _grasp_axis(result)) is not None:
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
    for k, (label, result) in enumerate(moving.items()):
        own = np.minimum(np.searchsorted(result.time, time - INSTANT), len(result.time) - 1)
        about = result[TARGET][own] if orbit else centre
        body, _ = _servicer(result, own, arrays, about, fit(result, own, arrays))
        found.append(body._replace(name=label, colour=k))
        apart = np.linalg.norm((result[SERVICER] - result[TARGET])[own], axis=1)
        numbers.append({"name": label, "unit": "m", "factor": 1.0, "values": arrays.keep(apart)})
    outfit = fit(longest, rows, arrays)
    client = _target(longest, rows, centre, False, outfit)._replace(colour=NEUTRAL)
    return scene(
        arrays,
        time,
        "target" if orbit else "origin of N",
        [*found, client],
        **frames(arrays, r, v, _planet(longest)),
        marks=_marks(longest, rows, arrays, centre),
        numbers=numbers,
    )


INSTANT = 1e-6
"""Times closer than this [s] are the same."""
NEUTRAL = 7
"""Colour of what belongs to no run."""


def _planet(result: Result) -> float:
    """Radius of the planet [m], 0 if no parameter says it."""
    return max(_parameter(result, "target.R_E"), _parameter(result, "monitor.R_E"))


# ---- marks


def _marks(result: Result, rows: Rows, arrays: Arrays, centre: Array) -> list[Scene]:
    """Zones, corridor, grasp axis, reference position."""
    found = [*_zones(result), *_corridor(result)]
    if (axis := _grasp_axis(result)) is not None:
        length = max(
            _parameter(result, "guidance.rho_0"), 1.5 * _parameter(result, "guidance.rho_f")
        )
        found.append(
            {
                "kind": "axis",
                "on": "target",
                "axis": axis.tolist(),
                "length": length or 10.0,
                "text": _meaning(result, "guidance.p_T"),
            }
        )
    if "guidance.rho_ref_N" in result and result["guidance.rho_ref_N"].any():
        place = (result["guidance.rho_ref_N"] + result[TARGET])[rows] - centre
        text = result.description("guidance.rho_ref_N") or "guidance.rho_ref_N"
        found.append({"kind": "point", "on": "N", "r": arrays.keep(place), "text": text})
    return found


def _zones(result: Result) -> list[Scene]:
    """The keep-out zone of the monitor; without one, the distance that the guidance holds."""
    names = [f"monitor.{n}" for n in ("keep_out_shape", "keep_out_half", "keep_out_axes")]
    if result.holds(parameters=names) and result.parameter(names[0]) > 0:
        shape, half, axes = (result.parameter(name) for name in names)
        kind = "ellipsoid" if shape == 1 else "cuboid"
        on = "target" if axes else "H"
        text = _meaning(result, names[1])
        return [{"kind": kind, "on": on, "half": half.tolist(), "text": text}]
    for name in ("guidance.rho_M", "guidance.rho_f", "guidance.zeta1"):
        if radius := _parameter(result, name):
            text = _meaning(result, name)
            return [{"kind": "ellipsoid", "on": "target", "half": [radius] * 3, "text": text}]
    return []


def _corridor(result: Result) -> list[Scene]:
    """The approach corridor of the monitor: a cone."""
    names = [f"monitor.corridor_{n}" for n in ("axis", "apex", "half_angle", "length", "axes")]
    if not result.holds(parameters=(*names, "monitor.use_corridor")):
        return []
    if not result.parameter("monitor.use_corridor"):
        return []
    axis, apex, angle, length, axes = (result.parameter(name) for name in names)
    farthest = np.linalg.norm(result[SERVICER] - result[TARGET], axis=1).max()
    return [
        {
            "kind": "cone",
            "on": "target" if axes else "H",
            "axis": axis.tolist(),
            "at": apex.tolist(),
            "angle": float(angle),
            "length": float(length or 1.1 * farthest),
            "text": _meaning(result, names[2]),
        }
    ]


def _parameter(result: Result, name: str) -> float:
    return float(result.parameter(name)) if result.holds(parameters=(name,)) else 0.0


def _meaning(result: Result, name: str) -> str:
    text = result.parameters.description(name) if result.parameters else ""
    return f"{name}: {text}" if text else name


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
