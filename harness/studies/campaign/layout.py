# SPDX-License-Identifier: BSD-2-Clause
"""Which arrays the dataset of a campaign has, their CF attributes `units` and `long_name`, and
which names it can hold.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from harness.results.evaluation import unit_in
from harness.results.expressions import parsed
from harness.results.margins import unit_of_margin
from harness.results.result import Result
from harness.studies.campaign import metrics
from harness.studies.campaign.plan import Layout, Plan
from harness.studies.campaign.worker import PENDING, SUCCESS, VERDICTS, Task, metrics_of

Labels = Mapping[str, Any]

STATUS: Labels = {
    "long_name": "what became of the run",
    "flag_values": [0, 1, 2],
    "flag_meanings": "pending complete failed",
}
VERDICT: Labels = {
    "long_name": "what became of a requirement",
    "flag_values": [*range(len(VERDICTS))],
    "flag_meanings": " ".join(v.name.lower() for v in VERDICTS),
}
MARGIN: Labels = {"long_name": "distance of a requirement to failing, negative where it fails"}
NUMBERS: Labels = {"units": "1", "long_name": "independent normal numbers that were asked for"}
GENERATION: Labels = {"long_name": "generation of flights that were asked for together"}
TIME: Labels = {"units": "s", "long_name": "time"}
END: Labels = {"units": "s", "long_name": "time of the last row"}
EXPERIMENT = {
    "step": {"units": "s", "long_name": "macro step"},
    "stop": {"units": "s", "long_name": "stop time"},
}


def of_factor(name: str, kinds: Result) -> Labels:
    """Those of a parameter or start value; kinds: what names, units and texts are taken from."""
    if name in EXPERIMENT:
        return EXPERIMENT[name]
    if kinds.parameters is not None and name in kinds.parameters:
        return of_variable(name, kinds.parameters)
    return of_variable(name, kinds)


def of_variable(name: str, kinds: Result) -> Labels:
    """Those of a variable of a result, none if it has no such variable."""
    if name not in kinds:
        return {}
    return _known({"units": kinds.unit(name), "long_name": kinds.description(name)})


def of_metric(name: str, plan: Plan, kinds: Result) -> Labels:
    """The unit that follows from its text, and the text itself."""
    if name == "success":
        return {"units": "1", "long_name": plan.success or "all requirements are met"}
    text = str(plan.definition["metrics"][name])
    return _known({"units": metrics.unit(text, kinds), "long_name": text})


def of_margin(text: str, kinds: Result) -> str:
    """Unit of the margin of a requirement, "" if it is not known."""
    return unit_of_margin(parsed(text), partial(unit_in, kinds))


def _known(labels: Mapping[str, str]) -> Labels:
    return {name: text for name, text in labels.items() if text}


SCRATCH = "history_of_"
"""Histories that are kept only until their bands are known."""
OWN = ("status", "message", "end_time", "last", "column", "column_units", "time", "percentile",
       "requirement", "requirement_text", "verdict", "margin", "margin_units", "numbers",
       "generation")  # fmt: skip
"""Arrays that every dataset may have."""
LONGEST = 200
"""Bytes of a name: every array is a folder, and a history has a prefix."""


class Field(NamedTuple):
    """One array: its axes by name, the first one `run` if it has a value per run; values: what it
    holds from the start.
    """

    name: str
    kind: Any
    shape: tuple[int, ...]
    axes: tuple[str, ...]
    fill: Any = np.nan
    about: Mapping[str, Any] = {}
    values: Any = None


def fields(plan: Plan, task: Task, found: Layout) -> Iterator[Field]:
    """All arrays of a campaign, those of every run first; its bands come at the end."""
    n, kinds = plan.runs, found.kinds
    yield Field("status", np.int8, (n,), ("run",), PENDING, STATUS)
    yield Field("message", str, (n,), ("run",), "")
    yield Field("end_time", np.float64, (n,), ("run",), about=END)
    yield Field("last", np.float64, (n, len(task.columns)), ("run", "column"))
    for name, value in plan.values(0).items():
        axes = tuple(f"{name}_{k + 1}" for k in range(np.ndim(value)))
        about = {"role": "factor", "whole": plan.whole(name), **of_factor(name, kinds)}
        kind, fill = (str, "") if isinstance(value, str) else (np.float64, np.nan)
        yield Field(name, kind, (n, *np.shape(value)), ("run", *axes), fill, about)
    yield from _of_requirements(n, task.requirements, kinds)
    for name in metrics_of(task):
        about = {"role": "metric", **of_metric(name, plan, kinds)}
        yield Field(name, np.float64, (n,), ("run",), about=about)
    yield from _of_histories(plan, task, found)
    if plan.asked:
        axes = ("run", "number")
        yield Field("numbers", np.float64, (n, plan.asked), axes, about=NUMBERS)
        yield Field("generation", np.int32, (n,), ("run",), 0, GENERATION)
    yield _texts("column", task.columns, "column")
    yield _texts("column_units", kinds.units, "column")


def _of_requirements(n: int, given: Mapping[str, str], kinds: Result) -> Iterator[Field]:
    if given:
        shape, axes = (n, len(given)), ("run", "requirement")
        yield Field("verdict", np.int8, shape, axes, 0, VERDICT)
        yield Field("margin", np.float64, shape, axes, about=MARGIN)
        units = [of_margin(text, kinds) for text in given.values()]
        yield _texts("margin_units", units, "requirement")
        yield _texts("requirement", [*given], "requirement")
        yield _texts("requirement_text", [*given.values()], "requirement")


def _of_histories(plan: Plan, task: Task, found: Layout) -> Iterator[Field]:
    """What is kept of the histories, and their time."""
    for name in task.kept:
        label = name if name in plan.keep.get("histories", ()) else SCRATCH + name
        width = len([c for c in task.columns if c == name or c.startswith(f"{name}[")])
        about = {"role": "history", **of_variable(name, found.kinds)}
        axes, shape = ("run", "time", f"{name}_element"), (plan.runs, len(task.rows), width)
        yield Field(label, np.float64, shape, axes, about=about)
    if task.kept:
        time = found.start + np.array(task.steps, dtype=np.float64) * found.step
        yield Field("time", np.float64, time.shape, ("time",), about=TIME, values=time)


def _texts(name: str, values: Sequence[str], axis: str) -> Field:
    array = np.array(values, dtype=object)
    return Field(name, str, array.shape, (axis,), "", values=array)


# ---- names


def wrong_names(
    metrics: Iterable[str], factors: Sequence[str], seeds: Sequence[str], keep: Mapping[str, Any]
) -> Iterator[str]:
    """Metrics, factors and variables that the dataset cannot hold under their names, and what has
    two meanings, a line each.
    """
    twice = [name for name, count in Counter(seeds).items() if count > 1]
    yield from (f"seeds.{name}: is given twice" for name in twice)
    yield from (
        f"seeds.{name}: is a factor too" for name in dict.fromkeys(seeds) if name in factors
    )
    kept = [str(name) for key in ("histories", "bands") for name in keep.get(key, ())]
    taken = {
        **dict.fromkeys((*OWN, "run", SUCCESS), "a name of the dataset itself"),
        **{label: "a recorded history or band" for name in kept for label in _labels(name)},
        **dict.fromkeys((*factors, *seeds), "a factor"),
    }
    for name in metrics:
        if problem := _wrong(name):
            yield f"metrics.{name if name.isprintable() else repr(name)}: {problem}"
        elif name in taken:
            yield f"metrics.{name}: cannot have this name, it is {taken[name]}"
        elif _is_axis(name, (*factors, *kept)):
            yield f"metrics.{name}: cannot have this name, it is an axis of the dataset"
    for place, names in (("factors", factors), ("seeds", seeds), ("keep", kept)):
        yield from (f"{place}.{name}: {problem}" for name in names if (problem := _wrong(name)))


def _labels(name: str) -> tuple[str, ...]:
    return name, f"{name}_band", f"{SCRATCH}{name}"


def _is_axis(name: str, others: Iterable[str]) -> bool:
    stem, _, end = name.rpartition("_")
    return stem in others and (end == "element" or end.isdigit())


def _wrong(name: str) -> str:
    """Why no array can have a name, "" if one can: every array is a folder, / leads into it."""
    if not name or name in (".", "..", "zarr.json"):
        return "a dataset cannot hold an array of this name"
    if bad := sorted({c for c in name if c in "/\\" or not c.isprintable()}):
        return f"a dataset cannot hold names with {' '.join(map(repr, bad))}"
    if name.startswith("__"):
        return "a dataset cannot hold names that begin with __"
    if len(name.encode()) > LONGEST:
        return f"a dataset cannot hold names of more than {LONGEST} bytes"
    return ""
