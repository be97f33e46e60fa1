# SPDX-License-Identifier: BSD-2-Clause
"""pursuit_guidance.fmu: required attitude and rate, speed laws, modes against an independent state
machine.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.close import close
from tests.each import each
from tests.reference import relay

from .cases import random_direction, random_rotation
from .rejections import rejection
from .theory import MU, dcm_of_quaternion, quaternion_of_dcm

T0 = 0.1
SCALAR, VECTOR = {"law": 0}, {"law": 1}
TWO_TURNS, SHORTEST_ARC = SCALAR | {"att": 0}, SCALAR | {"att": 1}
"""with the scalar law, which points at the target at all times"""
V_T = np.array([0.0, 0.008, 0.006])
COAST, ALIGN, BURN = 0, 1, 2
X = np.array([1.0, 0.0, 0.0])


def at_range(distance, along=X):
    return {"r_TN_N": distance * np.asarray(along), "r_SN_N": (0, 0, 0), "v_TN_N": V_T}


# ---- required attitude


def printed_matrix(d):
    """B.4.1 as printed: rows are the required body axes in ISK."""
    r, q = np.linalg.norm(d), np.hypot(d[1], d[2])
    cg, sg, cb, sb = d[0] / r, q / r, d[1] / q, d[2] / q
    return np.array([(cg, sg * cb, sg * sb), (-sg, cg * cb, cg * sb), (0, -sb, cb)])


def test_two_turns_are_the_printed_matrix(fmu, rng):
    for _ in range(50):
        d, C_SN = rng.normal(size=3), random_rotation(rng)
        unit = fmu(
            "pursuit_guidance", TWO_TURNS, at_range(100, d) | {"q_SN": quaternion_of_dcm(C_SN)}
        )
        assert dcm_of_quaternion(unit.get("q_DN")) == pytest.approx(printed_matrix(d), abs=1e-13)
        assert dcm_of_quaternion(unit.get("q_DS")) == pytest.approx(
            printed_matrix(d) @ C_SN.T, abs=1e-13
        )
        assert unit.get("q_DS")[0] >= 0


def test_initial_geometry_of_the_paper_starts_with_the_positive_half_turn(fmu):
    """b = 180 deg: the printed formulas divide 0 by 0; L = [0, cos(g/2), -sin(g/2), 0] is what drz
    > 0 continues.
    """
    g = np.arctan2(100, 500)
    unit = fmu("pursuit_guidance", TWO_TURNS, {"r_TN_N": (500, -100, 0), "v_TN_N": V_T})
    close(unit.get("q_DS"), [0, np.cos(g / 2), -np.sin(g / 2), 0], rel=1e-14)
    unit.step(T0, {"r_TN_N": (500, -100, 1e-6)})
    assert unit.get("q_DS") == pytest.approx([0, np.cos(g / 2), -np.sin(g / 2), 0], abs=1e-7)
    assert unit.get("q_DS")[0] > 0


@pytest.mark.parametrize(
    ("d", "rows"), [((1, 0, 0), np.eye(3)), ((-1, 0, 0), np.diag([-1, -1, 1]))]
)
def test_two_turns_along_the_axis_take_b_as_0(fmu, d, rows):
    unit = fmu("pursuit_guidance", TWO_TURNS, at_range(100, d))
    assert dcm_of_quaternion(unit.get("q_DN")) == pytest.approx(rows, abs=1e-15)


def test_shortest_arc_brings_the_axis_to_the_line_of_sight_without_roll(fmu, rng):
    for _ in range(50):
        d, C_SN = random_direction(rng), random_rotation(rng)
        unit = fmu(
            "pursuit_guidance", SHORTEST_ARC, at_range(100, d) | {"q_SN": quaternion_of_dcm(C_SN)}
        )
        L, gap = unit.get("q_DS"), np.arccos(C_SN[0] @ d)
        close(dcm_of_quaternion(unit.get("q_DN"))[0], d, rel=2e-14)
        assert L[1] == 0
        assert 2 * np.arctan2(np.linalg.norm(L[1:]), L[0]) == pytest.approx(gap, abs=1e-9)
        assert unit.get("pointing_angle") == pytest.approx(gap, abs=1e-9)


@pytest.mark.verifies("B.4-1")
@pytest.mark.parametrize(("d", "L"), [((1, 0, 0), (1, 0, 0, 0)), ((-1, 0, 0), (0, 0, 1, 0))])
def test_shortest_arc_of_a_target_straight_ahead_and_straight_behind(fmu, d, L):
    assert fmu("pursuit_guidance", SHORTEST_ARC, at_range(100, d)).get("q_DS") == pytest.approx(
        L, abs=0
    )


@pytest.mark.parametrize("offset", [1e-3, 1e-6, 1e-9, 1e-12, 1e-15])
def test_shortest_arc_next_to_straight_behind_goes_the_short_way_round(fmu, offset):
    """The half angle to the last bit: c = sin(offset)/2, although 1 + b1 has no digits left below
    1e-8.
    """
    unit = fmu("pursuit_guidance", SHORTEST_ARC, {"r_TN_N": (-49, 0, 49 * offset)})
    assert unit.get("q_DS") == pytest.approx(
        [np.arctan(offset) / 2, 0, -1, 0], abs=2e-16 + offset**2
    )


@pytest.mark.verifies("B.4-1")
def test_a_target_straight_behind_is_turned_to_at_every_range_and_attitude(fmu, rng):
    """Where 1 + b1 is rounding: once a target 49 m behind was taken for one ahead."""
    for distance in range(1, 1001, 13):
        assert fmu("pursuit_guidance", SHORTEST_ARC, at_range(distance, -X)).get("q_DS")[
            0
        ] == pytest.approx(0, abs=1e-15)
    for _ in range(40):
        C_SN = random_rotation(rng)
        state = at_range(100, -C_SN[0]) | {"q_SN": quaternion_of_dcm(C_SN)}
        q_DN = fmu("pursuit_guidance", SHORTEST_ARC, state).get("q_DN")
        close(dcm_of_quaternion(q_DN)[0], -C_SN[0], rel=2e-14)


@each(
    "q_SN", [(1, 0, 0, 0), (-1, 0, 0, 0), (0, 1, 0, 0), (0, -1, 0, 0), (0, 0, 0, 1), (0, 0, 0, -1)]
)
@each("d", [(500, -100, 0), (-500, -100, 0), (-1, -5, 0), (500, 0, 0), (-500, 0, 0)])
def test_half_a_turn_has_the_same_direction_for_either_sign_of_the_quaternion(fmu, d, q_SN):
    """L1 > 0, which the motion selects as soon as drz > 0; else L2 > 0, else L3 > 0."""
    L = fmu("pursuit_guidance", TWO_TURNS, {"r_TN_N": d, "q_SN": q_SN}).get("q_DS")
    other = fmu("pursuit_guidance", TWO_TURNS, {"r_TN_N": d, "q_SN": -np.array(q_SN)}).get("q_DS")
    assert L.tolist() == other.tolist()
    if L[0] == 0:
        assert L[1:][np.flatnonzero(L[1:])[0]] > 0


def test_half_a_turn_towards_a_target_behind_continues_the_motion(fmu):
    unit = fmu("pursuit_guidance", TWO_TURNS, {"r_TN_N": (-500, -100, 0), "v_TN_N": V_T})
    before = unit.get("omega_DN_D")
    unit.step(T0, {"r_TN_N": (-500, -100, 1e-6)})
    assert unit.get("omega_DN_D") == pytest.approx(before, abs=1e-9)


# ---- required rate


@pytest.mark.verifies("B.4-2")
@pytest.mark.parametrize("attitude", [TWO_TURNS, SHORTEST_ARC])
def test_rate_is_along_the_axis_of_the_transition_up_to_its_limit(fmu, rng, attitude):
    """The same components in servicer and reference axes, because the axis is the axis of the turn
    between them.
    """
    for _ in range(30):
        k_q, largest = rng.uniform(0.01, 0.1), rng.uniform(0.01, 0.1)
        parameters = attitude | {"k_q": k_q, "omega_max": largest}
        unit = fmu("pursuit_guidance", parameters, at_range(80, random_direction(rng)))
        L, omega_D = unit.get("q_DS"), unit.get("omega_DN_D")
        required = 2 * k_q * L[1:]
        required *= min(1, largest / np.linalg.norm(required))
        close(omega_D, required, rel=2e-14)
        close(dcm_of_quaternion(L).T @ omega_D, required, rel=2e-14)
        assert not unit.get("alpha_DN_D").any()  # a command, not a derivative
        assert not unit.get("ddrho_ref_N").any()


def test_rate_limit_0_is_none(fmu):
    unit = fmu(
        "pursuit_guidance", SHORTEST_ARC | {"k_q": 3, "omega_max": 0}, at_range(100, (0, 1, 0))
    )
    assert unit.get("omega_DN_D") == pytest.approx([0, 0, 6 * np.sin(np.pi / 4)])


# ---- scalar law


@pytest.mark.parametrize(
    ("distance", "formula", "text"),
    [
        (510, 2, 2),
        (50.001, 2, 2),
        (50, 0.5, 1),
        (30, 0.5, 1),
        (10.001, 0.5, 1),
        (10, 1, 1),
        (1, 1, 1),
    ],
)
def test_required_speed_of_the_scalar_law(fmu, distance, formula, text):
    for option, factor in ((0, formula), (1, text)):
        unit = fmu("pursuit_guidance", SCALAR | {"text_speed": option}, at_range(distance))
        assert unit.get("v_req") == pytest.approx(factor * 0.01, rel=1e-14)


@pytest.mark.verifies("B.4-3")
def test_range_hysteresis_of_the_scalar_law(fmu):
    """zeta1 = 50 m, 1 m to either side; the first sample has no memory."""
    unit, seen = fmu("pursuit_guidance", SCALAR | {"zhys": 1}, at_range(50.5)), []
    for distance in (50.5, 49.5, 49.0, 49.5, 50.5, 51.0, 51.001, 50.0, 49.001, 49.0):
        unit.step(T0, at_range(distance))
        seen.append(round(unit.get("v_req") / 0.01, 9))
    assert seen == [2, 2, 0.5, 0.5, 0.5, 0.5, 2, 2, 2, 0.5]


def test_scalar_law_commands_its_speed_along_the_thrust_axis(fmu, rng):
    """The error of the controller, (v_T + drho_ref - v_S).X, is v_req - v_S.X."""
    C_SN, v_S = random_rotation(rng), rng.normal(size=3)
    inputs = at_range(300, random_direction(rng)) | {"q_SN": quaternion_of_dcm(C_SN), "v_SN_N": v_S}
    unit = fmu("pursuit_guidance", SCALAR, inputs)
    assert (V_T + unit.get("drho_ref_N") - v_S) @ C_SN[0] == pytest.approx(
        0.02 - v_S @ C_SN[0], abs=1e-15
    )
    assert unit.get("translate") == 1
    assert unit.get("mode") == BURN


# ---- vector law


@pytest.mark.parametrize(
    ("distance", "closing"),
    [(510, 0.02), (60, 0.02), (58, 0.016), (50, 0), (48, -0.004), (45, -0.01), (5, -0.01)],
)
def test_closing_speed_of_the_vector_law(fmu, rng, distance, closing):
    """clip(2e-3 (range - 50), -|v_T|, 2 |v_T|) along the line of sight."""
    d, v_S = random_direction(rng), 0.01 * rng.normal(size=3)
    unit = fmu("pursuit_guidance", VECTOR, at_range(distance, d) | {"v_SN_N": v_S})
    assert unit.get("v_req") == pytest.approx(closing, abs=1e-14)
    assert unit.get("drho_ref_N") == pytest.approx(closing * d, abs=1e-14)
    assert unit.get("e_v_N") == pytest.approx(V_T + closing * d - v_S, abs=1e-14)
    close(unit.get("rho_ref_N"), -50 * d, rel=1e-14)
    assert unit.get("range") == pytest.approx(distance, rel=1e-14)


@pytest.mark.parametrize("turn", [0.0, np.pi / 2, 0.7, 4.0])
def test_in_orbit_the_speed_of_the_target_counts_relative_to_the_orbiting_point(fmu, turn):
    """Velocity of the point as the derivative of its place, 0.03 m/s more for the target."""
    R = 42164e3
    n = np.sqrt(MU / R**3)
    t = turn / n
    place = R * np.array([np.cos(turn), np.sin(turn), 0])
    velocity = np.cross([0, 0, n], place)
    unit = fmu("pursuit_guidance", VECTOR | {"mu": MU, "frame_radius": R, "k_r": 1}, start=t)
    inputs = {
        "r_TN_N": np.add(place, (500, 0, 0)),
        "r_SN_N": place,
        "v_TN_N": np.add(velocity, (0, 0, 0.03)),
        "v_SN_N": velocity,
    }
    unit.step(T0, inputs)
    assert unit.get("v_req") == pytest.approx(0.06, abs=1e-11)


def needs(error, **more):
    """Inputs with this velocity error at the hold range, where the closing speed is 0: e_v =
    -v_S.
    """
    return {
        "r_TN_N": (0, 50, 0),
        "v_TN_N": (0, 0, 0),
        "v_SN_N": -np.asarray(error, dtype=float),
    } | more


def modes(unit, *samples):
    seen = []
    for inputs in samples:
        unit.step(T0, {"omega_SN_S": (0, 0, 0), "translation_firing": 0, "F_S": (0, 0, 0)} | inputs)
        seen.append(int(unit.get("mode")))
        assert unit.get("translate") == (seen[-1] == BURN)
    return seen


def axis_wanted(unit):
    """X axis of the required attitude, N axes."""
    return dcm_of_quaternion(unit.get("q_DN"))[0]


def test_coast_aligns_at_rho2_and_returns_below_rho1(fmu):
    """The error is across the thrust axis, so no burn. Both thresholds and the band between them,
    where modes stay.
    """
    unit = fmu("pursuit_guidance", VECTOR)
    across = [needs((0, 0, e)) for e in (4.9e-3, 5e-3, 4.5e-3, 4e-3, 3.9e-3, 4.5e-3)]
    assert modes(unit, *across) == [COAST, ALIGN, ALIGN, ALIGN, COAST, COAST]


def test_a_velocity_error_of_zero_in_align_retains_the_axis(fmu):
    """Without a threshold for the return to coast the error may reach 0, which has no direction."""
    unit = fmu("pursuit_guidance", VECTOR | {"rho1": 0})
    assert modes(unit, needs((0, 0, 0.01)), needs((0, 0, 0)))[0] == ALIGN
    close(axis_wanted(unit), [1, 0, 0], rel=1e-14)


def test_axis_looks_at_the_target_in_coast_and_along_the_error_in_align(fmu):
    unit = fmu("pursuit_guidance", VECTOR)
    modes(unit, needs((0, 0, 1e-3)))
    close(axis_wanted(unit), [0, 1, 0], rel=1e-14)
    modes(unit, needs((0, 3e-2, 4e-2)))
    close(axis_wanted(unit), [0, 0.6, 0.8], rel=1e-14)


@pytest.mark.parametrize(
    ("cosine", "brakes"), [(-0.0099, False), (-0.0101, True), (-1, True), (0.5, False)]
)
def test_error_behind_the_axis_is_left_to_the_brakes(fmu, cosine, brakes):
    e = 0.01 * np.array([cosine, 0, np.sqrt(1 - cosine**2)])
    unit = fmu("pursuit_guidance", VECTOR)
    modes(unit, needs(e))
    assert axis_wanted(unit) == pytest.approx((-e if brakes else e) / 0.01, abs=1e-13)


def test_aligned_and_calm_coast_align_and_burn_are_passed_within_one_sample(fmu):
    assert modes(fmu("pursuit_guidance", VECTOR), needs((0.01, 0, 0))) == [BURN]


@pytest.mark.verifies("B.4-4")
@pytest.mark.parametrize(
    ("angle", "rate", "mode"), [(9.9, 1.9e-3, BURN), (10.1, 0, ALIGN), (0, 2.1e-3, ALIGN)]
)
def test_ignition_needs_pointing_and_calm(fmu, angle, rate, mode):
    e = 0.01 * np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle)), 0])
    assert modes(fmu("pursuit_guidance", VECTOR), needs(e, omega_SN_S=(0, 0, rate))) == [mode]


def test_burn_lasts_more_than_five_samples_and_ends_in_the_sixth(fmu):
    unit = fmu("pursuit_guidance", VECTOR)
    assert modes(unit, needs((0.01, 0, 0)), *[needs((1e-3, 0, 0))] * 6) == [BURN] * 6 + [COAST]
    close(axis_wanted(unit), [0, 1, 0], rel=1e-14)


@pytest.mark.verifies("B.4-5")
@pytest.mark.parametrize(
    ("obstacle", "mode"),
    [
        ({}, COAST),
        ({"translation_firing": 1}, BURN),
        ({"F_S": (0.051, 0, 0)}, BURN),
        ({"F_S": (0.049, 0.5, 0.5)}, COAST),
        ({"F_S": (0.05, 0, 0)}, COAST),
        ({"F_S": (-0.04, 0, 0)}, COAST),
        ({"F_S": (-0.041, 0, 0)}, BURN),
        ({"F_S": (-0.039, 0, 0)}, COAST),
    ],
)
def test_burn_continues_while_an_engine_fires_or_decays(fmu, obstacle, mode):
    """More than 1 % of 5 N ahead and of 4 N back; attitude thrust across does not count."""
    unit = fmu("pursuit_guidance", VECTOR)
    assert modes(unit, *[needs((0.01, 0, 0))] * 10, needs((1e-3, 0, 0)) | obstacle)[-1] == mode


def test_burn_continues_while_the_error_along_the_axis_is_large_and_retains_its_direction(fmu):
    unit = fmu("pursuit_guidance", VECTOR)
    samples = [needs((0.01, 1e-3 * k, -1e-3 * k)) for k in range(12)]
    first = np.array([0.01, 0, 0]) / 0.01
    assert modes(unit, *samples) == [BURN] * 12
    close(axis_wanted(unit), first, rel=1e-14)
    assert modes(unit, needs((4.9e-3, 0.5, 0.5))) == [COAST]


def test_modes_follow_the_reference_through_random_histories(fmu, rng):
    """Random walk of error, rate and engines through every transition; mode and direction at every
    sample.
    """
    p = relay.Parameters()
    unit, reference = fmu("pursuit_guidance", VECTOR), relay.Guidance(p)
    error, visited = np.zeros(3), set()
    for k in range(1500):
        error = 0.9 * error + 3e-3 * rng.normal(size=3) * [1, 0.3, 0.3]
        omega, firing = 1.2e-3 * rng.normal(size=3), bool(rng.random() < 0.3)
        push = 0.1 * rng.random() * (rng.random() < 0.2)
        before = reference.mode
        fires = firing or push > 0.05
        d = reference.modes(k, (0, 50, 0), tuple(error), (1, 0, 0), tuple(omega), fires)
        modes(unit, needs(error, omega_SN_S=omega, translation_firing=firing, F_S=(push, 0, 0)))
        assert unit.get("mode") == reference.mode
        assert axis_wanted(unit) == pytest.approx(relay.unit(d), abs=1e-13)
        visited.add((before, reference.mode))
    assert visited >= {(COAST, ALIGN), (ALIGN, COAST), (ALIGN, BURN), (COAST, BURN), (BURN, COAST)}


def test_samples_do_not_depend_on_how_finely_a_master_steps(fmu, rng):
    coarse, fine = (fmu("pursuit_guidance", VECTOR | {"sample_period": T0}) for _ in range(2))
    for k in range(60):
        inputs = needs((0.006 * rng.normal(), 0, 0), omega_SN_S=1e-3 * rng.normal(size=3))
        coarse.step(T0, inputs)
        fine.set(inputs)
        for j in range(4):
            fine.slave.doStep((k + j / 4) * T0, T0 / 4)
        assert all(np.array_equal(coarse.get(name), fine.get(name)) for name in coarse.kind.outputs)


def test_first_outputs_are_the_law_and_leave_no_memory(fmu):
    """Burning at the start; after it only an error inside the band, which coast alone ignores."""
    unit = fmu("pursuit_guidance", VECTOR, needs((0.01, 0, 0)))
    assert unit.get("mode") == BURN
    assert modes(unit, needs((4.5e-3, 0, 0))) == [COAST]


def test_turning_the_inertial_frame_turns_the_vectors_and_nothing_else(fmu, rng):
    """Shortest arc, vector law: the paper's two turns depend on the inertial axes by definition."""
    C_SN, R = random_rotation(rng), random_rotation(rng)
    inputs = {"r_TN_N": 60 * rng.normal(size=3), "v_TN_N": V_T, "v_SN_N": 0.02 * rng.normal(size=3)}
    one = fmu("pursuit_guidance", VECTOR, inputs | {"q_SN": quaternion_of_dcm(C_SN)})
    turned = {name: R @ value for name, value in inputs.items()} | {
        "q_SN": quaternion_of_dcm(C_SN @ R.T)
    }
    other = fmu("pursuit_guidance", VECTOR, turned)
    for name in ("drho_ref_N", "rho_ref_N", "e_v_N"):
        assert R @ one.get(name) == pytest.approx(other.get(name), abs=1e-12)
    for name in ("q_DS", "omega_DN_D", "mode", "range", "v_req", "pointing_angle"):
        assert one.get(name) == pytest.approx(other.get(name), abs=1e-12)


@pytest.mark.verifies("B.4-7")
def test_outputs_stay_finite_at_the_target(fmu):
    """Range 0 has no direction: the axis stays where it is."""
    for parameters in (SCALAR, VECTOR, TWO_TURNS):
        unit = fmu("pursuit_guidance", parameters, {"r_TN_N": (0, 0, 0), "v_TN_N": (0, 0, 0)})
        assert unit.get("q_DS").tolist() == [1, 0, 0, 0]


# ---- rejections


@pytest.mark.verifies("B.4-8")
@pytest.mark.parametrize(
    ("parameters", "rule"),
    [
        ({"rho1": 5e-3}, "rho1 = 0.005: must be below rho2"),
        ({"zeta2": 50}, "zeta2 = 50: must be below zeta1"),
        ({"zhys": 51}, "zhys = 51: must not be above zeta1"),
        ({"k_q": 0}, "k_q = 0: must be > 0"),
        ({"alpha_fire": 2}, "alpha_fire = 2: must be below 1.5 rad"),
        ({"law": 0, "mu": 4e14, "frame_radius": 4e7}, "law = 0: must be 1 when mu > 0"),
        ({"mu": 4e14}, "frame_radius = 0: must be > 0 when mu > 0"),
    ],
)
def test_bad_parameters_are_rejected_with_the_rule(tmp_path, parameters, rule):
    assert rule in rejection("pursuit_guidance", parameters, tmp_path)
