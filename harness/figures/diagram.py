# SPDX-License-Identifier: BSD-2-Clause
"""N2 diagram of a system as .svg, .pdf or .png by matplotlib.

The blocks of the components are on the diagonal in execution order. Signals leave a block along its
row and enter another block along the column of that block; the field where both cross names the
signals. Fields above the diagonal hold signals to later components, fields below it signals to
earlier ones. A vector is one signal.
"""

from __future__ import annotations

import io
import textwrap
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.errors import UsageError
from harness.figures.style import Style
from harness.files.output import written
from harness.system.model import System

CHARACTER, LINE = 7.3, 15
"""Width of a character and distance of two lines of text [px]."""
PAD, GAP, MARGIN = 7, 18, 20
"""Distances between text and edge of a field, between fields, and around the diagram [px]."""
LEAST = 60
"""Smallest number of characters for which a line of the title has space, even if the fields of the
diagram are narrower.
"""
FORMATS = ("svg", "pdf", "png")
INK, PAPER, GREY = "#34506b", "#eef3f8", "#5a6b7c"
PIXELS = 96.0
"""Pixels per inch, as in CSS."""
STYLE = Style(("diagram.mplstyle",))
Place = tuple[int, int]


class Field(NamedTuple):
    """Rectangle with lines of text; left, top, width, height in [px]."""

    x: float
    y: float
    width: float
    height: float
    lines: tuple[str, ...]

    @property
    def middle(self) -> tuple[float, float]:
        """Return the middle of the field, where the wires of its row and column cross [px]."""
        return self.x + self.width / 2, self.y + self.height / 2


def texts(system: System) -> dict[Place, list[str]]:
    """Return the lines of text of every field by row and column.

    On the diagonal: the component, its FMU, and signals from the component to itself. Elsewhere:
    the signals from the component of the row to the component of the column.
    """
    index = {c.name: k for k, c in enumerate(system.components)}
    found: dict[Place, list[str]] = defaultdict(list)
    for k, c in enumerate(system.components):
        found[k, k] = [c.name] if c.fmu.stem == c.name else [c.name, c.fmu.stem]
    for start, end, _ in system.connections:
        line = start.signal + (f" > {end.signal}" if end.signal != start.signal else "")
        lines = found[index[start.component], index[end.component]]
        if line not in lines:
            lines.append(line)
    return found


def lay_out(system: System) -> dict[Place, Field]:
    """Return all fields by row and column. A column is as wide, and a row as high, as the largest
    text in it needs.
    """
    found, count = texts(system), len(system.components)
    widths, heights = np.zeros(count), np.zeros(count)
    for (row, column), lines in found.items():
        widths[column] = max(widths[column], CHARACTER * max(map(len, lines)) + 2 * PAD)
        heights[row] = max(heights[row], LINE * len(lines) + 2 * PAD)
    lefts = MARGIN + np.cumsum(widths + GAP) - widths - GAP
    tops = MARGIN + np.cumsum(heights + GAP) - heights - GAP
    return {
        (row, column): Field(lefts[column], tops[row], widths[column], heights[row], tuple(lines))
        for (row, column), lines in found.items()
    }


def draw(system: System, path: Path) -> None:
    """Write the diagram of a system to a file; raise UsageError if the ending of `path` is not in
    FORMATS, ResultsError if the file cannot be written.
    """
    ending = path.suffix.removeprefix(".")
    if ending not in FORMATS:
        known = ", .".join(FORMATS)
        raise UsageError(f"{path}: a diagram is written as .{known}, not as '{path.suffix}'")
    with written(path) as target:
        target.write_bytes(painted(system, ending))


def painted(system: System, ending: str = "svg") -> bytes:
    """Return the diagram of a system as the bytes of a file; `ending`, one of FORMATS, selects the
    format. The same system gives the same bytes.
    """
    file, undated = io.BytesIO(), {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    with STYLE.used():
        canvas = _canvas(system, lay_out(system))
        canvas.savefig(file, format=ending, dpi=2 * PIXELS, metadata=undated.get(ending))
    return file.getvalue()


def _canvas(system: System, fields: dict[Place, Field]) -> Any:
    """Return the diagram as a matplotlib figure whose coordinates are the pixels of the layout: x
    to the right, y down.
    """
    from matplotlib.figure import Figure

    words = f"{system.name}: {system.description}".rstrip(": ")
    right = max(field.x + field.width for field in fields.values())
    bottom = max(field.y + field.height for field in fields.values()) + MARGIN
    title = textwrap.wrap(words, max(int((right - MARGIN) / CHARACTER), LEAST))
    width = MARGIN + max(right, MARGIN + CHARACTER * max(map(len, title), default=0))
    above = LINE * len(title) + PAD
    canvas = Figure(figsize=(width / PIXELS, (bottom + above) / PIXELS))
    axes = canvas.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(bottom, -above))
    for k, line in enumerate(title):
        _words(axes, MARGIN, MARGIN - above + k * LINE, line, ha="left", color=GREY)
    _paint_all(axes, fields)
    return canvas


def _paint_all(axes: Any, fields: dict[Place, Field]) -> None:
    """Draw all fields and wires, and hide the axes of matplotlib."""
    axes.set_axis_off()
    for (row, column), field in fields.items():
        _paint(axes, field, row == column)
        if row != column:
            _wire(axes, fields[row, row], field, fields[column, column])


def _paint(axes: Any, field: Field, block: bool) -> None:
    """Draw a field with its lines of text; block: whether the field is a component."""
    from matplotlib.patches import FancyBboxPatch

    look: Any = (
        {"fc": PAPER, "ec": INK, "lw": 1.1} if block else {"fc": "white", "ec": GREY, "lw": 0.4}
    )
    corner = (field.x, field.y)
    style = "round,pad=0,rounding_size=4"
    axes.add_patch(FancyBboxPatch(corner, field.width, field.height, style, zorder=3, **look))
    x, y = field.middle
    for k, line in enumerate(field.lines):
        title = {"size": 10, "weight": "bold"} if block and k == 0 else {}
        _words(axes, x, y + (k + 0.5 - len(field.lines) / 2) * LINE, line, **title)


def _wire(axes: Any, start: Field, field: Field, end: Field) -> None:
    """Draw a wire from the middle of the block `start` along its row to the middle of `field`, and
    from there down or up to the edge of the block `end`.
    """
    x, y = field.middle
    edge = end.y if end.y > y else end.y + end.height
    axes.plot([start.middle[0], x], [y, y], color=INK, lw=1, zorder=1)
    head = {"arrowstyle": "-|>", "color": INK, "lw": 1, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (x, edge), (x, y), arrowprops=head, zorder=2)


def _words(axes: Any, x: float, y: float, words: str, **look: Any) -> None:
    plain = {"size": 9, "color": "#1b2a3a", "ha": "center", "va": "center_baseline", "zorder": 4}
    axes.text(x, y, words, parse_math=False, **plain | look)
