# SPDX-License-Identifier: BSD-2-Clause
"""What a .nc and a .mat have in common: flat columns of variables with axes (the way back of
variables()), and what their texts cannot hold.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.results.provenance import flat
from harness.results.result import Result
from harness.results.variables import ELEMENTS, element_names, from_lines


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
