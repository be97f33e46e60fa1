# SPDX-License-Identifier: BSD-2-Clause
"""Plots of a study that asks on: effects as a tornado, the search and its worst thirty flights, the
probability against the limit.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from harness.report.arrays import Canvas
from harness.report.plots import Plot, diagram
from harness.results.files import read
from harness.results.result import Result
from harness.studies.campaign.store import Store
from harness.studies.inquiry.study import SHOWN, Study
from harness.studies.inquiry.worst import confirmed

WORST = 30
"""Flights whose numbers are drawn side by side."""
DECADES = 1e-12
"""Least probability of a diagram."""


def text(store: Store, path: Path) -> str:
    """What the study found, "" of a plain campaign; path: of the dataset in commands."""
    return "" if _estimate(store) is None else Study(path, store).summary()


def plots(canvas: Canvas, store: Store) -> Iterator[Plot]:
    """What there is to draw of a study."""
    if (estimate := _estimate(store)) is None:
        return
    names = [str(n) for n in store.array("requirement")]
    for name, found in estimate["of"].items():
        if "value" in found:
            yield _tornado(canvas, name, found, estimate["factors"])
        if "run" in found:
            k = names.index(name)
            yield _convergence(canvas, name, store, k, found)
            yield _parallel(canvas, name, store, k)
        if found.get("levels"):
            yield _levels(canvas, name, found["levels"])


def flights(store: Store, path: Path) -> dict[str, Result]:
    """The nominal flight and the worst ones of a search by label, where they were kept."""
    if store.group.attrs.get("kind") != "worst" or (estimate := _estimate(store)) is None:
        return {}
    return {label: read(file) for label, file in confirmed(path, estimate["of"]).items()}


def _estimate(store: Store) -> Any:
    given = store.group.attrs.get("estimate")
    return None if given is None else json.loads(given)


def _line(canvas: Canvas, x: Any, y: Any, **look: Any) -> Plot:
    return canvas.line(x, y, **{"name": "", "colour": 0, "dash": "solid", **look})


def _tornado(canvas: Canvas, name: str, found: Any, factors: list[str]) -> Plot:
    """Effects as bars, the largest on top, with their intervals as lines."""
    order = np.argsort(found["value"])[-SHOWN:]
    curves = []
    for place, k in enumerate(order):
        bar = [0, found["value"][k], found["value"][k], 0, 0]
        edge = np.array([-0.4, -0.4, 0.4, 0.4, -0.4]) + place
        curves.append(_line(canvas, bar, edge, name=factors[k], fill=True, colour=place))
        if "low" in found:
            ends = [found["low"][k], found["high"][k]]
            curves.append(_line(canvas, ends, [float(place)] * 2, colour=place, dash="dash"))
    return diagram(f"{name}: what matters", "effect", "factor", curves)


def _convergence(canvas: Canvas, name: str, store: Store, column: int, found: Any) -> Plot:
    """All flights of a search, and the best so far."""
    label = f"margin of {name} [{store.array('margin_units')[column] or '1'}]"
    last = found["run"] - found["place"] + found["flights"]
    y = store.array("margin")[:, column][last - found["flights"] : last]
    y = np.where(np.isfinite(y), y, np.nan)
    flight = np.arange(1, len(y) + 1)
    curves = [
        _line(canvas, flight, y, name="flights", marker="dot"),
        _line(canvas, flight, np.fmin.accumulate(y), name="worst so far", colour=1),
    ]
    return diagram(label, "flight", label, curves)


def _parallel(canvas: Canvas, name: str, store: Store, column: int) -> Plot:
    """Numbers of the worst flights side by side; failures in another colour."""
    numbers, margins = store.array("numbers"), store.array("margin")[:, column]
    axis = np.arange(1, numbers.shape[1] + 1)
    curves = [
        _line(canvas, axis, numbers[k], colour=int(margins[k] < 0))
        for k in np.argsort(margins, kind="stable")[:WORST]
    ]
    title = f"{name}: the worst {len(curves)} flights"
    return diagram(title, "number", "standard deviations", curves)


def _levels(canvas: Canvas, name: str, repeats: Any) -> Plot:
    """Probability of a margin below the limit, of each repeat."""
    curves = []
    for k, levels in enumerate(repeats):
        limits, p = np.array([level[:2] for level in levels], dtype=float).T
        y = np.log10(np.maximum(p, DECADES))
        curves.append(_line(canvas, limits, y, name=f"repeat {k + 1}", colour=k))
    return diagram(f"{name}: probability of less than a margin", "margin", "log10 p", curves)
