# SPDX-License-Identifier: BSD-2-Clause
"""Figures of the transposition of a docked assembly: plan, momentum of the gyros and saturation,
attitude, tracking, gimbals, the two bodies in space; and figures of several runs together.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from harness.figures.style import MANY, legend_above, time_axis
from harness.mission.figure import (
    Axes,
    Curve,
    Drawing,
    Figure,
    Level,
    Overlay,
    Panel,
    degrees,
)
from harness.results.result import Array, Result

from .metrics import attitude_error as tracking_error

MOMENTUM, SHARE, ATTITUDE, EPS = (
    "assembly.h_cmg_S",
    "assembly.momentum_share",
    "assembly.q_SH",
    "assembly.eps",
)
ARM, ROTATION, REFERENCE, PREDICTED = (
    "assembly.arm_angle",
    "assembly.rotation",
    "guidance.q_DH",
    "guidance.h_ref_D",
)
ITERATIONS, SATURATION, MARGIN = (
    "guidance.iterations",
    "guidance.H_sat",
    "guidance.momentum_share",
)
GIMBALS = tuple(f"gyro {k}" for k in range(1, 7))
EDGES = np.array([[a, b] for a in range(8) for b in range(a) if (a ^ b) in (1, 2, 4)])
"""Pairs of corners of a box that are the ends of an edge. Bit i of the number of a corner states on
which side of the box it is along axis i.
"""
FORM = ("hinge", "module", "box_0", "box_1")
PANELS = ("panel_area", "panel_body", "panel_position", "panel_normal")
SHAPE = tuple(f"assembly.{name}" for name in (*FORM, *PANELS))
FLIGHT = np.array([[0.0, 0, -1], [1, 0, 0], [0, -1, 0]])
"""Matrix whose rows are the axes x, y, z of H in axes of the flight attitude, which has x along the
motion and z towards the planet.
"""
SNAPSHOTS = 6


def _rotations(q: Array) -> Array:
    """Return the matrices (rows, 3, 3) that convert vectors from body axes to the axes relative to
    which the quaternions q (rows, 4) describe the body.
    """
    w, v = q[:, :1, None], q[:, 1:]
    skew = np.cross(np.eye(3), v[:, None, :])
    return np.asarray(np.eye(3) + 2 * w * skew + 2 * skew @ skew)


def _box(edges: Array) -> Array:
    """Return the 12 edges of a box about the origin as line segments (12, 2, 3); edges: lengths."""
    corners = np.array([[(k >> axis & 1) - 0.5 for axis in range(3)] for k in range(8)]) * edges
    return np.asarray(corners[EDGES])


def _panel(area: float, position: Array, normal: Array) -> Array:
    """Return the outline of a square panel as line segments (4, 2, 3), from its area, centre and
    unit normal.
    """
    along = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    along /= np.linalg.norm(along)
    across = np.cross(normal, along)
    corners = [along + across, across - along, -along - across, along - across]
    outline = position + np.sqrt(area) / 2 * np.array(corners)
    return np.stack((outline, np.roll(outline, -1, axis=0)), axis=1)


def _body(result: Result, body: int) -> Array:
    """Return the line segments (n, 2, 3) of the base (body 0) or the module (body 1) with its
    panels, in its own axes from its own centre.
    """
    panels = zip(*(result.parameter(f"assembly.{name}") for name in PANELS), strict=True)
    outlines = [
        _panel(area, place, normal)
        for area, carrier, place, normal in panels
        if area > 0 and carrier == body
    ]
    return np.concatenate((_box(result.parameter(f"assembly.box_{body}")), *outlines))


def _placed(result: Result) -> Iterator[tuple[float, Array, Array]]:
    """Yield time [s] and the line segments of base and module in axes of the flight attitude, at
    SNAPSHOTS instants from start to end.
    """
    rows = np.linspace(0, len(result.time) - 1, SNAPSHOTS).round().astype(int)
    base, module = _body(result, 0), _body(result, 1)
    hinge, centre = result.parameter("assembly.hinge"), result.parameter("assembly.module")
    turns = _rotations(result[ATTITUDE][rows])
    for row, turn in zip(rows, turns, strict=True):
        c, s = np.cos(result[ARM][row]), np.sin(result[ARM][row])
        swing = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        to_flight = (FLIGHT.T @ turn).T
        yield (
            float(result.time[row]),
            base @ to_flight,
            (hinge + (centre + module) @ swing.T) @ to_flight,
        )


def _bodies(canvas: Axes, result: Result) -> None:
    """Draw base and module at several times, with the planet below and the orbital motion to the
    right.
    """
    from mpl_toolkits.mplot3d.art3d import Line3DCollection  # type: ignore[import-untyped]

    shown = list(_placed(result))
    ends = np.concatenate([part.reshape(-1, 3) for _, *parts in shown for part in parts])
    low, high = ends.min(axis=0), ends.max(axis=0)
    for k, (time, *parts) in enumerate(shown, start=1):
        axes = canvas.add_subplot(2, SNAPSHOTS // 2, k, projection="3d")
        for part, colour, label in zip(parts, ("C0", "C1"), ("base", "module"), strict=True):
            axes.add_collection3d(
                Line3DCollection(part, colors=colour, linewidths=0.9, label=label)
            )
        axes.set(
            xlim=(low[0], high[0]),
            ylim=(high[1], low[1]),
            zlim=(high[2], low[2]),
            title=f"{time:.0f} s",
            xlabel="flight [m]",
            ylabel="- normal [m]",
            zlabel="nadir [m]",
        )
        axes.set_box_aspect(high - low, zoom=0.85)
        axes.locator_params(nbins=3)
        axes.tick_params(pad=-2)
        for axis in (axes.xaxis, axes.yaxis, axes.zaxis):
            axis.labelpad = -3
        axes.view_init(elev=25, azim=-60)
    axes.legend()


# ---- plans, and the lists of all figures


def _length(name: str) -> Curve:
    return Curve(f"norm({name})")


def _iterations(canvas: Axes, result: Result) -> None:
    """Draw the largest momentum and the largest rotation of every attitude history that the planner
    tried, over the number of iterations after which the planner had this history.
    """
    count = int(result[ITERATIONS][0]) + 1
    left, right = canvas.add_subplot(1, 2, 1), canvas.add_subplot(1, 2, 2)
    left.bar(range(count), result["guidance.peak"][0, :count])
    limits = {"saturation": 1.0, "limit of the plan": float(result.parameter(MARGIN))}
    for (label, share), style in zip(limits.items(), ("-", "--"), strict=True):
        level = float(share * result.parameter(SATURATION))
        left.axhline(level, color="k", linestyle=style, linewidth=1, label=label)
    left.set(xlabel="iterations of the planner", ylabel="largest momentum [N m s]")
    legend_above(left)
    right.bar(range(count), np.degrees(result["guidance.rotation"][0, :count]))
    right.set(xlabel="iterations of the planner", ylabel="largest rotation [deg]")
    for axes in (left, right):
        axes.set_xticks(range(count))


def _planned_momentum(
    canvas: Axes, results: Mapping[str, Result], colours: Mapping[str, str]
) -> None:
    """Draw the predicted momentum, with the level of saturation, and the rotation of the reference
    over time, with a line for each plan; results: by label of the plan.
    """
    momentum, rotation = canvas.subplots(2, 1, sharex=True)
    clock = time_axis(*(r.time for r in results.values()))
    for label, result in results.items():
        time = result.time / clock.seconds
        size = np.linalg.norm(result["guidance.h_ref_D"], axis=1)
        momentum.plot(time, size, color=colours[label], label=label)
        rotation.plot(time, np.degrees(result["guidance.rotation_ref"]), color=colours[label])
    saturation = float(next(iter(results.values())).parameter("guidance.H_sat"))
    level = momentum.axhline(saturation, color="k", linewidth=1, label="saturation")
    momentum.set(ylabel="momentum [N m s]")
    legend_above(momentum, None if len(results) < MANY else [level])
    rotation.set(xlabel=clock.label, ylabel="rotation [deg]")


FIGURES: tuple[Figure | Drawing, ...] = (
    Drawing(
        "plan",
        "Attitude history after each iteration of the planner; 0: constant flight attitude",
        (ITERATIONS, "guidance.peak", "guidance.rotation"),
        _iterations,
        shows=lambda result: bool(result["guidance.peak"].any()),
        parameters=(SATURATION, MARGIN),
    ),
    Figure(
        "momentum",
        "Momentum of the gyros",
        (
            Panel("S axes [N m s]", (Curve(MOMENTUM),)),
            Panel(
                "magnitude [N m s]",
                (
                    Curve(f"norm({MOMENTUM})", "simulated"),
                    Curve(f"norm({PREDICTED})", "predicted", style="--"),
                ),
            ),
            Panel("share of saturation", (Curve(SHARE),), level=Level("saturation", 1.0)),
        ),
    ),
    Figure(
        "assembly_attitude",
        "Attitude relative to the flight attitude, and the arm",
        (
            Panel("quaternion, vector part", (Curve(EPS),)),
            Panel("rotation [deg]", (Curve(f"degrees({ROTATION})"),)),
            Panel("arm [deg]", (Curve(f"degrees({ARM})"),)),
        ),
    ),
    Figure(
        "assembly_tracking",
        "Tracking of the planned attitude",
        (
            Panel(
                "error [deg]",
                (Curve(tracking_error, convert=degrees, needs=(ATTITUDE, REFERENCE)),),
                log=True,
            ),
            Panel("commanded rate of momentum [N m]", (Curve("controller.hdot_cmd_S"),)),
        ),
    ),
    Figure(
        "gimbals",
        "Control moment gyros",
        (
            Panel("angle [deg]", (Curve("degrees(assembly.gimbal_angle)", labels=GIMBALS),)),
            Panel("rate [deg/s]", (Curve("degrees(assembly.gimbal_rate)", labels=GIMBALS),)),
            Panel("sqrt(det A A'), 0: singular", (Curve("assembly.singularity"),)),
        ),
    ),
    Figure(
        "assembly_torques",
        "Torques of the environment, S axes",
        (
            Panel("gravity gradient [N m]", (Curve("assembly.M_gravity_S"),)),
            Panel("atmosphere [N m]", (Curve("assembly.M_aero_S"),)),
        ),
    ),
    Drawing(
        "bodies",
        "Base and module, axes of flight",
        (ATTITUDE, ARM),
        _bodies,
        (11, 7),
        SHAPE,
    ),
)
OVERLAYS: tuple[Figure | Overlay, ...] = (
    Overlay(
        "planned_momentum",
        "Predicted momentum and rotation of the reference",
        ("guidance.h_ref_D", "guidance.rotation_ref"),
        _planned_momentum,
        size=(9, 7),
        parameters=("guidance.H_sat",),
    ),
    Figure(
        "compared_momentum",
        "Momentum of the gyros, rotation and tracking",
        (
            Panel("momentum [N m s]", (_length(MOMENTUM),)),
            Panel("share of saturation", (Curve(SHARE),), level=Level("saturation", 1.0)),
            Panel("rotation [deg]", (Curve(f"degrees({ROTATION})"),)),
            Panel(
                "tracking error [deg]",
                (Curve(tracking_error, convert=degrees, needs=(ATTITUDE, REFERENCE)),),
                log=True,
            ),
        ),
    ),
)
