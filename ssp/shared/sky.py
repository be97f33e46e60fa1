# SPDX-License-Identifier: BSD-2-Clause
"""Surroundings of a 3D replay in orbit: frames, the rotating planet, the Sun, the shadow."""

from __future__ import annotations

import numpy as np

from harness.errors import HarnessError, library
from harness.report.arrays import Arrays
from harness.results.result import Array, Result, Rows

from .conventions import BODIES
from .exchange.bodies import days_since_j2000, instants, shadow, sun_direction
from .scene import Scene

EARTH = 6378137.0
"""Equatorial radius of the planet unless a parameter defines it [m]."""
RATE = 7.292115e-5
"""Angular rate of the Earth [rad/s]."""
LIKE = 0.01
"""Largest relative difference between a planet's radius and EARTH at which the coasts of the Earth
are drawn on it.
"""
UNDATED = "no date, or library erfa missing: rotation angle of the Earth arbitrary"
IN_ORBIT = 1e6
"""Distance from the origin of N [m] above which a body is in orbit and has a Hill frame."""
HILL = {"key": "H", "name": "Hill frame", "axes": ["radial", "along track", "normal"]}
INERTIAL = {"key": "N", "name": "inertial axes", "axes": ["x N", "y N", "z N"]}


def in_orbit(r: Array) -> bool:
    """Return whether the first of the positions r (rows, 3) [m] relative to N is in orbit."""
    return bool(np.linalg.norm(r[0]) > IN_ORBIT)


def frames(result: Result, arrays: Arrays, rows: Rows, position: str, velocity: str) -> Scene:
    """Return the entries of a scene for its frames: `frames`, those that the reader of the replay
    can choose (Hill and inertial axes in orbit, inertial axes in deep space), and `hill`, the
    attitude of the Hill frame.

    position, velocity: variables that define the Hill frame. In deep space `hill` is present too,
    for parts that a mission draws, unless position and velocity are parallel in a row.
    """
    r, v = result[position][rows], result[velocity][rows]
    found: Scene = {"frames": [HILL, INERTIAL] if in_orbit(r) else [INERTIAL]}
    if in_orbit(r) or np.linalg.norm(np.cross(r, v), axis=1).all():
        found["hill"] = arrays.sample(result, rows, f"hill({position}, {velocity})")
    return found


def sky(
    result: Result, arrays: Arrays, rows: Rows, centre: str | Array, radius: float = 0.0
) -> Scene:
    """Return the entries of a scene for planet, Sun and shadow.

    centre: position of the origin of the scene from the centre of the planet, a variable or an
    array (rows, 3) [m]; radius: of the planet [m], 0: the radius of the Earth.

    The direction of the Sun and the rotation of the Earth follow from the date of the run. Without
    a date the Sun is in the direction of a parameter of the run, if it has one, and the rotation
    begins at an arbitrary angle; the replay states this. The coasts are drawn only on a body with
    the radius of the Earth. They are the coasts of Natural Earth at 1:110m, which is in the public
    domain, simplified (`page/coasts.json`).
    """
    turn, towards = _dated(result, rows)
    if isinstance(centre, str):
        r, to_planet = result[centre][rows], arrays.sample(result, rows, f"-{centre}")
    else:
        r, to_planet = centre, arrays.store(-centre)
    planet = {
        "r": to_planet,
        "radius": min(radius or EARTH, 0.99 * float(np.linalg.norm(r, axis=1).min())),
        "coasts": abs((radius or EARTH) / EARTH - 1) < LIKE,
        "turn": arrays.store(np.unwrap(turn)),
    }
    if towards is not None:
        return {"planet": planet, "sun": _sun(arrays, r, towards)}
    if (fixed := _fixed(result)) is None:
        return {"planet": planet, "undated": f"{UNDATED}, Sun not shown"}
    undated = f"{UNDATED}, direction of the Sun from a parameter"
    return {"planet": planet, "sun": _sun(arrays, r, fixed[None]), "undated": undated}


def _sun(arrays: Arrays, r: Array, towards: Array) -> Scene:
    every = np.broadcast_to(towards, r.shape)
    return {"towards": arrays.store(towards), "shadow": arrays.store(shadow(r, every))}


def _dated(result: Result, rows: Rows) -> tuple[Array, Array | None]:
    """Return the rotation angle of the Earth (rows,) [rad], and the direction of the Sun (rows, 3).
    Without a date or the library erfa, return RATE times time, and None as the direction.
    """
    epoch = result.provenance.epoch if result.provenance else ""
    if epoch:
        try:
            dates = instants(result, epoch)[rows]
            turn = library("erfa", "exchange").era00(2451545.0, days_since_j2000(dates))
            return np.asarray(turn, dtype=np.float64), sun_direction(dates)
        except HarnessError:
            pass
    return RATE * result.time[rows], None


def _fixed(result: Result) -> Array | None:
    """Return the unit vector to the Sun from a parameter of the run; None if it has none."""
    table = result.parameters
    for name in table.vectors if table else ():
        if name.rpartition(".")[2] == BODIES.sun:
            found = np.asarray(result.parameter(name), dtype=np.float64)
            return np.asarray(found / np.linalg.norm(found))
    return None
