# SPDX-License-Identifier: BSD-2-Clause
"""Analysis of the safety filter in a run (docs/models.md M): least barrier values of its rules, and
when, by how much and for which rule it changed the force.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from harness.figures.style import legend_above, time_axis
from harness.mission import Limits, Metric, RuleFinding
from harness.mission.figure import Axes, Colour, Drawing, Overlay
from harness.results.histories import minus, norm, turned
from harness.results.result import Array, Result

from .relative_motion import SERVICER, TARGET

MODE, ACTIVE, CHANGE = "filter.mode", "filter.active", "filter.intervention"
BARRIER, LEAST, RELAXED = "filter.barrier", "filter.least_barrier", "filter.relaxed"
NEEDS = (MODE, ACTIVE, CHANGE, BARRIER, LEAST, RELAXED)
ERRORS = ("filter.position_error", "filter.velocity_error", "filter.reaction")
RESTING = 1e9
"""Barrier value of a rule that is off or does not apply. As least value: the rule has not applied
since the start.
"""
RULES = (("keep-out", "m"), ("corridor", "m"), ("speed", "m/s"), ("drift", "m"))
"""Rules with a barrier value that must not be negative, and the unit of this value."""
WORDS = ("stop", *(name for name, _ in RULES), "plume", "force limit")
"""Names by the value of filter.active, the rule that determines the force. 0 with a changed
force is a stop: a filter of kind simplex brakes although no rule is broken.
"""
SHOWN = 4
"""Number of episodes that the notes list, chosen by their impulse."""


class Episode(NamedTuple):
    """Uninterrupted time span in which the filter changed the force because of one rule: begin and
    end [s], largest change [N], impulse of the change [N s].
    """

    rule: str
    begin: float
    end: float
    largest: float
    impulse: float


def impulses(result: Result) -> Array:
    """Return the integral of the change of the force by the filter from each row to the next
    (rows,) [N s].
    """
    steps = np.diff(result.time, append=result.time[-1])
    return np.asarray(result[CHANGE] * steps)


def episodes(result: Result) -> list[Episode]:
    """Return the episodes of a run in the order of time."""
    time, change = result.time, impulses(result)
    rule = np.where(result[CHANGE] > 0, result[ACTIVE], -1)
    edges = np.flatnonzero(np.diff(rule, prepend=np.nan, append=np.nan))
    return [
        Episode(
            WORDS[int(rule[a])],
            float(time[a]),
            float(time[min(int(b), len(time) - 1)]),
            float(result[CHANGE][a:b].max()),
            float(change[a:b].sum()),
        )
        for a, b in pairwise(edges)
        if rule[a] >= 0
    ]


def notes(result: Result) -> Iterator[str]:
    """Yield notes for a report: how much the filter changed the commanded force, and the SHOWN
    episodes with the largest impulse of the change.
    """
    if not (result.holds(*NEEDS) and len(result.time)):
        return
    found = episodes(result)
    changed = int(np.count_nonzero(result[CHANGE]))
    yield (
        f"filter: force changed in {changed} of {len(result.time)} rows, "
        f"by {impulses(result).sum():.4g} N s in total; impulse after the filter "
        f"{passed(result):.4g} N s"
    )
    largest = sorted(found, key=lambda e: -e.impulse)[:SHOWN]
    for e in sorted(largest, key=lambda e: e.begin):
        yield (
            f"filter: {e.begin:.1f} to {e.end:.1f} s, {e.rule}: change of up to {e.largest:.3g} N, "
            f"{e.impulse:.3g} N s in total"
        )
    if len(found) > SHOWN:
        yield f"filter: {len(found) - SHOWN} further episodes"


def passed(result: Result) -> float:
    """Return the impulse of the force that the filter passes on to the actuators [N s]."""
    steps = np.diff(result.time, append=result.time[-1])
    return float(np.sum(norm(result["filter.F_safe_S"]) * steps))


# ---- rules


def findings(result: Result) -> Iterator[RuleFinding]:
    """Yield a finding for each rule of the filter that has applied: the least barrier value (the
    distance or speed that remains to the limit after braking) and the time of the first violation.

    A negative barrier value is a violation, with one exception: if one of the parameters ERRORS
    (errors of the estimates, reaction time) is not 0, these alone can make the value negative, and
    it is a violation only in rows in which the filter has relaxed the rule.
    """
    if not (result.holds(*NEEDS, parameters=ERRORS) and len(result.time)):
        return
    exact = not any(result.parameter(name) for name in ERRORS)
    for rule, (name, unit) in enumerate(RULES):
        least = float(result[LEAST][-1, rule])
        if least >= RESTING:
            continue
        broken = (result[BARRIER][:, rule] < 0) & (exact | (result[RELAXED] == rule + 1))
        when = float(result.time[np.argmax(broken)]) if broken.any() else float("nan")
        text, limit = "distance or speed that remains to the limit after braking", "at least 0"
        yield RuleFinding(f"{name} (filter)", least, unit, when, text, limit)


# ---- metrics


def _least(rule: int, result: Result, _: Limits) -> float:
    least = float(result[LEAST][-1, rule])
    return least if least < RESTING else float("nan")


METRICS = (
    Metric(
        "filter changes",
        "%",
        NEEDS,
        lambda r, _: float(100 * np.mean(r[CHANGE] > 0)),
        beside=True,
    ),
    Metric("filter impulse", "N s", NEEDS, lambda r, _: float(impulses(r).sum()), beside=True),
    *(
        Metric(f"{name} barrier", unit, NEEDS, partial(_least, rule), beside=True)
        for rule, (name, unit) in enumerate(RULES)
    ),
)


# ---- figure


def _draw(canvas: Axes, result: Result) -> None:
    time, barrier = result.time / time_axis(result.time).seconds, result[BARRIER]
    above, below = canvas.subplots(2, 1, sharex=True)
    for rule, (name, unit) in enumerate(RULES):
        if result[LEAST][-1, rule] < RESTING:
            shown = np.where(barrier[:, rule] < RESTING, barrier[:, rule], np.nan)
            above.plot(time, shown, lw=0.9, label=f"{name} [{unit}]")
    above.axhline(0, ls="--", lw=0.8, color="k")
    above.set_yscale("symlog", linthresh=0.1)
    above.set_ylabel("barrier")
    if above.get_legend_handles_labels()[0]:
        legend_above(above)
    below.plot(time, result[CHANGE], lw=0.9)
    below.set_ylabel("intervention [N]")
    below.set_xlabel(time_axis(result.time).label)


PARAMETERS = ("keep_out_radius", "use_corridor", "corridor_half_angle", "corridor_axis")
SEEN = (SERVICER, TARGET, "target.q_TN", MODE)


def beside_axis(result: Result) -> tuple[Array, Array]:
    """Return the coordinate of the servicer along the axis of the corridor, measured from the
    target, and its distance from that axis, (rows,) each [m].
    """
    back = result["target.q_TN"] * (1, -1, -1, -1)
    rho = turned(back, minus(result[SERVICER], result[TARGET]))
    along = rho @ result.parameter("filter.corridor_axis")
    return along, np.sqrt(np.maximum(norm(rho) ** 2 - along**2, 0))


def _draw_paths(canvas: Axes, results: Mapping[str, Result], colours: Mapping[str, Colour]) -> None:
    panel = canvas.subplots()
    for label, result in results.items():
        panel.plot(*beside_axis(result), lw=1.1, label=label, color=colours[label])
    first = next(iter(results.values()))
    radius, corridor, half, _ = (first.parameter(f"filter.{name}") for name in PARAMETERS)
    angle = np.linspace(0, np.pi, 181)
    panel.plot(radius * np.cos(angle), radius * np.sin(angle), "k--", lw=0.8)
    if corridor:
        far = np.array((0, max(float(beside_axis(r)[0].max()) for r in results.values())))
        panel.plot(far, far * np.tan(half), "k:", lw=0.8)
    panel.set_aspect("equal")
    panel.set_xlabel("along the axis of the corridor [m]")
    panel.set_ylabel("off the axis [m]")
    legend_above(panel)


OVERLAYS: tuple[Overlay, ...] = (
    Overlay(
        "filtered_paths",
        "Paths in target axes; keep-out sphere dashed, corridor dotted",
        SEEN,
        _draw_paths,
        (9, 4),
    ),
)
FIGURES: tuple[Drawing, ...] = (
    Drawing("filter", "Barriers and interventions of the safety filter", NEEDS, _draw, (11, 7)),
)
