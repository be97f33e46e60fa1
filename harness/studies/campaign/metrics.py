# SPDX-License-Identifier: BSD-2-Clause
"""Metrics that a campaign records for every run: built-in metrics, expressions, functions of the
user.

Expressions follow harness.results.expressions, `last(norm(servicer.r_SN_N))`. A function is
`FILE.py:NAME` and takes the Result.
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
    """Return the metric that a text defines; raise ValueError if there is none.

    folder: folder of the files with functions.
    """
    if offered := offering(text):
        return offered[1]
    if file_of(text):
        file, _, name = text.rpartition(":")
        return BaseMetric(text, "", (), _function(folder / file, name))
    _expression(text)
    return BaseMetric(text, "", (), text)


def read(name: str, text: str, folder: Path) -> BaseMetric:
    """Return a named metric. `success` is a requirement, true in every row, or a function."""
    if name != "success" or not is_condition(text):
        return metric(text, folder)
    condition(text)
    return BaseMetric(name, "", (), partial(_succeeded, text))


def is_condition(text: str) -> bool:
    """Return whether a success is stated as a requirement, not as a function of a file."""
    return bool(text) and not file_of(text)


def file_of(text: str) -> str:
    """Return the file of a function, "" of any other metric."""
    file = text.rpartition(":")[0]
    return file if file.endswith(".py") else ""


def _succeeded(text: str, result: Result) -> bool:
    found = finding(result, "success", text)
    if found.verdict in OPEN:
        raise ValueError(found.reason)
    return found.verdict is Verdict.MET


def offering(text: str) -> tuple[str, Metric] | None:
    """Return the first available mission that has a built-in metric of this name, and the metric;
    None for an expression and a function. Only missions up to that one are imported.
    """
    if file_of(text) or is_expression(text):
        return None
    offered = ((name, m) for name in places() if (own := mission(name)) for m in own.metrics)
    return next((each for each in offered if each[1].name == text), None)


@lru_cache(maxsize=256)
def is_expression(text: str) -> bool:
    """Return whether a text is an expression, which the name of a built-in metric is not."""
    try:
        return bool(parsed(text))
    except ValueError:
        return False


def _expression(text: str) -> Node:
    """Return the tree of an expression; raise ValueError with close names of metrics."""
    if is_expression(text):
        return parsed(text)
    return parsed(text, [m.name for m in everything().metrics], "metric")


def variables(text: str) -> tuple[str, ...]:
    """Return the variables that an expression names; none for a built-in metric or a function."""
    return () if offering(text) or file_of(text) else _expression(text).outputs


def unit(text: str, kinds: Result) -> str:
    """Return the unit of a metric, "" if it is unknown; kinds: a result with the units of the
    variables.
    """
    if offered := offering(text):
        return offered[1].unit
    if file_of(text):
        return ""
    return unit_of(parsed(text), partial(unit_in, kinds))


def _function(file: Path, name: str) -> Callable[[Result], Any]:
    """Return a function of a file of the user."""
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
    """Return all metrics of a run, NaN for one that does not exist, and the reasons by name."""
    values, reasons, limits = {}, {}, cache(partial(_limits, result))
    for name, each in metrics.items():
        values[name], reason = value(each, result, limits)
        if reason:
            reasons[name] = reason
    return values, reasons


def _limits(result: Result) -> Limits:
    """Return the limits of a comparison of this one run."""
    return of_result(result).limits(Limits(), {"": result})


def value(
    each: Callable[..., Any], result: Result, limits: Callable[[], Limits] | None = None
) -> tuple[float, str]:
    """Return a metric of a result, or NaN and the reason; limits: of a built-in metric."""
    try:
        with np.errstate(all="ignore"), catch_warnings():
            simplefilter("ignore", RuntimeWarning)  # numpy warns of the mean of no values
            given = (limits() if limits else _limits(result),) if isinstance(each, Metric) else ()
            return one_number(each(result, *given)), ""
    except (Exception, SystemExit) as error:  # of a function of the user
        plain = isinstance(error, KeyError | ValueError | HarnessError) and error.args
        text = str(error.args[0]) if plain else f"{type(error).__name__}: {error}"
        return math.nan, " ".join(text.split())[:200]


def rejection(text: str, each: BaseMetric, results: Sequence[Result], all_of_them: bool) -> str:
    """Return why no run can have a metric; "" if a run can have it, and for a function, which only
    a run can check.

    results: results of every structure; all_of_them: every run must have the metric.
    """
    if file_of(text):
        return ""
    found = [_lacking(each, result) or value(each, result)[1] for result in results]
    return next(filter(None, found), "") if all_of_them or all(found) else ""


def _lacking(each: BaseMetric, result: Result) -> str:
    lacks = each.lacks(result)
    return f"the system lacks what the metric needs: {', '.join(lacks)}" if lacks else ""
