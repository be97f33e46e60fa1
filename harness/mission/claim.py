# SPDX-License-Identifier: BSD-2-Clause
"""Metrics, numbers that are computed from a result, and statements with a verdict as data: claims
of a paper (statement, metric in a result, deciding bands), safety rules that were in force,
published reference values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from harness.results.expressions import parsed
from harness.results.program import value_of
from harness.results.result import Array, Result, Rows
from harness.results.verdict import Kind, Outcome, Verdict

# ---- metrics


class NotANumberError(ValueError):
    """Value of a metric that is not one number."""


def one_number(given: Any) -> float:
    """Return the value of a metric as float; raise NotANumberError if it is not one number."""
    if shape := np.shape(given):
        size = " x ".join(map(str, shape))
        raise NotANumberError(
            f"is an array of {size}, not one number; reduce it with last() or max()"
        )
    if not isinstance(given, int | float | np.number | np.bool_ | np.ndarray):
        raise NotANumberError(f"is {given!r:.40}, not a number")
    return float(given)


@dataclass(frozen=True)
class BaseMetric:
    """Named quantity computed from a result: a number, or a time series with a value per row. Base
    class of columns of a comparison, metrics of a campaign, watched metrics of a run and values of
    claims.

    name, unit: texts for tables and axes; needs, parameters: variables and parameters of the run
    that the result must contain; compute: function of the result, or an expression such as
    `max(norm(servicer.v_SN_N))`, whose variables need not be listed in needs.
    """

    name: str
    unit: str
    needs: tuple[str, ...]
    compute: Callable[..., Any] | str
    parameters: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Collect the variables of an expression; raise TypeError if compute is neither a function
        nor an expression.
        """
        if isinstance(self.compute, str):
            tree = parsed(self.compute)
            held = [n.partition(" ")[2] for n in tree.variables if n.startswith("parameter ")]
            object.__setattr__(self, "needs", tuple(dict.fromkeys((*self.needs, *tree.outputs))))
            object.__setattr__(self, "parameters", (*self.parameters, *held))
        elif not callable(self.compute):
            raise TypeError(
                f"{self.name}: expected a function or an expression, got {self.compute!r:.40}"
            )

    def lacks(self, result: Result) -> list[str]:
        """Return the needed variables and parameters that the result lacks."""
        fixed = [n for n in self.parameters if not result.holds(parameters=(n,))]
        return [name for name in self.needs if name not in result] + fixed

    def __call__(self, result: Result, *further: Any) -> Any:
        """Return the value; further: arguments of the function besides the result."""
        if callable(self.compute):
            return self.compute(result, *further)
        return value_of(result, self.compute)


# ---- statements

Evaluation = Callable[[Result], tuple[float, ...]]
"""Numbers computed from a result: the first decides the verdict, the others are shown too. May
raise NotJudgedError.
"""
ROUNDING = 1e-6
"""Largest distance of times that count as the same [s]."""


class NotJudgedError(Exception):
    """Result without the data that a claim needs. str() gives the reason."""


class NotExercisedError(NotJudgedError):
    """End of a run before the time that a claim is about."""


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
    """Return the band of all numbers up to a limit."""
    return Band(high=high)


def at_least(low: float) -> Band:
    """Return the band of all numbers from a limit on."""
    return Band(low=low)


class Judgement(NamedTuple):
    """Value of a claim as text, and its verdict."""

    value: str
    verdict: Verdict


@dataclass(frozen=True)
class Claim:
    """Claim of a paper.

    name: for references; text: the statement of the paper; where: its place in the paper; needs,
    compute, unit: of its numbers, see harness.mission.claim; value: format of the numbers. The
    first number determines the verdict; reproduced, partly: its bands; interval: longest recording
    interval [s] for a verdict.
    """

    name: str
    text: str
    where: str
    needs: tuple[str, ...]
    compute: Evaluation | str
    value: str
    unit: str
    reproduced: Band
    partly: Band | None = None
    interval: float = 10.0

    def evaluate(self, result: Result) -> Judgement:
        """Return the measured value and the verdict, or the reason why there is none."""
        try:
            numbers = self.numbers(result)
        except NotExercisedError as reason:
            return Judgement(str(reason), Verdict.NOT_EXERCISED)
        except NotJudgedError as reason:
            return Judgement(str(reason), Verdict.NOT_JUDGED)
        return Judgement(self.value.format(*numbers), self.verdict(numbers[0]))

    def numbers(self, result: Result) -> tuple[float, ...]:
        """Return the numbers of the claim in the result; raise NotJudgedError if something is
        missing or not finite.
        """
        number = BaseMetric(self.name, self.unit, self.needs, self.compute)
        if missing := number.lacks(result):
            raise NotJudgedError(f"the result holds no {' and no '.join(missing)}")
        if not len(result.time):
            raise NotJudgedError("nothing was recorded")
        if (interval := np.diff(result.time).max(initial=0.0)) > self.interval + ROUNDING:
            raise NotJudgedError(f"recorded every {interval:g} s, {self.interval:g} s are needed")
        with np.errstate(all="ignore"):
            numbers = tuple(np.atleast_1d(number(result)).tolist())
        if not np.isfinite(numbers).all():
            raise NotJudgedError("the result holds values that are not finite or never change")
        return numbers

    def verdict(self, value: float) -> Verdict:
        """Return the verdict of the band that a measured number falls into."""
        if value in self.reproduced:
            return Verdict.REPRODUCED
        return Verdict.PARTLY if self.partly and value in self.partly else Verdict.NOT_REPRODUCED

    def criterion(self, band: Band | None) -> str:
        """Return one of the two bands as text, e.g. `<= 2 deg`."""
        return f"{band} {self.unit}".rstrip() if band else ""


@dataclass(frozen=True)
class Case:
    """Run that a paper describes.

    system: name; params: parameter set; swap: (component, FMU); free: parameters that the paper
    leaves open, `stop` for any end.
    """

    system: str
    params: str = "default"
    swap: tuple[tuple[str, str], ...] = ()
    free: tuple[str, ...] = ()


@dataclass(frozen=True)
class Paper:
    """Paper, or a part of one, with its claims.

    It applies to every result with all variables of `needs` and all `parameters` for which `meant`
    is true. cases: runs that it describes (none: the claims apply to every run); differs:
    deviations of a result from all cases in parameters that they leave free, a text each.
    """

    title: str
    needs: tuple[str, ...]
    claims: tuple[Claim, ...]
    parameters: tuple[str, ...] = ()
    meant: Callable[[Result], bool] = lambda result: True
    cases: tuple[Case, ...] = ()
    differs: Callable[[Result], Iterable[str]] = lambda result: ()

    def belongs_to(self, result: Result) -> bool:
        """Return whether the claims apply to a result."""
        return result.holds(*self.needs, parameters=self.parameters) and self.meant(result)


# ---- parameters and parts of a history


def scalar(result: Result, name: str) -> float:
    """Return the value of a scalar parameter, or of one element, of the run; raise NotJudgedError
    if the result lacks it.
    """
    return float(parameter(result, name))


def parameter(result: Result, name: str) -> Array:
    """Return the value of a parameter of the run; raise NotJudgedError if the result lacks it,
    such as a result from a .csv.
    """
    if not result.holds(parameters=(name,)):
        raise NotJudgedError(f"the result does not hold the parameter {name}")
    return result.parameter(name)


def between(result: Result, begin: float, end: float) -> Rows:
    """Return the rows of begin <= t <= end [s], at least one; raise NotExercisedError if the run
    ends earlier.
    """
    if result.time[-1] < end - ROUNDING:
        raise NotExercisedError(f"the run ends at {result.time[-1]:g} s, before {end:g} s")
    chosen = np.flatnonzero((result.time >= begin - ROUNDING) & (result.time <= end + ROUNDING))
    if not len(chosen):
        raise NotJudgedError(f"nothing was recorded between {begin:g} s and {end:g} s")
    return chosen


def since(result: Result, begin: float, reach: float) -> Rows:
    """Return the rows from a time on; raise NotExercisedError if the run ends before the time
    `reach` [s].
    """
    return between(result, begin, max(float(result.time[-1]), reach))


def final(result: Result, seconds: float, reach: float, before: float = 0.0) -> Rows:
    """Return the rows of the last `seconds` of a run that reaches a time [s], or of an equal span
    that ends `before` seconds earlier.
    """
    end = max(float(result.time[-1]), reach)
    between(result, -math.inf, end)
    return between(result, end - before - seconds, end - before)


def at(result: Result, time: float) -> int:
    """Return the last row at or before a time [s]; NotExercisedError if the run is over earlier."""
    return int(between(result, -math.inf, time)[-1])


class RuleFinding(NamedTuple):
    """Finding about a safety rule: its name, the least margin since the start and its unit, the
    time of the first violation [s] (NaN: none), the meaning of the margin, and the limit in words.
    """

    name: str
    margin: float
    unit: str
    violated: float
    text: str = ""
    limit: str = ""

    @property
    def verdict(self) -> Verdict:
        """Return MET if the rule was never violated."""
        return Verdict.HOLDS if math.isnan(self.violated) else Verdict.VIOLATED

    @property
    def state(self) -> str:
        """Return the verdict as text, with the first violation."""
        since = "" if math.isnan(self.violated) else f", first at {self.violated:.2f} s"
        return Kind.RULE.word(self.verdict) + since

    @property
    def outcome(self) -> Outcome:
        """Return the verdict for the exit status."""
        return Outcome(Kind.RULE, self.name, self.verdict, f"{self.name}: {self.state}")


@dataclass(frozen=True)
class Row:
    """Quantity of a case: the largest difference over its rows, in `unit`.

    case: its name; tests: subject of the test; source: name, place and licence of the numbers.
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
        """Return whether the values agree. A difference that is not a number does not."""
        return self.difference <= self.tolerance

    @property
    def verdict(self) -> str:
        """Return the agreement as a word."""
        return "agrees" if self.within else "DIFFERS"


class Validation(NamedTuple):
    """Validation cases. names: of all cases; answer: rows of the case with a name."""

    names: Callable[[], Sequence[str]]
    answer: Callable[[Sequence[str]], Sequence[Row]]
