# SPDX-License-Identifier: BSD-2-Clause
"""pid_controller.fmu: the law, its integrals, anti-windup."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from tests.each import each

from ..reference import ppc as reference
from .los_cases import Scene, bodies, random_scene, reference_of, sample
from .motion import deviation

FREE = {"a_max": 0, "M_max": (0, 0, 0)}
SIGMA = np.array((-1, -1, 1))
Kp, Ki, Kd = (np.array(k) for k in ((0.4, 20, 20), (0.024, 4, 4), (2, 48, 48)))


@pytest.mark.parametrize("up_axis", [1, 2, 3])
def test_outputs_match_the_reference_over_five_samples(fmu, rng, up_axis):
    """Limits act in some; 1e-7 relative: 1e-9 m of cancellation by gains. Attitude begins at the
    third sample.
    """
    p = replace(
        reference.Pid(), up_axis=up_axis, t_att=0.2, use_wheels=rng.integers(2), force_scale=80.0
    )
    unit, x = fmu("pid_controller", reference.settings(p)), (np.zeros(3), np.zeros(3))
    for k in range(5):
        u = random_scene(rng, up_axis).inputs()
        expected, x = reference.pid(0.1 * k, *bodies(u), reference_of(u), x, p, 0.1)
        out = sample(unit, u)
        for name, value in expected.items():
            assert deviation(out[name], value, 1 + np.max(np.abs(value))) < 1e-7, (k, name)


def test_every_channel_has_gains_of_its_own(fmu, rng):
    """In the paper the gains of elevation and azimuth are the same; limits act, so the integrals
    give way by the times of their channels too. A scene in which one of the limits does not act, by
    the reference, is drawn again.
    """
    p = replace(
        reference.Pid(),
        range=reference.Gains(0.4, 0.02, 2.0, 4.0),
        elevation=reference.Gains(20.0, 4.0, 48.0, 0.5),
        azimuth=reference.Gains(15.0, 3.0, 40.0, 0.8),
        a_max=0.02,
    )
    unit, x = fmu("pid_controller", reference.settings(p)), (np.zeros(3), np.zeros(3))
    for k in range(3):
        saturated = False
        while not saturated:
            u = random_scene(rng).inputs()
            expected, after = reference.pid(0.1 * k, *bodies(u), reference_of(u), x, p, 0.1)
            saturated = (np.abs(expected["a_cmd_L"]) == p.a_max).all()
        x, out = after, sample(unit, u)
        assert out["a_saturated"].all()
        for name in ("a_cmd_L", "integral"):
            assert deviation(out[name], expected[name], 1 + np.max(np.abs(expected[name]))) < 1e-7


def test_proportional_and_rate_gain_act_per_channel(fmu, rng):
    scene = replace(random_scene(rng), r_TN_N=np.zeros(3), v_TN_N=np.zeros(3))
    out = sample(fmu("pid_controller", FREE), scene.inputs())
    assert deviation(SIGMA * out["a_cmd_L"], -(Kp * scene.x1 + Kd * scene.x2)) < 1e-11


@pytest.mark.verifies("C.5-3")
def test_the_integral_of_a_constant_error_grows_linearly_and_acts_one_sample_later(fmu):
    e = np.array((2.0, 0.01, -0.01))
    unit = fmu("pid_controller", FREE)
    for k in range(1, 6):
        out = sample(unit, Scene(x1=e).inputs())
        assert deviation(out["integral"], 0.1 * k * e) < 1e-12
        assert deviation(SIGMA * out["a_cmd_L"], -(Kp * e + Ki * 0.1 * (k - 1) * e)) < 1e-11


def test_without_integral_action_it_is_a_pd_controller_at_its_limits_and_within(fmu, rng):
    """Anti-windup divides by Ki: of none there is nothing to divide."""
    none = {f"{channel}.Ki": 0 for channel in ("range", "elevation", "azimuth", "attitude")}
    scene = replace(random_scene(rng), r_TN_N=np.zeros(3), v_TN_N=np.zeros(3))
    required = -(Kp * scene.x1 + Kd * scene.x2)
    limit = float(np.max(np.abs(required)))
    for a_max in (0.5 * limit, 2 * limit):
        unit = fmu("pid_controller", {"a_max": a_max, "M_max": (0.1, 0.1, 0.1)} | none)
        for k in range(1, 4):
            out = sample(unit, scene.inputs())
            command = SIGMA * out["a_cmd_L"]
            assert deviation(command, np.clip(required, -a_max, a_max)) < 1e-11
            assert deviation(out["integral"], 0.1 * k * scene.x1) < 1e-11


@pytest.mark.verifies("C.5-5")
def test_first_outputs_do_not_integrate(fmu):
    unit = fmu(
        "pid_controller",
        None,
        Scene(x1=np.array((2.0, 0.1, 0.1)), turn=np.array((0.1, 0, 0))).inputs(),
    )
    assert unit.get("integral.range") == 0
    assert not np.any(unit.get("integral_att"))


# ---- anti-windup ----


def saturating(fmu, T_aw, period=0.1, seconds=60.0):
    """Integral of the range after a minute at 100 m, where the limit holds the command."""
    unit = fmu("pid_controller", {"range.T_aw": T_aw, "sample_period": period})
    out = sample(unit, Scene(x1=np.array((100.0, 0, 0))).inputs(), seconds)
    assert out["a_saturated"][0] == 1
    return unit, out["integral"][0]


def test_without_back_calculation_the_integral_winds_up(fmu):
    _, integral = saturating(fmu, 0.0)
    assert abs(integral - 6000.0) < 1e-6


@pytest.mark.verifies("C.5-2")
@each("period", [0.01, 0.05, 0.1, 1.0])
@each("T_aw", [40.0, 4.0, 0.025])
def test_back_calculation_settles_where_it_balances_the_error_at_every_period(fmu, T_aw, period):
    """Ki T e + u - sat u = 0 with u - sat u = -(Kp e + Ki I) + 4.9, reached at the rate 1/T, Euler
    ahead of the exponential; T is no less than the period."""
    _, integral = saturating(fmu, T_aw, period, seconds=200.0)
    T = max(T_aw, period)
    expected = T * 100.0 + (4.9 - Kp[0] * 100.0) / Ki[0]
    assert abs(integral - expected) < 1.01 * abs(expected) * np.exp(-200.0 / T) + 1e-9 * abs(
        expected
    )


@pytest.mark.verifies("C.5-1")
def test_the_command_leaves_the_limit_as_soon_as_the_error_does(fmu):
    """After a minute of saturation a small error is answered by a small command; without it the
    limit would stay.
    """
    commands = {}
    for T_aw in (0.0, 4.0):
        unit, _ = saturating(fmu, T_aw)
        commands[T_aw] = sample(unit, Scene(x1=np.array((-1.0, 0, 0))).inputs(), 0.5)["a_cmd_L"][0]
    assert commands[0.0] == 4.9
    assert commands[4.0] < 0


@pytest.mark.verifies("C.5-1")
def test_the_torque_integral_is_retained_from_winding_up_too(fmu):
    """2 rad of error hold the torque at its limit."""
    scene = Scene(turn=np.array((2.0, 0, 0))).inputs()
    wound, retained = (
        fmu("pid_controller", {"attitude.T_aw": T, "sample_period": 0.1}) for T in (0.0, 10.0)
    )
    w, k = sample(wound, scene, 30.0), sample(retained, scene, 30.0)
    assert w["M_cmd_S"][0] == k["M_cmd_S"][0] == -10
    assert k["integral_att"][0] < 0.1 * w["integral_att"][0]


def test_integrals_stay_finite_for_ever(fmu):
    unit = fmu("pid_controller", {"range.T_aw": 1e-9, "a_max": 1e-6})
    u = Scene().inputs() | {"r_SN_N": (1e300, -1e300, 1e300)}
    for _ in range(50):
        unit.step(1e4, u)
    assert np.isfinite(unit.get("integral.range"))


@pytest.mark.verifies("C.5-6")
@pytest.mark.parametrize(
    "p", [{"range.Kp": -1}, {"attitude.Ki": -1}, {"azimuth.T_aw": -1}, {"wheel_scale": 0}], ids=str
)
def test_impossible_gains_are_rejected(fmu, p):
    with pytest.raises(FMICallException):
        fmu("pid_controller", p)
