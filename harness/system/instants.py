# SPDX-License-Identifier: BSD-2-Clause
"""Instants in UTC to the nanosecond, in the years that numpy can represent at this resolution."""

from __future__ import annotations

import re

import numpy as np

from harness.errors import UsageError

J2000 = np.datetime64("2000-01-01T12:00:00", "ns")
FIRST, LAST = 1678, 2261
"""First and last whole year that a 64-bit number of nanoseconds since 1970 can represent."""

_DATE = re.compile(r"(\d{4,})-\d\d-\d\d(T\d\d:\d\d(:\d\d(\.\d{1,9})?)?)?")


def moment(text: str) -> np.datetime64:
    """Return the UTC instant of a date such as 2026-01-31T12:00:00, with or without Z; raise
    ValueError for other texts and for years outside the range of 64-bit nanoseconds.
    """
    date = _DATE.fullmatch(text.removesuffix("Z"))
    if date is None:
        raise ValueError("expected a date such as 2026-01-31T12:00:00")
    if not FIRST <= int(date[1][:6]) <= LAST:
        raise ValueError(f"expected a year from {FIRST} to {LAST}, got {date[1]}")
    try:
        return np.datetime64(date[0], "ns")
    except ValueError as error:  # such as month 13, second 60
        raise ValueError(f"expected a date such as 2026-01-31T12:00:00 ({error})") from error


def written(instant: np.datetime64) -> str:
    """Return an instant as a date that moment() reads, with 0, 6 or 9 decimals of a second, as
    needed.
    """
    for shorter in (instant.astype("datetime64[s]"), instant.astype("datetime64[us]")):
        if shorter == instant:
            return str(np.datetime_as_string(shorter))
    return str(np.datetime_as_string(instant.astype("datetime64[ns]")))


def date(text: str) -> str:
    """Return a date in the form of written(), "" for an empty text; raise ValueError if it is no
    date.
    """
    return written(moment(text)) if text else ""


def start_note(instant: np.datetime64) -> str:
    """Return the line that states the UTC instant of t = 0."""
    return f"t = 0 is {np.datetime_as_string(instant.astype('datetime64[us]'))} UTC"


def epoch_of(text: str) -> np.datetime64:
    """Return the instant that the option --epoch gives; raise UsageError if it is not a date."""
    try:
        return moment(text)
    except ValueError as error:
        raise UsageError(f"--epoch {text}: {error}") from error
