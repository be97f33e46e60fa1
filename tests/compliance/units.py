# SPDX-License-Identifier: BSD-2-Clause
"""Dimensions of unit strings such as "kg.m2" or "m3/s2": powers of the FMI base units, from the SI
Brochure.
"""

from __future__ import annotations

import re
from collections import Counter

SYMBOLS = {
    "1": {},
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "A": {"A": 1},
    "K": {"K": 1},
    "rad": {"rad": 1},
    "Hz": {"s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
}
FACTOR = re.compile(r"(?P<symbol>1|[A-Za-z]+)(?P<exponent>[2-9]?)")


def dimension(unit: str) -> dict[str, int]:
    """Grammar of Modelica: factors joined by dots, one slash, brackets round several factors behind
    it; else ValueError.
    """
    above, slash, below = unit.partition("/")
    if slash and not below:
        raise ValueError(f"{unit}: nothing behind the slash")
    if "." in below:
        if not (below.startswith("(") and below.endswith(")")):
            raise ValueError(f"{unit}: several factors behind the slash need brackets")
        below = below[1:-1]
    total: Counter[str] = Counter()
    for text, sign in ((above, 1), *([(below, -1)] if slash else [])):
        for factor in text.split("."):
            match = FACTOR.fullmatch(factor)
            if match is None or match["symbol"] not in SYMBOLS:
                raise ValueError(f"{unit}: unknown factor {factor!r}")
            for base, power in SYMBOLS[match["symbol"]].items():
                total[base] += sign * power * int(match["exponent"] or 1)
    return {base: power for base, power in total.items() if power}
