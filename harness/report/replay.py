# SPDX-License-Identifier: BSD-2-Clause
"""Which replay fits a result: the first of its mission that does."""

from __future__ import annotations

from collections.abc import Mapping

from harness.mission.library import of_result
from harness.mission.mission import together
from harness.report.arrays import Arrays
from harness.report.scene import Scene
from harness.results.result import Result


def replay(result: Result, arrays: Arrays) -> Scene | None:
    """The replay of a result; None if it holds nothing that moves."""
    if len(result.time) < 2:
        return None
    for kind in of_result(result).scene:
        if result.holds(*kind.needs, parameters=kind.parameters):
            return kind.build(result, arrays)
    return None


def replay_several(results: Mapping[str, Result], arrays: Arrays) -> Scene | None:
    """The replay of several runs by label in one scene; None if their mission has none."""
    for kind in together(map(of_result, results.values())).scene:
        if kind.several and (found := kind.several(results, arrays)):
            return found
    return None
