# SPDX-License-Identifier: BSD-2-Clause
"""Figures of the relay approach: counterparts of figures 6 to 9 of Kozlova & Fomichev 2023, and
figures of the engines and the phase planes of the relays.
"""

from __future__ import annotations

import numpy as np

from harness.figures.finish import ROUNDING
from harness.figures.style import legend_above
from harness.mission.figure import AXES, Axes, Curve, Drawing, Figure, Panel
from harness.results.result import Array, Result
from ssp.shared.paths_in_space import draw_paths

from ..shared.relative_motion import SERVICER, SPEED, TARGET, range_

PURSUIT = ("guidance.q_DS",)
"""Output of pursuit_guidance, by which results of the relay approach are recognised."""
HOLD = "guidance.zeta1"
"""Parameter with the range at which the servicer must stay [m]."""
IN_ORBIT = 1e6
"""Largest coordinate of the target in N [m] above which it is in orbit, so that paths are drawn
relative to the target.
"""
WINDOW = 5.0
"""Ratio of the largest drawn value on an axis of a phase plane to the value at which the outer
switching line crosses this axis.
"""


# ---- paths: figures 6 and 7


def _origin(result: Result) -> Array:
    """Return the origin of the drawn paths (rows, 3) [m]: the position of the target if it is in
    orbit, otherwise the origin of N.
    """
    target = result[TARGET]
    return target if np.abs(target).max() > IN_ORBIT else np.zeros_like(target)


def _servicer(result: Result) -> Array:
    return np.asarray(result[SERVICER] - _origin(result))


def _target(result: Result) -> Array:
    return np.asarray(result[TARGET] - _origin(result))


def _trajectory(canvas: Axes, result: Result) -> None:
    servicer, target = _servicer(result), _target(result)
    paths = {
        "servicer": (servicer, "-"),
        "target": (target if target.any() else target[:1], "--" if target.any() else "ko"),
    }
    plane = draw_paths(canvas, paths, ("x_N [m]", "y_N [m]", "z_N [m]"), (0, 1))
    points = {"start": 0, "end": len(servicer) - 1}
    hold = float(result.parameter(HOLD)) if result.holds(parameters=(HOLD,)) else 0.0
    near = np.flatnonzero(range_(result) <= hold)
    if len(near):
        points[f"{hold:g} m"] = int(near[0])
    for (label, row), style in zip(points.items(), ("g^", "rs", "ko"), strict=False):
        plane.plot(*servicer[row, :2], style, label=label)
    legend_above(plane)


def _coordinate(k: int) -> tuple[Curve, ...]:
    needs = (SERVICER, TARGET)
    return (
        Curve(lambda r: _servicer(r)[:, k], "servicer", needs=needs),
        Curve(lambda r: _target(r)[:, k], "target", needs=needs, style="--"),
    )


# ---- rotation: figures 8 and 9


def _rates(k: int) -> tuple[Curve, ...]:
    rate = "servicer.omega_SN_S"
    return (
        Curve(f"{rate}[{k + 1}] + controller.domega_S[{k + 1}]", "required"),
        Curve(f"{rate}[{k + 1}]", "actual"),
    )


# ---- engines


def _group(first: int, last: int, what: str, label: str) -> Curve:
    """Return the curve of the sum of a variable `propulsion.WHAT` over the thrusters
    `first` + 1 to `last`, numbered from 1.
    """
    engines = range(first + 1, last + 1)
    return Curve(" + ".join(f"propulsion.{what}[{k}]" for k in engines), label)


def _groups(what: str) -> tuple[Curve, ...]:
    return (
        _group(0, 8, what, "attitude"),
        _group(8, 12, what, "brakes"),
        _group(12, 13, what, "main engine"),
    )


# ---- phase planes of the relays

TRANSLATION = tuple(f"controller.{name}" for name in ("Kp_v", "Kd_v", "rho1", "rho2"))
ROTATION = tuple(f"controller.{name}" for name in ("Kp_w", "Kd_w", "xi1", "xi2"))


def _phase_planes(canvas: Axes, result: Result) -> None:
    """Draw phase planes of the speed error and of the rate errors e: derivative e' over e, with the
    lines Kp e + Kd e' = const at which the relays switch. Rows in which no translation is permitted
    have sigma_v = 0, so their points are on the line Kp e + Kd e' = 0 for any e'.
    """
    Kp, Kd, off, on = (result.parameter(name) for name in TRANSLATION)
    error, sigma = result["controller.e_v"], result["controller.sigma_v"]
    _phase_plane(
        canvas.add_subplot(2, 2, 1),
        error,
        sigma,
        (Kp, Kd, off, on),
        ("speed error along X [m/s]", "m/s2"),
    )
    Kp, Kd, off, on = (result.parameter(name) for name in ROTATION)
    errors, sigmas = result["controller.domega_S"], result["controller.sigma_w"]
    turning = np.abs(errors).max(axis=0) > ROUNDING * np.abs(errors).max()
    for place, k in enumerate(np.flatnonzero(turning), start=2):
        axis, axes = AXES[k], canvas.add_subplot(2, 2, place)
        gains = (Kp[k], Kd[k], off[k], on[k])
        _phase_plane(
            axes, errors[:, k], sigmas[:, k], gains, (f"rate error about {axis} [rad/s]", "rad/s2")
        )


def _phase_plane(
    axes: Axes, error: Array, sigma: Array, gains: tuple[Array, ...], names: tuple[str, str]
) -> None:
    """Draw the derivative of an error over the error, and the switching lines of its relay.

    sigma: Kp e + Kd e'; gains: Kp, Kd, and the levels of sigma at which the relay switches off and
    on; names: label of the error, unit of its derivative. With Kd = 0 the derivative is unknown and
    drawn as 0.
    """
    Kp, Kd, off, on = (float(gain) for gain in gains)
    x, y = (WINDOW * on / gain if gain else 1.0 for gain in (Kp, Kd))
    axes.plot(error, (sigma - Kp * error) / Kd if Kd else 0 * error, ".", markersize=1, color="C0")
    ends = np.array([-x, x])
    for level, style in ((on, "-"), (-on, "-"), (off, "--"), (-off, "--")):
        if Kd:
            axes.plot(ends, (level - Kp * ends) / Kd, style, color="C3", linewidth=1)
        elif Kp:
            axes.axvline(level / Kp, linestyle=style, color="C3", linewidth=1)
    axes.set(xlim=(-x, x), ylim=(-y, y), xlabel=names[0], ylabel=f"its derivative [{names[1]}]")


FIGURES: tuple[Figure | Drawing, ...] = (
    Drawing(
        "trajectory", "Paths of servicer and target", (SERVICER, TARGET, *PURSUIT), _trajectory
    ),
    Figure(
        "coordinates",
        "Coordinates",
        tuple(Panel(f"{a} [m]", _coordinate(k)) for k, a in enumerate(AXES)),
        PURSUIT,
    ),
    Figure(
        "rates",
        "Required and actual angular velocity, body axes",
        tuple(Panel(f"{a} [rad/s]", _rates(k)) for k, a in enumerate(AXES)),
        PURSUIT,
    ),
    Figure(
        "transition",
        "Transition quaternion to the required attitude (L0: scalar part)",
        (Panel("element", (Curve("guidance.q_DS", labels=("L0", "L1", "L2", "L3")),)),),
    ),
    Figure(
        "speeds",
        "Speed relative to the target, and required speed",
        (
            Panel(
                "actual [m/s]",
                (Curve(SPEED),),
            ),
            Panel("required [m/s]", (Curve("guidance.v_req"),)),
        ),
    ),
    Figure(
        "engines",
        "Engines",
        (
            Panel("thrust [N]", _groups("thrust")[1:]),
            Panel("cumulative impulse [N s]", _groups("impulse")),
            Panel("number of ignitions", _groups("switches")),
        ),
        PURSUIT,
    ),
    Drawing(
        "phase_planes",
        "Relays: error, its derivative, switching lines (solid: on, dashed: off)",
        ("controller.e_v", "controller.sigma_v", "controller.domega_S", "controller.sigma_w"),
        _phase_planes,
        (11, 9),
        TRANSLATION + ROTATION,
    ),
)
