# SPDX-License-Identifier: BSD-2-Clause
"""Limits of axes that show signals, not rounding: what is 0 but for the last bits is a line at 0,
and what one run does to its own scale does not flatten the others.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from harness.results.result import Array

ROUNDING = 1e-10
"""A curve smaller than this part of those in the same unit beside it, or than this part of its own
mean, is rounding.
"""
DECADES = 1e-9
"""Lower end of a logarithmic axis at most, as part of its upper one."""
BODY, EDGE = 99.0, 1.5
"""Percentile of all values that is the body of the runs; times this it is the edge of the panel."""
SPIKE, TOWER, FEW = 5.0, 1e-3, 5
"""Spikes are this many times higher than the body, which is at least that part of them, and at most
so many in a run.
"""


def calm(panels: Sequence[tuple[Any, str]]) -> None:
    """Set the limits of panels, given with their labels, that show rounding.

    A panel takes those of the largest panel in the same unit, and says so; a constant gets a band
    of 5 % about it.
    """
    linear = [(axes, label) for axes, label in panels if axes.get_yscale() == "linear"]
    largest: dict[str, tuple[float, Any]] = {}
    for axes, label in linear:
        unit = unit_of(label)
        largest[unit] = max(largest.get(unit, (0.0, axes)), (_size(axes), axes), key=lambda x: x[0])
    for axes, label in linear:
        size, sibling = largest[unit_of(label)]
        if _size(axes) < ROUNDING * size:
            axes.set_ylim(sibling.get_ylim())
            _note(axes, f"rounding below {_size(axes):.0e}".replace("e-0", "e-"))
        elif _span(axes) < ROUNDING * _size(axes):
            level = float(np.median(_values(axes)))
            axes.set_ylim(sorted((0.95 * level, 1.05 * level)))
    for axes, _ in panels:
        if axes.get_yscale() == "log":
            low, high = axes.get_ylim()
            axes.set_ylim(max(low, DECADES * high), high)


def cut_spikes(axes: Any, histories: Sequence[Array]) -> None:
    """Limit a panel of several runs to what they do nearly all the time, and say what is beyond.

    A train of pulses is no spike.
    """
    sizes = np.concatenate([np.abs(h[np.isfinite(h)]) for h in histories])
    body = float(np.percentile(sizes, BODY)) if len(sizes) else 0.0
    largest = float(sizes.max(initial=0.0))
    beyond = [np.abs(np.nan_to_num(h)) > EDGE * body for h in histories]
    pulses = max((np.count_nonzero(np.diff(each)) // 2 for each in beyond), default=0)
    flattened = TOWER * largest < body < largest / SPIKE
    if axes.get_yscale() == "log" or not flattened or pulses > FEW:
        return
    low, high = axes.get_ylim()
    axes.set_ylim(max(low, -EDGE * body), min(high, EDGE * body))
    _note(axes, f"cut: up to {largest:.3g}")


def _note(axes: Any, text: str) -> None:
    axes.annotate(
        text, (0.99, 0.95), xycoords="axes fraction", ha="right", va="top", fontsize="small",
        color="0.35",
    )  # fmt: skip


def unit_of(label: str) -> str:
    """What a label has in brackets, or nothing."""
    found = re.search(r"\[(.*?)\]", label)
    return found[1] if found else ""


def _values(axes: Any) -> Array:
    """Everything that the curves of a panel show."""
    curves = [np.asarray(line.get_ydata(), dtype=np.float64) for line in axes.get_lines()]
    values = np.concatenate(curves) if curves else np.zeros(1)
    finite = values[np.isfinite(values)]
    return finite if len(finite) else np.zeros(1)


def _size(axes: Any) -> float:
    return float(np.abs(_values(axes)).max())


def _span(axes: Any) -> float:
    return float(np.ptp(_values(axes)))
