# SPDX-License-Identifier: BSD-2-Clause
"""Figures, metrics and other parts that all missions with an approach to a target share."""

from __future__ import annotations

from collections.abc import Iterator

from harness.mission import Drawing, Figure, FinalMetric, Limits, Mission, Overlay, Paper, Scene
from harness.results.result import Result

from . import (
    filtering,
    flexible,
    line_of_sight_figures,
    navigation_claims,
    navigation_figures,
    optima,
    plan_figures,
    safety_figures,
)
from . import relative_motion as motion
from .approach_figures import (
    ADAPTIVE,
    ALIGNMENT,
    ATTITUDE_ERROR,
    FIRING,
    FORCE,
    PHASES,
    RANGE,
    WHEEL_SPEEDS,
)
from .approach_scene import PAIR, pair, pairs
from .conventions import ADDED, CONTROLLER, ORBITS, RESTARTS, STEERED
from .meanings import explained
from .metrics import AT_LIMITS, METRICS, bands, definitions
from .overlays import FIGURES as OVERLAYS
from .safety import LEAST, RESTING, RULES, findings

PLACES = (motion.SERVICER, motion.TARGET)
FINAL = (
    FinalMetric("range", "m", PLACES, motion.range_),
    FinalMetric("speed", "m/s", motion.VELOCITIES, motion.relative_speed),
    FinalMetric("position error", "m", (*PLACES, motion.REFERENCE), motion.position_error),
    FinalMetric("phase", "", (), "controller.phase"),
)
"""Metrics at the end of a run for the head of a page, which shows the first three that a result
has.
"""
COMMON = (RANGE, optima.FIGURE, FORCE, *ADAPTIVE, ATTITUDE_ERROR, WHEEL_SPEEDS, ALIGNMENT)
"""Figures for approaches with any guidance and any controller."""
FURTHER = (
    FIRING,
    *line_of_sight_figures.FIGURES,
    *navigation_figures.FIGURES,
    *safety_figures.FIGURES,
    *filtering.FIGURES,
    *flexible.FIGURES,
    *plan_figures.FIGURES,
)
"""Figures that need certain components: actuators, controllers, sensors, monitor."""
IDLE = (LEAST, *(rule.history for rule in RULES), filtering.BARRIER, filtering.LEAST)
"""Variables with margins and barrier values. Where a variable has the value RESTING, its rule does
not apply, and figures do not draw the value.
"""


def approach(
    figures: tuple[Figure | Drawing, ...] = (),
    claims: tuple[Paper, ...] = (),
    overlays: tuple[Figure | Overlay, ...] = (),
) -> Mission:
    """Return the Mission of an approach, with the figures, papers and overlays (figures of several
    runs) of this mission in addition to the shared ones.
    """
    return Mission(
        figures=(*COMMON, *figures, *FURTHER),
        overlays=(*OVERLAYS, *filtering.OVERLAYS, *overlays),
        phases=PHASES,
        metrics=explained((*METRICS, *filtering.METRICS, *flexible.METRICS)),
        claims=(*claims, navigation_claims.PAPER),
        final=FINAL,
        scene=(Scene(PAIR, (), pair, pairs),),
        rules=(findings, filtering.findings),
        idle=tuple((name, RESTING) for name in IDLE),
        notes=(notes, filtering.notes, flexible.notes),
        bands=(bands,),
        definitions=(definitions,),
        exchange=(ORBITS,),
        restarts=RESTARTS,
        examples=(CONTROLLER, *ADDED),
        steering=(STEERED,),
    )


# ---- notes

TORQUE_COMMANDS = ("propulsion.M_S", "controller.wheel_accel_cmd")
"""Commands that turn the servicer."""


def notes(result: Result) -> Iterator[str]:
    """Yield notes for a report: torques without effect, actuators that are often at a limit."""
    yield from _torque_without_effect(result)
    for metric in AT_LIMITS:
        if (share := metric(result, Limits())) > metric.above:
            yield (
                f"{metric.name} in {share:.0f} % of the rows: these rows show the limit of the "
                f"actuator, not the control law"
            )


def _torque_without_effect(result: Result) -> Iterator[str]:
    """Yield a line if a torque is commanded while the attitude of the servicer is frozen."""
    release = min(motion.release_time(result), result.time[-1])
    frozen = result.time < release
    for name in TORQUE_COMMANDS:
        if name in result and result[name][frozen].any():
            yield (
                f"the attitude of the servicer is frozen before {release:g} s, so {name} acts on "
                f"nothing until then; to turn the servicer from the start: --set servicer.t_att=0"
            )
            return
