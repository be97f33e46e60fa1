# SPDX-License-Identifier: BSD-2-Clause
"""Where the Sun stands, and the shadow of the Earth, by the date.

Geocentric direction by the series of VSOP2000 that erfa brings (epv00), ICRS axes taken as those of
N; neither light time nor aberration, 20 arcsec together. The shadow is that of a sphere before a
disc of the Sun of its true size, without an atmosphere.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.exchange.bodies import bodies, instants
from harness.files.libraries import library
from harness.results.result import Result
from harness.system.instants import days_since_j2000

Array = NDArray[np.float64]

EARTH, SUN, AU = 6378136.3, 6.957e8, 149597870700.0
"""Radii of Earth and Sun, astronomical unit [m]."""
TT_AHEAD = 69.184
"""TT - UTC since 2017 [s]: the Sun moves by 0.04 arcsec per second."""

ROWS = 2000
"""Rows that are looked at for eclipses."""


def sun_direction(times: NDArray[np.datetime64]) -> Array:
    """Unit vectors from the Earth to the Sun (rows, 3), components of N."""
    erfa = library("erfa", "exchange")
    days = days_since_j2000(times) + TT_AHEAD / 86400
    heliocentric, _ = erfa.epv00(2451545.0, days)
    towards = -np.asarray(heliocentric["p"], dtype=np.float64)
    return np.asarray(towards / np.linalg.norm(towards, axis=-1, keepdims=True))


def eclipses(result: Result) -> list[str]:
    """When the first body of a dated result is in the shadow, in a line; none without a date,
    bodies about the Earth, or erfa.
    """
    epoch = result.provenance.epoch if result.provenance else ""
    if not epoch or not len(result.time):
        return []
    try:
        body = bodies(result)[0]
        rows = np.unique(np.linspace(0, len(result.time) - 1, ROWS).round().astype(np.intp))
        towards = sun_direction(instants(result, epoch)[rows])
    except HarnessError:
        return []
    dark = shadow(body.r_N[rows], towards) > 0
    edges = np.flatnonzero(np.diff(np.concatenate(([False], dark, [False]))))
    time = result.time[rows]
    spans = [f"{time[a]:g} to {time[b - 1]:g} s" for a, b in edges.reshape(-1, 2)]
    return [f"{body.name} in the shadow of the Earth: {', '.join(spans) or 'never'}"]


def shadow(r_N: Array, towards: Array) -> Array:
    """Part (rows,) of the disc of the Sun that the Earth covers: 0 in the light, 1 in the umbra.

    r_N: positions about the Earth (rows, 3) [m]; towards: unit vectors to the Sun (rows, 3).
    Montenbruck & Gill, Satellite Orbits, 3.4.2: two discs of apparent radii a (Sun) and b (Earth),
    c apart, overlap in the area A = a^2 arccos(x / a) + b^2 arccos((c - x) / b) - c y.
    """
    to_sun = AU * towards - r_N
    distance, range_ = np.linalg.norm(to_sun, axis=-1), np.linalg.norm(r_N, axis=-1)
    a, b = np.arcsin(SUN / distance), np.arcsin(np.minimum(1.0, EARTH / range_))
    cosine = -np.sum(r_N * to_sun, axis=-1) / (range_ * distance)
    c = np.arccos(np.clip(cosine, -1, 1))
    x = (c**2 + a**2 - b**2) / (2 * np.where(c > 0, c, 1))
    y = np.sqrt(np.maximum(0, a**2 - x**2))
    sector = a**2 * np.arccos(np.clip(x / a, -1, 1))
    area = sector + b**2 * np.arccos(np.clip((c - x) / b, -1, 1)) - c * y
    partly = area / (np.pi * a**2)
    return np.asarray(np.where(c >= a + b, 0.0, np.where(c <= b - a, 1.0, partly)))
