# SPDX-License-Identifier: BSD-2-Clause
"""The dataset of a campaign: a Zarr group that xarray opens, one line per run.

It is written block by block, and a block is a chunk, so that nothing waits in memory and no chunk
is written twice. The status of its runs is written last: what is pending after an interruption is
run again.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import ResultsError, UsageError
from harness.files.output import naming
from harness.ssp.library import name_of
from harness.studies.campaign import labels
from harness.studies.campaign.plan import Layout, Plan, Values
from harness.studies.campaign.worker import PENDING, Row, Task

Array = NDArray[np.float64]
PERCENTILES = (5.0, 25.0, 50.0, 75.0, 95.0)
COMPRESSED = 4096
"""Bytes of a chunk from which on it is compressed; for less it costs more than it saves."""
SCRATCH = "history_of_"
"""Histories that are kept only until their bands are known."""


class Store:
    """An open dataset."""

    def __init__(self, path: Path, group: Any) -> None:
        self.path, self.group = path, group
        self._written: dict[str, Any] = {}  # opening an array costs as much as writing to it

    # ---- life

    @classmethod
    def create(cls, path: Path, plan: Plan, task: Task, block: int, found: Layout) -> Store:
        """A new dataset with every run pending; UsageError if there is one already."""
        import zarr

        if path.exists():
            raise UsageError(f"{path}: is there already; go on with --resume, or remove it")
        about = {
            "definition": json.dumps(plan.definition),
            "folder": str(plan.folder),
            "digest": plan.digest,
            "system": name_of(plan.system),
            "block": block,
        }
        with naming(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            store = cls(path, zarr.open_group(path, mode="w-", zarr_format=3))
            store.group.attrs.update(about)
            store._lay_out(plan, task, block, found)
        return store

    @classmethod
    def open(cls, path: Path) -> Store:
        """A dataset that is there; ResultsError if it is none."""
        import zarr

        try:
            store = cls(path, zarr.open_group(path, mode="r+", zarr_format=3))
            store.group.attrs["digest"]
        except (OSError, KeyError, ValueError) as error:
            raise ResultsError(f"{path}: is not the dataset of a campaign") from error
        return store

    def _lay_out(self, plan: Plan, task: Task, block: int, found: Layout) -> None:
        n, kinds = plan.runs, found.kinds
        self._array("status", np.int8, (n,), ("run",), block, PENDING, labels.STATUS)
        self._array("message", str, (n,), ("run",), block, "")
        self._array("end_time", np.float64, (n,), ("run",), block, about=labels.END)
        columns = len(task.columns)
        self._array("last", np.float64, (n, columns), ("run", "column"), block)
        self._fill("column", np.array(task.columns, dtype=object), ("column",), str)
        self._fill("column_units", np.array(kinds.units, dtype=object), ("column",), str)
        for name, value in plan.values(0).items():
            kind = str if isinstance(value, str) else np.float64
            shape = np.shape(value)
            axes = tuple(f"{name}_{k + 1}" for k in range(len(shape)))
            about = {"role": "factor", "whole": plan.whole(name), **labels.of_factor(name, kinds)}
            fill = "" if kind is str else np.nan
            self._array(name, kind, (n, *shape), ("run", *axes), block, fill, about)
        for name in task.metrics:
            about = {"role": "metric", **labels.of_metric(name, plan, kinds)}
            self._array(name, np.float64, (n,), ("run",), block, about=about)
        if task.kept:
            time = found.start + np.array(task.steps, dtype=np.float64) * found.step
            self._fill("time", time, ("time",), np.float64, labels.TIME)
        for name in task.kept:
            width = len(_elements(name, task.columns))
            label = self._history(plan, name)
            shape = (n, len(task.rows), width)
            axes = ("run", "time", f"{name}_element")
            about = {"role": "history", **labels.of_variable(name, kinds)}
            self._array(label, np.float64, shape, axes, block, about=about)

    def _history(self, plan: Plan, name: str) -> str:
        return name if name in plan.keep.get("histories", ()) else SCRATCH + name

    def _array(  # noqa: PLR0913, PLR0917 - what an array is
        self,
        name: str,
        kind: Any,
        shape: tuple[int, ...],
        axes: tuple[str, ...],
        block: int,
        fill: Any = np.nan,
        about: Mapping[str, Any] | None = None,
    ) -> Any:
        chunks = (min(block, shape[0]), *shape[1:])
        small = kind is not str and 8 * np.prod(chunks) < COMPRESSED
        return self.group.create_array(
            name,
            shape=shape,
            dtype=kind,
            chunks=chunks,
            compressors=None if small else "auto",
            fill_value=fill,
            dimension_names=list(axes),
            attributes=dict(about or {}),
        )

    def _fill(
        self,
        name: str,
        values: Any,
        axes: tuple[str, ...],
        kind: Any,
        about: Mapping[str, Any] | None = None,
    ) -> None:
        fill = "" if kind is str else np.nan
        self._array(name, kind, np.shape(values), axes, len(values), fill, about)[...] = values

    # ---- blocks

    @property
    def block(self) -> int:
        """Runs per block."""
        return int(self.group.attrs["block"])

    @property
    def runs(self) -> int:
        """Number of runs of the campaign."""
        return int(self.group["status"].shape[0])

    def pending(self) -> Iterator[int]:
        """First runs of the blocks that are not complete."""
        status = np.asarray(self.group["status"][:])
        for first in range(0, len(status), self.block):
            if (status[first : first + self.block] == PENDING).any():
                yield first

    def write(self, first: int, values: Sequence[Values], rows: Sequence[Row]) -> None:
        """Keep a block of runs, its status last; ResultsError."""
        with naming(self.path):
            self._write(first, values, rows)

    def _write(self, first: int, values: Sequence[Values], rows: Sequence[Row]) -> None:
        place = slice(first, first + len(rows))
        for name in values[0]:
            self._put(name, place, [v[name] for v in values])
        self._put("message", place, [row.message for row in rows])
        self._put("end_time", place, [row.time for row in rows])
        self._put("last", place, [row.last for row in rows])
        for name in rows[0].metrics:
            self._put(name, place, [row.metrics[name] for row in rows])
        for name in self._histories:
            empty = np.full(self._opened(name).shape[1:], np.nan)
            plain = name.removeprefix(SCRATCH)
            self._put(name, place, [row.histories.get(plain, empty) for row in rows])
        self._put("status", place, [row.status for row in rows])

    def _put(self, name: str, place: slice, values: Sequence[Any]) -> None:
        array = self._opened(name)
        text = bool(values) and isinstance(values[0], str)
        array[place] = np.array(values, dtype=object if text else array.dtype)

    def _opened(self, name: str) -> Any:
        """An array that is written again and again."""
        if name not in self._written:
            self._written[name] = self.group[name]
        return self._written[name]

    @cached_property
    def _histories(self) -> list[str]:
        return self.names("history")

    # ---- reading

    def names(self, role: str) -> list[str]:
        """Factors, metrics or histories by name."""
        return sorted(n for n, a in self.group.arrays() if a.attrs.get("role") == role)

    def units(self) -> dict[str, str]:
        """Units of factors, metrics and histories by name, of those that have one."""
        given = {n.removesuffix("_band"): a.attrs.get("units", "") for n, a in self.group.arrays()}
        return {name: unit for name, unit in given.items() if unit not in {"", "1"}}

    def array(self, name: str) -> Any:
        """All values of one array; texts as Python has them."""
        values = np.asarray(self.group[name][...])
        return values if values.dtype.kind in "fiu" else np.array(list(map(str, values)), object)

    def values(self, run: int) -> Values:
        """Values of all factors of a run, as they were drawn."""
        return {name: self._value(self.group[name], run) for name in self.names("factor")}

    @staticmethod
    def _value(array: Any, run: int) -> Any:
        value = array[run]
        if array.dtype.kind not in "fiu":
            return str(value)
        plain = np.asarray(value).tolist()
        return int(plain) if array.attrs["whole"] else plain

    def definition(self) -> tuple[Mapping[str, Any], Path]:
        """The table of the campaign, and the folder of the files that it names."""
        return json.loads(self.group.attrs["definition"]), Path(self.group.attrs["folder"])

    # ---- the end

    def finish(self) -> None:
        """Compute the percentile bands and remove what they were computed from; ResultsError."""
        with naming(self.path):
            self._finish()

    def _finish(self) -> None:
        for name in self.names("history"):
            source = self.group[name]
            plain = name.removeprefix(SCRATCH)
            label = f"{plain}_band"
            if label not in self.group:
                self._bands(source, plain, label)
            if name.startswith(SCRATCH):
                del self.group[name]

    def _bands(self, source: Any, plain: str, label: str) -> None:
        if "percentile" not in self.group:
            self._fill("percentile", np.array(PERCENTILES), ("percentile",), np.float64)
        _, rows, width = source.shape
        axes = ("percentile", "time", f"{plain}_element")
        shape = (len(PERCENTILES), rows, width)
        about = {**source.attrs, "role": "band"}
        band = self._array(label, np.float64, shape, axes, len(PERCENTILES), about=about)
        step = max(1, 4_000_000 // max(1, source.shape[0] * width))  # some 32 MB at once
        for first in range(0, rows, step):
            part = np.asarray(source[:, first : first + step])
            flown = part[:, np.isfinite(part).any(axis=(0, 2))]
            values = np.full((len(PERCENTILES), *part.shape[1:]), np.nan)
            if flown.size:
                found = np.nanpercentile(flown, PERCENTILES, axis=0)
                values[:, np.isfinite(part).any(axis=(0, 2))] = found
            band[:, first : first + step] = values


def _elements(name: str, columns: Sequence[str]) -> list[str]:
    """Columns of a variable."""
    return [c for c in columns if c == name or c.startswith(f"{name}[")]
