# SPDX-License-Identifier: BSD-2-Clause
"""assembly.fmu: against point masses, conservation of momentum, quadrature, published reference
values.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad, simpson
from scipy.spatial.transform import Rotation

from tests.close import close

from .assembly_cases import (
    C_HO,
    N_ORBIT,
    Q_FLIGHT,
    Assembly,
    C_of,
    C_SO_of,
    q_SH_of,
    quintic,
)
from .rejections import rejection

SPACE = {"mu": 0, "max_step": 0.25}
FAST_SWING = {"swing_start": 0, "swing_duration": 60, "swing_angle": 1.2}
TUMBLING = {"eps_0": (0.1, -0.2, 0.3), "omega_SH_S_0": (1e-3, -2e-3, 1.5e-3)}
ODD = Assembly(
    m0=800,
    m1=300,
    J0=np.array([[900.0, 30, -60], [30, 1200, 20], [-60, 20, 1500]]),
    J1=np.diag((150.0, 260, 210)),
    hinge=(1.5, 0.4, -0.3),
    module=(1.2, -0.2, 0.5),
)


def own_momentum(unit, assembly):
    """Inertial, from attitude, rates, arm and gyros, by point masses."""
    arm = unit.get("arm_angle"), unit.get("arm_rate")
    H_S = assembly.momentum(unit.get("omega_SN_S"), *arm) + unit.get("h_cmg_S")
    return C_of(unit.get("q_SN")).T @ H_S


# ---- geometry


@pytest.mark.parametrize("assembly", [Assembly(), ODD], ids=["scenario", "odd"])
@pytest.mark.parametrize("angle", [0.0, 0.7, -2.0])
def test_inertia_matches_the_point_masses(fmu, assembly, angle):
    unit = fmu(
        "assembly",
        assembly.parameters() | {"swing_start": -10, "swing_duration": 5, "swing_angle": angle},
    )
    J = assembly.inertia(angle)
    assert unit.get("J_A").reshape(3, 3) == pytest.approx(J, abs=1e-12 * J.max())
    assert unit.get("arm_angle") == pytest.approx(angle)


def test_run_attitude_is_x_along_track_and_z_to_the_earth(fmu):
    unit = fmu("assembly")
    assert unit.get("q_SH") == pytest.approx(Q_FLIGHT, abs=1e-15)
    C_SH = C_of(unit.get("q_SH"))  # rows: base axes in H
    assert np.allclose(C_SH, [[0, 1, 0], [0, 0, -1], [-1, 0, 0]], atol=1e-15)
    assert unit.get("omega_SN_S") == pytest.approx([0, -N_ORBIT, 0], abs=1e-18)
    assert unit.get("rotation") == 0


@pytest.mark.parametrize("t", [0.0, 700.0, -3000.0])
def test_start_attitude_is_a_rotation_from_the_run_attitude_anywhere_on_the_orbit(fmu, t):
    eps = np.array((0.1, -0.2, 0.3))
    unit = fmu("assembly", {"eps_0": eps}, start=t)
    assert abs(unit.get("q_SH") @ q_SH_of(eps)) == pytest.approx(1, abs=1e-15)
    C_HN = Rotation.from_rotvec((0, 0, N_ORBIT * t)).as_matrix().T
    assert C_of(unit.get("q_SN")) == pytest.approx(C_SO_of(q_SH_of(eps)) @ C_HO.T @ C_HN, abs=1e-13)
    assert unit.get("rotation") == pytest.approx(2 * np.arcsin(np.linalg.norm(eps)))


def test_arm_follows_the_quintic_and_its_derivatives(fmu):
    unit = fmu("assembly")
    for t in (300.0, 600.0, 900.0, 2100.0, 3500.0, 3600.0, 5000.0):
        unit.step(t - unit.time)
        arm = [unit.get(n) for n in ("arm_angle", "arm_rate", "arm_accel")]
        for k, expected in enumerate(quintic(t)):  # terms of up to 180 cancel
            close(arm[k], expected, rel=1e-13, of=np.pi / 2 / 3000**k)


@pytest.mark.parametrize("angle", [np.pi / 2, -0.7])
def test_arm_without_a_smooth_swing_speeds_up_and_slows_down_as_much(fmu, angle):
    """Half the angle in half the time at a constant acceleration a, then back at -a."""
    begin, duration = 600.0, 3000.0
    unit = fmu("assembly", {"swing_smooth": 0, "swing_angle": angle})
    a = angle / (duration / 2) ** 2
    for t in (300.0, 900.0, 2000.0, 2200.0, 2900.0, 3500.0, 3600.0, 4000.0):
        unit.step(t - unit.time)
        gone = min(max(t - begin, 0), duration)
        left = duration - gone
        first = gone <= duration / 2
        required = (a / 2 * gone**2, a * gone) if first else (angle - a / 2 * left**2, a * left)
        assert unit.get("arm_angle") == pytest.approx(required[0], rel=1e-12, abs=1e-15)
        assert unit.get("arm_rate") == pytest.approx(required[1], rel=1e-12, abs=1e-15)
        if 0 < gone < duration:
            assert unit.get("arm_accel") == pytest.approx(a if first else -a, rel=1e-12)


# ---- torques


@pytest.mark.parametrize("swung", [0.0, 1.1])
def test_torques_are_those_on_point_masses_and_plates(fmu, rng, swung):
    eps, assembly = rng.uniform(-0.4, 0.4, 3), Assembly()
    unit = fmu(
        "assembly",
        {"eps_0": eps, "swing_start": -10, "swing_duration": 5, "swing_angle": swung},
    )
    C_SO = C_SO_of(q_SH_of(eps))
    gravity, aero = assembly.gravity_torque(C_SO, swung), assembly.aero_torque(C_SO, swung)
    assert unit.get("M_gravity_S") == pytest.approx(gravity, abs=1e-10 * np.linalg.norm(gravity))
    assert unit.get("M_aero_S") == pytest.approx(aero, abs=1e-10 * np.linalg.norm(aero))
    printed = 3 * N_ORBIT**2 * aero  # the patent's prefix 3 mu/R_C^3
    assert np.linalg.norm(aero - printed) > 0.99 * np.linalg.norm(aero)


def test_air_and_gravity_can_be_switched_off(fmu):
    unit = fmu("assembly", {"eps_0": (0.1, 0.2, 0.1), "use_aero": 0, "use_gravity_gradient": 0})
    assert not unit.get("M_gravity_S").any()
    assert not unit.get("M_aero_S").any()


# ---- conservation


@pytest.mark.parametrize("assembly", [Assembly(), ODD], ids=["scenario", "odd"])
def test_momentum_is_constant_without_environment_for_any_motion_of_arm_and_gyros(
    fmu, rng, assembly
):
    free = assembly.parameters() | SPACE | TUMBLING | FAST_SWING | {"max_step": 0.05}
    unit = fmu("assembly", free | {"H_sat": 1e6})
    before = own_momentum(unit, assembly)
    for _ in range(90):
        unit.step(1.0, {"hdot_cmd_S": rng.normal(size=3) * assembly.m0 / 2000})
    scale = np.linalg.norm(before) + np.linalg.norm(unit.get("h_cmg_S"))
    assert own_momentum(unit, assembly) == pytest.approx(before, abs=1e-9 * scale)
    assert unit.get("h_total_N") == pytest.approx(before, abs=1e-9 * scale)


def test_momentum_is_constant_while_the_cluster_moves(fmu, rng):
    unit = fmu("assembly", SPACE | TUMBLING | FAST_SWING | {"use_cluster": 1})
    before, angles = own_momentum(unit, Assembly(mu=0)), unit.get("gimbal_angle")
    for _ in range(90):
        unit.step(1.0, {"gimbal_rate_cmd": rng.uniform(-0.2, 0.2, 6)})
    assert not np.allclose(angles, unit.get("gimbal_angle"), atol=0.1)
    assert own_momentum(unit, Assembly(mu=0)) == pytest.approx(
        before, abs=1e-9 * np.linalg.norm(before)
    )


@pytest.mark.parametrize(("use_aero", "tolerance"), [(0, 1e-8), (1, 2e-4)])
def test_momentum_changes_by_the_integral_of_the_torques(fmu, use_aero, tolerance):
    """Simpson's rule over 2 s; the kink where a face turns into the flow costs it accuracy."""
    unit = fmu(
        "assembly", TUMBLING | {"swing_start": 0, "swing_duration": 600, "use_aero": use_aero}
    )
    rows, count, h = [], 200, 2.0
    for k in range(count + 1):
        C_NS = C_of(unit.get("q_SN")).T
        torque = unit.get("M_gravity_S") + unit.get("M_aero_S")
        rows.append((own_momentum(unit, Assembly()), C_NS @ torque))
        if k < count:
            unit.step(h)
    H, torque = (np.array(x) for x in zip(*rows, strict=True))
    impulse = simpson(torque, dx=h, axis=0)
    assert H[-1] - H[0] == pytest.approx(impulse, abs=tolerance * np.linalg.norm(impulse))
    assert np.linalg.norm(impulse) > 100


def test_free_swing_turns_the_base_by_the_planar_quadrature_angle(fmu):
    """At rest, all centres in one plane, no products of inertia: d theta = -h_m/J_A dt, and the
    angle depends on the path of the arm alone.
    """
    flat = Assembly(
        J0=np.diag(np.diag(Assembly().J0)), J1=np.diag(np.diag(Assembly().J1)), mu=0,
        hinge=(9.5, 0, 0), module=(8.5, 0, 0),
    )  # fmt: skip
    unit = fmu("assembly", flat.parameters() | FAST_SWING | {"max_step": 0.1})
    still = np.zeros(3)
    expected, _ = quad(lambda a: -flat.momentum(still, a, 1.0)[2] / flat.inertia(a)[2, 2], 0, 1.2)
    unit.step(61.0)
    eps = unit.get("eps")
    assert 2 * np.arctan2(eps[2], np.sqrt(1 - eps @ eps)) == pytest.approx(expected, abs=1e-8)
    assert unit.get("omega_SN_S") == pytest.approx([0, 0, 0], abs=1e-10)
    assert expected < -0.3


# ---- gyros


def test_ideal_device_stops_at_its_limit_and_retains_the_momentum_of_the_whole(fmu):
    unit = fmu("assembly", SPACE | {"H_sat": 100, "h_0_S": (90, 0, 0)})
    before = own_momentum(unit, Assembly(mu=0))
    flags = []
    for _ in range(40):
        unit.step(1.0, {"hdot_cmd_S": (1.0, 3.0, 0)})
        flags.append(unit.get("saturated"))
        assert unit.get("h_cmg") <= 100 * (1 + 1e-12)
    assert flags[0] == 0
    assert flags[-1] == 1
    assert own_momentum(unit, Assembly(mu=0)) == pytest.approx(before, abs=1e-8)
    unit.step(1.0, {"hdot_cmd_S": (-1.0, -3.0, 0)})
    assert unit.get("saturated") == 0
    assert unit.get("h_cmg") == pytest.approx(100 - np.sqrt(10), abs=0.5)


def pyramid():
    """Gimbal axes, spin axes at zero, by rotation matrices."""
    g, s = [np.array([0, 0, 1.0])], [np.array([1.0, 0, 0])]
    for k in range(5):
        turn = Rotation.from_euler("ZY", (2 * np.pi / 5 * k, np.arctan(2)))
        g.append(turn.apply((0, 0, 1)))
        s.append(turn.apply((0, 1, 0)))
    return np.array(g), np.array(s)


def cluster_momentum(angles, h_w=350.0):
    g, s = pyramid()
    return h_w * sum(
        Rotation.from_rotvec(d * axis).apply(spin)
        for d, axis, spin in zip(angles, g, s, strict=True)
    )


def test_cluster_has_the_momentum_of_wheels_turned_about_their_gimbals(fmu, rng):
    angles = rng.uniform(-3, 3, 6)
    unit = fmu("assembly", {"use_cluster": 1, "gimbal_angle_0": angles})
    assert unit.get("h_cmg_S") == pytest.approx(cluster_momentum(angles), abs=1e-10)
    d = 1e-6
    A = [
        (cluster_momentum(angles + d * e) - cluster_momentum(angles - d * e)) / 700 / d
        for e in np.eye(6)
    ]
    m = np.sqrt(np.linalg.det(np.transpose(A) @ A))
    assert unit.get("singularity") == pytest.approx(m, rel=1e-7)


def test_cluster_starts_empty_and_far_from_singular(fmu):
    unit = fmu("assembly", {"use_cluster": 1})
    assert unit.get("h_cmg_S") == pytest.approx([0, 0, 0], abs=1e-10)
    assert unit.get("singularity") > 2


def test_gimbals_turn_no_faster_than_their_limit(fmu):
    unit = fmu("assembly", {"use_cluster": 1, "gimbal_angle_0": np.zeros(6)})
    unit.step(2.0, {"gimbal_rate_cmd": (0.05, -0.3, 0.2, 0, 0.1, -0.1)})
    assert unit.get("gimbal_angle") == pytest.approx([0.1, -0.2, 0.2, 0, 0.2, -0.2], abs=1e-15)


def test_envelope_is_reached_in_ten_thousand_directions(kind):
    """The largest momentum along u is reached with every wheel turned as near to u as its gimbal
    lets it; random angles stay below. One instance in initialization mode gives them all.
    """
    from .driver import Unit

    rng = np.random.default_rng(5)
    g, s = pyramid()
    t = np.cross(g, s)
    unit = Unit.__new__(Unit)
    unit.kind = kind("assembly")
    from fmpy.fmi2 import FMU2Slave

    d = unit.kind.description
    unit.slave = FMU2Slave(
        guid=d.guid,
        modelIdentifier=d.coSimulation.modelIdentifier,
        unzipDirectory=unit.kind.folder,
    )
    unit.slave.instantiate()
    unit.slave.setupExperiment(startTime=0.0)
    unit.slave.enterInitializationMode()
    unit.set({"use_cluster": 1})
    for u in rng.normal(size=(10000, 3)):
        u /= np.linalg.norm(u)
        best = np.arctan2(t @ u, s @ u)
        largest = 350 * np.sqrt(1 - (g @ u) ** 2).sum()
        assert largest > 1500
        unit.set({"gimbal_angle_0": best})
        assert unit.get("h_cmg_S") @ u == pytest.approx(largest, rel=1e-12)
        assert unit.get("momentum_share") <= 1 + 1e-12
    unit.close()


# ---- rejections


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"m0": 0}, "m0 = 0: must be > 0"),
        ({"m1": -1}, "m1 = -1: must be > 0"),
        ({"J1": np.diag((1, 1, 3))}, "J1 = 3: must satisfy the triangle inequality"),
        ({"J0": -np.eye(3)}, "J0 = -1: must be positive definite"),
        ({"H_sat": 0}, "H_sat = 0: must be > 0"),
        ({"H_sat": 10, "h_0_S": (0, 11, 0)}, "h_0_S = 11: must not be larger than H_sat"),
        ({"swing_duration": 0}, "swing_duration = 0: must be > 0"),
        ({"eps_0": (1, 1, 0)}, "must not be longer than 1"),
        ({"panel_normal": np.eye(4, 3)}, "panel_normal[4] = 0: must be a unit vector"),
        ({"R_C": 0}, "R_C = 0: must be > 0"),
    ],
)
def test_rejected(tmp_path, parameters, message):
    assert message in rejection("assembly", parameters, tmp_path)
