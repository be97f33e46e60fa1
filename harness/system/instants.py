# SPDX-License-Identifier: BSD-2-Clause
"""Instants in UTC to the nanosecond, in the years in which numpy can count these."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import ResultsError, UsageError

J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
FIRST, LAST = 1678, 2261
"""Whole years that 64 bits of nanoseconds about 1970 hold."""

_DATE = re.compile(r"(\d{4,})-\d\d-\d\d(T\d\d:\d\d(:\d\d(\.\d{1,9})?)?)?")


def moment(text: str) -> np.datetime64:
    """UTC of a date as 2026-01-31T12:00:00, with or without Z; ValueError if it is none, or of a
    year that cannot be counted.
    """
    date = _DATE.fullmatch(text.removesuffix("Z"))
    if date is None:
        raise ValueError("expected a date as 2026-01-31T12:00:00")
    if not FIRST <= int(date[1][:6]) <= LAST:
        raise ValueError(f"expected a year from {FIRST} to {LAST}, got {date[1]}")
    try:
        return np.datetime64(date[0], "ns")
    except ValueError as error:  # a month 13, a second 60
        raise ValueError(f"expected a date as 2026-01-31T12:00:00 ({error})") from error


def written(instant: np.datetime64) -> str:
    """A date as moment() reads it, in the digits that say it all: 0, 6 or 9 of a second."""
    for shorter in (instant.astype("datetime64[s]"), instant.astype("datetime64[us]")):
        if shorter == instant:
            return str(np.datetime_as_string(shorter))
    return str(np.datetime_as_string(instant.astype("datetime64[ns]")))


def date(text: str) -> str:
    """A date as written() gives it, "" for none; ValueError."""
    return written(moment(text)) if text else ""


def told(instant: np.datetime64) -> str:
    """What a user is told of the instant at which a run starts."""
    return f"t = 0 is {np.datetime_as_string(instant.astype('datetime64[us]'))} UTC"


def epoch_of(text: str) -> np.datetime64:
    """The instant of the option --epoch; UsageError."""
    try:
        return moment(text)
    except ValueError as error:
        raise UsageError(f"--epoch {text}: {error}") from error


def after(start: np.datetime64, seconds: NDArray[np.float64]) -> NDArray[np.datetime64]:
    """Instants so many seconds after another; ResultsError if that leaves the years that can be
    counted.
    """
    begin, end = (np.datetime64(f"{year}-01-01", "s") for year in (FIRST, LAST + 1))
    here = start.astype("datetime64[s]")
    least, most = ((limit - here).astype(np.float64) for limit in (begin, end))
    if not ((seconds >= least) & (seconds < min(most, 9e9))).all():  # 64 bits of nanoseconds
        raise ResultsError(f"times of the result lead from {here} out of {FIRST} to {LAST}")
    return np.asarray(start + np.round(seconds * 1e9).astype("timedelta64[ns]"))


def days_since_j2000(instants: Any) -> Any:
    """Days of 86 400 s since J2000, as arguments of erfa and SGP4; the nanoseconds between two
    instants may be more than 64 bits hold.
    """
    days = instants.astype("datetime64[D]")
    part = (instants - days.astype("datetime64[ns]")) / np.timedelta64(1, "D")
    return (days - J2000.astype("datetime64[D]")) / np.timedelta64(1, "D") + (part - 0.5)
