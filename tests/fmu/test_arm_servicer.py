# SPDX-License-Identifier: BSD-2-Clause
"""arm_servicer.fmu: against published reference values, point masses, `servicer`, `space_robot`,
and what must stay constant.
"""

from __future__ import annotations

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation

from ..reference import arm as reference
from .arm_cases import (
    BASE_CENTRE,
    FREE,
    SHIFT,
    SPACE,
    Published,
    iiwa,
    moving,
    random_arm,
)
from .cases import random_direction, spinning_servicer
from .driver import bits
from .motion import deviation, order_ratio, stencil
from .rejections import rejection
from .robot_cases import PAPER
from .theory import EARTH, MU, dcm_of_mrp, vee
from .theory import dcm_of_quaternion as matrix

ORBIT = EARTH | {"a": 7.1e6, "e": 0.001, "inc": 0.5, "argp": 1.0, "raan": 2.0, "nu": 0.6}


# ---- published reference values ----


def test_reference_has_the_published_mass_matrix_and_jacobian():
    """Point masses against Pinocchio and MuJoCo: the reference of the other tests here."""
    v, T, C = reference.Vehicle(iiwa(), Published.q), np.eye(13), Published.attitude.as_matrix()
    T[:6, :6] = SHIFT
    assert T.T @ v.H() @ T == pytest.approx(Published.H(), abs=1e-11)
    assert np.kron(np.eye(2), C) @ v.generalized_jacobian() == pytest.approx(
        Published.jacobian, abs=1e-11
    )


def test_joint_accelerations_match_published_values(fmu):
    unit = fmu("arm_servicer", Published.start(), FREE | {"joint_torque": Published.torque})
    assert unit.get("joint_accel") == pytest.approx(Published.ddq, abs=1e-10)


def test_start_has_the_published_energy_momentum_and_tip(fmu):
    """The published energy is the energy of the whole motion, ours the energy about C."""
    unit = fmu("arm_servicer", Published.start(), FREE)
    about_C = Published.energy - Published.momentum @ Published.momentum / 217.5 / 2
    assert unit.get("kinetic_energy") == pytest.approx(about_C, abs=1e-11)
    assert unit.get("h_N") == pytest.approx(Published.h, abs=1e-11)
    assert 217.5 * unit.get("v_CN_N") == pytest.approx(Published.momentum, abs=1e-11)
    assert unit.get("r_EN_N") == pytest.approx(Published.tip, abs=1e-11)
    assert unit.get("mass") == 217.5


def test_ten_seconds_match_published_values(fmu):
    """RK4 at 2 ms, as one of the two published integrations."""
    unit = fmu(
        "arm_servicer",
        Published.start() | {"max_step": 0.002},
        FREE | {"joint_torque": Published.small_torque},
    )
    for t, (root, w, q) in Published.recording.items():
        unit.step(t - unit.time)
        C = matrix(unit.get("q_SN"))
        assert unit.get("r_SN_N") - C.T @ BASE_CENTRE == pytest.approx(root, abs=1e-9)
        assert unit.get("omega_SN_S") == pytest.approx(w, abs=1e-9)
        assert unit.get("joint_angle") == pytest.approx(q, abs=1e-7)
    q_10 = np.roll(unit.get("q_SN"), -1)
    assert q_10 * np.sign(q_10[3]) == pytest.approx(Published.attitude_10, abs=1e-9)


def grasped(fmu, seconds):
    """Speeds after the published impulse, given as a load on E over a short time; body axes."""
    F, M = (Published.impulse / seconds).reshape(2, 3)
    unit = fmu("arm_servicer", Published.start() | {"max_step": seconds}, FREE)
    C_EN = matrix(unit.get("q_EN"))
    unit.step(seconds, {"F_contact_E": -C_EN @ F, "M_contact_E": -C_EN @ M})
    w = unit.get("omega_SN_S")
    v_root = matrix(unit.get("q_SN")) @ unit.get("v_SN_N") - np.cross(w, BASE_CENTRE)
    return np.concatenate((v_root, w, unit.get("joint_rate")))


def test_load_on_the_tip_gives_the_published_capture_impulse(fmu):
    """The limit of ever shorter loads: the error has whole powers of the duration."""
    long, middle, short = (grasped(fmu, seconds) for seconds in (4e-4, 2e-4, 1e-4))
    limit = (8 * short - 6 * middle + long) / 3
    expected = np.concatenate((Published.v_root_after, Published.w_after, Published.dq_after))
    assert limit == pytest.approx(expected, abs=1e-8)


def test_rigid_capture_has_the_published_impulse_momenta_and_energy():
    """The formula that the simulated impulse is compared with; twists at E, inertial axes. The
    speeds afterwards belong to the composite body: the projection of the motion before onto motions
    in which E and the target's point stay together, in the metric of the kinetic energy.
    """
    v, C = reference.Vehicle(iiwa(), Published.q), Published.attitude.as_matrix()
    R = C @ v.tip()[1] @ matrix(iiwa().q_EA)  # axes of link 7
    d = -R @ (0.1, -0.05, 0.6)  # E from the centre of the target
    J_t, M_t = np.eye(6), np.zeros((6, 6))
    J_t[:3, 3:] = np.cross(np.eye(3), -d)
    M_t[:3, :3], M_t[3:, 3:] = 100 * np.eye(3), R @ np.diag((20.0, 25, 15)) @ R.T
    u_t = np.array((0.05, 0.01, -0.02, 0.03, -0.05, 0.04))
    H, J, zero = v.H(), np.kron(np.eye(2), C) @ v.tip_columns(), np.zeros((13, 6))
    u = np.concatenate(
        (Published.v_root + np.cross(Published.w, BASE_CENTRE), Published.w, Published.dq)
    )
    impulse, after, after_t = reference.rigid_capture(H, J, M_t, J_t, u, u_t)
    assert impulse == pytest.approx(Published.impulse, abs=1e-11)
    assert after[:3] - np.cross(after[3:6], BASE_CENTRE) == pytest.approx(
        Published.v_root_after, abs=1e-11
    )
    assert after[3:6] == pytest.approx(Published.w_after, abs=1e-11)
    assert after[6:] == pytest.approx(Published.dq_after, abs=1e-11)
    both, M = np.concatenate((u, u_t)), np.block([[H, zero], [zero.T, M_t]])
    together = null_space(np.hstack((J, -J_t)))
    speeds = np.linalg.solve(together.T @ M @ together, together.T @ M @ both)
    assert np.concatenate((after, after_t)) == pytest.approx(together @ speeds, abs=1e-11)
    assert (C @ (H @ u)[:3] + 100 * u_t[:3]) == pytest.approx(
        C @ (H @ after)[:3] + 100 * after_t[:3], abs=1e-11
    )
    energy = [(a @ H @ a + b @ M_t @ b) / 2 for a, b in ((u, u_t), (after, after_t))]
    assert energy == pytest.approx((0.3776540949311389, 0.284070211961963), abs=1e-11)
    assert energy[0] - energy[1] == pytest.approx((J @ u - J_t @ u_t) @ impulse / 2, abs=1e-12)


# ---- point masses ----


def state(unit, n):
    names = ("r_SN_N", "v_SN_N", "q_SN", "omega_SN_S", "wheel_speed")
    joints = [unit.get(name)[:n] for name in ("joint_angle", "joint_rate")]
    return np.concatenate([unit.get(name) for name in names] + joints)


def same_attitude(y, other):
    """The same state with the sign of the quaternion of the other."""
    return np.concatenate((y[:6], y[6:10] * np.sign(y[6:10] @ other[6:10]), y[10:]))


A_W = np.diag((12.0, 15, 10))


@pytest.mark.parametrize("n", [2, 7])
def test_run_under_all_loads_matches_point_masses(fmu, rng, n):
    """Forces and torques on base and tip, joint torques, wheels, friction; full inertias. RK4 at 2
    ms against DOP853.
    """
    arm, p = random_arm(rng, n), moving(rng, n)
    F, M, F_E, M_E = rng.normal(size=(4, 3))
    tau, accel = rng.normal(size=7), 0.1 * rng.normal(size=3)
    rough = {"joint_damping": np.arange(7.0), "joint_friction": np.arange(7.0)[::-1]}
    rough |= {"friction_rate": 0.5}
    inputs = {"F_S": F / 2, "F_contact_S": F / 2, "M_S": M / 3, "M_contact_S": 2 * M / 3}
    inputs |= {"F_contact_E": F_E, "M_contact_E": M_E, "joint_torque": tau}
    p |= SPACE | arm.parameters() | rough | {"max_step": 0.002}
    unit = fmu("arm_servicer", p, FREE | inputs | {"wheel_accel_cmd": accel})
    held = reference.Loads(
        F,
        M,
        F_E,
        M_E,
        tau[:n],
        accel,
        A_W,
        *(r[:n] for r in (rough["joint_damping"], rough["joint_friction"])),
        0.5,
    )
    expected = reference.simulate(arm, state(unit, n), 0.2, held)
    unit.step(0.2)
    found = same_attitude(state(unit, n), expected)
    assert found == pytest.approx(expected, abs=1e-8)


def test_run_in_a_strong_gradient_matches_point_masses(fmu, rng):
    """A planet of small mass at 30 m: the gradient is of order one, the field at C and not at S."""
    arm, p, mu, n = random_arm(rng, 4), moving(rng, 4), 2700.0, 4
    p |= {"r_0_N": 30 * random_direction(rng), "use_gravity_gradient": 1, "use_J2": 0}
    p |= SPACE | arm.parameters() | {"mu": mu, "max_step": 0.005}
    unit = fmu("arm_servicer", p, FREE)
    nothing = reference.Loads(*np.zeros((4, 3)), np.zeros(n), np.zeros(3), A_W, *np.zeros((2, n)))
    expected = reference.simulate(arm, state(unit, n), 0.2, nothing, mu)
    unit.step(0.2)
    assert same_attitude(state(unit, n), expected) == pytest.approx(expected, abs=1e-8)


@pytest.mark.parametrize("n", [0, 2, 7])
def test_outputs_match_point_masses(fmu, rng, n):
    arm, p = random_arm(rng, n), moving(rng, n)
    unit = fmu("arm_servicer", SPACE | arm.parameters() | p, FREE)
    v = reference.Vehicle(arm, p["joint_angle_0"])
    C, w, dq = dcm_of_mrp(p["sigma_SN_0"]), p["omega_SN_S_0"], p["joint_rate_0"][:n]
    tip, R = v.tip()
    u = np.concatenate((np.zeros(3), w, dq))
    velocity, spin = np.split(v.tip_columns() @ u, 2)
    points = v.columns() @ u
    v_C = v.m @ points / v.m.sum()
    h = v.m @ np.cross(v.p - v.c, points - v_C) + A_W @ p["wheel_speed_0"]
    energy = (v.m @ ((points - v_C) ** 2).sum(axis=1) + arm.joint_inertia @ dq**2) / 2
    assert unit.get("r_CS_S") == pytest.approx(v.c, abs=1e-13)
    assert unit.get("v_CN_N") == pytest.approx(p["v_0_N"] + C.T @ v_C, abs=1e-13)
    assert unit.get("r_EN_N") == pytest.approx(p["r_0_N"] + C.T @ tip, abs=1e-13)
    assert unit.get("v_EN_N") == pytest.approx(p["v_0_N"] + C.T @ velocity, abs=1e-13)
    assert matrix(unit.get("q_EN")) == pytest.approx(R.T @ C, abs=1e-13)
    assert unit.get("omega_EN_E") == pytest.approx(R.T @ spin, abs=1e-13)
    assert unit.get("h_N") == pytest.approx(C.T @ h, abs=1e-12)
    assert unit.get("kinetic_energy") == pytest.approx(energy, abs=1e-12)
    assert unit.get("mass") == pytest.approx(v.m.sum(), abs=1e-12)
    assert list(unit.get("joint_angle")[n:]) == list(unit.get("joint_rate")[n:]) == [0] * (7 - n)


# ---- `servicer`, `space_robot` ----


@pytest.mark.parametrize("frozen", [False, True])
def test_without_joints_it_is_the_servicer(fmu, rng, frozen):
    """In orbit, under every load and disturbance, before and after t_att."""
    wave = {"bias": (1e-3, 2e-3, -1e-3), "amplitude": (2e-3, 0, 1e-3), "frequency": (0.3, 1, 0.2)}
    p = ORBIT | spinning_servicer(rng) | {"a": 7.1e6, "mu": MU, "use_gravity_gradient": 1}
    p |= {"M_dist_S": wave, "a_dist": wave, "a_dist_axes": 1, "wheel_speed_max": 2.5}
    p |= {"wheel_accel_max": 0.05, "t_att": 2.0 * frozen, "velocity_follows_attitude": 1}
    units = fmu("servicer", p), fmu("arm_servicer", p | {"joints": 0})
    for _ in range(40):
        F, M, F_c, M_c, accel = rng.normal(size=(5, 3))
        inputs = {"F_S": F, "M_S": M, "F_contact_S": F_c, "M_contact_S": M_c, "mdot": 0.01}
        for unit in units:
            unit.step(0.1, inputs | {"wheel_accel_cmd": 0.1 * accel})
        for name, size in (
            *(("r_SN_N", 7e6), ("v_SN_N", 7e3), ("q_SN", 1), ("omega_SN_S", 1)),
            *(("sigma_SN", 1), ("wheel_speed", 1), ("mass", 100)),
        ):
            assert deviation(units[1].get(name), units[0].get(name), size) < 1e-14


def locked_body(arm, q):
    """Mass, centre from S, inertia about S: a rigid body of H_00."""
    v = reference.Vehicle(arm, q)
    return v.m.sum(), v.c, v.H()[3:6, 3:6]


def test_locked_arm_turns_like_a_rigid_body_of_the_whole_inertia(fmu, rng):
    """Torque-free: w of `servicer` with the inertia about C; C moves straight."""
    arm, p = random_arm(rng, 5), moving(rng, 5)
    p["joint_rate_0"] = np.zeros(7)
    mass, c, inertia = locked_body(arm, p["joint_angle_0"])
    about_C = inertia - mass * (c @ c * np.eye(3) - np.outer(c, c))
    unit = fmu("arm_servicer", SPACE | arm.parameters() | p)
    same = {"mass_0": mass, "J_S": (about_C + about_C.T) / 2}
    rigid = fmu("servicer", SPACE | p_of_servicer(p) | same)
    before = unit.get("v_CN_N")
    for _ in range(20):
        unit.step(0.1)
        rigid.step(0.1)
        assert unit.get("omega_SN_S") == pytest.approx(rigid.get("omega_SN_S"), abs=1e-12)
        assert unit.get("v_CN_N") == pytest.approx(before, abs=1e-12)
    assert unit.get("joint_angle")[:5] == pytest.approx(p["joint_angle_0"][:5], abs=0)


def p_of_servicer(p):
    return {name: value for name, value in p.items() if not name.startswith("joint")}


SATELLITE = {"mu": 3.986004418e14, "a": 7.0e6, "e": 0, "inc": 0, "argp": 0, "raan": 0, "nu": 0}


def robot_arm():
    """The two links of the space robot: axes along z, along x at joint angle zero."""
    diag = [(PAPER.Ixx[k], PAPER.Iyy[k], PAPER.Izz[k]) for k in (1, 2)]
    base = np.diag((PAPER.Ixx[0], PAPER.Iyy[0], PAPER.Izz[0]))
    return reference.Arm(
        joint_axis=np.array([(0, 0, 1.0)] * 2),
        joint_offset=np.array([(1.0, 0, 0), (2.0, 0, 0)]),
        link_mass=np.array(PAPER.mass[1:]),
        link_centre=np.array([(1.0, 0, 0)] * 2),
        link_inertia=np.array(diag),
        link_products=np.zeros((2, 3)),
        joint_inertia=np.zeros(2),
        p_EA_A=np.array((2.0, 0, 0)),
        q_EA=np.array((1.0, 0, 0, 0)),
        mass_0=PAPER.mass[0],
        J_S=base,
    )


ANGLES = np.array((0.5235987755982988, 0.3490658503988659))


def beside_robot(fmu, euler, rates, dq, h=1.0, **inputs):
    """space_robot and arm_servicer in the same state on the same circular orbit, J2 off."""
    start = {"euler_0": euler, "deuler_0": rates, "joint_angle_0": ANGLES, "joint_rate_0": dq}
    robot = fmu("space_robot", start | {"max_step": h}, inputs | {"joint_lock": 0})
    torque = {"joint_torque": (*inputs.get("joint_torque", (0, 0)), 0, 0, 0, 0, 0)}
    arm = fmu(
        "arm_servicer",
        robot_arm().parameters()
        | {"a": 0, "mu": SATELLITE["mu"], "use_J2": 0, "use_gravity_gradient": 1, "max_step": h}
        | {"A_w": np.eye(3), "r_0_N": robot.get("r_SN_N"), "v_0_N": robot.get("v_SN_N")}
        | {"sigma_SN_0": Rotation.from_quat(np.roll(robot.get("q_SN"), -1)).as_mrp()}
        | {"omega_SN_S_0": robot.get("omega_SN_S")}
        | {"joint_angle_0": (*ANGLES, 0, 0, 0, 0, 0), "joint_rate_0": (*dq, 0, 0, 0, 0, 0)},
        FREE | inputs | torque,
    )
    return robot, arm


def test_two_links_have_the_accelerations_of_the_space_robot(fmu):
    """In three dimensions with gradient, force, torque and joint torques."""
    loads = {"F_S": (3, -2, 1), "M_S": (0.5, -0.3, 0.4), "joint_torque": (0.4, -0.2)}
    robot, arm = beside_robot(fmu, (0.1, -0.2, 0.3), (1e-3, -2e-3, 3e-3), (5e-3, -1e-2), **loads)
    assert arm.get("joint_accel")[:2] == pytest.approx(robot.get("joint_accel"), abs=1e-10)
    assert arm.get("h_N") == pytest.approx(robot.get("h_N"), abs=1e-7)


def test_two_links_with_free_joints_run_like_the_space_robot(fmu):
    """A tenth of an orbit in the plane: 1e-7 rad."""
    robot, arm = beside_robot(fmu, (0, 0, 0.3), (0, 0, 2e-3), (1e-3, -2e-3))
    for unit in (robot, arm):
        unit.step(580.0)
    assert arm.get("joint_angle")[:2] == pytest.approx(robot.get("joint_angle"), abs=1e-7)
    turned = matrix(arm.get("q_SN")) @ matrix(robot.get("q_SN")).T
    assert Rotation.from_matrix(turned).magnitude() < 1e-7
    assert arm.get("h_N") == pytest.approx(robot.get("h_N"), rel=1e-9)


# ---- constants of motion ----


def errors_of_momenta(fmu, h, seed=5):
    """4 s in deep space under joint torques, friction, wheels and a lock that closes at 2 s."""
    rng = np.random.default_rng(seed)
    arm, p = reference.DEFAULT, moving(rng, 7)
    p["joint_rate_0"] = 0.3 * p["joint_rate_0"]
    rough = {"joint_damping": 0.3, "joint_friction": 0.2, "friction_rate": 0.2}
    p |= {name: np.full(7, x) if name != "friction_rate" else x for name, x in rough.items()}
    unit = fmu("arm_servicer", SPACE | arm.parameters() | p | {"max_step": h}, FREE)
    v, h_N = unit.get("v_CN_N"), unit.get("h_N")
    for k in range(8):
        lock = (k >= 4, 0, 0, k >= 5, 0, 0, 0)
        torque, accel = 0.2 * rng.normal(size=7), 0.05 * rng.normal(size=3)
        unit.step(0.5, {"joint_torque": torque, "wheel_accel_cmd": accel, "joint_lock": lock})
    mass = arm.mass_0 + arm.link_mass.sum()
    return np.concatenate((mass * (unit.get("v_CN_N") - v), unit.get("h_N") - h_N))


def test_momenta_are_constant_without_external_load_to_fourth_order(fmu):
    coarse, fine = (np.abs(errors_of_momenta(fmu, h)).max() for h in (0.01, 0.005))
    assert coarse < 1e-8
    assert coarse / fine > 12


def test_joint_torques_do_the_work_that_the_kinetic_energy_gains(fmu, rng):
    """Constant torques: their work is torque times angle."""
    arm, p = random_arm(rng, 6), moving(rng, 6)
    tau = 0.5 * rng.normal(size=7)
    unit = fmu("arm_servicer", SPACE | arm.parameters() | p, FREE | {"joint_torque": tau})
    T, q = unit.get("kinetic_energy"), unit.get("joint_angle")
    unit.step(2.0)
    work = tau @ (unit.get("joint_angle") - q)
    assert unit.get("kinetic_energy") - T == pytest.approx(work, abs=1e-8)


def test_free_drift_on_a_circular_orbit_retains_jacobis_constant(fmu, rng):
    """T + V - n h_z, all seven joints free: V of the point masses in the published pose."""
    arm, p, n = random_arm(rng, 7), moving(rng, 7), np.sqrt(MU / 7.0e6**3)
    p |= arm.parameters() | {"mu": MU, "use_J2": 0, "use_gravity_gradient": 1, "max_step": 0.05}
    p |= {"r_0_N": (7.0e6, 0, 0), "v_0_N": (0, 7.0e6 * n, 0), "a": 0, "wheel_speed_0": (0, 0, 0)}
    slow = {name: 0.02 * p[name] for name in ("omega_SN_S_0", "joint_rate_0")}
    v = reference.Vehicle(arm, p["joint_angle_0"])
    C = dcm_of_mrp(p["sigma_SN_0"])
    dv = v.columns() @ np.concatenate(
        (np.zeros(3), *(x[: 7 if i else 3] for i, x in enumerate(slow.values())))
    )
    p |= slow
    p["r_0_N"] = (7.0e6, 0, 0) - C.T @ v.c
    p["v_0_N"] = (0, 7.0e6 * n, 0) - C.T @ (v.m @ dv / v.m.sum())
    unit = fmu("arm_servicer", p, FREE)

    def constant():
        v, C = reference.Vehicle(arm, unit.get("joint_angle")), matrix(unit.get("q_SN"))
        a = unit.get("r_SN_N") + C.T @ v.c
        x = (v.p - v.c) @ C
        a /= np.linalg.norm(a)
        V = n**2 * v.m @ ((x * x).sum(axis=1) - 3 * (x @ a) ** 2) / 2
        return unit.get("kinetic_energy") + V - n * unit.get("h_N")[2]

    before = constant()
    T = unit.get("kinetic_energy")
    unit.step(400)
    assert abs(unit.get("kinetic_energy") - T) > 1e-6
    assert constant() == pytest.approx(before, abs=1e-9)


def test_gradient_torque_is_the_rate_of_the_angular_momentum(fmu, rng):
    """dh_N/dt = sum x x f over the point masses, by central differences."""
    arm, p, h = random_arm(rng, 7), moving(rng, 7), 0.05
    p |= arm.parameters() | {"mu": MU, "use_J2": 0, "use_gravity_gradient": 1, "max_step": 0.01}
    p |= {"r_0_N": 7.0e6 * random_direction(rng), "a": 0}
    unit = fmu("arm_servicer", p, FREE)
    before = unit.get("h_N")
    unit.step(h)
    v, C = reference.Vehicle(arm, unit.get("joint_angle")), matrix(unit.get("q_SN"))
    r, x = unit.get("r_SN_N") + C.T @ v.c, (v.p - v.c) @ C
    a, g = r / np.linalg.norm(r), MU / np.linalg.norm(r) ** 3
    torque = g * v.m @ np.cross(x, 3 * np.outer(x @ a, a))
    unit.step(h)
    assert (unit.get("h_N") - before) / (2 * h) == pytest.approx(torque, abs=1e-7)
    assert np.linalg.norm(torque) > 1e-6


# ---- mass matrix ----


def test_joints_answer_torques_by_a_symmetric_positive_matrix_of_the_pose_alone(fmu, rng):
    """The block of H^-1 of the joints, by differences of accelerations: equal to the reference's
    for any attitude, rates and loads.
    """
    arm, q = random_arm(rng, 7), rng.uniform(-1, 1, 7)
    expected = np.linalg.inv(reference.Vehicle(arm, q).H())[6:, 6:]
    assert np.linalg.eigvalsh(expected).min() > 0
    for _ in range(3):
        p = SPACE | arm.parameters() | moving(rng, 7) | {"joint_angle_0": q}
        inputs = FREE | {"F_S": rng.normal(size=3), "F_contact_E": rng.normal(size=3)}
        rest = fmu("arm_servicer", p, inputs).get("joint_accel")
        found = [
            fmu("arm_servicer", p, inputs | {"joint_torque": e}).get("joint_accel") - rest
            for e in np.eye(7)
        ]
        found, most = np.array(found), np.abs(expected).max()
        assert found == pytest.approx(expected, abs=1e-10 * most)
        assert found == pytest.approx(found.T, abs=1e-11 * most)


# ---- generalized Jacobian ----


def test_generalized_jacobian_is_the_motion_of_the_tip_at_zero_momentum(fmu, rng):
    """A base that does not move, joints that do: differences of simulated poses, at the middle
    one.
    """
    arm, p = random_arm(rng, 7), moving(rng, 7)
    v = reference.Vehicle(arm, p["joint_angle_0"])
    H, dq = v.H(), p["joint_rate_0"]
    base = -np.linalg.solve(H[:6, :6], H[:6, 6:] @ dq)
    C, h = dcm_of_mrp(p["sigma_SN_0"]), 1e-2
    p |= {"v_0_N": C.T @ base[:3], "omega_SN_S_0": base[3:], "wheel_speed_0": np.zeros(3)}
    unit = fmu("arm_servicer", SPACE | arm.parameters() | p | {"max_step": h / 4}, FREE)
    assert unit.get("h_N") == pytest.approx(np.zeros(3), abs=1e-13)
    assert unit.get("v_CN_N") == pytest.approx(np.zeros(3), abs=1e-14)
    poses, states = [], []
    for _ in range(5):
        poses.append((unit.get("r_EN_N"), matrix(unit.get("q_EN")).T))
        states.append([unit.get(name) for name in ("joint_angle", "joint_rate", "q_SN")])
        unit.step(h)
    q, dq, attitude = states[2]
    C = matrix(attitude)
    motion = reference.Vehicle(arm, q).generalized_jacobian() @ dq
    turning = stencil([R for _, R in poses], h) @ poses[2][1].T
    assert stencil([r for r, _ in poses], h) == pytest.approx(C.T @ motion[:3], abs=1e-6)
    assert vee(turning) == pytest.approx(C.T @ motion[3:], abs=1e-6)


# ---- locks ----


def test_closing_lock_passes_the_momentum_to_base_and_free_joints(fmu, rng):
    """u_f += H_ff^-1 H_fl dq_l: with an impulse on the locked joints alone."""
    arm, p = random_arm(rng, 5), moving(rng, 5)
    unit = fmu("arm_servicer", SPACE | arm.parameters() | p, FREE)
    v = reference.Vehicle(arm, p["joint_angle_0"])
    C = dcm_of_mrp(p["sigma_SN_0"])
    u = np.concatenate((C @ p["v_0_N"], p["omega_SN_S_0"], p["joint_rate_0"][:5]))
    free, stopped = [0, 1, 2, 3, 4, 5, 6, 8, 10], [7, 9]
    H = v.H()
    u[free] += np.linalg.solve(H[np.ix_(free, free)], H[np.ix_(free, stopped)] @ u[stopped])
    u[stopped] = 0
    lock = fmu("arm_servicer", SPACE | arm.parameters() | p, {"joint_lock": (0, 1, 0, 1, 0, 1, 1)})
    assert C @ lock.get("v_SN_N") == pytest.approx(u[:3], abs=1e-12)
    assert lock.get("omega_SN_S") == pytest.approx(u[3:6], abs=1e-12)
    assert lock.get("joint_rate")[:5] == pytest.approx(u[6:], abs=1e-12)
    assert lock.get("h_N") == pytest.approx(unit.get("h_N"), abs=1e-11)
    assert lock.get("v_CN_N") == pytest.approx(unit.get("v_CN_N"), abs=1e-13)


def test_lock_torque_is_what_holds_the_joint(fmu, rng):
    """The same motion with the joint free and that torque in place of the lock; the command of a
    locked joint has no effect.
    """
    arm, p = random_arm(rng, 4), moving(rng, 4)
    p["joint_rate_0"] = np.where(np.arange(7) == 2, 0, p["joint_rate_0"])
    p |= SPACE | arm.parameters() | {"joint_friction": np.full(7, 0.1)}
    loads = {"F_S": rng.normal(size=3), "F_contact_E": rng.normal(size=3)}
    tau = rng.normal(size=7)
    lock = {"joint_lock": (0, 0, 1, 0, 0, 0, 0)}
    held = fmu("arm_servicer", p, loads | lock | {"joint_torque": tau})
    torque = held.get("lock_torque")
    assert torque[2] != 0
    assert list(np.delete(torque, 2)) == [0] * 6
    tau = np.where(np.arange(7) == 2, torque, tau)
    driven = fmu("arm_servicer", p, loads | FREE | {"joint_torque": tau})
    assert driven.get("joint_accel") == pytest.approx(held.get("joint_accel"), abs=1e-12)
    assert held.get("joint_accel")[2] == 0


def test_an_unconnected_arm_is_rigid(fmu, rng):
    unit = fmu("arm_servicer", SPACE | {"joint_rate_0": rng.normal(size=7)})
    unit.step(1.0, {"F_S": (1, 2, 3), "joint_torque": rng.normal(size=7)})
    assert unit.get("joint_angle") == pytest.approx(reference.STOWED, abs=0)
    assert list(unit.get("joint_rate")) == [0] * 7


# ---- torque limits, frozen attitude, steps ----


def test_torques_beyond_their_limit_are_cut(fmu, rng):
    arm, p = random_arm(rng, 3), moving(rng, 3) | SPACE
    p |= arm.parameters() | {"joint_torque_max": (0.5, 0, 0.2, 9, 9, 9, 9)}
    cut = fmu("arm_servicer", p, FREE | {"joint_torque": (-2, 1.5, 0.7, 0, 0, 0, 0)})
    within = fmu("arm_servicer", p, FREE | {"joint_torque": (-0.5, 1.5, 0.2, 0, 0, 0, 0)})
    cut.step(0.5)
    within.step(0.5)
    assert bits(cut) == bits(within)


def test_before_t_att_the_base_does_not_turn_but_the_joints_move(fmu, rng):
    """Rows of w leave the system; at t_att rate and wheels take their start values, and nothing
    moves at once: in the last h = 1 ms position and joint angles change by the mean of their rates,
    times h. What that neglects is h^3/12 of a jerk, a few 1e-9 at 30 rad/s^3.
    """
    arm, p = random_arm(rng, 3), moving(rng, 3)
    tau = rng.normal(size=7)
    p |= SPACE | arm.parameters() | {"t_att": 1.0}
    unit = fmu("arm_servicer", p, FREE | {"joint_torque": tau, "M_S": (1, 2, 3)})
    v = reference.Vehicle(arm, p["joint_angle_0"])
    free = [0, 1, 2, 6, 7, 8]
    y = np.concatenate((np.zeros(6), tau[:3])) - v.b(np.zeros(3), p["joint_rate_0"][:3])
    expected = np.linalg.solve(v.H()[np.ix_(free, free)], y[free])
    assert unit.get("joint_accel")[:3] == pytest.approx(expected[3:], abs=1e-9)
    sigma, momentum = unit.get("sigma_SN"), unit.get("v_CN_N")
    unit.step(0.9)
    assert list(unit.get("sigma_SN")) == list(sigma)
    assert list(unit.get("omega_SN_S")) == list(unit.get("wheel_speed")) == [0, 0, 0]
    assert unit.get("v_CN_N") == pytest.approx(momentum, abs=1e-9)
    unit.step(0.1 - (h := 1e-3))
    rate_of = {"r_SN_N": "v_SN_N", "joint_angle": "joint_rate"}
    before = {name: unit.get(name) for name in (*rate_of, *rate_of.values())}
    unit.step(h)
    assert unit.get("omega_SN_S") == pytest.approx(p["omega_SN_S_0"], abs=0)
    assert unit.get("wheel_speed") == pytest.approx(p["wheel_speed_0"], abs=0)
    for name, rate in rate_of.items():
        change = h * (before[rate] + unit.get(rate)) / 2
        assert deviation(unit.get(name) - before[name], change) < 1e-7, name


def test_lock_that_closes_before_t_att_retains_the_force_balance_alone(fmu, rng):
    arm, p = random_arm(rng, 3), moving(rng, 3)
    p |= SPACE | arm.parameters() | {"t_att": 5.0}
    free = fmu("arm_servicer", p, FREE)
    lock = fmu("arm_servicer", p)
    assert lock.get("v_CN_N") == pytest.approx(free.get("v_CN_N"), abs=1e-13)
    lock.step(5.0)
    assert lock.get("omega_SN_S") == pytest.approx(p["omega_SN_S_0"], abs=0)


def test_wheel_limits_hold_at_the_end_of_a_step_too(fmu, rng):
    """Published joint accelerations are those with the wheel acceleration within its limits."""
    arm, p = random_arm(rng, 2), moving(rng, 2) | SPACE | {"wheel_accel_max": 0.02}
    fast = fmu("arm_servicer", p | arm.parameters(), FREE | {"wheel_accel_cmd": (5, -5, 5)})
    slow = fmu(
        "arm_servicer", p | arm.parameters(), FREE | {"wheel_accel_cmd": (0.02, -0.02, 0.02)}
    )
    assert bits(fast) == bits(slow)


def test_mass_flow_matches_the_base(fmu):
    unit = fmu("arm_servicer", SPACE | {"mass_0": 100})
    unit.step(10, {"mdot": 0.5})
    assert unit.get("mass") == pytest.approx(120, abs=1e-11)
    light = reference.DEFAULT.__class__(**(vars(reference.DEFAULT) | {"mass_0": 95.0}))
    assert unit.get("r_CS_S") == pytest.approx(
        reference.Vehicle(light, reference.STOWED).c, abs=1e-12
    )


def test_step_that_would_use_more_than_the_base_is_rejected(fmu):
    unit = fmu("arm_servicer", SPACE | {"mass_0": 1})
    with pytest.raises(FMICallException):
        unit.step(5, {"mdot": 0.3})


def test_many_steps_give_the_bits_of_one(fmu, rng):
    arm, p = random_arm(rng, 7), moving(rng, 7)
    p |= SPACE | arm.parameters()
    inputs = FREE | {"joint_torque": rng.normal(size=7)}
    one, many = fmu("arm_servicer", p, inputs), fmu("arm_servicer", p, inputs)
    one.step(1.0)
    for _ in range(10):
        many.step(0.1)
    assert bits(one) == bits(many)


def test_integration_is_of_fourth_order(fmu, rng):
    arm, p = random_arm(rng, 7), moving(rng, 7)
    inputs = FREE | {"joint_torque": rng.normal(size=7)}

    def simulated(h):
        unit = fmu("arm_servicer", SPACE | arm.parameters() | p | {"max_step": h}, inputs)
        unit.step(0.8)
        return state(unit, 7)

    assert 12 < order_ratio(simulated, 0.01) < 21


# ---- rejections ----


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ({"joints": 2.5}, "joints = 2.5: must be a whole number from 0 to 7"),
        ({"joints": 8}, "joints = 8: must be a whole number from 0 to 7"),
        ({"joint_axis": [(0, 0, 1)] * 6 + [(1, 1e-3, 0)]}, "joint_axis[7] = 1.0000005"),
        ({"link_mass": (4, 0, 5, 1, 1, 1, 1)}, "link_mass[2] = 0: must be > 0"),
        (
            {"link_inertia": [(1, 1, 3)] * 7},
            "link_inertia[1] = 3: must satisfy the triangle inequality",
        ),
        (
            {"link_products": [(0, 0.4, 0)] * 7},
            "link_inertia[1] = 0.015: must be positive definite",
        ),
        ({"joint_inertia": (1, 1, -1, 1, 1, 1, 1)}, "joint_inertia[3] = -1: must be >= 0"),
        ({"joint_damping": (1, 1, -1, 1, 1, 1, 1)}, "joint_damping[3] = -1: must be >= 0"),
        ({"joint_friction": (-2, 1, 1, 1, 1, 1, 1)}, "joint_friction[1] = -2: must be >= 0"),
        ({"joint_torque_max": (0, 1, 1, 1, 1, 1, -3)}, "joint_torque_max[7] = -3: must be >= 0"),
        ({"friction_rate": 0}, "friction_rate = 0: must be > 0"),
        ({"q_EA": (1, 1, 0, 0)}, "|q_EA| = 1.41421356: must be a unit quaternion"),
    ],
)
def test_arms_that_cannot_be_are_rejected(rows, message, tmp_path):
    for name in ("arm_servicer", "arm_controller"):
        assert message in rejection(name, rows, tmp_path / name)


def test_rows_beyond_the_last_joint_are_not_judged(tmp_path):
    rows = {"joints": 1, "link_mass": (4, *(-1,) * 6), "joint_inertia": (0, *(-1,) * 6)}
    rows |= {
        "joint_axis": [(0, 0, 1)] + [(0, 0, 0)] * 6,
        "link_inertia": [(1, 1, 1)] + [(0, 0, 0)] * 6,
    }
    rows |= dict.fromkeys(("joint_damping", "joint_friction"), (0, *((-1,) * 6)))
    assert rejection("arm_servicer", rows, tmp_path) == ""
