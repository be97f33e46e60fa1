# SPDX-License-Identifier: BSD-2-Clause
"""los_guidance.fmu against geometry: triad, published derivatives, camera frame, flags, what it
does not know.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy.spatial.transform import Rotation

from ..reference import los as reference
from .cases import ELEMENTS, random_bodies, random_direction, random_inertia, turned
from .los_cases import bodies, gathered
from .motion import deviation, stencil
from .theory import EARTH, dcm_of_quaternion, quaternion_of_dcm

MU = reference.Guidance().mu
H = 0.02  # s
SUN = np.array((0.3, 0.9, 0.3)) / np.linalg.norm((0.3, 0.9, 0.3))


def guided(fmu, u, p=None):
    """Outputs of one sample."""
    unit = fmu("los_guidance", p)
    unit.step(0.1, u)
    return gathered(unit.outputs())


def seen_at(r, v=(0, 0, 0)):
    """Inputs of a servicer that has the target at r from it, closing as r moves at v."""
    bodies = {
        "r_TN_N": np.array((7e6, 0, 0)),
        "v_TN_N": np.array((0, 7.5e3, 0)),
        "q_TN": (1, 0, 0, 0),
    }
    return bodies | {
        "r_SN_N": bodies["r_TN_N"] - r,
        "v_SN_N": bodies["v_TN_N"] - v,
        "q_SN": (1, 0, 0, 0),
    }


# ---- line of sight ----


@pytest.mark.parametrize("up_axis", [1, 2, 3])
def test_outputs_match_the_reference(fmu, rng, up_axis):
    """1e-11 relative: positions of 7e6 m leave 1e-9 m of 100 m."""
    u = random_bodies(rng, distance=60.0) | {"F_cmd_S": 50 * rng.normal(size=3)}
    p = {
        "J_T": random_inertia(rng),
        "p_T": random_direction(rng),
        "sun_N": rng.normal(size=3),
        "rho_f": 35.0,
    }
    p |= {"up_axis": up_axis, "force_scale": 80.0, "use_gravity_gradient": 1}
    out = guided(fmu, u, p)
    expected, _ = reference.guide(*bodies(u), u["F_cmd_S"], reference.Guidance(mu=MU, **p))
    for name, value in expected.items():
        if name == "q_DN":
            assert abs(abs(value @ out[name]) - 1) < 1e-12
        else:
            assert deviation(out[name], value, 1 + np.max(np.abs(value))) < 1e-11, name


@pytest.mark.parametrize("up_axis", [1, 2, 3])
def test_line_of_sight_round_trip(fmu, rng, up_axis):
    """Inputs given as LOS coordinates come back; 1e-9 m of cancellation in 7e6 m."""
    q = np.array((rng.uniform(5, 300), rng.uniform(-1.2, 1.2), rng.uniform(-3.1, 3.1)))
    dq = rng.normal(size=3) * (1, 0.02, 0.02)
    r, v = reference.inertial(q, dq, up_axis)
    out = guided(fmu, seen_at(r, v), {"up_axis": up_axis})
    assert deviation(out["los"], q, 1 + q[0]) < 1e-10
    assert deviation(out["dlos"], dq) < 1e-9


def test_round_trip_in_deep_space_is_exact_to_rounding(fmu, rng):
    """Near the origin of N nothing cancels: 1e-12."""
    q = np.array((rng.uniform(5, 300), rng.uniform(-1.2, 1.2), rng.uniform(-3.1, 3.1)))
    dq = rng.normal(size=3) * (1, 0.02, 0.02)
    r, v = reference.inertial(q, dq)
    u = {"r_TN_N": r, "v_TN_N": v, "r_SN_N": np.zeros(3), "v_SN_N": np.zeros(3)}
    out = guided(fmu, u, {"mu": 0})
    assert deviation(out["los"], q, q[0]) < 1e-14
    assert deviation(out["dlos"], dq) < 1e-13


@pytest.mark.parametrize(("up_axis", "first"), [(1, 2), (2, 0), (3, 1)])
def test_elevation_is_counted_from_the_plane_normal_to_up_and_azimuth_from_its_first_axis(
    fmu, up_axis, first
):
    up, start = np.eye(3)[up_axis - 1], np.eye(3)[first]
    out = guided(fmu, seen_at(100 * (np.cos(0.3) * start + np.sin(0.3) * up)), {"up_axis": up_axis})
    assert deviation(out["los"], (100, 0.3, 0)) < 1e-9
    quarter = guided(fmu, seen_at(100 * np.cross(up, start)), {"up_axis": up_axis})
    assert (
        abs(quarter["los"][2] - np.pi / 2) < 1e-9
    )  # positive about up, hence from +X towards -Z with Y up


def simulated(fmu, p_target=None, p=None, force=(20.0, -30.0, 10.0), steps=4):
    """Guidance samples while both bodies move as the software believes: no manoeuvre, the force it
    commanded.
    """
    orbit = (
        EARTH | ELEMENTS | {"mu": MU, "use_J2": 0, "use_gravity_gradient": 0, "max_step": H / 10}
    )
    target = fmu("target", orbit | {"omega_TN_T_0": (0.05, -0.08, 0.12)} | (p_target or {}))
    start = {"rho_0_H": (60, -80, 40), "drho_0_H": (-1, 2, 0.5), "sigma_SN_0": (0.1, 0.2, -0.1)}
    servicer = fmu(
        "servicer", orbit | start | {"omega_SN_S_0": (0, 0, 0), "J_S": np.diag((1e9, 1e9, 1e9))}
    )
    guidance, rows = fmu("los_guidance", p), []
    for _ in range(steps + 1):
        states = {name: target.get(name) for name in ("r_TN_N", "v_TN_N", "q_TN", "omega_TN_T")}
        states |= {name: servicer.get(name) for name in ("r_SN_N", "v_SN_N", "q_SN", "omega_SN_S")}
        guidance.step(H, states | {"F_cmd_S": force})
        rows.append(gathered(guidance.outputs()))
        target.step(H)
        servicer.step(H, {"F_S": force})
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def test_published_derivatives_are_derivatives(fmu):
    """Five-point stencil: h^4/30 of the fifth derivative, below 1e-9 of the rates; 1e-9 m/h of
    rounding in 7e6 m.
    """
    out = simulated(fmu)
    for value, rate, scale in (
        ("rho_ref_N", "drho_ref_N", 3.0),
        ("drho_ref_N", "ddrho_ref_N", 0.5),
        ("los", "dlos", 100.0),
        ("los_ref", "dlos_ref", 1.0),
        ("dlos_ref", "ddlos_ref", 0.1),
    ):
        assert deviation(stencil(out[value], H), out[rate][2], scale) < 3e-9, rate


def test_angular_rate_and_acceleration_match_the_camera_frame(fmu):
    """The frame from the quaternions, turned back to the middle sample; the orbit leaves 1e-9
    m/(100 m h) of noise.
    """
    out = simulated(fmu)
    C = [dcm_of_quaternion(q) for q in out["q_DN"]]
    turns = np.array([Rotation.from_matrix(C[2] @ c.T).as_rotvec() for c in C])
    assert deviation(stencil(turns, H), out["omega_DN_D"][2]) < 1e-8
    assert deviation(stencil(out["omega_DN_D"], H), out["alpha_DN_D"][2]) < 1e-8


def test_gravity_gradient_on_the_target_is_known_if_required(fmu):
    """Its torque 1e-6 rad/s2 times 20 m is far above the rounding of the stencil."""
    known = {"use_gravity_gradient": 1}
    out, ignorant = simulated(fmu, known, known), simulated(fmu, known)
    truth = stencil(out["drho_ref_N"], H)
    assert deviation(truth, out["ddrho_ref_N"][2]) < 1e-9
    assert deviation(truth, ignorant["ddrho_ref_N"][2]) > 1e-6


@pytest.mark.verifies("C.3-6")
def test_first_outputs_take_no_command_into_account(fmu, rng):
    """Nothing was commanded before the start, so start values that travel round the software loop
    settle at once.
    """
    u = random_bodies(rng, distance=60.0)
    still, pushed = (
        fmu("los_guidance", None, u | {"F_cmd_S": F}) for F in ((0, 0, 0), (100, 200, 300))
    )
    assert np.array_equal(still.get("alpha_DN_D"), pushed.get("alpha_DN_D"))
    pushed.step(0.1)
    assert not np.array_equal(still.get("alpha_DN_D"), pushed.get("alpha_DN_D"))


# ---- the frame D ----


@pytest.mark.verifies("C.3-1")
def test_camera_looks_along_the_line_of_sight_and_panels_lie_normal_to_the_sun(fmu, rng):
    u = random_bodies(rng, distance=60.0)
    out = guided(fmu, u)
    x, y, z = dcm_of_quaternion(out["q_DN"])
    r = u["r_TN_N"] - u["r_SN_N"]
    assert deviation(x, r / np.linalg.norm(r)) < 1e-12
    assert abs(y @ SUN) < 1e-12
    assert y @ np.cross(SUN, x) > 0  # the sign that is never left
    assert deviation(z, np.cross(x, y)) < 1e-12


def test_turning_the_whole_scene_turns_the_reference(fmu, rng):
    """Rates in axes D stay, vectors in N turn, the azimuth shifts when the turn is about up."""
    u, psi = random_bodies(rng, distance=60.0), rng.uniform(-1, 1)
    R = Rotation.from_rotvec((0, psi, 0)).as_matrix()
    out, moved = guided(fmu, u), guided(fmu, turned(u, R), {"sun_N": R @ SUN})
    for name in ("rho_ref_N", "drho_ref_N", "ddrho_ref_N"):
        assert deviation(moved[name], R @ out[name]) < 1e-10, name
    for name in ("omega_DN_D", "alpha_DN_D"):
        assert deviation(moved[name], out[name]) < 1e-10, name
    for name in ("los", "los_ref"):
        shift = moved[name] - out[name] - (0, 0, psi)
        assert np.max(np.abs(np.sin(shift / 2))) < 1e-9, (
            name
        )  # up to whole turns; range within 1e-9 m


@pytest.mark.verifies("C.3-3")
def test_quaternion_never_jumps_while_the_servicer_runs_around_the_target(fmu):
    """Two turns, 2 deg a sample; the positive-scalar quaternion would flip its sign."""
    unit, last, flips = fmu("los_guidance"), None, 0
    for a in np.radians(np.arange(0, 720, 2)):
        r = 50 * np.array((np.cos(a), 0.3, np.sin(a)))
        unit.step(0.1, seen_at(r))
        q = unit.get("q_DN")
        assert last is None or np.linalg.norm(q - last) < 0.1
        flips += q[0] < 0
        last = q
    assert flips > 0


def test_of_both_signs_of_a_quaternion_the_nearer_to_the_last_one_is_published(fmu, rng):
    """Also where the line of sight jumps to anywhere."""
    unit, last, signs = fmu("los_guidance"), None, set()
    for _ in range(60):
        unit.step(0.1, seen_at(100 * random_direction(rng)))
        q = unit.get("q_DN")
        assert last is None or q @ last > 0
        signs.add(np.sign(q[0]))
        last = q
    assert signs == {-1, 1}


@pytest.mark.verifies("C.3-2")
def test_near_the_sun_the_panel_axis_is_held(fmu):
    """The line of sight crosses the Sun 0.01 deg beside it: flagged, and y turns by no more than
    the line of sight.
    """
    across = np.cross(SUN, (0, 1, 0)) / np.linalg.norm(np.cross(SUN, (0, 1, 0)))
    side = np.cross(SUN, across)
    unit, axes = fmu("los_guidance", {"guard_angle": np.radians(2)}), []
    for a in np.radians(np.arange(-1.9, 1.9, 0.1)):
        unit.step(0.1, seen_at(100 * (SUN + a * across + np.radians(0.01) * side)))
        assert unit.get("attitude_guard") == 1
        axes.append(dcm_of_quaternion(unit.get("q_DN")))
    steps = [np.linalg.norm(b[1] - a[1]) for a, b in pairwise(axes)]
    assert max(steps) < np.radians(0.11)
    assert all(deviation(C @ C.T, np.eye(3)) < 1e-12 for C in axes)


@pytest.mark.verifies("C.3-2")
def test_held_panel_axis_is_the_one_before_the_guard(fmu):
    unit = fmu("los_guidance", {"guard_angle": np.radians(5)})
    beside = np.cross(SUN, (1, 0, 0))
    unit.step(0.1, seen_at(100 * (SUN + 0.1 * beside)))
    assert unit.get("attitude_guard") == 0
    before = dcm_of_quaternion(unit.get("q_DN"))[1]
    unit.step(0.1, seen_at(100 * SUN))
    assert unit.get("attitude_guard") == 1
    assert deviation(dcm_of_quaternion(unit.get("q_DN"))[1], before) < 1e-9


def test_a_line_of_sight_along_the_held_panel_axis_gets_another_one(fmu):
    """A guard of 69 deg and a first sample inside it, whose axis need not be normal to the Sun."""
    unit = fmu("los_guidance", {"guard_angle": 1.2, "sun_N": (0, 0, 1)})
    unit.step(0.1, seen_at(100 * np.array((np.sin(1.1), 0, np.cos(1.1)))))
    held = dcm_of_quaternion(unit.get("q_DN"))[1]
    unit.step(0.1, seen_at(100 * held))
    assert unit.get("attitude_guard") == 1
    C = dcm_of_quaternion(unit.get("q_DN"))
    assert deviation(C @ C.T, np.eye(3)) < 1e-12
    assert deviation(C[0], held) < 1e-9


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("axis", np.eye(3).tolist(), ids="xyz")
def test_a_first_sample_inside_the_guard_has_some_panel_axis(fmu, axis, sign):
    """Sun and target lie along one axis of N: there is no earlier axis to hold, and the one that is
    chosen has to be normal to the line of sight.
    """
    sight = sign * np.array(axis)
    found = guided(fmu, seen_at(100 * sight), {"sun_N": sight, "guard_angle": np.radians(5)})
    assert found["attitude_guard"] == 1
    C = dcm_of_quaternion(found["q_DN"])
    assert deviation(C @ C.T, np.eye(3)) < 1e-12
    assert deviation(C[0], sight) < 1e-12


# ---- flags, rejections ----


@pytest.mark.verifies("C.3-4")
@pytest.mark.parametrize(
    ("elevation", "rho", "flag"),
    [(79, 100, 0), (81, 100, 1), (-81, 100, 1), (0, 5.1, 0), (0, 4.9, 1)],
)
def test_poles_of_the_angles_and_closeness_are_flagged(fmu, elevation, rho, flag):
    r, _ = reference.inertial(np.array((rho, np.radians(elevation), 0.4)), np.zeros(3))
    assert guided(fmu, seen_at(r))["los_guard"] == flag


@pytest.mark.parametrize("rho", [0.05, 1e-3, 1e-9, 1e-140])
def test_closer_than_ten_centimetres_rates_are_those_at_ten_centimetres(fmu, rho):
    """Divisions are by at least 0.1 m: the reference turns no faster the nearer the target
    comes.
    """
    at, near = (
        {
            "r_TN_N": (0, 0, 0),
            "v_TN_N": (0, 0, 0),
            "q_TN": (1, 0, 0, 0),
            "r_SN_N": (-d, 0, 0),
            "v_SN_N": (0, -0.3, 0.4),
        }
        for d in (0.1, rho)
    )
    there, here = (guided(fmu, u | {"q_SN": (1, 0, 0, 0)}, {"mu": 0}) for u in (at, near))
    assert here["omega_DN_D"] == pytest.approx(there["omega_DN_D"], rel=1e-9)
    assert here["alpha_DN_D"] == pytest.approx(there["alpha_DN_D"], rel=1e-9)
    assert np.linalg.norm(here["omega_DN_D"]) == pytest.approx(5.0, rel=0.5)


@pytest.mark.verifies("C.3-4")
def test_a_desired_line_of_sight_near_the_pole_is_flagged_too(fmu):
    over = seen_at(np.array((100, 0, 0))) | {
        "q_TN": quaternion_of_dcm(Rotation.from_euler("z", -85, degrees=True).as_matrix())
    }
    assert guided(fmu, over)["los_guard"] == 1


def test_alignment_angles_vanish_on_the_axis_of_the_feature(fmu):
    """20 m in front of +X of the target, camera on it."""
    back = quaternion_of_dcm(np.diag((-1.0, -1.0, 1.0)))
    out = guided(fmu, seen_at(np.array((-20.0, 0, 0))) | {"q_SN": back})
    assert out["beta_t"] < 1e-9
    assert out["beta_p"] < 1e-9


@pytest.mark.verifies("C.3-5")
def test_a_range_of_zero_is_rejected(fmu):
    unit = fmu("los_guidance")
    with pytest.raises(FMICallException):
        unit.step(0.1, seen_at(np.zeros(3)))


@pytest.mark.verifies("C.3-8")
@pytest.mark.parametrize(
    "p",
    [
        {"rho_f": 0},
        {"p_T": (1, 1, 0)},
        {"sun_N": (0, 0, 0)},
        {"up_axis": 0},
        {"up_axis": 2.5},
        {"J_T": np.diag((1, 1, 3))},
    ],
    ids=lambda p: next(iter(p)),
)
def test_impossible_parameters_are_rejected(fmu, p):
    with pytest.raises(FMICallException):
        fmu("los_guidance", p)
