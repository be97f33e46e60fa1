# SPDX-License-Identifier: BSD-2-Clause
"""A system as a block diagram: .svg, .pdf or .png by matplotlib."""

from __future__ import annotations

import io
import textwrap
from pathlib import Path
from typing import Any

from harness.errors import UsageError
from harness.exports.diagram import CHARACTER, LINE, MARGIN, Diagram, Text, lay_out
from harness.files.output import written
from harness.system.model import System

FORMATS = ("svg", "pdf", "png")
INK, PAPER, GREY = "#34506b", "#eef3f8", "#5a6b7c"
PIXELS = 96.0
"""Per inch, as of CSS."""
FONT: Any = {
    "font.family": "monospace",
    "font.monospace": ["DejaVu Sans Mono"],
    "svg.fonttype": "none",
    "svg.hashsalt": "servicing-fmus",
    "pdf.fonttype": 42,
}


def draw(system: System, path: Path) -> None:
    """Write the block diagram of a system; UsageError for an ending that is none of FORMATS,
    ResultsError if it cannot be written.
    """
    ending = path.suffix.removeprefix(".")
    if ending not in FORMATS:
        raise UsageError(
            f"{path}: a diagram is written as .{', .'.join(FORMATS)}, not as '{path.suffix}'"
        )
    with written(path) as target:
        target.write_bytes(_painted(system, ending))


def svg(system: System) -> bytes:
    """The block diagram of a system; the same system gives the same bytes."""
    return _painted(system, "svg")


def _painted(system: System, ending: str) -> bytes:
    import matplotlib as mpl

    file, undated = io.BytesIO(), {"svg": {"Date": None}, "pdf": {"CreationDate": None}}
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(FONT)
        canvas = _canvas(system)
        canvas.savefig(file, format=ending, dpi=2 * PIXELS, metadata=undated.get(ending))
    return file.getvalue()


def _canvas(system: System) -> Any:
    """A figure of matplotlib whose unit is the pixel of the layout, from the top left."""
    from matplotlib.figure import Figure

    diagram = lay_out(system)
    title = _title(system, diagram.width)
    above = LINE * (len(title) - 1)
    width, height = diagram.width, diagram.height + above
    canvas = Figure(figsize=(width / PIXELS, height / PIXELS))
    axes = canvas.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(diagram.height, -above))
    axes.set_axis_off()
    for row, line in enumerate(title):
        _words(axes, 12, 20 - above + row * LINE, line, color=GREY)
    _blocks(axes, diagram)
    _wires(axes, diagram)
    return canvas


def _title(system: System, width: float) -> list[str]:
    """Name and description, in lines that the picture is wide enough for."""
    words = f"{system.name}: {system.description}".rstrip(": ")
    return textwrap.wrap(words, int((width - MARGIN) / CHARACTER)) or [words]


def _blocks(axes: Any, diagram: Diagram) -> None:
    from matplotlib.patches import FancyBboxPatch

    for (x, y, width, height), (name, fmu) in zip(diagram.blocks, diagram.titles, strict=True):
        round_ = "round,pad=0,rounding_size=5"
        axes.add_patch(FancyBboxPatch((x, y), width, height, round_, fc=PAPER, ec=INK, lw=1.1))
        middle = y + height / 2
        _words(axes, x + width / 2, middle - 2, name, ha="center", size=10, weight="bold")
        if fmu != name:
            _words(axes, x + width / 2, middle + LINE, fmu, ha="center", color=GREY)


def _wires(axes: Any, diagram: Diagram) -> None:
    for points in (*diagram.lines, *diagram.arrows):
        axes.plot(*zip(*points, strict=True), color=INK, lw=1, solid_joinstyle="miter")
    for points in diagram.arrows:
        head = {"arrowstyle": "-|>", "color": INK, "lw": 1, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", points[-1], points[-2], arrowprops=head)
    for x, y in diagram.dots:
        axes.plot(x, y, "o", color=INK, ms=4)
    for label in diagram.labels:
        _label(axes, label)


def _label(axes: Any, label: Text) -> None:
    side = {"start": "left", "middle": "center", "end": "right"}[label.anchor]
    clear = {"fc": "white", "ec": "none", "pad": 0.6}  # where a line passes
    for row, line in enumerate(label.lines):
        _words(axes, label.x, label.y + row * LINE, line, ha=side, bbox=clear)


def _words(axes: Any, x: float, y: float, words: str, **look: Any) -> None:
    axes.text(x, y, words, **{"size": 9, "color": "#1b2a3a", "parse_math": False, **look})
