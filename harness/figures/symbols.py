# SPDX-License-Identifier: BSD-2-Clause
"""Texts of figures in print: symbols as in formulas, and numbers of ticks."""

from __future__ import annotations

import re

import numpy as np

GREEK = (
    "alpha|beta|gamma|delta|epsilon|zeta|eta|theta|kappa|lambda|mu|nu|xi|rho|sigma|tau|phi|chi|psi"
    "|omega|Delta|Gamma|Omega"
)
SYMBOL = re.compile(rf"(?<![\w$\\.])(?P<base>{GREEK}|[A-Za-z])_(?P<index>\w+)(?![\w.])|"
                    rf"(?<![\w$\\.])(?P<alone>{GREEK})(?![\w.])")  # fmt: skip
POWERS = str.maketrans(
    "0123456789-", "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079\u207b"
)


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


def plain_number(value: float) -> str:
    """Return the number of a tick without the mark-up of formulas."""
    if 1e-4 < abs(value) < 1e5:
        return f"{value:.4g}"
    power = int(np.floor(np.log10(abs(value))))
    part = f"{value / 10.0**power:.3g}"
    front = "" if part == "1" else f"{part}\u00d7"
    return f"{front}10{str(power).translate(POWERS)}"
