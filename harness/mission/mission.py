# SPDX-License-Identifier: BSD-2-Clause
"""Contents of a mission as data: figures, metrics, claims and so on.

A mission is a folder with `system.toml`, further systems, `campaigns/` and, for contents of its
own, `mission.py` with

    MISSION = Mission(figures=(...), metrics=(...), claims=(...))

Missions import the engine; the engine knows no mission.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np

from harness.errors import HarnessError
from harness.mission.claim import (
    BaseMetric,
    NotANumberError,
    Paper,
    RuleFinding,
    Validation,
    one_number,
)
from harness.mission.fields import Checked, one, place_of
from harness.mission.figure import Drawing, Figure, Overlay, Phase
from harness.mission.optimum import Bound, PhaseBounds
from harness.results.program import value_of
from harness.results.result import Result


@dataclass(frozen=True)
class Limits:
    """Limits for all runs of a comparison.

    position [m], attitude [deg]: an error has settled when it stays within this band (None: chosen
    by the mission).
    """

    position: float | None = None
    attitude: float = 1.0


@dataclass(frozen=True)
class Metric(BaseMetric):
    """Metric in a column of a comparison, whose function takes the limits too.

    beside: shown in a table of its own, not among the metrics of a page; about: meaning of the
    limits for it, the last line of its heading; words: names of its values 0, 1, ..; apart: a
    comparison warns if its values differ by more than this factor; above: a comparison shows the
    metric, with a warning, only if a value exceeds this; meaning: a sentence for readers of a page.
    The function returns the value, or an expression that gives it. live: a function of result and
    limits that returns the expression of a live page, if the value is not from an expression.
    """

    beside: bool = False
    about: Callable[[Limits, Mapping[str, Result]], str] | None = None
    words: tuple[str, ...] = ()
    apart: float = math.inf
    above: float = -math.inf
    meaning: str = ""
    live: Callable[[Result, Limits], str] | None = None

    def expression(self, result: Result, limits: Limits) -> str:
        """Return the expression that gives the value in each run of the system of a result, "" if
        only a function does.
        """
        found = self.live or self.compute
        if callable(found):
            found = "" if self.lacks(result) else found(result, limits)
        return found if isinstance(found, str) else ""

    def __call__(self, result: Result, *limits: Limits) -> float:
        """Return the value; NaN if the result lacks what it needs, or has no such value.

        Raises HarnessError if the function returns something else than a number.
        """
        if self.lacks(result):
            return math.nan
        found = super().__call__(result, *limits)
        try:
            return one_number(value_of(result, found) if isinstance(found, str) else found)
        except NotANumberError as error:
            raise HarnessError(f"{place_of(self.compute)}metric {self.name} {error}") from error
        except ValueError as error:
            text = f"is {found!r:.60}, neither a number nor an expression: {error}"
            raise HarnessError(f"{place_of(self.compute)}metric {self.name} {text}") from error


def measured(
    found: Iterable[Metric], results: Mapping[str, Result], limits: Limits
) -> dict[tuple[str, str], dict[str, float]]:
    """Return the metrics of results by (name, unit), then by the label of the run."""
    return {
        (m.name, m.unit): {label: m(result, limits) for label, result in results.items()}
        for m in found
    }


def apart(
    found: Iterable[Metric], columns: Mapping[tuple[str, str], Mapping[str, float]]
) -> Iterator[str]:
    """Yield a line per metric whose values differ by more than its factor."""
    for metric in found:
        column = columns.get((metric.name, metric.unit), {})
        values = {label: x for label, x in column.items() if math.isfinite(x) and x > 0}
        if values and max(values.values()) > metric.apart * min(values.values()):
            most, least = (pick(values, key=values.__getitem__) for pick in (max, min))
            yield (
                f"{metric.name}: {most} {values[most]:.3g} {metric.unit}, {least} "
                f"{values[least]:.3g} {metric.unit} differ by more than a factor of "
                f"{metric.apart:g}: the actuators are not the same"
            )


def exceeding(
    found: Iterable[Metric], columns: Mapping[tuple[str, str], Mapping[str, float]]
) -> Iterator[str]:
    """Yield a line per metric and run above the value from which on the metric is shown."""
    for metric in (m for m in found if m.above > -math.inf):
        for label, value in columns.get((metric.name, metric.unit), {}).items():
            if value > metric.above:
                yield (
                    f"{label}: {metric.name} {value:.3g} {metric.unit}, more than "
                    f"{metric.above:g} {metric.unit}: the run shows the limit, not the law"
                )


class WatchedMetric(BaseMetric):
    """Metric of the last row of a run in progress. Its function returns a history, or a text ("":
    nothing to show).
    """

    def text(self, result: Result) -> str:
        """Return the value, or its name if its one variable defines names for numbers."""
        values = self(result)
        if isinstance(values, str):
            return values
        try:
            value = float(np.sum(np.atleast_1d(values)[-1]))
        except (TypeError, ValueError, IndexError):
            text = f"expected rows of numbers or a text, got {values!r:.60}"
            raise HarnessError(f"{place_of(self.compute)}metric {self.name}: {text}") from None
        if len(self.needs) == 1 and result.mode_names(self.needs[0]):
            return result.mode(self.needs[0], value)
        return f"{value:.4g} {self.unit}".rstrip()


class Start(NamedTuple):
    """Start values: parameters by name, for `set` of run(); assumptions, one line each; UTC of t =
    0, for `epoch`.
    """

    values: Mapping[str, Any]
    notes: tuple[str, ...]
    epoch: str


@dataclass(frozen=True, eq=False)
class Exchange:
    """Files of other tools.

    writers: by ending, a function of a result, the path, a component (None: any suitable one) and
    the UTC of t = 0; start: start values of a system from files (or their text) by component, an
    epoch or None and changes of run(); remarks: lines of a page about a result, besides the notes.
    """

    writers: Mapping[str, Callable[[Result, Path, str | None, str], None]] = field(
        default_factory=dict
    )
    start: Callable[..., Start] | None = None
    remarks: Callable[[Result], Iterable[str]] | None = None


class Example(NamedTuple):
    """Source that can replace a component: the component, the inputs that it needs, its outputs,
    its file without ending in the folder of examples, and a note for users who change it. A sensor
    or a plant is added to a system instead: the place is the system, a TOML beside the source
    extends it, options are options of a first run.
    """

    place: str
    inputs: frozenset[str]
    outputs: frozenset[str]
    file: Path
    note: str = ""
    kind: str = "controller"
    options: str = ""


class Scene(NamedTuple):
    """Replay in space for results with these variables and parameters; build: from the result and
    the arrays of the page; several: the same for several runs by label.
    """

    needs: tuple[str, ...]
    parameters: tuple[str, ...]
    build: Callable[[Result, Any], dict[str, Any]]
    several: Callable[[Mapping[str, Result], Any], dict[str, Any] | None] | None = None


class Steering(NamedTuple):
    """Agent in the place of components: the components, macro steps per action (0: their own
    period), a quantity whose increase is the cost of a step, conditions that end an episode, and
    bounds of outputs by name in place of the limits of the actuators.
    """

    open: tuple[str, ...]
    every: int = 0
    cost: str = ""
    ends: tuple[str, ...] = ()
    bounds: tuple[tuple[str, float | tuple[float, float]], ...] = ()


class Plan(Protocol):
    """Answer of a planner before a run; histories: by label, for figures."""

    @property
    def histories(self) -> Mapping[str, Result]:
        """Return the planned histories and the histories for comparison."""

    @property
    def good(self) -> bool:
        """Return whether the plan is feasible."""

    def text(self) -> str:
        """Return the plan as text."""


@dataclass(frozen=True)
class Mission(Checked):
    """Figures, metrics, claims and other parts of one mission.

    figures; overlays (of several runs); phases (quantity against rate); metrics (columns of a
    comparison); claims (papers with verdicts); watched (metrics shown during a run); scene
    (replays); rules (safety rules of a result); notes (facts about a result that its numbers do not
    show); plans: answer of `harness plan` for a system and the changes of run(); bands: default
    limits of a comparison; definitions: lines below the table that explain its columns; idle:
    variables with the value from which on nothing is in force; validations: cases with published
    reference values; exchange: files of other tools; restarts: a parameter that contains a state,
    another parameter, and its value that enables the state; examples: sources that can replace a
    component or extend a system; steering: components that an agent replaces, the first choice
    first; bounds: convex problems whose optimum a run is compared with.
    """

    figures: tuple[Figure | Drawing, ...] = ()
    overlays: tuple[Figure | Overlay, ...] = ()
    phases: tuple[Phase, ...] = ()
    metrics: tuple[Metric, ...] = ()
    claims: tuple[Paper, ...] = ()
    watched: tuple[WatchedMetric, ...] = ()
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
    steering: tuple[Steering, ...] = ()
    bounds: tuple[Bound | PhaseBounds, ...] = ()

    def limits(self, given: Limits, results: Mapping[str, Result]) -> Limits:
        """Return the limits, completed by the bands that these results suggest."""
        for band in self.bands:
            given = one(Limits, band, given, results)
        return given


def together(missions: Iterable[Mission]) -> Mission:
    """Return the contents of several missions together, shared entries once."""
    found = list(missions)
    offered: dict[str, Any] = {
        f.name: tuple(dict.fromkeys(x for m in found for x in getattr(m, f.name)))
        for f in fields(Mission)
    }
    return Mission(**offered)
