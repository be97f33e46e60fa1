# SPDX-License-Identifier: BSD-2-Clause
"""relay_controller.fmu: truth table of the relays with memory, derivative terms, frames, limit
cycle with thrusters.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.close import close
from tests.each import each
from tests.reference import relay

from .cases import random_rotation
from .rejections import rejection
from .theory import quaternion_of_dcm

T0 = 0.1
EXACT = {"xi1": [0.25] * 3, "xi2": [0.5] * 3, "rho1": 0.25, "rho2": 0.5, "Kp_v": 1, "Kp_w": [1] * 3}
"""Thresholds and gains that are exact in binary, so that a switching function can be put on a
threshold.
"""
STATIC = EXACT | {"Kd_v": 0, "Kd_w": [0] * 3}
FREE = {"translate": 1}

# docs/models.md B.6: engines (0-based) by axis and sign of the rate error
ROTATION = {
    (0, 1): (5, 7),
    (0, -1): (4, 6),
    (1, 1): (3,),
    (1, -1): (1,),
    (2, 1): (0,),
    (2, -1): (2,),
}
BRAKES, MAIN = (8, 9, 10, 11), (12,)


def vector(axis, value):
    v = np.zeros(3)
    v[axis] = value
    return v


def throttle(engines):
    return [float(i in engines) for i in range(16)]


def on(unit):
    """Engines that are on (0-based)."""
    return tuple(np.flatnonzero(unit.get("throttle")))


# What a relay does: value of the switching function, then whether it is on with "off" and with "on"
# before. Thresholds 0.25 and 0.5; a rotation relay stays as it is at its lower threshold, a
# translation relay goes off there.
BELOW, LOW, INSIDE, HIGH, ABOVE = 0.125, 0.25, 0.375, 0.5, 0.75
ROTATION_TABLE = [
    (BELOW, 0, 0),
    (LOW, 0, 1),
    (INSIDE, 0, 1),
    (HIGH, 1, 1),
    (ABOVE, 1, 1),
    (-ABOVE, 0, 0),
]
TRANSLATION_TABLE = [
    (BELOW, 0, 0),
    (LOW, 0, 0),
    (INSIDE, 0, 1),
    (HIGH, 1, 1),
    (ABOVE, 1, 1),
    (-ABOVE, 0, 0),
]


@pytest.mark.verifies("B.5-1")
@each("before", [0, 1])
@each(("value", "from_off", "from_on"), ROTATION_TABLE)
@each("axis", range(3))
@each("sign", [1, -1])
def test_truth_table_of_the_rotation_relays(fmu, axis, sign, value, from_off, from_on, before):
    unit = fmu("relay_controller", STATIC)
    for error in ((ABOVE if before else 0), value):
        unit.step(T0, {"omega_DN_D": vector(axis, sign * error)})
    expected = ROTATION[axis, sign] if (from_on if before else from_off) else ()
    expected += ROTATION[axis, -sign] if value <= -HIGH else ()
    assert unit.get("throttle").tolist() == throttle(expected)
    assert unit.get("translation_firing") == 0


@pytest.mark.verifies("B.5-1")
@each("before", [0, 1])
@each(("value", "from_off", "from_on"), TRANSLATION_TABLE)
@each(("sign", "engines", "others"), [(1, MAIN, BRAKES), (-1, BRAKES, MAIN)])
def test_truth_table_of_main_engine_and_brakes(
    fmu, sign, engines, others, value, from_off, from_on, before
):
    """The brakes go off when sigma_v has risen to -rho1 (B.8: printed with the other sign, they
    would never go off).
    """
    unit = fmu("relay_controller", STATIC, FREE)
    for error in ((ABOVE if before else 0), value):
        unit.step(T0, {"drho_ref_N": (sign * error, 0, 0)})
    expected = engines if (from_on if before else from_off) else ()
    expected += others if value <= -HIGH else ()
    assert unit.get("throttle").tolist() == throttle(expected)
    assert unit.get("translation_firing") == bool(expected)


@pytest.mark.verifies("B.5-1")
def test_memory_lasts_as_long_as_the_switching_function_stays_inside(fmu):
    unit = fmu("relay_controller", STATIC)
    trace = [0.3, 0.4, 0.5, 0.4, 0.3, 0.4, 0.3, 0.2, 0.3, 0.4, 0.49, 0.5, -0.3, -0.4, -0.5, -0.3]
    seen = []
    for value in trace:
        unit.step(T0, {"omega_DN_D": (value, 0, 0)})
        seen.append(on(unit))
    plus, minus, none = ROTATION[0, 1], ROTATION[0, -1], ()
    assert seen == [none] * 2 + [plus] * 5 + [none] * 4 + [plus] + [none] * 2 + [minus] * 2


def test_all_relays_follow_the_reference_with_random_errors(fmu, rng):
    """All four channels at once, derivative terms included; switching functions to 1e-12, relays
    exactly.
    """
    p = relay.Parameters()
    unit, reference = fmu("relay_controller", {"law": 1}, FREE), relay.Relays(p)
    for _ in range(300):
        dw, e = 1.5e-3 * rng.normal(size=3), 6e-3 * rng.normal()
        unit.step(T0, {"omega_DN_D": dw, "drho_ref_N": (e, *rng.normal(size=2))})
        sigma_w, sigma_v = reference.sigma_w(tuple(dw)), reference.sigma_v(e, e)
        reference.switch(sigma_v, sigma_w)
        assert unit.get("sigma_w") == pytest.approx(sigma_w, abs=1e-12)
        assert unit.get("sigma_v") == pytest.approx(sigma_v, abs=1e-14)
        assert unit.get("throttle").tolist() == [*reference.flags, 0, 0, 0]


# ---- derivative terms


@pytest.mark.verifies("B.5-3")
def test_derivative_is_the_difference_over_a_sample_and_0_at_first(fmu):
    unit = fmu("relay_controller", EXACT | {"Kd_w": [0.3, 0.2, 0.1], "sample_period": T0})
    errors = np.array([(0.1, 0.2, -0.1), (0.15, 0.1, 0.3), (0.15, -0.1, 0.2)])
    seen = []
    for error in errors:
        unit.step(T0, {"omega_DN_D": error})
        seen.append(unit.get("sigma_w"))
    slope = np.vstack([np.zeros(3), np.diff(errors, axis=0)]) / T0
    assert np.array(seen) == pytest.approx(errors + [0.3, 0.2, 0.1] * slope, abs=1e-14)


@pytest.mark.parametrize(("law", "differentiated"), [(0, -0.01), (1, 0.5 - 0.01)])
def test_scalar_law_does_not_differentiate_steps_of_the_required_speed(fmu, law, differentiated):
    """The reference jumps by 0.5 m/s while the servicer gains 0.01 m/s."""
    unit = fmu("relay_controller", EXACT | {"law": law, "Kd_v": 0.1}, FREE)
    unit.step(T0, {"drho_ref_N": (0.1, 0, 0), "v_SN_N": (0.02, 0, 0)})
    unit.step(T0, {"drho_ref_N": (0.6, 0, 0), "v_SN_N": (0.03, 0, 0)})
    assert unit.get("sigma_v") == pytest.approx(0.57 + 0.1 * differentiated / T0, abs=1e-14)


def test_error_is_differentiated_also_while_thrust_is_not_permitted(fmu):
    """At the permission the previous error is the error of the last sample, so there is no kick."""
    unit = fmu("relay_controller", EXACT | {"law": 1, "Kd_v": 0.1}, {"translate": 0})
    for e in (0.1, 0.2, 0.3):
        unit.step(T0, {"drho_ref_N": (e, 0, 0)})
        assert unit.get("sigma_v") == 0
        assert unit.get("e_v") == pytest.approx(e, abs=1e-15)
    unit.step(T0, {"drho_ref_N": (0.32, 0, 0), "translate": 1})
    assert unit.get("sigma_v") == pytest.approx(0.32 + 0.1 * 0.02 / T0, abs=1e-14)


@pytest.mark.verifies("B.5-2")
def test_without_permission_main_engine_and_brakes_go_off(fmu):
    unit = fmu("relay_controller", STATIC, FREE)
    unit.step(T0, {"drho_ref_N": (0.7, 0, 0)})
    assert on(unit) == MAIN
    unit.step(T0, {"translate": 0})
    assert on(unit) == ()


def test_samples_do_not_depend_on_how_finely_a_master_steps(fmu, rng):
    coarse, fine = (fmu("relay_controller", {"sample_period": T0}, FREE) for _ in range(2))
    for k in range(40):
        inputs = {"omega_DN_D": 2e-3 * rng.normal(size=3), "v_SN_N": 0.01 * rng.normal(size=3)}
        coarse.step(T0, inputs)
        fine.set(inputs)
        for j in range(4):
            fine.slave.doStep((k + j / 4) * T0, T0 / 4)
        assert all(np.array_equal(coarse.get(name), fine.get(name)) for name in coarse.kind.outputs)


def test_first_outputs_are_the_law_at_the_first_inputs_and_leave_no_memory(fmu):
    """On at the start for 0.6; the first step finds 0.4 in the band, with relays that have never
    been on.
    """
    unit = fmu("relay_controller", STATIC | {"Kd_w": [7] * 3}, {"omega_DN_D": (0.6, 0, 0)})
    assert on(unit) == ROTATION[0, 1]
    unit.step(T0, {"omega_DN_D": (0.4, 0, 0)})
    assert unit.get("sigma_w")[0] == 0.4
    assert on(unit) == ()


# ---- frames


def random_inputs(rng):
    C_SN, C_DN = random_rotation(rng), random_rotation(rng)
    return C_SN, {
        "r_TN_N": rng.normal(size=3),
        "v_TN_N": rng.normal(size=3),
        "v_SN_N": rng.normal(size=3),
        "q_SN": quaternion_of_dcm(C_SN),
        "omega_SN_S": rng.normal(size=3),
        "drho_ref_N": rng.normal(size=3),
        "q_DN": quaternion_of_dcm(C_DN),
        "omega_DN_D": rng.normal(size=3),
    }


def test_errors_are_taken_in_servicer_axes(fmu, rng):
    C_SN, inputs = random_inputs(rng)
    unit = fmu("relay_controller", STATIC, inputs | FREE)
    C_DN = np.linalg.inv(random_rotation(rng))
    unit.step(T0, {"q_DN": -quaternion_of_dcm(C_DN), "q_SN": -inputs["q_SN"]})
    rate_D_S = C_SN @ C_DN.T @ inputs["omega_DN_D"]
    close(unit.get("domega_S"), rate_D_S - inputs["omega_SN_S"], rel=2e-14)
    error = C_SN @ (inputs["v_TN_N"] + inputs["drho_ref_N"] - inputs["v_SN_N"])
    assert unit.get("e_v") == pytest.approx(error[0], abs=1e-14)


def test_turning_the_inertial_frame_changes_nothing(fmu, rng):
    _, inputs = random_inputs(rng)
    R = random_rotation(rng)
    as_matrix = {name: np.array(value) for name, value in inputs.items()}
    turned = {name: R @ v if name.endswith("_N") else v for name, v in as_matrix.items()}
    for q in ("q_SN", "q_DN"):
        turned[q] = np.array(relay.times(tuple(quaternion_of_dcm(R.T)), tuple(as_matrix[q])))
    one, other = (fmu("relay_controller", {"law": 0}, x | FREE) for x in (inputs, turned))
    for unit in (one, other):
        unit.step(T0)
        unit.step(T0)
    close(one.get("sigma_w"), other.get("sigma_w"), rel=1e-13)
    close(one.get("sigma_v"), other.get("sigma_v"), rel=1e-12)


def test_the_inputs_match_every_controller(kind):
    def inputs(name):
        return {v.name for v in kind(name).description.modelVariables if v.causality == "input"}

    assert inputs("adaptive_controller") | {"translate"} == inputs("relay_controller")


# ---- limit cycle


def limit_cycle(controller, engines, axis, k, inertia, rate, steps):
    """Histories of angle, rate and acceleration of a double integrator whose required rate is -k
    angle.
    """
    angle, rows = 0.0, []
    for _ in range(steps):
        controller.step(
            T0, {"omega_DN_D": vector(axis, -k * angle), "omega_SN_S": vector(axis, rate)}
        )
        engines.step(T0, {"throttle": controller.get("throttle")})
        acceleration = engines.get("M_S")[axis] / inertia
        rows.append((angle, rate, acceleration))
        angle, rate = angle + T0 * rate + T0**2 / 2 * acceleration, rate + T0 * acceleration
    return np.array(rows).T


@pytest.mark.parametrize("delay", [0, 0.1, 0.4])
@pytest.mark.parametrize("axis", [1, 2])
def test_limit_cycle_of_a_double_integrator_has_the_period_of_theory(fmu, axis, delay):
    """T = 4 (theta + w d)/w: coasting at rate w between the switching lines at +-theta, the
    reversal comes d later.

    An engine comes on at k angle + rate = xi2, that is at theta = (xi2 - w)/k, and takes 2 w from
    the rate: the difference of the thresholds and what it gives during the delay. Half the pulse is
    delivered d = Tl + (length of the pulse)/2 after the switching. The start is on the cycle; a
    tick is 0.2 % of its period, a delay of 0.4 s makes 3 %.
    """
    k, xi1, xi2, inertia = 0.1, 4e-3, 2e-2, 60.0
    gains = {"Kp_w": [1] * 3, "Kd_w": [0] * 3, "xi1": [xi1] * 3, "xi2": [xi2] * 3}
    controller, engines = (
        fmu("relay_controller", gains),
        fmu("propulsion", {"Tl": delay, "T2up": 0, "T2dn": 0}),
    )
    start = (xi2 - xi1 + 0.5 / inertia * delay) / 2
    angle, rate, acceleration = limit_cycle(controller, engines, axis, k, inertia, start, 4000)
    rising = np.flatnonzero((angle[:-1] < 0) & (angle[1:] >= 0))
    crossings = rising - angle[rising] / (angle[rising + 1] - angle[rising])
    w, whole = np.abs(rate[acceleration == 0]).mean(), slice(rising[0], rising[-1])
    pulse = T0 * np.count_nonzero(acceleration[whole]) / (2 * (len(rising) - 1))
    theta, d = (xi2 - w) / k, delay + pulse / 2
    assert len(rising) >= 5
    assert T0 * np.diff(crossings).mean() == pytest.approx(4 * (theta + w * d) / w, rel=0.02)


# ---- rejections


@pytest.mark.verifies("B.5-5")
@pytest.mark.parametrize(
    ("parameters", "rule"),
    [
        ({"rho1": 5e-3}, "rho1 = 0.005: must be below rho2"),
        ({"rho1": 6e-3}, "rho1 = 0.006: must be below rho2"),
        ({"rho1": -1}, "rho1 = -1: must be >= 0"),
        ({"xi1": [0.03, 0.05, 0.03]}, "xi1[2] = 0.05: must be below xi2"),
        ({"Kp_v": -1}, "Kp_v = -1: must be >= 0"),
        ({"law": 3}, "law = 3: must be 0 or 1"),
    ],
)
def test_bad_parameters_are_rejected_with_the_rule(tmp_path, parameters, rule):
    assert rule in rejection("relay_controller", parameters, tmp_path)
