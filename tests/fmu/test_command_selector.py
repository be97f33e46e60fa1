# SPDX-License-Identifier: BSD-2-Clause
"""command_selector.fmu: which law commands what, by hand; bumpless between laws, at once to and
from nothing; the relays' virtual engines; a reference along random selections.
"""

from __future__ import annotations

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from tests.close import close
from tests.reference.mission import Selector

from .cases import random_inertia
from .rejections import rejection

P = 0.1
PARAMETERS = {
    "main_thrust": 2.0, "brake_thrust": 2.0, "relay_torque": (0.5, 0.5, 0.5),
    "A_w": np.diag((12.0, 15.0, 10.0)), "push_force": 1.0, "blend_time": 5.0, "sample_period": P,
    "wheel_speed_max": 0.3, "wheel_speed_ref": (0.0, 0.0, 0.0), "unload_on": 0.7, "unload_off": 0.1,
    "k_unload": 0.0, "M_unload_max": 0.05,
}  # fmt: skip
LAWS = {
    "throttle": [0.0] * 16,
    "F_close_S": (1.0, 2, 3), "M_close_S": (0.1, 0.2, 0.3), "wheel_close": (0.01, 0.02, 0.03),
    "F_sync_S": (-1.0, 5, 2), "M_sync_S": (-0.1, 0.5, 0.2), "wheel_sync": (-0.01, 0.05, 0.02),
    "F_retreat_S": (0.0, 0.9, 0), "wheel_stack": (0.003, 0.001, -0.002),
    "M_unload_S": (0.024, -0.03, 0.01), "push": 0.0, "wheel_speed": (0.0, 0.0, 0.0),
    "F_opt_S": (0.5, -0.2, 0.1),
}  # fmt: skip


def select(force, torque, **other):
    return LAWS | {"select_force": force, "select_torque": torque} | other


def command(unit):
    return np.array([unit.get(name) for name in ("F_cmd_S", "M_cmd_S", "wheel_accel_cmd")])


def settled(fmu, force, torque, **other):
    """Commands of an instance that has known no other selection."""
    return command(fmu("command_selector", {}, select(force, torque, **other)))


# docs/models.md B.6: axis and sign of the torque of P1..P8, share of the full torque
ENGINES = [(2, 1, 1), (1, -1, 1), (2, -1, 1), (1, 1, 1),
           (0, -1, 0.5), (0, 1, 0.5), (0, -1, 0.5), (0, 1, 0.5)]  # fmt: skip


@pytest.mark.parametrize("engine", range(8))
def test_attitude_engines_give_their_torque_and_no_force(fmu, engine):
    throttle = np.eye(16)[engine]
    axis, sign, share = ENGINES[engine]
    F, M, W = command(
        fmu("command_selector", {"relay_torque": (0.2, 0.3, 0.4)}, select(1, 1, throttle=throttle))
    )
    expected = np.zeros(3)
    expected[axis] = sign * share * (0.2, 0.3, 0.4)[axis]
    assert pytest.approx(expected, abs=1e-15) == M
    assert not F.any()
    assert not W.any()


@pytest.mark.parametrize("engine", range(8))
def test_wheels_give_the_torque_of_the_attitude_engines(fmu, rng, engine):
    """far_wheels: the body gets -A_w times their acceleration, the thrusters have no torque; and
    full wheels are unloaded at unload_on, not always.
    """
    A, u = random_inertia(rng, 5, 20), select(1, 1, throttle=np.eye(16)[engine])
    by_thrusters = command(fmu("command_selector", {"A_w": A}, u))
    F, M, W = command(fmu("command_selector", {"A_w": A, "far_wheels": 1}, u))
    assert pytest.approx(by_thrusters[1], abs=1e-14) == -A @ W
    assert np.abs(W).max() > 0
    assert not M.any()
    assert pytest.approx(by_thrusters[0], abs=1e-15) == F
    unit = fmu("command_selector", {"k_unload": 0.01, "far_wheels": 1}, select(0, 1))
    seen = []
    for speed in (0.2, 0.22, 0.04, 0.02, 0.2):
        unit.step(P, select(0, 1, wheel_speed=(0, speed, 0)))
        seen.append(unit.get("wheels_unloading"))
    assert seen == [0, 1, 1, 0, 0]


def test_main_engine_pushes_forward_and_four_brakes_together_backward(fmu):
    p = {"main_thrust": 3.0, "brake_thrust": 2.0}
    for throttle, expected in (
        (np.eye(16)[12], 3.0),
        (np.eye(16)[8], -0.5),
        (np.eye(16)[8:12].sum(0), -2.0),
        (np.ones(16), 1.0),
        (np.eye(16)[13:].sum(0), 0.0),
    ):
        F, M, _ = command(fmu("command_selector", p, select(1, 1, throttle=throttle)))
        assert pytest.approx((expected, 0, 0), abs=1e-15) == F
        assert not M.any()


@pytest.mark.verifies("J.5-1")
def test_each_selection_passes_its_own_law(fmu):
    zero, unload = (0, 0, 0), np.array(LAWS["M_unload_S"])
    forces = [zero, zero, LAWS["F_close_S"], LAWS["F_sync_S"], zero, LAWS["F_retreat_S"],
              LAWS["F_opt_S"]]  # fmt: skip
    torques = [zero, zero, LAWS["M_close_S"], LAWS["M_sync_S"], unload]
    wheels = [zero, zero, LAWS["wheel_close"], LAWS["wheel_sync"],
              LAWS["wheel_stack"] + unload / (12, 15, 10)]  # fmt: skip
    for force, expected in enumerate(forces):
        assert settled(fmu, force, 0)[0] == pytest.approx(expected, abs=1e-15)
    for torque, expected in enumerate(zip(torques, wheels, strict=True)):
        assert settled(fmu, 0, torque)[1:] == pytest.approx(np.array(expected), abs=1e-15)


def test_unloading_torque_is_taken_up_by_the_wheels(fmu, rng):
    """A_w times the added acceleration is the torque of the thrusters, for full matrices too."""
    A = random_inertia(rng, 5, 20)
    M = rng.normal(size=3)
    unit = fmu("command_selector", {"A_w": A}, select(0, 4, M_unload_S=M, wheel_stack=(0, 0, 0)))
    assert A @ unit.get("wheel_accel_cmd") == pytest.approx(M, abs=1e-12)


FULL = (0.1, -0.22, 0.05)  # 0.73 of 0.3 rad/s


@pytest.mark.parametrize("torque", range(5))
def test_full_wheels_are_unloaded_in_the_laws_that_steer_before_capture(fmu, torque):
    """Thrusters and wheels against each other: A_w W = M in what is added, in laws 1 to 3."""
    plain = settled(fmu, 0, torque, wheel_speed=FULL)
    unit = fmu("command_selector", {"k_unload": 0.01}, select(0, torque, wheel_speed=FULL))
    added = command(unit) - plain
    speeds = np.array(FULL) if torque in (1, 2, 3) else np.zeros(3)
    assert not added[0].any()
    assert added[1] == pytest.approx(-0.01 * speeds * (12, 15, 10), abs=1e-15)
    assert added[2] == pytest.approx(-0.01 * speeds, abs=1e-15)
    assert unit.get("wheels_unloading") == (torque in (1, 2, 3))


@pytest.mark.verifies("J.5-4")
@pytest.mark.parametrize(("torque", "begins"), [(1, 0.03), (2, 0.21), (3, 0.21)])
def test_unloading_begins_and_ends_at_its_levels(fmu, torque, begins):
    """In law 1 the wheels rest, so it begins at once where it would end."""
    unit = fmu("command_selector", {"k_unload": 0.01}, select(0, torque))
    seen = []
    for part in (begins - 1e-6, begins + 1e-6, 0.03 + 1e-6, 0.03 - 1e-6, begins - 1e-6):
        unit.step(P, select(0, torque, wheel_speed=(0, 0, -part)))
        seen.append(unit.get("wheels_unloading"))
    assert seen == [0, 1, 1, 0, 0]


@pytest.mark.verifies("J.5-4")
@pytest.mark.parametrize("torque", range(5))
def test_wheels_are_brought_to_the_bias_of_a_coming_manoeuvre(fmu, torque):
    """At any speed, with the laws before the capture; without k_unload nothing happens."""
    bias, now = np.array((0.1, -0.2, 0.05)), np.array((0.01, 0.02, 0.04))
    u = select(0, torque, wheel_speed=now, wheel_bias=bias, prepare=1)
    for k, law in ((0.01, torque in (1, 2, 3)), (0, False)):
        unit = fmu("command_selector", {"k_unload": k}, u)
        added = command(unit) - settled(fmu, 0, torque, wheel_speed=now)
        expected = 0.01 * (bias - now) * law
        assert added[1] == pytest.approx(expected * (12, 15, 10), abs=1e-15)
        assert added[2] == pytest.approx(expected, abs=1e-15)
        assert unit.get("wheels_unloading") == law


def test_a_bias_is_ignored_after_the_preparation(fmu):
    added = command(fmu("command_selector", {"k_unload": 0.01},
                        select(0, 3, wheel_speed=FULL, wheel_bias=FULL)))  # fmt: skip
    assert added[1] - LAWS["M_sync_S"] == pytest.approx(-0.01 * np.array(FULL) * (12, 15, 10))


@pytest.mark.verifies("J.5-4")
@pytest.mark.parametrize(("speed", "unloads"), [(0.2, 0), (0.22, 1)])
def test_after_the_preparation_the_upper_level_decides(fmu, speed, unloads):
    """A bias between the levels remains: 0.03 and 0.21 rad/s."""
    wheels = {"wheel_speed": (0, speed, 0), "wheel_bias": (0, speed, 0)}
    unit = fmu("command_selector", {"k_unload": 0.01}, select(0, 3, prepare=1, **wheels))
    unit.step(P, select(0, 3, prepare=1, **wheels))
    assert unit.get("wheels_unloading") == 1
    unit.step(P, select(0, 3, prepare=0, **wheels))
    assert unit.get("wheels_unloading") == unloads


def test_unloading_pulls_no_harder_than_it_may(fmu):
    p = {"k_unload": 1.0, "M_unload_max": 0.04, "wheel_speed_ref": (0, 0, 0.1)}
    added = settled_with(fmu, p, FULL)
    assert added[1] == pytest.approx((-0.04, 0.04, 0.04), abs=1e-15)
    assert added[2] == pytest.approx((-0.04 / 12, 0.04 / 15, 0.04 / 10), abs=1e-15)


def settled_with(fmu, parameters, wheel_speed):
    inputs = select(0, 3, wheel_speed=wheel_speed)
    return command(fmu("command_selector", parameters, inputs)) - settled(fmu, 0, 3)


@pytest.mark.verifies("J.5-5")
def test_wheels_that_are_emptied_leave_the_body_at_rest(fmu):
    """The impulse of the thrusters is what the wheels lose; the body retains nothing."""
    speed, body, spent = np.array((0.25, -0.1, 0.2)), np.zeros(3), np.zeros(3)
    A = np.diag((12.0, 15, 10))
    unit = fmu("command_selector", {"k_unload": 0.02}, select(0, 1, wheel_speed=speed))
    for _ in range(3000):
        M, W = unit.get("M_cmd_S"), unit.get("wheel_accel_cmd")
        body += (M - A @ W) * P
        spent += M * P
        speed = speed + W * P
        unit.step(P, select(0, 1, wheel_speed=speed))
    assert np.abs(speed).max() == pytest.approx(0.03, rel=0.01)  # unload_off
    assert spent == pytest.approx(A @ (speed - (0.25, -0.1, 0.2)), abs=1e-12)
    assert body == pytest.approx(np.zeros(3), abs=1e-14)


BLENDING = [(a, b) for a in (1, 2, 3) for b in (1, 2, 3) if a != b]


@pytest.mark.verifies("J.5-2")
@pytest.mark.parametrize(("old", "new"), BLENDING)
def test_from_law_to_law_nothing_jumps_and_the_difference_fades(fmu, old, new):
    unit = fmu("command_selector", {}, select(old, old))
    before, target = settled(fmu, old, old), settled(fmu, new, new)
    largest = np.abs([before, target]).max()  # of 80 factors that are rounded one after the other
    unit.step(P)
    for k in range(80):
        unit.step(P, select(new, new))
        fade = np.exp(-k * P / 5)
        close(command(unit), target + fade * (before - target), rel=1e-13, of=largest)


@pytest.mark.parametrize(("old", "new"), [(a, 6) for a in (1, 2, 3)] + [(6, a) for a in (1, 2, 3)])
def test_the_force_of_the_optimal_law_blends_with_the_laws_of_the_approach(fmu, old, new):
    unit = fmu("command_selector", {}, select(old, 3))
    unit.step(P)
    unit.step(P, select(new, 3))
    assert command(unit) == pytest.approx(settled(fmu, old, 3), abs=1e-14)
    unit.step(P, select(new, 3))
    assert not np.array_equal(command(unit), settled(fmu, old, 3))


AT_ONCE = [(0, 3), (3, 0), (5, 3), (3, 5), (4, 2), (2, 4), (0, 5), (6, 0), (6, 5), (6, 4)]


@pytest.mark.verifies("J.5-3")
@pytest.mark.parametrize(("old", "new"), AT_ONCE)
def test_force_fades_out_and_in_and_the_retreat_acts_at_once(fmu, old, new):
    unit = fmu("command_selector", {}, select(old, 0))
    unit.step(P)
    unit.step(P, select(new, 0))
    assert np.array_equal(command(unit), settled(fmu, new, 0))


@pytest.mark.parametrize(("old", "new", "blends"), [(0, 4, 0), (4, 0, 0), (3, 4, 1), (4, 1, 1)])
def test_torque_blends_among_the_four_laws(fmu, old, new, blends):
    unit = fmu("command_selector", {}, select(0, old))
    unit.step(P)
    unit.step(P, select(0, new))
    expected = settled(fmu, 0, old if blends else new)
    assert command(unit) == pytest.approx(expected, abs=1e-14)


def test_a_fading_command_is_dropped_where_the_force_ends(fmu):
    unit = fmu("command_selector", {}, select(2, 2))
    for selected in ((2, 2), (3, 3), (0, 0)):
        unit.step(P, select(*selected))
    assert not command(unit).any()
    unit.step(P, select(3, 3))
    assert np.array_equal(command(unit), settled(fmu, 3, 3))


def test_push_is_added_to_the_synchronised_approach_only_and_not_remembered(fmu):
    for force in range(7):
        pushed = settled(fmu, force, 0, push=1)[0] - settled(fmu, force, 0)[0]
        assert pushed == pytest.approx((1.0 if force == 3 else 0, 0, 0), abs=1e-15)
    unit = fmu("command_selector", {}, select(3, 3, push=1))
    unit.step(P)
    unit.step(P, select(2, 2, push=1))
    assert unit.get("F_cmd_S") == pytest.approx(LAWS["F_sync_S"], abs=1e-14)


def test_without_a_blend_time_every_change_is_at_once(fmu):
    unit = fmu("command_selector", {"blend_time": 0}, select(2, 2))
    unit.step(P)
    unit.step(P, select(3, 3))
    assert np.array_equal(command(unit), settled(fmu, 3, 3))


@pytest.mark.parametrize("blend_time", [0.0, 0.3, 5.0])
@pytest.mark.parametrize("k_unload", [0.0, 0.02])
def test_random_selections_follow_the_reference(fmu, rng, blend_time, k_unload):
    more = {"k_unload": k_unload, "wheel_speed_ref": 0.02 * rng.normal(size=3)}
    p = PARAMETERS | {"blend_time": blend_time, "A_w": random_inertia(rng, 5, 20)} | more
    unit, model = fmu("command_selector", p, select(0, 0)), Selector(p)
    inputs = select(0, 0)
    for _ in range(300):
        for name, value in LAWS.items():
            inputs[name] = np.array(value) + 0.1 * rng.normal(size=np.shape(value))
        inputs["throttle"] = rng.integers(0, 2, 16).astype(float)
        inputs["push"] = float(rng.integers(2))
        inputs["wheel_speed"] = 0.1 * rng.normal(size=3)
        if rng.random() < 0.2:
            inputs["select_force"] = float(rng.integers(7))
        if rng.random() < 0.2:
            inputs["select_torque"] = float(rng.integers(5))
        unit.step(P, inputs)
        for name, value in model.sample(inputs).items():
            assert unit.get(name) == pytest.approx(value, abs=1e-12), name


@pytest.mark.verifies("J.5-6")
@pytest.mark.parametrize("bad", [{"select_force": 7}, {"select_force": -1}, {"select_force": 6.6},
                                 {"select_torque": 5}, {"select_torque": -1}])  # fmt: skip
def test_selections_outside_their_lists_are_rejected_in_the_step(fmu, bad):
    unit = fmu("command_selector", {}, select(2, 2))
    with pytest.raises(FMICallException):
        unit.step(P, bad)


def test_samples_are_taken_at_multiples_of_the_period(fmu):
    unit = fmu("command_selector", {}, select(2, 2))
    unit.step(P / 2)
    unit.step(P / 2, select(3, 3))
    assert np.array_equal(command(unit), settled(fmu, 2, 2))


@pytest.mark.verifies("J.5-7")
@pytest.mark.parametrize(
    "change", [{"blend_time": -1}, {"A_w": np.diag((1, 1, -1))}, {"unload_off": 0.8}]
)
def test_rejected(change, tmp_path):
    assert next(iter(change)) in rejection("command_selector", change, tmp_path)
