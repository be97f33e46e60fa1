# SPDX-License-Identifier: BSD-2-Clause
"""Tables of the relay approach, by parameter set and with a latency of one macro step, and a table
of thrusters in the synchronised approach.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from results import Column, cell, of_runs, result_of
from text import table

SETS = ("paper", "paper_small_thrust", "newton", "geo")
THRUSTERS = {
    "ideal propulsion (`sync_approach`)": "sync_approach",
    "continuous throttles": "sync_approach_thrusters",
    "`pulsed`": "sync_approach_thrusters --params pulsed",
    "`pulsed`, `propulsion.T2dn=0.3`":
        "sync_approach_thrusters --params pulsed --set propulsion.T2dn=0.3",
    "`torque_by_thrusters`": "sync_approach_thrusters --params torque_by_thrusters",
}  # fmt: skip


def runs(latency: int = 0) -> dict[str, str]:
    """Return commands of runs by name of the set in SETS; latency: of the controller, in macro
    steps.
    """
    late = f" --latency controller={latency}" if latency else ""
    return {name: f"relay_approach --params {name} --every 10{late}" for name in SETS}


def arrived(result: Any) -> float:
    """Return the first time at which the range is at most 50 m [s]; NaN if there is none."""
    there = result.time[result["guidance.range"] <= 50.0]
    return float(there[0]) if len(there) else float("nan")


def held(result: Any) -> tuple[float, ...]:
    """Return the least and largest range [m] from 1000 s after the arrival at 50 m to the end."""
    late = result["guidance.range"][result.time >= arrived(result) + 1000.0]
    return (float(late.min()), float(late.max())) if len(late) else (float("nan"),)


def leg_speed(result: Any) -> float:
    """Return the mean speed of the servicer on the first leg [m/s]: its speed in N, or, if the
    servicer is in an orbit, its speed relative to the target.
    """
    from ssp.shared.relative_motion import relative_speed

    leg = (result.time >= 2000.0) & (result.time <= arrived(result) - 2000.0)
    speed = np.linalg.norm(result["servicer.v_SN_N"], axis=1)
    found = speed if speed.max() < 100.0 else relative_speed(result)
    return float(found[leg].mean())


def pointed(result: Any) -> float:
    """Return the first time at which axis X of the servicer points to the target within 2 deg [s];
    NaN if it never does.
    """
    from harness.results.histories import turned

    axis = turned(result["servicer.q_SN"], np.tile([1.0, 0.0, 0.0], (len(result.time), 1)))
    to_target = result["target.r_TN_N"] - result["servicer.r_SN_N"]
    cosine = np.sum(axis * to_target, axis=1) / np.linalg.norm(to_target, axis=1)
    within = np.degrees(np.arccos(np.minimum(cosine, 1.0))) < 2.0
    return float(result.time[within.argmax()]) if within.any() else math.nan


def impulses(result: Any) -> tuple[float, float]:
    """Return the impulse of the main engine and of the brakes [N s]."""
    last = result["propulsion.impulse"][-1]
    return float(last[12]), float(last[8:12].sum())


def by_set() -> str:
    """Return a table with a column per parameter set in SETS."""
    return of_runs("set", runs(), [
        Column("50 m reached [s]", arrived, "{:.0f}"),
        Column("range from 1000 s after that [m]", held, "{:.2f} to {:.2f}"),
        Column("mean speed on the first leg, `geo`: relative [m/s]", leg_speed, "{:.4f}"),
        Column("first pointing below 2 deg [s]", pointed, "{:.0f}"),
        Column("impulse of main engine, brakes [N s]", impulses, "{:.1f}, {:.1f}"),
    ], across=True)  # fmt: skip


def by_latency() -> str:
    """Return a table of the velocity increments of each parameter set in SETS, without latency and
    with a latency of the controller of one macro step.
    """
    shown = Column("", "delta-v", "{:.4g}")
    cells = [[cell(shown, result_of(c)) for c in runs(late).values()] for late in (0, 1)]
    rows = zip(SETS, *cells, strict=True)
    return f"\n{table(('set', 'delta-v on time [m/s]', 'one macro step late [m/s]'), rows)}"


def tracking(result: Any) -> float:
    """Return the rms position error from 600 to 1200 s [cm]."""
    from ssp.shared.relative_motion import position_error

    error, time = position_error(result), result.time[: len(position_error(result))]
    rows = (time >= 600.0) & (time <= 1200.0)
    return float(100 * np.sqrt(np.mean(error[rows] ** 2)))


def thrusters() -> str:
    """Return a table that compares ideal propulsion and thrusters in the synchronised approach."""
    return of_runs("`sync_approach_thrusters`", THRUSTERS, [
        Column("position error, rms from 600 to 1200 s [cm]", tracking),
        Column("impulse [N s]", "total(last(propulsion.impulse))", "{:.1f}"),
    ])  # fmt: skip


VALUES = {"relay_sets": by_set, "relay_latency": by_latency, "relay_thrusters": thrusters}
