# SPDX-License-Identifier: BSD-2-Clause
"""Definitions of units, and the conversion of a number that is transferred from one variable to
another.

A BaseUnit states exponents of the SI units, with SI value = factor * value + offset. A hop (step of
a conversion) first converts units, then computes factor * value + offset (SSP 1.0, 5.3.5).

All hops of a signal are composed in rational arithmetic to one Affine and rounded once at the end.

Units after numbers are written as in FMUs, `2 deg`, `3.3 m/min`: points between factors, digits for
exponents, all factors after a slash in the denominator (`kg.m2`, `m/s2`, `1/(N.m)`).
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from functools import lru_cache
from typing import NamedTuple

from harness.spelling import did_you_mean
from harness.system.values import base

Base = Mapping[str, float]
"""Definition of a unit (BaseUnit): exponents of kg m s A K mol cd rad, then factor and offset."""


class UndefinedUnitError(ValueError):
    """Error: a unit has a name but no definition."""


class Unit(NamedTuple):
    """Name of a unit, and its definition if there is one."""

    name: str
    base: Base | None = None


class Affine(NamedTuple):
    """Conversion value -> factor * value + offset."""

    factor: float = 1.0
    offset: float = 0.0

    def __call__(self, value: float) -> float:
        """Return the converted value."""
        return self.factor * value + self.offset


IDENTITY = Affine()


class Hop(NamedTuple):
    """Step of a conversion, from one connection or mapping of a file: convert to `unit` (None: the
    unit of the variable that receives the value), then apply `change`.

    convert: whether units are converted; False if the file suppresses this.
    """

    change: Affine = IDENTITY
    convert: bool = True
    unit: Unit | None = None


PLAIN = Hop()

_Exact = tuple[Fraction, Fraction]
_NOTHING: _Exact = Fraction(1), Fraction(0)


def compose(start: Unit | None, hops: Sequence[Hop], end: Unit | None) -> Affine:
    """Return the conversion from a variable in unit `start` over all hops to a variable in unit
    `end`; raise ValueError if units are not compatible.

    A hop without a unit converts into `end`. Without hops only units are converted.
    """
    if not hops and (start is None or end is None or start.name == end.name):
        return IDENTITY
    factor, offset = _NOTHING
    unit = start
    for hop in hops or (PLAIN,):
        here = hop.unit or end
        converted = _conversion(unit, here) if hop.convert else _NOTHING
        for f, o in (converted, tuple(map(_fraction, hop.change))):
            factor, offset = f * factor, f * offset + o
        unit = here or unit
    try:
        return Affine(float(factor), float(offset))
    except OverflowError:
        names = " to ".join(unit.name for unit in (start, end) if unit is not None)
        raise ValueError(f"the factor or offset of the conversion {names} overflows") from None


def _fraction(number: float) -> Fraction:
    """Return a number as the fraction that its decimal digits state: 0.001 is 1/1000."""
    return Fraction(repr(float(number)))


def _conversion(a: Unit | None, b: Unit | None) -> _Exact:
    """Return the exact conversion of numbers in unit a to numbers in unit b, without change for
    equal or missing units. Raise UndefinedUnitError if a unit has no definition, ValueError if they
    are not compatible.
    """
    if a is None or b is None or a.name == b.name:
        return _NOTHING
    if a.base is None or b.base is None:
        undefined = f"{(a if a.base is None else b).name} is not defined by a BaseUnit"
        raise UndefinedUnitError(f"{a.name} cannot be converted to {b.name}: {undefined}")
    if _dimension(a.base) != _dimension(b.base):
        required = f"{b.name} [{_text(b.base)}]"
        raise ValueError(f"{a.name} [{_text(a.base)}] cannot be converted to {required}")
    (fa, oa), (fb, ob) = _scale(a.name, a.base), _scale(b.name, b.base)
    return fa / fb, (oa - ob) / fb


def _scale(name: str, base: Base) -> _Exact:
    factor, offset = base.get("factor", 1.0), base.get("offset", 0.0)
    if not (math.isfinite(factor) and math.isfinite(offset) and factor != 0):
        scale = f"the factor {factor:g} and the offset {offset:g}"
        raise ValueError(f"{name} has {scale}; expected finite numbers and no factor of 0")
    return _fraction(factor), _fraction(offset)


def _dimension(base: Base) -> dict[str, int]:
    """Return the dimension of a unit as the exponents, by SI unit, that are not zero."""
    return {name: int(n) for name, n in base.items() if name not in ("factor", "offset") and n}


def _text(base: Base) -> str:
    """Return the dimension of a unit as text, such as kg.m.s-2, "1" if it has none."""
    return ".".join(f"{name}{n if n != 1 else ''}" for name, n in _dimension(base).items()) or "1"


# ---- units given as text, such as "km/h"

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
"""Known units by symbol: factor to the SI unit, and exponents of kg, m, s and rad."""

FACTOR = re.compile(r"([A-Za-z%]+|1)\^?(-?\d)?")
"""Regular expression of a symbol with its exponent of one digit, such as `m2` or `s^-1`."""


def unit(text: str) -> Unit:
    """Return the unit that a text states, with its definition; raise ValueError if a symbol is
    unknown.
    """
    dimension: Counter[str] = Counter()
    factor = 1.0
    for symbol, power in _factors(text):
        if symbol not in SYMBOLS:
            raise ValueError(f"there is no unit {text}{did_you_mean(symbol, SYMBOLS)}")
        size, exponents = SYMBOLS[symbol]
        factor *= size**power
        dimension.update({name: power * n for name, n in exponents.items()})
    base: Base = {**dimension, "factor": factor}
    return Unit(text, base)


def _factors(text: str) -> Iterator[tuple[str, int]]:
    """Yield the symbols in a unit with their exponents: `m/s2` gives ("m", 1) and ("s", -2)."""
    for place, part in enumerate(text.replace(" ", "").split("/")):
        for each in part.removeprefix("(").removesuffix(")").split("."):
            match = FACTOR.fullmatch(each)
            symbol, power = (match[1], int(match[2] or 1)) if match else (each, 1)
            yield symbol, -power if place else power


def product(a: str, b: str, power: float = 1) -> str | None:
    """Return the unit of the product of a number in unit a and a power of a number in unit b, such
    as `kg.m/s2`; None if an exponent is not a whole number.
    """
    exponents: Counter[str] = Counter()
    for text, times in ((a, 1), (b, power)):
        for symbol, n in _factors(text):
            if symbol != "1":
                exponents[symbol] += times * n  # type: ignore[assignment]
    if not all(float(n).is_integer() for n in exponents.values()):
        return None
    above, below = (
        [
            f"{symbol}{abs(int(n)) if abs(n) != 1 else ''}"
            for symbol, n in exponents.items()
            if sign * n > 0
        ]
        for sign in (1, -1)
    )
    under = ".".join(below) if len(below) < 2 else f"({'.'.join(below)})"
    return "/".join(filter(None, (".".join(above) or "1", under)))


def convert(value: float, given: str, required: str) -> float:
    """Return a number in unit `given` as a number in unit `required`; raise ValueError if the units
    are unknown or not compatible.
    """
    if given == required:
        return value
    return _between(given, required)(value)


@lru_cache(maxsize=256)
def _between(given: str, required: str) -> Affine:
    return compose(unit(given), (), unit(required))


def with_unit(name: str, units: Mapping[str, str]) -> str:
    """Return a name with its unit, such as `miss [m]`, the name alone if its unit is not known. An
    element has the unit of its vector.
    """
    found = units.get(name) or units.get(base(name))
    return f"{name} [{found}]" if found else name
