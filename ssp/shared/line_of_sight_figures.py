# SPDX-License-Identifier: BSD-2-Clause
"""Figures of approaches in line-of-sight coordinates: counterparts of figures 2 and 4 to 6 of Yin
et al. 2017 (figure 3 is `range` in approach_figures.py), and the funnels of prescribed performance
control.
"""

from __future__ import annotations

import numpy as np

from harness.figures.style import legend_above
from harness.mission.figure import AXES, Axes, Curve, Drawing, Figure, Level, Panel, degrees
from harness.results.result import Array, Result
from ssp.shared.paths_in_space import draw_paths

from ..shared.relative_motion import (
    ATTITUDE,
    REFERENCE,
    REFERENCE_ATTITUDE,
    SERVICER,
    TARGET,
    attitude_error,
    position_error,
    release_time,
)

QUATERNION = "Actual and desired attitude relative to N: vector part q1, q2, q3 of the quaternion"
LOS = ("guidance.los.elevation",)
"""Variable of the line-of-sight guidance alone; figures that need it are drawn for no other run."""
CHANNELS = (("range", "m"), ("elevation", "rad"), ("azimuth", "rad"))


def _trajectory(canvas: Axes, result: Result) -> None:
    path = result[SERVICER] - result[TARGET]
    paths = {"servicer": (path, "-"), "target": (np.zeros((1, 3)), "ko")}
    plane = draw_paths(canvas, paths, ("x_N [m]", "y_N [m]", "z_N [m]"), (0, 2))
    plane.plot(*path[0, ::2], "g^", label="start")
    plane.plot(*path[-1, ::2], "rs", label="end")
    legend_above(plane)


def _angle(name: str) -> Panel:
    actual, desired = (
        Curve(f"degrees(guidance.los.{name})", "actual"),
        Curve(f"degrees(guidance.los_ref.{name})", "desired", style="--"),
    )
    return Panel(f"{name} [deg]", (actual, desired))


def _desired_attitude(result: Result) -> Array:
    """Return the quaternion of the reference attitude (rows, 4), with the sign for which it is
    closer to the quaternion of the servicer.
    """
    actual, desired = result[ATTITUDE], result[REFERENCE_ATTITUDE]
    return np.asarray(
        desired * np.where(np.sum(actual * desired, axis=1, keepdims=True) < 0, -1.0, 1.0)
    )


def quaternion(k: int) -> Panel:
    """Return a panel with element k of the actual and of the desired quaternion."""
    needs = (ATTITUDE, REFERENCE_ATTITUDE)
    actual = Curve(f"{ATTITUDE}[{k + 1}]", "actual")
    desired = Curve(lambda r: _desired_attitude(r)[:, k], "desired", needs=needs, style="--")
    return Panel(f"{'xyz'[k - 1]} (q{k})", (actual, desired))


def _widest(alpha: Array) -> Array:
    return alpha if alpha.ndim == 1 else np.asarray(alpha.max(axis=1))


def _funnel(name: str, unit: str, z: str, alpha: str) -> Panel:
    """Return a panel with the variable `z` (generalised states) between plus and minus its bound,
    the variable `alpha`.
    """
    bounds = (
        Curve(alpha, "bound", _widest, style="k--"),
        Curve(alpha, "", lambda x: -_widest(x), style="k--"),
    )
    return Panel(f"{name}: z [{unit}]", (Curve(z, ""), *bounds))


FIGURES: tuple[Figure | Drawing, ...] = (
    Drawing(
        "trajectory",
        "Path of the servicer relative to the target, N axes",
        (SERVICER, TARGET, *LOS),
        _trajectory,
    ),
    Figure("line_of_sight", "Line of sight", (_angle("elevation"), _angle("azimuth"))),
    Figure(
        "acceleration",
        "Commanded acceleration along the line-of-sight axes",
        (
            Panel(
                "[m/s2]", (Curve("controller.a_cmd_L", labels=("range", "elevation", "azimuth")),)
            ),
        ),
    ),
    Figure("quaternion", QUATERNION, tuple(quaternion(k) for k in (1, 2, 3)), LOS),
    Figure(
        "los_error",
        "Errors in line-of-sight coordinates",
        (
            Panel("range [m]", (Curve("controller.error.range"),)),
            Panel("elevation [deg]", (Curve("degrees(controller.error.elevation)"),)),
            Panel("azimuth [deg]", (Curve("degrees(controller.error.azimuth)"),)),
            Panel(
                "attitude [deg]",
                (Curve(attitude_error, convert=degrees, needs=(ATTITUDE, REFERENCE_ATTITUDE)),),
                log=True,
            ),
        ),
    ),
    Figure(
        "tracking_error",
        "Distance from the reference position",
        (Panel("[m]", (Curve(position_error, needs=(SERVICER, TARGET, REFERENCE)),), log=True),),
        LOS,
    ),
    Figure(
        "torque",
        "Torque, body axes",
        (Panel("[N m]", (Curve("propulsion.M_S", labels=AXES),), idle_until=release_time),),
        LOS,
    ),
    Figure(
        "funnel",
        "Generalised states within their bounds",
        (
            *(
                _funnel(name, unit, f"controller.z.{name}", f"controller.alpha.{name}")
                for name, unit in CHANNELS
            ),
            _funnel("attitude", "1", "controller.z_att", "controller.alpha_att"),
            Panel(
                "kappa",
                (Curve("controller.kappa", "position"), Curve("controller.kappa_att", "attitude")),
                level=Level("bound", 1.0),
            ),
        ),
    ),
)
