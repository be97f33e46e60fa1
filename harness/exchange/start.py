# SPDX-License-Identifier: BSD-2-Clause
"""Start values from files of the field: orbit ephemeris messages (OEM) and two-line elements.

Axes of a file become those of N: EME2000, GCRF and ICRF as they are (23 mas between them), TEME of
two-line elements by the IAU models with UT1 = UTC, which cancels. A body that starts beside the
target, and for which no file is given, goes along with it: it gets the elements of the target's
orbit, and stands where its position in the Hill frame has it.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.errors import StructureError, UsageError, library, reason_of
from harness.exchange import two_line
from harness.exchange.bodies import sun_direction
from harness.exchange.czml import earth
from harness.files.paths import contents
from harness.files.temporary import PrivateFolder
from harness.master.simulation import Simulation
from harness.mission.library import everything, mission
from harness.mission.mission import Bodies
from harness.results.result import Array, Result
from harness.spelling import did_you_mean
from harness.system.instants import J2000, days_since_j2000, epoch_of, moment, written
from harness.system.model import System

SAME_AXES = ("EME2000", "J2000", "GCRF", "GCRS", "ICRF")
LONGEST = 256 * 1024**2
"""Bytes of a file of start values."""
INLINE = "two-line elements"
"""Name of a source that stands in the TOML itself."""
EXACT = 1e-6
"""An instant of an ephemeris this close is taken as it is, not interpolated [s]."""


class State(NamedTuple):
    """Position [m] and velocity [m/s], components of N."""

    r: Array
    v: Array


@dataclass(frozen=True)
class Source:
    """A file, or elements as text: its name, first instant that it knows, axes in words, and the
    state at an instant.
    """

    path: Path | str
    first: np.datetime64
    axes: str
    state: Callable[[np.datetime64], State]


@dataclass(frozen=True)
class Start:
    """Values of parameters by name, for `set` of run(); what was assumed, one line each; the UTC of
    t = 0, for `epoch`.
    """

    values: Mapping[str, Any]
    notes: tuple[str, ...]
    epoch: str


def start_values(
    system: System,
    files: Mapping[str, str | Path],
    epoch: str | None = None,
    **changes: Any,
) -> Start:
    """Start values of components from files, for the system with these changes, see
    harness.master.changes.Changes.

    files: OEM or two-line elements by component, may be none; those of the system's own `[start]`
    stay under them; epoch: t = 0 in UTC (default: that of the system, else the first instant that
    all files know). What must know where the Sun is gets its direction at that instant. Raises
    UsageError (no such component, no such file, an epoch outside), and HarnessError if a library of
    the extra `exchange` is missing.
    """
    parameters = Simulation(system, **changes).parameters()
    files = {**system.starts, **files}
    names = _names(system, needed=bool(files))
    if names:
        for component in files:
            _check(component, system, parameters, names)
    sources = {component: _source(component, file) for component, file in files.items()}
    date = system.experiment.epoch if epoch is None else epoch
    asked = date or epoch is not None or not files
    instant = epoch_of(date) if asked else max(s.first for s in sources.values())
    states = {component: _state(component, s, instant) for component, s in sources.items()}
    values = _orbits(parameters, states, names) if names else {}
    sun, told = _sun(parameters, names.sun if names else "", instant)
    return Start(values | sun, (*_notes(sources, instant), *told), written(instant))


def of_system(system: System) -> tuple[Mapping[str, Any], str]:
    """Start values and epoch of the `[start]` of a TOML; what harness.ssp.read_starts is. Raises
    StructureError with the problem.
    """
    try:
        found = start_values(system, {})
    except UsageError as error:
        text = str(error).replace("--start ", "[start] ").replace("--start: ", "[start] ")
        raise StructureError(text.splitlines()) from error
    return found.values, found.epoch


def _orbits(parameters: Result, states: Mapping[str, State], names: Bodies) -> dict[str, Any]:
    """Parameters that start bodies in these states, and beside them those that go along."""
    values: dict[str, Any] = {}
    for component, state in states.items():
        values |= {
            f"{component}.{names.semi_major_axis}": 0.0,  # then position and velocity count
            f"{component}.{names.start[0]}": state.r.tolist(),
            f"{component}.{names.start[1]}": state.v.tolist(),
        }
    return values | _beside(parameters, states, names)


def _sun(parameters: Result, name: str, instant: np.datetime64) -> tuple[dict[str, Any], list[str]]:
    """The direction to the Sun for all that must know it, and the line that says so."""
    needing = [n for n in parameters.vectors if name and n.endswith(f".{name}")]
    if not needing:
        return {}, []
    to_sun = sun_direction(np.array([instant]))[0].tolist()
    shown = ", ".join(f"{x:.6f}" for x in to_sun)
    return dict.fromkeys(needing, to_sun), [f"Sun at t = 0: {', '.join(needing)} = [{shown}]"]


def _state(component: str, source: Source, instant: np.datetime64) -> State:
    try:
        with _undated():
            found = source.state(instant)
        if not (np.isfinite(found.r).all() and np.isfinite(found.v).all()):
            raise ValueError("position and velocity at the epoch are not finite")
        return found
    except (ValueError, IndexError) as error:
        raise UsageError(f"--start {component}: {source.path}: {reason_of(error)}") from error


@contextmanager
def _undated() -> Iterator[None]:
    """Without the warnings of erfa, which knows no leap seconds of years to come, and with no other
    tables of UT1 than those that astropy brings.
    """
    conf = library("astropy.utils.iers", "exchange").conf
    with warnings.catch_warnings(), conf.set_temp("auto_download", False):
        warnings.simplefilter("ignore")
        yield


def _notes(sources: Mapping[str, Source], instant: np.datetime64) -> list[str]:
    text = np.datetime_as_string(instant.astype("datetime64[us]"))
    axes = [f"{component}: {Path(s.path).name}, {s.axes}" for component, s in sources.items()]
    return [f"t = 0 is {text} UTC", *axes]


def _names(system: System, needed: bool) -> Bodies | None:
    """The names of bodies in the mission of a system, else in any that is at hand; UsageError if
    they are needed and nobody has any.
    """
    own = mission(system.mission) if system.mission else None
    found = (own.bodies if own else ()) or everything().bodies
    if needed and not found:
        raise UsageError(
            f"--start: no mission defines start parameters for the bodies of {system.name}"
        )
    return found[0] if found else None


def _check(component: str, system: System, parameters: Result, names: Bodies) -> None:
    known = [c.name for c in system.components]
    if component not in known:
        raise UsageError(
            f"--start {component}: {system.name} has no such component"
            f"{did_you_mean(component, known)}"
        )
    for name in (names.semi_major_axis, names.field, *names.start):
        if f"{component}.{name}" not in parameters:
            raise UsageError(f"--start {component}: it has no parameter {name}")


def _beside(parameters: Result, states: Mapping[str, State], names: Bodies) -> dict[str, float]:
    """The orbit of a target for which a file is given, for bodies that start in its Hill frame."""
    target = next((c for c in states if f"{c}.{names.beside[0]}" not in parameters), None)
    if target is None:
        return {}
    rows = (names.semi_major_axis, *names.elements)
    found: dict[str, float] = {}
    for component in _followers(parameters, states, names):
        orbit = elements(states[target], float(parameters[f"{component}.{names.field}"][0]))
        if not orbit[1] < 1:
            raise UsageError(
                f"--start {target}: its orbit is open (e = {orbit[1]:.6g}), and {component}, which "
                f"starts beside it, takes a closed one; name a file for {component}"
            )
        found |= {f"{component}.{name}": x for name, x in zip(rows, orbit, strict=True)}
    return found


def _followers(parameters: Result, states: Mapping[str, State], names: Bodies) -> Iterator[str]:
    """Bodies without a file that start in the Hill frame of another one."""
    ending = f".{names.beside[0]}"
    others = {name.removesuffix(ending) for name in parameters.vectors if name.endswith(ending)}
    for component in sorted(others - states.keys()):
        size = f"{component}.{names.semi_major_axis}"
        if size in parameters and parameters[size][0] > 0:  # else it is an estimate, or in no orbit
            yield component


def elements(state: State, mu: float) -> tuple[float, ...]:
    """Osculating a [m], e, inclination, argument of perigee, right ascension and true anomaly [rad]
    about a point mass mu [m3/s2]; an equatorial orbit has its node, a circular one its perigee on
    the axis that is left.

    Vallado, Fundamentals of Astrodynamics, RV2COE: h = r x v, n = z x h, e = v x h / mu - r / |r|.
    """
    r, v = state
    h = np.cross(r, v)
    node = np.array([-h[1], h[0], 0.0]) if h[:2].any() else np.array([1.0, 0.0, 0.0])
    towards = np.cross(v, h) / mu - r / np.linalg.norm(r)
    perigee = towards if towards.any() else node
    distance = float(np.linalg.norm(r))
    return (
        1 / (2 / distance - float(v @ v) / mu),
        float(np.linalg.norm(towards)),
        float(np.arctan2(np.hypot(h[0], h[1]), h[2])),
        _about(h, node, perigee),
        float(np.arctan2(node[1], node[0])),
        _about(h, perigee, r),
    )


def _about(axis: Array, begin: Array, end: Array) -> float:
    """Angle from one vector to another about an axis across both [rad]."""
    sine = np.cross(begin, end) @ axis / np.linalg.norm(axis)
    return float(np.arctan2(sine, begin @ end))


# ---- files


def _source(component: str, file: str | Path) -> Source:
    """A file by its path, or elements in so many lines."""
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


SYSTEMS = ("GPS", "TAI", "TT", "UT1", "UTC")
"""Time systems of an ephemeris: those of astropy, and GPS = TAI - 19 s."""
GPS_BEHIND_TAI = 19.0
_TIME_SYSTEM = re.compile(r"\bTIME_SYSTEM\s*[=>]\s*([^\s<]+)")


def _ephemeris(path: Path | str, text: str) -> Source:
    system = _time_system(text)
    with PrivateFolder() as folder:
        copy = folder / "message.oem"  # with a time system that the library knows
        copy.write_text(_TIME_SYSTEM.sub(lambda m: m[0].replace("GPS", "TAI"), text), "utf-8")
        message = library("oem", "exchange").OrbitEphemerisMessage.open(str(copy))
    frame = _frame(message)
    behind = GPS_BEHIND_TAI if system == "GPS" else 0.0
    late = library("astropy.time", "exchange").TimeDelta(behind, format="sec")
    begin = (message.states[0].epoch + late).utc
    begin.precision = 9
    told = "" if system in ("", "UTC") else f", times in {system}"
    state = partial(_interpolated, message, frame, late)
    return Source(path, moment(begin.isot), f"{frame} taken as N{told}", state)


def _time_system(text: str) -> str:
    """Of all segments of an ephemeris, "" if it names none; ValueError."""
    systems = {match[1] for match in _TIME_SYSTEM.finditer(text)}
    if unknown := systems - {*SYSTEMS}:
        raise ValueError(
            f"its times are {' and '.join(sorted(unknown))}, expected {', '.join(SYSTEMS)}"
        )
    if len(systems) > 1:
        raise ValueError(f"its times are {' and '.join(sorted(systems))}, expected one system")
    return next(iter(systems), "")


def _frame(message: Any) -> str:
    """Axes of all segments of an ephemeris about the Earth; ValueError."""
    frames = {segment.metadata["REF_FRAME"].upper() for segment in message}
    centres = {segment.metadata["CENTER_NAME"].upper() for segment in message}
    if centres != {"EARTH"}:
        raise ValueError(f"its centre is {' and '.join(sorted(centres))}, not the EARTH")
    if len(frames) != 1 or not frames <= {*SAME_AXES, "TEME"}:
        raise ValueError(
            f"its axes are {' and '.join(sorted(frames))}, expected {', '.join(SAME_AXES)} or TEME"
        )
    return str(frames.pop())


def _interpolated(message: Any, frame: str, late: Any, instant: np.datetime64) -> State:
    time = library("astropy.time", "exchange").Time(instant, scale="utc")
    time = getattr(time, message.states[0].epoch.scale) - late
    near = min(message.states, key=lambda state: abs((state.epoch - time).sec))
    state = near if abs((near.epoch - time).sec) < EXACT else message(time)
    found = State(1e3 * np.asarray(state.position), 1e3 * np.asarray(state.velocity))
    return _out_of_teme(found, instant) if frame == "TEME" else found


def _elements(path: Path | str, first: str, second: str) -> Source:
    api = library("sgp4.api", "exchange")
    library("sgp4.io", "exchange").verify_checksum(first, second)
    if wrong := "; ".join(two_line.problems(first, second)):
        raise ValueError(wrong)
    satellite = api.Satrec.twoline2rv(first, second)
    day, part = satellite.jdsatepoch - 2451545.0, satellite.jdsatepochF
    nanoseconds = round((day + part) * 86400e6) * 1000  # the format has 1e-8 days, 0.9 ms
    epoch = J2000 + np.timedelta64(nanoseconds, "ns")
    return Source(path, epoch, "SGP4, TEME turned into N", partial(_propagated, api, satellite))


def _propagated(api: Any, satellite: Any, instant: np.datetime64) -> State:
    error, r, v = satellite.sgp4(2451545.0, float(days_since_j2000(instant)))
    if error:
        raise ValueError(f"SGP4: {api.SGP4_ERRORS[error]}")
    return _out_of_teme(State(1e3 * np.array(r), 1e3 * np.array(v)), instant)


def _out_of_teme(state: State, instant: np.datetime64) -> State:
    """By the Earth-fixed axes: with GMST 1982 into them, with the IAU 2006/2000A matrix out."""
    erfa = library("erfa", "exchange")
    turn = erfa.rz(erfa.gmst82(2451545.0, float(days_since_j2000(instant))), np.eye(3))
    matrix = earth(np.array([instant]))[0].T @ turn
    return State(matrix @ state.r, matrix @ state.v)
