# SPDX-License-Identifier: BSD-2-Clause
"""What every approach to a target hands the engine, with what a mission has of its own."""

from __future__ import annotations

from harness.mission import Drawing, Figure, Mission, Overlay, Paper, Scene

from . import (
    flexible,
    line_of_sight_figures,
    navigation_claims,
    navigation_figures,
    safety_figures,
)
from .approach_figures import (
    ADAPTIVE,
    ALIGNMENT,
    ATTITUDE_ERROR,
    FIRING,
    FORCE,
    RANGE,
    WHEEL_SPEEDS,
)
from .approach_scene import PAIR, pair, pairs
from .conventions import CONTROLLER, ORBITS, RESTARTS
from .gauges import GAUGES
from .measures import MEASURES, bands, definitions
from .notes import notes
from .overlays import FIGURES as OVERLAYS
from .phases import PHASES
from .safety import LEAST, RESTING, RULES, findings

COMMON = (RANGE, FORCE, *ADAPTIVE, ATTITUDE_ERROR, WHEEL_SPEEDS, ALIGNMENT)
"""Figures of any guidance and any controller."""
FURTHER = (
    FIRING,
    *line_of_sight_figures.FIGURES,
    *navigation_figures.FIGURES,
    *safety_figures.FIGURES,
    *flexible.FIGURES,
)
"""Figures of what may take the place of a component: actuators, controllers, sensors, monitor."""


def approach(
    figures: tuple[Figure | Drawing, ...] = (),
    claims: tuple[Paper, ...] = (),
    overlays: tuple[Figure | Overlay, ...] = (),
) -> Mission:
    """The mission of an approach: its own figures between those that all have, its papers."""
    return Mission(
        figures=(*COMMON, *figures, *FURTHER),
        overlays=(*OVERLAYS, *overlays),
        phases=PHASES,
        measures=(*MEASURES, *flexible.MEASURES),
        claims=(*claims, navigation_claims.PAPER),
        gauges=GAUGES,
        scene=(Scene(PAIR, (), pair, pairs),),
        rules=(findings,),
        idle=tuple((name, RESTING) for name in (LEAST, *(rule.history for rule in RULES))),
        notes=(notes, flexible.notes),
        bands=(bands,),
        definitions=(definitions,),
        exchange=(ORBITS,),
        restarts=RESTARTS,
        examples=(CONTROLLER,),
    )
