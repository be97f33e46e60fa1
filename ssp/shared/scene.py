# SPDX-License-Identifier: BSD-2-Clause
"""Scene of a replay as data: bodies with their parts, and their positions and attitudes at selected
instants, and further parts such as zones.

Positions are relative to the origin of the scene, in axes of frame N. Attitudes are quaternions of
the body relative to N, scalar first, v_N = q v_B q*. The page transforms both into the Hill frame H
by the quaternion of this frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from harness.report.arrays import Arrays
from harness.results.result import Array, Result, Rows

from .relative_motion import rotation_angle

Scene = dict[str, Any]
Part = dict[str, Any]
"""Shape that the page draws: `kind` (box, panel, ...), `at` (centre in body axes; rod, cup: ends
`from` and `to`) and sizes [m].
"""

LEAST, MOST = 600, 3000
"""Smallest and largest number of instants of a replay."""
TURN = np.radians(8)
"""Largest mean angle by which a body turns between two instants [rad], unless MOST instants are too
few for it.
"""


def instants(result: Result, *attitudes: str) -> Rows:
    """Return the equally spaced rows of a result that a replay shows, so many that bodies turn on
    average by at most TURN between two; attitudes: quaternion variables of the bodies.
    """
    histories = (result[name] for name in attitudes)
    turned = (float(np.nansum(rotation_angle(q[:-1], q[1:]))) for q in histories)
    count = int(np.clip(max(turned, default=0.0) / TURN, LEAST, MOST))
    last = len(result.time) - 1
    return np.unique(np.linspace(0, last, min(count, last + 1)).round().astype(np.intp))


class Body(NamedTuple):
    """Body of a scene.

    r, q: names of the arrays of its positions (instants, 3) and attitudes (instants, 4); parts: its
    shapes; colour: index in the palette of the page; radius: radius of the sphere around its hull
    [m]; links: parts that turn on joints, see joint(); trail: whether its path is drawn.
    """

    name: str
    r: str
    q: str
    parts: list[Part]
    colour: int
    radius: float
    links: tuple[dict[str, Any], ...] = ()
    trail: bool = True
    reach: float = 0.0
    """Distance of the farthest part from the body's origin [m], 0 if all are inside `radius`."""


def scene(arrays: Arrays, time: Array, origin: str, found: list[Body], **about: Any) -> Scene:
    """Return a scene with the bodies `found` at the instants `time` [s].

    arrays: arrays of the page, among which `time` is stored; origin: name of the point that is the
    origin of all positions; about: further entries of the scene.
    """
    shown = [body._asdict() | {"links": list(body.links)} for body in found]
    return {"time": arrays.store(time), "origin": origin, "bodies": shown, **about}


def joint(
    at: Any, angle: str, index: int, parts: list[Part], axis: Any = (0, 0, 1), **about: Any
) -> Scene:
    """Return a link: parts that turn about an axis, which is fixed in the body or link to which the
    new link is attached.

    at: point on the axis [m]; angle, index: name of the array of angles [rad], and its column;
    about: further entries, such as `links` that this link carries.
    """
    place, along = ([float(x) for x in v] for v in (at, axis))
    return {"at": place, "axis": along, "angle": angle, "index": index, "parts": parts, **about}


def number(  # noqa: PLR0913, PLR0917 - the value and its presentation
    result: Result, arrays: Arrays, rows: Rows, name: str, words: Sequence[str] = (), text: str = ""
) -> Scene:
    """Return the entry of a scene for a variable whose value the replay shows as a number, angles
    in degrees.

    arrays: arrays of the page, among which the values are stored; rows: rows of the result at the
    instants of the replay; words: texts to show in place of the values 0, 1, ...; text: label
    (default: the name of the variable with spaces).
    """
    angle = result.unit(name) == "rad"
    return {
        "name": text or name.partition(".")[2].replace("_", " "),
        "unit": "deg" if angle else result.unit(name),
        "factor": float(np.degrees(1.0)) if angle else 1.0,
        "values": arrays.sample(result, rows, name),
        **({"words": words} if words else {}),
    }


def runs_of(values: Array, time: Array, words: tuple[str, ...]) -> list[Scene]:
    """Return the time spans in which a variable is constant, each with `begin` and `end` [s] and
    the `text` of its value.

    values: whole numbers (rows,); time: of the rows [s]; words: texts of the values 0, 1, ...
    """
    edges = np.flatnonzero(np.diff(values, prepend=np.nan))
    ends = [*time[edges[1:]], time[-1]]
    return [
        {"begin": float(time[k]), "end": float(end), "text": words[int(values[k])]}
        for k, end in zip(edges, ends, strict=True)
    ]
