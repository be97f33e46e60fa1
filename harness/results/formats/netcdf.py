# SPDX-License-Identifier: BSD-2-Clause
"""netCDF4 format: variables with axes, units and long names; parameters are variables without time,
provenance is in attributes.
"""

from __future__ import annotations

import os
import re
import unicodedata
from collections.abc import Iterable, Mapping
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from harness.results import provenance
from harness.results.result import (
    ELEMENTS,
    PROVENANCE,
    Array,
    Result,
    attributes,
    element_names,
    labelled,
    time_labels,
)

PACKED = 1000
"""Number of values of a variable above which it is compressed, without loss."""


def fits(name: str) -> bool:
    """Return whether a netCDF file can store a name unchanged. The library changes a name that is
    not in Unicode's composed form NFC.
    """
    as_it_is = unicodedata.is_normalized("NFC", name) and len(name) <= 200
    return as_it_is and _NAME.fullmatch(name) is not None


_NAME = re.compile(r"((?a:\w)|[^\x00-\x7f])[^/\x00-\x1f\x7f]*(?<! )")
"""Regular expression of the names that netCDF accepts."""


def write(result: Result, path: Path) -> None:
    """Write the file. All variables are defined before the first is filled, because each switch
    between defining and filling takes time in proportion to the number of variables so far.
    """
    import netCDF4

    about, content = attributes(result), labelled(result)
    of_variables = (each.values() for *_, each in content.values())
    _check_nul(chain(content, about.values(), *of_variables))
    with netCDF4.Dataset(path, "w") as file:
        file.setncatts(about)
        content["time"] = (("time",), result.time, time_labels(result))
        defined = [(_defined(file, name, *each), each[1]) for name, each in content.items()]
        file.set_auto_maskandscale(False)  # without masking and scaling: a third less time
        for variable, data in defined:
            variable[...] = data


def _check_nul(texts: Iterable[object]) -> None:
    """Raise ValueError for a text with the character NUL: the library would store the text only up
    to it.
    """
    for text in texts:
        if "\0" in str(text):
            raise ValueError(
                f"a text contains a NUL character, which this format cannot store: {text!r}"
            )


def _defined(
    file: Any, name: str, axes: tuple[str, ...], data: Array, about: dict[str, str]
) -> Any:
    """Return a new variable of a netCDF file with its dimensions and attributes."""
    for axis, size in zip(axes, data.shape, strict=True):
        if axis not in file.dimensions:
            file.createDimension(axis, size)
    packed = {"zlib": True, "complevel": 1, "shuffle": True} if data.size > PACKED else {}
    variable = file.createVariable(name, "f8", axes, fill_value=False, **packed)
    variable.setncatts(about)
    return variable


def read(path: Path) -> Result:
    """Read the file; a variable without a time axis is a parameter."""
    import netCDF4

    histories, fixed = {}, {}
    with netCDF4.Dataset(path) as file:
        file.set_auto_mask(False)
        _check_size(sum(8 * v.size for v in file.variables.values()), path.stat().st_size)
        about = {name: file.getncattr(name) for name in file.ncattrs()}
        time = _values("time", file["time"])
        for name, variable in file.variables.items():
            data, notes = _values(name, variable), vars(variable)
            if variable.dimensions[:1] == ("time",) and name != "time":
                histories[name] = (data, notes)
            elif name != "time":
                fixed[name] = (data[None], notes)
    origin = {n.removeprefix(PROVENANCE): v for n, v in about.items() if n.startswith(PROVENANCE)}
    system = about.get("system", path.stem)
    return replace(
        _flat_columns(system, time, histories),
        complete=bool(about.get("complete", 1)),
        message=about.get("message", ""),
        parameters=_flat_columns(system, time[:1], fixed) if fixed else None,
        provenance=provenance.from_flat(origin) if origin else None,
    )


def _values(name: str, variable: Any) -> Array:
    """Return the values of a variable, NaN where the file declares a value as missing (CF
    conventions).
    """
    if not {"_FillValue", "missing_value"} & {*variable.ncattrs()}:
        return _numbers(name, variable[...])
    variable.set_auto_mask(True)
    found = np.ma.asanyarray(variable[...])
    return np.where(np.ma.getmaskarray(found), np.nan, _numbers(name, found.data))


def _flat_columns(
    system: str, time: Array, histories: Mapping[str, tuple[Array, Mapping[str, str]]]
) -> Result:
    """Return a result with variables as flat columns, one column per element: the inverse of
    harness.results.result.variables(). histories: by name of the variable, its values (rows, ...)
    and attributes.
    """
    columns, blocks, units, descriptions, modes = [], [np.empty((len(time), 0))], [], [], []
    for name, (values, about) in histories.items():
        given = about.get(ELEMENTS)
        if len(values) != len(time):
            raise ValueError(f"{name}: {len(values)} rows instead of {len(time)}")
        names = _from_lines(given) if given else element_names(name, values.shape[1:])
        columns += names
        blocks.append(values.reshape(len(values), -1))
        units += [about.get("units", "")] * len(names)
        descriptions += [about.get("long_name", "")] * len(names)
        modes += [about.get("modes", "")] * len(names)
    values, texts = np.hstack(blocks), tuple(descriptions)
    return Result(system, time, tuple(columns), tuple(units), values, texts, modes=tuple(modes))


def _from_lines(text: str) -> list[str]:
    """Return the names in a text from in_lines(): one name per line, in which each backslash and
    newline is escaped by a backslash.
    """
    return [_ESCAPED.sub(lambda m: _MEANT[m[0]], line) for line in text.split("\n")]


_MEANT = {r"\\": "\\", r"\n": "\n"}
_ESCAPED = re.compile(r"\\[\\n]")


# ---- size


RATIO = 1100
"""Largest plausible ratio of unpacked to packed size: zlib reaches 1032."""
SMALL = 64 * 1024**2
"""Unpacked size [bytes] up to which no file is rejected."""


def _check_size(unpacked: int, packed: int) -> None:
    """Raise ValueError if the unpacked numbers [bytes] exceed half of the memory of this machine,
    or are more than a file of `packed` bytes can plausibly contain.
    """
    if unpacked > SMALL and unpacked > _memory() / 2:
        raise ValueError(
            f"it unpacks to {_size(unpacked)}, more than half of the memory of this machine"
        )
    if unpacked > max(SMALL, RATIO * packed):
        raise ValueError(
            f"the file of {_size(packed)} unpacks to {_size(unpacked)}, which cannot be a result"
        )


def _memory() -> int:
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # the machine does not state its memory
        return 16 * 1024**3


def _size(count: int) -> str:
    return f"{count / 1e9:.3g} GB" if count >= 1e8 else f"{count / 1e3:.3g} kB"


def _numbers(name: str, values: Any) -> Array:
    """Return values of a file as an array of doubles; raise ValueError if they are not numbers.
    name: of the variable, for the error.
    """
    array = np.asarray(values)
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{name}: expected numbers, found the type {array.dtype}")
    return array.astype(np.float64, copy=False)
