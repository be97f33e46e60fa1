# SPDX-License-Identifier: BSD-2-Clause
"""What a .nc and a .mat have in common: flat columns of variables with axes (the way back of
variables()), and what their texts cannot hold; and what must hold of a result that any file
claims to be.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.results.provenance import flat
from harness.results.result import Result
from harness.results.variables import ELEMENTS, element_names, from_lines


def sound(result: Result) -> Result:
    """The result; ValueError with the first thing that is wrong with it."""
    for problem in _problems(result):
        raise ValueError(problem)
    return result


def _problems(result: Result) -> Iterator[str]:
    if not len(result.time):
        yield "it holds no rows"
    if not np.isfinite(result.time).all():
        yield f"row {np.argmin(np.isfinite(result.time))} has the time {_bad(result.time)}"
    if (np.diff(result.time) < 0).any():
        yield f"row {np.argmax(np.diff(result.time) < 0) + 1} is earlier than the one before"
    for name, text in (("system", result.system), ("message", result.message)):
        if not isinstance(text, str):
            yield f"{name}: expected a text, got {text!r:.40}"
    yield from _table(result, len(result.time), "variable")
    if result.parameters is not None:
        yield from _table(result.parameters, 1, "parameter")


def _bad(time: Any) -> float:
    return float(time[~np.isfinite(time)][0])


def _table(table: Result, rows: int, kind: str) -> Iterator[str]:
    """What is wrong with columns, units and numbers."""
    width = len(table.columns)
    if table.values.shape != (rows, width):
        yield f"{kind}s: expected {rows} rows of {width} values, got {table.values.shape}"
    if twice := [name for name, times in Counter(table.columns).items() if times > 1]:
        yield f"{kind} {twice[0]} is there twice"
    for about, texts in (("unit", table.units), ("description", table.descriptions)):
        if texts and len(texts) != width:
            yield f"{kind}s: {len(texts)} {about}s for {width} names"
        for name, text in zip(table.columns, texts, strict=False):
            if not isinstance(text, str):
                yield f"{about} of {kind} {name}: expected a text, got {text!r:.40}"


# ---- size


RATIO = 1100
"""No file of ours unpacks to more times its size: zlib reaches 1032."""
SMALL = 64 * 1024**2
"""Bytes that are not worth a question."""


def refuse_size(unpacked: int, packed: int | None = None) -> None:
    """ValueError if so many bytes of numbers are more than half of the memory of this machine, or
    more than a file of `packed` bytes can honestly hold.
    """
    if unpacked > SMALL and unpacked > _memory() / 2:
        raise ValueError(f"it unpacks to {_size(unpacked)}, more than half of the memory here")
    if packed is not None and unpacked > max(SMALL, RATIO * packed):
        raise ValueError(
            f"its {_size(packed)} unpack to {_size(unpacked)}, which cannot be a result"
        )


def _memory() -> int:
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    except (AttributeError, ValueError, OSError):  # not on every machine
        return 16 * 1024**3


def _size(count: int) -> str:
    return f"{count / 1e9:.3g} GB" if count >= 1e8 else f"{count / 1e3:.3g} kB"


def flat_columns(
    system: str,
    time: NDArray[np.float64],
    histories: Mapping[str, tuple[NDArray[np.float64], Mapping[str, str]]],
) -> Result:
    """Variables with their attributes as flat columns."""
    columns, blocks, units, descriptions = [], [np.empty((len(time), 0))], [], []
    for name, (values, about) in histories.items():
        given = about.get(ELEMENTS)
        if len(values) != len(time):
            raise ValueError(f"{name}: {len(values)} rows instead of {len(time)}")
        names = from_lines(given) if given else element_names(name, values.shape[1:])
        columns += names
        blocks.append(values.reshape(len(values), -1))
        units += [about.get("units", "")] * len(names)
        descriptions += [about.get("long_name", "")] * len(names)
    return Result(
        system, time, tuple(columns), tuple(units), np.hstack(blocks), tuple(descriptions)
    )


def numbers(name: str, values: Any) -> NDArray[np.float64]:
    """An array of a file as doubles; ValueError if it holds something else."""
    array = np.asarray(values)
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{name}: expected numbers, got {array.dtype}")
    return array.astype(np.float64, copy=False)


def refuse_nul(result: Result) -> None:
    """ValueError if a text of a result has a character that ends texts in files of C programs."""
    tables = [table for table in (result, result.parameters) if table is not None]
    texts = [result.message, result.system]
    texts += [t for table in tables for t in (*table.columns, *table.units, *table.descriptions)]
    if result.provenance is not None:
        texts += [t for t in flat(result.provenance).values() if isinstance(t, str)]
    if bad := next((text for text in texts if "\0" in text), None):
        raise ValueError(f"it cannot hold a NUL character: {bad!r}")
