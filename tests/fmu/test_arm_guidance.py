# SPDX-License-Identifier: BSD-2-Clause
"""arm_guidance.fmu against guidance on rotation matrices and point masses, sample by sample, and
what its laws guarantee.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.each import each

from ..reference import arm as reference
from ..reference.arm_software import (
    ALIGN,
    CLOSE,
    DEPLOY,
    FOLD,
    GUIDANCE,
    REST,
    STOW,
    Guidance,
    attitude,
    exp,
)
from .arm_cases import random_arm
from .motion import stencil
from .rejections import rejection
from .theory import quaternion_of_dcm

QUICK = {"T_deploy": 2.0, "T_align": 3.0, "T_close": 3.0, "deploy_from": 0.2, "track_from": 3.0}
QUICK |= {"T_rest": 0.3, "joint_rate_max": 2 * np.ones(7), "grip_speed": 0.02, "grip_rate": 0.05}
CLOCK = {"arm_mode_cmd": -1.0, "capture_phase": 0.0}
FLAGS = ("arm_mode", "grip", "limited")


def target(t, spin=(0.002, 0.01, 0.0), speed=(0.01, -0.02, 0.005)):
    """A tumbling target far from the origin, at constant rate."""
    R = Rotation.from_rotvec((0.3, -0.2, 0.5)).as_matrix() @ exp(t * np.array(spin))
    r = np.array((50.0, -20, 10)) + t * np.array(speed)
    return {
        "r_TN_N": r,
        "v_TN_N": np.array(speed),
        "q_TN": quaternion_of_dcm(R.T),
        "omega_TN_T": np.array(spin),
    }


def servicer(t, tilt=(0.02, 0.04, -0.03), rate=(0.001, -0.002, 0.003)):
    """2.6 m from the target on its X axis, arm towards it: in reach, not aligned."""
    at = target(0)
    T = attitude(at["q_TN"])
    R = T @ np.diag((-1.0, -1, 1)) @ exp(np.array(tilt)) @ exp(t * np.array(rate))
    return {
        "r_SN_N": at["r_TN_N"] + T @ (2.6, 0.03, 0.02) + t * at["v_TN_N"],
        "v_SN_N": at["v_TN_N"],
        "q_SN": quaternion_of_dcm(R.T),
        "omega_SN_S": np.array(rate),
    }


def settings(arm, p):
    """Parameters as the interface has them; a random arm gets seven rows."""
    return arm.parameters() | p


class Loop:
    """FMU and reference side by side; joints that follow their references."""

    def __init__(self, fmu, arm, p, period=0.1):
        self.arm, self.period, self.k = arm, period, 0
        self.reference = Guidance(arm, **p)
        start = {"joint_angle": (*self.reference.ref, *[0] * (7 - arm.n))}
        self.unit = fmu("arm_guidance", settings(arm, p) | {"sample_period": period}, start)
        self.q = np.array(start["joint_angle"])
        self.dq = np.zeros(7)
        self.modes = []

    def inputs(self, **more):
        t = self.k * self.period
        joints = {"joint_angle": self.q.copy(), "joint_rate": self.dq.copy()}
        return CLOCK | target(t) | servicer(t) | joints | more

    def sample(self, **more):
        u, t = self.inputs(**more), self.k * self.period
        self.unit.step(self.period, u)
        self.k += 1
        self.expected = self.reference.sample(t, u, self.period)
        found = {name: self.unit.get(name) for name in self.expected}
        for name, value in self.expected.items():
            exact = name in FLAGS
            assert found[name] == pytest.approx(value, abs=0 if exact else 1e-9), (name, t)
        n = self.arm.n
        self.q[:n] = self.reference.ref
        self.dq[:n] = found["joint_rate_ref"][:n]
        self.modes.append(int(found["arm_mode"]))
        return found


@pytest.mark.parametrize("floats", [0, 1])
def test_whole_grasp_matches_the_reference(fmu, floats):
    """Stowed, deploy, align, close, grip: all outputs, all samples."""
    loop = Loop(fmu, reference.DEFAULT, QUICK | {"base_floats": floats, "deploy_from": 0.2})
    while loop.k < 110 and (not loop.modes or loop.modes[-1] != REST):
        found = loop.sample()
    assert sorted(set(loop.modes)) == [STOW, DEPLOY, ALIGN, CLOSE, REST]
    assert found["grip"] == 1
    for _ in range(5):
        found = loop.sample(capture_phase=2.0)
    assert found["arm_mode"] == REST


@pytest.mark.parametrize(("seed", "n"), [(0, 4), (1, 5), (2, 7), (3, 7), (4, 6)])
def test_random_arms_are_led_as_by_the_reference(fmu, seed, n):
    """Any axes, too few joints, singular poses, limits of angle and rate."""
    rng = np.random.default_rng(seed)
    arm = random_arm(rng, n)
    p = QUICK | {
        "joint_angle_stowed": rng.uniform(-1, 1, 7),
        "joint_angle_ready": rng.uniform(-1, 1, 7),
        "joint_angle_min": -1.2 * np.ones(7),
        "joint_angle_max": 1.2 * np.ones(7),
        "joint_rate_max": rng.uniform(0.3, 0.6, 7),
        "manipulability_min": 0.4,
        "q_QT": quaternion_of_dcm(Rotation.random(random_state=seed).as_matrix()),
    }
    loop = Loop(fmu, arm, p)
    damped, limited, scaled = 0, 0, 0
    for _ in range(70):
        found = loop.sample()
        damped += found["damping"] > 0
        limited += found["limited"].any()
        scaled += 0 < found["rate_scale"] < 1
    assert ALIGN in loop.modes
    assert damped
    assert limited
    assert scaled


@pytest.mark.verifies("K.3-4")
def test_joint_rates_give_the_tip_its_motion_where_nothing_limits(fmu):
    """J dq = y, 1e-12; posture moves in the null space alone."""
    loop = Loop(fmu, reference.DEFAULT, QUICK | {"manipulability_min": 1e-9})
    tracked = 0
    for _ in range(45):
        found = loop.sample()
        if found["arm_mode"] == ALIGN:
            tracked += 1
            J, y = terms(loop)
            assert J @ found["joint_rate_ref"] == pytest.approx(y, abs=1e-12)
    assert tracked > 5


def terms(loop):
    """J and y of the sample just taken."""
    r = loop.reference
    last = r.rates((loop.k - 1) * loop.period - r.t_m)
    return last["J"], last["y"]


@pytest.mark.verifies("K.3-5")
def test_limited_joint_moves_towards_its_bound_by_K_limit(fmu):
    bound = reference.READY.copy()
    bound[3] = -2.1  # the elbow of the ready arm is beyond
    p = QUICK | {"joint_angle_min": np.where(np.arange(7) == 3, bound, -3.1), "K_limit": 0.7}
    loop = Loop(fmu, reference.DEFAULT, p)
    seen = 0
    for _ in range(60):
        q = loop.q.copy()
        found = loop.sample()
        if found["limited"][3]:
            seen += 1
            assert found["joint_rate_ref"][3] == pytest.approx(
                found["rate_scale"] * 0.7 * (-2.1 - q[3]), abs=1e-12
            )
    assert seen


def test_reference_of_the_tip_is_the_derivative_of_itself():
    """x_r, v_r and R_r, w_r by differences along a tumbling target (1e-7), in ALIGN and CLOSE."""
    g = Guidance(reference.DEFAULT, **QUICK)
    u = servicer(0) | {"joint_angle": reference.READY, "joint_rate": np.zeros(7)}
    g.ref = reference.READY
    g.look(u | target(0))
    for mode in (ALIGN, CLOSE):
        g.enter(mode, 0.0)
        for t in (0.4, 1.5, 2.7):
            h, poses = 1e-2, []
            for k in range(-2, 3):
                g.look(u | target(t + k * h))
                x, v, R, w = g.desired(t + k * h)
                poses.append((x, R))
                if k == 0:
                    now = v, w, R
            spin = stencil([R for _, R in poses], h) @ now[2].T
            assert stencil([x for x, _ in poses], h) == pytest.approx(now[0], abs=1e-7)
            assert (spin[2, 1], spin[0, 2], spin[1, 0]) == pytest.approx(now[1], abs=1e-7)


def test_half_turn_about_Z_where_the_gripper_looks_away(fmu):
    """X_E = X_Q exactly: the arc is not unique."""
    arm, still, ahead = reference.first(reference.DEFAULT, 0), np.zeros(3), np.array((1.0, 0, 0, 0))
    u = {"r_SN_N": np.array((1.0, 0, 0)), "v_SN_N": still, "q_SN": ahead, "omega_SN_S": still}
    u |= {"r_TN_N": still, "v_TN_N": still, "q_TN": ahead, "omega_TN_T": still}
    u |= {"joint_angle": np.zeros(7), "joint_rate": np.zeros(7)}
    u |= {"arm_mode_cmd": 2.0, "capture_phase": 0.0}
    p = {"T_deploy": 0.1, "T_align": 1.0}
    unit, other = fmu("arm_guidance", settings(arm, p) | {"sample_period": 0.1}), Guidance(arm, **p)
    for k in range(8):
        unit.step(0.1, u)
        expected = other.sample(0.1 * k, u, 0.1)
        assert unit.get("arm_mode") == expected["arm_mode"]
        assert unit.get("angle_error") == pytest.approx(expected["angle_error"], abs=1e-12)
    assert unit.get("misalignment") == pytest.approx(np.pi)
    assert expected["angle_error"] > 0.1


# ---- modes ----


def commanded(fmu, commands, **p):
    """Modes under commands of (seconds, command, capture phase)."""
    loop = Loop(fmu, reference.DEFAULT, QUICK | p)
    for seconds, cmd, phase in commands:
        for _ in range(round(seconds / loop.period)):
            loop.sample(arm_mode_cmd=float(cmd), capture_phase=float(phase))
    changes = [m for i, m in enumerate(loop.modes) if i == 0 or m != loop.modes[i - 1]]
    return changes, loop


@pytest.mark.verifies("K.3-1")
@each(
    ("commands", "modes"),
    [
        ([(0.3, 0, 0), (0.3, 3, 0)], [STOW]),
        ([(0.3, 2, 0), (2.5, 0, 0), (0.2, 0, 0)], [DEPLOY, FOLD, STOW]),
        ([(0.3, 1, 0), (0.5, 0, 0), (0.5, 1, 0)], [DEPLOY, FOLD, DEPLOY]),
        ([(0.3, 1, 0), (0.5, 3, 0), (0.5, 1, 0)], [DEPLOY, REST, DEPLOY]),
        ([(0.3, 1, 0), (0.5, 3, 0), (0.5, 0, 0)], [DEPLOY, REST, FOLD]),
        ([(0.3, 1, 0), (0.5, 1, 2), (0.5, 1, 3), (0.5, 0, 2)], [DEPLOY, REST]),
        ([(2.5, 2, 0), (0.3, 1, 0)], [DEPLOY, ALIGN, DEPLOY]),
        ([(2.5, 2, 0), (0.3, 0, 0)], [DEPLOY, ALIGN, FOLD]),
        ([(2.5, 2, 0), (0.3, 3, 0)], [DEPLOY, ALIGN, REST]),
        ([(5.5, 2, 0), (0.3, 1, 0)], [DEPLOY, ALIGN, CLOSE, DEPLOY]),
        ([(5.5, 2, 0), (0.3, 0, 0)], [DEPLOY, ALIGN, CLOSE, FOLD]),
        ([(5.5, 2, 0), (0.3, 3, 0)], [DEPLOY, ALIGN, CLOSE, REST]),
        ([(0.3, 1, 0), (0.3, 0, 0), (0.3, 3, 0)], [DEPLOY, FOLD, DEPLOY, REST]),
        ([(0.3, 1, 0), (0.3, 0, 0), (0.3, 0, 3)], [DEPLOY, FOLD, REST]),
    ],
)
def test_modes_follow_their_table(fmu, commands, modes):
    found, loop = commanded(fmu, commands)
    if commands[-1][1] == 3 and modes[-2:] == [DEPLOY, REST] and FOLD in modes:
        modes = [DEPLOY, FOLD, REST]  # cmd = 3 comes before cmd >= 1
    assert found == modes
    assert loop.unit.get("grip") == 0


@pytest.mark.verifies("K.3-3")
def test_grip_opens_when_the_arm_deploys_anew_and_not_while_held(fmu):
    found, loop = commanded(fmu, [(9.0, 2, 0)])
    assert found[-1] == REST
    for phase, cmd, mode, grip in ((2, 1, REST, 1), (3, 0, REST, 1), (0, 1, DEPLOY, 0)):
        loop.sample(arm_mode_cmd=float(cmd), capture_phase=float(phase))
        assert (loop.unit.get("arm_mode"), loop.unit.get("grip")) == (mode, grip)


# ---- gripper ----

STILL = reference.first(reference.DEFAULT, 1)
"""One joint at rest: the tip moves with the servicer."""
LIMITS = {"grip_distance": 0.01, "grip_angle": 0.035, "grip_speed": 0.005, "grip_rate": 0.005}


def put(distance=0.0, angle=0.0, speed=0.0, rate=0.0):
    """Inputs with the tip so far from the seat along -X_Q, misaligned about Z, so fast."""
    tip = reference.Vehicle(STILL, np.zeros(1)).tip()[0]
    R = np.diag((-1.0, -1, 1)) @ exp(np.array((0, 0, angle)))
    spin = np.array((0, 0, rate))
    v = np.array((speed, 0, 0)) - R @ np.cross(spin, tip)
    r = np.array((0.6 - 0.05 - distance, 0, 0)) - R @ tip
    body = {"r_SN_N": r, "v_SN_N": v, "q_SN": quaternion_of_dcm(R.T), "omega_SN_S": spin}
    other = {"r_TN_N": np.zeros(3), "v_TN_N": np.zeros(3), "q_TN": np.array((1.0, 0, 0, 0))}
    return body | other | {"omega_TN_T": np.zeros(3), "joint_angle": np.zeros(7)}


def closing(fmu, **p):
    """A unit at its first sample of CLOSE."""
    always = {"T_deploy": 0.1, "T_align": 0.1, "gate_distance": 9, "gate_angle": 4}
    unit = fmu(
        "arm_guidance",
        settings(STILL, always | LIMITS | {"grip_dwell": 0.3} | p) | {"sample_period": 0.1},
        put(5) | {"arm_mode_cmd": 2},
    )
    for _ in range(3):
        unit.step(0.1)
    assert unit.get("arm_mode") == CLOSE
    return unit


def gripped_after(unit, *samples):
    """Number of the sample that grips."""
    for k, inputs in enumerate(samples):
        unit.step(0.1, inputs)
        if unit.get("grip"):
            return k
    return None


@pytest.mark.verifies("K.3-2")
@pytest.mark.parametrize("which", ["distance", "angle", "speed", "rate"])
def test_each_condition_alone_retains_the_gripper_open(fmu, which):
    """Off by 1e-9; inside by 1e-9 it closes."""
    limit = LIMITS[f"grip_{which}"]
    outside, inside = (put(**{which: limit + d}) for d in (1e-9, -1e-9))
    assert gripped_after(closing(fmu), *[outside] * 8) is None
    assert gripped_after(closing(fmu), *[inside] * 8) == 3


@pytest.mark.verifies("K.3-2")
def test_dwell_counts_from_the_first_good_sample_and_a_bad_one_forgets_it(fmu):
    good, bad = put(), put(distance=0.02)
    assert gripped_after(closing(fmu), *[good] * 5) == 3
    assert gripped_after(closing(fmu), good, good, bad, *[good] * 5) == 6
    assert gripped_after(closing(fmu, grip_dwell=0), bad, good) == 1


def test_first_sample_of_CLOSE_does_not_count(fmu):
    """The change acts at its sample; the gripper is checked from the next one on."""
    always = {"T_deploy": 0.1, "T_align": 0.1, "gate_distance": 9, "gate_angle": 4, "grip_dwell": 0}
    unit = fmu(
        "arm_guidance",
        settings(STILL, always) | {"sample_period": 0.1},
        put() | {"arm_mode_cmd": 2},
    )
    modes = []
    for _ in range(6):
        unit.step(0.1)
        modes.append(unit.get("arm_mode"))
    assert modes[modes.index(CLOSE) :][:2] == [CLOSE, REST]


@pytest.mark.parametrize(("gate_angle", "mode"), [(0.5 + 1e-9, CLOSE), (0.5 - 1e-9, ALIGN)])
def test_a_tip_at_the_standoff_waits_until_it_points_at_the_fixture(fmu, gate_angle, mode):
    always = {"T_deploy": 0.1, "T_align": 0.1, "gate_distance": 9, "gate_angle": gate_angle}
    unit = fmu(
        "arm_guidance",
        settings(STILL, always) | {"sample_period": 0.1},
        put(angle=0.5) | {"arm_mode_cmd": 2},
    )
    for _ in range(5):
        unit.step(0.1)
    assert unit.get("arm_mode") == mode


@pytest.mark.verifies("K.3-4")
@pytest.mark.parametrize("joints", [0, 1])
@pytest.mark.parametrize("base_floats", [0, 1])
def test_a_singular_arm_without_damping_only_goes_towards_its_posture(fmu, joints, base_floats):
    """The end effector cannot move along X: the joint turns about X, or there is none."""
    p = {"joints": joints, "joint_axis": np.tile((1.0, 0, 0), (7, 1)), "K_posture": 0.02}
    p |= {"T_deploy": 0.1, "manipulability_min": 0, "base_floats": base_floats}
    unit = fmu(
        "arm_guidance",
        settings(STILL, p) | {"sample_period": 0.1, "joint_angle_ready": np.full(7, 0.5)},
        put() | {"arm_mode_cmd": 2, "joint_angle": np.full(7, 0.1)},
    )
    for _ in range(4):
        unit.step(0.1)
    assert unit.get("arm_mode") == ALIGN
    assert np.array_equal(
        unit.get("joint_rate_ref"), [0.02 * (0.5 - 0.1)] * joints + [0] * (7 - joints)
    )


# ---- the rest ----


def test_samples_do_not_depend_on_the_step_of_the_master(fmu):
    p = settings(reference.DEFAULT, QUICK) | {"sample_period": 0.1}
    u = CLOCK | target(0) | servicer(0) | {"joint_angle": reference.READY}
    whole, parts = fmu("arm_guidance", p, u), fmu("arm_guidance", p, u)
    for _ in range(60):
        whole.step(0.1)
        for _ in range(4):
            parts.step(0.025)
    for name in ("joint_angle_ref", "joint_rate_ref", "arm_mode"):
        assert np.array_equal(whole.get(name), parts.get(name))


@pytest.mark.verifies("K.3-6")
def test_initialization_publishes_a_sample_and_retains_nothing(fmu):
    """Start after deploy_from: DEPLOY shows, and begins at the first sample."""
    u = CLOCK | target(0) | servicer(0)
    unit = fmu("arm_guidance", {"deploy_from": 0, "sample_period": 0.1}, u)
    assert unit.get("arm_mode") == DEPLOY
    assert unit.get("joint_angle_ref") == pytest.approx(reference.STOWED, abs=0)
    unit.step(0.3)
    other = Guidance(reference.DEFAULT, deploy_from=0)
    joints = {"joint_angle": np.zeros(7), "joint_rate": np.zeros(7)}
    for k in range(3):
        expected = other.sample(0.1 * k, u | joints, 0.1)
    assert unit.get("joint_rate_ref") == pytest.approx(expected["joint_rate_ref"], abs=1e-15)


@pytest.mark.verifies("K.3-7")
@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ({"q_QT": (1, 1, 0, 0)}, "|q_QT| = 1.41421356: must be a unit quaternion"),
        ({"joint_angle_max": (3, 3, -4, 3, 3, 3, 3)}, "joint_angle_max[3] = -4: must be above"),
        ({"T_rest": 0}, "T_rest = 0: must be > 0"),
        ({"link_mass": (0, *[1] * 6)}, "link_mass[1] = 0: must be > 0"),
    ],
)
def test_impossible_parameters_are_rejected(rows, message, tmp_path):
    assert message in rejection("arm_guidance", rows, tmp_path)


def test_defaults_of_the_reference_match_the_interface(fmu):
    unit = fmu("arm_guidance")
    for name, value in GUIDANCE.items():
        assert unit.get(name) == pytest.approx(value, abs=0), name
