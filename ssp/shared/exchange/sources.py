# SPDX-License-Identifier: BSD-2-Clause
"""Reading of the state of a body at an instant from orbit ephemeris messages (OEM) and two-line
elements.

States are given in N axes: EME2000, GCRF and ICRF are taken as N (they differ by 23 mas), TEME of
two-line elements is converted by way of Earth-fixed axes with the IAU models. For this, UT1 is set
to UTC; the error cancels, because both conversions use the same UT1. The library sgp4 accepts any
text in the columns of a number, so two-line elements are checked first.
"""

from __future__ import annotations

import calendar
import re
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.errors import UsageError, library, reason_of
from harness.files.output import PrivateFolder
from harness.files.paths import contents
from harness.results.result import Array
from harness.system.instants import J2000, moment

from .bodies import days_since_j2000
from .czml import earth

SAME_AXES = ("EME2000", "J2000", "GCRF", "GCRS", "ICRF")
LONGEST = 256 * 1024**2
"""Size of the largest file of start values that is read [bytes]."""
INLINE = "two-line elements"
"""Name that messages use, in place of a path, for elements given as text in the TOML."""
EXACT = 1e-6
"""Time difference up to which a state of an ephemeris is used without interpolation [s]."""


class State(NamedTuple):
    """Position r [m] and velocity v [m/s] in N axes, (3,) each."""

    r: Array
    v: Array


@dataclass(frozen=True)
class Source:
    """Source of the state of a body: a file, or elements as text.

    path: path of the file, or INLINE; first: first instant with a state (elements: their epoch),
    UTC; axes: note about the original axes; state: function that returns the state at an instant.
    """

    path: Path | str
    first: np.datetime64
    axes: str
    state: Callable[[np.datetime64], State]


def source_of(component: str, file: str | Path) -> Source:
    """Return the source for a component: the file at a path, or two-line elements given as a text
    of several lines; raise UsageError if it is neither an OEM nor two-line elements.
    """
    inline = "\n" in str(file).strip()
    path, text = (INLINE, str(file)) if inline else (file, _text(component, Path(file)))
    try:
        return _read(path, text)
    except (ValueError, KeyError, IndexError, SyntaxError) as error:
        raise UsageError(f"--start {component}: {path}: {reason_of(error)}") from error


def _read(path: Path | str, text: str) -> Source:
    if "CCSDS_OEM_VERS" in text or "<oem" in text:
        with _undated():
            return _ephemeris(path, text)
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    elements = [line for line in lines if line[:2] in ("1 ", "2 ") and len(line) >= 68]
    if [line[0] for line in elements] != ["1", "2"]:
        raise ValueError("neither an OEM nor one set of two-line elements")
    return _elements(path, *elements)


def _text(component: str, path: Path) -> str:
    try:
        return contents(path, LONGEST).decode()
    except UnicodeDecodeError as error:
        raise UsageError(f"--start {component}: {path}: is not a text file") from error
    except (OSError, ValueError) as error:
        reason = reason_of(error)
        raise UsageError(f"--start {component}: {path}: cannot be read ({reason})") from error


def state_of(component: str, source: Source, instant: np.datetime64) -> State:
    """Return the state of a component at a UTC instant from its source; raise UsageError if the
    source has none.
    """
    try:
        with _undated():
            found = source.state(instant)
        if not (np.isfinite(found.r).all() and np.isfinite(found.v).all()):
            raise ValueError("position or velocity at the epoch is not finite")
        return found
    except (ValueError, IndexError) as error:
        raise UsageError(f"--start {component}: {source.path}: {reason_of(error)}") from error


@contextmanager
def _undated() -> Iterator[None]:
    """Suppress the warnings of erfa about future leap seconds, which are unknown, and use only the
    tables of UT1 that astropy contains, without a download.
    """
    conf = library("astropy.utils.iers", "exchange").conf
    with warnings.catch_warnings(), conf.set_temp("auto_download", False):
        warnings.simplefilter("ignore")
        yield


# ---- orbit ephemeris messages

SYSTEMS = ("GPS", "TAI", "TT", "UT1", "UTC")
"""Time systems of an ephemeris that can be read (TDB and others are rejected); GPS: TAI - 19 s."""
GPS_BEHIND_TAI = 19.0
_TIME_SYSTEM = re.compile(r"\bTIME_SYSTEM\s*[=>]\s*([^\s<]+)")


def _ephemeris(path: Path | str, text: str) -> Source:
    system = _time_system(text)
    with PrivateFolder() as folder:
        # the library does not support GPS time: it reads the times as TAI; `late` adds the 19 s
        copy = folder / "message.oem"
        copy.write_text(_TIME_SYSTEM.sub(lambda m: m[0].replace("GPS", "TAI"), text), "utf-8")
        message = library("oem", "exchange").OrbitEphemerisMessage.open(str(copy))
    frame = _frame(message)
    behind = GPS_BEHIND_TAI if system == "GPS" else 0.0
    late = library("astropy.time", "exchange").TimeDelta(behind, format="sec")
    begin = (message.states[0].epoch + late).utc
    begin.precision = 9
    times = "" if system in ("", "UTC") else f", times in {system}"
    axes = "turned into" if frame == "TEME" else "taken as"
    state = partial(_interpolated, message, frame, late)
    return Source(path, moment(begin.isot), f"{frame} {axes} N{times}", state)


def _time_system(text: str) -> str:
    """Return the time system of all segments of an ephemeris, "" if it states none; raise
    ValueError if there are several or an unknown one.
    """
    systems = {match[1] for match in _TIME_SYSTEM.finditer(text)}
    if unknown := systems - {*SYSTEMS}:
        raise ValueError(
            f"its time system is {' and '.join(sorted(unknown))}, expected {', '.join(SYSTEMS)}"
        )
    if len(systems) > 1:
        raise ValueError(
            f"its segments have the time systems {' and '.join(sorted(systems))}, expected only one"
        )
    return next(iter(systems), "")


def _frame(message: Any) -> str:
    """Return the name of the axes of all segments of an ephemeris; raise ValueError for several or
    unknown axes, or another centre than the Earth.
    """
    frames = {segment.metadata["REF_FRAME"].upper() for segment in message}
    centres = {segment.metadata["CENTER_NAME"].upper() for segment in message}
    if centres != {"EARTH"}:
        raise ValueError(f"its centre is {' and '.join(sorted(centres))}, not the EARTH")
    if len(frames) != 1 or not frames <= {*SAME_AXES, "TEME"}:
        raise ValueError(
            f"its axes are {' and '.join(sorted(frames))}, "
            f"expected only one of {', '.join(SAME_AXES)} or TEME"
        )
    return str(frames.pop())


def _interpolated(message: Any, frame: str, late: Any, instant: np.datetime64) -> State:
    time = library("astropy.time", "exchange").Time(instant, scale="utc")
    time = getattr(time, message.states[0].epoch.scale) - late
    near = min(message.states, key=lambda state: abs((state.epoch - time).sec))
    state = near if abs((near.epoch - time).sec) < EXACT else message(time)
    found = State(1e3 * np.asarray(state.position), 1e3 * np.asarray(state.velocity))
    return _out_of_teme(found, instant) if frame == "TEME" else found


# ---- two-line elements


def _elements(path: Path | str, first: str, second: str) -> Source:
    api = library("sgp4.api", "exchange")
    library("sgp4.io", "exchange").verify_checksum(first, second)
    if wrong := "; ".join(_problems(first, second)):
        raise ValueError(wrong)
    satellite = api.Satrec.twoline2rv(first, second)
    day, part = satellite.jdsatepoch - 2451545.0, satellite.jdsatepochF
    # the format resolves 1e-8 days, 0.9 ms: rounding to 1 us removes only rounding errors
    nanoseconds = round((day + part) * 86400e6) * 1000
    epoch = J2000 + np.timedelta64(nanoseconds, "ns")
    return Source(path, epoch, "SGP4, TEME turned into N", partial(_propagated, api, satellite))


def _propagated(api: Any, satellite: Any, instant: np.datetime64) -> State:
    error, r, v = satellite.sgp4(2451545.0, float(days_since_j2000(instant)))
    if error:
        raise ValueError(f"SGP4: {api.SGP4_ERRORS[error]}")
    return _out_of_teme(State(1e3 * np.array(r), 1e3 * np.array(v)), instant)


def _out_of_teme(state: State, instant: np.datetime64) -> State:
    """Return the state in N axes from a state in TEME axes. TEME is converted into Earth-fixed axes
    by GMST 1982, and these into N by the IAU 2006/2000A matrix.
    """
    erfa = library("erfa", "exchange")
    turn = erfa.rz(erfa.gmst82(2451545.0, float(days_since_j2000(instant))), np.eye(3))
    matrix = earth(np.array([instant]))[0].T @ turn
    return State(matrix @ state.r, matrix @ state.v)


class Field(NamedTuple):
    """Number in two-line elements: its name, line (1 or 2), first and last column (counted from 1),
    and least and largest permitted value.
    """

    name: str
    line: int
    first: int
    last: int
    least: float
    most: float
    point: bool = True  # False: the text has digits only, after an implied decimal point


FIELDS = (
    Field("inclination [deg]", 2, 9, 16, 0, 180),
    Field("right ascension of the ascending node [deg]", 2, 18, 25, 0, 360),
    Field("eccentricity", 2, 27, 33, 0, 1, point=False),
    Field("argument of perigee [deg]", 2, 35, 42, 0, 360),
    Field("mean anomaly [deg]", 2, 44, 51, 0, 360),
    Field("mean motion [revolutions per day]", 2, 53, 63, 1e-8, 20),
)

_NUMBER = re.compile(r" *[-+]?(\d+\.?\d*|\.\d+) *")


def _problems(first: str, second: str) -> Iterator[str]:
    """Yield the faults of a set of two-line elements, one line each."""
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
    """Yield the faults of the epoch in line 1. An epoch is a two-digit year, for 1957 to 2056, and
    the day of that year, which is 1.0 at the beginning of the first of January.
    """
    place, text = "line 1, columns 19 to 32: epoch", first[18:32]
    if not (re.fullmatch(r"[\d ]\d", text[:2]) and _NUMBER.fullmatch(text[2:])):
        yield f"{place} is not a year and day: {text.strip()!r}"
        return
    year, day = int(text[:2]), float(text[2:])
    year += 1900 if year >= 57 else 2000
    days = 366 if calendar.isleap(year) else 365
    if not 1 <= day < days + 1:
        yield f"{place}: {year} has the days 1 to {days}, not {day:g}"
