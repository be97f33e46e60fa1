# SPDX-License-Identifier: BSD-2-Clause
"""Figures that show several runs together: one quantity per panel, one colour per run.

For ppc_tracking they are the counterparts of figures 2 to 8 of Yin et al. 2017.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from harness.figures.style import MANY, legend_above
from harness.mission.figure import (
    AXES,
    Axes,
    Colour,
    Curve,
    Figure,
    Overlay,
    Panel,
    degrees,
)
from harness.results.result import Result
from ssp.shared.paths_in_space import draw_paths

from .line_of_sight_figures import LOS, QUATERNION, quaternion
from .relative_motion import (
    ATTITUDE,
    DISTANCE,
    REFERENCE,
    REFERENCE_ATTITUDE,
    SERVICER,
    SPEED,
    TARGET,
    attitude_error,
    position_error,
    release_time,
)


def _sum(name: str, first: int = 0, last: int | None = None) -> Curve:
    """Return the curve of the sum of a vector's elements with indices from `first` to last - 1."""
    return Curve(lambda r: np.asarray(r[name][:, first:last].sum(axis=1)), needs=(name,))


def _per_axis(
    what: str, unit: str, name: str, labels: tuple[str, ...] = AXES, **look: Any
) -> tuple[Panel, ...]:
    return tuple(
        Panel(f"{what} {label} [{unit}]", (Curve(f"{name}[{i}]"),), **look)
        for i, label in enumerate(labels, start=1)
    )


def _trajectories(
    canvas: Axes, results: Mapping[str, Result], colours: Mapping[str, Colour]
) -> None:
    """Draw the paths relative to the target, N axes."""
    paths = {label: (r[SERVICER] - r[TARGET], "-") for label, r in results.items()} | {
        "target": (np.zeros((1, 3)), "ko")
    }
    flat = draw_paths(canvas, paths, ("x_N [m]", "y_N [m]", "z_N [m]"), (0, 2), colours)
    if len(results) < MANY:
        legend_above(flat)


FIGURES: tuple[Figure | Overlay, ...] = (
    Overlay(
        "compared_trajectory",
        "Paths relative to the target, N axes",
        (SERVICER, TARGET),
        _trajectories,
    ),
    Figure(
        "compared_range",
        "Range and speed",
        (
            Panel("range [m]", (Curve(DISTANCE),)),
            Panel("relative speed [m/s]", (Curve(SPEED),)),
        ),
    ),
    Figure(
        "compared_errors",
        "Distance and angle from the reference",
        (
            Panel(
                "position [m]",
                (Curve(position_error, needs=(SERVICER, TARGET, REFERENCE)),),
                log=True,
            ),
            Panel(
                "attitude [deg]",
                (Curve(attitude_error, convert=degrees, needs=(ATTITUDE, REFERENCE_ATTITUDE)),),
                log=True,
            ),
        ),
    ),
    Figure(
        "compared_line_of_sight",
        "Line of sight",
        (
            Panel("elevation [deg]", (Curve("degrees(guidance.los.elevation)"),)),
            Panel("azimuth [deg]", (Curve("degrees(guidance.los.azimuth)"),)),
        ),
    ),
    Figure(
        "compared_quaternion",
        f"{QUATERNION} (desired: dashed)",
        tuple(quaternion(k) for k in (1, 2, 3)),
        LOS,
    ),
    Figure(
        "compared_acceleration",
        "Commanded acceleration along the line-of-sight axes",
        _per_axis("a", "m/s2", "controller.a_cmd_L", ("range", "elevation", "azimuth")),
    ),
    Figure(
        "compared_force", "Force on the servicer, body axes", _per_axis("F", "N", "propulsion.F_S")
    ),
    Figure(
        "compared_torque",
        "Torque on the servicer, body axes",
        _per_axis("M", "N m", "propulsion.M_S", idle_until=release_time),
    ),
    Figure(
        "compared_wheels",
        "Wheel speeds",
        _per_axis("wheel", "rad/s", "servicer.wheel_speed"),
        ("guidance.rho_H",),
    ),
    Figure(
        "compared_impulse",
        "Impulse of all axes or thrusters so far",
        (Panel("[N s]", (_sum("propulsion.impulse"),)),),
    ),
    Figure(
        "compared_engines",
        "Main engine and brakes",
        (
            Panel("main engine [N]", (_sum("propulsion.thrust", 12, 13),)),
            Panel("brakes [N]", (_sum("propulsion.thrust", 8, 12),)),
        ),
        ("guidance.q_DS",),
    ),
)
