# SPDX-License-Identifier: BSD-2-Clause
"""Dataset of a campaign: a Zarr group of arrays with an entry per run, their axes and their labels.

A dataset is created with all its arrays or not at all. Consecutive runs are written together as a
block. A block is one chunk of each array, with a checksum, so that no chunk is written twice, and a
lost or damaged chunk is detected. Of each block, the array `status` is written last. After an
interruption, runs whose status is pending are repeated.
"""

from __future__ import annotations

import json
import shutil
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import Struct

from harness.errors import ResultsError, UsageError
from harness.files.checksums import Taken, locked, on_the_disk
from harness.files.output import naming, new_beside
from harness.spelling import some
from harness.ssp.library import name_of
from harness.studies.campaign.layout import SCRATCH, Field
from harness.studies.campaign.plan import Plan, Source, Table, Values
from harness.studies.campaign.worker import PENDING, Row
from harness.system.tables import Count

Columns = Mapping[str, Sequence[Any]]
"""Entries of consecutive runs in each array, by name of the array."""
PERCENTILES = np.array([5.0, 25.0, 50.0, 75.0, 95.0])
"""Percentiles of which the recorded bands consist [%]."""
AXIS = Field("percentile", np.float64, PERCENTILES.shape, ("percentile",), values=PERCENTILES)
COMPRESSED = 4096
"""Smallest size of a chunk of numbers that is compressed, at 8 bytes per number [bytes]; for less,
compression is not worth it. Texts are always compressed.
"""
MAKING = "unfinished_"
"""Prefix of the name of an array that is being written or removed."""
SCHEMA = 1
"""Version of the layout of a dataset, see docs/release.md. A dataset without a version number has
version 1.
"""
DAMAGES = (OSError, KeyError, ValueError, TypeError, AttributeError, IndexError, RuntimeError)
"""Exceptions that zarr raises for an array that it cannot read."""


class About(Struct, frozen=True):
    """Attributes of a dataset.

    definition: table of the campaign as JSON; folder: folder of the files that the table names;
    system: name of the system; block: number of runs that are written together; repeat: command
    that repeats a run; sources: files and packages that influence the results of the runs, by name;
    schema: see SCHEMA; decided: the stopping rule has ended the campaign before all planned runs,
    so the dataset is complete.
    """

    definition: str
    folder: str
    system: str
    block: Count
    repeat: str = ""
    sources: dict[str, Source] = {}
    schema: int = SCHEMA
    decided: bool = False


class Labels(Struct, frozen=True):
    """Attributes of an array of a dataset; role: factor, metric, history (time series) or band
    (percentiles of a time series over all runs); whole: whether all values of a factor are whole
    numbers.
    """

    role: str = ""
    units: str = ""
    long_name: str = ""
    whole: bool = False


class Store:
    """Open dataset of a campaign or study, at `path`; group: the Zarr group in it."""

    def __init__(self, path: Path, group: Any) -> None:
        self.path, self.group = path, group
        self._seen: dict[str, Any] = {}  # arrays, opened once: opening takes as long as writing

    # ---- create and open

    @classmethod
    def create(cls, path: Path, plan: Plan, block: int, laid: Iterable[Field]) -> Store:
        """Create a dataset in which every run is pending; raise UsageError if the path exists.

        block: number of runs that are written together; laid: arrays of the dataset; plan:
        campaign.
        """
        import zarr

        reject_existing(path)
        name, text = name_of(plan.system), json.dumps(plan.definition)
        repeat = f"harness run {name} --like DATASET#RUN"
        about = About(text, str(plan.folder), name, block, repeat, dict(plan.sources))
        with naming(path), ExitStack() as life:
            beside = new_beside(path.absolute(), folder=True)
            life.callback(shutil.rmtree, beside, ignore_errors=True)
            store = cls(path, zarr.open_group(beside, mode="w", zarr_format=3))
            store.group.attrs.update(msgspec.structs.asdict(about))
            for field in laid:
                store._lay_out(field, block)
            on_the_disk(beside)
            reject_existing(path)
            beside.rename(path)
        return cls(path, zarr.open_group(path, mode="r+", zarr_format=3))

    @classmethod
    def open(cls, path: Path) -> Store:
        """Open an existing dataset; raise ResultsError if the path is no dataset of a campaign."""
        import zarr

        try:
            store = cls(path, zarr.open_group(path, mode="r+", zarr_format=3))
            schema = store.about.schema
            msgspec.convert(store.definition()[0], Table)
            for name in store._folders():
                if (array := store._array(name)) is not None:
                    msgspec.convert(dict(array.attrs), Labels)
        except DAMAGES as error:
            raise ResultsError(f"{path}: is not the dataset of a campaign") from error
        if schema != SCHEMA:
            raise ResultsError(
                f"{path}: has schema {schema}, but this version of harness reads only {SCHEMA}"
            )
        return store

    @classmethod
    def resumed(
        cls, path: Path, plan: Plan, laid: Iterable[Field], life: ExitStack, kind: str = ""
    ) -> Store:
        """Reopen the dataset of an interrupted campaign or study, and set runs whose data are lost
        to pending unless the stopping rule has ended the campaign. The dataset is locked until the
        end of `life`.

        laid: arrays that the dataset should have; kind: kind of a study, such as `worst` ("":
        campaign). Raises UsageError if the definition or a source has changed, the kind is another
        one, or the dataset is locked, and ResultsError if it is damaged or cannot be written.
        """
        store = cls.open(path)
        if kind and store.group.attrs.get("kind") != kind:
            raise UsageError(f"{path}: cannot resume: it is not the dataset of a {kind} study")
        then, now = store.plan().decisive, plan.decisive
        if names := [name for name in {**then, **now} if then.get(name) != now.get(name)]:
            raise UsageError(
                f"{path}: cannot resume: changed since its first run: {some(names)}; restore them, "
                "or write another dataset"
            )
        life.enter_context(store.alone())
        if not store.about.decided:
            store.mend(laid)
        return store

    @property
    def about(self) -> About:
        """Return the attributes of the dataset; raise ValueError if their types are wrong."""
        return msgspec.convert(dict(self.group.attrs), About)

    def _folders(self) -> list[str]:
        """Return the names of all arrays, including those that cannot be read."""
        return sorted(each.name for each in self.path.iterdir() if each.is_dir())

    def _array(self, name: str) -> Any:
        """Return an array by name, None if it cannot be read.

        A chunk that contains only the fill value is written too. By default Zarr omits such chunks,
        and mend() would take the runs of a missing chunk for lost.
        """
        from zarr import config

        if not (self.path / name / "zarr.json").is_file():
            return None
        if name not in self._seen:
            try:
                with config.set({"array.write_empty_chunks": True}):
                    self._seen[name] = self.group[name]
            except DAMAGES:
                return None
        return self._seen[name]

    def _arrays(self) -> Iterator[tuple[str, Any]]:
        """Yield name and array of all complete arrays; raise ResultsError if one is damaged. An
        array that another process removes meanwhile does not count as damaged.
        """
        for name in self._folders():
            if name.startswith(MAKING):
                continue
            if (array := self._array(name)) is not None:
                yield name, array
            elif (self.path / name).is_dir():
                raise self._damaged(name)

    def _damaged(self, name: str) -> ResultsError:
        return ResultsError(
            f"{self.path}: array {name} is damaged; "
            "the command that made it repeats the missing runs with --resume"
        )

    @contextmanager
    def alone(self) -> Iterator[None]:
        """Lock the dataset against other writers; raise UsageError if it is locked."""
        try:
            with locked(self.path / "zarr.json"):
                yield
        except Taken as error:
            raise UsageError(
                f"{self.path}: another process is writing this dataset; wait until it has ended"
            ) from error

    def _lay_out(self, field: Field, block: int) -> Any:
        """Create an array, replacing an existing one, and return it. If its first axis is `run`,
        each chunk contains `block` runs.
        """
        from zarr import config
        from zarr.codecs import Crc32cCodec, ZstdCodec

        self._seen.pop(field.name, None)
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

    @cached_property
    def block(self) -> int:
        """Return the number of runs per block."""
        return self.about.block

    @property
    def runs(self) -> int:
        """Return the number of runs in the dataset, including pending ones."""
        return int(self.group["status"].shape[0])

    def blocks(self) -> Iterator[slice]:
        """Yield the slice of run numbers of every block."""
        for first in range(0, self.runs, self.block):
            yield slice(first, min(first + self.block, self.runs))

    def pending(self) -> Iterator[int]:
        """Return an iterator over the number of the first run of each block with pending runs."""
        status = self.array("status")
        return (part.start for part in self.blocks() if (status[part] == PENDING).any())

    def write(
        self, first: int, values: Sequence[Values], rows: Sequence[Row], further: Columns
    ) -> None:
        """Write the entries of consecutive runs into all arrays, `status` last.

        first: number of the first run; values: values of the factors, one dictionary per run; rows:
        results of the runs; further: entries of other arrays. Raises ResultsError.
        """
        columns = {**further, **{n: [v[n] for v in values] for n in values[0]}, **_columns(rows)}
        for name in self._histories:
            empty = np.full(self._array(name).shape[1:], np.nan)
            plain = name.removeprefix(SCRATCH)
            columns[name] = [row.histories.get(plain, empty) for row in rows]
        columns["status"] = [row.status for row in rows]
        with naming(self.path):
            for name, column in columns.items():
                self._put(name, slice(first, first + len(rows)), column)

    def _put(self, name: str, place: slice, values: Sequence[Any]) -> None:
        array = self._array(name)
        text = bool(values) and isinstance(values[0], str)
        array[place] = np.array(values, dtype=object if text else array.dtype)

    def shorten(self, runs: int) -> None:
        """Reduce the dataset to its first `runs` runs, because the campaign needs no more;
        raise ResultsError if it cannot be written.
        """
        with naming(self.path):
            for name in self._of_runs():
                self._array(name).resize((runs, *self._array(name).shape[1:]))
            self._seen.clear()
            self.group.attrs["decided"] = True

    @cached_property
    def _histories(self) -> list[str]:
        return self.names("history")

    # ---- after an interruption

    def mend(self, laid: Iterable[Field]) -> None:
        """Repair the dataset after an interruption: create missing arrays again, and set the status
        of all runs in blocks with missing or damaged chunks to pending, so that they are repeated.

        laid: arrays that the dataset should have. Raises ResultsError if it cannot be written.
        """
        with naming(self.path):
            for left in self.path.rglob("*.partial"):
                left.unlink(missing_ok=True)
            for name in self._folders():
                if name.startswith(MAKING) or self._array(name) is None:
                    shutil.rmtree(self.path / name)
            for field in laid:
                plain = field.name.removeprefix(SCRATCH)
                done = plain != field.name and f"{plain}_band" in self.group
                if field.values is not None or not (done or self._fits(field)):
                    self._lay_out(field, self.block)
            names = self._of_runs()
            for part in self.blocks():
                lost = not self._whole("status", part)
                if not lost and (self._array("status")[part] != PENDING).all():
                    lost = not all(self._whole(name, part) for name in names)
                if lost:
                    self._put("status", part, [PENDING] * (part.stop - part.start))

    def _fits(self, field: Field) -> bool:
        """Return whether the array exists with the shape and chunk length that it should have."""
        if (array := self._array(field.name)) is None:
            return False
        chunk = min(self.block, field.shape[0])
        return bool(array.shape == field.shape and array.chunks[0] == chunk)

    def _of_runs(self) -> list[str]:
        """Return the names of the arrays that have an entry per run."""
        return [n for n, a in self._arrays() if (a.metadata.dimension_names or [""])[0] == "run"]

    def _whole(self, name: str, part: slice) -> bool:
        """Return whether the chunk of an array for a block of runs exists and agrees with its
        checksum. part: numbers of the runs of the block.
        """
        array = self._array(name)
        place = (part.start // self.block, *[0] * (array.ndim - 1))
        try:
            np.asarray(array[part])
        except DAMAGES:
            return False
        return bool((self.path / name / array.metadata.encode_chunk_key(place)).is_file())

    # ---- reading

    def names(self, role: str) -> list[str]:
        """Return the names of the arrays with a role: factor, metric, history or band."""
        return [n for n, a in self._arrays() if a.attrs.get("role") == role]

    def units(self) -> dict[str, str]:
        """Return the units of all factors, metrics and variables that are not dimensionless, by
        name.
        """
        given = {n.removesuffix("_band"): a.attrs.get("units", "") for n, a in self._arrays()}
        return {name: unit for name, unit in given.items() if unit not in {"", "1"}}

    def array(self, name: str) -> Any:
        """Return all values of an array; raise ResultsError if it is damaged. Texts are returned as
        an array of str objects.
        """
        values = np.asarray(self._read(name, ...))
        return values if values.dtype.kind in "fiu" else np.array(list(map(str, values)), object)

    def _read(self, name: str, place: Any) -> Any:
        try:
            return self._array(name)[place]
        except DAMAGES as error:
            raise self._damaged(name) from error

    def values(self, run: int) -> Values:
        """Return the values of all factors of a run by name, with the types that they had in the
        run: text, int, float or lists of floats.
        """
        return {name: self._value(name, run) for name in self.names("factor")}

    def _value(self, name: str, run: int) -> Any:
        value, array = self._read(name, run), self._array(name)
        if array.dtype.kind not in "fiu":
            return str(value)
        plain = np.asarray(value).tolist()
        return int(plain) if array.attrs.get("whole") else plain

    @property
    def system(self) -> str:
        """Return the system as an argument of `harness run`: its name, or the path of its TOML as
        the file of the campaign gives it.
        """
        given = str(self.definition()[0].get("system", ""))
        return given if given.endswith(".toml") else self.about.system

    def plan(self) -> Plan:
        """Return the plan of the campaign, with the recorded sources."""
        return Plan(*self.definition(), self.about.sources)

    def definition(self) -> tuple[Mapping[str, Any], Path]:
        """Return the table of the campaign, and the folder of the files that the table names."""
        return json.loads(self.about.definition), Path(self.about.folder)

    # ---- bands

    def finish(self) -> None:
        """Compute the percentile bands of the recorded time series, and remove time series that
        were recorded for their bands only; raise ResultsError if the dataset cannot be written.
        """
        with naming(self.path):
            for name in self.names("history"):
                plain = name.removeprefix(SCRATCH)
                label = f"{plain}_band"
                if label not in self.group:
                    self._bands(self._array(name), plain)
                    # renamed only now, so that an interruption leaves no incomplete band
                    (self.path / (MAKING + label)).rename(self.path / label)
                if name.startswith(SCRATCH):
                    gone = (self.path / name).rename(self.path / (MAKING + name))
                    shutil.rmtree(gone)

    def _bands(self, source: Any, plain: str) -> None:
        """Compute the percentile bands of a time series (runs, rows, elements), and write them into
        a new array whose name has the prefix MAKING; plain: name of the variable.
        """
        if "percentile" not in self.group:
            self._lay_out(AXIS, self.block)
        _, rows, width = source.shape
        axes, shape = ("percentile", "time", f"{plain}_element"), (len(PERCENTILES), rows, width)
        about = {**source.attrs, "role": "band"}
        field = Field(f"{MAKING}{plain}_band", np.float64, shape, axes, about=about)
        band = self._lay_out(field, self.block)
        step = max(1, 4_000_000 // max(1, source.shape[0] * width))  # 32 MB at a time
        with warnings.catch_warnings():
            # numpy warns about rows that no run reached, which contain only NaN
            warnings.simplefilter("ignore", RuntimeWarning)
            for first in range(0, rows, step):
                part = np.asarray(source[:, first : first + step])
                band[:, first : first + step] = np.nanpercentile(part, PERCENTILES, axis=0)


def _columns(rows: Sequence[Row]) -> Columns:
    """Return the entries of consecutive runs, by name of the array, except for factors, time series
    and status. rows: results of the runs.
    """
    columns: dict[str, list[Any]] = {"message": [row.message for row in rows]}
    columns |= {"end_time": [row.time for row in rows], "last": [row.last for row in rows]}
    columns |= {name: [row.metrics[name] for row in rows] for name in rows[0].metrics}
    if rows[0].verdicts:
        columns |= {"verdict": [row.verdicts for row in rows]}
        columns |= {"margin": [row.margins for row in rows]}
    return columns


def reject_existing(path: Path) -> None:
    """Raise UsageError if the path of a new dataset already exists."""
    if path.exists():
        raise UsageError(f"{path}: already exists; continue with --resume, or remove it")
