# SPDX-License-Identifier: BSD-2-Clause
"""Statements with a verdict as data: a claim of a paper (what it says, how it is measured in a
result, the bands that decide), a safety rule that was in force, numbers made by others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from harness.results.number import Number
from harness.results.result import Array, Result, Rows
from harness.results.verdict import Judged, Kind, Verdict

Evaluation = Callable[[Result], tuple[float, ...]]
"""Numbers taken from a result: the first is judged, the others are shown with it. May raise
CannotJudgeError.
"""
ROUNDING = 1e-6
"""Times closer than this [s] are the same."""


class CannotJudgeError(Exception):
    """The result does not hold what a claim needs; str() is the reason."""


class NotExercisedError(CannotJudgeError):
    """The run ended before the time that a claim is about."""


@dataclass(frozen=True)
class Band:
    """Closed interval of a measured number."""

    low: float = -math.inf
    high: float = math.inf

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high

    def __str__(self) -> str:
        if math.isinf(self.low):
            return f"<= {self.high:g}"
        return f">= {self.low:g}" if math.isinf(self.high) else f"{self.low:g} to {self.high:g}"


def at_most(high: float) -> Band:
    """Everything up to a number."""
    return Band(high=high)


def at_least(low: float) -> Band:
    """Everything from a number on."""
    return Band(low=low)


class Judgement(NamedTuple):
    """What the table shows of a claim."""

    figure: str
    verdict: Verdict


@dataclass(frozen=True)
class Claim:
    """One claim.

    name: for references; text: the statement of the paper; where: its place in the paper; needs,
    measure, unit: of its numbers, see harness.results.number, which are shown as `figure` formats
    them; the first decides on the verdict; reproduced, partly: bands of the first number; interval:
    longest recording interval [s] for a verdict.
    """

    name: str
    text: str
    where: str
    needs: tuple[str, ...]
    measure: Evaluation | str
    figure: str
    unit: str
    reproduced: Band
    partly: Band | None = None
    interval: float = 10.0

    def evaluate(self, result: Result) -> Judgement:
        """The measured figure and the verdict, or the reason why there is none."""
        try:
            numbers = self.numbers(result)
        except NotExercisedError as reason:
            return Judgement(str(reason), Verdict.NOT_EXERCISED)
        except CannotJudgeError as reason:
            return Judgement(str(reason), Verdict.NOT_JUDGED)
        return Judgement(self.figure.format(*numbers), self.verdict(numbers[0]))

    def numbers(self, result: Result) -> tuple[float, ...]:
        """Measure the result; CannotJudgeError if something is missing or not finite."""
        number = Number(self.name, self.unit, self.needs, self.measure)
        if missing := number.lacks(result):
            raise CannotJudgeError(f"the result holds no {' and no '.join(missing)}")
        if not len(result.time):
            raise CannotJudgeError("nothing was recorded")
        if (interval := np.diff(result.time).max(initial=0.0)) > self.interval + ROUNDING:
            raise CannotJudgeError(f"recorded every {interval:g} s, {self.interval:g} s are needed")
        with np.errstate(all="ignore"):
            numbers = tuple(np.atleast_1d(number(result)).tolist())
        if not np.isfinite(numbers).all():
            raise CannotJudgeError("the result holds values that are not finite or never change")
        return numbers

    def verdict(self, value: float) -> Verdict:
        """Return the verdict of the band that a measured number falls into."""
        if value in self.reproduced:
            return Verdict.REPRODUCED
        return Verdict.PARTLY if self.partly and value in self.partly else Verdict.NOT_REPRODUCED

    def criterion(self, band: Band | None) -> str:
        """One of the two bands in words, e.g. `<= 2 deg`."""
        return f"{band} {self.unit}".rstrip() if band else ""


@dataclass(frozen=True)
class Case:
    """A run that a paper describes.

    system: name; params: set; swap: (component, FMU); free: parameters on which the paper leaves
    the choice, `stop` for any end.
    """

    system: str
    params: str = "default"
    swap: tuple[tuple[str, str], ...] = ()
    free: tuple[str, ...] = ()


@dataclass(frozen=True)
class Paper:
    """A paper, or one part, and its claims.

    It belongs to every result that holds all variables of `needs` and all `parameters` and that is
    `meant`. cases: the runs that it describes (none: the claims are about every run); differs: how
    a result is none of them in parameters that they leave free, a text each.
    """

    title: str
    needs: tuple[str, ...]
    claims: tuple[Claim, ...]
    parameters: tuple[str, ...] = ()
    meant: Callable[[Result], bool] = lambda result: True
    cases: tuple[Case, ...] = ()
    differs: Callable[[Result], Iterable[str]] = lambda result: ()

    def belongs_to(self, result: Result) -> bool:
        """Whether these claims are about a result like this."""
        return result.holds(*self.needs, parameters=self.parameters) and self.meant(result)


# ---- parameters and parts of a history


def scalar(result: Result, name: str) -> float:
    """Value of a scalar parameter, or of one element, of the run; CannotJudgeError if the result
    does not hold it.
    """
    return float(parameter(result, name))


def parameter(result: Result, name: str) -> Array:
    """Value of a parameter of the run; CannotJudgeError if the result does not hold it, as one from
    a .csv.
    """
    if not result.holds(parameters=(name,)):
        raise CannotJudgeError(f"the result does not hold the parameter {name}")
    return result.parameter(name)


def between(result: Result, begin: float, end: float) -> Rows:
    """Rows of begin <= t <= end [s], at least one; NotExercisedError if the run is over before the
    end of that.
    """
    if result.time[-1] < end - ROUNDING:
        raise NotExercisedError(f"the run ends at {result.time[-1]:g} s, before {end:g} s")
    chosen = np.flatnonzero((result.time >= begin - ROUNDING) & (result.time <= end + ROUNDING))
    if not len(chosen):
        raise CannotJudgeError(f"nothing was recorded between {begin:g} s and {end:g} s")
    return chosen


def since(result: Result, begin: float, reach: float) -> Rows:
    """Rows from a time on; NotExercisedError if the run is over before it has reached another time
    [s].
    """
    return between(result, begin, max(float(result.time[-1]), reach))


def final(result: Result, seconds: float, reach: float, before: float = 0.0) -> Rows:
    """Rows of the last seconds of a run that reaches a time [s], or of as many seconds some time
    `before` the last.
    """
    end = max(float(result.time[-1]), reach)
    between(result, -math.inf, end)
    return between(result, end - before - seconds, end - before)


def at(result: Result, time: float) -> int:
    """Return the last row at or before a time [s]; NotExercisedError if the run is over earlier."""
    return int(between(result, -math.inf, time)[-1])


class RuleFinding(NamedTuple):
    """A rule: its name, the least margin since the start and its unit, the time of the first
    violation [s] (NaN: none), what the margin is, and the limit in words.
    """

    name: str
    margin: float
    unit: str
    violated: float
    text: str = ""
    limit: str = ""

    @property
    def verdict(self) -> Verdict:
        """Whether the rule was never violated."""
        return Verdict.HOLDS if math.isnan(self.violated) else Verdict.VIOLATED

    @property
    def state(self) -> str:
        """The verdict in words, with the first violation."""
        since = "" if math.isnan(self.violated) else f", first at {self.violated:.2f} s"
        return Kind.RULE.word(self.verdict) + since

    @property
    def judged(self) -> Judged:
        """What decides on the exit status."""
        return Judged(Kind.RULE, self.name, self.verdict, f"{self.name}: {self.state}")


@dataclass(frozen=True)
class Row:
    """One quantity of one case: the largest difference over its rows, in `unit`.

    case: its name; tests: what it tests; source: name, where, licence of the numbers.
    """

    case: str
    tests: str
    source: Mapping[str, str]
    quantity: str
    difference: float
    tolerance: float
    unit: str

    @property
    def within(self) -> bool:
        """Whether we agree; a difference that is not a number does not."""
        return self.difference <= self.tolerance

    @property
    def verdict(self) -> str:
        """The same as a word."""
        return "agrees" if self.within else "DIFFERS"


class Validation(NamedTuple):
    """Cases: names: of all; answer: rows of the case of a name."""

    names: Callable[[], Sequence[str]]
    answer: Callable[[Sequence[str]], Sequence[Row]]
