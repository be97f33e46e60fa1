# SPDX-License-Identifier: BSD-2-Clause
"""A replay as data: bodies with their parts, where they are and how they stand at chosen rows,
marks that belong to a body or to a frame, and what is far away.

Positions are relative to the origin of the scene, in N axes; attitudes are quaternions of the body
relative to N, scalar first, v_N = q v_B q*. With the quaternion of the Hill frame the page turns
all of it into H axes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from harness.errors import HarnessError, library
from harness.exchange.bodies import instants as utc
from harness.exchange.bodies import names_of, shadow, sun_direction
from harness.report import bodies
from harness.report.arrays import Arrays
from harness.results.histories import quaternion, rotation_angle
from harness.results.result import Array, Result, Rows
from harness.system.instants import days_since_j2000

Scene = dict[str, Any]

LEAST, MOST = 600, 3000
"""Instants of a replay."""
TURN = np.radians(8)
"""Angle that a body turns between two instants, if MOST allows it."""
IN_ORBIT = 1e6
"""A body farther than that [m] from the origin of N is in orbit, and has a Hill frame."""
HILL = {"key": "H", "name": "Hill frame", "axes": ["radial", "along track", "normal"]}
EARTH = 6378137.0
"""Equatorial radius of the planet where no parameter says it [m]."""
RATE = 7.292115e-5
"""Turn of the Earth [rad/s]."""
LIKE = 0.01
"""A radius that differs by less, as a part, is that of the Earth."""
UNDATED = "no date: turn of the Earth arbitrary"
INERTIAL = {"key": "N", "name": "inertial axes", "axes": ["x N", "y N", "z N"]}


def instants(result: Result, *attitudes: str) -> Rows:
    """Rows of the replay, equally spaced, so many that turning bodies are followed."""
    histories = (result[name] for name in attitudes)
    turned = (float(np.nansum(rotation_angle(q[:-1], q[1:]))) for q in histories)
    count = int(np.clip(max(turned, default=0.0) / TURN, LEAST, MOST))
    last = len(result.time) - 1
    return np.unique(np.linspace(0, last, min(count, last + 1)).round().astype(np.intp))


def hill_quaternion(r: Array, v: Array) -> Array:
    """Quaternion (rows, 4) of the Hill frame of an orbit relative to N: x: r, z: r x v."""
    normal = np.cross(r, v)
    axes = (r, np.cross(normal, r), normal)
    return quaternion(*(each / np.linalg.norm(each, axis=1)[:, None] for each in axes))


def in_orbit(r: Array) -> bool:
    """Whether positions r (rows, 3) [m] about the origin of N are those of an orbit."""
    return bool(np.linalg.norm(r[0]) > IN_ORBIT)


class Body(NamedTuple):
    """A body of the scene: position and attitude (rows), its parts, bodies that hang on it."""

    name: str
    r: Array
    q: Array
    parts: list[bodies.Part]
    colour: int
    radius: float
    links: tuple[dict[str, Any], ...] = ()
    trail: bool = True
    reach: float = 0.0
    """Distance of its farthest part, if that is beyond the radius of its hull."""


def scene(arrays: Arrays, time: Array, origin: str, found: list[Body], **about: Any) -> Scene:
    """Bodies at the instants `time` [s] about an origin, with what else is about the scene."""
    instants, shown = arrays.keep(time), []
    for body in found:
        kept = {"r": arrays.keep(body.r), "q": arrays.keep(body.q), "links": list(body.links)}
        shown.append(body._asdict() | kept)
    return {"time": instants, "origin": origin, "bodies": shown, **about}


def frames(arrays: Arrays, r: Array, v: Array) -> Scene:
    """Hill frame and both kinds of axes in orbit; N only in deep space, where the Hill frame, if
    position and velocity make one, carries what a mission has in it.
    """
    found: Scene = {"frames": [HILL, INERTIAL] if in_orbit(r) else [INERTIAL]}
    if in_orbit(r) or np.linalg.norm(np.cross(r, v), axis=1).all():
        found["hill"] = arrays.keep(hill_quaternion(r, v))
    return found


def joint(
    at: Any, angle: str, index: int, parts: list[bodies.Part], axis: Any = (0, 0, 1), **about: Any
) -> Scene:
    """What turns about an axis of what carries it, by a column of an array of angles."""
    place, along = ([float(x) for x in v] for v in (at, axis))
    return {"at": place, "axis": along, "angle": angle, "index": index, "parts": parts, **about}


def number(  # noqa: PLR0913, PLR0917 - what is shown, and how
    result: Result,
    arrays: Arrays,
    rows: Rows,
    name: str,
    words: tuple[str, ...] = (),
    text: str = "",
) -> Scene:
    """A number that runs along with the replay; angles in degrees; words: shown in place of the
    whole numbers from 0 on; text: what it is, else the name of the variable in words.
    """
    angle = result.unit(name) == "rad"
    return {
        "name": text or name.partition(".")[2].replace("_", " "),
        "unit": "deg" if angle else result.unit(name),
        "factor": float(np.degrees(1.0)) if angle else 1.0,
        "values": arrays.keep(result[name][rows]),
        **({"words": words} if words else {}),
    }


# ---- what is far away: the planet and its turn, the Sun, the shadow


def sky(result: Result, arrays: Arrays, rows: Rows, r: Array, radius: float = 0.0) -> Scene:
    """Planet, Sun and shadow of a scene whose origin is at r (rows, 3) [m] from the centre of the
    planet; radius: of that [m], 0: the Earth's.

    Where the Sun stands and how far the Earth has turned follow from the date of the run. Without
    one the Sun is where a parameter of the run has it, if one does, and the turn begins anywhere:
    the replay says so. The coasts are drawn on a body with the radius of the Earth only: those of
    Natural Earth at 1:110m, which is in the public domain, simplified (`page/coasts.json`).
    """
    turn, towards = _dated(result, rows)
    planet = {
        "r": arrays.keep(-r),
        "radius": min(radius or EARTH, 0.99 * float(np.linalg.norm(r, axis=1).min())),
        "coasts": abs((radius or EARTH) / EARTH - 1) < LIKE,
        "turn": arrays.keep(np.unwrap(turn)),
    }
    if towards is not None:
        return {"planet": planet, "sun": _sun(arrays, r, towards)}
    if (fixed := _fixed(result)) is None:
        return {"planet": planet, "undated": f"{UNDATED}, Sun not shown"}
    undated = f"{UNDATED}, Sun where a parameter has it"
    return {"planet": planet, "sun": _sun(arrays, r, fixed[None]), "undated": undated}


def _sun(arrays: Arrays, r: Array, towards: Array) -> Scene:
    every = np.broadcast_to(towards, r.shape)
    return {"towards": arrays.keep(towards), "shadow": arrays.keep(shadow(r, every))}


def _dated(result: Result, rows: Rows) -> tuple[Array, Array | None]:
    """Turn of the Earth [rad] and direction of the Sun, None without a date or the library."""
    epoch = result.provenance.epoch if result.provenance else ""
    if epoch:
        try:
            dates = utc(result, epoch)[rows]
            turn = library("erfa", "exchange").era00(2451545.0, days_since_j2000(dates))
            return np.asarray(turn, dtype=np.float64), sun_direction(dates)
        except HarnessError:
            pass
    return RATE * result.time[rows], None


def _fixed(result: Result) -> Array | None:
    """The direction of the Sun that a parameter of the run says."""
    table = result.parameters
    wanted = {names.sun for names in names_of(result) if names.sun}
    for name in table.vectors if table else ():
        if name.rpartition(".")[2] in wanted:
            found = np.asarray(result.parameter(name), dtype=np.float64)
            return np.asarray(found / np.linalg.norm(found))
    return None
