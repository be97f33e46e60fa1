# SPDX-License-Identifier: BSD-2-Clause
"""Formats of results files, one module per kind with write(result, path) and read(path). They raise
the errors of their libraries, and harness/results/files.py reports each error in one line.

This module contains what several formats share: texts, parameters and provenance of a bare table,
and the checks of a result from any file.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from harness.results import provenance
from harness.results.result import Array, Result


def sound(result: Result) -> Result:
    """Return the result of a file if it is consistent; raise ValueError with its first fault."""
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
        yield f"row {np.argmin(finite)} has the time {result.time[~finite][0]}"
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


# ---- size


RATIO = 1100
"""Largest plausible ratio of unpacked to packed size: zlib reaches 1032."""
SMALL = 64 * 1024**2
"""Unpacked size [bytes] up to which no file is rejected."""


def check_size(unpacked: int, packed: int | None = None) -> None:
    """Raise ValueError if the unpacked numbers [bytes] exceed half of the memory of this machine,
    or are more than a file of `packed` bytes can plausibly contain.
    """
    if unpacked > SMALL and unpacked > _memory() / 2:
        raise ValueError(
            f"it unpacks to {_size(unpacked)}, more than half of the memory of this machine"
        )
    if packed is not None and unpacked > max(SMALL, RATIO * packed):
        raise ValueError(
            f"the file of {_size(packed)} unpacks to {_size(unpacked)}, which cannot be a result"
        )


def _memory() -> int:
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # not on every machine
        return 16 * 1024**3


def _size(count: int) -> str:
    return f"{count / 1e9:.3g} GB" if count >= 1e8 else f"{count / 1e3:.3g} kB"


def numbers(name: str, values: Any) -> Array:
    """Return an array of a file as doubles; raise ValueError if it contains something else."""
    array = np.asarray(values)
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{name}: expected numbers, got {array.dtype}")
    return array.astype(np.float64, copy=False)


# ---- texts and parameters of a bare table


def content(result: Result) -> dict[str, Any]:
    """Return everything in a result except the values of its table, for TOML and JSON."""
    about: dict[str, Any] = {
        "system": result.system,
        "complete": result.complete,
        "message": result.message,
    }
    if result.provenance is not None:
        about["provenance"] = provenance.table(result.provenance)
    if (fixed := result.parameters) is not None:
        values = dict(zip(fixed.columns, fixed.values[0].tolist(), strict=True))
        about["parameters"] = {"values": values, **_texts(fixed)}
    return {**about, "columns": _texts(result)}


def _texts(result: Result) -> dict[str, Any]:
    """Return units, descriptions and modes, each by column, without empty texts."""
    given = {"units": result.units, "descriptions": result.descriptions, "modes": result.modes}
    return {
        kind: {name: text for name, text in zip(result.columns, texts, strict=False) if text}
        for kind, texts in given.items()
    }


def completed(result: Result, about: Mapping[str, Any]) -> Result:
    """Return a result that has only columns and values, completed by the texts, parameters and
    provenance in `about`, as content() returned them; raise ValueError if `about` is invalid.
    """
    origin, parameters = _table(about, "provenance"), _table(about, "parameters")
    return replace(
        _named(result, _table(about, "columns")),
        system=about.get("system", result.system),
        parameters=_parameters(result, parameters) if parameters else None,
        provenance=provenance.from_table(origin) if origin else None,
    )


def _table(about: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the table with this name inside a table, {} if it is missing; raise ValueError if the
    entry is not a table.
    """
    if not isinstance(found := about.get(name, {}), dict):
        raise ValueError(f"{name}: expected a table, got {found!r:.40}")
    return found


def _named(result: Result, texts: Mapping[str, Any]) -> Result:
    found: dict[str, Any] = {
        kind: tuple(_table(texts, kind).get(name, "") for name in result.columns)
        for kind in ("units", "descriptions", "modes")
    }
    return replace(result, **found)


def _parameters(result: Result, table: Mapping[str, Any]) -> Result:
    given = _table(table, "values")
    for name, value in given.items():
        if not isinstance(value, int | float):
            raise ValueError(f"parameter {name}: expected a number, got {value!r:.40}")
    values = np.array([list(given.values())], dtype=np.float64)
    return _named(Result(result.system, result.time[:1], tuple(given), (), values), table)
