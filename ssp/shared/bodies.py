# SPDX-License-Identifier: BSD-2-Clause
"""Shapes of the bodies of a 3D replay, from the parameters of the run.

A plant whose parameters state its shape (boxes and panels of the assembly, positions of thrusters,
lengths of links) is drawn in that shape. Any other body is drawn as the box of uniform density with
its mass m and its moments of inertia J:

    edge_x^2 = 6 (J_y + J_z - J_x) / m

The hull of a servicer or target has HULL times these edges, and symbolic solar panels at the hull
represent the rest of the inertia. Parts are dictionaries that the page draws: `kind`, `at` (centre,
body axes; rods and cups have the ends `from` and `to` instead) and sizes [m].
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from harness.results.result import Array, Result

from .scene import Part

SLIMMEST = 0.15
"""Smallest ratio of the least to the largest edge of a box."""
HULL = 0.6
"""Ratio of the edges of a drawn hull to the edges of uniform_box(), the box with the mass and the
moments of inertia of the body; the solar panels at the hull represent the rest of the inertia.
"""
EDGE = 1.0
"""Edge of the cube that represents a body without known mass and inertia, or of no size [m]."""
WING = 1.6
"""Ratio of the length of a solar panel to the longest edge of the hull to which it belongs."""
THIN = 0.03
"""Ratio of the thickness of a solar panel to the longest edge of the hull to which it belongs."""


def uniform_box(mass: float, inertia: Array) -> Array:
    """Return the edges (3,) [m] of the box of uniform density with this mass [kg] and inertia [kg
    m2]: the diagonal (3,), or a matrix (3, 3) of which only the diagonal is used.
    """
    J = np.diag(inertia) if np.ndim(inertia) == 2 else np.asarray(inertia)
    squares = 6 * (J.sum() - 2 * J) / mass
    edges = np.sqrt(np.maximum(squares, 0))
    return np.asarray(np.maximum(edges, SLIMMEST * edges.max()))


def edges(result: Result, mass: str, inertia: str) -> Array:
    """Return the edges of the hull of a body (3,) [m] from the parameters with the names `mass` and
    `inertia`; the edges of a cube if the result lacks them.
    """
    if not result.holds(parameters=(mass, inertia)):
        return np.full(3, EDGE)
    found = HULL * uniform_box(float(result.parameter(mass)), result.parameter(inertia))
    return found if found.max() > 0 else np.full(3, EDGE)


def edges_through(result: Result, mass: str, inertia: str, point: Any) -> Array:
    """Return the edges of the box with the proportions of edges() whose surface contains a point
    (3,) [m]. Where a part is mounted on the body, the mounting point gives a better size than HULL.
    """
    found = edges(result, mass, inertia)
    return np.asarray(found * np.max(2 * np.abs(point) / found))


def box(size: Array, at: Any = (0, 0, 0), look: str = "hull") -> Part:
    """Return a box with edges `size` along the axes of its body and its centre at `at` [m]; look:
    material in the page.
    """
    return {"kind": "box", "size": _plain(size), "at": _plain(at), "look": look}


def wings(size: Array) -> list[Part]:
    """Return two symbolic solar panels along y with their booms, for a hull with the edges `size`
    [m].
    """
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
    """Return a nozzle whose thrust acts along `force`: its opening points the opposite way."""
    return {"kind": "nozzle", "at": _plain(at), "out": _plain(-np.asarray(force)), "size": size}


def arm(reach: float, face: float, radius: float) -> list[Part]:
    """Return a straight arm of two links along x, from the face of the body at x = `face` to the
    grasp point at x = `face` + `reach` [m].
    """
    elbow, end = face + reach / 2, face + reach
    return [
        ball((face, 0, 0), 1.6 * radius),
        rod((face, 0, 0), (elbow, 0, 0), radius, "arm"),
        ball((elbow, 0, 0), 1.6 * radius),
        rod((elbow, 0, 0), (end, 0, 0), radius, "arm"),
        ball((end, 0, 0), 1.8 * radius, "accent"),
    ]


def ring(axis: Array, size: Array, radius: float) -> Part:
    """Return the grasp ring about `axis`, where this axis leaves a box with edges `size`."""
    reach = 0.5 / np.max(np.abs(axis) / size)
    return hoop(axis * reach, axis, radius)


def hoop(at: Any, axis: Any, radius: float) -> Part:
    """Return a ring about an axis."""
    return {"kind": "ring", "at": _plain(at), "axis": _plain(axis), "radius": radius}


def cup(floor: Any, mouth: Any, radii: tuple[float, float]) -> Part:
    """Return an open cone from the centre of its floor to the centre of its mouth; radii: at the
    floor and at the mouth.
    """
    return {"kind": "cup", "from": _plain(floor), "to": _plain(mouth), "radii": _plain(radii)}


def panels(area: Array, position: Array, normal: Array) -> Iterator[Part]:
    """Yield the square panels of the assembly with these areas (n,) [m2], centres (n, 3) [m] and
    unit normals (n, 3), without panels of area 0.
    """
    for size, place, direction in zip(area, position, normal, strict=True):
        if size > 0:
            edge = float(np.sqrt(size))
            yield {"kind": "panel", "at": _plain(place), "normal": _plain(direction), "edge": edge}


def shifted(parts: list[Part], by: Array) -> list[Part]:
    """Return parts that have the entry `at`, each moved by a vector [m]."""
    return [part | {"at": _plain(np.add(part["at"], by))} for part in parts]


def hull_of(places: Array) -> tuple[Array, Array]:
    """Return edges (3,) and centre (3,) [m] of the box around the positions of thrusters (n, 3)."""
    low, high = places.min(axis=0), places.max(axis=0)
    size = high - low
    return np.maximum(size, SLIMMEST * size.max()), (low + high) / 2


def _plain(values: Any) -> list[float]:
    return [round(float(value), 6) for value in values]
