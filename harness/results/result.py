# SPDX-License-Identifier: BSD-2-Clause
"""Result of a run: a table of recorded rows with names and units, access to its vectors and
matrices by name, and its forms for other tools.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from html import escape
from importlib.util import find_spec
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from harness.results.provenance import Provenance, flat
from harness.spelling import did_you_mean
from harness.system.graph import Graph, columns, constants
from harness.system.values import base, expand, grid, index

Array = NDArray[np.float64]
"""Array of doubles; a time series has the shape (rows,) or (rows, n)."""
Rows = NDArray[np.intp]
"""Indices of rows of a time series."""


@dataclass(frozen=True, repr=False, eq=False)
class Result:
    """Recorded rows of a run, with parameters and provenance.

    time: (rows,) [s]; columns: names `component.variable[i]`; units, descriptions: one text per
    column ("" if unknown); values: (rows, columns), read-only like time; complete: False if the run
    ended early, `message` then contains the reason; parameters: all parameters of all components
    with their values in the run, a table of one row (None if unknown); provenance: the system, its
    files and changes (None if unknown); modes: one text per column, the names of the values 0, 1,
    .. if the variable is a mode, as "far|hold 1|closing", else "".
    """

    system: str
    time: Array
    columns: tuple[str, ...]
    units: tuple[str, ...]
    values: Array
    descriptions: tuple[str, ...] = ()
    complete: bool = True
    message: str = ""
    parameters: Result | None = None
    provenance: Provenance | None = None
    modes: tuple[str, ...] = ()

    plot: ClassVar[Callable[..., Any]]
    save: ClassVar[Callable[..., Any]]
    report: ClassVar[Callable[..., Any]]

    def __post_init__(self) -> None:
        """Make the recorded rows read-only."""
        for name in ("time", "values"):
            array = getattr(self, name).view()
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def parameter(self, name: str) -> Array:
        """Return the value of a parameter: (), (n,) for a vector, (m, n) for a matrix; raise
        KeyError with close matches.
        """
        if self.parameters is None:
            raise KeyError(f"{name}: the result does not hold the parameters of the run")
        return np.asarray(self.parameters[name][0])

    def __getitem__(self, name: str) -> Array:
        """Return the time series of a variable: (rows,) for a scalar or an element, (rows, n) for a
        vector, (rows, m, n) for a matrix.

        Raises KeyError with close matches.
        """
        if name in self._column:
            return self.values[:, self._column[name]]
        if name not in self.vectors:
            raise KeyError(f"{name}{did_you_mean(name, [*self.vectors, *self.columns])}")
        columns = self.vectors[name]
        flat = columns.reshape(-1)
        consecutive = bool((np.diff(flat) == 1).all())  # a slice needs no copy
        values = self.values[:, flat[0] : flat[-1] + 1] if consecutive else self.values[:, flat]
        return values.reshape(len(self.time), *columns.shape)

    def __contains__(self, name: str) -> bool:
        return name in self._column or name in self.vectors

    def holds(self, *names: str, parameters: Iterable[str] = ()) -> bool:
        """Return whether the result has all these variables, and all these parameters
        of the run.
        """
        known: Result | tuple[()] = () if self.parameters is None else self.parameters
        return all(name in self for name in names) and all(name in known for name in parameters)

    def unit(self, name: str) -> str:
        """Return the unit of a scalar, element, vector or matrix; "" if unknown."""
        return self.units[self._first(name)]

    def description(self, name: str) -> str:
        """Return the description of a variable; "" if unknown."""
        return self.descriptions[self._first(name)] if self.descriptions else ""

    def mode_names(self, name: str) -> tuple[str, ...]:
        """Return the names of the values 0, 1, .. of a variable whose values have names (a mode),
        with "" for a number without a name; () for other variables.
        """
        names = self.modes[self._first(name)] if self.modes else ""
        return tuple(names.split("|")) if names else ()

    def mode(self, name: str, value: float) -> str:
        """Return the name of a value of a mode, or the value as text if it has no name."""
        names = self.mode_names(name)
        known = value in range(len(names)) and names[int(value)]
        return known or f"{value:g}"

    def _first(self, name: str) -> int:
        return self._column[name] if name in self._column else int(self.vectors[name].flat[0])

    @cached_property
    def _column(self) -> Mapping[str, int]:
        return {name: i for i, name in enumerate(self.columns)}

    @cached_property
    def vectors(self) -> Mapping[str, NDArray[np.intp]]:
        """Return the indices of the columns of every variable, by its name without indices, in an
        array of the shape of the variable.
        """
        return _vectors(tuple(self.columns))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Return the names of all scalars, vectors and matrices, and then of the columns that
        belong to no complete vector or matrix.
        """
        whole = {column for columns in self.vectors.values() for column in columns.flat}
        return (*self.vectors, *(n for i, n in enumerate(self.columns) if i not in whole))

    # ---- views

    def __repr__(self) -> str:
        return f"<Result {self.summary}>"

    @property
    def summary(self) -> str:
        """Return system, time span, size and state in one line."""
        span = f"{self.time[0]:g} to {self.time[-1]:g} s" if len(self.time) else "nothing recorded"
        state = "" if self.complete else f", incomplete: {self.message or 'the run ended early'}"
        return f"{self.system}: {span}, {len(self.time)} rows, {len(self.columns)} columns{state}"

    def _repr_html_(self) -> str | None:
        """Return HTML for a notebook: settings of the run, and the dataset as xarray shows it; None
        without xarray.
        """
        if find_spec("xarray") is None:
            return None
        settings = self.provenance.lines() if self.provenance is not None else []
        lines = "<br>".join(map(escape, [self.summary, *settings]))
        return f"<p>{lines}</p>{self.to_xarray()._repr_html_()}"

    def to_xarray(self) -> Any:
        """Return the result as an xarray.Dataset, as xarray.open_dataset() reads it from a .nc:
        vectors with an axis, parameters without time, units as attributes.
        """
        import xarray

        time = ("time", self.time, time_labels(self))
        found = xarray.Dataset(labelled(self), coords={"time": time}, attrs=attributes(self))
        return xarray.decode_cf(found)

    def to_dataframe(self) -> Any:
        """Return the result as a pandas.DataFrame: a column per scalar, time [s] as index; `attrs`
        contains system and units by column.
        """
        import pandas as pd

        frame = pd.DataFrame(
            self.values, index=pd.Index(self.time, name="time"), columns=list(self.columns)
        )
        units = dict(zip(self.columns, self.units, strict=True))
        frame.attrs = {"system": self.system, "units": units}
        return frame


def parameters_of(system: str, graph: Graph, start: float = 0.0) -> Result:
    """Return all parameters of a system as a table of one row, at the time `start` [s]."""
    given = list(constants(graph))
    names, units, texts, modes = columns([slot for slot, _ in given])
    values = np.array([[value for _, value in given]])
    return Result(system, np.array([start]), names, units, values, texts, modes=modes)


@lru_cache(maxsize=16)
def _vectors(columns: tuple[str, ...]) -> Mapping[str, NDArray[np.intp]]:
    """Return the value of Result.vectors for these columns, cached for all runs of a system."""
    groups: dict[str, dict[tuple[int, ...], int]] = {}
    for i, name in enumerate(columns):
        groups.setdefault(base(name), {})[index(name)] = i
    return {name: array for name, group in groups.items() if (array := _array(group)) is not None}


def _array(group: Mapping[tuple[int, ...], int]) -> NDArray[np.intp] | None:
    """Return the indices of the columns of one variable in an array of its shape; group: index of
    the column by indices of the element. Return None if elements are missing or the indices begin
    at neither 0 nor 1; only single elements can then be read by name.
    """
    whole = grid(group)
    if whole is None or max(whole.first, default=0) > 1:
        return None
    array = np.empty(whole.shape, dtype=np.intp)
    for i, column in group.items():
        array[whole.place(i)] = column
    array.flags.writeable = False
    return array


# ---- views: variables with axes


ELEMENTS = "elements"
"""Name of the attribute that lists the names of a variable's elements if their indices are not
counted from 1.
"""
PROVENANCE = "provenance_"
"""Prefix of the names of attributes with the provenance of a result."""
AXES = {3: "axis"}
"""Name of the second dimension of a vector by its length; other lengths n are called axis_n."""


def variables(
    table: Result | None,
) -> Iterator[tuple[str, tuple[str, ...], NDArray[np.float64], dict[str, str]]]:
    """Yield every variable of a table: name, names of its axes without time (none for a scalar, one
    for a vector, two for a matrix), values (rows, ...), and attributes (unit, description, names of
    modes, names of elements). Yield nothing if `table` is None (parameters unknown).
    """
    if table is None:
        return
    for name in table.names:
        values = table[name]
        about = {"units": table.unit(name), "long_name": table.description(name)}
        if names := table.mode_names(name):
            about["modes"] = "|".join(names)
        if name in table.vectors:
            given = [table.columns[i] for i in table.vectors[name].flat]
            if given != element_names(name, values.shape[1:]):
                about[ELEMENTS] = in_lines(given)
        yield name, _dimensions(values.shape[1:]), values, about


def labelled(
    table: Result,
) -> dict[str, tuple[tuple[str, ...], NDArray[np.float64], dict[str, str]]]:
    """Return axes, values and attributes of all variables and all parameters, by name. Parameters
    have no time axis.
    """
    fixed = {name: (axes, x[0], about) for name, axes, x, about in variables(table.parameters)}
    return fixed | {name: (("time", *axes), x, about) for name, axes, x, about in variables(table)}


def _dimensions(shape: tuple[int, ...]) -> tuple[str, ...]:
    if len(shape) == 1:
        return (AXES.get(shape[0], f"axis_{shape[0]}"),)
    return tuple(f"{name}_{n}" for name, n in zip(("row", "column", "layer"), shape, strict=False))


def element_names(name: str, shape: tuple[int, ...]) -> list[str]:
    """Return the names of the elements of a variable of this shape, with indices from 1."""
    return list(expand(name, np.empty(shape).tolist())) if shape else [name]


def in_lines(names: Iterable[str]) -> str:
    """Return names in one text, one per line. Backslashes and line breaks inside a name are
    escaped.
    """
    return "\n".join(name.replace("\\", r"\\").replace("\n", r"\n") for name in names)


def time_labels(table: Result) -> dict[str, str]:
    """Return the attributes of the time axis according to the CF conventions."""
    units = "s" if table.provenance is None else table.provenance.time_units
    dated = {} if units == "s" else {"calendar": "proleptic_gregorian"}
    return {"units": units, "long_name": "time", **dated}


def attributes(table: Result) -> dict[str, Any]:
    """Return the attributes of a whole result for .nc files and xarray: system, message,
    completeness and provenance.
    """
    origin = {} if table.provenance is None else flat(table.provenance)
    return {
        "system": table.system,
        "message": table.message,
        "complete": int(table.complete),
        **{PROVENANCE + name: value for name, value in origin.items()},
    }
