# SPDX-License-Identifier: BSD-2-Clause
"""A result as others see it: variables with axes, of which netCDF, .mat and xarray are made; in a
notebook a table with units.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from html import escape
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
SHOWN = 400
"""Variables that a table in a notebook lists."""


def variables(
    table: Table | None,
) -> Iterator[tuple[str, tuple[str, ...], NDArray[np.float64], dict[str, str]]]:
    """Vectors with an axis, matrices with row and column, the rest as they are: name, axes, (rows,
    ...), attributes.
    """
    if table is None:
        return
    for name in table.names:
        values = table[name]
        about = {"units": table.unit(name), "long_name": table.description(name)}
        if name in table.vectors:
            given = [table.columns[i] for i in table.vectors[name].flat]
            if given != element_names(name, values.shape[1:]):
                about[ELEMENTS] = in_lines(given)
        yield name, _dimensions(values.shape[1:]), values, about


def labelled(
    table: Table,
) -> dict[str, tuple[tuple[str, ...], NDArray[np.float64], dict[str, str]]]:
    """Axes, values and attributes of the parameters, which have no time, and of the variables."""
    fixed = {name: (axes, x[0], about) for name, axes, x, about in variables(table.parameters)}
    return fixed | {name: (("time", *axes), x, about) for name, axes, x, about in variables(table)}


def _dimensions(shape: tuple[int, ...]) -> tuple[str, ...]:
    if len(shape) == 1:
        return (AXES.get(shape[0], f"axis_{shape[0]}"),)
    return tuple(f"{name}_{n}" for name, n in zip(("row", "column", "layer"), shape, strict=False))


def element_names(name: str, shape: tuple[int, ...]) -> list[str]:
    """Scalars of a variable of that shape, counted from 1."""
    return list(expand(name, np.empty(shape).tolist())) if shape else [name]


def in_lines(names: Iterable[str]) -> str:
    """Names in one text, a line each: a backslash begins a line break inside of a name."""
    return "\n".join(name.replace("\\", r"\\").replace("\n", r"\n") for name in names)


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


def as_page(table: Table) -> str:
    """A result in a notebook: what was flown, and a table of its variables."""
    flown = table.provenance.lines() if table.provenance is not None else []
    found = list(variables(table))
    rows = [_row("th", ("name", "shape", "unit", "first", "last", "meaning"))]
    rows += [_row("td", _cells(*each)) for each in found[:SHOWN]]
    more = f"<p>and {len(found) - SHOWN} more</p>" if len(found) > SHOWN else ""
    return (
        f"<p><b>{escape(table.summary)}</b></p><p>{'<br>'.join(map(escape, flown))}</p>"
        f"<details><summary>{len(found)} variables</summary>"
        f"<table>{''.join(rows)}</table>{more}</details>"
    )


def _row(tag: str, cells: Iterable[str]) -> str:
    return f"<tr>{''.join(f'<{tag}>{escape(cell)}</{tag}>' for cell in cells)}</tr>"


def _cells(name: str, _axes: Any, values: Any, about: dict[str, str]) -> tuple[str, ...]:
    shape = " x ".join(map(str, values.shape[1:])) or "scalar"
    ends = (_short(values[0]), _short(values[-1])) if len(values) else ("", "")
    return (name, shape, about["units"], *ends, about["long_name"])


def _short(value: Any) -> str:
    """A number, or a vector of up to four."""
    numbers = value.reshape(-1).tolist()
    shown = ", ".join(f"{number:.4g}" for number in numbers[:4])
    return f"[{shown}{', ...' if len(numbers) > 4 else ''}]" if value.ndim else shown
