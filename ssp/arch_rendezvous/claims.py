# SPDX-License-Identifier: BSD-2-Clause
"""Rendezvous benchmark SPRE of ARCH-COMP (Chan & Mitra 2017): results proved by other tools, and
evidence from one run.

A proof covers all start positions and abort times of an instance of the benchmark, a run only one
of them. "Reproduced" means that this run agrees with the published verdict, not that the verdict is
proved again.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from harness.mission.claim import Band, Case, Claim, Paper, at_least, parameter, scalar
from harness.results.result import Result

LEAST, PHASE = "monitor.least_margin", "controller.phase"
ABORT = "controller.t_abort"
UNSAFE_ABORT = (240 * 60.0, 300 * 60.0)
"""Limits of the abort times [s] for which the benchmark states the verdict "unsafe"."""
STOP = 300 * 60.0


def abort_time(result: Result) -> float:
    """Return the time of the abort, after which there is no thrust [s]."""
    return scalar(result, ABORT)


def unsafe(result: Result) -> bool:
    """Return whether the published verdict for the abort time of a run is "unsafe"."""
    low, high = UNSAFE_ABORT
    return low < abort_time(result) <= high


def box(result: Result) -> tuple[float, ...]:
    """Return the least distance to the box |x|, |y| <= 0.2 m about the target [m], negative inside,
    and the time from which there is no thrust: abort, at the latest STOP [min].
    """
    return _least(result, 0), min(abort_time(result), STOP) / 60


def corridor(result: Result) -> tuple[float, ...]:
    """Return the least distance to the edge of the line-of-sight cone [m], and the duration of the
    rendezvous attempt [min].
    """
    return _least(result, 1), _attempt(result)


def speed(result: Result) -> tuple[float, ...]:
    """Return the least margin to the speed limit [m/min], and the duration of the rendezvous
    attempt [min].
    """
    return _least(result, 2) * 60, _attempt(result)


def _least(result: Result, rule: int) -> float:
    return float(result[LEAST][-1, rule])


def _attempt(result: Result) -> float:
    steps = np.diff(result.time, prepend=result.time[0])
    return float(np.sum(steps[result[PHASE] == 2])) / 60


LINE_OF_SIGHT = Claim(
    name="line of sight",
    text="during the attempt |y| <= -x tan 30 deg (published: holds in all safe instances)",
    where="SRNA01, SRA01 to SRA08, SRU01, SRU02",
    needs=(LEAST, PHASE),
    compute=corridor,
    value="stays {0:.3g} m off the edge of the cone in {1:.0f} min of attempt",
    unit="m",
    reproduced=at_least(0.0),
    interval=STOP,
)
SPEED = Claim(
    name="speed",
    text="during the attempt the speed is at most 3.3 m/min "
    "(published: holds in all safe instances)",
    where="SRNA01, SRA01 to SRA08, SRU01, SRU02",
    needs=(LEAST, PHASE),
    compute=speed,
    value="stays {0:.3g} m/min below the limit in {1:.0f} min of attempt",
    unit="m/min",
    reproduced=at_least(0.0),
    interval=STOP,
)
SAFE = Claim(
    name="passive safety",
    text="after the abort the drift stays out of the box |x|, |y| <= 0.2 m "
    "(published: safe, verified)",
    where="SRA01 to SRA08, abort up to 240 min; SRNA01",
    needs=(LEAST,),
    compute=box,
    value="stays {0:.3g} m outside; no thrust from {1:.0f} min on",
    unit="m",
    reproduced=at_least(0.0),
    interval=STOP,
)
UNSAFE = Claim(
    name="collision",
    text="after the abort the drift enters the box |x|, |y| <= 0.2 m "
    "(published: unsafe, falsified)",
    where="SRU01, SRU02, abort at 260 min",
    needs=(LEAST,),
    compute=box,
    value="least distance to the box {0:.3g} m (negative inside); no thrust from {1:.0f} min on",
    unit="m",
    reproduced=Band(high=-1e-9),
    interval=STOP,
)

TITLE = (
    "Chan N., Mitra S.: Verifying safety of an autonomous spacecraft rendezvous mission. "
    "ARCH 2017, EPiC Series in Computing 48, 20-32; verdicts of the competition ARCH-COMP, "
    "linear dynamics"
)


def outside_start_box(result: Result) -> Iterator[str]:
    """Yield a text if a run starts outside the start box of the benchmark: x from -925 to -875 m, y
    from -425 to -375 m, z = 0, in Hill axes.
    """
    off = np.abs(parameter(result, "servicer.rho_0_H") - (-900, -400, 0)) - (25, 25, 0)
    if (distance := float(np.max(off))) > 0:
        yield f"start outside the start box of the benchmark by {distance:.6g} m instead of 0 m"


CASES = (Case("arch_rendezvous", free=("servicer.rho_0_H", ABORT)),)
"""Start position and abort time may differ from the values in the system, since they
distinguish the instances of the benchmark.
"""

PAPERS = (
    Paper(
        title=f"{TITLE}: an instance that is safe",
        needs=(LEAST, PHASE),
        claims=(LINE_OF_SIGHT, SPEED, SAFE),
        differs=outside_start_box,
        cases=CASES,
        parameters=(ABORT,),
        meant=lambda result: not unsafe(result),
    ),
    Paper(
        title=f"{TITLE}: an instance that is unsafe",
        needs=(LEAST, PHASE),
        claims=(LINE_OF_SIGHT, SPEED, UNSAFE),
        differs=outside_start_box,
        cases=CASES,
        parameters=(ABORT,),
        meant=unsafe,
    ),
)
