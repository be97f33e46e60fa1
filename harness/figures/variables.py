# SPDX-License-Identifier: BSD-2-Clause
"""A figure of any variables of a result: a panel for each, the elements of a vector in one, units
on the axes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from harness.errors import UsageError
from harness.mission.figure import AXES, Array, Curve, Figure, Panel
from harness.results.result import Result
from harness.spelling import did_you_mean, file_stem


def figure_of(result: Result, names: Sequence[str]) -> Figure:
    """One figure of these variables: `component.variable`, one element, or the part of a name in
    front of a point for all below it. Raises UsageError with close matches.
    """
    found = list(dict.fromkeys(v for name in names for v in _expanded(result, name)))
    about = result.description(found[0]) if len(found) == 1 else ""
    title = f"{result.system}: {about}" if about else result.system
    stem = file_stem("_".join(name.rstrip("]") for name in names))
    return Figure(stem, title, tuple(_panel(result, v) for v in found))


def _expanded(result: Result, name: str) -> Iterator[str]:
    """The variable of that name, or all below it."""
    below = [v for v in result.vectors if v.startswith(f"{name}.")]
    if name in result:
        yield name
    elif below:
        yield from below
    elif result.holds(parameters=(name,)):
        value = np.array2string(result.parameter(name), separator=", ")
        raise UsageError(f"--var {name}: a parameter, which has no history; it is {value}")
    else:
        close = did_you_mean(name, dict.fromkeys((*result.vectors, *result.columns)))
        raise UsageError(f"--var {name}: the result has no such variable{close}")


def _panel(result: Result, name: str) -> Panel:
    unit = result.unit(name).replace(".", " ")
    label = f"{name} [{unit}]" if unit not in ("", "1") else name
    return Panel(label, (Curve(name, convert=_flat, labels=_labels(result, name)),))


def _flat(history: Array) -> Array:
    """Matrices as the rows of their elements."""
    return history if history.ndim == 1 else history.reshape(len(history), -1)


def _labels(result: Result, name: str) -> tuple[str, ...]:
    """Elements of a vector in space by axis, others by index."""
    if name not in result.vectors or result.vectors[name].shape == (3,):
        return AXES
    columns = (result.columns[i] for i in result.vectors[name].flat)
    return tuple(column.removeprefix(name).strip("[]") for column in columns)
