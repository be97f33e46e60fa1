# SPDX-License-Identifier: BSD-2-Clause
"""ideal_propulsion.fmu against closed forms: saturation, first-order lag, impulse, propellant flow,
flags.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from .driver import bits
from .motion import deviation

G_0 = 9.80665  # m/s2, standard gravity, exact by definition
LIMITS = {"F_max": (3.0, 5.0, 0.0), "M_max": (0.2, 0.0, 0.4)}
PORTS = [("F_cmd_S", "F_S", "impulse"), ("M_cmd_S", "M_S", "torque_impulse")]


def saturated(command, limit):
    """Per axis; a limit of 0 is none."""
    bound = np.where(np.array(limit) > 0, limit, np.inf)
    return np.clip(command, -bound, bound)


def lagged(before, command, tau, t):
    return command + (before - command) * np.exp(-t / tau)


def integral_of_magnitude(f, t):
    """Integral of |f| from 0 to t by quadrature, split where f, which has at most one zero, changes
    sign.
    """
    zeros = [brentq(f, 0, t, xtol=1e-15)] if f(0) * f(t) < 0 else []
    return quad(lambda s: abs(f(s)), 0, t, points=zeros or None, epsabs=1e-13, epsrel=1e-13)[0]


@pytest.mark.parametrize("tau", [0, 0.01])
def test_wrench_is_the_command_limited_per_axis(fmu, rng, tau):
    """A lag of 0.01 s has settled to exp(-100) after 1 s."""
    F, M = rng.uniform(-8, 8, 3), rng.uniform(-1, 1, 3)
    unit = fmu("ideal_propulsion", LIMITS | {"tau": tau})
    unit.step(1, {"F_cmd_S": F, "M_cmd_S": M})
    assert deviation(unit.get("F_S"), saturated(F, LIMITS["F_max"])) < 1e-14
    assert deviation(unit.get("M_S"), saturated(M, LIMITS["M_max"])) < 1e-14


def test_flags_state_which_axes_request_more_than_their_limit(fmu):
    commands = {"F_cmd_S": (3.1, -5.0, 1e6), "M_cmd_S": (-0.1, 1e6, -0.5)}
    unit = fmu("ideal_propulsion", LIMITS, commands)
    for _ in range(2):  # after initialization, after a step
        assert unit.get("F_saturated").tolist() == [1, 0, 0]
        assert unit.get("M_saturated").tolist() == [0, 0, 1]
        unit.step(1)
    unit.step(1, {"F_cmd_S": (3.0, -5.1, 0), "M_cmd_S": (-0.3, 0, 0.4)})
    assert unit.get("F_saturated").tolist() == [0, 1, 0]
    assert unit.get("M_saturated").tolist() == [1, 0, 0]


def test_thrust_is_there_at_once_without_lag_and_starts_from_zero_with_lag(fmu):
    commands = {"F_cmd_S": (1, -2, 6), "M_cmd_S": (0.3, 0.1, -0.1)}
    at_once, lag = (
        fmu("ideal_propulsion", LIMITS | {"tau": tau, "Isp": 200}, commands) for tau in (0, 2)
    )
    assert deviation(at_once.get("F_S"), (1, -2, 6)) == 0
    assert deviation(at_once.get("M_S"), (0.2, 0.1, -0.1)) == 0
    assert deviation(at_once.get("mdot"), 9 / (200 * G_0)) < 1e-15
    for name in ("F_S", "M_S", "mdot"):
        assert deviation(lag.get(name), 0) == 0
    for unit in (at_once, lag):
        assert not unit.get("impulse").any()
        assert not unit.get("torque_impulse").any()


@pytest.mark.parametrize("ports", PORTS)
@pytest.mark.parametrize("h", [0.1, 0.37, 4.0])
def test_wrench_approaches_the_saturated_command_exponentially(fmu, rng, h, ports):
    """Force, and integral of its magnitude also where it changes sign, at any macro step."""
    (command, wrench, impulse), tau, limit = ports, 1.7, np.array([2.0, 0.0, 1.0])
    unit = fmu("ideal_propulsion", {"tau": tau, "F_max": limit, "M_max": limit})
    force, integral = np.zeros(3), np.zeros(3)
    for _ in range(6):
        c, steps = rng.uniform(-3, 3, 3), max(1, round(3 / h))
        for _ in range(steps):
            unit.step(h, {command: c})
        target = saturated(c, limit)
        for i in range(3):
            integral[i] += integral_of_magnitude(
                partial(lagged, force[i], target[i], tau), steps * h
            )
        force = lagged(force, target, tau, steps * h)
        assert deviation(unit.get(wrench), force) < 1e-12
        assert deviation(unit.get(impulse), integral, integral.max()) < 1e-9


@pytest.mark.parametrize("ports", PORTS)
def test_without_lag_the_impulse_is_limited_magnitude_times_time(fmu, rng, ports):
    (command, wrench, impulse), limit = ports, np.array([2.0, 0.0, 1.0])
    unit, integral = fmu("ideal_propulsion", {"F_max": limit, "M_max": limit}), np.zeros(3)
    for h in rng.uniform(0.01, 2, 20):
        c = rng.uniform(-3, 3, 3)
        unit.step(h, {command: c})
        integral += h * np.abs(saturated(c, limit))
        assert deviation(unit.get(wrench), saturated(c, limit)) == 0
        assert deviation(unit.get(impulse), integral) < 1e-12


@pytest.mark.parametrize("tau", [0, 0.8])
def test_propellant_flow_is_the_sum_of_forces_over_exhaust_speed(fmu, rng, tau):
    unit = fmu("ideal_propulsion", {"tau": tau, "Isp": 220, "F_max": (2, 2, 2)})
    for _ in range(5):
        unit.step(0.5, {"F_cmd_S": rng.uniform(-4, 4, 3), "M_cmd_S": rng.normal(size=3)})
        expected = np.abs(unit.get("F_S")).sum() / (220 * G_0)
        assert deviation(unit.get("mdot"), expected, expected) < 1e-14


def test_without_specific_impulse_no_propellant_flows(fmu):
    unit = fmu("ideal_propulsion", {}, {"F_cmd_S": (1, 2, 3)})
    unit.step(1)
    assert unit.get("mdot") == 0


@pytest.mark.parametrize("h", [0.1, 0.3, 1.0])
def test_result_does_not_depend_on_how_the_step_is_cut(fmu, h):
    p, u = LIMITS | {"tau": 1.3, "Isp": 200}, {"F_cmd_S": (4, -3, 2), "M_cmd_S": (0.1, -0.2, 0.7)}
    whole, cut = fmu("ideal_propulsion", p), fmu("ideal_propulsion", p)
    whole.step(6, u)
    whole.step(6, {"F_cmd_S": (-1, 1, 1)})
    for k in range(2 * round(6 / h)):
        cut.step(h, u if k < round(6 / h) else {"F_cmd_S": (-1, 1, 1)})
    assert bits(cut) == bits(whole)
