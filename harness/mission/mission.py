# SPDX-License-Identifier: BSD-2-Clause
"""Contents of a mission as data: figures, metrics, claims and so on.

A mission is a folder with `system.toml`, perhaps further systems and `campaigns/`, and `mission.py`
for contents of its own; one of the two files is enough. `mission.py` defines

    MISSION = Mission(figures=(...), metrics=(...), claims=(...))

Missions import the harness; the harness contains no name of a mission.
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
from harness.results.program import value_of
from harness.results.result import Result


@dataclass(frozen=True)
class Limits:
    """Limits in the metrics of a comparison, equal for all runs of the comparison.

    position [m], attitude [deg]: an error has settled when it stays at or below this value
    (position None: the mission chooses).
    """

    position: float | None = None
    attitude: float = 1.0


@dataclass(frozen=True)
class Metric(BaseMetric):
    """Metric in a column of a comparison. A function `compute` takes the result and the Limits of
    the comparison; it returns the value, or an expression that gives the value.

    beside: whether the page of a run omits the metric from its headline values; about: function of
    limits and results by label that returns the last line of the column's heading, a text about the
    limits of the metric; words: names of the values 0, 1, ..; apart: a comparison warns if
    positive values differ by more than this factor; above: a comparison warns if a value exceeds
    this number, and its text omits the metric otherwise; meaning: a sentence that explains the
    metric to readers of a page; live: function of result and limits that returns the expression for
    a live page, if `compute` returns no expression.
    """

    beside: bool = False
    about: Callable[[Limits, Mapping[str, Result]], str] | None = None
    words: tuple[str, ...] = ()
    apart: float = math.inf
    above: float = -math.inf
    meaning: str = ""
    live: Callable[[Result, Limits], str] | None = None

    def expression(self, result: Result, limits: Limits) -> str:
        """Return the expression of this metric for all runs of one system, "" if only a function
        can compute the metric. result: any run of the system; limits: of the comparison that shows
        the metric.
        """
        found = self.live or self.compute
        if callable(found):
            found = "" if self.lacks(result) else found(result, limits)
        return found if isinstance(found, str) else ""

    def __call__(self, result: Result, *limits: Limits) -> float:
        """Return the value; NaN if the result does not contain what the metric needs. limits: the
        further argument of `compute`, one Limits, if `compute` is a function.

        Raises HarnessError if the function returns neither a number nor an expression.
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
    """Return the values of metrics: by (name, unit) of the metric, then by the label of the run."""
    return {
        (m.name, m.unit): {label: m(result, limits) for label, result in results.items()}
        for m in found
    }


def apart(
    found: Iterable[Metric], columns: Mapping[tuple[str, str], Mapping[str, float]]
) -> Iterator[str]:
    """Yield a warning per metric whose positive values differ by more than the factor `apart` of
    the metric. columns: values of metrics in the form that measured() returns.
    """
    for metric in found:
        column = columns.get((metric.name, metric.unit), {})
        values = {label: x for label, x in column.items() if math.isfinite(x) and x > 0}
        if values and max(values.values()) > metric.apart * min(values.values()):
            most, least = (pick(values, key=values.__getitem__) for pick in (max, min))
            yield (
                f"{metric.name}: {most} {values[most]:.3g} {metric.unit} and {least} "
                f"{values[least]:.3g} {metric.unit} differ by more than a factor of "
                f"{metric.apart:g}: compare them only if the runs have equal actuators"
            )


def exceeding(
    found: Iterable[Metric], columns: Mapping[tuple[str, str], Mapping[str, float]]
) -> Iterator[str]:
    """Yield a warning per metric and run whose value exceeds `above` of the metric. columns: values
    of metrics in the form that measured() returns.
    """
    for metric in (m for m in found if m.above > -math.inf):
        for label, value in columns.get((metric.name, metric.unit), {}).items():
            if value > metric.above:
                yield (
                    f"{label}: {metric.name} {value:.3g} {metric.unit}, more than "
                    f"{metric.above:g} {metric.unit}: the actuator limit decides, not the control "
                    "law"
                )


class FinalMetric(BaseMetric):
    """Metric whose value in the last row is stated in the head of a page. It is a time series."""

    def text(self, result: Result) -> str:
        """Return the value in the last row (of a vector, the sum of its elements) with its unit, or
        the name of the value if the only variable is a mode (its values 0, 1, .. have names).
        """
        values = self(result)
        try:
            value = float(np.sum(np.atleast_1d(values)[-1]))
        except (TypeError, ValueError, IndexError):
            text = f"expected rows of numbers, got {values!r:.60}"
            raise HarnessError(f"{place_of(self.compute)}metric {self.name}: {text}") from None
        if len(self.needs) == 1 and result.mode_names(self.needs[0]):
            return result.mode(self.needs[0], value)
        return f"{value:.4g} {self.unit}".rstrip()


class Start(NamedTuple):
    """Start values of a system. values: parameters by name, for `set` of run(); notes: assumptions,
    one line each; epoch: UTC of t = 0, for `epoch` of run().
    """

    values: Mapping[str, Any]
    notes: tuple[str, ...]
    epoch: str


@dataclass(frozen=True, eq=False)
class Exchange:
    """Conversion from and to files of other tools.

    writers: by ending of the file, the function that writes the file, called with result, path,
    component (None: the function chooses) and UTC of t = 0; start: function that returns start
    values, called with a system, files (or their text) by component, an epoch or None, and the
    keyword arguments of run() that change the system; remarks: function that returns lines for the
    report page of a result, such as eclipses, called with the result.
    """

    writers: Mapping[str, Callable[[Result, Path, str | None, str], None]] = field(
        default_factory=dict
    )
    start: Callable[..., Start] | None = None
    remarks: Callable[[Result], Iterable[str]] | None = None


class Example(NamedTuple):
    """Example source code for users: a controller that can replace a component, or a sensor or
    plant that extends a system.

    place: for a controller, the component that it replaces; for a sensor or plant, the system that
    it extends by a TOML file beside the source; inputs: names of needed inputs; outputs: names of
    all outputs; file: path of the source without ending, in the folder of examples; note: for users
    who change the source; kind: controller, sensor or plant; options: options of the command line
    for a first run.
    """

    place: str
    inputs: frozenset[str]
    outputs: frozenset[str]
    file: Path
    note: str = ""
    kind: str = "controller"
    options: str = ""


class Scene(NamedTuple):
    """Replay in space, for results with the variables `needs` and with `parameters`. build:
    function that returns the replay, called with the result and the arrays of the page; several:
    the same, called with several results by label instead of one (None: not supported).
    """

    needs: tuple[str, ...]
    parameters: tuple[str, ...]
    build: Callable[[Result, Any], dict[str, Any]]
    several: Callable[[Mapping[str, Result], Any], dict[str, Any] | None] | None = None


class Steering(NamedTuple):
    """Task for an agent that replaces components and sets their outputs. open: replaced components;
    every: macro steps per action (0: longest of their periods); cost: expression whose increase is
    the cost of a step; ends: conditions that end an episode; bounds: pairs (output, bound) for
    outputs that no actuator limits; a bound is x for -x to x, or the smallest and largest value.
    """

    open: tuple[str, ...]
    every: int = 0
    cost: str = ""
    ends: tuple[str, ...] = ()
    bounds: tuple[tuple[str, float | tuple[float, float]], ...] = ()


class Plan(Protocol):
    """Plan for a run, made before the run: the answer of `harness plan`."""

    @property
    def histories(self) -> Mapping[str, Result]:
        """Return the planned time series, and time series for comparison, by label, for figures."""

    @property
    def good(self) -> bool:
        """Return whether the plan is feasible."""

    def text(self) -> str:
        """Return the plan as text."""


class LeastImpulse(Protocol):
    """Least impulse with which a run would have been possible: the answer of `harness bound`."""

    @property
    def verified(self) -> Result | None:
        """Return a run with the least impulse; None if every phase of the mission was simulated
        alone, so that there is no run of the whole mission.
        """

    def lines(self) -> Iterator[str]:
        """Yield the lines that `harness bound` prints."""

    def store(self) -> Path:
        """Store the answer for later reports and comparisons, and return the path of the file."""


@dataclass(frozen=True)
class Mission(Checked):
    """Figures, metrics, claims and other parts of one mission.

    figures; overlays: figures of several runs; phases: plots of a quantity against its rate;
    metrics: columns of a comparison; claims: papers with claims; final: metrics for the head of a
    page; scene: replays in space; rules: functions that return the findings about safety rules of a
    result; notes: functions that return facts about a result that its values do not show; plans:
    functions that answer `harness plan`, called with a system and the keyword arguments of run()
    that change the system; bands: functions that complete the limits of a comparison; definitions:
    functions that return lines below the table of a comparison, which explain its columns; idle:
    pairs of a variable and the value from which on the variable has no meaning and is not drawn;
    validations: cases with published reference values; exchange: files of other tools; restarts:
    triples (p, q, v): the start value of a state in parameter p is used only if parameter q has the
    value v; examples: sources that can replace a component or extend a system; steering: tasks for
    agents, the default first; bounds: functions that answer `harness bound`, called with a system
    and the options `cost`, `grid` and `without`; they return None for a system that they do not
    support.
    """

    figures: tuple[Figure | Drawing, ...] = ()
    overlays: tuple[Figure | Overlay, ...] = ()
    phases: tuple[Phase, ...] = ()
    metrics: tuple[Metric, ...] = ()
    claims: tuple[Paper, ...] = ()
    final: tuple[FinalMetric, ...] = ()
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
    bounds: tuple[Callable[..., LeastImpulse | None], ...] = ()

    def limits(self, given: Limits, results: Mapping[str, Result]) -> Limits:
        """Return the limits of a comparison, completed by the functions `bands` of the mission for
        its results.
        """
        for band in self.bands:
            given = one(Limits, band, given, results)
        return given


def together(missions: Iterable[Mission]) -> Mission:
    """Return one mission with the contents of several missions; equal entries appear once."""
    found = list(missions)
    offered: dict[str, Any] = {
        f.name: tuple(dict.fromkeys(x for m in found for x in getattr(m, f.name)))
        for f in fields(Mission)
    }
    return Mission(**offered)
