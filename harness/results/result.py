# SPDX-License-Identifier: BSD-2-Clause
"""The outcome of a run: a table with names and units, vectors by name, and the files it is kept
in.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from harness.results.provenance import Provenance
from harness.results.views import as_page, attributes, labelled, time_labels
from harness.spelling import did_you_mean
from harness.system.values import base, grid, index

Array = NDArray[np.float64]
"""Numbers of a result, of a history by row: (rows,) or (rows, n)."""
Rows = NDArray[np.intp]
"""Rows of a history by their number."""


@dataclass(frozen=True, repr=False)
class Result:
    """The recorded rows of a run, with parameters and provenance.

    time: (rows,) [s]; columns: `component.variable[i]`; units, descriptions: per column ("" if
    unknown); values: (rows, columns), read-only like time; complete: False if the run ended early,
    `message` then holds the reason; parameters: all parameters of all components as set, a table of
    one row (None if unknown); provenance: the system, its files and changes (None if unknown).
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

    plot: ClassVar[Callable[..., Any]]
    save: ClassVar[Callable[..., Any]]
    report: ClassVar[Callable[..., Any]]

    def __post_init__(self) -> None:
        """What was recorded stays as it is, whatever is computed from it."""
        for name in ("time", "values"):
            array = getattr(self, name).view()
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def parameter(self, name: str) -> Array:
        """Value of a parameter: (), (n,) for a vector, (m, n) for a matrix; KeyError with close
        matches.
        """
        if self.parameters is None:
            raise KeyError(f"{name}: the result does not hold the parameters of the run")
        return np.asarray(self.parameters[name][0])

    def __getitem__(self, name: str) -> Array:
        """History of a variable: (rows,) for a scalar or an element, (rows, n) for a vector, (rows,
        m, n) for a matrix.

        Raises KeyError with close matches.
        """
        if name in self._column:
            return self.values[:, self._column[name]]
        if name not in self.vectors:
            raise KeyError(f"{name}{did_you_mean(name, [*self.vectors, *self.columns])}")
        columns = self.vectors[name]
        flat = columns.reshape(-1)
        consecutive = bool((np.diff(flat) == 1).all())  # then no copy is made
        values = self.values[:, flat[0] : flat[-1] + 1] if consecutive else self.values[:, flat]
        return values.reshape(len(self.time), *columns.shape)

    def __contains__(self, name: str) -> bool:
        return name in self._column or name in self.vectors

    def holds(self, *names: str, parameters: Iterable[str] = ()) -> bool:
        """Whether the result has all these variables, and all these parameters of the run."""
        known: Result | tuple[()] = () if self.parameters is None else self.parameters
        return all(name in self for name in names) and all(name in known for name in parameters)

    def unit(self, name: str) -> str:
        """Unit of a scalar, element, vector or matrix; "" if unknown."""
        return self.units[self._first(name)]

    def description(self, name: str) -> str:
        """Meaning of a variable; "" if unknown."""
        return self.descriptions[self._first(name)] if self.descriptions else ""

    def _first(self, name: str) -> int:
        return self._column[name] if name in self._column else int(self.vectors[name].flat[0])

    @cached_property
    def _column(self) -> Mapping[str, int]:
        return {name: i for i, name in enumerate(self.columns)}

    @cached_property
    def vectors(self) -> Mapping[str, NDArray[np.intp]]:
        """Columns of every variable by its name without indices, in an array of the variable's own
        shape.
        """
        return _vectors(tuple(self.columns))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Variables of their own shape, then the elements of what is not whole."""
        whole = {column for columns in self.vectors.values() for column in columns.flat}
        return (*self.vectors, *(n for i, n in enumerate(self.columns) if i not in whole))

    # ---- for others

    def __repr__(self) -> str:
        return f"<Result {self.summary}>"

    @property
    def summary(self) -> str:
        """System, time span, size and state in one line."""
        span = f"{self.time[0]:g} to {self.time[-1]:g} s" if len(self.time) else "nothing recorded"
        state = "" if self.complete else f", incomplete: {self.message or 'the run ended early'}"
        return f"{self.system}: {span}, {len(self.time)} rows, {len(self.columns)} columns{state}"

    def _repr_html_(self) -> str:
        return as_page(self)

    def to_xarray(self) -> Any:
        """The result as an xarray.Dataset, what xarray.open_dataset() makes of its .nc: vectors
        with an axis, parameters without time, units as attributes.
        """
        import xarray

        time = ("time", self.time, time_labels(self))
        found = xarray.Dataset(labelled(self), coords={"time": time}, attrs=attributes(self))
        return xarray.decode_cf(found)

    def to_dataframe(self) -> Any:
        """The result as a pandas.DataFrame: a column per scalar, time [s] as index; `attrs` holds
        system and units by column.
        """
        import pandas as pd

        frame = pd.DataFrame(
            self.values, index=pd.Index(self.time, name="time"), columns=list(self.columns)
        )
        units = dict(zip(self.columns, self.units, strict=True))
        frame.attrs = {"system": self.system, "units": units}
        return frame


@lru_cache(maxsize=16)
def _vectors(columns: tuple[str, ...]) -> Mapping[str, NDArray[np.intp]]:
    """The same for every run of a system, so a campaign asks once."""
    groups: dict[str, dict[tuple[int, ...], int]] = {}
    for i, name in enumerate(columns):
        groups.setdefault(base(name), {})[index(name)] = i
    return {name: array for name, group in groups.items() if (array := _array(group)) is not None}


def _array(group: Mapping[tuple[int, ...], int]) -> NDArray[np.intp] | None:
    """Columns in the shape of their indices, which begin at 0 or 1; None if elements are missing,
    then only single elements have names.
    """
    whole = grid(group)
    if whole is None or max(whole.first, default=0) > 1:
        return None
    array = np.empty(whole.shape, dtype=np.intp)
    for i, column in group.items():
        array[whole.place(i)] = column
    array.flags.writeable = False
    return array
