# SPDX-License-Identifier: BSD-2-Clause
"""Runs of relay_approach, and what they show: ranges, speeds, pointing, impulse."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np

from harness import load
from harness.master.changes import apply
from harness.master.isolated import simulate
from harness.results.result import Result

SYSTEM = "relay_approach"
PAPER, SMALL, NEWTON, GEO = "paper", "paper_small_thrust", "newton", "geo"
BRAKES, MAIN, ATTITUDE = slice(8, 12), 12, slice(0, 8)
HOLD, CAPTURE = 50.0, 1000.0
"""Range to hold [m], and the time after which the approach to it counts as over [s]."""
MU, R0 = 3.986004415e14, 42164e3


@lru_cache(maxsize=16)
def recording(
    params: str = NEWTON,
    changes: tuple[str, ...] = (),
    *,
    late: tuple[str, ...] = (),
    every: int = 20,
    stop: float = 40000.0,
    step: float = 0.1,
    algorithm: str | None = None,
    executor: str = "c",
) -> Result:
    """Return the recording of the master; `late`: components that publish one macro step later.
    Cached for other tests (25 MB).
    """
    with load(SYSTEM) as found:
        system = apply(found, params=params, set=changes, stop=stop, step=step, algorithm=algorithm)
        slow = tuple(replace(c, latency=1) if c.name in late else c for c in system.components)
        result = simulate(replace(system, components=slow), executor=executor, every=every)
    result.values.flags.writeable = False
    return result


def orbit_point(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position and velocity of the point on the circular orbit that the parameter set `geo` refers
    to.
    """
    n = np.sqrt(MU / R0**3)
    c, s, none = np.cos(n * t), np.sin(n * t), 0 * t
    return R0 * np.stack([c, s, none], axis=1), n * R0 * np.stack([-s, c, none], axis=1)


def distance(result: Result) -> np.ndarray:
    return result["guidance.range"]


def velocities(result: Result) -> tuple[np.ndarray, np.ndarray]:
    """Of servicer and target in ISK."""
    frame = orbit_point(result.time)[1] if abs(result["target.r_TN_N"]).max() > 1e6 else 0.0
    return result["servicer.v_SN_N"] - frame, result["target.v_TN_N"] - frame


def speed(result: Result) -> np.ndarray:
    return np.linalg.norm(velocities(result)[0], axis=1)


def relative_speed(result: Result) -> np.ndarray:
    v_S, v_T = velocities(result)
    return np.linalg.norm(v_S - v_T, axis=1)


def arrival(result: Result) -> float:
    """When the range to hold is reached, inf if it never is [s]."""
    there = distance(result) <= HOLD
    return float(result.time[there.argmax()]) if there.any() else np.inf


def holding(result: Result) -> np.ndarray:
    """Rows of the hold."""
    return result.time >= arrival(result) + CAPTURE


def last(result: Result, seconds: float) -> np.ndarray:
    """Rows of the last seconds."""
    return result.time >= result.time[-1] - seconds


def approaching(result: Result) -> np.ndarray:
    """Rows of the first leg: first alignment and arrival left out."""
    return (result.time >= 2000) & (result.time <= arrival(result) - 2000)


def pointing(result: Result) -> np.ndarray:
    """deg"""
    return np.degrees(result["guidance.pointing_angle"])


def transition(result: Result) -> np.ndarray:
    """Rotation angle of the transition quaternion [deg]."""
    L = result["guidance.q_DS"]
    return np.degrees(2 * np.arctan2(np.linalg.norm(L[:, 1:], axis=1), L[:, 0]))


def impulse(result: Result, engines: int | slice) -> float:
    """N s"""
    return float(np.sum(result["propulsion.impulse"][-1, engines]))
