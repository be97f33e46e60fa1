# SPDX-License-Identifier: BSD-2-Clause
"""Variables with axes as the flat columns of a result: the way back of variables()."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from harness.results.result import Result
from harness.results.variables import ELEMENTS, element_names


def flat_columns(
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
