# SPDX-License-Identifier: BSD-2-Clause
"""Claims about the events of the mission. Their reference values are from an independent simulation
of the guidance and control laws of this mission, with ideal thrust of at most 2, 1, 1 N along x, y,
z and a lag of 0.3 s.
"""

from __future__ import annotations

import numpy as np

from harness.mission.claim import (
    Band,
    Case,
    Claim,
    Evaluation,
    NotExercisedError,
    NotJudgedError,
    Paper,
    at_least,
    at_most,
)
from harness.results.result import Result

from ..shared.relative_motion import range_
from .events import ISP, NEEDS, Stay, captures, increments, stays

LEAST, PEAK, LOAD = "monitor.least_margin", "mechanism.contact_force_peak", "mechanism.load_force"
RATE, BY_ARM = "servicer.omega_SN_S", "manager.by_arm"


def by_arm(result: Result) -> bool:
    """Return whether the arm captures the target: then the claims about the probe do not apply."""
    return result.holds(parameters=(BY_ARM,)) and bool(result.parameter(BY_ARM))


def stay(result: Result, phase: str) -> Stay:
    """Return the first Stay of the mission in a phase; raise NotExercisedError if the run does not
    reach the phase.
    """
    found = [s for s in stays(result) if s.phase == phase]
    if not found:
        raise NotExercisedError(f"the mission does not reach {phase}")
    return found[0]


def reached(phase: str, after: str | None = None) -> Evaluation:
    """Return an evaluation that gives the time at which a phase begins, measured from t = 0 or from
    the beginning of the phase `after` [s], and the range at that time [m].
    """

    def evaluate(result: Result) -> tuple[float, ...]:
        there = stay(result, phase)
        since = stay(result, after).begin if after else 0.0
        return there.begin - since, float(range_(result)[there.row])

    return evaluate


def range_at(phase: str) -> Evaluation:
    """Return an evaluation that gives the range at the beginning of a phase [m]."""
    return lambda result: (float(range_(result)[stay(result, phase).row]),)


def _capture(result: Result, what: str) -> float:
    found = [t for t, event in captures(result) if event == what]
    if not found:
        raise NotJudgedError(f"no {what}")
    return found[-1]


def soft_after_mating(result: Result) -> tuple[float, ...]:
    """Return the time from the last mating to soft capture [s]."""
    last = [s for s in stays(result) if s.phase == "mating"][-1]
    return (_capture(result, "soft capture") - last.begin,)


def at_soft(name: str) -> Evaluation:
    """Return an evaluation that gives the norm of a variable in the row before soft capture."""

    def evaluate(result: Result) -> tuple[float, ...]:
        row = np.searchsorted(result.time, _capture(result, "soft capture")) - 1
        return (float(np.linalg.norm(result[name][row])),)

    return evaluate


def hard_after_soft(result: Result) -> tuple[float, ...]:
    """Return the time from soft to hard capture [s]."""
    return (_capture(result, "hard capture") - _capture(result, "soft capture"),)


def largest(name: str) -> Evaluation:
    """Return an evaluation that gives the largest value of a variable."""
    return lambda result: (float(result[name].max()),)


def rate_at_end(result: Result) -> tuple[float, ...]:
    """Return the magnitude of the angular rate of the servicer in the last row [rad/s]."""
    return (float(np.linalg.norm(result[RATE][-1])),)


def all_increments(result: Result) -> tuple[float, ...]:
    """Return the sum of the velocity increments of the mission, from the used propellant [m/s]."""
    return (float(increments(result)[-1]),)


def least_before_mating(result: Result) -> tuple[float, ...]:
    """Return the least range before the first mating [m]."""
    return (float(range_(result)[: stay(result, "mating").row].min()),)


def least_margin(result: Result) -> tuple[float, ...]:
    """Return the smallest of the three numbers that follow, whose sign decides the claim, then the
    least margins of the rules keep-out [m], corridor [m] and speed [m/s].
    """
    margins = result[LEAST][-1, :3]
    return (float(margins.min()), *map(float, margins))


def claim(  # noqa: PLR0913, PLR0917 - the columns of the table
    name: str,
    there: str,
    evaluation: Evaluation,
    figure: str,
    unit: str,
    band: Band,
    *needs: str,
) -> Claim:
    """Return a claim on an event; there: value in the independent simulation, as text; figure:
    format of the value of a run; needs: variables that the claim needs besides NEEDS.
    """
    return Claim(name, f"{name}: {there}", "events", (*NEEDS, *needs), evaluation, figure, unit,
                 band, interval=1.0)  # fmt: skip


def after(phase: str, before: str, there: str, low: float, high: float) -> Claim:
    """Return the claim that a phase begins `low` to `high` seconds after the beginning of the phase
    `before`; there: value in the independent simulation, as text.
    """
    return claim(phase, there, reached(phase, before), f"{{0:.0f}} s after {before}", "s",
                 Band(low, high))  # fmt: skip


CLAIMS = (
    claim("hold 1", "1421 s", reached("hold 1"), "{0:.0f} s", "s", Band(1100, 2200)),
    claim("range at hold 1", "103.8 m", range_at("hold 1"), "{0:.1f} m", "m", Band(95, 105)),
    after("closing", "hold 1", "60 s after hold 1", 60, 70),
    after("hold 2", "closing", "509 s after closing, at 20.7 m", 350, 900),
    after("fly-around", "hold 2", "30 s after hold 2", 30, 90),
    after("final", "fly-around", "435 s after fly-around (depends on the grasp axis)", 200, 800),
    after("hold 3", "final", "329 s after final", 320, 400),
    claim("soft capture", "52 s after mating", soft_after_mating, "{0:.1f} s", "s", Band(45, 75)),
    claim("speed at soft capture", "0.029 m/s", at_soft("mechanism.dtip_Q"), "{0:.3f} m/s", "m/s",
          at_most(0.06), "mechanism.dtip_Q"),
    claim("off the axis at soft capture", "0.2 mm", at_soft("mechanism.offset"), "{0:.2g} m", "m",
          at_most(0.02), "mechanism.offset"),
    claim("hard capture", "30 s after soft capture", hard_after_soft, "{0:.1f} s", "s",
          Band(30, 32)),
    claim("peak contact force", "4.8 N", largest(PEAK), "{0:.2f} N", "N", Band(3, 40), PEAK),
    claim("peak load", "3.8 N", largest(LOAD), "{0:.2f} N", "N", at_most(60), LOAD),
    after("stack", "detumble", "110 s after detumble", 60, 300),
    claim("rate at the end", "1e-5 rad/s and falling", rate_at_end, "{0:.2g} rad/s", "rad/s",
          at_most(2e-4), RATE),
    claim("velocity increments", "5.9 m/s", all_increments, "{0:.2f} m/s", "m/s", Band(4, 10)),
    claim("least range before mating", "3.00 m", least_before_mating, "{0:.3f} m", "m",
          at_least(2.9)),
    claim("margins of keep-out, corridor, speed", "above 0", least_margin,
          "{1:.3g} m, {2:.3g} m, {3:.3g} m/s", "", at_least(0), LEAST),
)  # fmt: skip

PAPER = Paper(
    title="Events of a mission (independent simulation of the same laws, ideal thrust)",
    needs=NEEDS,
    claims=CLAIMS,
    parameters=(ISP,),
    meant=lambda result: bool((result["manager.phase"] == 10).any()) and not by_arm(result),
    cases=(Case("servicing_mission"), Case("servicing_mission_navigated")),
)
