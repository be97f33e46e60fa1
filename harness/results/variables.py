# SPDX-License-Identifier: BSD-2-Clause
"""The flat columns of a result as variables with axes: what netCDF, xarray and .mat make of it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.results.provenance import flat
from harness.system.values import expand

Table = Any
"""A Result, which knows this module."""

ELEMENTS = "elements"
"""Attribute with the names of the elements of a vector where they are not counted from 1."""

PROVENANCE = "provenance_"
"""Begin of the attributes that say where a result comes from."""

AXES = {3: "axis"}
"""Name of the second dimension of a vector by its length; other lengths n are called axis_n."""


def variables(
    table: Table | None,
) -> Iterator[tuple[str, tuple[str, ...], NDArray[np.float64], dict[str, str]]]:
    """Vectors with an axis, matrices with row and column, the rest as they are: name, axes, (rows,
    ...), attributes.
    """
    if table is None:
        return
    whole = {column for columns in table.vectors.values() for column in columns.flat}
    single = [name for i, name in enumerate(table.columns) if i not in whole]
    for name in (*table.vectors, *single):
        values = table[name]
        about = {"units": table.unit(name), "long_name": table.description(name)}
        if name in table.vectors:
            given = [table.columns[i] for i in table.vectors[name].flat]
            if given != element_names(name, values.shape[1:]):
                about[ELEMENTS] = in_lines(given)
        yield name, _dimensions(values.shape[1:]), values, about


def _dimensions(shape: tuple[int, ...]) -> tuple[str, ...]:
    if len(shape) == 1:
        return (AXES.get(shape[0], f"axis_{shape[0]}"),)
    return tuple(f"{name}_{n}" for name, n in zip(("row", "column", "layer"), shape, strict=False))


def element_names(name: str, shape: tuple[int, ...]) -> list[str]:
    """Scalars of a variable of that shape, counted from 1."""
    return list(expand(name, np.empty(shape).tolist())) if shape else [name]


def in_lines(names: Iterable[str]) -> str:
    """Names in one text, a line each, and from_lines() has them again: a backslash begins a line
    break inside of a name.
    """
    return "\n".join(name.replace("\\", r"\\").replace("\n", r"\n") for name in names)


def from_lines(text: str) -> list[str]:
    """The inverse of in_lines()."""
    return [_ESCAPED.sub(lambda m: _MEANT[m[0]], line) for line in text.split("\n")]


_MEANT = {r"\\": "\\", r"\n": "\n"}
_ESCAPED = re.compile(r"\\[\\n]")


def time_labels(table: Table) -> dict[str, str]:
    """CF attributes of the time."""
    units = "s" if table.provenance is None else table.provenance.time_units
    dated = {} if units == "s" else {"calendar": "proleptic_gregorian"}
    return {"units": units, "long_name": "time", **dated}


def attributes(table: Table) -> dict[str, Any]:
    """What is said of a whole result."""
    origin = {} if table.provenance is None else flat(table.provenance)
    return {
        "system": table.system,
        "message": table.message,
        "complete": int(table.complete),
        **{PROVENANCE + name: value for name, value in origin.items()},
    }
