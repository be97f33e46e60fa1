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
import tempfile
from contextlib import nullcontext
from pathlib import Path

from harness.errors import HarnessError, ResultsError, UsageError
from harness.files.output import new_beside, written
from harness.files.signals import held
from harness.results.formats import comma_separated, matlab, netcdf, parquet
from harness.results.formats.columns import sound
from harness.results.result import Result
from harness.system.graph import read_interfaces
from harness.system.model import Port, System


class ResultFile:
    """A results file that was found writable before the run. It appears whole or not at all."""

    def __init__(self, path: Path) -> None:
        """UsageError for an unknown ending, ResultsError if the file cannot be written there."""
        if path.suffix not in WRITERS:
            raise UsageError(
                f"{path}: results are written as {', '.join(WRITERS)}, not as "
                f"'{path.suffix or path.name}'"
            )
        self.path = path
        self._target = path.absolute()  # wherever an FMU may lead this process
        self.partial = path.with_name(f"{path.stem}.partial{path.suffix}")
        try:
            self._special = path.exists() and not path.is_file()
        except (OSError, ValueError) as error:  # a name that no file can have
            reason = getattr(error, "strerror", None) or str(error)
            raise ResultsError(f"{path}: cannot be written ({reason})") from error
        if path.is_dir():
            raise ResultsError(f"{path}: cannot be written, it is a folder")
        if path.exists() and not os.access(path, os.W_OK):
            raise ResultsError(f"{path}: cannot be written (no permission)")
        if not self._special:
            self._try()

    def _try(self) -> None:
        """Look whether the file can be written, without leaving anything behind."""
        folder = next(folder for folder in self.path.absolute().parents if folder.exists())
        if not folder.is_dir():
            raise ResultsError(f"{self.path}: cannot be written ({folder} is not a folder)")
        if not os.access(folder, os.W_OK):
            raise ResultsError(f"{self.path}: cannot be written (no permission for {folder})")
        if folder == self.path.absolute().parent:
            try:
                new_beside(self.path.absolute()).unlink(missing_ok=True)
            except OSError as error:
                raise ResultsError(f"{self.path}: cannot be written ({error.strerror})") from error

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
        except HarnessError as error:
            if not isinstance(error, ResultsError):  # a library is missing
                raise
            raise ResultsError(_failure(error, self.path)) from error
        except Exception as error:  # OSError, or what the libraries behind xarray and scipy raise
            raise ResultsError(_failure(error, self.path)) from error


def _failure(error: Exception, path: Path) -> str:
    cause = error.__cause__ if isinstance(error, ResultsError) and error.__cause__ else error
    reason = getattr(cause, "strerror", None) or " ".join(str(cause).split())
    return f"{path}: cannot be written ({reason or type(cause).__name__})"


def _rescued(result: Result, path: Path) -> Path | None:
    """Where a result was written that could not be written to its place."""
    elsewhere = Path(tempfile.gettempdir())
    for folder, ending in ((elsewhere, path.suffix), (path.parent, ".csv"), (elsewhere, ".csv")):
        try:
            number, name = tempfile.mkstemp(ending, f"{path.stem[:100]}-", folder)
        except OSError:
            continue
        os.close(number)
        try:
            with held():
                WRITERS[ending](result, Path(name))
        except Exception:  # the same failures as at its own place
            Path(name).unlink(missing_ok=True)
        else:
            return Path(name)
    return None


def read(file: str | Path) -> Result:
    """Read a results file written by the harness; ResultsError if it cannot be read.

    A .csv without the .toml beside it knows neither units nor parameters nor the name of the
    system, which is then the stem of the file.
    """
    path = Path(file)
    if path.suffix not in READERS:
        raise UsageError(f"{path}: only {', '.join(READERS)} can be read back")
    try:
        return sound(READERS[path.suffix](path))
    except HarnessError:  # a library is missing
        raise
    except Exception as error:  # OSError, or what the libraries behind xarray and numpy raise
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise ResultsError(f"{path}: cannot be read ({reason or type(error).__name__})") from error


WRITERS = {
    ".csv": comma_separated.write,
    ".nc": netcdf.write,
    ".mat": matlab.write,
    ".parquet": parquet.write,
}
READERS = {
    ".csv": comma_separated.read,
    ".nc": netcdf.read,
    ".mat": matlab.read,
    ".parquet": parquet.read,
}


def save(result: Result, path: str | Path) -> Path:
    """Write to .nc, .csv or .mat, an incomplete result to NAME.partial beside; UsageError,
    ResultsError. Returns where it is.
    """
    file = ResultFile(Path(path))
    if not result.complete:
        return Path(file.keep(result))
    file.write(result)
    return Path(path)
