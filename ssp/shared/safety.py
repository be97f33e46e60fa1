# SPDX-License-Identifier: BSD-2-Clause
"""Findings of the safety monitor of a run: for each rule the least margin since the start and the
first violation, also between samples (docs/models.md G).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.mission import RuleFinding
from harness.results.result import Result

LEAST, FIRST = "monitor.least_margin", "monitor.t_first"
VIOLATED, WHEN = "monitor.rule_violated", "monitor.t_violation"
FOUND = (LEAST, FIRST, VIOLATED, WHEN)
Parameter = Callable[[str], NDArray[np.float64]]
"""Function that returns a parameter of the monitor by its name."""
RESTING = 1e9
"""Margin of a rule that is off or does not apply. As least margin: the rule has not applied since
the start.
"""


class Rule(NamedTuple):
    """Rule of the monitor: its name, the unit of its margin, and the output with the margin over
    time (`history`).
    """

    name: str
    unit: str
    history: str


RULES = (
    Rule("keep-out", "m", "monitor.keep_out_margin"),
    Rule("corridor", "m", "monitor.corridor_margin"),
    Rule("speed", "m/s", "monitor.speed_margin"),
    Rule("passive", "m", "monitor.passive_margin"),
    Rule("plume", "m", "monitor.plume_margin"),
    Rule("navigation", "s", "monitor.navigation_margin"),
    Rule("escape", "m", "monitor.escape_margin"),
)
"""Rules in the order of the elements of monitor.least_margin."""


def findings(result: Result) -> Iterator[RuleFinding]:
    """Yield the finding of each rule that was in force during the run."""
    if not (result.holds(*FOUND) and len(result.time)):
        return
    for rule, margin, time in zip(RULES, result[LEAST][-1], result[FIRST][-1], strict=False):
        if margin < RESTING:
            yield RuleFinding(
                rule.name,
                float(margin),
                rule.unit,
                float(time) if time >= 0 else float("nan"),
                result.description(rule.history),
                limit(result, rule),
            )


def least_margin(result: Result, name: str) -> float:
    """Return the least margin of a rule since the start, in the unit of the rule; NaN if the rule
    was not in force.
    """
    return next((f.margin for f in findings(result) if f.name == name), float("nan"))


def first_violation(result: Result) -> float:
    """Return the time of the first violation of any rule [s]; NaN if there was none."""
    times = [f.violated for f in findings(result) if np.isfinite(f.violated)]
    return min(times, default=float("nan"))


# ---- limits of the rules as text


def limit(result: Result, rule: Rule) -> str:
    """Return a text that states the limit of a rule with the parameters of the run; "" if the
    result lacks them.
    """
    if not result.holds(parameters=("monitor.keep_out_half", "monitor.lost_time")):
        return ""
    return LIMITS[rule.name](lambda name: result.parameter(f"monitor.{name}"))


def _keep_out(p: Parameter) -> str:
    half = p("keep_out_half")
    if p("keep_out_shape") == 1 and np.ptp(half) == 0:
        return f"outside a sphere of {half[0]:g} m"
    shape = "an ellipsoid" if p("keep_out_shape") == 1 else "a box"
    return f"outside {shape} with half axes of {', '.join(f'{x:g}' for x in half)} m"


def _corridor(p: Parameter) -> str:
    frame = "the target" if p("corridor_axes") else "the orbit"
    cone = f"within {np.degrees(p('corridor_half_angle')):g} deg of an axis fixed in {frame}"
    return cone + (f", up to {p('corridor_length'):g} m" if p("corridor_length") else "")


def _speed(p: Parameter) -> str:
    limit, slope = f"at most {p('speed_at_zero'):g} m/s", p("speed_slope")
    if p("speed_tumble"):
        tumble = f"tumble rate of the target, at most {p('tumble_max'):g} rad/s"
        return f"{limit} + ({slope:.4g} 1/s + {tumble}) * range"
    return limit + (f" + {slope:.4g} 1/s * range" if slope else "")


def _passive(p: Parameter) -> str:
    return f"a drift of {p('passive_time'):g} s without thrust does not enter the keep-out zone"


def _plume(p: Parameter) -> str:
    return (
        f"no exhaust within {np.degrees(p('plume_half_angle')):g} deg of the direction "
        f"to the target below a range of {p('plume_range'):g} m"
    )


def _navigation(p: Parameter) -> str:
    if p("range_alone"):
        state = "with a state that disagrees with the independent range"
    else:
        state = "without a valid relative state"
    return f"at most {p('lost_time'):g} s {state}"


def _escape(p: Parameter) -> str:
    phases = ("before the final approach", "while approaching")
    radii = [f"{r:g} m {phase}" for r, phase in zip(p("escape_radius"), phases, strict=True) if r]
    return (
        f"after an abort the servicer stays outside a radius for {p('escape_time'):g} s: "
        f"{', '.join(radii)}"
    )


LIMITS = dict(
    zip(
        [rule.name for rule in RULES],
        (_keep_out, _corridor, _speed, _passive, _plume, _navigation, _escape),
        strict=True,
    )
)
