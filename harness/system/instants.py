# SPDX-License-Identifier: BSD-2-Clause
"""Instants in UTC to the nanosecond, in the years in which numpy can count these."""

from __future__ import annotations

import re

import numpy as np

from harness.errors import UsageError

J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
FIRST, LAST = 1678, 2261
"""Whole years that 64 bits of nanoseconds about 1970 hold."""

_DATE = re.compile(r"(\d{4,})-\d\d-\d\d(T\d\d:\d\d(:\d\d(\.\d{1,9})?)?)?")


def moment(text: str) -> np.datetime64:
    """Return the UTC instant of a date such as 2026-01-31T12:00:00, with or without Z; raise
    ValueError for other texts and for years outside the range of 64-bit nanoseconds.
    """
    date = _DATE.fullmatch(text.removesuffix("Z"))
    if date is None:
        raise ValueError("expected a date as 2026-01-31T12:00:00")
    if not FIRST <= int(date[1][:6]) <= LAST:
        raise ValueError(f"expected a year from {FIRST} to {LAST}, got {date[1]}")
    try:
        return np.datetime64(date[0], "ns")
    except ValueError as error:  # such as month 13, second 60
        raise ValueError(f"expected a date as 2026-01-31T12:00:00 ({error})") from error


def written(instant: np.datetime64) -> str:
    """Return a date that moment() reads, with 0, 6 or 9 decimals of a second, as many as needed."""
    for shorter in (instant.astype("datetime64[s]"), instant.astype("datetime64[us]")):
        if shorter == instant:
            return str(np.datetime_as_string(shorter))
    return str(np.datetime_as_string(instant.astype("datetime64[ns]")))


def date(text: str) -> str:
    """Return a date in the form of written(), "" for an empty text; raise ValueError."""
    return written(moment(text)) if text else ""


def start_note(instant: np.datetime64) -> str:
    """Return the note about the instant at which a run starts."""
    return f"t = 0 is {np.datetime_as_string(instant.astype('datetime64[us]'))} UTC"


def epoch_of(text: str) -> np.datetime64:
    """Return the instant of the option --epoch; raise UsageError."""
    try:
        return moment(text)
    except ValueError as error:
        raise UsageError(f"--epoch {text}: {error}") from error
