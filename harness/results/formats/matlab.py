# SPDX-License-Identifier: BSD-2-Clause
"""A .mat: one struct per component, `parameters` and `provenance` beside them."""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.results.formats.columns import flat_columns, numbers, refuse_nul, refuse_size
from harness.results.provenance import flat, from_flat
from harness.results.result import Result
from harness.results.variables import ELEMENTS, element_names, in_lines, variables


def write(result: Result, path: Path) -> None:
    """Write the file, in names that MATLAB accepts."""
    import scipy.io

    refuse_nul(result)
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
            columns = about.get(ELEMENTS) or in_lines(element_names(name, values.shape[1:]))
            for kind, text in zip(TOLD, (about["units"], about["long_name"], columns), strict=True):
                told[prefix + kind].setdefault(component, {})[variable] = text
    content |= told | {"parameters": fixed}
    if result.provenance is not None:
        content["provenance"] = flat(result.provenance)
    scipy.io.savemat(path, content, long_field_names=True, oned_as="column", do_compression=True)


TOLD = ("units", "descriptions", "columns")
"""Structs of a .mat with texts about its variables; those of parameters begin with `parameter_`."""


def read(path: Path) -> Result:
    """Read the file; every struct that is not RESERVED is a component."""
    import scipy.io

    refuse_size(unpacked(path))
    with path.open("rb") as file:
        content = scipy.io.loadmat(file, simplify_cells=True)
    if missing := {"time", "system"} - content.keys():
        raise ValueError(f"it does not hold {' and '.join(sorted(missing))}")
    time = np.atleast_1d(numbers("time", content["time"]))
    histories = {n: v for n, v in content.items() if n not in RESERVED and isinstance(v, dict)}
    system = str(content["system"])
    fixed, origin = (_struct(content, name) for name in ("parameters", "provenance"))
    parameters = _told(system, time[:1], fixed, content, "parameter_") if fixed else None
    return replace(
        _told(system, time, histories, content, ""),
        complete=bool(content.get("complete", 1)),
        message=_text(content.get("message", "")),
        parameters=parameters,
        provenance=from_flat(origin) if origin else None,
    )


def unpacked(path: Path) -> int:
    """Bytes of the variables of a .mat, without keeping them."""
    total = 0
    with path.open("rb") as file:
        file.seek(128)
        while len(tag := file.read(8)) == 8:
            kind, size = struct.unpack("<II", tag)
            if kind != COMPRESSED:
                total += size
                file.seek(size, os.SEEK_CUR)
                continue
            total += _inflated(file.read(size))
    return total


COMPRESSED = 15
"""Type miCOMPRESSED of an element (MAT-File Format, level 5)."""


def _inflated(data: bytes) -> int:
    inflate, size = zlib.decompressobj(), 0
    while data and not inflate.eof:
        size += len(inflate.decompress(data, 1 << 20))
        data = inflate.unconsumed_tail
    return size


def _struct(content: Mapping[str, Any], name: str) -> dict[str, Any]:
    """A struct of a .mat; {} if there is none, or an empty array in its place."""
    found = content.get(name, {})
    if isinstance(found, dict):
        return found
    if np.size(found):
        raise ValueError(f"{name}: expected a struct, got {type(found).__name__}")
    return {}


def _told(
    system: str,
    time: NDArray[np.float64],
    structs: Mapping[str, Mapping[str, Any]],
    content: Mapping[str, Any],
    prefix: str,
) -> Result:
    """Structs of components with what is told about their fields."""
    found: dict[str, tuple[NDArray[np.float64], dict[str, str]]] = {}
    units, descriptions, columns = (_struct(content, prefix + kind) for kind in TOLD)
    for component, fields in structs.items():
        if not isinstance(fields, dict):
            raise ValueError(f"{component}: expected a struct, got {type(fields).__name__}")
        for field, values in fields.items():
            array = numbers(f"{component}.{field}", values).reshape(len(time), -1)
            name = f"{component}.{field}"
            about = {
                "units": _text(_struct(units, component).get(field, "")),
                "long_name": _text(_struct(descriptions, component).get(field, "")),
                ELEMENTS: _text(_struct(columns, component).get(field, "")),
            }
            found[name] = (array if about[ELEMENTS] or array.shape[1] > 1 else array[:, 0], about)
    return flat_columns(system, time, found)


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
