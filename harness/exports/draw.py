# SPDX-License-Identifier: BSD-2-Clause
"""A system as a block diagram: .svg, .pdf or .png by matplotlib.

Components stand in a row in execution order; signals are bundled into nets, with lines at right
angles. As in the geometry of the .ssd, inputs are on the left and outputs on the right of a block.
Vectors are one signal, and all signals that go from one component to the same others are one net.
A net to the next block is a straight arrow; others run in lanes, forward above the blocks and
backward below, the shorter the closer.
"""

from __future__ import annotations

import io
import textwrap
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from harness.errors import UsageError
from harness.files.output import written
from harness.system.model import System

CHARACTER, LINE = 7.3, 15
"""Width of a character and distance of two lines of text [px]."""

BLOCK, PORT, TRACK, LANE, MARGIN = 130, 16, 12, 26, 30
"""Least width of a block; distances of ports, of vertical tracks, of horizontal lanes; margin
[px].
"""

Points = tuple[tuple[float, float], ...]


class Net(NamedTuple):
    """Signals from one component to others, all before it or all behind it; components by index."""

    source: int
    targets: tuple[int, ...]
    signals: tuple[str, ...]

    @property
    def kind(self) -> str:
        """Straight to the next block, forward above the blocks, or back below them."""
        if self.targets[0] <= self.source:
            return "back"
        return "straight" if self.targets == (self.source + 1,) else "forward"

    @property
    def span(self) -> int:
        """Number of blocks that it passes at most."""
        return max(abs(target - self.source) for target in self.targets)


class Text(NamedTuple):
    """Lines of text, the first one at (x, y); `anchor` start, middle or end."""

    x: float
    y: float
    lines: tuple[str, ...]
    anchor: str


@dataclass
class Diagram:
    """What there is to draw: blocks (left, top, width, height), lines with or without an arrow
    head, texts.
    """

    width: float = 0.0
    height: float = 0.0
    blocks: list[tuple[float, float, float, float]] = field(default_factory=list)
    titles: list[tuple[str, str]] = field(default_factory=list)
    arrows: list[Points] = field(default_factory=list)
    lines: list[Points] = field(default_factory=list)
    labels: list[Text] = field(default_factory=list)
    dots: list[tuple[float, float]] = field(default_factory=list)


def nets(system: System) -> list[Net]:
    """All connections of a system, bundled."""
    index = {c.name: i for i, c in enumerate(system.components)}
    readers: dict[tuple[int, str], set[tuple[int, str]]] = defaultdict(set)
    for start, end, _ in system.connections:
        signal = (index[start.component], start.signal)
        readers[signal].add((index[end.component], end.signal))
    bundles: dict[tuple[int, tuple[int, ...]], list[str]] = defaultdict(list)
    for (source, name), ends in readers.items():
        for side in (True, False):
            targets = sorted({t for t, _ in ends if (t > source) == side})
            others = sorted({other for t, other in ends if (t > source) == side and other != name})
            if targets:
                bundles[source, tuple(targets)].append(
                    name + (f" > {', '.join(others)}" if others else "")
                )
    return [Net(source, targets, tuple(names)) for (source, targets), names in bundles.items()]


def lay_out(system: System) -> Diagram:
    """Places of everything in the picture."""
    return _Layout(system).diagram


class _Layout:
    def __init__(self, system: System) -> None:
        self.titles = [(c.name, c.fmu.stem) for c in system.components]
        self.nets = nets(system)
        self.lanes = {kind: self._lanes(kind) for kind in ("forward", "back")}
        self.diagram = Diagram(titles=self.titles)
        self._columns()
        self._rows()
        for net in self.nets:
            self._draw(net)

    def _lanes(self, kind: str) -> list[Net]:
        """Nets of the lanes on one side, the closest to the blocks first."""
        return sorted(
            (net for net in self.nets if net.kind == kind), key=lambda net: (net.span, net.source)
        )

    def _leaving(self, i: int, kind: str) -> list[Net]:
        return [net for net in self.lanes[kind] if net.source == i]

    def _entering(self, i: int, kind: str) -> list[Net]:
        return [net for net in self.lanes[kind] if i in net.targets]

    def _straight(self, i: int) -> list[Net]:
        return [net for net in self.nets if net.kind == "straight" and net.source == i]

    # ---- sizes

    def _columns(self) -> None:
        """Left edges of the blocks, and the room between them for tracks and labels."""
        self.left: list[float] = []
        x = float(MARGIN) + self._tracks(self._entering, 0)
        self.widths = [max(BLOCK, CHARACTER * (2 + max(map(len, title)))) for title in self.titles]
        for i, width in enumerate(self.widths):
            self.left.append(x)
            label = max((len(s) for net in self._straight(i) for s in net.signals), default=0)
            x += (
                width
                + self._tracks(self._leaving, i)
                + CHARACTER * label
                + 50
                + self._tracks(self._entering, i + 1)
            )
        self.diagram.width = x - 50 + MARGIN

    def _tracks(self, nets_of: Callable[[int, str], list[Net]], i: int) -> float:
        return TRACK * (1 + max(len(nets_of(i, "forward")), len(nets_of(i, "back"))))

    def _rows(self) -> None:
        """Zones from the top: lanes forward, their ports, straight arrows, ports and lanes back."""
        count = range(len(self.titles))
        ports = {
            kind: max(
                (
                    len(nets_of(i, kind))
                    for nets_of in (self._leaving, self._entering)
                    for i in count
                ),
                default=0,
            )
            for kind in self.lanes
        }
        middle = max((sum(self._stack(net) for net in self._straight(i)) for i in count), default=0)
        self.top = MARGIN + LINE + LANE * (len(self.lanes["forward"]) + 1)
        self.middle = self.top + PORT * (ports["forward"] + 0.5)
        height = PORT * (ports["forward"] + ports["back"] + 1) + max(middle, 3 * LINE)
        self.bottom = self.top + height
        self.diagram.height = self.bottom + LANE * (len(self.lanes["back"]) + 1) + MARGIN / 2
        self.diagram.blocks = [
            (x, self.top, w, height) for x, w in zip(self.left, self.widths, strict=True)
        ]

    @staticmethod
    def _stack(net: Net) -> float:
        """Height of a straight arrow with its label above."""
        return LINE * len(net.signals) + 10

    # ---- nets

    def _draw(self, net: Net) -> None:
        if net.kind == "straight":
            self._draw_straight(net)
        else:
            self._draw_lane(net)

    def _draw_straight(self, net: Net) -> None:
        nets_here = self._straight(net.source)
        y = self.middle + sum(self._stack(other) for other in nets_here[: nets_here.index(net) + 1])
        start, end = self.left[net.source] + self.widths[net.source], self.left[net.source + 1]
        self.diagram.arrows.append(((start, y), (end, y)))
        at = start + self._tracks(self._leaving, net.source) + 10
        self.diagram.labels.append(
            Text(at, y - 6 - LINE * (len(net.signals) - 1), net.signals, "start")
        )

    def _port(self, nets_here: Sequence[Net], net: Net) -> tuple[float, float]:
        """Distance of the track from the block, and height of the port: the closer the lane, the
        closer both.
        """
        place = nets_here.index(net) + 1
        edge = (
            self.top + PORT * (place - 0.25)
            if net.kind == "forward"
            else self.bottom - PORT * (place - 0.25)
        )
        return TRACK * place, edge

    def _draw_lane(self, net: Net) -> None:
        lane = LANE * (self.lanes[net.kind].index(net) + 1)
        y = self.top - lane if net.kind == "forward" else self.bottom + lane
        track, port = self._port(self._leaving(net.source, net.kind), net)
        right = self.left[net.source] + self.widths[net.source]
        entries = list(self._entries(net))
        far = (max if net.kind == "forward" else min)(x for x, _, _ in entries)
        self.diagram.lines.append(
            ((right, port), (right + track, port), (right + track, y), (far, y))
        )
        for x, height, edge in entries:
            self.diagram.arrows.append(((x, y), (x, height), (edge, height)))
            if x != far:
                self.diagram.dots.append((x, y))
        at, anchor = (
            (right + track + 6, "start") if net.kind == "forward" else (right + track - 6, "end")
        )
        self.diagram.labels.append(Text(at, y - 5, (", ".join(net.signals),), anchor))

    def _entries(self, net: Net) -> Iterator[tuple[float, float, float]]:
        """Track, port and left edge of every block that a net enters."""
        for target in net.targets:
            track, port = self._port(self._entering(target, net.kind), net)
            yield self.left[target] - track - 8, port, self.left[target]


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
