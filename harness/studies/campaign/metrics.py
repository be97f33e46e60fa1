# SPDX-License-Identifier: BSD-2-Clause
"""Numbers that a campaign keeps of every run: built-in measures, expressions, functions of the
user.

Expressions are those of harness.results.expressions, `norm(servicer.r_SN_N - target.r_TN_N)[-1]`. A
function is `FILE.py:NAME` and takes the Result.
"""

from __future__ import annotations

import ast
import importlib.util
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path

from harness.mission import Limits, Measure
from harness.mission.library import everything, of_result
from harness.results.evaluation import evaluate, history, resolved, unit_in, unit_of
from harness.results.expressions import parsed
from harness.results.expressions import variables as named
from harness.results.result import Result

Metric = Callable[[Result], float]


def metric(text: str, folder: Path) -> Metric:
    """The metric that a text stands for; ValueError if it makes no sense.

    folder: where files of functions are looked for.
    """
    if text in (known := _measures()):
        return partial(_measured, known[text])
    file, colon, name = text.rpartition(":")
    if colon and file.endswith(".py"):
        return _function(folder / file, name)
    tree = parsed(text, list(known), "measure")
    return partial(_evaluated, tree)


def _measures() -> dict[str, Measure]:
    """Measures of the missions at hand by name."""
    return {m.name: m for m in reversed(everything().measures)}


def _evaluated(tree: ast.expr, result: Result) -> float:
    plain = resolved(tree, partial(unit_in, result))
    return float(evaluate(plain, partial(history, result)))


def _measured(measure: Measure, result: Result) -> float:
    """A built-in measure with the limits that a comparison of this one run would have."""
    return measure(result, of_result(result).limits(Limits(), {"": result}))


def variables(text: str) -> Iterator[str]:
    """Variables that an expression names; none for a measure or a function."""
    if text in (known := _measures()) or text.rpartition(":")[0].endswith(".py"):
        return
    names = named(parsed(text, list(known), "measure"))
    yield from (name for name in names if name != "time" and not name.startswith("parameter "))


def unit(text: str, kinds: Result) -> str:
    """Unit of a metric, "" if it is not known; kinds: a result with the units of the variables."""
    if text in (known := _measures()):
        return known[text].unit
    if text.rpartition(":")[0].endswith(".py"):
        return ""
    return unit_of(parsed(text), partial(unit_in, kinds))


def _function(file: Path, name: str) -> Metric:
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


def measured(metrics: Mapping[str, Metric], result: Result) -> dict[str, float]:
    """All metrics of a run; NaN where one does not exist for it."""
    values = {}
    for name, each in metrics.items():
        try:
            values[name] = float(each(result))
        except (KeyError, ValueError, IndexError, ZeroDivisionError, TypeError, OverflowError):
            values[name] = float("nan")
    return values
