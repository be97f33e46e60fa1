# SPDX-License-Identifier: BSD-2-Clause
"""Results files: .csv and .parquet (flat columns), .nc (netCDF4: vectors, units, long names) and
.mat (one struct per component).

All keep the parameters of the run and its provenance too. A .nc: as variables without time, and as
attributes; a .mat: in the structs `parameters` and `provenance`; a .csv, which stays a bare table
for whatever reads tables: in NAME.csv.toml beside it, with the units.

A run that ended early leaves a file NAME.partial.nc beside, so that a complete file is replaced by
complete ones only: .nc and .mat say `complete = 0`, a .csv ends with a line `# incomplete: reason`.
What cannot be written there is kept elsewhere.
"""

from __future__ import annotations

import os
import secrets
import tempfile
from contextlib import nullcontext, suppress
from pathlib import Path

from harness.errors import HarnessError, ResultsError, UsageError, reason_of
from harness.files.output import new_beside, written
from harness.files.signals import held
from harness.results.formats import comma_separated, matlab, netcdf, parquet, sound
from harness.results.result import Result
from harness.system.graph import read_interfaces
from harness.system.model import Port, System

FORMATS = {".csv": comma_separated, ".nc": netcdf, ".mat": matlab, ".parquet": parquet}
WRITERS = {ending: kind.write for ending, kind in FORMATS.items()}
READERS = {ending: kind.read for ending, kind in FORMATS.items()}


class ResultFile:
    """A results file that was found writable before the run. It appears whole or not at all."""

    def __init__(self, path: Path) -> None:
        """UsageError for an unknown ending, ResultsError if the file cannot be written there."""
        if path.suffix not in FORMATS:
            raise UsageError(
                f"{path}: results are written as {', '.join(FORMATS)}, not as "
                f"'{path.suffix or path.name}'"
            )
        self.path = path
        self._target = path.absolute()  # wherever an FMU may lead this process
        self.partial = path.with_name(f"{path.stem}.partial{path.suffix}")
        try:
            found = path.exists()
            self._special = found and not path.is_file()  # as a pipe
            if found and not os.access(path, os.W_OK):
                raise PermissionError("no permission")
            if not self._special:
                self._try()
        except (OSError, ValueError) as error:  # or a name that no file can have
            raise self._refused(reason_of(error)) from error
        if path.is_dir():
            raise ResultsError(f"{path}: cannot be written, it is a folder")

    def _refused(self, reason: str) -> ResultsError:
        return ResultsError(f"{self.path}: cannot be written ({reason})")

    def _try(self) -> None:
        """Write something beside, or into the folder where the folders will be, and remove it."""
        folder = next(folder for folder in self._target.parents if folder.exists())
        if not folder.is_dir():
            raise NotADirectoryError(f"{folder} is not a folder")
        new_beside(folder / self.path.name).unlink(missing_ok=True)

    def accept(self, system: System) -> None:
        """Look whether the file can hold the names of a system; ResultsError with those that it
        cannot.
        """
        if self.path.suffix != ".nc":
            return
        names = (
            str(Port(component, variable))
            for component, interface in read_interfaces(system).items()
            for variable in (*interface.outputs(), *interface.named("parameter"))
        )
        if bad := [name for name in names if not netcdf.fits(name)]:
            more = f" and {len(bad) - 3} more" if len(bad) > 3 else ""
            shown = ", ".join(repr(name[:80]) for name in bad[:3]) + more
            raise ResultsError(f"{self.path}: a .nc cannot hold {shown}: choose .csv or .mat")

    def write(self, result: Result) -> None:
        """Write the result of a complete run, in the place of an earlier partial one too.

        ResultsError if that fails; an earlier file is then left as it was, and the result is kept
        elsewhere if that is possible.
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

    def keep(self, result: Result) -> str:
        """Write the result of a run that ended early, beside the file; returns where it is.

        ResultsError if it can be written nowhere.
        """
        partial = self.path if self._special else self.partial
        try:
            self._write(result, self._target.with_name(partial.name))
        except ResultsError as error:
            if place := _rescued(result, self._target):
                return f"{place} ({error})"
            raise
        return str(partial)

    def _write(self, result: Result, path: Path) -> None:
        try:
            with held(), nullcontext(path) if self._special else written(path) as target:
                WRITERS[path.suffix](result, target)
            if path.suffix == ".csv" and not self._special:
                comma_separated.write_beside(result, path)
        except Exception as error:  # OSError, or what the libraries behind xarray and scipy raise
            if isinstance(error, HarnessError) and not isinstance(error, ResultsError):
                raise  # a library is missing
            cause = error.__cause__ if isinstance(error, ResultsError) else None
            raise self._refused(reason_of(cause or error)) from error


def _rescued(result: Result, path: Path) -> Path | None:
    """Where a result was written that could not be written to its place."""
    elsewhere = Path(tempfile.gettempdir())
    for folder, ending in ((elsewhere, path.suffix), (path.parent, ".csv"), (elsewhere, ".csv")):
        place = folder / f"{path.stem[:100]}-{secrets.token_hex(6)}{ending}"
        with suppress(Exception), written(place) as target:  # as at its own place
            WRITERS[ending](result, target)
        if place.exists():
            return place
    return None


def read(file: str | Path) -> Result:
    """Read a results file written by the harness; ResultsError if it cannot be read.

    A .csv without the .toml beside it knows neither units nor parameters nor the name of the
    system, which is then the stem of the file.
    """
    path = Path(file)
    if path.suffix not in FORMATS:
        raise UsageError(f"{path}: only {', '.join(FORMATS)} can be read back")
    try:
        return sound(READERS[path.suffix](path))
    except HarnessError:  # a library is missing
        raise
    except Exception as error:  # OSError, or what the libraries behind xarray and numpy raise
        raise ResultsError(f"{path}: cannot be read ({reason_of(error)})") from error


def save(result: Result, path: str | Path) -> Path:
    """Write to .nc, .csv or .mat, an incomplete result to NAME.partial beside; UsageError,
    ResultsError. Returns where it is.
    """
    file = ResultFile(Path(path))
    if not result.complete:
        return Path(file.keep(result))
    file.write(result)
    return Path(path)
