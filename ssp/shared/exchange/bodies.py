# SPDX-License-Identifier: BSD-2-Clause
"""Bodies of a result: position, velocity and attitude relative to N, with dates; direction of the
Sun and shadow of the Earth at these dates.

The geocentric direction of the Sun is computed by erfa (epv00, series VSOP2000), with ICRS axes
treated as the axes of N. Light time and aberration are ignored, which is an error of 20 arcsec. The
Earth is a sphere without atmosphere, the Sun a disc of true size.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError, ResultsError, UsageError, library
from harness.results.result import Array, Result
from harness.spelling import did_you_mean
from harness.system.instants import FIRST, J2000, LAST, epoch_of

EARTH_RADIUS = 6.3e6
"""Smallest distance from the origin of N at which a body counts as moving about the Earth [m]."""


class Bodies(NamedTuple):
    """Names, without the component, of the variables of a body and of the parameters of its start;
    `{}` in a name represents the letter of the body, as in r_{}N_N.

    position [m], velocity [m/s], attitude: relative to an inertial frame; components: components
    that are bodies, in the order in which bodies() returns them; start: position [m] and velocity
    [m/s] at the start; attitude_start: attitude at the start of bodies and of estimates, modified
    Rodrigues parameters;
    semi_major_axis: of the orbit at the start [m], 0 if `start` applies instead of the orbit;
    elements: eccentricity, inclination, argument of perigee, right ascension and true anomaly of
    this orbit [rad]; field: gravitational parameter [m3/s2]; beside: start position and velocity
    relative to another body in the Hill frame of that body; sun: parameter with the direction of
    the Sun, a unit vector in the inertial frame ("": none).
    """

    position: str
    velocity: str
    attitude: str
    components: tuple[str, ...]
    start: tuple[str, str]
    attitude_start: str
    semi_major_axis: str
    elements: tuple[str, str, str, str, str]
    field: str
    beside: tuple[str, str]
    sun: str = ""

    def found(self, result: Result) -> dict[str, str]:
        """Return the letters of the components whose position is in the result, by component, as
        {"servicer": "S"}.
        """
        before, after = map(re.escape, self.position.split("{}"))
        pattern = re.compile(rf"(\w+)\.{before}([A-Z]){after}")
        return {match[1]: match[2] for n in result.vectors if (match := pattern.fullmatch(n))}


@dataclass(frozen=True)
class Body:
    """One body of a result: position r_N (rows, 3) [m], velocity v_N (rows, 3) [m/s], and attitude
    q relative to N (rows, 4), scalar first (None: the result has no attitude).
    """

    name: str
    r_N: Array
    v_N: Array
    q: Array | None


def bodies(names: Bodies, result: Result, name: str | None = None) -> list[Body]:
    """Return the body `name` of a result in a list or, if None, all bodies in names.components;
    raise UsageError for an unknown name, ResultsError if the result has no body, lacks the velocity
    of one, or a body comes closer than EARTH_RADIUS to the origin of N.
    """
    known = names.found(result)
    if name is not None and name not in known:
        close = did_you_mean(name, known) or (f", only {', '.join(known)}" if known else "")
        raise UsageError(f"--body {name}: {result.system} has no such body{close}")
    usual = [name] if name else [c for c in names.components if c in known]
    found = [_body(result, c, known[c], names) for c in usual]
    if not found:
        raise ResultsError(f"{result.system}: the result holds no body with position and velocity")
    for body in found:
        if len(body.r_N) and np.linalg.norm(body.r_N, axis=1).min() < EARTH_RADIUS:
            raise ResultsError(
                f"{body.name}: does not move in an orbit about the Earth; its distance from the "
                f"origin of N falls below 6300 km"
            )
    return found


def _body(result: Result, name: str, letter: str, names: Bodies) -> Body:
    position, velocity, attitude = (
        f"{name}.{text.format(letter)}" for text in (names.position, names.velocity, names.attitude)
    )
    if velocity not in result:
        raise ResultsError(f"{name}: the result does not hold its velocity {velocity}")
    held = attitude in result
    return Body(name, result[position], result[velocity], result[attitude] if held else None)


def instants(result: Result, epoch: str) -> NDArray[np.datetime64]:
    """Return the UTC of every row (rows,) to the nanosecond; epoch: UTC at t = 0. Raises UsageError
    if the epoch is not a date, ResultsError if a date is outside the years FIRST to LAST.
    """
    start, seconds = epoch_of(epoch), result.time
    begin, end = (np.datetime64(f"{year}-01-01", "s") for year in (FIRST, LAST + 1))
    here = start.astype("datetime64[s]")
    least, most = ((limit - here).astype(np.float64) for limit in (begin, end))
    # 9e9 s: nanoseconds in 64 bits overflow at 9.2e9 s
    if not ((seconds >= least) & (seconds < min(most, 9e9))).all():
        raise ResultsError(
            f"times of the result, from {here} on, leave the range of years {FIRST} to {LAST}"
        )
    return np.asarray(start + np.round(seconds * 1e9).astype("timedelta64[ns]"))


def days_since_j2000(instants: Any) -> Any:
    """Return the time from J2000 to UTC instants in days of 86 400 s, as erfa and SGP4 need it. It
    is computed in two parts, because a difference in nanoseconds may exceed 64 bits.
    """
    days = instants.astype("datetime64[D]")
    part = (instants - days.astype("datetime64[ns]")) / np.timedelta64(1, "D")
    return (days - J2000.astype("datetime64[D]")) / np.timedelta64(1, "D") + (part - 0.5)


# ---- the Sun and the shadow of the Earth

EARTH, SUN, AU = 6378136.3, 6.957e8, 149597870700.0
"""Radii of Earth and Sun, astronomical unit [m]."""
TT_AHEAD = 69.184
"""Difference TT - UTC since 2017 [s]. In other years the difference is some seconds away from this
value; the error is small, because the Sun moves by only 0.04 arcsec per second.
"""

ROWS = 2000
"""Largest number of rows at which eclipses are looked for."""


def sun_direction(times: NDArray[np.datetime64]) -> Array:
    """Return unit vectors from the Earth to the Sun at these UTC instants, in N axes (rows, 3)."""
    erfa = library("erfa", "exchange")
    days = days_since_j2000(times) + TT_AHEAD / 86400
    heliocentric, _ = erfa.epv00(2451545.0, days)
    towards = -np.asarray(heliocentric["p"], dtype=np.float64)
    return np.asarray(towards / np.linalg.norm(towards, axis=-1, keepdims=True))


def eclipses(names: Bodies, result: Result) -> list[str]:
    """Return a line, in a list, with the time spans in which the first body of a result is in the
    shadow of the Earth; [] if the run has no date, a body is not in an orbit about the Earth, or
    the library erfa is missing.
    """
    epoch = result.provenance.epoch if result.provenance else ""
    if not epoch or not len(result.time):
        return []
    try:
        body = bodies(names, result)[0]
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
    """Return the share (rows,) of the disc of the Sun that the Earth covers: 0 in the light, 1 in
    the umbra.

    r_N: positions about the Earth (rows, 3) [m]; towards: unit vectors to the Sun (rows, 3).
    Montenbruck & Gill, Satellite Orbits, 3.4.2: two discs of apparent radii a (Sun) and b (Earth),
    c apart, overlap in the area A = a^2 arccos(x / a) + b^2 arccos((c - x) / b) - c y. x: distance
    from the centre of the Sun to the common chord, y: half its length, all as angles [rad].
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
