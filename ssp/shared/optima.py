# SPDX-License-Identifier: BSD-2-Clause
"""Stored optima (least impulses) of runs: optima of the project, which .ci/bounds.py computes, and
optima that `harness bound --store` writes into the working folder; with a figure that compares a
run with its optimum, and a metric.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from hashlib import sha256
from pathlib import Path

import msgspec
import numpy as np

from harness.errors import ResultsError
from harness.files.output import written
from harness.mission import Limits, Metric
from harness.mission.figure import Curve, Figure, Panel
from harness.results.histories import norm, total
from harness.results.result import Array, Result, Rows

from .convex import Optimum
from .relative_motion import DISTANCE, SERVICER, TARGET

FILE = Path(__file__).with_name("optima.json")
OWN = Path("results", "optima.json")
"""File with the optima of the user, in the working folder."""
POINTS = 100
"""Largest number of time intervals of a stored optimum."""
DIGITS = 6
IMPULSE = "propulsion.impulse"


class Leg(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Stored optimum of a run or of one phase of a mission: instants (n,) [s], position from the
    target in N axes (n, 3) [m], and impulse since the first instant (n,) [N s].
    """

    time: list[float]
    position: list[list[float]]
    impulse: list[float]


Cases = Mapping[str, Sequence[Leg]]


def case(result: Result) -> str:
    """Return a hash of everything on which the optimum of a run depends: system, stop time, and all
    parameters except the ones of the controller; "" for a result without parameters.
    """
    if result.parameters is None:
        return ""
    values = zip(result.parameters.columns, result.parameters.values[0].tolist(), strict=True)
    given = sorted(f"{name}={x!r}" for name, x in values if not name.startswith("controller."))
    text = "\n".join([result.system, f"{result.time[-1]:.9g}", *given])
    return sha256(text.encode()).hexdigest()[:16]


def stored() -> dict[str, list[Leg]]:
    """Return all stored optima by the hash case(); raise ResultsError if a file cannot be read."""
    return {**read(FILE), **read(OWN)}


def read(path: Path) -> dict[str, list[Leg]]:
    """Return the optima in a file by the hash of their case, see case(); {} if the file is missing;
    raise ResultsError if it cannot be read.
    """
    if not path.is_file():
        return {}
    try:
        return msgspec.json.decode(path.read_bytes(), type=dict[str, list[Leg]])
    except (OSError, msgspec.DecodeError) as error:
        raise ResultsError(f"{path}: contains no optima of `harness bound`: {error}") from error


def write(path: Path, cases: Cases) -> None:
    """Write optima into a file, a line per case; raise ResultsError."""
    lines = (f'"{name}": {msgspec.json.encode(legs).decode()}' for name, legs in cases.items())
    with written(path) as target:
        target.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")


def store(result: Result, optima: Sequence[Optimum]) -> Path:
    """Add the optima of a run to the file OWN of the user, and return the path of this file; raise
    ResultsError if the file is damaged or cannot be written.
    """
    write(OWN, {**read(OWN), case(result): list(map(leg, optima))})
    return OWN


def leg(optimum: Optimum) -> Leg:
    """Return the Leg that is stored for an optimum: at most POINTS intervals, DIGITS digits after
    the point.
    """
    steps = np.abs(optimum.force).sum(axis=1) * np.diff(optimum.time)
    spent = np.concatenate(([0.0], np.cumsum(steps)))
    nodes = len(optimum.time)
    rows = np.unique(np.linspace(0, nodes - 1, min(nodes, POINTS + 1)).round().astype(int))
    columns = (optimum.time, optimum.position, spent)
    return Leg(*(column[rows].round(DIGITS).tolist() for column in columns))


# ---- comparison of a run with its optimum


def _legs(result: Result) -> list[Leg]:
    return stored().get(case(result), []) if len(result.time) else []


def _parts(result: Result) -> Iterator[tuple[Leg, Rows]]:
    """Yield the stored legs of a run, each with the indices of the rows in its time span."""
    for each in _legs(result):
        inside = (result.time >= each.time[0]) & (result.time <= each.time[-1])
        yield each, np.flatnonzero(inside)


def _position(result: Result) -> Array:
    """Return the optimal position from the target in N axes (rows, 3) [m]; NaN where none is
    stored.
    """
    found = np.full((len(result.time), 3), np.nan)
    for each, rows in _parts(result):
        for k, column in enumerate(np.transpose(each.position)):
            found[rows, k] = np.interp(result.time[rows], each.time, column)
    return found


def _impulse(result: Result) -> Array:
    """Return the optimal cumulative impulse (rows,) [N s], NaN where none is stored. The
    optimum of each phase begins at the cumulative impulse that the run has at this time.
    """
    found, spent = np.full(len(result.time), np.nan), total(result[IMPULSE])
    for each, rows in _parts(result):
        begun = np.interp(each.time[0], result.time, spent)
        found[rows] = begun + np.interp(result.time[rows], each.time, each.impulse)
    return found


PATH = (SERVICER, TARGET)
OPTIMUM = partial(Curve, label="optimum", style="--")
FIGURE = Figure(
    "optimum",
    "Run and its optimum",
    (
        Panel("impulse [N s]", (
            Curve(f"total({IMPULSE})", "run"), OPTIMUM(_impulse, needs=(IMPULSE,)))),
        Panel("range [m]", (
            Curve(DISTANCE, "run"), OPTIMUM(lambda r: norm(_position(r)), needs=PATH))),
        Panel("position from the target, N [m]", (
            Curve(f"{SERVICER} - {TARGET}", "run"), OPTIMUM(_position, needs=PATH, anew=True))),
    ),
    only=lambda result: bool(_legs(result)),
)  # fmt: skip
"""Figure of a run and its optimum, for results whose optimum is stored."""


def _of_the_optimum(result: Result, _: Limits) -> float:
    legs, spent = _legs(result), total(result[IMPULSE])
    ends = [np.interp((each.time[0], each.time[-1]), result.time, spent) for each in legs]
    least = sum(each.impulse[-1] for each in legs)
    return float(sum(np.diff(end)[0] for end in ends)) / least if least else math.nan


METRIC = Metric("x optimum", "1", (IMPULSE,), _of_the_optimum)
"""Metric: impulse of the run divided by its least impulse if that is stored. For a mission only the
phases with a stored optimum count.
"""
