# SPDX-License-Identifier: BSD-2-Clause
"""What must hold of two-line elements before SGP4 takes them: it reads whatever stands in its
columns.
"""

from __future__ import annotations

import calendar
import re
from collections.abc import Iterator
from typing import NamedTuple


class Field(NamedTuple):
    """Columns of a line, counted from 1, and the least and largest value of what stands there."""

    name: str
    line: int
    first: int
    last: int
    least: float
    most: float
    point: bool = True  # False: a decimal point is implied before the first digit


FIELDS = (
    Field("inclination [deg]", 2, 9, 16, 0, 180),
    Field("right ascension of the ascending node [deg]", 2, 18, 25, 0, 360),
    Field("eccentricity", 2, 27, 33, 0, 1, point=False),
    Field("argument of perigee [deg]", 2, 35, 42, 0, 360),
    Field("mean anomaly [deg]", 2, 44, 51, 0, 360),
    Field("mean motion [revolutions per day]", 2, 53, 63, 1e-8, 20),
)

_NUMBER = re.compile(r" *[-+]?(\d+\.?\d*|\.\d+) *")


def problems(first: str, second: str) -> Iterator[str]:
    """What is wrong with a set of two-line elements, one line each."""
    lines = ("", first, second)
    if first[2:7] != second[2:7]:
        yield f"line 1 is of satellite {first[2:7].strip()}, line 2 of {second[2:7].strip()}"
    yield from _epoch(first)
    for field in FIELDS:
        text = lines[field.line][field.first - 1 : field.last]
        place = f"line {field.line}, columns {field.first} to {field.last}: {field.name}"
        if not (_NUMBER if field.point else re.compile(r"\d+")).fullmatch(text):
            yield f"{place} is not a number: {text.strip()!r}"
        elif not field.least <= (value := float(text if field.point else f".{text}")) <= field.most:
            yield f"{place} must be {field.least:g} to {field.most:g}, not {value:g}"


def _epoch(first: str) -> Iterator[str]:
    """Year of two digits, of 1957 to 2056, and the day of that year, 1 for the first of January."""
    place, text = "line 1, columns 19 to 32: epoch", first[18:32]
    if not (re.fullmatch(r"[\d ]\d", text[:2]) and _NUMBER.fullmatch(text[2:])):
        yield f"{place} is not a year and day: {text.strip()!r}"
        return
    year, day = int(text[:2]), float(text[2:])
    year += 1900 if year >= 57 else 2000
    days = 366 if calendar.isleap(year) else 365
    if not 1 <= day < days + 1:
        yield f"{place}: {year} has the days 1 to {days}, not {day:g}"
