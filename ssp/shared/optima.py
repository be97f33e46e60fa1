# SPDX-License-Identifier: BSD-2-Clause
"""Stored optima of runs by case: cases of this project, which .ci/bounds.py computes, and cases of
`harness bound --store` in the working folder; the figure that shows them beside a run, and the
metric.
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
from harness.mission.optimum import Optimum
from harness.results.histories import norm, total
from harness.results.result import Array, Result, Rows

from .relative_motion import DISTANCE, SERVICER, TARGET

FILE = Path(__file__).with_name("optima.json")
OWN = Path("results", "optima.json")
"""File of the user, in the working folder."""
POINTS = 100
"""Largest number of intervals of a stored optimum."""
DIGITS = 6
IMPULSE = "propulsion.impulse"


class Leg(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Optimum of a run or of a phase: instants (n,) [s], position from the target in N (n, 3) [m]
    and impulse so far (n,) [N s].
    """

    time: list[float]
    position: list[list[float]]
    impulse: list[float]


Cases = Mapping[str, Sequence[Leg]]


def case(result: Result) -> str:
    """Return a hash of what the optimum depends on: system, stop time, and all parameters but of
    the controller.
    """
    if result.parameters is None:
        return ""
    values = zip(result.parameters.columns, result.parameters.values[0].tolist(), strict=True)
    given = sorted(f"{name}={x!r}" for name, x in values if not name.startswith("controller."))
    text = "\n".join([result.system, f"{result.time[-1]:.9g}", *given])
    return sha256(text.encode()).hexdigest()[:16]


def stored() -> dict[str, list[Leg]]:
    """Return the optima by case; raise ResultsError if a file cannot be read."""
    return {**read(FILE), **read(OWN)}


def read(path: Path) -> dict[str, list[Leg]]:
    """Return the optima of a file, none if it is missing; raise ResultsError."""
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
    """Add the optima of a run to the file of the user, and return it; raise ResultsError."""
    write(OWN, {**read(OWN), case(result): list(map(leg, optima))})
    return OWN


def leg(optimum: Optimum) -> Leg:
    """Return what is stored of an optimum."""
    steps = np.abs(optimum.force).sum(axis=1) * np.diff(optimum.time)
    spent = np.concatenate(([0.0], np.cumsum(steps)))
    nodes = len(optimum.time)
    rows = np.unique(np.linspace(0, nodes - 1, min(nodes, POINTS + 1)).round().astype(int))
    columns = (optimum.time, optimum.position, spent)
    return Leg(*(column[rows].round(DIGITS).tolist() for column in columns))


# ---- beside a run


def _legs(result: Result) -> list[Leg]:
    return stored().get(case(result), []) if len(result.time) else []


def _parts(result: Result) -> Iterator[tuple[Leg, Rows]]:
    """Yield the legs, and the rows of the result that belong to each."""
    for each in _legs(result):
        inside = (result.time >= each.time[0]) & (result.time <= each.time[-1])
        yield each, np.flatnonzero(inside)


def _position(result: Result) -> Array:
    """Return the optimal position (rows, 3) from the target in N, NaN where none is stored [m]."""
    found = np.full((len(result.time), 3), np.nan)
    for each, rows in _parts(result):
        for k, column in enumerate(np.transpose(each.position)):
            found[rows, k] = np.interp(result.time[rows], each.time, column)
    return found


def _impulse(result: Result) -> Array:
    """Return the optimal impulse (rows,) [N s]; a phase begins with the impulse of the run."""
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
"""Figure of results whose optimum is stored. The optimum is of the run in the file."""


def _of_the_optimum(result: Result, _: Limits) -> float:
    legs, spent = _legs(result), total(result[IMPULSE])
    ends = [np.interp((each.time[0], each.time[-1]), result.time, spent) for each in legs]
    least = sum(each.impulse[-1] for each in legs)
    return float(sum(np.diff(end)[0] for end in ends)) / least if least else math.nan


METRIC = Metric("x optimum", "1", (IMPULSE,), _of_the_optimum)
"""Impulse over the least impulse of the case, where that is stored; of a mission in the phases that
have an optimum.
"""
