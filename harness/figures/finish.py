# SPDX-License-Identifier: BSD-2-Clause
"""The last touch of every figure: axes of time that end where the run ends, three ticks and more on
logarithmic axes, labels in line; in print curves that differ without colour, and symbols as in
formulas.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

import numpy as np

from harness.results.result import Array

DASHES = (
    (0, (5, 1.5)), (0, (6, 1.5, 1, 1.5)), (0, (1, 1.3)), (0, (3, 1, 1, 1, 1, 1)),
    (0, (9, 2)), (0, (2, 2)), (0, (1, 3)), (0, (9, 1.5, 3, 1.5)), (0, (5, 4)),
    (0, (3, 1.5, 3, 1.5, 1, 1.5)), (0, (12, 2, 1, 2)),
)  # fmt: skip
"""Line styles that differ in print, in the order in which they are given out."""
WIDTHS = (1.0, 1.9, 0.5, 2.8)
"""Widths of curves whose dashes are all taken, as parts of their own."""
CROWD = 0.06
"""A tick nearer than this part of the axis to its end gives way to the end."""
LEAST_TICKS = 3
GREEK = (
    "alpha|beta|gamma|delta|epsilon|zeta|eta|theta|kappa|lambda|mu|nu|xi|rho|sigma|tau|phi|chi|psi"
    "|omega|Delta|Gamma|Omega"
)
SYMBOL = re.compile(rf"(?<![\w$\\.])(?P<base>{GREEK}|[A-Za-z])_(?P<index>\w+)(?![\w.])|"
                    rf"(?<![\w$\\.])(?P<alone>{GREEK})(?![\w.])")  # fmt: skip
POWERS = str.maketrans(
    "0123456789-", "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079\u207b"
)


def finished(canvas: Any, end: float | None, distinct: bool) -> Any:
    """A figure of matplotlib with the last touch; end: of the runs in the unit of the axes of time,
    None: there are none; distinct: it is for print.
    """
    flat = [axes for axes in canvas.axes if axes.name != "3d" and axes.get_label() != "<colorbar>"]
    for axes in flat:
        for axis in (axes.xaxis, axes.yaxis):
            if axis.get_scale() == "log":
                _ticked(axis)
    if end is not None:
        _ended([axes for axes in flat if _of_time(axes)], end)
    if distinct:
        for axes in canvas.axes:
            tell_apart(axes)
        _symbols(canvas)
    canvas.align_labels()
    return canvas


# ---- axes


def _of_time(axes: Any) -> bool:
    shared = axes.get_shared_x_axes().get_siblings(axes)
    return any(re.match(r"time \[", each.get_xlabel()) for each in shared)


def _ended(panels: Iterable[Any], end: float) -> None:
    """Axes of time that end with the run, with a tick there."""
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


def _ticked(axis: Any) -> None:
    """At least three ticks with labels on a logarithmic axis."""
    from matplotlib.ticker import FixedFormatter, FixedLocator, MaxNLocator

    low, high = sorted(axis.get_view_interval())
    if not 0 < low < high < np.inf:
        return
    decades = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    whole = [10.0**k for k in decades if low <= 10.0**k <= high]
    if len(whole) >= LEAST_TICKS:
        return
    steps = ((1, 3), (1, 2, 5), (1, 2, 3, 4, 6, 8))
    options = [[m * 10.0**k for k in decades for m in parts] for parts in steps]
    options.append(list(MaxNLocator(4, min_n_ticks=LEAST_TICKS + 2).tick_values(low, high)))
    inside = ([t for t in ticks if low <= t <= high] for ticks in options)
    chosen = next((ticks for ticks in inside if len(ticks) >= LEAST_TICKS), [low, high])
    axis.set_major_locator(FixedLocator(chosen))
    axis.set_major_formatter(FixedFormatter([plain_number(t) for t in chosen]))
    axis.set_minor_formatter(FixedFormatter([]))


def plain_number(value: float) -> str:
    """A number of a tick, without the mark-up of formulas."""
    if 1e-4 < abs(value) < 1e5:
        return f"{value:.4g}"
    power = int(np.floor(np.log10(abs(value))))
    part = f"{value / 10.0**power:.3g}"
    front = "" if part == "1" else f"{part}\u00d7"
    return f"{front}10{str(power).translate(POWERS)}"


def untexed(text: str) -> str:
    """A tick or label of matplotlib without the mark-up of formulas, powers raised."""
    bare = re.sub(r"\\math\w+\{((?:[^{}]|\{[^{}]*\})*)\}", r"\1", text.replace("$", ""))
    raised = re.sub(r"\^\{([-\d]+)\}", lambda m: m[1].translate(POWERS), bare)
    return re.sub(r"\\(?:times|cdot)\s*", "\u00d7", raised).replace("\u2212", "-")


# ---- curves that differ without colour


def look_of(line: Any) -> tuple[Any, ...]:
    """What one sees of a curve on a grey print: its dashes, its marker, its width."""
    dashes = _dashes(line) if line.get_linestyle() != "None" else None
    return str(dashes), str(line.get_marker()), round(float(line.get_linewidth()), 2)


def tell_apart(axes: Any) -> None:
    """Curves of axes that have different colours get different dashes; those of one colour, as the
    edges of a band, keep theirs together.
    """
    kinds: dict[Any, list[Any]] = {}
    for line in axes.get_lines():
        if line.get_linestyle() != "None" and np.size(line.get_xdata()) > 1:
            kinds.setdefault((str(line.get_color()), *look_of(line)), []).append(line)
    taken: set[Any] = set()
    for lines in kinds.values():
        own = look_of(lines[0])
        if own in taken:
            dashes, width = next(
                (d, w) for w in WIDTHS for d in DASHES if _with(lines[0], d, w) not in taken
            )
            for line in lines:
                line.set(linestyle=dashes, linewidth=width * line.get_linewidth())
            own = look_of(lines[0])
        taken.add(own)
    if legend := axes.get_legend():
        _repeat(legend, axes.get_legend_handles_labels()[0])


def _repeat(legend: Any, shown: Iterable[Any]) -> None:
    """The looks of curves in their legend."""
    from matplotlib.lines import Line2D

    for handle, line in zip(legend.legend_handles, shown, strict=False):
        if isinstance(line, Line2D) and isinstance(handle, Line2D):
            dashed = line.get_linestyle() != "None"
            handle.set_linestyle(_dashes(line) if dashed else "None")
            handle.set_linewidth(line.get_linewidth())


def _dashes(line: Any) -> Any:
    offset, pattern = line._unscaled_dash_pattern
    return (offset, tuple(pattern)) if pattern else "-"


def _with(line: Any, dashes: Any, width: float) -> tuple[Any, ...]:
    """The look that a curve would have with dashes and so many times its width."""
    had, wide = _dashes(line), line.get_linewidth()
    line.set(linestyle=dashes, linewidth=width * wide)
    look = look_of(line)
    line.set(linestyle=had, linewidth=wide)
    return look


# ---- symbols


def mathematical(text: str) -> str:
    """Symbols of a label as in formulas: `rho_ref [m]`; units with raised powers."""
    if "$" in text:
        return text
    parts = re.split(r"(\[[^\]]*\])", text)
    return "".join(_unit(p) if p.startswith("[") else SYMBOL.sub(_formula, p) for p in parts)


def _unit(text: str) -> str:
    """A unit in brackets with raised powers."""
    raised = re.sub(r"(?<=[a-z])(-?\d)", lambda m: m[1].translate(POWERS), text)
    return raised.replace(".", "\u00b7")


def _formula(found: re.Match[str]) -> str:
    base = found["base"] or found["alone"]
    name = f"\\{base}" if len(base) > 1 else base
    index = (found["index"] or "").replace("_", ",")
    upright = index if len(index) < 2 else rf"\mathrm{{{index}}}"
    return f"${name}_{{{upright}}}$" if index else f"${name}$"


def symbols(text: str) -> str:
    """A sentence with its symbols as in formulas, units as they are."""
    return text if "$" in text else SYMBOL.sub(_formula, text)


def _symbols(canvas: Any) -> None:
    for axes in canvas.axes:
        for text in (axes.title, *axes.texts):
            text.set_text(mathematical(text.get_text()))
        for axis in filter(None, (axes.xaxis, axes.yaxis, getattr(axes, "zaxis", None))):
            axis.set_label_text(mathematical(axis.get_label_text()))
        if legend := axes.get_legend():
            for text in legend.get_texts():
                text.set_text(mathematical(text.get_text()))
