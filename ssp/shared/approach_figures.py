# SPDX-License-Identifier: BSD-2-Clause
"""Figures of every approach, with any guidance and controller, and figures of the estimates by
adaptive control. Some are the counterparts of figures 5, 6 and 8 to 11 of Zhu & Yang 2009.
"""

from __future__ import annotations

import numpy as np

from harness.figures.style import time_axis
from harness.mission import Phase
from harness.mission.figure import (
    AXES,
    Axes,
    Curve,
    Drawing,
    Figure,
    Level,
    Panel,
    degrees,
)
from harness.results.result import Array, Result

from .relative_motion import (
    ATTITUDE,
    DISTANCE,
    FORCE_H,
    REFERENCE_ATTITUDE,
    SERVICER,
    TARGET,
    VELOCITIES,
    attitude_error,
    attitude_error_vector,
    force_H,
    release_time,
)

ETA = "controller.eta_hat"
"""Output of estimated inertias: elements 11, 12, 13, 22, 23, 33 of the body, then of the wheels."""
MAIN, OFF = (0, 3, 5), (1, 2, 4)
"""Indices of the diagonal elements, and of the other elements, among 11, 12, 13, 22, 23, 33."""
BODY, WHEELS = "servicer.J_S", "servicer.A_w"
FINAL_RANGE = Level("to be held:", ("guidance.rho_M", "guidance.zeta1", "guidance.rho_f"))
TURNED = (ATTITUDE, REFERENCE_ATTITUDE)
PURSUIT = "guidance.q_DS"
"""Output of pursuit_guidance. A result that contains this output is from a system with the
thrusters of Kozlova & Fomichev.
"""
DIRECTION = "propulsion.thruster_direction"
ENGINES = (*(f"P{i}" for i in range(1, 9)), *(f"P'{i}" for i in range(1, 6)))
"""Names of the thrusters in Kozlova & Fomichev 2023: attitude P1 to P8, brakes P'1 to P'4, main
engine P'5.
"""
COLUMNS = 1500
"""Largest number of columns of the firing chart. If there are more rows, each column shows the
largest thrust of several rows.
"""


def _inertias(what: str, first: int, elements: tuple[int, ...], parameter: str) -> Panel:
    """Return a panel titled `what` with estimated inertia elements and, dashed, their true values.

    first: index in ETA of the first of the six elements of the body or of the wheels; elements:
    indices, among these six, of the elements to show; parameter: matrix of the true values.
    """
    places = [f"{i}{j}" for i in (1, 2, 3) for j in range(i, 4)]
    estimates = [Curve(f"{ETA}[{first + k + 1}]", places[k]) for k in elements]
    values = [
        Curve(f"parameter({parameter}[{','.join(places[k])}])", "" if n else "true", style="--",
              anew=not n, parameters=(parameter,))
        for n, k in enumerate(elements)
    ]  # fmt: skip
    return Panel(f"{what} [kg m2]", (*estimates, *values), after=release_time)


def _firing_chart(canvas: Axes, result: Result) -> None:
    """Draw the thrust of every thruster that fires over time, as share of its largest thrust."""
    thrust = result["propulsion.thrust"]
    exist = np.flatnonzero(thrust.any(axis=0))
    names = [_engine(result, int(i)) for i in exist]
    axes, clock = canvas.add_subplot(), time_axis(result.time)
    if len(exist):
        part = thrust[:, exist] / thrust[:, exist].max(axis=0)
        begin, end = result.time[[0, -1]] / clock.seconds
        span = (begin, end, len(exist) - 0.5, -0.5)
        image = axes.imshow(
            _thinned(part).T,
            aspect="auto",
            extent=span,
            cmap="Greys",
            vmin=0,
            vmax=1,
            interpolation="none",
        )
        canvas.colorbar(image, label="part of the largest thrust")
    axes.set_yticks(range(len(exist)), names)
    axes.set(xlabel=clock.label, ylabel="thruster")
    axes.grid(False)


def _engine(result: Result, i: int) -> str:
    """Return the label of the thruster with index i: its name in Kozlova & Fomichev 2023, or in
    other systems its number and, if its force is along a body axis, the direction of the force.
    """
    if PURSUIT in result:
        return ENGINES[i] if i < len(ENGINES) else str(i + 1)
    if not result.holds(parameters=(DIRECTION,)):
        return str(i + 1)
    direction = result.parameter(DIRECTION)[i]
    axis = int(np.argmax(np.abs(direction)))
    along = np.count_nonzero(direction) == 1
    return f"{i + 1} ({'-' if direction[axis] < 0 else '+'}{AXES[axis]})" if along else str(i + 1)


def _thinned(rows: Array) -> Array:
    """Return rows (n, elements) reduced to at most COLUMNS rows. Each new row contains the largest
    values of the successive rows that it replaces.
    """
    starts = np.unique(
        np.linspace(0, len(rows), min(len(rows), COLUMNS), endpoint=False).astype(int)
    )
    return np.asarray(np.maximum.reduceat(rows, starts, axis=0))


RANGE = Figure(
    "range",
    "Range",
    (Panel("range [m]", (Curve("guidance.range", "range"),), level=FINAL_RANGE, least=True),),
)
FORCE = Figure(
    "force",
    "Control force",
    (
        Panel("force, Hill axes [N]", (Curve(force_H, needs=FORCE_H),)),
        Panel("force, servicer axes [N]", (Curve("propulsion.F_S"),)),
    ),
)
ESTIMATED_MASS = Figure(
    "estimated_mass",
    "Estimated and true mass",
    (
        Panel(
            "mass [kg]",
            (Curve("controller.m_hat", "estimate"), Curve("servicer.mass", "true", style="--")),
        ),
    ),
)
ATTITUDE_ERROR = Figure(
    "attitude_error",
    "Attitude error",
    (
        Panel(
            "MRP of S relative to D",
            (Curve(attitude_error_vector, needs=TURNED, jump=1.0),),
            after=release_time,
        ),
        Panel(
            "angle [deg]",
            (Curve(attitude_error, convert=degrees, needs=TURNED),),
            after=release_time,
            log=True,
        ),
    ),
)
WHEEL_SPEEDS = Figure(
    "wheel_speeds",
    "Wheel speeds",
    (
        Panel(
            "wheel speed, servicer axes [rad/s]",
            (Curve("servicer.wheel_speed"),),
            after=release_time,
        ),
    ),
    ("guidance.rho_H",),
)
INERTIA_ESTIMATES = Figure(
    "inertia_estimates",
    "Estimated inertias, true ones dashed",
    (
        _inertias("body, diagonal", 0, MAIN, BODY),
        _inertias("body, products", 0, OFF, BODY),
        _inertias("wheels, diagonal", 6, MAIN, WHEELS),
        _inertias("wheels, products", 6, OFF, WHEELS),
    ),
    (ETA,),
)
ALIGNMENT = Figure(
    "alignment",
    "Alignment",
    (
        Panel(
            "angle [deg]",
            (
                Curve("degrees(guidance.beta_t)", "grasp axis to relative position"),
                Curve("degrees(guidance.beta_p)", "arm to direction of target"),
            ),
        ),
    ),
)
FIRING = Drawing("firing", "Thruster firings", ("propulsion.thrust",), _firing_chart)
ADAPTIVE = (ESTIMATED_MASS, INERTIA_ESTIMATES)


# ---- phase plots


RANGE_RATE = "total(({} - {}) * ({} - {})) / {}".format(SERVICER, TARGET, *VELOCITIES, DISTANCE)
PHASES = (
    Phase(
        "Range",
        "range [m]",
        "its rate [m/s]",
        (SERVICER, TARGET, *VELOCITIES),
        DISTANCE,
        RANGE_RATE,
    ),
    Phase(
        "Attitude error",
        "MRP of S relative to D",
        "rate error [deg/s]",
        ("controller.epsilon", "controller.domega_S"),
        "controller.epsilon",
        "degrees(controller.domega_S)",
        after=release_time,
    ),
)
