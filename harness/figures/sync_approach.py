# SPDX-License-Identifier: BSD-2-Clause
"""Figures of the synchronised approach: counterparts of figures 4 to 11 of Zhu & Yang 2009."""

from __future__ import annotations

import numpy as np

from harness.figures.figure import (
    Array,
    Axes,
    Curve,
    Drawing,
    Figure,
    Level,
    Panel,
    degrees,
    draw_paths,
    norm,
)
from harness.figures.style import legend_above
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

ETA = "controller.eta_hat"
"""Elements 11 12 13 22 23 33 of the inertia of the body, then of the wheels."""
MAIN, OFF = (0, 3, 5), (1, 2, 4)
"""Which of six elements are on the diagonal, and which are not."""
BODY, WHEELS = "servicer.J_S", "servicer.A_w"
FINAL_RANGE = Level("to be held:", ("guidance.rho_M", "guidance.zeta1", "guidance.rho_f"))
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
    legend_above(plane)


def _inertias(what: str, first: int, elements: tuple[int, ...], parameter: str) -> Panel:
    """Six estimated elements from `first` on, or those on or off the diagonal, and the true ones,
    dashed.
    """
    chosen = [first + k for k in elements]
    places = [(i, j) for i in range(3) for j in range(i, 3)]
    labels = tuple("{}{}".format(*(i + 1 for i in places[k])) for k in elements)

    def true(result: Result) -> Array:
        matrix = result.parameter(parameter)
        return np.tile([matrix[places[k]] for k in elements], (len(result.time), 1))

    estimates = Curve(ETA, "", lambda x: np.asarray(x[:, chosen]), labels, "-")
    values = Curve(true, "", None, ("true", "", ""), "--", anew=True, parameters=(parameter,))
    return Panel(f"{what} [kg m2]", (estimates, values), after=release_time)


FIGURES: tuple[Figure | Drawing, ...] = (
    Drawing(
        "trajectory",
        "Approach trajectory, Hill frame of the target",
        ("guidance.rho_H", "guidance.rho_ref_H"),
        _approach,
    ),
    Figure(
        "range",
        "Range",
        (Panel("range [m]", (Curve("guidance.range", "range"),), level=FINAL_RANGE),),
    ),
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
        "Estimated inertias, true ones dashed",
        (
            _inertias("body, diagonal", 0, MAIN, BODY),
            _inertias("body, products", 0, OFF, BODY),
            _inertias("wheels, diagonal", 6, MAIN, WHEELS),
            _inertias("wheels, products", 6, OFF, WHEELS),
        ),
        (ETA,),
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
