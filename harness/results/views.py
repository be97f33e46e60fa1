# SPDX-License-Identifier: BSD-2-Clause
"""A result in a notebook: a short text, a table with units, xarray and pandas, figures, files.

What draws, writes and reports stands above results and is attached there: harness.api.
"""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from typing import Any, ClassVar

from harness.results.variables import attributes, time_labels, variables

SHOWN = 400
"""Variables that a table in a notebook lists."""


class Views:
    """What a Result offers beside its numbers."""

    system: Any
    time: Any
    columns: Any
    units: Any
    values: Any
    complete: Any
    message: Any
    parameters: Any
    provenance: Any
    plot: ClassVar[Callable[..., Any]]
    save: ClassVar[Callable[..., Any]]
    report: ClassVar[Callable[..., Any]]

    def __repr__(self) -> str:
        return f"<Result {self._summary()}>"

    def _summary(self) -> str:
        span = f"{self.time[0]:g} to {self.time[-1]:g} s" if len(self.time) else "nothing recorded"
        state = "" if self.complete else f", incomplete: {self.message or 'the run ended early'}"
        return f"{self.system}: {span}, {len(self.time)} rows, {len(self.columns)} columns{state}"

    def _repr_html_(self) -> str:
        flown = self.provenance.lines() if self.provenance is not None else []
        found = list(variables(self))
        rows = "".join(_row(*each) for each in found[:SHOWN])
        more = f"<p>and {len(found) - SHOWN} more</p>" if len(found) > SHOWN else ""
        return (
            f"<p><b>{escape(self._summary())}</b></p>"
            f"<p>{'<br>'.join(map(escape, flown))}</p>"
            f"<details><summary>{len(found)} variables</summary><table><thead><tr><th>name</th>"
            "<th>shape</th><th>unit</th><th>first</th><th>last</th><th>meaning</th></tr></thead>"
            f"<tbody>{rows}</tbody></table>{more}</details>"
        )

    def to_xarray(self) -> Any:
        """The result as an xarray.Dataset, what xarray.open_dataset() makes of its .nc: vectors
        with an axis, parameters without time, units as attributes.
        """
        import xarray

        content = {name: (axes, d[0], a) for name, axes, d, a in variables(self.parameters)}
        content |= {name: (("time", *axes), d, a) for name, axes, d, a in variables(self)}
        time = ("time", self.time, time_labels(self))
        found = xarray.Dataset(content, coords={"time": time}, attrs=attributes(self))
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


def _row(name: str, _axes: Any, values: Any, about: dict[str, str]) -> str:
    shape = " x ".join(map(str, values.shape[1:])) or "scalar"
    ends = (_short(values[0]), _short(values[-1])) if len(values) else ("", "")
    cells = (name, shape, about["units"], *ends, about["long_name"])
    return "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>"


def _short(value: Any) -> str:
    """A number, or a vector of up to four."""
    numbers = value.reshape(-1).tolist()
    shown = ", ".join(f"{number:.4g}" for number in numbers[:4])
    return f"[{shown}{', ...' if len(numbers) > 4 else ''}]" if value.ndim else shown
