# SPDX-License-Identifier: BSD-2-Clause
"""What a replay has in orbit: frames, the planet and its turn, the Sun, the shadow."""

from __future__ import annotations

import numpy as np

from harness.errors import HarnessError, library
from harness.report.arrays import Arrays
from harness.report.scene import Scene
from harness.results.histories import quaternion
from harness.results.result import Array, Result, Rows
from harness.system.instants import days_since_j2000

from .conventions import BODIES
from .exchange.bodies import instants, shadow, sun_direction

EARTH = 6378137.0
"""Equatorial radius of the planet where no parameter says it [m]."""
RATE = 7.292115e-5
"""Turn of the Earth [rad/s]."""
LIKE = 0.01
"""A radius that differs by less, as a part, is that of the Earth."""
UNDATED = "no date: turn of the Earth arbitrary"
IN_ORBIT = 1e6
"""A body farther than that [m] from the origin of N is in orbit, and has a Hill frame."""
HILL = {"key": "H", "name": "Hill frame", "axes": ["radial", "along track", "normal"]}
INERTIAL = {"key": "N", "name": "inertial axes", "axes": ["x N", "y N", "z N"]}


def hill_quaternion(r: Array, v: Array) -> Array:
    """Quaternion (rows, 4) of the Hill frame of an orbit relative to N: x: r, z: r x v."""
    normal = np.cross(r, v)
    axes = (r, np.cross(normal, r), normal)
    return quaternion(*(each / np.linalg.norm(each, axis=1)[:, None] for each in axes))


def in_orbit(r: Array) -> bool:
    """Whether positions r (rows, 3) [m] about the origin of N are those of an orbit."""
    return bool(np.linalg.norm(r[0]) > IN_ORBIT)


def frames(arrays: Arrays, r: Array, v: Array) -> Scene:
    """Hill frame and both kinds of axes in orbit; N only in deep space, where the Hill frame, if
    position and velocity make one, carries what a mission has in it.
    """
    found: Scene = {"frames": [HILL, INERTIAL] if in_orbit(r) else [INERTIAL]}
    if in_orbit(r) or np.linalg.norm(np.cross(r, v), axis=1).all():
        found["hill"] = arrays.keep(hill_quaternion(r, v))
    return found


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
            dates = instants(result, epoch)[rows]
            turn = library("erfa", "exchange").era00(2451545.0, days_since_j2000(dates))
            return np.asarray(turn, dtype=np.float64), sun_direction(dates)
        except HarnessError:
            pass
    return RATE * result.time[rows], None


def _fixed(result: Result) -> Array | None:
    """The direction of the Sun that a parameter of the run says."""
    table = result.parameters
    for name in table.vectors if table else ():
        if name.rpartition(".")[2] == BODIES.sun:
            found = np.asarray(result.parameter(name), dtype=np.float64)
            return np.asarray(found / np.linalg.norm(found))
    return None
