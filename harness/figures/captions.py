# SPDX-License-Identifier: BSD-2-Clause
"""Texts of figures: symbols as in formulas, numbers of ticks, and captions for a paper in
`captions.md` and `captions.tex` beside the figures.

A caption states the content, the run, the meaning of dashes and levels and the smallest values. Its
sources are the tables of the figures and the result.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from harness.files.output import written
from harness.mission.figure import Drawing, Figure, Overlay, unit_of
from harness.results.result import Result

GREEK = (
    "alpha|beta|gamma|delta|epsilon|zeta|eta|theta|kappa|lambda|mu|nu|xi|rho|sigma|tau|phi|chi|psi"
    "|omega|Delta|Gamma|Omega"
)
SYMBOL = re.compile(rf"(?<![\w$\\.])(?P<base>{GREEK}|[A-Za-z])_(?P<index>\w+)(?![\w.])|"
                    rf"(?<![\w$\\.])(?P<alone>{GREEK})(?![\w.])")  # fmt: skip
POWERS = str.maketrans(
    "0123456789-", "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079\u207b"
)
SPECIAL = str.maketrans({c: f"\\{c}" for c in "&%$#_{}"})
"""Escapes of characters that TeX reads as commands."""


def write_captions(
    directory: Path,
    figures: Mapping[str, Figure | Drawing | Overlay],
    results: Mapping[str, Result],
) -> list[Path]:
    """Write the captions of figures by the stem of their files, and return the two paths."""
    texts = {name: caption(figure, results) for name, figure in figures.items()}
    plain = "".join(f"**{name}.** {symbols(text)}\n\n" for name, text in texts.items())
    tex = "".join(_tex(name, text) for name, text in texts.items())
    files = {directory / "captions.md": plain, directory / "captions.tex": tex}
    for path, content in files.items():
        with written(path) as target:
            target.write_text(content, encoding="utf-8")
    return list(files)


def _tex(name: str, text: str) -> str:
    return f"% {name}\n\\caption{{{_escaped(symbols(text))}}}\n\\label{{fig:{name}}}\n\n"


def _escaped(text: str) -> str:
    """Return a text for TeX; formulas between dollar signs are unchanged."""
    parts = text.split("$")
    return "$".join(p if k % 2 else p.translate(SPECIAL) for k, p in enumerate(parts))


def caption(figure: Figure | Drawing | Overlay, results: Mapping[str, Result]) -> str:
    """Return what a figure shows, in sentences."""
    parts = [
        figure.title,
        *(_panel_sentences(figure, results) if isinstance(figure, Figure) else ()),
    ]
    return ". ".join([*parts, _runs(results)]) + "."


def _panel_sentences(figure: Figure, results: Mapping[str, Result]) -> Iterator[str]:
    result = next(iter(results.values()))
    if len(figure.panels) > 1:
        yield "From top to bottom: " + "; ".join(panel.ylabel for panel in figure.panels)
    for panel in figure.panels:
        if line := panel.line(result):
            yield f"Level, {line[1]}"
        for label, run in results.items():
            for time, value in panel.minima(run) if figure.fits(run) else ():
                of = f" of {label}" if label else ""
                yield f"Smallest value{of} {value:.4g} {unit_of(panel.ylabel)} at {time:g} s"


def _runs(results: Mapping[str, Result]) -> str:
    """Return system, parameter set, runs and time span."""
    first = next(iter(results.values()))
    known = first.provenance
    chosen = f", parameter set {known.params}" if known and known.params else ""
    runs = f"; runs: {', '.join(results)}" if len(results) > 1 else ""
    end = max(float(r.time[-1]) for r in results.values())
    return f"System {first.system}{chosen}{runs}, {first.time[0]:g} to {end:g} s"


# ---- symbols and numbers


def mathematical(text: str) -> str:
    """Return a label as `rho_ref [m]` with symbols as in formulas and powers of units raised."""
    if "$" in text:
        return text
    parts = re.split(r"(\[[^\]]*\])", text)
    return "".join(_unit(p) if p.startswith("[") else SYMBOL.sub(_formula, p) for p in parts)


def _unit(text: str) -> str:
    """Return a unit in brackets with raised powers."""
    raised = re.sub(r"(?<=[a-z])(-?\d)", lambda m: m[1].translate(POWERS), text)
    return raised.replace(".", "\u00b7")


def _formula(found: re.Match[str]) -> str:
    base = found["base"] or found["alone"]
    name = f"\\{base}" if len(base) > 1 else base
    index = (found["index"] or "").replace("_", ",")
    upright = index if len(index) < 2 else rf"\mathrm{{{index}}}"
    return f"${name}_{{{upright}}}$" if index else f"${name}$"


def symbols(text: str) -> str:
    """Return a sentence with its symbols as in formulas; units are unchanged."""
    return text if "$" in text else SYMBOL.sub(_formula, text)


def plain_number(value: float) -> str:
    """Return the number of a tick without the mark-up of formulas."""
    if 1e-4 < abs(value) < 1e5:
        return f"{value:.4g}"
    power = int(np.floor(np.log10(abs(value))))
    part = f"{value / 10.0**power:.3g}"
    front = "" if part == "1" else f"{part}\u00d7"
    return f"{front}10{str(power).translate(POWERS)}"
