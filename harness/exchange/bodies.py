# SPDX-License-Identifier: BSD-2-Clause
"""Bodies of a result: position, velocity and attitude relative to N, and their instants."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.errors import ResultsError, UsageError
from harness.exchange.instants import after, epoch_of
from harness.results.result import Result
from harness.spelling import did_you_mean

Array = NDArray[np.float64]

EPOCH = "2000-01-01T12:00:00"
"""Instant of t = 0, unless the user names another: J2000."""
USUAL = ("servicer", "target", "robot")
"""Components that are bodies in the systems of the project."""
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
    known = {match[1]: match[2] for n in result.vectors if (match := POSITION.fullmatch(n))}
    if name is not None and name not in known:
        close = did_you_mean(name, known) or (f", only {', '.join(known)}" if known else "")
        raise UsageError(f"--body {name}: {result.system} has no such body{close}")
    found = [_body(result, n, known[n]) for n in ([name] if name else USUAL) if n in known]
    if not found:
        raise ResultsError(f"{result.system}: the result holds no body with position and velocity")
    for body in found:
        if len(body.r_N) and np.linalg.norm(body.r_N, axis=1).min() < EARTH_RADIUS:
            raise ResultsError(f"{body.name}: does not move in an orbit about the Earth")
    return found


POSITION = re.compile(r"(\w+)\.r_([A-Z])N_N")


def _body(result: Result, name: str, letter: str) -> Body:
    velocity, attitude = f"{name}.v_{letter}N_N", f"{name}.q_{letter}N"
    if velocity not in result:
        raise ResultsError(f"{name}: the result does not hold its velocity {velocity}")
    held = attitude in result
    return Body(
        name, result[f"{name}.r_{letter}N_N"], result[velocity], result[attitude] if held else None
    )


def instants(result: Result, epoch: str) -> NDArray[np.datetime64]:
    """UTC of every row, to the nanosecond; UsageError if the epoch is no date, ResultsError if a
    time leads out of all years.
    """
    return after(epoch_of(epoch), result.time)
