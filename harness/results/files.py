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

import csv
import json
import os
import re
import tempfile
import unicodedata
from collections.abc import Collection, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError, ResultsError, UsageError
from harness.files.libraries import library
from harness.files.output import new_beside, written
from harness.files.signals import held
from harness.results import sidecar
from harness.results.provenance import Provenance, flat, from_flat
from harness.results.result import Result
from harness.results.variables import ELEMENTS, PROVENANCE, attributes, element_names, variables
from harness.system.graph import read_interfaces
from harness.system.model import Port, System

INCOMPLETE = "# incomplete: "
PACKED = 1000
"""Values from which a variable of a .nc is compressed, without loss."""

LONGEST_LINE = 64 * 1024**2
"""Characters of a line of a .csv."""


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
                new_beside(self.path.absolute()).unlink()
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
        if bad := [name for name in names if not _fits_netcdf(name)]:
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
                raise ResultsError(f"{error}; the results are kept in {place}") from error
            raise
        if not self._special:
            partial = self._target.with_name(self.partial.name)
            partial.unlink(missing_ok=True)
            sidecar.place(partial).unlink(missing_ok=True)

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
                sidecar.write(result, path)
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


def _fits_netcdf(name: str) -> bool:
    """Whether a netCDF file keeps a name as it is: it composes characters (NFC)."""
    as_it_is = unicodedata.is_normalized("NFC", name) and len(name) <= 200
    return as_it_is and _NETCDF_NAME.fullmatch(name) is not None


_NETCDF_NAME = re.compile(r"[\w\u0080-\U0010ffff][^/\x00-\x1f\x7f]*(?<! )")
"""Names that a netCDF file can have, of at most 256 bytes."""


def read(file: str | Path) -> Result:
    """Read a results file written by the harness; ResultsError if it cannot be read.

    A .csv without the .toml beside it knows neither units nor parameters nor the name of the
    system, which is then the stem of the file.
    """
    path = Path(file)
    if path.suffix not in READERS:
        raise UsageError(f"{path}: only {', '.join(READERS)} can be read back")
    try:
        return READERS[path.suffix](path)
    except HarnessError:  # a library is missing
        raise
    except Exception as error:  # OSError, or what the libraries behind xarray and numpy raise
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise ResultsError(f"{path}: cannot be read ({reason})") from error


# ---- .csv


def _write_csv(result: Result, path: Path) -> None:
    with path.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerow(("time", *result.columns))
        table = np.column_stack((result.time, result.values))
        for row in table:  # repr is the shortest text that reads back as the same number
            file.write(",".join(map(repr, row.tolist())) + "\n")
        if not result.complete:
            file.write(f"{INCOMPLETE}{result.message}\n")


def _lines(file: TextIO) -> Iterator[str]:
    """Lines of a file; ValueError if one does not end, as those of a device."""
    while line := file.readline(LONGEST_LINE):
        if len(line) == LONGEST_LINE:
            raise ValueError(f"a line is longer than {LONGEST_LINE} characters")
        yield line


def _read_csv(path: Path) -> Result:
    with path.open(newline="") as file:
        names = next(csv.reader(_lines(file)), [])
        if not names or names[0] != "time":
            raise ValueError("it does not begin with a column named time")
        table = np.loadtxt(file, delimiter=",", ndmin=2)
        reason = _last_line(file).partition(INCOMPLETE)
    if table.shape[1] != len(names):
        raise ValueError(f"{len(names)} names for {table.shape[1]} columns")
    units = ("",) * (len(names) - 1)
    result = Result(
        path.stem,
        table[:, 0],
        tuple(names[1:]),
        units,
        table[:, 1:],
        (),
        not reason[1],
        reason[2].strip(),
    )
    return sidecar.completed(result, path)


def _last_line(file: TextIO) -> str:
    file.seek(0, os.SEEK_END)
    file.seek(max(0, file.tell() - 10_000))
    lines = file.read().splitlines()
    return lines[-1] if lines else ""


# ---- .nc


def _write_nc(result: Result, path: Path) -> None:
    """All variables are defined before the first is filled: each change from the one to the other
    costs as much as all variables so far.
    """
    import netCDF4

    time = {"units": "s", "long_name": "time"}
    content = {
        name: (axes, data[0], about) for name, axes, data, about in variables(result.parameters)
    }
    content |= {
        name: (("time", *axes), data, about) for name, axes, data, about in variables(result)
    }
    with netCDF4.Dataset(path, "w") as file:
        file.setncatts(attributes(result))
        content["time"] = (("time",), result.time, time)
        defined = [(_defined(file, name, *each), each[1]) for name, each in content.items()]
        for variable, data in defined:
            variable[...] = data


def _defined(
    file: Any, name: str, axes: tuple[str, ...], data: NDArray[np.float64], about: dict[str, str]
) -> Any:
    """A new variable of a netCDF file, its dimensions and its attributes."""
    for axis, size in zip(axes, data.shape, strict=True):
        if axis not in file.dimensions:
            file.createDimension(axis, size)
    packed = {"zlib": True, "complevel": 1, "shuffle": True} if data.size > PACKED else {}
    variable = file.createVariable(name, "f8", axes, fill_value=False, **packed)
    variable.setncatts(about)
    return variable


def _read_nc(path: Path) -> Result:
    import netCDF4

    histories, fixed = {}, {}
    with netCDF4.Dataset(path) as file:
        file.set_auto_mask(False)
        about = {name: file.getncattr(name) for name in file.ncattrs()}
        time = file["time"][...]
        for name, variable in file.variables.items():
            data, notes = np.asarray(variable[...]), vars(variable)
            if "time" in variable.dimensions and name != "time":
                histories[name] = (data, notes)
            elif name != "time":
                fixed[name] = (data[None], notes)
    system = about.get("system", path.stem)
    parameters = _table(system, time[:1], fixed) if fixed else None
    complete, message = bool(about.get("complete", 1)), about.get("message", "")
    return replace(
        _table(system, time, histories),
        complete=complete,
        message=message,
        parameters=parameters,
        provenance=_provenance(about),
    )


def _provenance(about: Mapping[str, Any]) -> Provenance | None:
    found = {n.removeprefix(PROVENANCE): v for n, v in about.items() if n.startswith(PROVENANCE)}
    return from_flat(found) if found else None


def _table(
    system: str,
    time: NDArray[np.float64],
    histories: Mapping[str, tuple[NDArray[np.float64], Mapping[str, str]]],
) -> Result:
    """Variables with their attributes as flat columns."""
    columns, blocks, units, descriptions = [], [np.empty((len(time), 0))], [], []
    for name, (values, about) in histories.items():
        given = about.get(ELEMENTS)
        names = given.split("\n") if given else element_names(name, values.shape[1:])
        columns += names
        blocks.append(values.reshape(len(values), -1))
        units += [about.get("units", "")] * len(names)
        descriptions += [about.get("long_name", "")] * len(names)
    return Result(
        system, time, tuple(columns), tuple(units), np.hstack(blocks), tuple(descriptions)
    )


# ---- .mat


def _write_mat(result: Result, path: Path) -> None:
    import scipy.io

    content: dict[str, Any] = {
        "time": result.time,
        "system": result.system,
        "complete": float(result.complete),
        "message": result.message,
    }
    told: dict[str, Any] = {name: {} for name in (*TOLD, *(f"parameter_{n}" for n in TOLD))}
    fixed: dict[str, Any] = {}
    for table, place, prefix in ((result, content, ""), (result.parameters, fixed, "parameter_")):
        for name, _, values, about in variables(table):
            component, variable = _place(place, name)
            place[component][variable] = values if table is result else values[0]
            columns = about.get(ELEMENTS) or "\n".join(element_names(name, values.shape[1:]))
            for kind, text in zip(TOLD, (about["units"], about["long_name"], columns), strict=True):
                told[prefix + kind].setdefault(component, {})[variable] = text
    content |= told | {"parameters": fixed}
    if result.provenance is not None:
        content["provenance"] = flat(result.provenance)
    scipy.io.savemat(path, content, long_field_names=True, oned_as="column", do_compression=True)


TOLD = ("units", "descriptions", "columns")
"""Structs of a .mat with texts about its variables; those of parameters begin with `parameter_`."""


def _read_mat(path: Path) -> Result:
    import scipy.io

    with path.open("rb") as file:
        content = scipy.io.loadmat(file, simplify_cells=True)
    time = np.atleast_1d(np.asarray(content["time"], dtype=np.float64))
    histories = {n: v for n, v in content.items() if n not in RESERVED and isinstance(v, dict)}
    system = str(content["system"])
    fixed, origin = content.get("parameters") or {}, content.get("provenance")
    parameters = _told(system, time[:1], fixed, content, "parameter_") if len(fixed) else None
    return replace(
        _told(system, time, histories, content, ""),
        complete=bool(content.get("complete", 1)),
        message=_text(content.get("message", "")),
        parameters=parameters,
        provenance=None if origin is None else from_flat(origin),
    )


def _told(
    system: str,
    time: NDArray[np.float64],
    structs: Mapping[str, Mapping[str, Any]],
    content: Mapping[str, Any],
    prefix: str,
) -> Result:
    """Structs of components with what is told about their fields."""
    found: dict[str, tuple[NDArray[np.float64], dict[str, str]]] = {}
    units, descriptions, columns = (content.get(prefix + kind, {}) for kind in TOLD)
    for component, fields in structs.items():
        for field, values in fields.items():
            array = np.asarray(values, dtype=np.float64).reshape(len(time), -1)
            name = f"{component}.{field}"
            about = {
                "units": _text(units.get(component, {}).get(field, "")),
                "long_name": _text(descriptions.get(component, {}).get(field, "")),
                ELEMENTS: _text(columns.get(component, {}).get(field, "")),
            }
            found[name] = (array if about[ELEMENTS] or array.shape[1] > 1 else array[:, 0], about)
    return _table(system, time, found)


def _text(value: Any) -> str:
    """A text of a .mat, where an empty one is an empty array."""
    return value if isinstance(value, str) else ""


def _place(content: dict[str, Any], name: str) -> tuple[str, str]:
    """Struct of the component and field of the variable, in names that MATLAB accepts."""
    component, _, variable = name.partition(".")
    component = _legal(component, RESERVED)
    return component, _legal(variable, content.setdefault(component, {}))


RESERVED = (
    *("time", "system", "complete", "message", "parameters", "provenance"),
    *TOLD,
    *(f"parameter_{name}" for name in TOLD),
)
"""Names in a .mat that are no component."""


def _legal(name: str, taken: Collection[str]) -> str:
    """A name that MATLAB accepts (letters, digits, underscores, a letter first, at most 63) and
    that is not taken.
    """
    legal = re.sub(r"\W", "_", name, flags=re.ASCII)[:60]
    if not legal[:1].isalpha():
        legal = f"x_{legal}"[:60]
    while legal in taken:
        legal += "_"
    return legal


# ---- .parquet

ABOUT = b"servicing-fmus"
"""Key of the metadata of a .parquet with what is no column."""


def _write_parquet(result: Result, path: Path) -> None:
    arrow, parquet = library("pyarrow", "exchange"), library("pyarrow.parquet", "exchange")
    fields = [arrow.field("time", arrow.float64(), metadata={"units": "s"})]
    descriptions = result.descriptions or ("",) * len(result.columns)
    for name, unit, text in zip(result.columns, result.units, descriptions, strict=True):
        about = {"units": unit, "long_name": text}
        fields.append(arrow.field(name, arrow.float64(), metadata=about))
    whole = json.dumps(sidecar.content(result))
    schema = arrow.schema(fields, metadata={ABOUT: whole.encode()})
    columns = [arrow.array(column) for column in (result.time, *result.values.T)]
    parquet.write_table(arrow.table(columns, schema=schema), path, compression="zstd")


def _read_parquet(path: Path) -> Result:
    with path.open("rb") as file:
        table = library("pyarrow.parquet", "exchange").read_table(file)
    names = tuple(table.column_names)
    if names[:1] != ("time",):
        raise ValueError("it does not begin with a column named time")
    values = np.column_stack([table.column(i).to_numpy() for i in range(len(names))])
    units = ("",) * (len(names) - 1)
    result = Result(path.stem, values[:, 0], names[1:], units, np.ascontiguousarray(values[:, 1:]))
    about = json.loads((table.schema.metadata or {}).get(ABOUT, b"null"))
    if about is None:
        return result
    complete, message = about.get("complete", True), about.get("message", "")
    return replace(sidecar.told(result, about), complete=complete, message=message)


WRITERS = {
    ".csv": _write_csv,
    ".nc": _write_nc,
    ".mat": _write_mat,
    ".parquet": _write_parquet,
}
READERS = {".csv": _read_csv, ".nc": _read_nc, ".mat": _read_mat, ".parquet": _read_parquet}
