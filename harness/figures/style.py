# SPDX-License-Identifier: BSD-2-Clause
"""Appearance of figures on a screen or in a paper: style sheets of matplotlib, the widths and
titles that a style sheet cannot state, the unit of the time axis, legends.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.errors import UsageError
from harness.files.output import written
from harness.results.result import Array

SHEETS = Path(__file__).parent / "styles"
NARROW, HOURS = 8.0, 7200.0
"""Largest width on the screen [in] of a figure that is drawn in one column of a paper (wider
figures go across the page); shortest time span [s] that is shown in hours.
"""
COLUMN, PAGE, STRETCH = 3.5, 7.0, 1.15
"""Width [in] in a paper of a figure in one column and of a figure across the page. STRETCH: ratio
of height to width of a figure in one column, relative to this ratio on the screen.
"""
TITLE = 0.75
"""Largest number of characters in a line of a title, relative to the number of characters of
ordinary text that fit into the figure width: a title has larger characters.
"""
MANY = 10
"""Smallest number of runs that are drawn with a colour scale, since a legend would be too long."""


@dataclass(frozen=True)
class Style:
    """Appearance of figures for the screen or a paper.

    sheets: style sheets of matplotlib; a later sheet overrides an earlier one; printed: whether
    figures are for a paper; they then have the widths of its columns and no titles, because the
    captions of the paper state them.
    """

    sheets: tuple[str, ...] = ("screen.mplstyle",)
    printed: bool = False

    def size(self, size: tuple[float, float]) -> tuple[float, float]:
        """Return width and height of a figure in this style [in]; size: width and height on the
        screen [in].
        """
        width, height = size
        if not self.printed:
            return size
        if width > NARROW:
            return PAGE, height * PAGE / width
        return COLUMN, height * STRETCH * COLUMN / width

    @contextmanager
    def used(self) -> Iterator[None]:
        """Apply the style sheets inside a `with` block, in which figures are drawn and saved."""
        import matplotlib as mpl

        with mpl.rc_context():
            mpl.rcdefaults()
            for sheet in self.sheets:
                found = mpl.rc_params_from_file(SHEETS / sheet, use_default_template=False)
                mpl.rcParams.update(found)
            yield


SCREEN = Style()
PAPER = Style(("paper.mplstyle",), printed=True)
SERIF = Style(("paper.mplstyle", "serif.mplstyle"), printed=True)
STYLES = {"screen": SCREEN, "paper": PAPER, "serif": SERIF}


def style_of(name: str) -> Style:
    """Return the style with this name; raise UsageError if there is no such style."""
    if name not in STYLES:
        raise UsageError(f"there is no style {name}, only {', '.join(STYLES)}")
    return STYLES[name]


def new_canvas(title: str, size: tuple[float, float], style: Style = SCREEN) -> Any:
    """Return an empty figure of matplotlib, which opens no window and does not use pyplot; size:
    width and height on the screen [in].
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    canvas = Figure(layout="constrained", figsize=style.size(size))
    FigureCanvasAgg(canvas)
    if not style.printed:
        lines = (wrapped(line, TITLE * size[0]) for line in title.splitlines())
        canvas.suptitle("\n".join(lines))
    return canvas


def save(canvas: Any, path: Path) -> Path:
    """Write a figure from new_canvas() to a file and return its path; raise ResultsError if that
    fails.
    """
    undated = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with written(path) as target:
        canvas.savefig(target, metadata=undated.get(path.suffix))
    return path


def place_of(colour: Any) -> Any:
    """Return the index of a colour in the colour cycle of the style sheet: 3 for `C3`, "ink" for
    black, otherwise the index of the most similar colour.
    """
    from matplotlib import rcParams
    from matplotlib.colors import to_rgb

    if isinstance(colour, str) and re.fullmatch(r"C\d+", colour):
        return int(colour[1:])
    shown = to_rgb(colour)
    cycle = [to_rgb(each) for each in rcParams["axes.prop_cycle"].by_key()["color"]]
    return int(np.linalg.norm(np.subtract(cycle, shown), axis=1).argmin()) if any(shown) else "ink"


# ---- time


class TimeAxis(NamedTuple):
    """Unit of a time axis ("s" or "h") and the length of this unit in seconds."""

    unit: str
    seconds: float

    @property
    def label(self) -> str:
        """Return the label of the axis."""
        return f"time [{self.unit}]"


def time_axis(*times: Array) -> TimeAxis:
    """Return the unit for the time axis of several runs, given by their times [s]: hours if the
    longest run lasts HOURS or more, otherwise seconds.
    """
    span = max((t[-1] - t[0] for t in times if len(t)), default=0.0)
    return TimeAxis("h", 3600.0) if span >= HOURS else TimeAxis("s", 1.0)


# ---- texts


def wrapped(label: str, length: float) -> str:
    """Return an axis label, divided into lines of at most `length` inches, without a line break
    inside a unit.
    """
    whole = re.sub(r"\[.*?\]", lambda unit: unit[0].replace(" ", "\u00a0"), label)
    return textwrap.fill(whole, max(int(length / _character()), 8), break_long_words=False)


def fitting(names: Sequence[str], width: float) -> int:
    """Return how many legend entries with these names fit side by side into `width` inches."""
    entry = _character() * (5 + max(map(len, names)))
    return min(max(int(width / entry), 1), len(names))


def _character() -> float:
    """Return the mean width of a character of ordinary text [in]."""
    from matplotlib import rcParams

    return 0.55 / 72 * float(rcParams["font.size"])


def legend_above(axes: Any, handles: Sequence[Any] | None = None) -> None:
    """Add a legend above a panel, where it hides no curve.

    handles: curves in the legend (None: all curves with a label).
    """
    shown = handles or axes.get_legend_handles_labels()[0]
    if shown:
        width = axes.figure.get_figwidth() / axes.get_subplotspec().get_geometry()[1]
        names = [handle.get_label() for handle in shown]
        axes.legend(
            handles=shown,
            loc="lower right",
            bbox_to_anchor=(1, 1),
            borderaxespad=0.1,
            ncols=fitting(names, 0.85 * width),
        )
