# SPDX-License-Identifier: BSD-2-Clause
"""Shapes of the bodies of a replay, from the parameters of the run.

A plant with a shape (boxes and panels of the assembly, positions of the thrusters, lengths of the
links) is drawn with it. Any other body is the box of uniform density with its mass and its moments
of inertia

    edge_x^2 = 6 (J_y + J_z - J_x) / m

The hull of a servicer or target is the share HULL of that box, and panels, a symbol without data,
represent the rest. Parts are dictionaries that the page draws: `kind`, `at` (centre, body axes) and
sizes [m].
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from harness.report.scene import Part
from harness.results.result import Array, Result

SLIMMEST = 0.15
"""Least edge of a box as part of its largest."""
HULL = 0.6
"""Edges of a hull with panels, relative to the edges of the uniform box."""
EDGE = 1.0
"""Edge of a body whose mass or inertia the result does not hold [m]."""
WING = 1.6
"""Length of a panel as part of the longest edge of its hull."""
THIN = 0.03
"""Thickness of what is flat as part of the longest edge."""


def uniform_box(mass: float, inertia: Array) -> Array:
    """Return the edges (3,) [m] of the box of uniform density with that mass and the diagonal of
    inertia.
    """
    J = np.diag(inertia) if np.ndim(inertia) == 2 else np.asarray(inertia)
    squares = 6 * (J.sum() - 2 * J) / mass
    edges = np.sqrt(np.maximum(squares, 0))
    return np.asarray(np.maximum(edges, SLIMMEST * edges.max()))


def edges(result: Result, mass: str, inertia: str) -> Array:
    """Return the edges of the hull of a body, from two of its parameters; a cube if they are not
    known.
    """
    if not result.holds(parameters=(mass, inertia)):
        return np.full(3, EDGE)
    found = HULL * uniform_box(float(result.parameter(mass)), result.parameter(inertia))
    return found if found.max() > 0 else np.full(3, EDGE)


def edges_through(result: Result, mass: str, inertia: str, point: Any) -> Array:
    """Return the edges of the box with the proportions of edges() whose surface contains a point.
    The point at which a part is mounted determines the size of a hull better than HULL does.
    """
    found = edges(result, mass, inertia)
    return np.asarray(found * np.max(2 * np.abs(point) / found))


def box(size: Array, at: Any = (0, 0, 0), look: str = "hull") -> Part:
    """Return a box with edges along the axes of its body."""
    return {"kind": "box", "size": _plain(size), "at": _plain(at), "look": look}


def wings(size: Array) -> list[Part]:
    """Return two panels along y with the booms that carry them."""
    long = float(np.max(size))
    chord = max(0.6 * float(size[0]), 0.3 * long)
    span, gap = WING * long, 0.15 * long
    parts = []
    for side in (-1, 1):
        root = side * size[1] / 2
        panel = np.array([chord, span, THIN * long])
        parts += [
            rod((0, root, 0), (0, root + side * gap, 0), 0.02 * long),
            box(panel, (0, root + side * (gap + span / 2), 0), "panel"),
        ]
    return parts


def rod(begin: Any, end: Any, radius: float, look: str = "metal") -> Part:
    """Return a cylinder between two points."""
    return {"kind": "rod", "from": _plain(begin), "to": _plain(end), "radius": radius, "look": look}


def ball(at: Any, radius: float, look: str = "metal") -> Part:
    """Return a sphere."""
    return {"kind": "ball", "at": _plain(at), "radius": radius, "look": look}


def nozzle(at: Any, force: Any, size: float) -> Part:
    """Return a nozzle whose thrust acts along `force`. Its opening points the other way."""
    return {"kind": "nozzle", "at": _plain(at), "out": _plain(-np.asarray(force)), "size": size}


def arm(reach: float, face: float, radius: float) -> list[Part]:
    """Return a straight arm of two links along x, from the face of the body to the grasp point."""
    elbow, end = face + reach / 2, face + reach
    return [
        ball((face, 0, 0), 1.6 * radius),
        rod((face, 0, 0), (elbow, 0, 0), radius, "arm"),
        ball((elbow, 0, 0), 1.6 * radius),
        rod((elbow, 0, 0), (end, 0, 0), radius, "arm"),
        ball((end, 0, 0), 1.8 * radius, "accent"),
    ]


def ring(axis: Array, size: Array, radius: float) -> Part:
    """Return the grasp ring on the face of a box through which an axis leaves."""
    reach = 0.5 / np.max(np.abs(axis) / size)
    return hoop(axis * reach, axis, radius)


def hoop(at: Any, axis: Any, radius: float) -> Part:
    """Return a ring about an axis."""
    return {"kind": "ring", "at": _plain(at), "axis": _plain(axis), "radius": radius}


def cup(floor: Any, mouth: Any, radii: tuple[float, float]) -> Part:
    """Return an open cone from the centre of its floor to the centre of its mouth, with
    both radii.
    """
    return {"kind": "cup", "from": _plain(floor), "to": _plain(mouth), "radii": _plain(radii)}


def panels(area: Array, position: Array, normal: Array) -> Iterator[Part]:
    """Yield square panels of the assembly by area [m2], centre [m] and unit normal; area 0:
    none.
    """
    for size, place, direction in zip(area, position, normal, strict=True):
        if size > 0:
            edge = float(np.sqrt(size))
            yield {"kind": "panel", "at": _plain(place), "normal": _plain(direction), "edge": edge}


def shifted(parts: list[Part], by: Array) -> list[Part]:
    """Return the parts at a shifted position."""
    return [part | {"at": _plain(np.add(part["at"], by))} for part in parts]


def hull_of(places: Array) -> tuple[Array, Array]:
    """Return the edges and centre of the box around the places of thrusters."""
    low, high = places.min(axis=0), places.max(axis=0)
    size = high - low
    return np.maximum(size, SLIMMEST * size.max()), (low + high) / 2


def _plain(values: Any) -> list[float]:
    return [round(float(value), 6) for value in values]
