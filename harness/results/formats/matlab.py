# SPDX-License-Identifier: BSD-2-Clause
"""MATLAB format: one struct per component, and the structs `parameters` and `provenance`."""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from harness.results.formats import check_nul, check_size, numbers, restored
from harness.results.provenance import flat
from harness.results.result import ELEMENTS, Array, Result, element_names, in_lines, variables

ATTRIBUTES = {
    "units": "units", "long_name": "descriptions", "modes": "modes", ELEMENTS: "columns"
}  # fmt: skip
"""Names of the structs in a .mat with texts about its variables, by attribute of the variable."""
OF_FIXED = "parameter_"
"""Prefix of the names of these structs for texts about parameters."""
STRUCTS = tuple(begin + name for begin in ("", OF_FIXED) for name in ATTRIBUTES.values())
RESERVED = ("time", "system", "complete", "message", "parameters", "provenance", *STRUCTS)
"""Names of variables in a .mat that contain no component."""


def write(result: Result, path: Path) -> None:
    """Write the file, in names that MATLAB accepts."""
    import scipy.io

    check_nul(result)
    content: dict[str, Any] = {
        "time": result.time,
        "system": result.system,
        "complete": float(result.complete),
        "message": result.message,
        **_structs(result),
    }
    if result.provenance is not None:
        content["provenance"] = flat(result.provenance)
    scipy.io.savemat(path, content, long_field_names=True, oned_as="column", do_compression=True)


def _structs(result: Result) -> dict[str, Any]:
    """Return the structs of a result: one per component, those with attributes of variables and
    parameters, and `parameters`.
    """
    described: dict[str, Any] = {name: {} for name in STRUCTS}
    found: dict[str, Any] = {}
    fixed: dict[str, Any] = {}
    for table, place, begin in ((result, found, ""), (result.parameters, fixed, OF_FIXED)):
        for name, values, about in _described(table):
            component, variable = _place(place, name)
            place[component][variable] = values if table is result else values[0]
            for attribute, kind in ATTRIBUTES.items():
                described[begin + kind].setdefault(component, {})[variable] = about[attribute]
    return {**found, **described, "parameters": fixed}


def _described(table: Result | None) -> Iterator[tuple[str, Array, dict[str, str]]]:
    """Yield the variables of a table with values and attributes, including the names of their
    elements.
    """
    for name, _, values, about in variables(table):
        elements = in_lines(element_names(name, values.shape[1:]))
        yield name, values, {ELEMENTS: elements, "modes": "", **about}


def read(path: Path) -> Result:
    """Read the file; every struct that is not RESERVED is a component."""
    import scipy.io

    check_size(unpacked(path))
    with path.open("rb") as file:
        content = scipy.io.loadmat(file, simplify_cells=True)
    if missing := {"time", "system"} - content.keys():
        raise ValueError(f"variables are missing: {' and '.join(sorted(missing))}")
    time = np.atleast_1d(numbers("time", content["time"]))
    histories = {n: v for n, v in content.items() if n not in RESERVED and isinstance(v, dict)}
    fixed, origin = (_struct(content, name) for name in ("parameters", "provenance"))
    described = {"system": str(content["system"]), "message": _text(content.get("message", ""))}
    return restored(
        content | described,
        time,
        _variables(len(time), histories, content, ""),
        _variables(1, fixed, content, OF_FIXED),
        origin,
    )


def unpacked(path: Path) -> int:
    """Return the size [bytes] of the uncompressed variables of a .mat. They are decompressed piece
    by piece and never held in memory as a whole.
    """
    total = 0
    with path.open("rb") as file:
        file.seek(128)
        while len(tag := file.read(8)) == 8:
            kind, size = struct.unpack("<II", tag)
            if kind == COMPRESSED:
                total += _inflated(file.read(size))
            else:
                total += size
                file.seek(size, os.SEEK_CUR)
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
    """Return a struct of a .mat, {} if it is missing or an empty array is in its place; raise
    ValueError for anything else.
    """
    found = content.get(name, {})
    if isinstance(found, dict):
        return found
    if np.size(found):
        raise ValueError(f"{name}: expected a struct, got {type(found).__name__}")
    return {}


def _variables(
    rows: int, structs: Mapping[str, Any], content: Mapping[str, Any], begin: str
) -> dict[str, tuple[Array, dict[str, str]]]:
    """Return the fields of the structs of components with their attributes. structs: by component;
    content: whole file; begin: prefix of the structs with attributes.
    """
    found: dict[str, tuple[Array, dict[str, str]]] = {}
    texts = {name: _struct(content, begin + struct) for name, struct in ATTRIBUTES.items()}
    for component, fields in structs.items():
        if not isinstance(fields, dict):
            raise ValueError(f"{component}: expected a struct, got {type(fields).__name__}")
        for field, values in fields.items():
            name = f"{component}.{field}"
            array = numbers(name, values)
            if rows != 1 and array.shape[:1] != (rows,):
                size = " x ".join(map(str, array.shape)) or "one value"
                raise ValueError(f"{name}: expected {rows} rows, got {size}")
            array = array.reshape(rows, -1)
            about = {a: _text(_struct(t, component).get(field, "")) for a, t in texts.items()}
            found[name] = (array if about[ELEMENTS] or array.shape[1] > 1 else array[:, 0], about)
    return found


def _text(value: Any) -> str:
    """Return a text of a .mat, which stores an empty text as an empty array."""
    return value if isinstance(value, str) else ""


def _place(content: dict[str, Any], name: str) -> tuple[str, str]:
    """Return the names of the struct and of the field for `component.variable`, as MATLAB accepts
    them; content: structs so far.
    """
    component, _, variable = name.partition(".")
    component = _legal(component, RESERVED)
    return component, _legal(variable, content.setdefault(component, {}))


def _legal(name: str, taken: Collection[str]) -> str:
    """Return a name that MATLAB accepts (letters, digits, underscores, a letter first, at most 63
    characters) and that is not among the taken names.
    """
    legal = re.sub(r"\W", "_", name, flags=re.ASCII)[:60]
    if not legal[:1].isalpha():
        legal = f"x_{legal}"[:60]
    while legal in taken:
        legal += "_"
    return legal
