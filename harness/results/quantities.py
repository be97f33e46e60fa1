# SPDX-License-Identifier: BSD-2-Clause
"""Units as people write them beside a number, `2 deg`, `3.3 m/min`, and their conversion.

The syntax is that of the FMUs: factors between points, exponents as digits, what follows a slash
divides (`kg.m2`, `m/s2`, `1/(N.m)`).
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping

from harness.spelling import did_you_mean
from harness.system.names import base
from harness.system.units import Base, Unit, compose

SYMBOLS: dict[str, tuple[float, dict[str, int]]] = {
    "1": (1.0, {}),
    "%": (0.01, {}),
    "m": (1.0, {"m": 1}),
    "km": (1e3, {"m": 1}),
    "cm": (1e-2, {"m": 1}),
    "mm": (1e-3, {"m": 1}),
    "um": (1e-6, {"m": 1}),
    "s": (1.0, {"s": 1}),
    "ms": (1e-3, {"s": 1}),
    "us": (1e-6, {"s": 1}),
    "min": (60.0, {"s": 1}),
    "h": (3600.0, {"s": 1}),
    "kg": (1.0, {"kg": 1}),
    "g": (1e-3, {"kg": 1}),
    "rad": (1.0, {"rad": 1}),
    "mrad": (1e-3, {"rad": 1}),
    "deg": (math.pi / 180, {"rad": 1}),
    "arcmin": (math.pi / 10800, {"rad": 1}),
    "arcsec": (math.pi / 648000, {"rad": 1}),
    "N": (1.0, {"kg": 1, "m": 1, "s": -2}),
    "mN": (1e-3, {"kg": 1, "m": 1, "s": -2}),
    "kN": (1e3, {"kg": 1, "m": 1, "s": -2}),
    "J": (1.0, {"kg": 1, "m": 2, "s": -2}),
    "W": (1.0, {"kg": 1, "m": 2, "s": -3}),
    "Hz": (1.0, {"s": -1}),
}
"""Factor to SI and exponents of the SI units, by symbol."""

FACTOR = re.compile(r"([A-Za-z%]+|1)\^?(-?\d)?")
"""A unit and its exponent, of one digit."""


def unit(text: str) -> Unit:
    """A unit with its meaning; ValueError if it has none."""
    exponents: Counter[str] = Counter()
    factor = 1.0
    for place, part in enumerate(text.replace(" ", "").split("/")):
        for each in part.removeprefix("(").removesuffix(")").split("."):
            symbol, power = _factor(each, text)
            power *= -1 if place else 1
            size, dimension = SYMBOLS[symbol]
            factor *= size**power
            exponents.update({name: power * n for name, n in dimension.items()})
    base: Base = {**exponents, "factor": factor}
    return Unit(text, base)


def _factor(text: str, whole: str) -> tuple[str, int]:
    match = FACTOR.fullmatch(text)
    if match is None or match[1] not in SYMBOLS:
        symbol = text if match is None else match[1]
        raise ValueError(f"there is no unit {whole}{did_you_mean(symbol, SYMBOLS)}")
    return match[1], int(match[2] or 1)


def convert(value: float, given: str, wanted: str) -> float:
    """A number in another unit; ValueError if there is no way."""
    if given == wanted:
        return value
    return compose(unit(given), (), unit(wanted))(value)


def with_unit(name: str, units: Mapping[str, str]) -> str:
    """`miss [m]`, or the name alone where units know none; an element has that of its vector."""
    found = units.get(name) or units.get(base(name))
    return f"{name} [{found}]" if found else name
