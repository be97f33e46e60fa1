# SPDX-License-Identifier: BSD-2-Clause
"""Figures of the rendezvous in phases: path, range and speed, phase of the controller."""

from __future__ import annotations

import numpy as np

from harness.figures.style import legend_above
from harness.mission.figure import Axes, Curve, Drawing, Figure, Panel
from harness.results.result import Result
from ssp.shared.paths_in_space import draw_paths

from ..shared.relative_motion import DISTANCE, SPEED

PHASE = "controller.phase"
POSITION = "controller.rho_H"


def _trajectory(canvas: Axes, result: Result) -> None:
    """Draw the path about the target in Hill axes, in space and in the orbital plane, in one colour
    per phase of the controller.
    """
    path, phase = result[POSITION], result[PHASE]
    paths = {
        f"phase {number:g}": (np.where((phase == number)[:, None], path, np.nan), "-")
        for number in np.unique(phase)
    } | {"target": (np.zeros((1, 3)), "ko")}
    names = ("radial x_H [m]", "along track y_H [m]", "normal z_H [m]")
    legend_above(draw_paths(canvas, paths, names, (1, 0)))


FIGURES: tuple[Figure | Drawing, ...] = (
    Drawing("trajectory", "Path, Hill frame of the target", (POSITION, PHASE), _trajectory),
    Figure(
        "approach",
        "Range, speed and phase",
        (
            Panel("range [m]", (Curve(DISTANCE),), log=True),
            Panel("speed [m/s]", (Curve(SPEED),), log=True),
            Panel("phase", (Curve(PHASE),)),
        ),
        (PHASE,),
    ),
)
