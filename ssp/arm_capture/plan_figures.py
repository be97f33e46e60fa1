# SPDX-License-Identifier: BSD-2-Clause
"""Figures of the plan of a capture by arm: reach around the base in two planes, joint angles."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from harness.mission.figure import Axes, Colour, Curve, Figure, Overlay, Panel
from harness.results.result import Array, Result

from .figures import JOINTS
from .kinematics import Arm, arm_of, pose
from .plan import KNOWN, POSES, limits_of
from .reach import Reach, reach

PLACE, ANGLE = "plan.place", "plan.joint_angle"
CELL = 0.15
"""Edge of a cell of the map [m]."""


def map_around(result: Result, up: int) -> tuple[Array, Array, Reach]:
    """Return the edges of the cells of a map along x and along base axis `up` (1: y, 2: z) [m], and
    the reach of the arm with its end effector at the middle of each cell, one row per cell.

    The plane of the map contains the first planned position; the end effector points along x.
    """
    arm, place = arm_of(result), result[PLACE][0]
    far = float(np.linalg.norm([*arm.offset[1:], arm.tip], axis=1).sum()) + CELL
    shoulder = arm.offset[0]
    x = np.arange(shoulder[0] - far / 3, shoulder[0] + far, CELL)
    y = np.arange(shoulder[up] - far, shoulder[up] + far, CELL)
    places = np.tile(place, ((len(x) - 1) * (len(y) - 1), 1))
    across, along = np.meshgrid(*((e[:-1] + e[1:]) / 2 for e in (y, x)))
    places[:, 0], places[:, up] = along.ravel(), across.ravel()
    outward = np.tile([1.0, 0, 0], (len(places), 1))
    return x, y, reach(arm, limits_of(result), places, outward)


def _line(arm: Arm, q: Array, up: int) -> tuple[Array, Array]:
    """Return x and coordinate `up` [m] of the points of the arm at joint angles q: S, all joints,
    end effector E.
    """
    at = pose(arm, q[None, : len(arm.axis)])
    points = np.vstack([np.zeros(3), at.joint[0], at.tip])
    return points[:, 0], points[:, up]


def _reach(canvas: Axes, results: Mapping[str, Result], colours: Mapping[str, Colour]) -> None:
    """Draw a map of the least singular value of the Jacobian J_m in the cells that the arm
    reaches, the stowed arm, and for each result all planned positions of the end effector and the
    arm at the first one.
    """
    first = next(iter(results.values()))
    arm = arm_of(first)
    panels = canvas.subplots(1, 2)
    for axes, up, name in zip(panels, (1, 2), "yz", strict=True):
        x, y, found = map_around(first, up)
        values = np.where(found.reached, found.singular[:, -1], np.nan)
        shape = (len(x) - 1, len(y) - 1)
        drawn = axes.pcolormesh(x, y, values.reshape(shape).T, vmin=0, cmap="viridis", alpha=0.7)
        axes.plot(*_line(arm, first.parameter(POSES[3]), up), "0.5", lw=1.2, label="stowed")
        for label, result in results.items():
            axes.plot(*_line(arm, result[ANGLE][0], up), "k.-", lw=1.2, ms=3)
            path = result[PLACE]
            axes.plot(path[:, 0], path[:, up], "o", color=colours[label], label=label)
        axes.set(xlabel="x [m]", ylabel=f"{name} [m]", aspect="equal")
    panels[0].legend(loc="lower left")
    canvas.colorbar(drawn, ax=panels, label="least singular value of Jacobian J_m", shrink=0.8)


OVERLAYS: tuple[Figure | Overlay, ...] = (
    Overlay("planned_reach", "Reach of the arm around the base, X_E along x", (PLACE, ANGLE),
            _reach, (11, 5), KNOWN),
    Figure(
        "planned_joints",
        "Planned poses of the arm on the fixture, base at its reference position",
        (
            Panel("joint angle [deg]", (Curve(f"degrees({ANGLE})", labels=JOINTS),)),
            Panel("least singular value", (Curve("plan.singular"),)),
            Panel("manipulability", (Curve("plan.manipulability"),)),
        ),
    ),
)  # fmt: skip
