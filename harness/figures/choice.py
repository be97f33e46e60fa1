# SPDX-License-Identifier: BSD-2-Clause
"""Which figures a result has: those of its mission that fit, else general ones."""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from harness.figures.variables import figure_of
from harness.mission.figure import Drawing, Figure, Overlay
from harness.mission.library import missing, of_result
from harness.mission.mission import together
from harness.results.result import Result

PANELS = 8
"""Most panels of a general figure."""

_log = logging.getLogger("harness")


def figures_of(result: Result) -> list[Figure | Drawing]:
    """Figures that fit, the first of a name; general ones if none of its mission does."""
    if note := missing(result):
        _log.warning("%s", note)
    fitting = {f.name: f for f in reversed(of_result(result).figures) if f.fits(result)}
    return list(reversed(fitting.values())) or list(general(result))


def overlays_of(results: Mapping[str, Result]) -> Sequence[Figure | Overlay]:
    """Figures of several runs that at least one of them fits."""
    offered = together(of_result(result) for result in results.values()).overlays
    fitting = [f for f in offered if any(f.fits(r) for r in results.values())]
    return fitting or list(general(next(iter(results.values()))))


def general(result: Result) -> Iterator[Figure]:
    """The moving variables of every component, some panels a figure."""
    components: dict[str, list[str]] = {}
    for name in _variables(result):
        if len(result.time) and np.ptp(result[name], axis=0).any():
            components.setdefault(name.partition(".")[0], []).append(name)
    for component, names in components.items():
        for k in range(0, len(names), PANELS):
            figure = figure_of(result, names[k : k + PANELS])
            number = f"_{k // PANELS + 1}" if len(names) > PANELS else ""
            yield Figure(f"{component}{number}", f"{result.system}: {component}", figure.panels)


def _variables(result: Result) -> Iterator[str]:
    """Vectors, and the scalars that belong to none."""
    whole = {int(column) for columns in result.vectors.values() for column in columns.flat}
    yield from result.vectors
    yield from (name for i, name in enumerate(result.columns) if i not in whole)
