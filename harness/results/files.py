# SPDX-License-Identifier: BSD-2-Clause
"""Results files: .csv (flat columns), and .nc (netCDF4: vectors, units, long names).

Both formats also store the parameters of the run and its provenance. A .nc stores parameters as
variables without time and provenance as attributes. A .csv is a plain table for any reader of
tables, so parameters, provenance and units are in a file NAME.csv.toml in the same folder.

A run that ended early is written to NAME.partial.nc beside NAME.nc, so that only a complete run
replaces a complete file. A partial .nc has `complete = 0`, a .csv ends with a line `# incomplete:
reason`. If a file cannot be written in its place, the result is written to the folder for temporary
files, or as .csv.
"""

from __future__ import annotations

import os
import secrets
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from pathlib import Path

import numpy as np

from harness.errors import ResultsError, UsageError, reason_of
from harness.files.output import new_beside, written
from harness.files.signals import held
from harness.results.formats import comma_separated, netcdf
from harness.results.result import Result
from harness.spelling import some
from harness.system.graph import read_interfaces
from harness.system.model import Port, System

FORMATS = {".csv": comma_separated, ".nc": netcdf}


class ResultFile:
    """Results file that is checked before the run to be writable. If writing fails, no incomplete
    file remains.
    """

    def __init__(self, path: Path) -> None:
        """Prepare the file; raise UsageError for an unknown ending, ResultsError if the file cannot
        be written there.
        """
        if path.suffix not in FORMATS:
            raise UsageError(
                f"{path}: results are written as {', '.join(FORMATS)}, not as "
                f"'{path.suffix or path.name}'"
            )
        self.path = path
        self._target = path.absolute()  # an FMU may change the working directory
        self.partial = path.with_name(f"{path.stem}.partial{path.suffix}")
        try:
            found = path.exists()
            self._special = found and not path.is_file()  # such as a pipe or device
            if found and not os.access(path, os.W_OK):
                raise PermissionError("no permission")
            if not self._special:
                self._try()
        except (OSError, ValueError) as error:  # ValueError: an impossible file name
            raise self._unwritable(reason_of(error)) from error
        if path.is_dir():
            raise ResultsError(
                f"{path}: is a folder; give the name of a file, such as {path / 'results.nc'}"
            )

    def _unwritable(self, reason: str) -> ResultsError:
        return ResultsError(f"{self.path}: cannot be written ({reason})")

    def _try(self) -> None:
        """Check that the nearest existing folder is writable: create a file in it and remove the
        file.
        """
        folder = next(folder for folder in self._target.parents if folder.exists())
        if not folder.is_dir():
            raise NotADirectoryError(f"{folder} is not a folder")
        new_beside(folder / self.path.name).unlink(missing_ok=True)

    def accept(self, system: System) -> None:
        """Check that the file can store the names of a system; raise ResultsError with the names
        that it cannot store.
        """
        if self.path.suffix != ".nc":
            return
        names = (
            str(Port(component, variable))
            for component, interface in read_interfaces(system).items()
            for variable in (*interface.outputs(), *interface.named("parameter"))
        )
        if bad := [name for name in names if not netcdf.fits(name)]:
            shown = some([repr(name[:80]) for name in bad])
            raise ResultsError(f"{self.path}: a .nc cannot store the names {shown}; choose .csv")

    def write(self, result: Result) -> None:
        """Write the result of a complete run, and remove the partial file of an earlier run.

        Raises ResultsError on failure. An earlier file then stays unchanged, except a .csv if only
        its NAME.csv.toml cannot be written, and the result is stored elsewhere if possible.
        """
        try:
            self._write(result, self._target)
        except ResultsError as error:
            if place := _rescued(result, self._target):
                raise ResultsError(f"{error}; the results are in {place}") from error
            raise
        if not self._special:
            partial = self._target.with_name(self.partial.name)
            partial.unlink(missing_ok=True)
            comma_separated.beside(partial).unlink(missing_ok=True)

    def write_partial(self, result: Result) -> tuple[Path, ResultsError | None]:
        """Write the result of a run that ended early to the partial file, and return its path and
        None. If that file cannot be written, write one in the folder for temporary files or a .csv
        beside it, and return the path of this file and the error.

        Raises ResultsError if the result cannot be stored anywhere.
        """
        partial = self.path if self._special else self.partial
        try:
            self._write(result, self._target.with_name(partial.name))
        except ResultsError as error:
            if place := _rescued(result, self._target):
                return place, error
            raise
        return partial, None

    def _write(self, result: Result, path: Path) -> None:
        try:
            with held(), nullcontext(path) if self._special else written(path) as target:
                FORMATS[path.suffix].write(result, target)
            if path.suffix == ".csv" and not self._special:
                comma_separated.write_beside(result, path)
        except Exception as error:  # OSError, or what the libraries of a format raise
            cause = error.__cause__ if isinstance(error, ResultsError) else None
            raise self._unwritable(reason_of(cause or error)) from error


def _rescued(result: Result, path: Path) -> Path | None:
    """Write a result that could not be written to `path` to the folder for temporary files, or else
    as .csv beside `path`, or else as .csv in the folder for temporary files. Return the path of the
    written file, None if all three failed.
    """
    elsewhere = Path(tempfile.gettempdir())
    for folder, ending in ((elsewhere, path.suffix), (path.parent, ".csv"), (elsewhere, ".csv")):
        place = folder / f"{path.stem[:100]}-{secrets.token_hex(6)}{ending}"
        with suppress(Exception), written(place) as target:  # the caller reports its own error
            FORMATS[ending].write(result, target)
        if place.exists():
            return place
    return None


def read(file: str | Path) -> Result:
    """Read a results file written by the harness; raise UsageError for an unknown ending,
    ResultsError if the file cannot be read.

    For a .csv without its NAME.csv.toml, the result has no units and no parameters, and the name of
    the system is the file name without its ending.
    """
    path = Path(file)
    if path.suffix not in FORMATS:
        raise UsageError(f"{path}: expected a results file ({', '.join(FORMATS)})")
    try:
        return _sound(FORMATS[path.suffix].read(path))
    except Exception as error:  # OSError, or what the libraries of a format raise
        raise ResultsError(f"{path}: cannot be read ({reason_of(error)})") from error


def save(result: Result, path: str | Path) -> Path:
    """Write a result to a .nc or .csv file and return its path. An incomplete result is written to
    NAME.partial.nc or NAME.partial.csv in the same folder. Raises UsageError, ResultsError.
    """
    file = ResultFile(Path(path))
    if not result.complete:
        return file.write_partial(result)[0]
    file.write(result)
    return Path(path)


# ---- checks of a result that was read from a file


def _sound(result: Result) -> Result:
    """Return a result that was read from a file unchanged if it is consistent; else raise
    ValueError with its first fault.
    """
    for problem in _problems(result):
        raise ValueError(problem)
    return result


def _problems(result: Result) -> Iterator[str]:
    if result.time.ndim != 1:
        size = " x ".join(map(str, result.time.shape))
        yield f"time: expected one value per row, got an array of {size}"
    if not len(result.time):
        yield "the file contains no rows"
    if not (finite := np.isfinite(result.time)).all():
        yield f"row {np.argmin(finite)} has the time {result.time[~finite][0]}, not finite"
    if (np.diff(result.time) < 0).any():
        yield f"row {np.argmax(np.diff(result.time) < 0) + 1} is earlier than the one before"
    for name, text in (("system", result.system), ("message", result.message)):
        if not isinstance(text, str):
            yield f"{name}: expected a text, got {text!r:.40}"
    yield from _faults(result, len(result.time), "variable")
    if result.parameters is not None:
        yield from _faults(result.parameters, 1, "parameter")


def _faults(table: Result, rows: int, kind: str) -> Iterator[str]:
    """Yield the faults of the columns, units and values of a table that should have `rows` rows."""
    width = len(table.columns)
    if table.values.shape != (rows, width):
        yield f"{kind}s: expected {rows} rows of {width} values, got {table.values.shape}"
    if twice := [name for name, times in Counter(table.columns).items() if times > 1]:
        yield f"{kind} {twice[0]} occurs twice"
    given = {"unit": table.units, "description": table.descriptions, "mode": table.modes}
    for about, texts in given.items():
        for name, text in zip(table.columns, texts, strict=False):
            if not isinstance(text, str):
                yield f"{about} of {kind} {name}: expected a text, got {text!r:.40}"
