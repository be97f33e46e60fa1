# SPDX-License-Identifier: BSD-2-Clause
"""Bodies of a result: position, velocity and attitude relative to N, and their instants."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.errors import ResultsError, UsageError
from harness.mission.conventions import Bodies
from harness.mission.library import everything, of_result
from harness.results.result import Result
from harness.spelling import did_you_mean
from harness.system.instants import after, epoch_of

Array = NDArray[np.float64]

EPOCH = "2000-01-01T12:00:00"
"""Instant of t = 0 of a run without a date, unless the user names one: J2000."""
EARTH_RADIUS = 6.3e6
"""Least distance of an orbit about the Earth from N [m]."""


@dataclass(frozen=True)
class Body:
    """One component: r_N (rows, 3) [m], v_N (rows, 3) [m/s], q: attitude relative to N (rows, 4),
    scalar first, None if the component has none.
    """

    name: str
    r_N: Array
    v_N: Array
    q: Array | None


def bodies(result: Result, name: str | None = None) -> list[Body]:
    """The usual bodies of a result, or the named one; ResultsError or UsageError if there is none
    that moves about the Earth.
    """
    names = names_of(result)
    known = {c: n for n in names for c in n.found(result)}
    usual = [c for n in names for c in n.components if c in known]
    if name is not None and name not in known:
        close = did_you_mean(name, known) or (f", only {', '.join(known)}" if known else "")
        raise UsageError(f"--body {name}: {result.system} has no such body{close}")
    found = [_body(result, c, known[c]) for c in ([name] if name else usual)]
    if not found:
        raise ResultsError(f"{result.system}: the result holds no body with position and velocity")
    for body in found:
        if len(body.r_N) and np.linalg.norm(body.r_N, axis=1).min() < EARTH_RADIUS:
            raise ResultsError(f"{body.name}: does not move in an orbit about the Earth")
    return found


def names_of(result: Result) -> tuple[Bodies, ...]:
    """The names of bodies in the mission of a result, else in all that are at hand."""
    return of_result(result).bodies or everything().bodies


def _body(result: Result, name: str, names: Bodies) -> Body:
    letter = names.found(result)[name]
    position, velocity, attitude = (
        f"{name}.{text.format(letter)}" for text in (names.position, names.velocity, names.attitude)
    )
    if velocity not in result:
        raise ResultsError(f"{name}: the result does not hold its velocity {velocity}")
    held = attitude in result
    return Body(name, result[position], result[velocity], result[attitude] if held else None)


def instants(result: Result, epoch: str) -> NDArray[np.datetime64]:
    """UTC of every row, to the nanosecond; UsageError if the epoch is no date, ResultsError if a
    time leads out of all years.
    """
    return after(epoch_of(epoch), result.time)
