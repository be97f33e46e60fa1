# SPDX-License-Identifier: BSD-2-Clause
"""Metrics that a campaign records for every run. The text of a metric is the name of a built-in
metric of a mission, an expression, or a function of the user.

An expression is written like `last(norm(servicer.r_SN_N))`, see harness.results.expressions. A
function is written as `FILE.py:NAME`; it takes the Result of a run and returns a number.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache, partial
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np

from harness.errors import HarnessError
from harness.mission import Limits, Metric
from harness.mission.claim import BaseMetric, one_number
from harness.mission.library import everything, mission, of_result, places
from harness.results.evaluation import unit_in, unit_of
from harness.results.expressions import Node, parsed
from harness.results.requirements import condition, finding
from harness.results.result import Result
from harness.results.verdict import OPEN, Verdict


def metric(text: str, folder: Path) -> BaseMetric:
    """Return the metric that a text defines; raise ValueError if the text defines none.

    folder: folder in which the Python file of a user's function is searched.
    """
    if offered := offering(text):
        return offered[1]
    if file_of(text):
        file, _, name = text.rpartition(":")
        return BaseMetric(text, "", (), _function(folder / file, name))
    _expression(text)
    return BaseMetric(text, "", (), text)


def read(name: str, text: str, folder: Path) -> BaseMetric:
    """Return the metric `name`, which a text defines. If the name is `success` and the text is a
    requirement, the metric is 1 if the requirement is met and 0 if not; it raises ValueError for a
    run in which the requirement is not exercised or cannot be evaluated.

    folder: folder in which the Python file of a user's function is searched.
    """
    if name != "success" or not is_condition(text):
        return metric(text, folder)
    condition(text)
    return BaseMetric(name, "", (), partial(_succeeded, text))


def is_condition(text: str) -> bool:
    """Return whether the text of `success` is a requirement, not a function of the user."""
    return bool(text) and not file_of(text)


def file_of(text: str) -> str:
    """Return the file in the text `FILE.py:NAME` of a user's function, "" for any other metric."""
    file = text.rpartition(":")[0]
    return file if file.endswith(".py") else ""


def _succeeded(text: str, result: Result) -> bool:
    """Return whether a run meets a requirement; raise ValueError if it has no verdict."""
    found = finding(result, "success", text)
    if found.verdict in OPEN:
        raise ValueError(found.reason)
    return found.verdict is Verdict.MET


def offering(text: str) -> tuple[str, Metric] | None:
    """Return the name of a mission and its built-in metric with the name `text`; None if the text
    is an expression, a function, or no known name. Missions are imported one by one until one has
    the metric.
    """
    if file_of(text) or is_expression(text):
        return None
    offered = ((name, m) for name in places() if (own := mission(name)) for m in own.metrics)
    return next((each for each in offered if each[1].name == text), None)


@lru_cache(maxsize=256)
def is_expression(text: str) -> bool:
    """Return whether the text of a metric is an expression, not the name of a built-in metric."""
    try:
        return bool(parsed(text))
    except ValueError:
        return False


def _expression(text: str) -> Node:
    """Return the syntax tree of an expression; raise ValueError if the text is none, with the names
    of built-in metrics that are spelled similarly.
    """
    if is_expression(text):
        return parsed(text)
    return parsed(text, [m.name for m in everything().metrics], "metric")


def variables(text: str) -> tuple[str, ...]:
    """Return the variables that an expression names; () for a built-in metric or a function of the
    user.
    """
    return () if offering(text) or file_of(text) else _expression(text).outputs


def unit(text: str, kinds: Result) -> str:
    """Return the unit of a metric, "" if it is unknown; kinds: result that has the units of all
    variables.
    """
    if offered := offering(text):
        return offered[1].unit
    if file_of(text):
        return ""
    return unit_of(parsed(text), partial(unit_in, kinds))


def _function(file: Path, name: str) -> Callable[[Result], Any]:
    """Return the function `name` of a Python file of the user; raise ValueError if the file cannot
    be imported or has no such function.
    """
    if not file.is_file():
        raise ValueError(f"{file}: no such file")
    place = importlib.util.spec_from_file_location(file.stem, file)
    assert place is not None
    assert place.loader is not None
    module = importlib.util.module_from_spec(place)
    try:
        place.loader.exec_module(module)
    except (Exception, SystemExit) as error:
        raise ValueError(f"{file}: cannot be imported ({error})") from error
    if not callable(found := getattr(module, name, None)):
        raise ValueError(f"{file}: has no function {name}")
    return found  # type: ignore[no-any-return]


# ---- values


def measured(
    metrics: Mapping[str, BaseMetric], result: Result
) -> tuple[dict[str, float], dict[str, str]]:
    """Return the values of all metrics of a run by name, NaN for a metric without a value, and by
    name the reason for each metric that raises an error. A computed NaN has no reason.
    """
    values, reasons, limits = {}, {}, cache(partial(_limits, result))
    for name, each in metrics.items():
        values[name], reason = value(each, result, limits)
        if reason:
            reasons[name] = reason
    return values, reasons


def _limits(result: Result) -> Limits:
    """Return the position and attitude errors within which the mission of a run counts an error as
    settled.
    """
    return of_result(result).limits(Limits(), {"": result})


def value(
    each: Callable[..., Any], result: Result, limits: Callable[[], Limits] | None = None
) -> tuple[float, str]:
    """Return the value of a metric in a result and "", or NaN and the reason why it has no value.

    each: function of the metric; limits: function that returns the errors within which a
    built-in metric counts an error as settled (None: use _limits()).
    """
    try:
        with np.errstate(all="ignore"), catch_warnings():
            simplefilter("ignore", RuntimeWarning)  # numpy warns if there is no value to average
            given = (limits() if limits else _limits(result),) if isinstance(each, Metric) else ()
            return one_number(each(result, *given)), ""
    except (Exception, SystemExit) as error:  # a user's function may raise anything
        plain = isinstance(error, KeyError | ValueError | HarnessError) and error.args
        text = str(error.args[0]) if plain else f"{type(error).__name__}: {error}"
        return math.nan, " ".join(text.split())[:200]


def rejection(text: str, each: BaseMetric, results: Sequence[Result], all_of_them: bool) -> str:
    """Return the reason why a metric can have no value in a campaign, "" if it can have one. A
    function of the user is not checked, because only a run can check it.

    results: one result with arbitrary values per structure (combination of FMUs and options);
    all_of_them: reject a metric that lacks a value in any structure, not only one that lacks it in
    all structures.
    """
    if file_of(text):
        return ""
    found = [_lacking(each, result) or value(each, result)[1] for result in results]
    return next(filter(None, found), "") if all_of_them or all(found) else ""


def _lacking(each: BaseMetric, result: Result) -> str:
    """Return a text with the variables that a metric needs and a result lacks, "" if none."""
    lacks = each.lacks(result)
    return f"the system lacks what the metric needs: {', '.join(lacks)}" if lacks else ""
