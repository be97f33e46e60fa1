# SPDX-License-Identifier: BSD-2-Clause
"""Figures of a mission: range and phases, the final approach in the corridor, contact and loads,
wheels and rates.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.figures.style import legend_above, time_axis
from harness.mission.figure import Axes, Curve, Drawing, Figure, Panel
from harness.results.histories import turned
from harness.results.result import Array, Result

from ..shared.relative_motion import SERVICER, TARGET, range_
from . import escapes
from .events import ISP, NEEDS, PHASE, increments, stays

HALF_ANGLE = "monitor.corridor_half_angle"
IN_TARGET = (SERVICER, TARGET, "target.q_TN")
LOADS = ("mechanism.normal_force", "mechanism.load_force", "mechanism.load_moment")
WHEELS, RATE, MOMENTUM = "servicer.wheel_speed", "servicer.omega_SN_S", "stack_guidance.momentum_S"
CLOSE = 25.0
"""Range that the figure of the final approach shows [m]."""
FAR_OFF, FANS, DRAWN = 60.0, 7, 12
"""Range that the figure of escapes shows [m], number of positions on the path at which it shows an
abort, number of drifts with random errors for each of these positions.
"""


def in_target_axes(result: Result) -> Array:
    """Return the position of the servicer relative to the target, target axes, (rows, 3) [m]."""
    rho = result[SERVICER] - result[TARGET]
    return turned(result["target.q_TN"] * (1, -1, -1, -1), rho)  # conjugated: from N to T


def _mission(canvas: Axes, result: Result) -> None:
    """Draw range and velocity increments over time, with the phases as named bands."""
    top, bottom = canvas.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    clock = time_axis(result.time)
    t = result.time / clock.seconds
    top.semilogy(t, range_(result))
    top.set_ylabel("range [m]")
    bottom.plot(t, increments(result))
    bottom.set(ylabel="increments [m/s]", xlabel=clock.label)
    for k, stay in enumerate(stays(result)):
        begin, end = stay.begin / clock.seconds, stay.end / clock.seconds
        for axes in (top, bottom) if k % 2 else ():
            axes.axvspan(begin, end, color="0.5", alpha=0.12, lw=0)
        if end - begin > 0.02 * t[-1]:
            top.text((begin + end) / 2, 0.98, stay.phase, transform=top.get_xaxis_transform(),
                     rotation=90, ha="center", va="top", fontsize=7)  # fmt: skip


def _in_final_approach(result: Result) -> Any:
    """Return a mask (rows,) of the rows within CLOSE of the target in the phases from "fly-around"
    to the one before "retreat" in the list of phases, thus with capture and stack.
    """
    first, last = map(result.mode_names(PHASE).index, ("fly-around", "retreat"))
    phase = result[PHASE]
    return (phase >= first) & (phase < last) & (range_(result) < CLOSE)


def _corridor(canvas: Axes, result: Result) -> None:
    """Draw the distance off the grasp axis over the distance along the axis, from the fly-around
    on, together with the corridor cone of the monitor.
    """
    p = in_target_axes(result)
    axis = np.asarray(result.parameter("guidance.p_T"))
    along, phase, near = p @ axis, result[PHASE], _in_final_approach(result)
    off = np.linalg.norm(p - along[:, None] * axis, axis=1)
    axes = canvas.add_subplot()
    for number in np.unique(phase[near]):
        shown = near & (phase == number)
        axes.plot(np.where(shown, along, np.nan), off, label=result.mode(PHASE, number))
    cone = np.array([0, CLOSE])
    axes.plot(cone, cone * np.tan(float(result.parameter(HALF_ANGLE))), "k--", lw=0.8)
    axes.set(xlabel="along the grasp axis [m]", ylabel="off the axis [m]")
    axes.set(xlim=(-CLOSE, CLOSE), ylim=(0, CLOSE))
    legend_above(axes)


def _escapes(canvas: Axes, result: Result) -> None:
    """Draw the path before the fly-around in the plane of the orbit, the circle with the radius
    escape_radius, and, for an abort at each of FANS positions of the path, DRAWN drifts with drawn
    errors and circles about the drift without errors. The radius of a circle is the largest
    displacement towards the target by errors within their bounds, not in every direction.
    """
    axes = canvas.add_subplot()
    rho, drho, rate = escapes.hill_states(result)
    shown = _closing(result)
    axes.plot(*rho[shown][:, [1, 0]].T, "k", lw=1.2)
    tau = np.arange(0, float(result.parameter("monitor.escape_time")) + 1, 20)
    rng, rows = np.random.default_rng(0), np.flatnonzero(shown)
    places = np.linspace(0, len(rows) - 1, FANS).astype(int)
    for k in rows[places]:
        e = escapes.escape(result, rho[k], drho[k], float(rate[k]))
        path, h = escapes.support(result, e, tau)
        near = np.linalg.norm(path, axis=1) < FAR_OFF
        for at, radius in zip(path[near][::2], h[near][::2], strict=True):
            axes.add_patch(_circle(axes, at[[1, 0]], radius, color="C0", alpha=0.05, lw=0))
        fan = escapes.drift(e.n, *escapes.drawn(result, e, DRAWN, rng), tau)
        axes.plot(fan[..., 1], fan[..., 0], color="C0", lw=0.4, alpha=0.6)
        axes.plot(*rho[k, [1, 0]], "k.")
    zone = float(np.asarray(result.parameter("monitor.escape_radius"))[0])
    axes.add_patch(_circle(axes, (0, 0), zone, color="C3", alpha=0.25, lw=0))
    axes.set(xlabel="along the track [m]", ylabel="radial [m]", aspect="equal")
    axes.set(xlim=(-FAR_OFF, FAR_OFF / 3), ylim=(-FAR_OFF / 2, FAR_OFF / 3))


def _closing(result: Result) -> Array:
    """Return for each row whether it is before the fly-around and within FAR_OFF of the target."""
    return np.asarray(
        (result[PHASE] < result.mode_names(PHASE).index("fly-around")) & (range_(result) < FAR_OFF)
    )


def _circle(axes: Axes, centre: Array | tuple[float, float], radius: float, **style: object) -> Any:
    from matplotlib.patches import Circle

    return Circle(tuple(centre), radius, transform=axes.transData, **style)


FIGURES: tuple[Figure | Drawing, ...] = (
    Drawing("mission", "Range and phases", NEEDS, _mission, (11, 6), (ISP,)),
    Drawing(
        "corridor",
        "Fly-around and final approach in target axes",
        (*IN_TARGET, "manager.phase"),
        _corridor,
        (11, 6),
        ("guidance.p_T", HALF_ANGLE),
        lambda result: bool(_in_final_approach(result).any()),
    ),
    Drawing(
        "escapes",
        "Drifts for the time escape_time after an abort, in the plane of the orbit",
        (*escapes.STATES, PHASE),
        _escapes,
        (11, 8),
        escapes.PARAMETERS,
        lambda result: bool(_closing(result).any()),
    ),
    Figure(
        "contact",
        "Contact and loads",
        (
            Panel("normal force [N]", (Curve(LOADS[0], ""),)),
            Panel("load [N]", (Curve(LOADS[1], ""),)),
            Panel("couple [N m]", (Curve(LOADS[2], ""),)),
            Panel("off the axis of the drogue [m]", (Curve("mechanism.offset", ""),), log=True),
        ),
    ),
    Figure(
        "momentum",
        "Wheels, rate and momentum",
        (
            Panel("wheel speed [rad/s]", (Curve(WHEELS),)),
            Panel("rate of the servicer [rad/s]", (Curve(RATE),)),
            Panel("momentum of the stack [N m s]", (Curve(MOMENTUM),)),
        ),
        ("manager.phase",),
    ),
)
