# SPDX-License-Identifier: BSD-2-Clause
"""The dataset of a campaign: a Zarr group that xarray opens, one line per run.

It appears with all its arrays or not at all. It is written block by block, and a block is a chunk
with a checksum, so that nothing waits in memory, no chunk is written twice, and none that was lost
passes for one. The status of its runs is written last: what is pending after an interruption is run
again.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import ResultsError, UsageError
from harness.files.output import naming, new_beside
from harness.files.paths import Stamp, stamp
from harness.files.sealed import Taken, locked, on_the_disk
from harness.ssp.library import name_of
from harness.studies.campaign.layout import SCRATCH, Field
from harness.studies.campaign.plan import Plan, Values
from harness.studies.campaign.worker import PENDING, Row

Array = NDArray[np.float64]
PERCENTILES = (5.0, 25.0, 50.0, 75.0, 95.0)
COMPRESSED = 4096
"""Bytes of a chunk from which on it is compressed; for less it costs more than it saves."""
MAKING = "unfinished_"
"""What a band is called until it is complete."""
ATTRIBUTES = {"definition": str, "folder": str, "digest": str, "system": str, "block": int}
"""Of a dataset, and their types."""
SCHEMA = 1
"""Version of the layout of a dataset, see docs/release.md; datasets without a number have 1."""


class Store:
    """An open dataset."""

    def __init__(self, path: Path, group: Any) -> None:
        self.path, self.group = path, group
        self._written: dict[str, Any] = {}  # opening an array costs as much as writing to it
        self._seen: dict[str, tuple[Stamp, Any]] = {}

    # ---- life

    @classmethod
    def create(cls, path: Path, plan: Plan, block: int, laid: Iterable[Field]) -> Store:
        """A new dataset of these arrays with every run pending; UsageError if there is one."""
        import zarr

        refuse_existing(path)
        about = {
            "definition": json.dumps(plan.definition),
            "folder": str(plan.folder),
            "digest": plan.digest,
            "system": name_of(plan.system),
            "block": block,
            "repeat": f"harness run {name_of(plan.system)} --like DATASET#RUN",
            "schema": SCHEMA,
        }
        with naming(path), ExitStack() as life:
            beside = new_beside(path.absolute(), folder=True)
            life.callback(shutil.rmtree, beside, ignore_errors=True)
            store = cls(path, zarr.open_group(beside, mode="w", zarr_format=3))
            store.group.attrs.update(about)
            for field in laid:
                store._lay_out(field, block)
            on_the_disk(beside)
            refuse_existing(path)
            beside.rename(path)
        return cls(path, zarr.open_group(path, mode="r+", zarr_format=3))

    @classmethod
    def open(cls, path: Path) -> Store:
        """A dataset that is there; ResultsError if it is none."""
        import zarr

        try:
            store = cls(path, zarr.open_group(path, mode="r+", zarr_format=3))
            store._legible()
        except (OSError, KeyError, ValueError, TypeError, AttributeError) as error:
            raise ResultsError(f"{path}: is not the dataset of a campaign") from error
        if (schema := store.group.attrs.get("schema", 1)) != SCHEMA:
            raise ResultsError(f"{path}: has schema {schema}, this version reads {SCHEMA}")
        return store

    @classmethod
    def resumed(
        cls, path: Path, digest: str, laid: Iterable[Field], life: ExitStack, kind: str = ""
    ) -> Store:
        """The dataset of an interrupted campaign, or study of a kind, for us alone until the end of
        `life`, with what was lost pending; UsageError if it is another one.
        """
        store = cls.open(path)
        known = store.group.attrs
        if known["digest"] != digest or (kind and known.get("kind") != kind):
            other = "of another campaign or of another"
            if kind:
                other = f"no {kind} of this file and of this"
            raise UsageError(f"{path}: is {other} state of its system")
        life.enter_context(store.alone())
        if not store.decided:
            store.mend(laid)
        return store

    def _legible(self) -> None:
        """ValueError if attributes are not of their types."""
        given = {name: self.group.attrs[name] for name in ATTRIBUTES}
        wrong = [n for n, kind in ATTRIBUTES.items() if type(given[n]) is not kind]
        if wrong or given["block"] < 1 or not isinstance(self.definition()[0], Mapping):
            raise ValueError(wrong)
        for name in self._folders():
            if (array := self._found(name)) is not None:
                texts = [array.attrs.get(each, "") for each in ("role", "units", "long_name")]
                whole = array.attrs.get("whole", False)
                if not all(isinstance(t, str) for t in texts) or not isinstance(whole, bool):
                    raise ValueError(name)

    def _folders(self) -> list[str]:
        """Names of all arrays, whether they can be read or not."""
        return sorted(each.name for each in self.path.iterdir() if each.is_dir())

    def _found(self, name: str) -> Any:
        """An array, None if it cannot be read; opened anew only where its file has changed."""
        try:
            now = stamp(self.path / name / "zarr.json")
            if name not in self._seen or self._seen[name][0] != now:
                self._seen[name] = now, self.group[name]
            return self._seen[name][1]
        except (OSError, KeyError, ValueError, TypeError, AttributeError):
            return None

    def _arrays(self) -> Iterator[tuple[str, Any]]:
        """All complete arrays by name; ResultsError if one is damaged. What whoever flies the
        campaign removes meanwhile is not.
        """
        for name in self._folders():
            if name.startswith(MAKING):
                continue
            if (array := self._found(name)) is not None:
                yield name, array
            elif (self.path / name).is_dir():
                raise self._damaged(name)

    def _damaged(self, name: str) -> ResultsError:
        return ResultsError(
            f"{self.path}: {name} is damaged; harness campaign --resume repeats the missing runs"
        )

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Nobody else writes meanwhile; UsageError if somebody does."""
        try:
            with locked(self.path / "zarr.json"):
                yield
        except Taken as error:
            raise UsageError(f"{self.path}: another campaign is writing it") from error

    def _lay_out(self, field: Field, block: int) -> Any:
        from zarr import config
        from zarr.codecs import Crc32cCodec, ZstdCodec

        length = block if field.axes[0] == "run" else max(1, field.shape[0])
        chunks = (min(length, max(1, field.shape[0])), *field.shape[1:])
        small = field.kind is not str and 8 * np.prod(chunks) < COMPRESSED
        with config.set({"array.write_empty_chunks": True}):
            array = self.group.create_array(
                field.name,
                shape=field.shape,
                dtype=field.kind,
                chunks=chunks,
                compressors=[*([] if small else [ZstdCodec()]), Crc32cCodec()],
                fill_value=field.fill,
                dimension_names=list(field.axes),
                attributes=dict(field.about),
                overwrite=True,
            )
            if field.values is not None:
                array[...] = field.values
        return array

    # ---- blocks

    @property
    def block(self) -> int:
        """Runs per block."""
        return int(self.group.attrs["block"])

    @property
    def runs(self) -> int:
        """Number of runs of the campaign."""
        return int(self.group["status"].shape[0])

    def blocks(self) -> Iterator[slice]:
        """Runs of every block."""
        for first in range(0, self.runs, self.block):
            yield slice(first, min(first + self.block, self.runs))

    def pending(self) -> Iterator[int]:
        """First runs of the blocks that are not complete."""
        status = self.array("status")
        return (part.start for part in self.blocks() if (status[part] == PENDING).any())

    def write(
        self,
        first: int,
        values: Sequence[Values],
        rows: Sequence[Row],
        further: Mapping[str, Sequence[Any]] | None = None,
    ) -> None:
        """Keep a block of runs with further arrays of theirs, its status last; ResultsError."""
        with naming(self.path):
            for name, array in (further or {}).items():
                self._put(name, slice(first, first + len(rows)), array)
            self._write(first, values, rows)

    def shorten(self, runs: int) -> None:
        """The runs after these were not needed; ResultsError."""
        with naming(self.path):
            for name in self._of_runs:
                self._opened(name).resize((runs, *self._opened(name).shape[1:]))
            self._written.clear()
            self.group.attrs["decided"] = True

    @property
    def decided(self) -> bool:
        """Whether all its runs are there, fewer than were planned."""
        return bool(self.group.attrs.get("decided", False))

    def _write(self, first: int, values: Sequence[Values], rows: Sequence[Row]) -> None:
        place = slice(first, first + len(rows))
        for name in values[0]:
            self._put(name, place, [v[name] for v in values])
        self._put("message", place, [row.message for row in rows])
        self._put("end_time", place, [row.time for row in rows])
        self._put("last", place, [row.last for row in rows])
        for name in rows[0].metrics:
            self._put(name, place, [row.metrics[name] for row in rows])
        if rows[0].verdicts:
            self._put("verdict", place, [row.verdicts for row in rows])
            self._put("margin", place, [row.margins for row in rows])
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
        """An array that is written again and again; a chunk without news is written too."""
        if name not in self._written:
            from zarr import config

            with config.set({"array.write_empty_chunks": True}):
                self._written[name] = self.group[name]
        return self._written[name]

    @cached_property
    def _histories(self) -> list[str]:
        return self.names("history")

    # ---- after an interruption

    def mend(self, laid: Iterable[Field]) -> None:
        """Make what was lost by a kill or a power failure pending, so that it is flown again.

        Raises ResultsError.
        """
        with naming(self.path):
            for left in self.path.rglob("*.partial"):
                left.unlink(missing_ok=True)
            for name in self._folders():
                if name.startswith(MAKING) or self._found(name) is None:
                    shutil.rmtree(self.path / name)
            for field in laid:
                plain = field.name.removeprefix(SCRATCH)
                done = plain != field.name and f"{plain}_band" in self.group
                if field.values is not None or not (done or self._fits(field)):
                    self._lay_out(field, self.block)
            for part in self.blocks():
                if not self._whole("status", part):
                    self._put("status", part, [PENDING] * (part.stop - part.start))
            status = self.array("status")
            for part in self.blocks():
                complete = (status[part] != PENDING).all()
                if complete and not all(self._whole(name, part) for name in self._of_runs):
                    self._put("status", part, [PENDING] * (part.stop - part.start))

    def _fits(self, field: Field) -> bool:
        """Whether an array is there and as it is laid out."""
        if (array := self._found(field.name)) is None:
            return False
        chunk = min(self.block, field.shape[0])
        return bool(array.shape == field.shape and array.chunks[0] == chunk)

    @cached_property
    def _of_runs(self) -> list[str]:
        return [n for n, a in self._arrays() if (a.metadata.dimension_names or [""])[0] == "run"]

    def _whole(self, name: str, part: slice) -> bool:
        """Whether the chunk of a block is there and has the sum that was written with it."""
        array = self._opened(name)
        place = (part.start // self.block, *[0] * (array.ndim - 1))
        if not (self.path / name / array.metadata.encode_chunk_key(place)).is_file():
            return False
        try:
            np.asarray(array[part])
        except (ValueError, IndexError, RuntimeError):
            return False
        return True

    # ---- reading

    def names(self, role: str) -> list[str]:
        """Factors, metrics or histories by name."""
        return [n for n, a in self._arrays() if a.attrs.get("role") == role]

    def units(self) -> dict[str, str]:
        """Units of factors, metrics and histories by name, of those that have one."""
        given = {n.removesuffix("_band"): a.attrs.get("units", "") for n, a in self._arrays()}
        return {name: unit for name, unit in given.items() if unit not in {"", "1"}}

    def array(self, name: str) -> Any:
        """All values of one array; texts as Python has them. ResultsError if it is damaged."""
        values = np.asarray(self._read(name, ...))
        return values if values.dtype.kind in "fiu" else np.array(list(map(str, values)), object)

    def _read(self, name: str, place: Any) -> Any:
        try:
            return self.group[name][place]
        except (KeyError, ValueError, TypeError, RuntimeError, OSError) as error:
            raise self._damaged(name) from error

    def values(self, run: int) -> Values:
        """Values of all factors of a run, as they were drawn."""
        return {name: self._value(name, run) for name in self.names("factor")}

    def _value(self, name: str, run: int) -> Any:
        value, array = self._read(name, run), self.group[name]
        if array.dtype.kind not in "fiu":
            return str(value)
        plain = np.asarray(value).tolist()
        return int(plain) if array.attrs.get("whole") else plain

    @property
    def system(self) -> str:
        """What `harness run` knows the system by: its name, of a TOML its path as it was given."""
        given = str(self.definition()[0].get("system", ""))
        return given if given.endswith(".toml") else str(self.group.attrs["system"])

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
            plain = name.removeprefix(SCRATCH)
            label = f"{plain}_band"
            if label not in self.group:
                self._bands(self.group[name], plain)
                (self.path / (MAKING + label)).rename(self.path / label)  # complete or not there
            if name.startswith(SCRATCH):
                gone = (self.path / name).rename(self.path / (MAKING + name))  # whole or not there
                shutil.rmtree(gone)

    def _bands(self, source: Any, plain: str) -> None:
        if "percentile" not in self.group:
            values = np.array(PERCENTILES)
            axis = Field("percentile", np.float64, values.shape, ("percentile",), values=values)
            self._lay_out(axis, self.block)
        _, rows, width = source.shape
        axes = ("percentile", "time", f"{plain}_element")
        shape = (len(PERCENTILES), rows, width)
        about = {**source.attrs, "role": "band"}
        field = Field(f"{MAKING}{plain}_band", np.float64, shape, axes, about=about)
        band = self._lay_out(field, self.block)
        step = max(1, 4_000_000 // max(1, source.shape[0] * width))  # some 32 MB at once
        for first in range(0, rows, step):
            part = np.asarray(source[:, first : first + step])
            flown = part[:, np.isfinite(part).any(axis=(0, 2))]
            values = np.full((len(PERCENTILES), *part.shape[1:]), np.nan)
            if flown.size:
                found = np.nanpercentile(flown, PERCENTILES, axis=0)
                values[:, np.isfinite(part).any(axis=(0, 2))] = found
            band[:, first : first + step] = values


def refuse_existing(path: Path) -> None:
    """UsageError if there is something already."""
    if path.exists():
        raise UsageError(f"{path}: already exists; continue with --resume, or remove it")
