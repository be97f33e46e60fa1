# SPDX-License-Identifier: BSD-2-Clause
"""Choice of the figures of a result: the figures of its mission whose variables the result has,
otherwise general figures. Also a figure of given variables with one panel per variable.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from harness.errors import UsageError
from harness.mission.figure import Curve, Drawing, Figure, Overlay, Panel
from harness.mission.library import missing, of_result
from harness.mission.mission import together
from harness.results.result import Result
from harness.spelling import did_you_mean, file_stem

PANELS = 8
"""Largest number of panels of a general figure."""

_log = logging.getLogger("harness")


def figures_of(result: Result) -> list[Figure | Drawing]:
    """Return the mission's figures whose variables the result contains; of two figures with the
    same name, the first. If there is no such figure, return general figures.
    """
    if note := missing(result):
        _log.warning("%s", note)
    fitting = {f.name: f for f in reversed(of_result(result).figures) if f.fits(result)}
    return list(reversed(fitting.values())) or list(general(result))


def overlays_of(results: Mapping[str, Result]) -> Sequence[Figure | Overlay]:
    """Return the figures of the missions for which at least one run has the variables. If there is
    no such figure, return general figures of the first run. results: by label of the run.
    """
    offered = together(of_result(result) for result in results.values()).overlays
    fitting = [f for f in offered if any(f.fits(r) for r in results.values())]
    return fitting or list(general(next(iter(results.values()))))


def compared(
    results: Mapping[str, Result],
) -> tuple[list[tuple[Figure | Overlay, dict[str, Result]]], list[str]]:
    """Return two lists. First: the figures that compare several runs, each with the results that
    have its variables; its title names the runs that are left out. Figures that are constant or
    empty in all these runs are omitted.

    Second: texts `FIGURE (RUN)` for the figures for which only one run has the variables. results:
    by label of the run.
    """
    found, alone = [], []
    for figure in overlays_of(results):
        runs = {label: r for label, r in results.items() if figure.fits(r)}
        if all(figure.is_empty(r) for r in runs.values()):
            continue
        if len(runs) < min(2, len(results)):
            alone.append(f"{figure.name} ({next(iter(runs))})")
            continue
        absent = ", ".join(label for label in results if label not in runs)
        title = f"{figure.title}; without {absent}" if absent else figure.title
        found.append((replace(figure, title=title), runs))
    return found, alone


def general(result: Result) -> Iterator[Figure]:
    """Yield figures of all variables that change, separately for each component, at most PANELS
    variables per figure.
    """
    components: dict[str, list[str]] = {}
    for name in result.names:
        if len(result.time) and np.ptp(result[name], axis=0).any():
            components.setdefault(name.partition(".")[0], []).append(name)
    for component, names in components.items():
        for k in range(0, len(names), PANELS):
            figure = figure_of(result, names[k : k + PANELS])
            number = f"_{k // PANELS + 1}" if len(names) > PANELS else ""
            yield Figure(f"{component}{number}", f"{result.system}: {component}", figure.panels)


def figure_of(result: Result, names: Sequence[str]) -> Figure:
    """Return one figure with one panel for each variable.

    names: each is a variable, one element of a variable, or the beginning NAME of variables
    `NAME.*`, such as a component, which selects all these variables. Raises UsageError with close
    matches for an unknown name.
    """
    found = list(dict.fromkeys(v for name in names for v in _expanded(result, name)))
    about = result.description(found[0]) if len(found) == 1 else ""
    title = f"{result.system}: {about}" if about else result.system
    stem = file_stem("_".join(name.rstrip("]") for name in names))
    return Figure(stem, title, tuple(_panel(result, v) for v in found))


def _expanded(result: Result, name: str) -> Iterator[str]:
    """Yield the variable with this name, or all variables `NAME.*`; raise UsageError if there is
    none.
    """
    below = [v for v in result.vectors if v.startswith(f"{name}.")]
    if name in result:
        yield name
    elif below:
        yield from below
    elif result.holds(parameters=(name,)):
        value = np.array2string(result.parameter(name), separator=", ")
        raise UsageError(f"--var {name}: is a parameter ({value}), not a time series")
    else:
        close = did_you_mean(name, dict.fromkeys((*result.vectors, *result.columns)))
        raise UsageError(f"--var {name}: the result has no such variable{close}")


def _panel(result: Result, name: str) -> Panel:
    unit = result.unit(name).replace(".", " ")
    label = f"{name} [{unit}]" if unit not in ("", "1") else name
    elements = result.vectors.get(name)
    if elements is None or elements.shape in ((), (3,)):
        return Panel(label, (Curve(name),))
    columns = (result.columns[i].removeprefix(name).strip("[]") for i in elements.flat)
    return Panel(label, (Curve(name, labels=tuple(columns)),))
