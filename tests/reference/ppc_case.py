# SPDX-License-Identifier: BSD-2-Clause
"""The scenario of ssp/ppc_tracking/system.toml, and its closed loop with a zero-order hold as one
program.

Force and torque are held in servicer axes over one sample. Row k of a history holds the plant
states at t_k and what the software computed at t_k-1; row 0 holds the laws at the initial states.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from math import cos, pi, radians, sin, sqrt
from typing import Any

import numpy as np

from . import adaptive, attitude, los, ppc, servicer, target, theta_d
from .attitude import Array
from .body import Body
from .closed_loop import History, Recorder
from .orbit import hill_frame, state_of_elements
from .sinusoid import Sinusoid

STEP, STOP = 0.05, 120.0
J_T = ((100.0, 0.0, 0.0), (0.0, 150.0, 0.0), (0.0, 0.0, 90.0))
ORBIT: dict[str, Any] = {
    "mu": 3.986004418e14,
    "R_E": 6378137.0,
    "J2": 1.08262668e-3,
    "a": 7158140.0,
    "e": 0.01,
    "inc": radians(30.0),
    "argp": radians(60.0),
    "raan": radians(120.0),
    "nu": radians(30.0),
    "max_step": STEP,
}
GUIDANCE = los.Guidance()


# ---- start states, from the geometry that the specification gives ----


def target_attitude() -> Array:
    """C_TN: x_b against the line of sight (10, 20) deg, z_b = cos 25 y_l + sin 25 z_l."""
    x_l, y_l, z_l = los.triad(radians(10.0), radians(20.0))
    x_b, z_b = -x_l, cos(radians(25.0)) * y_l + sin(radians(25.0)) * z_l
    return np.array((x_b, attitude.cross(z_b, x_b), z_b))


def start_in_hill_frame() -> tuple[Array, Array]:
    """rho_0_H and drho_0_H of range 300 m, elevation 2 deg, azimuth 32 deg, closing at 10 m/s as
    seen in N.
    """
    r, v = los.inertial(np.array((300.0, radians(2.0), radians(32.0))), np.array((-10.0, 0.0, 0.0)))
    orbit = {name: ORBIT[name] for name in ("mu", "a", "e", "inc", "argp", "raan", "nu")}
    C_HN = hill_frame(*state_of_elements(**orbit), ORBIT["mu"])
    return C_HN.x @ -r, C_HN.x @ -v + C_HN.d @ -r


def start_attitude(T: Body, S: Body) -> Array:
    """q_SN: 60 deg off the desired attitude about [1, -1, 1]."""
    q_DN = los.guide(T, S, np.zeros(3), GUIDANCE)[0]["q_DN"]
    axis = np.array((1.0, -1.0, 1.0)) / sqrt(3.0)
    return attitude.multiply(q_DN, np.array((cos(pi / 6), *(sin(pi / 6) * axis))))


def _plants() -> tuple[target.Parameters, servicer.Parameters]:
    sigma_TN = attitude.mrp_of_quaternion(attitude.quaternion_of_dcm(target_attitude()))
    T = target.Parameters(
        **ORBIT, J_T=J_T, sigma_TN_0=tuple(sigma_TN), omega_TN_T_0=(0.0, 0.0, radians(1.0))
    )
    rho, drho = start_in_hill_frame()
    S = servicer.Parameters(
        **ORBIT,
        rho_0_H=tuple(rho),
        drho_0_H=tuple(drho),
        mass_0=100.0,
        J_S=((50.0, 0.0, 0.0), (0.0, 45.0, 0.0), (0.0, 0.0, 60.0)),
        A_w=((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
        omega_SN_S_0=(0.02, -0.02, 0.02),
    )
    q_SN = start_attitude(
        target.body(target.initial_state(T)), servicer.body(servicer.initial_state(S))
    )
    return T, replace(S, sigma_SN_0=tuple(attitude.mrp_of_quaternion(q_SN)))


TARGET, SERVICER = _plants()


# ---- scenarios ----


@dataclass(frozen=True)
class Scenario:
    target: target.Parameters = TARGET
    servicer: servicer.Parameters = SERVICER
    guidance: los.Guidance = GUIDANCE
    period: float = STEP


NOMINAL = Scenario()
MANOEUVRE = Scenario(
    replace(
        TARGET,
        a_manoeuvre_N=Sinusoid(
            bias=(0.25, 0.15, -0.20),
            amplitude=(0.10, 0.08, 0.10),
            frequency=(0.2, 0.15, 0.25),
            phase=(0.0, pi / 2, 0.0),
        ),
    ),
    replace(
        SERVICER,
        mass_0=130.0,
        J_S=((45.0, 0.0, 0.0), (0.0, 48.0, 0.0), (0.0, 0.0, 67.0)),
        a_dist=Sinusoid(amplitude=(1e-3, -1e-3, 1e-3), frequency=(0.05,) * 3),
        M_dist_S=Sinusoid(amplitude=(1e-2, -1e-2, 1e-2), frequency=(0.05,) * 3),
    ),
)
LITERAL_LAW = ppc.Ppc(
    law=0.0,
    range=ppc.Channel(140.0, 0.15, 4.3, 640.0, 2.0, 0.2),
    elevation=ppc.Channel(0.06, 0.13, 3.0, 1.25, 0.03, 0.2),
    azimuth=ppc.Channel(0.06, 0.13, 3.0, 1.25, 0.03, 0.2),
)


# ---- controllers as functions of (t, T, S, wheel_speed, reference) that have their own state ----

Law = Callable[[float, Body, Body, Array, Mapping[str, Any]], dict[str, Any]]


def ppc_law(p: ppc.Ppc) -> Law:
    x: ppc.PpcState = (None, None)

    def law(
        t: float, T: Body, S: Body, wheel_speed: Array, ref: Mapping[str, Any]
    ) -> dict[str, Any]:
        nonlocal x
        outputs, x = ppc.ppc(t, T, S, ref, x, p)
        return outputs

    return law


def pid_law(p: ppc.Pid, period: float) -> Law:
    x: ppc.PidState = (np.zeros(3), np.zeros(3))

    def law(
        t: float, T: Body, S: Body, wheel_speed: Array, ref: Mapping[str, Any]
    ) -> dict[str, Any]:
        nonlocal x
        outputs, x = ppc.pid(t, T, S, ref, x, p, period)
        return outputs

    return law


def adaptive_law(p: adaptive.Parameters, period: float) -> Law:
    x = adaptive.initial_estimate(p)

    def law(
        t: float, T: Body, S: Body, wheel_speed: Array, ref: Mapping[str, Any]
    ) -> dict[str, Any]:
        nonlocal x
        outputs, x = adaptive.sample(t, T, S, wheel_speed, ref, x, p, period)
        return outputs

    return law


# ---- closed loop ----


def run(s: Scenario, new_law: Callable[[], Law], stop: float = STOP) -> History:
    """Histories named `component.port`, and `time`; new_law makes the controller in its initial
    state.
    """
    rec, period = Recorder(), s.period
    yT, yS = target.initial_state(s.target), servicer.initial_state(s.servicer)
    F_cmd, held, law = np.zeros(3), los.NOTHING, new_law()
    for k in range(-1, round(stop / period)):
        t = max(k, 0) * period
        T, S = target.body(yT), servicer.body(yS, servicer.is_active(s.servicer, t))
        ref, held = los.guide(T, S, F_cmd, s.guidance, held if k >= 0 else los.NOTHING)
        command = (law if k >= 0 else new_law())(
            t, T, S, servicer.outputs(t, yS, s.servicer)["wheel_speed"], ref
        )
        F_cmd = command["F_cmd_S"]
        if k >= 0:
            yT, yS = _advance(s, yT, yS, command, t)
        _record(rec, max(k + 1, 0) * period, yT, yS, ref, command, s)
    return rec.history(period)


def _advance(
    s: Scenario, yT: Array, yS: Array, command: Mapping[str, Any], t: float
) -> tuple[Array, Array]:
    u = servicer.Input(
        F_S=command["F_cmd_S"], M_S=command["M_cmd_S"], wheel_accel_cmd=command["wheel_accel_cmd"]
    )
    end = t + s.period
    return target.step(s.target, yT, t, end), servicer.step(s.servicer, yS, t, end, u)


def _record(
    rec: Recorder, t: float, yT: Array, yS: Array, ref: Any, command: Any, s: Scenario
) -> None:
    rec.add("target", target.outputs(yT, s.target))
    rec.add("servicer", servicer.outputs(t, yS, s.servicer))
    rec.add("guidance", ref)
    rec.add("controller", command)


def laws(period: float = STEP) -> dict[str, Callable[[], Law]]:
    """The three controllers with the parameters of ppc_tracking."""
    return {
        "ppc_controller": lambda: ppc_law(ppc.Ppc()),
        "pid_controller": lambda: pid_law(ppc.Pid(), period),
        "theta_d_controller": lambda: theta_d.ThetaDLaw(theta_d.ThetaD()),
    }
