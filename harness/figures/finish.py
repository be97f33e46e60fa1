# SPDX-License-Identifier: BSD-2-Clause
"""Last changes to figures of runs: limits that hide rounding errors, time axes that end with the
run, at least three ticks on logarithmic axes, aligned labels. In figures for print, curves also
differ without colour, and symbols look as in formulas.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import product
from operator import itemgetter
from typing import Any

import numpy as np

from harness.mission.figure import unit_of
from harness.results.result import Array

DASHES = (
    (0, (5, 1.5)), (0, (6, 1.5, 1, 1.5)), (0, (1, 1.3)), (0, (3, 1, 1, 1, 1, 1)),
    (0, (9, 2)), (0, (2, 2)), (0, (1, 3)), (0, (9, 1.5, 3, 1.5)), (0, (5, 4)),
    (0, (3, 1.5, 3, 1.5, 1, 1.5)), (0, (12, 2, 1, 2)),
)  # fmt: skip
"""Dash patterns that can be distinguished in print, in the order of use: offset and lengths of
dashes and gaps, in line widths.
"""
WIDTHS = (1.0, 1.9, 0.5, 2.8)
"""Factors on the line width. After all dash patterns have been used with one factor, they are used
again with the next.
"""
CROWD = 0.06
"""Share of the length of a time axis: ticks that are nearer than this to the tick at the end of the
axis are removed.
"""
LEAST_TICKS = 3
STEPS = (1, 2, 5)
"""Multiples of powers of ten at which a logarithmic axis that spans too few decades has ticks."""
ROUNDING = 1e-10
"""Ratio below which a panel shows only rounding errors. It limits two ratios: of the largest value
in the panel to the largest value in all panels with the same unit, and of the range of the values
in the panel to their largest value.
"""
DECADES = 1e-9
"""Smallest ratio of the lower to the upper end of a logarithmic axis."""

GREEK = (
    "alpha|beta|gamma|delta|epsilon|zeta|eta|theta|kappa|lambda|mu|nu|xi|rho|sigma|tau|phi|chi|psi"
    "|omega|Delta|Gamma|Omega"
)
SYMBOL = re.compile(rf"(?<![\w$\\.])(?P<base>{GREEK}|[A-Za-z])_(?P<index>\w+)(?![\w.])|"
                    rf"(?<![\w$\\.])(?P<alone>{GREEK})(?![\w.])")  # fmt: skip
POWERS = str.maketrans(
    "0123456789-", "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079\u207b"
)


def finish(canvas: Any, end: float | None, distinct: bool) -> Any:
    """Apply the last changes to a figure of matplotlib and return it.

    end: end of the longest run in the unit of the time axes, None without time axes; distinct:
    whether the figure is for print, so that curves must differ without colour.
    """
    flat = plane(canvas)
    for axes in flat:
        for axis in (axes.xaxis, axes.yaxis):
            if axis.get_scale() == "log":
                _set_ticks(axis)
    if end is not None:
        _end_with_run([axes for axes in flat if label_of(axes, "x").startswith("time [")], end)
    if distinct:
        for axes in canvas.axes:
            distinguish(axes)
        _set_symbols(canvas)
    canvas.align_labels()
    return canvas


def plane(canvas: Any) -> list[Any]:
    """Return the two-dimensional axes of a figure, without colour bars."""
    return [axes for axes in canvas.axes if axes.name != "3d" and axes.get_label() != "<colorbar>"]


# ---- limits


def hide_rounding(panels: Sequence[tuple[Any, str]]) -> None:
    """Set the limits of panels whose curves would otherwise show rounding errors at full height.

    panels: axes with their labels. If the values in a panel are far below the largest values in
    another panel with the same unit, the panel gets the limits of that other panel, and a note. A
    panel with a constant gets limits 5 % below and above the constant. The lower end of a
    logarithmic axis is raised above rounding errors.
    """
    for axes, _ in panels:
        _limit_decades(axes)
    sizes = [
        (float(np.abs(_values(axes)).max()), axes, unit_of(label))
        for axes, label in panels
        if axes.get_yscale() == "linear"
    ]
    for size, axes, unit in sizes:
        largest, sibling, _ = max((each for each in sizes if each[2] == unit), key=itemgetter(0))
        if size < ROUNDING * largest:
            axes.set_ylim(sibling.get_ylim())
            _note(axes, f"rounding below {size:.0e}".replace("e-0", "e-"))
        elif np.ptp(_values(axes)) < ROUNDING * size:
            level = float(np.median(_values(axes)))
            axes.set_ylim(sorted((0.95 * level, 1.05 * level)))


def _limit_decades(axes: Any) -> None:
    """Raise the lower end of a logarithmic y axis to at least DECADES times its upper end."""
    if axes.get_yscale() == "log":
        low, high = axes.get_ylim()
        if low < DECADES * high:
            axes.set_ylim(DECADES * high, high)


def _note(axes: Any, text: str) -> None:
    axes.annotate(
        text, (0.99, 0.95), xycoords="axes fraction", ha="right", va="top", fontsize="small",
        color="0.35",
    )  # fmt: skip


def _values(axes: Any) -> Array:
    """Return all finite values of the curves of a panel, or [0] if there are none."""
    curves = [np.asarray(line.get_ydata(), dtype=np.float64) for line in axes.get_lines()]
    values = np.concatenate(curves) if curves else np.zeros(1)
    finite = values[np.isfinite(values)]
    return finite if len(finite) else np.zeros(1)


# ---- axes of time, ticks


def label_of(axes: Any, which: str) -> str:
    """Return the label of the x or y axis (`which`), which may be set at other axes that share this
    axis.
    """
    shared = getattr(axes, f"get_shared_{which}_axes")().get_siblings(axes)
    labels = (getattr(each, f"get_{which}label")() for each in (axes, *shared))
    return next(filter(None, labels), "")


def _end_with_run(panels: Iterable[Any], end: float) -> None:
    """Let the time axes of panels end at `end`, the end of the longest run, with a tick there."""
    for axes in panels:
        begin, last = axes.get_xlim()
        if not begin < end <= last:
            continue
        begin = max(
            begin, min((x.min() for x in map(_times, axes.get_lines()) if x.size), default=begin)
        )
        inside = [t for t in axes.get_xticks() if begin <= t <= end - CROWD * (end - begin)]
        axes.set_xlim(begin, end)
        axes.set_xticks([*inside, end], [f"{t:.5g}" for t in (*inside, end)])


def _times(line: Any) -> Array:
    x = np.asarray(line.get_xdata(), dtype=np.float64)
    return x[np.isfinite(x)] if line.get_transform() == line.axes.transData else x[:0]


def _set_ticks(axis: Any) -> None:
    """Set at least three ticks with labels on a logarithmic axis."""
    from matplotlib.ticker import FixedFormatter, FixedLocator, LogLocator, MaxNLocator

    low, high = sorted(axis.get_view_interval())
    if not 0 < low < high < np.inf:
        return
    if np.floor(np.log10(high)) - np.ceil(np.log10(low)) + 1 >= LEAST_TICKS:
        return
    locators = (LogLocator(subs=STEPS), MaxNLocator(4, min_n_ticks=LEAST_TICKS + 2))
    inside = ([t for t in at.tick_values(low, high) if low <= t <= high] for at in locators)
    chosen = next((ticks for ticks in inside if len(ticks) >= LEAST_TICKS), [low, high])
    axis.set_major_locator(FixedLocator(chosen))
    axis.set_major_formatter(FixedFormatter([plain_number(t) for t in chosen]))
    axis.set_minor_formatter(FixedFormatter([]))


# ---- curves that differ without colour


def look_of(line: Any) -> tuple[Any, ...]:
    """Return the features that distinguish a curve in a grey print: dashes, marker, line width."""
    dashes = _dashes(line) if line.get_linestyle() != "None" else None
    return str(dashes), str(line.get_marker()), round(float(line.get_linewidth()), 2)


def distinguish(axes: Any) -> None:
    """Give curves of different colours different dashes. Curves that had the same colour and style
    before, such as the two edges of a band, get the same dashes.
    """
    taken: set[Any] = set()
    for lines in _groups(axes):
        wide, looks = lines[0].get_linewidth(), product(WIDTHS, DASHES)
        while look_of(lines[0]) in taken:
            width, dashes = next(looks)
            for line in lines:
                line.set(linestyle=dashes, linewidth=width * wide)
        taken.add(look_of(lines[0]))
    if legend := axes.get_legend():
        _update_legend(legend, axes.get_legend_handles_labels()[0])


def _groups(axes: Any) -> Iterable[list[Any]]:
    """Return the curves in groups with the same colour, dashes, marker and width."""
    groups: dict[Any, list[Any]] = {}
    for line in axes.get_lines():
        if line.get_linestyle() != "None" and np.size(line.get_xdata()) > 1:
            groups.setdefault((str(line.get_color()), *look_of(line)), []).append(line)
    return groups.values()


def _update_legend(legend: Any, shown: Iterable[Any]) -> None:
    """Give the entries of a legend the dashes and widths of the curves `shown`, which they
    describe.
    """
    from matplotlib.lines import Line2D

    for handle, line in zip(legend.legend_handles, shown, strict=False):
        if isinstance(line, Line2D) and isinstance(handle, Line2D):
            dashed = line.get_linestyle() != "None"
            handle.set_linestyle(_dashes(line) if dashed else "None")
            handle.set_linewidth(line.get_linewidth())


def _dashes(line: Any) -> Any:
    offset, pattern = line._unscaled_dash_pattern
    return (offset, tuple(pattern)) if pattern else "-"


def _set_symbols(canvas: Any) -> None:
    from matplotlib.text import Text

    for text in canvas.findobj(Text):
        text.set_text(mathematical(text.get_text()))


# ---- symbols and numbers


def mathematical(text: str) -> str:
    """Return a label such as `rho_ref [m]` in the notation of formulas of matplotlib: Greek
    letters, subscripts, and powers in units as superscripts.
    """
    if "$" in text:
        return text
    parts = re.split(r"(\[[^\]]*\])", text)
    return "".join(_unit(p) if p.startswith("[") else SYMBOL.sub(_formula, p) for p in parts)


def _unit(text: str) -> str:
    """Return a unit in brackets with powers as superscripts and products with a dot."""
    raised = re.sub(r"(?<=[a-z])(-?\d)", lambda m: m[1].translate(POWERS), text)
    return raised.replace(".", "\u00b7")


def _formula(found: re.Match[str]) -> str:
    base = found["base"] or found["alone"]
    name = f"\\{base}" if len(base) > 1 else base
    index = (found["index"] or "").replace("_", ",")
    upright = index if len(index) < 2 else rf"\mathrm{{{index}}}"
    return f"${name}_{{{upright}}}$" if index else f"${name}$"


def plain_number(value: float) -> str:
    """Return the number at a tick as plain text such as `2×10⁷`, without the formula notation of
    matplotlib.
    """
    if 1e-4 < abs(value) < 1e5:
        return f"{value:.4g}"
    power = int(np.floor(np.log10(abs(value))))
    part = f"{value / 10.0**power:.3g}"
    front = "" if part == "1" else f"{part}\u00d7"
    return f"{front}10{str(power).translate(POWERS)}"
