# SPDX-License-Identifier: BSD-2-Clause
"""Replay as data: bodies with their parts, positions and attitudes at chosen rows, and zones that
belong to a body or to a frame.

Positions are relative to the origin of the scene, in N axes; attitudes are quaternions of the body
relative to N, scalar first, v_N = q v_B q*. With the quaternion of the Hill frame the page
transforms them into H axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from harness.report.arrays import Arrays
from harness.results.histories import rotation_angle
from harness.results.result import Array, Result, Rows

Scene = dict[str, Any]
Part = dict[str, Any]
"""A shape that the page draws: `kind`, `at` (centre, body axes) and sizes [m]."""

LEAST, MOST = 600, 3000
"""Smallest and largest number of instants of a replay."""
TURN = np.radians(8)
"""Angle by which a body turns between two instants, if MOST permits [rad]."""


def instants(result: Result, *attitudes: str) -> Rows:
    """Return the rows of the replay, equally spaced, enough of them to follow turning bodies."""
    histories = (result[name] for name in attitudes)
    turned = (float(np.nansum(rotation_angle(q[:-1], q[1:]))) for q in histories)
    count = int(np.clip(max(turned, default=0.0) / TURN, LEAST, MOST))
    last = len(result.time) - 1
    return np.unique(np.linspace(0, last, min(count, last + 1)).round().astype(np.intp))


class Body(NamedTuple):
    """Body of the scene: names of the arrays of its position and attitude, its parts, bodies that
    hang on it.
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
    """Distance of its farthest part, if that is beyond the radius of its hull."""


def scene(arrays: Arrays, time: Array, origin: str, found: list[Body], **about: Any) -> Scene:
    """Return bodies at the instants `time` [s] about an origin, with further parts of the scene."""
    shown = [body._asdict() | {"links": list(body.links)} for body in found]
    return {"time": arrays.store(time), "origin": origin, "bodies": shown, **about}


def joint(
    at: Any, angle: str, index: int, parts: list[Part], axis: Any = (0, 0, 1), **about: Any
) -> Scene:
    """Return a link that turns about an axis of the body or link that carries it; angle, index:
    array of angles and column.
    """
    place, along = ([float(x) for x in v] for v in (at, axis))
    return {"at": place, "axis": along, "angle": angle, "index": index, "parts": parts, **about}


def number(  # noqa: PLR0913, PLR0917 - what is shown, and how
    result: Result, arrays: Arrays, rows: Rows, name: str, words: Sequence[str] = (), text: str = ""
) -> Scene:
    """Return a value that the replay shows, with angles in degrees; words: shown in place of the
    numbers 0, 1, ...; text: name of the value, by default the name of the variable in words.
    """
    angle = result.unit(name) == "rad"
    return {
        "name": text or name.partition(".")[2].replace("_", " "),
        "unit": "deg" if angle else result.unit(name),
        "factor": float(np.degrees(1.0)) if angle else 1.0,
        "values": arrays.sample(result, rows, name),
        **({"words": words} if words else {}),
    }
