# SPDX-License-Identifier: BSD-2-Clause
"""Figures of the synchronised approach: counterparts of figures 4 and 7 of Zhu & Yang 2009; the
others are in ssp/shared/approach_figures.py.
"""

from __future__ import annotations

import numpy as np

from harness.figures.style import legend_above
from harness.mission.figure import (
    Axes,
    Curve,
    Drawing,
    Figure,
    Panel,
)
from harness.results.result import Result
from ssp.shared.paths_in_space import draw_paths

from ..shared.relative_motion import (
    POSITION_ERROR_H,
)


def _approach(canvas: Axes, result: Result) -> None:
    """Draw the path of the servicer and its reference about the target in Hill axes, in space and
    in the orbital plane.
    """
    actual, reference = result["guidance.rho_H"], result["guidance.rho_ref_H"]
    names = ("radial x_H [m]", "along track y_H [m]", "normal z_H [m]")
    paths = {
        "servicer": (actual, "-"),
        "reference": (reference[1:], "--"),
        "target": (np.zeros((1, 3)), "ko"),
    }
    plane = draw_paths(canvas, paths, names, (1, 0))
    plane.plot(actual[0, 1], actual[0, 0], "g^", label="start")
    legend_above(plane)


FIGURES: tuple[Figure | Drawing, ...] = (
    Drawing(
        "trajectory",
        "Approach trajectory, Hill frame of the target",
        ("guidance.rho_H", "guidance.rho_ref_H"),
        _approach,
    ),
    Figure(
        "tracking_error",
        "Position tracking error, Hill axes",
        (
            Panel("error, Hill axes [m]", (Curve(POSITION_ERROR_H),)),
            Panel("|error| [m]", (Curve(f"norm({POSITION_ERROR_H})"),), log=True),
        ),
    ),
)
