# SPDX-License-Identifier: BSD-2-Clause
"""docking_mechanism.fmu against its derivation in tests/reference/docking.py: geometry, loads, mean
wrench of the predicted motion, events one condition at a time, energies, rejections.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.spatial.transform import Rotation

from ..reference import docking as reference
from ..reference.docking import BROKEN, CONTACT, FREE, HARD, PARAMETERS, RELEASED, SOFT, Bodies
from .cases import random_inertia
from .driver import Unit, bits
from .rejections import rejection

H = 0.01
FINE = 2.5e-5  # of the prediction: RK4 against DOP853 to 1e-10
LOADS = ("F_contact_S", "M_contact_S", "F_T", "M_T", "load_force", "load_moment", "energy_elastic")


def vary(rng, **given):
    """Bodies of any inertia, ports anywhere on them."""
    quaternions = {
        n: reference.quaternion(Rotation.random(random_state=rng)) for n in ("q_PS", "q_QT")
    }
    return PARAMETERS | quaternions | {
        "J_S": random_inertia(rng), "J_T": random_inertia(rng),
        "mass_S": 130.0, "mass_T": 75.0,
        "p_PS_S": rng.normal(size=3), "p_QT_T": rng.normal(size=3),
    } | given  # fmt: skip


def docked(p, rng, e, u=(0, 0, 0), w=(0, 0, 0), tilt=(0, 0, 0), *, rate=0.02, shift=True):
    """Bodies with the tip at e, moving with u (as seen in Q), turning with w, the probe turned by
    the rotation vector `tilt` (Q axes) from where it faces the drogue; T tumbles.
    """
    turn_T = Rotation.random(random_state=rng)
    omega_T = rate * rng.normal(size=3)
    Q_to_N = turn_T * reference.rotation(p["q_QT"])
    facing = Rotation.from_rotvec(np.pi * np.array((0, 0, 1)))
    P_to_N = Q_to_N * Rotation.from_rotvec(tilt) * facing
    turn_S = P_to_N * reference.rotation(p["q_PS"]).inv()
    w_T = turn_T.apply(omega_T)
    w_S = w_T + Q_to_N.apply(w)
    r_T = 1e6 * rng.normal(size=3) if shift else np.zeros(3)
    v_T = rng.normal(size=3)
    tip = r_T + turn_T.apply(p["p_QT_T"]) + Q_to_N.apply(e)
    r_S = tip - turn_S.apply(p["p_PS_S"])
    v_tip = v_T + np.cross(w_T, tip - r_T) + Q_to_N.apply(u)
    v_S = v_tip - np.cross(w_S, tip - r_S)
    return Bodies(
        {"S": r_S, "T": r_T},
        {"S": v_S, "T": v_T},
        {"S": turn_S, "T": turn_T},
        {"S": turn_S.inv().apply(w_S), "T": omega_T},
    )


@pytest.fixture
def mechanism(fmu):
    def instance(p, bodies, **inputs) -> Unit:
        values = {k: np.asarray(v) for k, v in p.items()}
        return fmu("docking_mechanism", values, bodies.inputs() | inputs)

    return instance


def deviation(found, expected):
    return np.max(np.abs(np.asarray(found) - expected)) / max(1e-3, np.max(np.abs(expected)))


def same_loads(unit, required, tolerance=1e-9):
    wrong = {name: deviation(unit.get(name), required[name]) for name in LOADS}
    return {name: error for name, error in wrong.items() if not error < tolerance}


# ---- 2.1 relative motion


def test_pose_of_the_ports_matches_the_bodies(mechanism, rng):
    """Before and after a step, at an orbit radius: 1e-9 m of 1e6 m."""
    p = vary(rng)
    e, u, w, tilt = rng.normal(size=(4, 3)) * [[3], [0.1], [0.02], [0.4]]
    b = docked(p, rng, e, u, w, tilt)
    unit = mechanism(p, b)
    for _ in range(2):
        assert np.allclose(unit.get("tip_Q"), e, atol=2e-9)
        assert np.allclose(unit.get("dtip_Q"), u, atol=1e-10)
        assert np.allclose(unit.get("omega_PQ_Q"), w, atol=1e-14)
        P_to_Q = Rotation.from_rotvec(tilt) * Rotation.from_rotvec((0, 0, np.pi))
        assert np.allclose(unit.get("q_PQ"), reference.quaternion(P_to_Q), atol=1e-14)
        axis = P_to_Q.apply((1, 0, 0))
        assert unit.get("misalignment") == pytest.approx(np.arccos(-axis[0]), abs=1e-12)
        assert unit.get("offset") == pytest.approx(np.hypot(*e[1:]), abs=2e-9)
        assert unit.get("phase") == FREE and not np.any(unit.get("F_T"))
        unit.step(H, b.inputs())


def test_velocity_of_the_tip_is_the_derivative_of_its_place_as_seen_in_the_drogue(mechanism, rng):
    p = vary(rng)
    b = docked(p, rng, rng.normal(size=3), rng.normal(size=3), 0.1 * rng.normal(size=3), rate=0.3)
    none = {"S": np.zeros(3), "T": np.zeros(3)}

    def tip(h):
        moved, _ = reference.motion(p, b, h, lambda *_: (none, none, ()))
        return reference.ports(p, moved).e

    d = 1e-3
    rate = (8 * (tip(d) - tip(-d)) - tip(2 * d) + tip(-2 * d)) / (12 * d)
    assert np.allclose(mechanism(p, b).get("dtip_Q"), rate, atol=1e-6)


# ---- 2.2 contact, 2.5 mean wrench


PLACES = {
    "wall": (-0.06, 0.041, 0.025),
    "wall, at the mouth": (-0.006, 0.08, 0.0),
    "rim": (-0.003, 0.09, 0.05),
    "floor": (-0.124, 0.002, -0.003),
    "wall and floor": (-0.122, -0.0055, 0.0098),
    "on the axis of a floor": (-0.125, 0.0, 0.0),
    "outside the disc": (-0.003, 0.2, 0.0),
    "in the hole": (-0.08, 0.01, 0.01),
    "too deep": (-0.06, 0.1, 0.0),
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("closing", [-1, 1])
def test_mean_wrench_of_a_contact(mechanism, rng, place, closing):
    """All outputs: force, both torques, energies; inside the material for the whole step, slow
    enough for a force all along (1 - 40 s/m of the speed > 0), so that nothing has a corner.
    """
    p = vary(rng, max_step=FINE)
    e = np.array(PLACES[place])
    u = closing * np.array((-0.009, 0.006, 0.004)) + (0, 0.008, -0.005)
    b = docked(p, rng, e, u, 0.01 * rng.normal(size=3), shift=False)
    unit = mechanism(p, b)
    unit.step(0.004, b.inputs())
    m = reference.Memory(CONTACT)
    required = reference.step(p, m, b, 0, 0.004)
    assert same_loads(unit, required) == {}
    assert unit.get("energy_dissipated") == pytest.approx(required["lost"], rel=1e-9, abs=1e-15)
    assert unit.get("energy_drive") == 0
    normal = reference.contact(p, *(getattr(reference.ports(p, b), x) for x in "eu"))[3]
    assert unit.get("normal_force") == pytest.approx(normal, rel=1e-9)
    assert unit.get("missed") == (place == "too deep")
    touching = bool(reference.contacts(p, e))
    assert unit.get("contact") == (unit.get("phase") == CONTACT) == touching
    assert (unit.get("load_force") > 0) == touching


@pytest.mark.parametrize("e", [(0.001, 1.5, 0.3), (-1.199, 0.0, 0.0)], ids=["face", "floor"])
def test_a_large_drogue_is_met_within_the_step(mechanism, rng, e):
    """More than 1 m from the centre of the mouth: on the face, and on the floor of a deep cone."""
    p = vary(rng, max_step=FINE, face_radius=4.0, cone_depth=1.2)
    b = docked(p, rng, np.array(e), (-0.5, 0.06, 0.04), shift=False)
    unit = mechanism(p, b)
    unit.step(0.004, b.inputs())
    required = reference.step(p, reference.Memory(FREE), b, 0, 0.004)
    assert same_loads(unit, required, 1e-4) == {} and unit.get("load_force") > 1


def test_friction_opposes_the_slip_and_retains_its_bound(mechanism, rng):
    """A slide along the floor with the bodies at rest; the mean of one short step."""
    p = PARAMETERS | {"friction": 0.3, "damping_contact": 0.0}
    for slip in (1e-5, 1e-3, 1e-1):
        direction = np.array((0, 0.6, -0.8))
        b = docked(p, rng, (-0.121, 0, 0), slip * direction, rate=0, shift=False)
        unit = mechanism(p, b)
        unit.step(1e-6, b.inputs())
        Q = reference.ports(p, b).Q_to_N.inv() * b.turn["S"]
        F = Q.apply(unit.get("F_contact_S"))
        normal = 1e5 * 0.001**1.5
        assert F[0] == pytest.approx(normal, rel=1e-3)
        rub = -0.3 * normal * slip / np.hypot(slip, 1e-3)
        assert F[1:] == pytest.approx(rub * direction[1:], rel=1e-3)
        assert np.hypot(*F[1:]) <= 0.3 * normal


def test_normal_force_never_pulls_and_what_stays_stored_is_lost(mechanism, rng):
    p = PARAMETERS | {"max_step": FINE}
    b = docked(p, rng, (-0.122, 0, 0), (0.1, 0, 0), rate=0, shift=False)  # 1 - 40*0.1 < 0
    unit = mechanism(p, b)
    stored = 1e5 * 0.002**2.5 / 2.5
    unit.step(H, b.inputs())
    assert unit.get("contact") == 1 and unit.get("normal_force") == 0
    assert unit.get("contact_force_peak") == 0 and not np.any(unit.get("F_contact_S"))
    left = 1e5 * 0.001**2.5 / 2.5  # after 1 mm
    assert unit.get("energy_elastic") == pytest.approx(left, rel=1e-6)
    assert unit.get("energy_dissipated") == pytest.approx(stored - left, rel=1e-6)


def test_a_centred_probe_without_friction_has_no_lateral_force(mechanism, rng):
    p = PARAMETERS | {"friction": 0.0}
    b = docked(p, rng, (-0.123, 0, 0), (-0.02, 0, 0), rate=0, shift=False)
    unit = mechanism(p, b)
    unit.step(H, b.inputs())
    F = unit.get("F_contact_S")
    assert F[0] < -1 and np.max(np.abs(F[1:])) < 1e-12
    assert np.max(np.abs(unit.get("M_contact_S"))) < 1e-12


def test_outputs_do_not_change_when_all_is_moved_and_turned(mechanism, rng):
    p = vary(rng)
    b = docked(p, rng, PLACES["wall"], (-0.02, 0.01, 0.03), tilt=(0.3, 0.1, 0.2), shift=False)
    other = b.moved(Rotation.random(random_state=rng), 7e6 * rng.normal(size=3))
    shown = []
    for each in (b, other):
        unit = mechanism(p, each)
        unit.step(H, each.inputs())
        shown.append(unit.outputs())
    for name, value in shown[0].items():
        size = max(1e-6, np.max(np.abs(value)))
        assert np.max(np.abs(shown[1][name] - value)) < 1e-5 * size, name


@pytest.mark.parametrize("place", ["wall", "floor"])
def test_latency_predicts_the_step_after_the_next_sample(mechanism, rng, place):
    """Two calls: the second carries the bodies with the wrench that the first has given out."""
    p = vary(rng, max_step=FINE, latency=1.0)
    b = docked(p, rng, PLACES[place], (-0.01, 0.005, 0), 0.01 * rng.normal(size=3), shift=False)
    unit, h, m = mechanism(p, b), 0.002, reference.Memory(CONTACT)
    held = (np.zeros(3),) * 3
    lost = 0.0
    for k in range(2):
        required = reference.step(p, m, b, k * h, h, held)
        unit.step(h, b.inputs())
        assert same_loads(unit, required) == {}
        held, lost = required["wrench"], lost + required["lost"]
        assert unit.get("energy_dissipated") == pytest.approx(lost, rel=1e-9)


def test_prediction_takes_equal_internal_steps_and_converges_with_their_fourth_power(
    mechanism, rng
):
    p = vary(rng, friction=0.0)
    b = docked(p, rng, (-0.125, 0.001, 0), (-0.01, 0, 0), shift=False)
    exact = reference.step(p, reference.Memory(CONTACT), b, 0, H)["M_T"]
    errors = []
    for max_step in (H / 4, H / 8, H / 8.5, H / 9):
        unit = mechanism(p | {"max_step": max_step}, b)
        unit.step(H, b.inputs())
        errors.append(np.max(np.abs(unit.get("M_T") - exact)))
    assert errors[0] / errors[1] == pytest.approx(16, rel=0.4)
    assert errors[2] == pytest.approx(errors[3], rel=1e-6)  # 8.5 is 9


# ---- 2.3 latch and release


def caught(mechanism, rng, p, tilt=(0.3, 0.02, -0.03), **more):
    """A mechanism that has just latched, with the bodies of that sample and its memory."""
    p = p | {"trip_force": 0.0, "latch_dwell": 0.0}
    b = docked(p, rng, (-0.118, 0.001, -0.002), (-0.004, 0.001, 0), (1e-3, -2e-3, 3e-3), tilt,
               shift=False, **more)  # fmt: skip
    unit = mechanism(p, b, latch_enable=1)
    unit.step(H, b.inputs())
    assert unit.get("phase") == SOFT and unit.get("soft") == 1
    return unit, b, reference.caught(p, reference.ports(p, b), SOFT, 0.0)


def test_mean_wrench_of_soft_capture_while_the_probe_is_drawn_in(mechanism, rng):
    """Rest attitude aligned by the shortest arc, roll as caught; rest point on its way."""
    p = vary(rng, draw_delay=0.005, draw_time=0.03, max_step=FINE)
    unit, b, m = caught(mechanism, rng, p)
    s = reference.ports(p, b)
    jump = reference.latch_energy(p, m, s.e, s.P_to_Q, 0)  # misaligned when it caught
    required = reference.step(p, m, b, 0, H)
    assert same_loads(unit, required) == {}
    lost, driven = required["lost"], required["driven"]
    for k in range(1, 5):
        b = required["end"]
        required = reference.step(p, m, b, k * H, H)
        unit.step(H, b.inputs())
        assert same_loads(unit, required) == {}
        lost, driven = lost + required["lost"], driven + required["driven"]
    assert unit.get("energy_dissipated") == pytest.approx(lost, rel=1e-9)
    assert unit.get("energy_drive") - jump == pytest.approx(driven, rel=1e-8)


def test_energy_jump_of_soft_capture_is_put_in_by_the_latch(mechanism, rng):
    p = vary(rng, max_step=FINE)
    unit, b, m = caught(mechanism, rng, p)
    s = reference.ports(p, b)
    rise = reference.latch_energy(p, m, s.e, s.P_to_Q, 0)
    required = reference.step(p, m, b, 0, H)
    assert rise > 1e-3
    assert unit.get("energy_drive") == pytest.approx(rise + required["driven"], rel=1e-9)
    assert unit.get("energy_dissipated") == pytest.approx(required["lost"], rel=1e-9)


def test_couple_is_the_gradient_of_the_stored_energy(rng):
    """Of the reference: dU for a small turn about each axis of Q; so M needs no sign by hand."""
    p = PARAMETERS | {"c_soft": 0.0, "c_rot_soft": 0.0}
    b = docked(p, rng, (-0.1, 0.01, 0.02), tilt=0.5 * rng.normal(size=3), shift=False)
    s = reference.ports(p, b)
    m = reference.Memory(SOFT, 0.0, np.array((-0.11, 0, 0)), Rotation.random(random_state=rng))

    def U(x):
        return reference.latch_energy(p, m, s.e + x[:3], Rotation.from_rotvec(x[3:]) * s.P_to_Q, 0)

    F, M = reference.latch(p, m, s, 0)[:2]
    assert np.allclose(-approx_fprime(np.zeros(6), U, 1e-7), np.r_[F, M], atol=1e-4)


def seated_at(p, rng, m, e=(0, 0, 0), u=(0, 0, 0), w=(0, 0, 0), turn=(0, 0, 0)):
    """Bodies off the seat by e and off the rest attitude by `turn` (a rotation vector)."""
    facing = Rotation.from_rotvec((0, 0, np.pi))
    tilt = (Rotation.from_rotvec(turn) * m.rest * facing.inv()).as_rotvec()
    return docked(p, rng, np.array((-p["cone_depth"], 0, 0)) + e, u, w, tilt, shift=False)


def quick(rng, **more):
    return vary(rng, draw_delay=0.004, draw_time=0.006, max_step=FINE, **more)


def test_mean_wrench_of_hard_capture_and_what_the_drawing_in_has_cost(mechanism, rng):
    p = quick(rng)
    unit, _, m = caught(mechanism, rng, p)
    b = seated_at(
        p, rng, m, (1e-3, -5e-4, 8e-4), (1e-3, 0, -1e-3), (1e-3, 0, 1e-3), (2e-3, 3e-3, -4e-3)
    )
    before = unit.get("energy_drive"), unit.get("energy_dissipated")
    unit.step(H, b.inputs())
    assert unit.get("phase") == HARD
    s = reference.ports(p, b)
    now = reference.Memory(HARD, H, m.e_c, m.rest)
    soft = reference.Memory(SOFT, 0.0, m.e_c, m.rest)
    required = reference.step(p, now, b, H, H)
    assert same_loads(unit, required) == {}
    jump = reference.latch(p, now, s, H)[2] - reference.latch(p, soft, s, H)[2]
    assert jump > 0
    assert unit.get("energy_drive") - before[0] == pytest.approx(jump, rel=1e-8)
    assert unit.get("energy_dissipated") - before[1] == pytest.approx(required["lost"], rel=1e-8)


OFF = {
    "distance": {"e": (0, 0.002, 0)},
    "angle": {"turn": (0, 0, 0.01)},  # of 4 tan(turn/4)
    "speed": {"u": (0, 0, 0.002)},
    "rate": {"w": (0.002, 0, 0)},
}


@pytest.mark.parametrize("condition", OFF)
def test_each_condition_of_hard_capture_alone_retains_the_latch_soft(mechanism, rng, condition):
    """A millionth inside and outside its limit."""
    p = quick(rng)
    for factor in (1 - 1e-6, 1 + 1e-6):
        unit, _, m = caught(mechanism, rng, p)
        off = {k: factor * np.array(v) for k, v in OFF[condition].items()}
        if "turn" in off:
            off["turn"] = 4 * np.arctan(off["turn"] / 4)
        unit.step(H, seated_at(p, rng, m, **off).inputs())
        assert unit.get("hard") == (factor < 1)


def test_the_draw_in_counts_from_soft_capture(mechanism, rng):
    p = vary(rng, draw_delay=0.015, draw_time=0.015)
    unit, _, m = caught(mechanism, rng, p)
    phases = []
    for _ in range(4):
        unit.step(H, seated_at(p, rng, m).inputs())
        phases.append(unit.get("phase"))
    assert phases == [SOFT, SOFT, HARD, HARD]


@pytest.mark.parametrize("phase", [SOFT, HARD])
def test_release_lets_go_and_the_spring_separates(mechanism, rng, phase):
    p = quick(rng)
    unit, b, m = caught(mechanism, rng, p)
    if phase == HARD:
        b = seated_at(p, rng, m)
        unit.step(H, b.inputs())
        assert unit.get("phase") == HARD
    b = seated_at(p, rng, m, (3e-4, 2e-4, 0), turn=(0, 1e-3, 0))
    before = unit.get("energy_drive"), unit.get("energy_dissipated")
    t = unit.time
    unit.step(H, b.inputs() | {"release": 1})
    assert unit.get("phase") == RELEASED
    s = reference.ports(p, b)
    now = reference.Memory(RELEASED, t, s.e, m.rest)
    required = reference.step(p, now, b, t, H)
    assert same_loads(unit, required) == {}
    held = reference.Memory(phase, 0.0 if phase == SOFT else H, m.e_c, m.rest)
    jump = 60 * 0.05**2 / 2 + reference.contact(p, s.e, s.u)[1] - reference.latch(p, held, s, t)[2]
    changes = unit.get("energy_drive") - before[0], unit.get("energy_dissipated") - before[1]
    assert changes[0] == pytest.approx(max(jump, 0), rel=1e-8)
    assert changes[1] == pytest.approx(max(-jump, 0) + required["lost"], rel=1e-8)


def test_a_released_mechanism_is_armed_again_only_outside_the_mouth(mechanism, rng):
    p = quick(rng)
    unit, _, m = caught(mechanism, rng, p)
    unit.step(H, seated_at(p, rng, m).inputs() | {"release": 1})
    x = -p["cone_depth"]
    for e_x, release, phase in (
        (x + 0.06, 0, RELEASED),  # past the stroke, inside
        (0.01, 1, RELEASED),  # outside, but still commanded to release
        (-1e-9, 0, RELEASED),
        (1e-9, 0, FREE),
        (x + 0.001, 0, SOFT),
    ):
        b = docked(p, rng, (e_x, 0, 0), shift=False)
        unit.step(H, b.inputs() | {"release": release})
        assert unit.get("phase") == phase


@pytest.mark.parametrize("limit", ["break_force", "break_moment"])
def test_the_latch_breaks_at_the_first_sample_after_a_load_above_the_limit(mechanism, rng, limit):
    p = quick(rng, **{limit: 60.0})
    unit, _, m = caught(mechanism, rng, p, tilt=(0.3, 0, 0))
    unit.step(H, seated_at(p, rng, m).inputs())
    assert unit.get("phase") == HARD
    far = seated_at(p, rng, m, (8e-3, 0, 0), turn=(8e-3, 0, 0))
    unit.step(H, far.inputs())
    assert (
        unit.get("phase") == HARD and unit.get("load_force") > 60 and unit.get("load_moment") > 60
    )
    lost = unit.get("energy_dissipated")
    unit.step(H, far.inputs() | {"release": 1})  # the break goes before the release
    assert unit.get("phase") == BROKEN and unit.get("broken") == 1
    now = reference.Memory(HARD, H, m.e_c, m.rest)
    s = reference.ports(p, far)
    stored = reference.latch(p, now, s, 0)[2] - reference.contact(p, s.e, s.u)[1]
    assert unit.get("energy_dissipated") - lost >= stored * (1 - 1e-9) > 0
    for e_x in (0.2, -0.11):
        unit.step(H, docked(p, rng, (e_x, 0, 0), shift=False).inputs())
        assert unit.get("phase") == BROKEN


# ---- 2.4 the window of the latch


WINDOW = {"e": (-0.115, 0.0, 0.0), "u": (0.0, 0.0, 0.0), "w": (0.0, 0, 0), "tilt": (0.0, 0, 0)}
EDGES = {
    "depth": ({"e": (-0.11, 0, 0)}, -1),
    "offset": ({"e": (-0.115, 0.012, 0.0)}, 1),
    "angle": ({"tilt": (0, 0.0873 * 0.6, 0.0873 * 0.8)}, 1),
    "speed": ({"u": (0.036, 0.048, 0)}, 1),
    "rate": ({"w": (0.021, 0, 0.028)}, 1),
}


@pytest.mark.parametrize("edge", EDGES)
def test_each_condition_of_the_window_alone_retains_the_latch_open(mechanism, rng, edge):
    """1e-9 of its limit outside and inside."""
    change, sign = EDGES[edge]
    p = PARAMETERS | {"trip_force": 0.0, "latch_dwell": 0.0, "latch_offset": 0.012}
    for side in (-1, 1):
        factor = 1 + 1e-9 * side
        moved = {k: np.array(v) * (factor if edge != "offset" else (1, factor, 1))
                 for k, v in change.items()}  # fmt: skip
        b = docked(p, rng, **WINDOW | moved, rate=0, shift=False)
        b.v = {x: v - b.v["T"] for x, v in b.v.items()}
        unit = mechanism(p, b, latch_enable=1)
        unit.step(H, b.inputs())
        assert unit.get("soft") == (side * sign < 0), (edge, side)


def test_a_latch_that_is_not_armed_stays_open(mechanism, rng):
    p = PARAMETERS | {"trip_force": 0.0, "latch_dwell": 0.0}
    b = docked(p, rng, **WINDOW, shift=False)
    unit = mechanism(p, b, latch_enable=0)
    unit.step(H, b.inputs())
    assert unit.get("phase") == FREE
    unit.step(H, b.inputs() | {"latch_enable": 1})
    assert unit.get("phase") == SOFT


def test_dwell_counts_from_the_first_sample_inside_and_anew_after_one_outside(mechanism, rng):
    p = PARAMETERS | {"trip_force": 0.0, "latch_dwell": 0.03}
    inside, outside = (docked(p, rng, (x, 0, 0), shift=False).inputs() for x in (-0.115, -0.1))
    unit = mechanism(p, docked(p, rng, (-0.1, 0, 0), shift=False), latch_enable=1)
    phases = []
    for b in (inside, inside, inside, outside, inside, inside, inside, inside):
        unit.step(H, b)
        phases.append(unit.get("phase"))
    assert phases == [FREE] * 7 + [SOFT]


def test_the_catch_must_be_struck_inside_the_window_and_forgets_a_blow_of_before(mechanism, rng):
    p = PARAMETERS | {"latch_dwell": 0.0, "trip_force": 3.0, "max_step": FINE}
    touch = docked(p, rng, (-0.1208, 0, 0), (-0.001, 0, 0), rate=0, shift=False)  # 2.4 N
    hit = docked(p, rng, (-0.1212, 0, 0), (-0.001, 0, 0), rate=0, shift=False)  # 4.3 N
    calm, out = (docked(p, rng, (x, 0, 0), rate=0, shift=False) for x in (-0.115, -0.1))
    unit = mechanism(p, touch, latch_enable=1)
    for b in (touch, touch, calm):
        unit.step(H, b.inputs())
        assert unit.get("phase") in (FREE, CONTACT)
    assert 2 < unit.get("contact_force_peak") < 3
    unit.step(H, hit.inputs() | {"latch_enable": 0})  # struck, but not armed: no window
    unit.step(H, out.inputs() | {"latch_enable": 1})
    unit.step(H, calm.inputs())
    assert unit.get("phase") == FREE
    unit.step(H, hit.inputs())
    assert unit.get("phase") == SOFT


def test_a_blow_between_two_samples_trips_too(mechanism, rng):
    """In and out of the floor within one step of 0.1 s: the samples see no force."""
    p = PARAMETERS | {"latch_dwell": 0.0, "latch_speed": 0.06, "k_contact": 1e6, "max_step": FINE}
    b = docked(p, rng, (-0.1195, 0, 0), (-0.03, 0, 0), rate=0, shift=False)
    unit = mechanism(p, b, latch_enable=1)
    unit.step(0.15, b.inputs())
    assert unit.get("phase") == FREE and unit.get("contact_force_peak") > 3
    assert unit.get("normal_force") == 0
    unit.step(0.15, docked(p, rng, (-0.118, 0, 0), (0.01, 0, 0), rate=0, shift=False).inputs())
    assert unit.get("phase") == SOFT


# ---- the rest


def test_it_samples_its_inputs_at_each_call_and_starts_with_nothing_but_the_pose(mechanism, rng):
    p = vary(rng)
    b = docked(p, rng, PLACES["floor"], (-0.02, 0, 0), shift=False)
    unit = mechanism(p, b)
    shown = unit.outputs()
    pose = {"tip_Q", "dtip_Q", "q_PQ", "omega_PQ_Q", "misalignment", "offset"}
    assert all(not np.any(value) for name, value in shown.items() if name not in pose)
    one, two = mechanism(p, b), mechanism(p, b)
    one.step(2 * H, b.inputs())
    two.step(H, b.inputs())
    two.step(H, b.inputs())
    assert bits(one) != bits(two)


def test_a_tip_a_metre_off_costs_no_prediction_and_gives_no_load(mechanism, rng):
    b = docked(PARAMETERS, rng, (1.5, 0.2, 0), (-0.5, 0, 0), shift=False)
    unit = mechanism(PARAMETERS, b)
    unit.step(1, b.inputs())  # met within the step: predicted
    assert unit.get("missed") == 1 or unit.get("contact_force_peak") >= 0
    far = docked(PARAMETERS, rng, (5.5, 0.2, 0), (-0.5, 0, 0), shift=False)
    unit.step(0.1, far.inputs())
    assert not np.any(unit.get("F_T")) and unit.get("energy_elastic") == 0


@pytest.mark.parametrize(
    ("parameter", "value", "rule"),
    [
        *((name, 0, "> 0") for name in (
            "mass_S", "mass_T", "mouth_radius", "floor_radius", "cone_depth", "face_radius",
            "depth_max", "k_contact", "n_contact", "k_soft", "k_rot_soft", "k_hard", "k_rot_hard",
            "draw_delay", "draw_time", "k_sep", "latch_depth", "max_step")),
        *((name, -1, ">= 0") for name in (
            "damping_contact", "friction", "friction_speed", "c_soft", "c_rot_soft", "c_hard",
            "c_rot_hard", "latch_offset", "latch_angle", "latch_speed", "latch_rate", "latch_dwell",
            "trip_force", "hard_distance", "hard_angle", "hard_speed", "hard_rate", "break_force",
            "break_moment", "stroke_sep")),
        ("mouth_radius", 0.01, "above floor_radius"),
        ("face_radius", 0.07, "mouth_radius"),
        ("latch_depth", 0.1401, "cone_depth"),
        ("latch_angle", 1.51, "1.5"),
        ("latency", 2, "0 or 1"),
        ("latency", 0.5, "0 or 1"),
        ("q_PS", (0, 0, 0, 0), "norm 0"),
        ("q_QT", (0, 0, 0, 0), "norm 0"),
        ("J_S", np.diag((1, 1, 3)), "triangle"),
        ("J_T", np.diag((1, -1, 3)), "positive definite"),
    ],
)  # fmt: skip
def test_bad_parameters_are_rejected(tmp_path, parameter, value, rule):
    reported = rejection("docking_mechanism", {parameter: value}, tmp_path)
    assert parameter in reported and rule in reported
