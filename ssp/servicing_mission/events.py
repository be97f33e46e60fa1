# SPDX-License-Identifier: BSD-2-Clause
"""Analysis of a mission from its result: phases with their times, events, velocity increments."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from harness.mission import Limits, Metric
from harness.results.result import Array, Result

from ..shared.relative_motion import DISTANCE, SERVICER, TARGET, range_

PHASE, REASON, BEGUN = "manager.phase", "manager.reason", "manager.t_phase"
DOCKING, MASS, MISSED = "mechanism.phase", "servicer.mass", "mechanism.missed"
NEEDS = (PHASE, REASON, BEGUN, DOCKING, MASS, SERVICER, TARGET)
ISP, G_0 = "propulsion.Isp", 9.80665
TOUCHING, BESIDE = 1.5, 2.0
"""Two ranges [m]. Below TOUCHING, the bodies have collided: the range is 1.58 m after docking, and
1.55 m with an oblique probe in the cone. Below BESIDE, a probe that misses the drogue hits the
target beside the drogue, which the model of the mechanism does not notice.
"""


ENDS = {"stack": "captured", "aborted": "aborted", "retreat": "retreated"}
"""Outcome of a mission without collision, by the name of a phase: the first entry whose phase the
mission has reached; without such a phase the mission is under way.
"""


class Stay(NamedTuple):
    """Time span in which a mission remains in one phase: begin and end [s], the reason for which
    the previous phase ended ("": end condition or failed attempt), and the first row in the phase.
    """

    phase: str
    begin: float
    end: float
    reason: str
    row: int


def stays(result: Result) -> list[Stay]:
    """Return the stays in all phases of a run, in the order of time."""
    phase, reason = result[PHASE], result[REASON]
    rows = [0, *(np.flatnonzero(np.diff(phase)) + 1)]
    begun = [float(result[BEGUN][row]) for row in rows]
    ends = [*begun[1:], float(result.time[-1])]
    return [
        Stay(
            result.mode(PHASE, phase[row]),
            begin,
            end,
            result.mode(REASON, reason[row]) if reason[row] else "",
            int(row),
        )
        for row, begin, end in zip(rows, begun, ends, strict=True)
    ]


def increments(result: Result) -> Array:
    """Return the velocity increment since the start in every row (rows,) [m/s], computed from the
    used propellant.
    """
    mass = result[MASS]
    return np.asarray(float(result.parameter(ISP)) * G_0 * np.log(mass[0] / mass))


def collided(result: Result) -> bool:
    """Return whether the bodies touched anywhere but in the drogue."""
    far = range_(result)
    missed = (np.diff(result[MISSED], prepend=0.0) > 0) & (far < BESIDE)
    return bool((far < TOUCHING).any() or missed.any())


@lru_cache(maxsize=1)  # several metrics of one run need the outcome
def outcome(result: Result) -> str:
    """Return the outcome of a mission: collided, captured (the stack detumbled), aborted (by the
    monitor), retreated, or under way.
    """
    phases = {s.phase for s in stays(result)}
    found = [word for phase, word in ENDS.items() if phase in phases]
    return "collided" if collided(result) else found[0] if found else "under way"


def _ended(result: Result, word: str) -> str:
    """Return the text of an expression that is true if the outcome() of a run is `word`."""
    names = result.mode_names(PHASE)
    beside = f"{DISTANCE} < {BESIDE}"
    touched = f"{DISTANCE} < {TOUCHING} or {MISSED} > previous({MISSED}) and {beside}"
    found = [f"(max({touched}) or first({MISSED} > 0 and {beside}))"]
    found += [f"max({PHASE} == {names.index(name)})" for name in ENDS if name in names]
    words = ["collided", *(ENDS[name] for name in ENDS if name in names)]
    earlier = words.index(word) if word in words else len(words)
    parts = [f"not {each}" for each in found[:earlier]] + found[earlier : earlier + 1]
    return " and ".join(parts)


def _metric(word: str) -> Metric:
    def value(result: Result, limits: Limits) -> float:
        del limits
        return float(outcome(result) == word)

    def live(result: Result, _: Limits) -> str:
        return _ended(result, word)

    return Metric(word, "1", (*NEEDS, MISSED), value, words=("no", "yes"), live=live)


METRICS = tuple(map(_metric, ("captured", "retreated", "aborted", "collided", "under way")))


def captures(result: Result) -> Iterator[tuple[float, str]]:
    """Yield time [s] and name of the first contact and of every change of the latch."""
    docking = result[DOCKING]
    touched = np.flatnonzero(docking > 0)
    if len(touched):
        yield float(result.time[touched[0]]), "first contact"
    for row in np.flatnonzero(np.diff(docking)) + 1:
        if docking[row] > 1:
            yield float(result.time[row]), result.mode(DOCKING, docking[row])


def events(result: Result) -> list[tuple[float, str]]:
    """Return times [s] and texts of all phases, the first contact and changes of the latch, in the
    order of time.
    """
    far, used = range_(result), increments(result)
    phases = [
        (s.begin, f"{s.phase}{f' ({s.reason})' if s.reason else ''}, range {far[s.row]:.2f} m, "
         f"{used[s.row]:.2f} m/s used")
        for s in stays(result)
    ]  # fmt: skip
    return sorted([*phases, *captures(result)])


def notes(result: Result) -> Iterator[str]:
    """Yield notes for a report: a line for every event, and a line with the durations of phases."""
    if not (result.holds(*NEEDS, parameters=(ISP,)) and len(result.time)):
        return
    yield from (f"{t:.1f} s: {what}" for t, what in events(result))
    line = ", ".join(f"{s.phase} {s.end - s.begin:.0f} s" for s in stays(result))
    yield f"time line: {line}"
