# SPDX-License-Identifier: BSD-2-Clause
"""Which figures a result has: those of its mission that fit, else general ones; and a figure of any
variables: a panel for each, the elements of a vector in one, units on the axes.
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
from harness.results.result import Array, Result
from harness.spelling import did_you_mean, file_stem

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


def compared(
    results: Mapping[str, Result],
) -> tuple[list[tuple[Figure | Overlay, dict[str, Result]]], list[str]]:
    """Figures of several runs that show something, each with the runs that it fits (its title names
    the others); and those that one run alone has, which compare nothing, by name and run.
    """
    found, alone = [], []
    for figure in overlays_of(results):
        runs = {label: r for label, r in results.items() if figure.fits(r)}
        if all(figure.is_empty(r) for r in runs.values()):
            continue
        if len(runs) < min(2, len(results)):
            alone.append(f"{figure.name} ({next(iter(runs))})")
            continue
        found.append((named(figure, runs, results), runs))
    return found, alone


def named(
    figure: Figure | Overlay, runs: Mapping[str, Result], results: Mapping[str, Result]
) -> Figure | Overlay:
    """A figure of several runs whose title names the results that are not among them."""
    absent = ", ".join(label for label in results if label not in runs)
    return replace(figure, title=f"{figure.title}; without {absent}") if absent else figure


def general(result: Result) -> Iterator[Figure]:
    """The moving variables of every component, some panels a figure."""
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
    """One figure of these variables: `component.variable`, one element, or the part of a name in
    front of a point for all below it. Raises UsageError with close matches.
    """
    found = list(dict.fromkeys(v for name in names for v in _expanded(result, name)))
    about = result.description(found[0]) if len(found) == 1 else ""
    title = f"{result.system}: {about}" if about else result.system
    stem = file_stem("_".join(name.rstrip("]") for name in names))
    return Figure(stem, title, tuple(_panel(result, v) for v in found))


def _expanded(result: Result, name: str) -> Iterator[str]:
    """The variable of that name, or all below it."""
    below = [v for v in result.vectors if v.startswith(f"{name}.")]
    if name in result:
        yield name
    elif below:
        yield from below
    elif result.holds(parameters=(name,)):
        value = np.array2string(result.parameter(name), separator=", ")
        raise UsageError(f"--var {name}: a parameter, which has no history; it is {value}")
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

    def flat(history: Array) -> Array:
        return history.reshape(len(history), -1)

    return Panel(label, (Curve(name, convert=flat, labels=tuple(columns)),))
