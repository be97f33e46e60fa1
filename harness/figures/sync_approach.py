# SPDX-License-Identifier: BSD-2-Clause
"""Figures of the synchronised approach: counterparts of figures 4 to 11 of Zhu & Yang 2009."""

from __future__ import annotations

import numpy as np

from harness.figures.figure import (
    Axes,
    Curve,
    Drawing,
    Figure,
    Panel,
    degrees,
    draw_paths,
    norm,
)
from harness.results.derived import (
    ATTITUDE,
    FORCE_H,
    POSITION_H,
    REFERENCE_ATTITUDE,
    attitude_error,
    attitude_error_vector,
    force_H,
    position_error_H,
    release_time,
)
from harness.results.result import Result

J_LABELS = ("J11", "J12", "J13", "J22", "J23", "J33")
A_LABELS = ("A11", "A12", "A13", "A22", "A23", "A33")
TURNED = (ATTITUDE, REFERENCE_ATTITUDE)


def _approach(canvas: Axes, result: Result) -> None:
    """Path of the servicer about the target in Hill axes: in space, and seen along the orbit
    normal.
    """
    actual, reference = result["guidance.rho_H"], result["guidance.rho_ref_H"]
    names = ("radial x [m]", "along track y [m]", "normal z [m]")
    paths = {
        "servicer": (actual, "-"),
        "reference": (reference[1:], "--"),
        "target": (np.zeros((1, 3)), "ko"),
    }
    plane = draw_paths(canvas, paths, names, (1, 0))
    plane.plot(actual[0, 1], actual[0, 0], "g^", label="start")
    plane.legend(fontsize="small")


FIGURES: tuple[Figure | Drawing, ...] = (
    Drawing(
        "trajectory",
        "Approach trajectory, Hill frame of the target",
        ("guidance.rho_H", "guidance.rho_ref_H"),
        _approach,
    ),
    Figure("range", "Range", (Panel("range [m]", (Curve("guidance.range"),)),)),
    Figure(
        "force",
        "Control force",
        (
            Panel("Hill axes [N]", (Curve(force_H, needs=FORCE_H),)),
            Panel("servicer axes [N]", (Curve("propulsion.F_S"),)),
        ),
    ),
    Figure(
        "tracking_error",
        "Position tracking error, Hill axes",
        (
            Panel("error [m]", (Curve(position_error_H, needs=POSITION_H),)),
            Panel("|error| [m]", (Curve(position_error_H, "", norm, needs=POSITION_H),), log=True),
        ),
    ),
    Figure(
        "estimated_mass",
        "Estimated and true mass",
        (
            Panel(
                "mass [kg]",
                (Curve("controller.m_hat", "estimate"), Curve("servicer.mass", "true", style="--")),
            ),
        ),
    ),
    Figure(
        "attitude_error",
        "Attitude error",
        (
            Panel(
                "MRP of S relative to D",
                (Curve(attitude_error_vector, needs=TURNED),),
                after=release_time,
            ),
            Panel(
                "angle [deg]",
                (Curve(attitude_error, convert=degrees, needs=TURNED),),
                after=release_time,
                log=True,
            ),
        ),
    ),
    Figure(
        "wheel_speeds",
        "Wheel speeds",
        (Panel("speed [rad/s]", (Curve("servicer.wheel_speed"),), after=release_time),),
        ("guidance.rho_H",),
    ),
    Figure(
        "inertia_estimates",
        "Estimated inertias",
        (
            Panel(
                "body [kg m2]",
                (Curve("controller.eta_hat", convert=lambda x: x[:, :6], labels=J_LABELS),),
                after=release_time,
            ),
            Panel(
                "wheels [kg m2]",
                (Curve("controller.eta_hat", convert=lambda x: x[:, 6:], labels=A_LABELS),),
                after=release_time,
            ),
        ),
    ),
    Figure(
        "alignment",
        "Alignment",
        (
            Panel(
                "angle [deg]",
                (
                    Curve("guidance.beta_t", "grasp axis to relative position", degrees),
                    Curve("guidance.beta_p", "arm to direction of target", degrees),
                ),
            ),
        ),
    ),
)
