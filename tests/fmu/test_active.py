# SPDX-License-Identifier: BSD-2-Clause
"""Input `active` of the controllers: at rest as before the first sample, then as a fresh instance
whose time starts with the first active sample.
"""

from __future__ import annotations

import numpy as np
import pytest

from .driver import bits

PERIOD = 0.1
NEAR = {
    "r_TN_N": (7158140, 0, 0),
    "v_TN_N": (0, 7462.286, 0),
    "q_TN": (1, 0, 0, 0),
    "omega_TN_T": (0, 0, 0),
    "rho_ref_N": (-180, 180, 158.7),
    "drho_ref_N": (0.01, 0.02, -0.03),
    "ddrho_ref_N": (0, 0, 0),
    "q_DN": (1, 0, 0, 0),
    "omega_DN_D": (1e-3, -2e-3, 3e-3),
    "alpha_DN_D": (0, 0, 0),
}
COMMANDS = ("F_cmd_S", "M_cmd_S", "wheel_accel_cmd")
TRACKING = (*COMMANDS, "a_cmd_L", "a_saturated", "M_saturated")
LAWS = {
    "adaptive_controller": ({}, {}, (*COMMANDS, "F_cmd_H")),
    "pid_controller": ({"a_max": 1e-3, "M_max": (1e-3, 1, 1)}, {}, TRACKING),
    "ppc_controller": ({"a_max": 1e-3}, {}, (*TRACKING, "violation", "violation_att")),
    "theta_d_controller": ({"use_wheels": 1}, {}, TRACKING),
    "switched_controller": (
        {"K_rho_1": -np.eye(3), "switch_distance": (200, 0), "axis_H": (0, 1, 0)},
        {},
        (*COMMANDS, "F_saturated", "approaching"),
    ),
    "relay_controller": ({}, {"translate": 1}, ("throttle", "translation_firing")),
}
each_law = pytest.mark.parametrize("name", LAWS)


def inputs(rng, active=1):
    """Some metres and degrees off the reference."""
    turn = np.append(1, 0.05 * rng.normal(size=3))
    return NEAR | {
        "r_SN_N": NEAR["r_TN_N"] + np.array(NEAR["rho_ref_N"]) + rng.normal(size=3),
        "v_SN_N": NEAR["v_TN_N"] + 0.1 * rng.normal(size=3),
        "q_SN": turn / np.linalg.norm(turn),
        "omega_SN_S": 0.01 * rng.normal(size=3),
        "wheel_speed": rng.normal(size=3),
        "active": active,
    }


@pytest.fixture
def law(fmu):
    def instance(name, rng, start=0.0, active=1, **more):
        parameters, further, _ = LAWS[name]
        given = parameters | {"sample_period": PERIOD} | more
        return fmu(name, given, inputs(rng, active) | further, start)

    return instance


@pytest.mark.verifies("A.5-6", "C.5-5", "C.5-8")
@each_law
def test_after_a_rest_the_law_begins_as_a_fresh_instance(law, name, rng):
    """At work, at rest, at work again, to the last bit."""
    unit = law(name, rng)
    for active in (1, 1, 1, 0, 0):
        unit.step(7 * PERIOD, inputs(rng, active))
    fresh = law(name, rng, start=35 * PERIOD)
    for k in range(35, 40):
        now = inputs(rng)
        for each in (unit, fresh):
            each.time = k * PERIOD
            each.step(PERIOD, now)
        assert bits(unit) == bits(fresh)


@each_law
def test_a_rest_from_the_start_leaves_no_trace(law, name, rng):
    unit = law(name, rng, active=0)
    unit.step(40 * PERIOD, inputs(rng, 0))
    fresh, now = law(name, rng, start=unit.time), inputs(rng)
    unit.step(20 * PERIOD, now)
    fresh.step(20 * PERIOD, now)
    assert bits(unit) == bits(fresh)


@pytest.mark.verifies("A.5-6", "B.5-4")
@each_law
def test_at_rest_commands_and_flags_are_zero_and_the_errors_match_now(law, name, rng):
    unit = law(name, rng)
    unit.step(1, inputs(rng))
    now = inputs(rng, 0)
    unit.step(1, now)
    shown, zero = unit.outputs(), LAWS[name][2]
    for output in zero:
        assert not np.any(shown[output]), output
    first = law(name, np.random.default_rng(0), start=unit.time)
    first.slave.reset()
    first.slave.setupExperiment(startTime=unit.time)
    first.slave.enterInitializationMode()
    first.set(LAWS[name][0] | {"sample_period": PERIOD} | LAWS[name][1] | now | {"active": 1})
    first.slave.exitInitializationMode()
    for output, value in first.outputs().items():
        if output not in zero:
            assert np.array_equal(shown[output], value), output
        elif output in COMMANDS:
            assert "M_cmd" in output or "wheel" in output or np.any(value)


@each_law
def test_between_its_samples_a_law_does_not_see_a_rest(law, name, rng):
    unit, other, now = law(name, rng), law(name, np.random.default_rng(9)), inputs(rng)
    for each in (unit, other):
        each.step(PERIOD, now)
    unit.step(PERIOD / 2, now)
    other.step(PERIOD / 2, now)
    unit.step(PERIOD / 4, now | {"active": 0})
    other.step(PERIOD / 4, now)
    for each in (unit, other):
        each.step(PERIOD / 4 + PERIOD, now)
    assert bits(unit) == bits(other)


@each_law
def test_at_every_call_too(law, name, rng):
    """sample_period 0."""
    unit = law(name, rng, sample_period=0)
    for active in (1, 1, 0):
        unit.step(0.25, inputs(rng, active))
    fresh, now = law(name, rng, start=0.75, sample_period=0), inputs(rng)
    for each in (unit, fresh):
        each.step(0.25, now)
        each.step(0.25, now)
    assert bits(unit) == bits(fresh)


@pytest.mark.verifies("C.4-3")
def test_the_start_of_a_funnel_is_checked_at_the_first_active_sample(law, rng):
    """Outside the funnel, but at rest: the margin is 1. A law that wakes there rejects the step."""
    unit = law("ppc_controller", rng, active=0)
    far = inputs(rng, 0) | {"rho_ref_N": (-900.0, 900.0, 800.0)}
    unit.step(1, far)
    assert unit.get("start_margin") == unit.get("start_margin_att") == 1
    with pytest.raises(Exception, match="fmi2DoStep"):
        unit.step(1, far | {"active": 1})


def test_other_values_than_0_and_1_are_rejected(law, rng):
    unit = law("pid_controller", rng)
    with pytest.raises(Exception, match="fmi2SetReal"):
        unit.set({"active": 0.5})
