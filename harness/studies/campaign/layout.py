# SPDX-License-Identifier: BSD-2-Clause
"""Layout of the dataset of a campaign: its arrays with the CF attributes `units` and `long_name`,
and a check that the names of metrics, factors and variables can be names of arrays.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple
from unicodedata import normalize

import numpy as np

from harness.master.recorder import recorded
from harness.results.evaluation import unit_in
from harness.results.expressions import parsed
from harness.results.margins import unit_of_margin
from harness.results.result import Result
from harness.spelling import one_line
from harness.studies.campaign import metrics
from harness.studies.campaign.plan import SUCCESS, Plan, Table
from harness.studies.campaign.worker import PENDING, VERDICTS, Task

Labels = Mapping[str, Any]
"""Attributes of an array, by name of the attribute."""

STATUS: Labels = {
    "long_name": "status of the run",
    "flag_values": [0, 1, 2],
    "flag_meanings": "pending complete failed",
}
VERDICT: Labels = {
    "long_name": "verdict on a requirement",
    "flag_values": [*range(len(VERDICTS))],
    "flag_meanings": " ".join(v.name.lower() for v in VERDICTS),
}
MARGIN: Labels = {"long_name": "distance of a requirement to failing, negative where it fails"}
NUMBERS: Labels = {"units": "1", "long_name": "standard normal coordinates"}
TIME: Labels = {"units": "s", "long_name": "time"}
END: Labels = {"units": "s", "long_name": "time of the last row"}
EXPERIMENT = {
    "step": {"units": "s", "long_name": "macro step"},
    "stop": {"units": "s", "long_name": "stop time"},
}


def of_variable(name: str, kinds: Result | None) -> Labels:
    """Return unit and description of a variable as attributes of an array; {} if unknown.

    kinds: result that has the units and descriptions of the variables.
    """
    if kinds is None or name not in kinds:
        return {}
    return _known({"units": kinds.unit(name), "long_name": kinds.description(name)})


def _of_metric(name: str, task: Task) -> Labels:
    """Return the attributes of the array of a metric: the role "metric", the unit if known, and as
    long_name the text that defines the metric.
    """
    text = task.table.texts.get(name, "all requirements are met")
    unit = "1" if name == SUCCESS else metrics.unit(text, task.kinds)
    return {"role": "metric", **_known({"units": unit, "long_name": text})}


def _known(labels: Mapping[str, str]) -> Labels:
    return {name: text for name, text in labels.items() if text}


SCRATCH = "history_of_"
"""Prefix of the arrays of time series that are recorded only until their percentile bands are
computed.
"""
OWN = ("status", "message", "end_time", "last", "column", "column_units", "time", "percentile",
       "requirement", "requirement_text", "verdict", "margin", "margin_units",
       "numbers")  # fmt: skip
"""Names of arrays that a dataset can have in any campaign; a metric cannot have such a name."""
LONGEST = 200
"""Largest number of bytes of a name. An array is a folder, whose name may have a prefix, and file
systems limit names to 255 bytes.
"""


class Field(NamedTuple):
    """Array of a dataset, before the array is created.

    kind: type of the elements; axes: name of each dimension, the first of which is `run` if the
    array has an entry per run; fill: value of elements that are not written; about: attributes;
    values: initial content (None: filled later).
    """

    name: str
    kind: Any
    shape: tuple[int, ...]
    axes: tuple[str, ...]
    fill: Any = np.nan
    about: Mapping[str, Any] = {}
    values: Any = None


def fields(plan: Plan, task: Task) -> Iterator[Field]:
    """Yield all arrays of the dataset of a campaign, except for percentile bands and their axis
    `percentile`, which are created after the last run.
    """
    n, kinds, names = plan.runs, task.kinds, task.kinds.columns
    yield Field("status", np.int8, (n,), ("run",), PENDING, STATUS)
    yield Field("message", str, (n,), ("run",), "")
    yield Field("end_time", np.float64, (n,), ("run",), about=END)
    yield Field("last", np.float64, (n, len(names)), ("run", "column"))
    yield from _of_factors(plan, kinds)
    yield from _of_requirements(n, task)
    for name in task.metrics:
        yield Field(name, np.float64, (n,), ("run",), about=_of_metric(name, task))
    yield from _of_histories(n, task)
    if d := task.table.coordinates:
        yield Field("numbers", np.float64, (n, d), ("run", "number"), about=NUMBERS)
    yield _texts("column", names, "column")
    yield _texts("column_units", kinds.units, "column")


def _of_factors(plan: Plan, kinds: Result) -> Iterator[Field]:
    for name, value in plan.values(0).items():
        axes = tuple(f"{name}_{k + 1}" for k in range(np.ndim(value)))
        labels = EXPERIMENT.get(name) or of_variable(name, kinds.parameters)
        labels = labels or of_variable(name, kinds)
        about = {"role": "factor", "whole": plan.whole(name), **labels}
        kind, fill = (str, "") if isinstance(value, str) else (np.float64, np.nan)
        yield Field(name, kind, (plan.runs, *np.shape(value)), ("run", *axes), fill, about)


def _of_requirements(n: int, task: Task) -> Iterator[Field]:
    if given := task.requirements:
        shape, axes = (n, len(given)), ("run", "requirement")
        yield Field("verdict", np.int8, shape, axes, 0, VERDICT)
        yield Field("margin", np.float64, shape, axes, about=MARGIN)
        units = [
            unit_of_margin(parsed(text), partial(unit_in, task.kinds)) for text in given.values()
        ]
        yield _texts("margin_units", units, "requirement")
        yield _texts("requirement", [*given], "requirement")
        yield _texts("requirement_text", [*given.values()], "requirement")


def _of_histories(n: int, task: Task) -> Iterator[Field]:
    """Yield an array for the time series of each recorded variable, and one array with the times
    of their rows [s]; no array if nothing is recorded. n: number of runs.
    """
    for name in task.table.recorded:
        label = name if name in task.table.record.histories else SCRATCH + name
        width = task.kinds[name].reshape(1, -1).shape[1]
        about = {"role": "history", **of_variable(name, task.kinds)}
        axes, shape = ("run", "time", f"{name}_element"), (n, len(task.rows), width)
        yield Field(label, np.float64, shape, axes, about=about)
    if task.table.recorded:
        steps = recorded(task.steps, task.table.every)[task.rows]
        time = task.start + np.array(steps, dtype=np.float64) * task.step
        yield Field("time", np.float64, time.shape, ("time",), about=TIME, values=time)


def _texts(name: str, values: Sequence[str], axis: str) -> Field:
    array = np.array(values, dtype=object)
    return Field(name, str, array.shape, (axis,), "", values=array)


# ---- names


def wrong_names(table: Table) -> Iterator[str]:
    """Yield one line per metric, factor, seed or recorded variable whose name cannot be the name of
    an array, or would be the name of two different arrays.
    """
    varied, recorded = (*table.factors, *table.seeds), table.recorded
    alike = Counter(normalize("NFKC", name) for name in table.metrics)
    yield from (
        f"metrics.{name}: another metric has the same name in Unicode's normal form NFKC"
        for name in table.metrics
        if alike[normalize("NFKC", name)] > 1
    )
    yield from (
        f"seeds.{name}: is also in [factors] or twice in seeds; remove one of the entries"
        for name, n in Counter(varied).items()
        if n > 1
    )
    taken = {*OWN, "run", SUCCESS, *varied, *recorded}
    taken.update(label for name in recorded for label in (f"{name}_band", f"{SCRATCH}{name}"))
    for place, names in (("factors", varied), ("metrics", table.metrics), ("record", recorded)):
        for name in names:
            stem, _, end = name.rpartition("_")
            axis = stem in (*varied, *recorded) and (end == "element" or end.isdigit())
            if place == "metrics" and (name in taken or axis):
                yield (
                    f"metrics.{name}: the dataset has another array or axis of this name; choose "
                    "another name"
                )
            elif not _holds(name):
                rule = (
                    f"printable characters without / and \\, at most {LONGEST} bytes, not "
                    "beginning with __, and not one of ., .., zarr.json"
                )
                yield f"{place}.{one_line(name)}: cannot be the name of an array: expected {rule}"


def _holds(name: str) -> bool:
    """Return whether a name can be the name of an array, which is a folder in the dataset."""
    strange = {"", ".", "..", "zarr.json"} & {name} or name.startswith("__")
    letters = name.isprintable() and not {"/", "\\"} & {*name}
    return letters and not strange and len(name.encode()) <= LONGEST
