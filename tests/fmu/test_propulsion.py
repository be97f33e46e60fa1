# SPDX-License-Identifier: BSD-2-Clause
"""propulsion.fmu: closed forms of impulse, delay, rejection of short commands, torque table, grid
of calls, faults.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.close import close
from tests.each import each
from tests.reference import relay

from .cases import random_direction
from .driver import bits
from .rejections import rejection

G_0 = 9.80665  # m/s2, standard gravity, exact by definition
T0 = 0.1
PROMPT = {"Tl": 0, "T2up": 0, "T2dn": 0}
PAPER = [0.5] * 8 + [10] * 4 + [50] + [0] * 3


def only(i, value=1.0):
    """Throttles with one thruster on (0-based)."""
    throttle = np.zeros(16)
    throttle[i] = value
    return {"throttle": throttle}


def simulate(unit, throttles, h=T0):
    """Thrust of all thrusters after each step; one row of throttles per step."""
    rows = []
    for throttle in throttles:
        unit.step(h, {"throttle": throttle})
        rows.append(unit.get("thrust"))
    return np.array(rows)


def pulse(ticks, total, i=12):
    """One thruster on for the first ticks of all."""
    throttles = np.zeros((total, 16))
    throttles[:ticks, i] = 1
    return throttles


# ---- lag and impulse


@pytest.mark.parametrize("ticks", [1, 2, 3, 7, 20])
def test_impulse_of_a_pulse_is_the_closed_form(fmu, ticks):
    """B.6: sum of the two geometric series; 400 ticks of decay leave (6/7)^400 < 1e-26."""
    unit = fmu("propulsion", {"Tl": 0})
    simulate(unit, pulse(ticks, ticks + 400))
    a, P = 0.1 / 0.3, 50
    reached = P * (1 - (1 - a) ** ticks)
    expected = P * (ticks * 0.1 - (0.3 - 0.1) * (1 - (1 - a) ** ticks)) + reached * (0.7 - 0.1)
    assert unit.get("impulse")[12] == pytest.approx(expected, rel=1e-9)


def test_exact_lag_follows_the_exponentials(fmu):
    unit = fmu("propulsion", {"Tl": 0, "exact_lag": 1})
    thrust = simulate(unit, pulse(9, 30))[:, 12]
    t = 0.1 * np.arange(1, 31)
    rise, top = 50 * (1 - np.exp(-t / 0.3)), 50 * (1 - np.exp(-0.9 / 0.3))
    assert thrust == pytest.approx(
        np.where(t < 0.95, rise, top * np.exp(-(t - 0.9) / 0.7)), rel=1e-13
    )


@pytest.mark.parametrize(
    "lag", [{"T2up": 0.0999, "T2dn": 0.0999}, {"T2up": 0, "T2dn": 0, "exact_lag": 1}]
)
def test_time_constants_below_the_call_period_act_at_once(fmu, lag):
    thrust = simulate(fmu("propulsion", {"Tl": 0} | lag), pulse(2, 4))[:, 12]
    assert thrust.tolist() == [50, 50, 0, 0]


def test_rise_uses_one_constant_and_fall_the_other(fmu):
    """Also when the command falls from full to part: the delayed command is not 0, so the rise
    constant acts.
    """
    throttles = np.zeros((3, 16))
    throttles[:, 12] = 1, 0.2, 0
    thrust = simulate(fmu("propulsion", {"Tl": 0}), throttles)[:, 12]
    first = 50 / 3
    second = first + (10 - first) / 3
    assert thrust == pytest.approx([first, second, second * 6 / 7], rel=1e-14)


# ---- delay


@pytest.mark.parametrize("ticks", [0, 1, 2, 3, 7])
def test_first_force_comes_exactly_after_the_delay(fmu, ticks):
    """Tl = 0.3 s is 2.9999999999999996 calls: the division must not cost a tick."""
    unit = fmu("propulsion", {"Tl": ticks * 0.1, "T2up": 0, "T2dn": 0})
    thrust = simulate(unit, pulse(20, 40))[:, 12]
    assert thrust.tolist() == [0] * ticks + [50] * 20 + [0] * (20 - ticks)


@each("delay", [1, 2, 5])
@each("ticks", [1, 2, 3, 5, 6])
def test_commands_that_do_not_outlast_the_delay_are_rejected(fmu, delay, ticks):
    """A command shorter than Tl/T0 + 1 ticks leaves no trace; one of that length or longer passes
    with its length.
    """
    unit = fmu("propulsion", {"Tl": delay * 0.1, "T2up": 0, "T2dn": 0})
    thrust = simulate(unit, pulse(ticks, 20))[:, 12]
    assert np.count_nonzero(thrust) == (ticks if ticks > delay else 0)


def test_short_gaps_are_rejected_too(fmu):
    throttles = np.zeros((12, 16))
    throttles[:, 12] = [1, 1, 1, 0, 0, 1, 1, 1, 0, 0, 0, 0]
    thrust = simulate(fmu("propulsion", {"Tl": 0.2, "T2up": 0, "T2dn": 0}), throttles)[:, 12]
    assert (thrust > 0).tolist() == [False] * 2 + [True] * 8 + [False] * 2


def test_latch_samples_the_command_every_third_call(fmu):
    """Tl = 2 T0: the input at the calls 2, 5, 8, ... is delivered for three calls, however short it
    was.
    """
    throttles = np.zeros((12, 16))
    throttles[:, 12] = [1, 0, 1, 0, 1, 0, 0, 0, 1, 1, 1, 1]
    thrust = simulate(fmu("propulsion", {"Tl": 0.2, "T2up": 0, "T2dn": 0, "latch": 1}), throttles)[
        :, 12
    ]
    assert (thrust > 0).tolist() == [False] * 2 + [True] * 3 + [False] * 3 + [True] * 4


@pytest.mark.parametrize(
    "options", [{}, {"latch": 1}, {"exact_lag": 1}, {"Tl": 0.3}, {"Tl": 0.25, "T2dn": 0.05}]
)
def test_thrust_impulse_and_switches_follow_the_recursion_of_the_reference(fmu, rng, options):
    """The reference's recursion with random flags of random length; 1e-12 covers exp of two
    libraries.
    """
    flags = np.repeat(rng.integers(0, 2, (60, 13)), rng.integers(1, 6, 60), axis=0)
    unit, p = fmu("propulsion", options), relay.Parameters(brake=10, main=50, **options)
    reference, same = relay.Engines(p), 1e-12 if "exact_lag" in options else 0
    for row in flags:
        F, M = reference.call(row.tolist())
        unit.step(T0, {"throttle": [*row, 0, 0, 0]})
        assert unit.get("thrust")[:13] == pytest.approx(reference.thrust, rel=same, abs=0)
        close(unit.get("F_S"), F, rel=1e-14, of=p.main)
        close(unit.get("M_S"), M, rel=1e-14, of=p.main)  # arms of up to 1 m
    assert unit.get("impulse")[:13] == pytest.approx(reference.impulse, rel=same, abs=0)
    assert unit.get("switches")[:13].tolist() == reference.switches


# ---- wrench

# docs/models.md B.6, torque about the centre of mass of P1..P8 in N m
TORQUE = [
    (0, 0, 0.5),
    (0, -0.5, 0),
    (0, 0, -0.5),
    (0, 0.5, 0),
    (-0.5, 0, 0),
    (0.5, 0, 0),
    (-0.5, 0, 0),
    (0.5, 0, 0),
]


@pytest.mark.parametrize("i", range(8))
def test_torque_table_of_the_attitude_thrusters(fmu, i):
    unit = fmu("propulsion", PROMPT)
    unit.step(T0, only(i))
    assert unit.get("M_S") == pytest.approx(TORQUE[i], abs=1e-15)
    assert np.linalg.norm(unit.get("F_S")) == pytest.approx(0.5, abs=1e-15)


@pytest.mark.parametrize(
    ("engines", "force", "torque"),
    [
        ((5, 7), (0, 0, 0), (1, 0, 0)),
        ((4, 6), (0, 0, 0), (-1, 0, 0)),
        ((3,), (0, 0, 0.5), (0, 0.5, 0)),
        ((1,), (0, 0, -0.5), (0, -0.5, 0)),
        ((0,), (0, -0.5, 0), (0, 0, 0.5)),
        ((2,), (0, 0.5, 0), (0, 0, -0.5)),
        ((8, 9, 10, 11), (-40, 0, 0), (0, 0, 0)),
        ((12,), (50, 0, 0), (0, 0, 0)),
    ],
)
def test_switched_thrusters_give_force_and_torque_of_the_table(fmu, engines, force, torque):
    unit = fmu("propulsion", PROMPT)
    unit.step(T0, {"throttle": [i in engines for i in range(16)]})
    assert unit.get("F_S") == pytest.approx(force, abs=1e-14)
    assert unit.get("M_S") == pytest.approx(torque, abs=1e-14)


def test_torque_is_lever_cross_force_about_the_centre_of_mass(fmu, rng):
    position, centre = rng.uniform(-2, 2, (16, 3)), rng.uniform(-0.5, 0.5, 3)
    direction = np.array([random_direction(rng) for _ in range(16)])
    nominal, throttle = rng.uniform(0.1, 20, 16), rng.uniform(0, 1, 16)
    geometry = {
        "thruster_position": position,
        "thruster_direction": direction,
        "thrust_nominal": nominal,
    }
    unit = fmu("propulsion", PROMPT | geometry | {"centre_of_mass": centre})
    unit.step(T0, {"throttle": throttle})
    forces = (nominal * throttle)[:, None] * direction
    assert unit.get("F_S") == pytest.approx(forces.sum(axis=0), abs=1e-12)
    assert unit.get("M_S") == pytest.approx(
        np.cross(position - centre, forces).sum(axis=0), abs=1e-12
    )


def test_throttle_is_clipped_to_its_range(fmu):
    unit = fmu("propulsion", PROMPT)
    unit.step(T0, {"throttle": np.linspace(-1, 2, 16)})
    close(unit.get("thrust"), np.clip(np.linspace(-1, 2, 16), 0, 1) * PAPER, rel=1e-15)


def test_mass_flow_is_thrust_over_exhaust_velocity(fmu):
    unit = fmu("propulsion", {"Tl": 0, "Isp": 220})
    for throttle in pulse(5, 60):
        unit.step(T0, {"throttle": throttle})
        assert unit.get("mdot") == pytest.approx(unit.get("thrust").sum() / (220 * G_0), rel=1e-14)


# ---- grid of calls


def test_thrust_trace_does_not_depend_on_how_finely_a_master_steps(fmu, rng):
    """The same commands at the ticks, communication steps of 0.1, 0.05, 0.02, 0.1/3 s: all outputs
    equal there.
    """
    flags = np.repeat(rng.integers(0, 2, (30, 16)), rng.integers(1, 5, 30), axis=0)
    units = {parts: fmu("propulsion", {"Isp": 200}) for parts in (1, 2, 5, 3)}
    for k, row in enumerate(flags):
        for parts, unit in units.items():
            unit.set({"throttle": row})
            for j in range(parts):
                unit.slave.doStep((k + j / parts) * T0, T0 / parts)
        assert len({bits(unit) for unit in units.values()}) == 1


def test_many_calls_in_one_step_are_the_same_calls(fmu):
    one, many = fmu("propulsion"), fmu("propulsion")
    for i in (12, 3, 9):
        one.step(1.7, only(i))
        for _ in range(17):
            many.step(T0, only(i))
        assert bits(one) == bits(many)


def test_a_call_reads_the_input_of_the_step_it_falls_in_and_thrust_is_held_in_between(fmu):
    """Calls at 0, 0.1, 0.2: communication points at 0.05 and 0.13 change nothing before the next
    call.
    """
    unit = fmu("propulsion", PROMPT)
    unit.step(0.05, only(12))
    assert unit.get("thrust")[12] == 50
    unit.step(0.04, only(12, 0))
    assert unit.get("thrust")[12] == 50
    unit.step(0.04, only(12, 0))
    assert unit.get("thrust")[12] == 0
    unit.step(0.06, only(12))
    assert unit.get("thrust")[12] == 0
    unit.step(0.05, only(12))
    assert unit.get("thrust")[12] == 50
    assert unit.get("impulse")[12] == pytest.approx(10, abs=1e-14)


def test_before_the_first_call_there_is_no_thrust(fmu):
    unit = fmu("propulsion", PROMPT | {"Isp": 200}, only(12))
    assert all(np.all(value == 0) for value in unit.outputs().values())


# ---- counters


def test_switches_count_rising_edges_of_the_command_even_if_the_delay_rejects_it(fmu):
    unit = fmu("propulsion", {"Tl": 0.2})
    throttles = np.zeros((10, 16))
    throttles[:, 4] = [1, 0, 1, 1, 0, 0, 1, 0, 0, 1]
    simulate(unit, throttles)
    assert unit.get("switches")[4] == 4


# ---- faults


@pytest.mark.parametrize(
    ("fault", "before", "after"),
    [(0, (0, 50), (0, 50)), (1, (0, 50), (50, 50)), (2, (0, 50), (0, 0)), (3, (0, 50), (0, 15))],
)
def test_fault_from_its_time_on_leaves_the_other_thrusters_alone(fmu, fault, before, after):
    """Thrust with throttle 0 and 1 before and from the time of the fault."""
    faults = {
        "fault_kind": only(12, fault)["throttle"],
        "fault_factor": [0.3] * 16,
        "fault_time": [1.0] * 16,
    }
    for throttle in (0, 1):
        unit = fmu("propulsion", PROMPT | faults)
        command = only(12, throttle)["throttle"] + only(5)["throttle"]
        thrust = simulate(unit, [command] * 20)
        assert thrust[:, 12].tolist() == [before[throttle]] * 10 + [after[throttle]] * 10
        assert thrust[:, 5].tolist() == [0.5] * 20


def test_thruster_that_sticks_still_rises_and_falls_with_its_lag(fmu):
    fault = {"fault_kind": only(12, 1)["throttle"], "fault_time": [0.5] * 16}
    thrust = simulate(fmu("propulsion", {"Tl": 0.1} | fault), np.zeros((10, 16)))[:, 12]
    assert thrust == pytest.approx(
        [0] * 5 + [50 * (1 - (2 / 3) ** n) for n in range(1, 6)], rel=1e-14
    )


# ---- rejections


@pytest.mark.parametrize(
    ("parameters", "rule"),
    [
        (
            {"thruster_direction": [[0, -1.1, 0]] + [[1, 0, 0]] * 15},
            "|thruster_direction[1]| = 1.1: must be a unit vector",
        ),
        ({"thruster_direction": [[0, 0, 0]] + [[1, 0, 0]] * 15}, "must be a unit vector"),
        ({"thrust_nominal": [-0.5] * 16}, "thrust_nominal[1] = -0.5: must be >= 0"),
        ({"T0": 0}, "T0 = 0: must be > 0"),
        ({"T0": -0.1}, "T0 = -0.1: must be > 0"),
        ({"Tl": -0.1}, "Tl = -0.1: must be >= 0"),
        ({"T2up": -1}, "T2up = -1: must be >= 0"),
        ({"fault_kind": [0.5] * 16}, "fault_kind[1] = 0.5: must be 0, 1, 2 or 3"),
        ({"fault_kind": [4] * 16}, "fault_kind[1] = 4: must be 0, 1, 2 or 3"),
        ({"fault_factor": [1.5] * 16}, "fault_factor[1] = 1.5: must be in [0, 1]"),
        ({"latch": 2}, "latch = 2: must be 0 or 1"),
    ],
)
def test_bad_parameters_are_rejected_with_the_rule(tmp_path, parameters, rule):
    assert rule in rejection("propulsion", parameters, tmp_path)


def test_rows_of_thrusters_that_do_not_exist_may_hold_anything(fmu):
    """Nominal thrust 0: the direction is not looked at, the throttle does nothing."""
    unit = fmu("propulsion", PROMPT)
    unit.step(T0, only(15))
    assert unit.get("thrust")[15] == 0
    assert unit.get("F_S").tolist() == [0, 0, 0]
