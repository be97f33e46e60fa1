# SPDX-License-Identifier: BSD-2-Clause
"""Which replay fits a result."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from harness.figures.transposition import SHAPE
from harness.report.approach_scene import PAIR, pair
from harness.report.arrays import Arrays
from harness.report.jointed_scene import ASSEMBLY, LINKS, ROBOT, assembly, robot
from harness.report.scene import Scene
from harness.results.result import Result


class Kind(NamedTuple):
    """Results that hold these variables and parameters are replayed by this function."""

    needs: tuple[str, ...]
    parameters: tuple[str, ...]
    build: Callable[[Result, Arrays], Scene]


SCENES = (
    Kind(PAIR, (), pair),
    Kind(ROBOT, LINKS, robot),
    Kind(ASSEMBLY, (*SHAPE, "assembly.R_C"), assembly),
)


def replay(result: Result, arrays: Arrays) -> Scene | None:
    """The replay of a result; None if it holds nothing that moves."""
    if len(result.time) < 2:
        return None
    for kind in SCENES:
        if result.holds(*kind.needs, parameters=kind.parameters):
            return kind.build(result, arrays)
    return None
