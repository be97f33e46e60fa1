# SPDX-License-Identifier: BSD-2-Clause
"""Metrics (numbers that are computed from a result) and statements with a verdict, as data: claims
of a paper, each with a metric and bands that determine the verdict; safety rules that applied in a
run; and published reference values.
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
    """Error: the value of a metric is not one number."""


def one_number(given: Any) -> float:
    """Return the value of a metric as a float; raise NotANumberError if it is not one number."""
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
    class of columns of a comparison, metrics of a campaign, final metrics of a run and values of
    claims.

    name, unit: texts for tables and axes; needs, parameters: variables and parameters of the run
    that the result must contain; compute: function of the result, or an expression such as
    `max(norm(servicer.v_SN_N))`, whose variables and parameters are added to `needs` and
    `parameters`.
    """

    name: str
    unit: str
    needs: tuple[str, ...]
    compute: Callable[..., Any] | str
    parameters: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Add the variables and parameters of an expression to `needs` and `parameters`; raise
        TypeError if `compute` is neither a function nor an expression.
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
        """Return the names of needed variables and parameters that the result does not contain."""
        fixed = [n for n in self.parameters if not result.holds(parameters=(n,))]
        return [name for name in self.needs if name not in result] + fixed

    def __call__(self, result: Result, *further: Any) -> Any:
        """Return the value of the metric; further: arguments of the function `compute` besides the
        result.
        """
        if callable(self.compute):
            return self.compute(result, *further)
        return value_of(result, self.compute)


# ---- statements

Evaluation = Callable[[Result], tuple[float, ...]]
"""Function that computes the numbers of a claim from a result: the first decides the verdict, the
other numbers are only shown. It may raise NotJudgedError.
"""
ROUNDING = 1e-6
"""Largest difference of two times that count as equal [s]."""


class NotJudgedError(Exception):
    """Error: a claim cannot be evaluated with a result. str() gives the reason."""


class NotExercisedError(NotJudgedError):
    """Error: a run lacks the event that a claim is about. str() gives the reason."""


@dataclass(frozen=True)
class Band:
    """Closed interval of values of a metric."""

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
    """Verdict on a claim. value: the measured value as text, or the reason why there is no
    value.
    """

    value: str
    verdict: Verdict


@dataclass(frozen=True)
class Claim:
    """Claim of a paper.

    name: short name of the claim; text: the statement of the paper; where: place of the statement
    in the paper; needs, compute, unit: fields of the claim's metric, as in BaseMetric; value:
    format string that shows the numbers of the metric; reproduced, partly: bands for the first of
    these numbers, which determines the verdict; interval: largest time between two recorded rows
    [s] with which the claim can be evaluated.
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
        """Return the measured value with its verdict, or the reason why the claim cannot be
        evaluated.
        """
        try:
            numbers = self.numbers(result)
        except NotExercisedError as reason:
            return Judgement(str(reason), Verdict.NOT_EXERCISED)
        except NotJudgedError as reason:
            return Judgement(str(reason), Verdict.NOT_JUDGED)
        return Judgement(self.value.format(*numbers), self.verdict(numbers[0]))

    def numbers(self, result: Result) -> tuple[float, ...]:
        """Return the numbers of the claim for a result; raise NotJudgedError if the result lacks
        data, has rows more than `interval` apart, or gives numbers that are not finite.
        """
        number = BaseMetric(self.name, self.unit, self.needs, self.compute)
        if missing := number.lacks(result):
            raise NotJudgedError(f"the result holds no {' and no '.join(missing)}")
        if not len(result.time):
            raise NotJudgedError("the run recorded no row")
        if (interval := np.diff(result.time).max(initial=0.0)) > self.interval + ROUNDING:
            most = f"the claim needs at most {self.interval:g} s"
            raise NotJudgedError(f"rows are up to {interval:g} s apart, {most}")
        with np.errstate(all="ignore"):
            numbers = tuple(np.atleast_1d(number(result)).tolist())
        if not np.isfinite(numbers).all():
            raise NotJudgedError("its value is not finite: the result is constant or not finite")
        return numbers

    def verdict(self, value: float) -> Verdict:
        """Return the verdict for a value: the band in which it lies."""
        if value in self.reproduced:
            return Verdict.REPRODUCED
        return Verdict.PARTLY if self.partly and value in self.partly else Verdict.NOT_REPRODUCED

    def criterion(self, band: Band | None) -> str:
        """Return a band of this claim with the unit as text, such as `<= 2 deg`, "" for None."""
        return f"{band} {self.unit}".rstrip() if band else ""


@dataclass(frozen=True)
class Case:
    """Case of a paper: the run for which the paper states its claims.

    system: name of the system; params: parameter set; swap: pairs (component, FMU); free:
    parameters that may have other values, and `stop` if any stop time is permitted.
    """

    system: str
    params: str = "default"
    swap: tuple[tuple[str, str], ...] = ()
    free: tuple[str, ...] = ()


@dataclass(frozen=True)
class Paper:
    """Paper, or a part of a paper, with its claims.

    The claims apply to every result that has all variables of `needs` and all `parameters` and for
    which `meant` returns True. cases: runs that the paper describes (none: the claims apply to
    every run); differs: function that returns a text for each free parameter (Case.free) whose
    value in a result lies outside the values that the paper describes.
    """

    title: str
    needs: tuple[str, ...]
    claims: tuple[Claim, ...]
    parameters: tuple[str, ...] = ()
    meant: Callable[[Result], bool] = lambda result: True
    cases: tuple[Case, ...] = ()
    differs: Callable[[Result], Iterable[str]] = lambda result: ()

    def belongs_to(self, result: Result) -> bool:
        """Return whether the claims of the paper apply to a result."""
        return result.holds(*self.needs, parameters=self.parameters) and self.meant(result)


# ---- parameters and parts of a time series


def scalar(result: Result, name: str) -> float:
    """Return the value of a scalar parameter of the run, or of one element of a vector or matrix;
    raise NotJudgedError if the result does not contain it.
    """
    return float(parameter(result, name))


def parameter(result: Result, name: str) -> Array:
    """Return the value of a parameter of the run; raise NotJudgedError if the result does not
    contain it, for example because it was read from a .csv without its NAME.csv.toml.
    """
    if not result.holds(parameters=(name,)):
        raise NotJudgedError(f"the result does not hold the parameter {name}")
    return result.parameter(name)


def between(result: Result, begin: float, end: float) -> Rows:
    """Return the rows with begin <= t <= end [s]; raise NotExercisedError if the run ends before
    `end`, NotJudgedError if there is no such row.
    """
    if result.time[-1] < end - ROUNDING:
        raise NotExercisedError(f"the run ends at {result.time[-1]:g} s, before {end:g} s")
    chosen = np.flatnonzero((result.time >= begin - ROUNDING) & (result.time <= end + ROUNDING))
    if not len(chosen):
        raise NotJudgedError(f"nothing was recorded between {begin:g} s and {end:g} s")
    return chosen


def since(result: Result, begin: float, reach: float) -> Rows:
    """Return the rows from the time `begin` [s] to the end of the run; raise NotExercisedError if
    the run ends before the time `reach` [s].
    """
    return between(result, begin, max(float(result.time[-1]), reach))


def final(result: Result, seconds: float, reach: float, before: float = 0.0) -> Rows:
    """Return the rows of the last `seconds` of a run, or of a span of equal length that ends
    `before` seconds earlier; raise NotExercisedError if the run ends before the time `reach` [s].
    """
    end = max(float(result.time[-1]), reach)
    between(result, -math.inf, end)
    return between(result, end - before - seconds, end - before)


def at(result: Result, time: float) -> int:
    """Return the index of the last row at or before a time [s]; raise NotExercisedError if the run
    ends earlier.
    """
    return int(between(result, -math.inf, time)[-1])


class RuleFinding(NamedTuple):
    """Outcome of a safety rule in a run. name: name of the rule; margin: least margin in the run;
    unit: unit of the margin; violated: time of the first violation [s] (NaN: none); text: meaning
    of the margin; limit: limit of the rule in words.
    """

    name: str
    margin: float
    unit: str
    violated: float
    text: str = ""
    limit: str = ""

    @property
    def verdict(self) -> Verdict:
        """Return HOLDS if the rule was never violated, else VIOLATED."""
        return Verdict.HOLDS if math.isnan(self.violated) else Verdict.VIOLATED

    @property
    def state(self) -> str:
        """Return the verdict as text, with the time of the first violation."""
        since = "" if math.isnan(self.violated) else f", first at {self.violated:.2f} s"
        return Kind.RULE.word(self.verdict) + since

    @property
    def outcome(self) -> Outcome:
        """Return the finding as an Outcome, from which the exit status follows."""
        return Outcome(Kind.RULE, self.name, self.verdict, f"{self.name}: {self.state}")


@dataclass(frozen=True)
class Row:
    """Comparison of a quantity with published reference values in one case: the largest difference
    at any time of the case, in `unit`.

    case: name of the case; tests: description of the tested code; source: name, place and licence
    of the reference values; tolerance: largest difference at which the values agree.
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
        """Return whether the values agree. A difference that is NaN does not agree."""
        return self.difference <= self.tolerance

    @property
    def verdict(self) -> str:
        """Return "agrees" or "DIFFERS"."""
        return "agrees" if self.within else "DIFFERS"


class Validation(NamedTuple):
    """Comparisons with published reference values. names: function that returns the names of all
    cases; answer: function that returns the comparisons (Row) of the cases with given names.
    """

    names: Callable[[], Sequence[str]]
    answer: Callable[[Sequence[str]], Sequence[Row]]
