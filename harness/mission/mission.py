# SPDX-License-Identifier: BSD-2-Clause
"""What a mission hands the engine: figures, measures, claims and so on, each as data.

A mission is a folder with `system.toml`, further systems, `campaigns/` and, if it has something to
add to the general figures, `mission.py` with

    MISSION = Mission(figures=(...), measures=(...), claims=(...))

Missions import the engine; the engine knows no mission.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from harness.mission.claim import Paper, RuleFinding, Validation
from harness.mission.figure import Drawing, Figure, Overlay, Phase
from harness.results.number import Number
from harness.results.result import Result


@dataclass(frozen=True)
class Limits:
    """The limits for all runs of a comparison.

    position [m], attitude [deg]: an error has settled when it stays within this band (None: the
    mission chooses one); keep_out: smallest permitted range [m], 0: no such limit.
    """

    position: float | None = None
    attitude: float = 1.0
    keep_out: float = 0.0


@dataclass(frozen=True)
class Measure(Number):
    """A column of a comparison, whose function takes the limits too; beside: shown in a table of
    its own, not among the measures of a page; about: what the limits mean for it, the last line of
    its heading; words: what its values 0, 1, .. stand for; apart: a comparison warns where its
    values differ by more than this factor.
    """

    beside: bool = False
    about: Callable[[Limits, Mapping[str, Result]], str] | None = None
    words: tuple[str, ...] = ()
    apart: float = math.inf

    def __call__(self, result: Result, *limits: Limits) -> float:
        """The value; NaN if the result does not hold what it needs, or there is no such value."""
        return float(super().__call__(result, *limits)) if not self.lacks(result) else math.nan


def measured(
    found: Iterable[Measure], results: Mapping[str, Result], limits: Limits
) -> dict[tuple[str, str], dict[str, float]]:
    """Measures of results by (name, unit), then by the label of the run."""
    return {
        (m.name, m.unit): {label: m(result, limits) for label, result in results.items()}
        for m in found
    }


def apart(
    found: Iterable[Measure], columns: Mapping[tuple[str, str], Mapping[str, float]]
) -> Iterator[str]:
    """Measures that differ by more than their factor, a line each."""
    for measure in found:
        column = columns.get((measure.name, measure.unit), {})
        values = {label: x for label, x in column.items() if math.isfinite(x) and x > 0}
        if values and max(values.values()) > measure.apart * min(values.values()):
            most, least = (pick(values, key=values.__getitem__) for pick in (max, min))
            yield (
                f"{measure.name}: {most} {values[most]:.3g} {measure.unit}, {least} "
                f"{values[least]:.3g} {measure.unit}: more than {measure.apart:g} times apart, not "
                "the same actuators"
            )


class Gauge(Number):
    """A quantity of the last row; its function gives a history, or a text ("": nothing to show)."""

    def text(self, result: Result) -> str:
        """The value, with its name where its one variable defines names for numbers."""
        values = self(result)
        if isinstance(values, str):
            return values
        value = float(np.sum(np.atleast_1d(values)[-1]))
        if len(self.needs) == 1 and (name := _name(result.description(self.needs[0]), value)):
            return name
        return f"{value:.4g} {self.unit}".rstrip()


def _name(description: str, value: float) -> str:
    """What a number means by a description like `0 coast, 1 align, 2 burn`; "": it does not say."""
    names = dict(re.findall(r"(?:^|, )(\d+) (\w+)", description))
    return names.get(f"{value:g}", "") if re.match(r"0 \w", description) else ""


class Start(NamedTuple):
    """Values of parameters by name, for `set` of run(); what was assumed, one line each; the UTC of
    t = 0, for `epoch`.
    """

    values: Mapping[str, Any]
    notes: tuple[str, ...]
    epoch: str


@dataclass(frozen=True, eq=False)
class Exchange:
    """Files of other tools.

    writers: by ending, of a result, the path, a component (None: whichever suits) and the UTC of
    t = 0; start: start values of a system from files (or their text) by component, an epoch or None
    and changes of run(); remarks: lines of a page about a result, besides the notes.
    """

    writers: Mapping[str, Callable[[Result, Path, str | None, str], None]] = field(
        default_factory=dict
    )
    start: Callable[..., Start] | None = None
    remarks: Callable[[Result], Iterable[str]] | None = None


class Example(NamedTuple):
    """A source that flies in the place of a component: where, the inputs that it needs, the outputs
    that it has, its file without ending in the folder of examples, and what whoever changes it must
    know.
    """

    place: str
    inputs: frozenset[str]
    outputs: frozenset[str]
    file: Path
    note: str = ""


class Scene(NamedTuple):
    """A replay in space, of results that hold these variables and parameters; build: from the
    result and the arrays of the page; several: the same of several runs by label.
    """

    needs: tuple[str, ...]
    parameters: tuple[str, ...]
    build: Callable[[Result, Any], dict[str, Any]]
    several: Callable[[Mapping[str, Result], Any], dict[str, Any] | None] | None = None


class Plan(Protocol):
    """What a planner answers before anything is run; histories: by label, for figures."""

    @property
    def histories(self) -> Mapping[str, Result]:
        """What was planned, and what it is compared with."""

    @property
    def good(self) -> bool:
        """Whether the plan can be carried out."""

    def text(self) -> str:
        """The plan for reading."""


@dataclass(frozen=True)
class Mission:
    """The figures, measures, claims and other parts of one mission.

    figures, overlays (of several runs), phases (quantity against rate), measures (columns of a
    comparison), claims (papers with verdicts), gauges (shown while a run goes on), scene (replays),
    rules (safety rules of a result), notes (what a reader must know of a result), plans: what
    `harness plan` answers, from a system and the changes of run(); bands: the limits that runs are
    held against where the user names none, definitions: lines below the table that explain its
    columns; idle: variables with the value from which on nothing is in force; validations: numbers
    by others that the mission answers; exchange: files of other tools that it reads and writes;
    restarts: a parameter that holds a state, another one, and its value by which the state counts;
    examples: sources of what may take the place of a component.
    """

    figures: tuple[Figure | Drawing, ...] = ()
    overlays: tuple[Figure | Overlay, ...] = ()
    phases: tuple[Phase, ...] = ()
    measures: tuple[Measure, ...] = ()
    claims: tuple[Paper, ...] = ()
    gauges: tuple[Gauge, ...] = ()
    scene: tuple[Scene, ...] = ()
    rules: tuple[Callable[[Result], Iterator[RuleFinding]], ...] = ()
    notes: tuple[Callable[[Result], Iterator[str]], ...] = ()
    plans: tuple[Callable[..., Plan], ...] = ()
    bands: tuple[Callable[[Limits, Mapping[str, Result]], Limits], ...] = ()
    definitions: tuple[Callable[[Limits], Iterator[str]], ...] = ()
    idle: tuple[tuple[str, float], ...] = ()
    validations: tuple[Validation, ...] = ()
    exchange: tuple[Exchange, ...] = ()
    restarts: tuple[tuple[str, str, float], ...] = ()
    examples: tuple[Example, ...] = ()

    def limits(self, given: Limits, results: Mapping[str, Result]) -> Limits:
        """The limits with the bands that these results suggest."""
        for band in self.bands:
            given = band(given, results)
        return given


def together(missions: Iterable[Mission]) -> Mission:
    """All that several missions offer, what they share once."""
    found = list(missions)
    offered: dict[str, Any] = {
        f.name: tuple(dict.fromkeys(x for m in found for x in getattr(m, f.name)))
        for f in fields(Mission)
    }
    return Mission(**offered)
