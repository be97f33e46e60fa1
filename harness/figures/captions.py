# SPDX-License-Identifier: BSD-2-Clause
"""Captions of the figures of a paper, to be pasted: `captions.md` and `captions.tex` beside them.

A caption says what is drawn, of which run, what the dashes and levels mean and the least values
that matter; all of it comes from the tables of the figures and from the result.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path

from harness.figures.finish import symbols
from harness.figures.limits import unit_of
from harness.files.output import written
from harness.mission.figure import Drawing, Figure, Overlay
from harness.results.result import Result

SPECIAL = str.maketrans({c: f"\\{c}" for c in "&%$#_{}"})
"""Characters that TeX takes for commands."""


def written_captions(
    directory: Path,
    figures: Mapping[str, Figure | Drawing | Overlay],
    results: Mapping[str, Result],
) -> list[Path]:
    """Write the captions of figures by the stem of their files; returns the two files."""
    texts = {name: caption(figure, results) for name, figure in figures.items()}
    plain = "".join(f"**{name}.** {symbols(text)}\n\n" for name, text in texts.items())
    tex = "".join(
        f"% {name}\n\\caption{{{_escaped(symbols(text))}}}\n\\label{{fig:{name}}}\n\n"
        for name, text in texts.items()
    )
    files = {directory / "captions.md": plain, directory / "captions.tex": tex}
    for path, content in files.items():
        with written(path) as target:
            target.write_text(content, encoding="utf-8")
    return list(files)


def _escaped(text: str) -> str:
    """A text for TeX; formulas between dollar signs stay."""
    parts = text.split("$")
    return "$".join(p if k % 2 else p.translate(SPECIAL) for k, p in enumerate(parts))


def caption(figure: Figure | Drawing | Overlay, results: Mapping[str, Result]) -> str:
    """What a figure shows, in sentences."""
    parts = [figure.title, *(_panels(figure, results) if isinstance(figure, Figure) else ())]
    return ". ".join([*parts, _runs(results)]) + "."


def _panels(figure: Figure, results: Mapping[str, Result]) -> Iterator[str]:
    result = next(iter(results.values()))
    if len(figure.panels) > 1:
        yield "From top to bottom: " + "; ".join(panel.ylabel for panel in figure.panels)
    for panel in figure.panels:
        height = panel.level.height(result) if panel.level else None
        if panel.level and height is not None:
            yield f"Level, {panel.level.label} {height:g} {unit_of(panel.ylabel)}".rstrip()
        for label, run in results.items():
            for time, value in panel.minima(run) if figure.fits(run) else ():
                whose = f" of {label}" if label else ""
                yield f"Least value{whose} {value:.4g} {unit_of(panel.ylabel)} at {time:g} s"


def _runs(results: Mapping[str, Result]) -> str:
    """Which runs, with the set, and from when to when."""
    first = next(iter(results.values()))
    known = first.provenance
    chosen = f", set {known.params}" if known and known.params else ""
    runs = f"; runs: {', '.join(results)}" if len(results) > 1 else ""
    end = max(float(r.time[-1]) for r in results.values())
    return f"System {first.system}{chosen}{runs}, {first.time[0]:g} to {end:g} s"
