# SPDX-License-Identifier: BSD-2-Clause
"""Numbers that a campaign keeps of every run: built-in measures, expressions, functions of the
user.

Expressions are those of harness.results.expressions, `norm(servicer.r_SN_N - target.r_TN_N)[-1]`. A
function is `FILE.py:NAME` and takes the Result.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any
from warnings import catch_warnings, simplefilter

import numpy as np

from harness.mission import Limits, Measure
from harness.mission.library import everything, of_result
from harness.results.evaluation import unit_in, unit_of
from harness.results.expressions import parsed
from harness.results.number import Number
from harness.results.requirements import condition, finding
from harness.results.result import Result
from harness.results.verdict import OPEN, Verdict

Metric = Number
"""What it gives is not to be trusted before value() has seen it."""


def metric(text: str, folder: Path) -> Metric:
    """The metric that a text stands for; ValueError if it makes no sense.

    folder: where files of functions are looked for.
    """
    if text in (known := _measures()):
        of = known[text]
        return Number(text, of.unit, of.needs, partial(_measured, of), of.parameters)
    if _is_function(text):
        file, _, name = text.rpartition(":")
        return Number(text, "", (), _function(folder / file, name))
    parsed(text, list(known), "measure")
    return Number(text, "", (), text)


def read(name: str, text: str, folder: Path) -> Metric:
    """The metric of a name: `success` is a requirement, true in every row, or a function."""
    if name != "success" or not is_condition(text):
        return metric(text, folder)
    condition(text)
    return Number(name, "", (), partial(_succeeded, text))


def is_condition(text: str) -> bool:
    """Whether a success is stated as a requirement, not as a function of a file."""
    return bool(text) and not _is_function(text)


def _is_function(text: str) -> bool:
    return text.rpartition(":")[0].endswith(".py")


def _succeeded(text: str, result: Result) -> bool:
    found = finding(result, "success", text)
    if found.verdict in OPEN:
        raise ValueError(found.reason)
    return found.verdict is Verdict.MET


def _measures() -> dict[str, Measure]:
    """Measures of the missions at hand by name."""
    return {m.name: m for m in reversed(everything().measures)}


def _measured(measure: Measure, result: Result) -> float:
    """A built-in measure with the limits that a comparison of this one run would have."""
    return measure(result, of_result(result).limits(Limits(), {"": result}))


def variables(text: str) -> Iterator[str]:
    """Variables that an expression names; none for a measure or a function."""
    if text in (known := _measures()) or _is_function(text):
        return
    names = parsed(text, list(known), "measure").variables
    yield from (name for name in names if name != "time" and not name.startswith("parameter "))


def unit(text: str, kinds: Result) -> str:
    """Unit of a metric, "" if it is not known; kinds: a result with the units of the variables."""
    if text in (known := _measures()):
        return known[text].unit
    if _is_function(text):
        return ""
    return unit_of(parsed(text), partial(unit_in, kinds))


def _function(file: Path, name: str) -> Callable[[Result], Any]:
    """A function of a file of the user."""
    if not file.is_file():
        raise ValueError(f"{file}: no such file")
    place = importlib.util.spec_from_file_location(file.stem, file)
    assert place is not None
    assert place.loader is not None
    module = importlib.util.module_from_spec(place)
    try:
        place.loader.exec_module(module)
    except Exception as error:
        raise ValueError(f"{file}: cannot be imported ({error})") from error
    if not callable(found := getattr(module, name, None)):
        raise ValueError(f"{file}: has no function {name}")
    return found  # type: ignore[no-any-return]


# ---- values


def measured(
    metrics: Mapping[str, Metric], result: Result
) -> tuple[dict[str, float], dict[str, str]]:
    """All metrics of a run, NaN where one does not exist for it, and why some do not."""
    values, reasons = {}, {}
    for name, each in metrics.items():
        values[name], reason = value(each, result)
        if reason:
            reasons[name] = reason
    return values, reasons


def value(each: Callable[[Result], Any], result: Result) -> tuple[float, str]:
    """A metric of a result, or NaN and what is wrong with it."""
    try:
        with np.errstate(all="ignore"), catch_warnings():
            simplefilter("ignore", RuntimeWarning)  # the mean of nothing
            return _number(each(result)), ""
    except Exception as error:  # a function of the user may raise whatever it likes
        plain = isinstance(error, KeyError | ValueError) and error.args
        text = str(error.args[0]) if plain else f"{type(error).__name__}: {error}"
        return math.nan, " ".join(text.split())[:200]


def _number(given: Any) -> float:
    if shape := np.shape(given):
        size = " x ".join(map(str, shape))
        raise ValueError(f"is an array of {size}, not one number; [-1] or max() picks one")
    if not isinstance(given, int | float | np.number | np.bool_ | np.ndarray):
        raise ValueError(f"is {given!r:.40}, not a number")
    return float(given)


def refusal(text: str, each: Metric, results: Sequence[Result], all_of_them: bool) -> str:
    """Why no run can have a metric, "" if one can, or if only a run can tell: a function.

    results: what runs leave, of every structure; all_of_them: every run must have it.
    """
    if _is_function(text):
        return ""
    found = [_lacking(each, result) or value(each, result)[1] for result in results]
    return next(filter(None, found), "") if all_of_them or all(found) else ""


def _lacking(each: Metric, result: Result) -> str:
    lacks = each.lacks(result)
    return f"the system has not got what it needs ({', '.join(lacks)})" if lacks else ""
