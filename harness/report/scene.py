# SPDX-License-Identifier: BSD-2-Clause
"""Which replay fits a result, and the replay as data: bodies with their parts, where they are and
how they stand at chosen rows, marks that belong to a body or to a frame.

Positions are relative to the origin of the scene, in N axes; attitudes are quaternions of the body
relative to N, scalar first, v_N = q v_B q*. With the quaternion of the Hill frame the page turns
all of it into H axes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from harness.mission.library import of_result
from harness.mission.mission import together
from harness.report import bodies, models
from harness.report.arrays import Arrays
from harness.report.story import told, told_of_several
from harness.results.alignment import rotation_angle
from harness.results.result import Array, Result, Rows

Scene = dict[str, Any]

LEAST, MOST = 600, 3000
"""Instants of a replay."""
TURN = np.radians(8)
"""Angle that a body turns between two instants, if MOST allows it."""
IN_ORBIT = 1e6
"""A body farther than that [m] from the origin of N is in orbit, and has a Hill frame."""
HILL = {"key": "H", "name": "Hill frame", "axes": ["radial", "along track", "normal"]}
INERTIAL = {"key": "N", "name": "inertial axes", "axes": ["x N", "y N", "z N"]}


def instants(result: Result, *attitudes: str) -> Rows:
    """Rows of the replay, equally spaced, so many that turning bodies are followed."""
    turned = [_turned(result[name]) for name in attitudes]
    count = int(np.clip(max(turned, default=0.0) / TURN, LEAST, MOST))
    last = len(result.time) - 1
    return np.unique(np.linspace(0, last, min(count, last + 1)).round().astype(np.intp))


def _turned(q: Array) -> float:
    return float(np.nansum(rotation_angle(q[:-1], q[1:])))


def hill_quaternion(r: Array, v: Array) -> Array:
    """Quaternion (rows, 4) of the Hill frame of an orbit relative to N: x: r, z: r x v."""
    normal = np.cross(r, v)
    axes = (
        each / np.linalg.norm(each, axis=1)[:, None] for each in (r, np.cross(normal, r), normal)
    )
    (a, d, g), (b, e, h), (c, f, i) = (axis.T for axis in axes)
    # 4 q q^T row by row; the row with the largest element of its own is the exactest
    rows = (
        (1 + a + e + i, h - f, c - g, d - b),
        (h - f, 1 + a - e - i, b + d, c + g),
        (c - g, b + d, 1 - a + e - i, f + h),
        (d - b, c + g, f + h, 1 - a - e + i),
    )
    best, most = np.stack(rows[0], axis=1), rows[0][0]
    for k in (1, 2, 3):
        larger = rows[k][k] > most
        best = np.where(larger[:, None], np.stack(rows[k], axis=1), best)
        most = np.where(larger, rows[k][k], most)
    return np.asarray(best / np.linalg.norm(best, axis=1)[:, None])


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
    return {
        "time": arrays.keep(time),
        "origin": origin,
        "bodies": [
            {
                **body._asdict(),
                "r": arrays.keep(body.r),
                "q": arrays.keep(body.q),
                "links": list(body.links),
            }
            for body in found
        ],
        **about,
    }


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


def replay(result: Result, arrays: Arrays) -> Scene | None:
    """The replay of a result; None if it holds nothing that moves."""
    if len(result.time) < 2:
        return None
    for kind in of_result(result).scene:
        if result.holds(*kind.needs, parameters=kind.parameters):
            found = kind.build(result, arrays)
            if files := models.named(result):
                found = models.dressed(found, files, arrays)
            return told(result, arrays, found)
    return None


def replay_several(results: Mapping[str, Result], arrays: Arrays) -> Scene | None:
    """The replay of several runs by label in one scene; None if their mission has none."""
    for kind in together(map(of_result, results.values())).scene:
        if kind.several and (found := kind.several(results, arrays)):
            return told_of_several(results, found)
    return None
