# SPDX-License-Identifier: BSD-2-Clause
"""The docking mechanism between servicer and target in deep space: closed forms, conservation laws
and published reference values, under either master.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigvals
from scipy.optimize import brentq

from tests.systems.docking_case import J_S, J_T, M_RED, energy, kinetic, matrices, momenta, simulate

NO_LATCH = {"mechanism.latch_enable": 0}
FLOOR_ONLY = {  # so wide that no wall is near
    "mechanism.floor_radius": 2,
    "mechanism.mouth_radius": 2.001,
    "mechanism.face_radius": 4,
    "mechanism.depth_max": 1,
}
MASTERS = pytest.mark.parametrize("master", [("gauss-seidel", 0), ("jacobi", 1)])


def simulated(master, **more):
    algorithm, latency = master
    return simulate(algorithm=algorithm, **more, **{"mechanism.latency": latency})


def drift(history):
    """Largest change since the start."""
    return np.abs(history - history[0]).max()


# ---- contact


def restitution(x):
    """x (1 + e) = ln((1 + x)/(1 - e x)), x = c v (Hunt & Crossley 1975)."""
    return brentq(
        lambda e: x * (1 + e) - np.log((1 + x) / (1 - e * x)), 1e-9, min(1, 1 / x) - 1e-12
    )


def speed_after(result):
    return (result["servicer.v_SN_N"] - result["target.v_TN_N"])[-1, 0]


def test_restitution_is_the_closed_form_of_hunt_and_crossley():
    assert [restitution(x) for x in (0.4, 1.2, 2.0)] == pytest.approx(
        [0.788539, 0.546854, 0.410720], abs=1e-6
    )


@MASTERS
@pytest.mark.parametrize("speed", [0.01, 0.03, 0.05])
def test_restitution_of_a_head_on_blow_falls_with_the_square_of_the_step(master, speed):
    errors = []
    for h in (0.01, 0.005, 0.0025):
        result = simulated(master, speed=speed, step=h, **NO_LATCH)
        errors.append(speed_after(result) / speed - restitution(40 * speed))
    assert abs(errors[0]) < 4e-4
    assert abs(errors[2]) < 0.2 * max(map(abs, errors[:2]))


def test_deepest_point_is_the_closed_form():
    """k d^2.5/2.5 = m (v/c - ln(1 + c v)/c^2)."""
    v, c = 0.03, 40.0
    depth = (2.5 / 1e5 * M_RED * (v / c - np.log(1 + c * v) / c**2)) ** 0.4
    found = []
    for h in (0.002, 0.001):
        found.append(-0.12 - simulate(step=h, stop=1.5, **NO_LATCH)["mechanism.tip_Q"][:, 0].min())
    assert found[1] == pytest.approx(depth, rel=1e-5)


@pytest.mark.parametrize(
    ("c", "v", "after", "deepest"),
    [
        (0.15, 1.0, 0.9090157413489433, 0.05034751335970336),
        (0.5, 0.1, 0.09677385785309331, 0.00817859266561641),
        (0.3, 0.05, 0.04950494564164447, 0.004740253786869615),
    ],
)
def test_a_run_agrees_with_an_independent_integration(c, v, after, deepest):
    """m = 50 kg, k = 1e5 N/m^1.5: closed form confirmed by DOP853 to 3e-13 (arm_and_contact, 3).
    Without exact events an error of h^2 stays at the entry.
    """
    masses = {"servicer.mass_0": 100, "target.mass": 100, "mechanism.mass_T": 100}
    port = {"mechanism.damping_contact": c, "mechanism.max_step": 1e-4} | FLOOR_ONLY
    result = simulate(speed=v, tip=-0.119, step=0.0005, stop=0.4, **NO_LATCH, **masses, **port)
    assert speed_after(result) == pytest.approx(after, rel=2e-4)
    assert -0.12 - result["mechanism.tip_Q"][:, 0].min() == pytest.approx(deepest, rel=1e-4)


def test_slide_into_the_cone_and_out_again_retains_momenta_and_energy():
    """Off the axis, tumbling, with friction: momenta at 100 Hz, a quarter at half the step."""
    start = {
        "servicer.v_0_N": (-0.04, -0.0085, -0.0068),
        "target.omega_TN_T_0": (0.003, 0.004, -0.005),
        "servicer.omega_SN_S_0": (0.004, -0.004, -0.005),
        "servicer.sigma_SN_0": (0.02, 0.01, 1),
    } | NO_LATCH
    lost = []
    for h in (0.01, 0.005):
        result = simulate(step=h, stop=12, offset=(0.006, -0.004), tip=0.01, **start)
        assert result["mechanism.contact"].sum() * h > 0.3
        P, H = momenta(result)
        lost.append([drift(P), drift(H)])
        E = energy(result)
        assert np.ptp(E) < 2e-3 * E[0] * (h / 0.01) ** 2
    assert lost[0][0] < 1e-8 and lost[0][1] < 1e-7
    assert np.array(lost[1]) == pytest.approx(np.array(lost[0]) / 4, rel=0.35)


# ---- capture


START = {
    "servicer.v_0_N": (-0.04, -0.0085, -0.0068),
    "target.omega_TN_T_0": (0.003, 0.004, -0.005),
    "servicer.omega_SN_S_0": (0.004, -0.004, -0.005),
    "servicer.sigma_SN_0": (0.02, 0.01, 1),
    "servicer.wheel_speed_0": (0.03, -0.02, 0.02),
}
WHEELS = np.diag((12.0, 15, 10)) @ START["servicer.wheel_speed_0"]


def capture(master, h=0.01, stop=60, **more):
    return simulated(master, step=h, stop=stop, offset=(0.006, -0.004), tip=0.01, **(START | more))


@MASTERS
def test_momenta_stay_through_contact_soft_and_hard_capture_and_the_stack_turns_with_them(master):
    result = capture(master)
    phase = result["mechanism.phase"]
    assert [p for i, p in enumerate(phase) if i == 0 or p != phase[i - 1]][-2:] == [2, 3]
    P, H = momenta(result, wheels=WHEELS)
    assert drift(P) < 1e-8 and drift(H) < 1e-7
    finer = capture(master, 0.005)
    for before, after in zip((P, H), momenta(finer, wheels=WHEELS), strict=True):
        assert 3 < drift(before) / drift(after) < 5.5
    C_S, C_T = (matrices(result[f"{x}"][-1]) for x in ("servicer.q_SN", "target.q_TN"))
    rho = (result["servicer.r_SN_N"] - result["target.r_TN_N"])[-1]
    assert np.linalg.norm(rho) == pytest.approx(1.58, abs=2e-3)
    J = C_S @ J_S @ C_S.T + C_T @ J_T @ C_T.T + M_RED * (rho @ rho * np.eye(3) - np.outer(rho, rho))
    w = np.linalg.solve(J, H[-1] - C_S @ WHEELS)
    for found in (C_S @ result["servicer.omega_SN_S"][-1], C_T @ result["target.omega_TN_T"][-1]):
        assert np.allclose(found, w, atol=2e-6)


def test_energy_of_a_capture_is_accounted_for():
    errors = []
    for h in (0.01, 0.005):
        result = capture(("gauss-seidel", 0), h, **{"servicer.wheel_speed_0": (0, 0, 0)})
        E = energy(result)
        errors.append(drift(E) / kinetic(result)[0])
    assert errors[0] < 5e-4 and errors[1] < errors[0] / 3


@MASTERS
def test_the_same_capture_in_both_masters(master):
    """A step late with latency 1: phases within two steps of each other."""
    times = []
    for each in (("gauss-seidel", 0), master):
        result = capture(each)
        times.append([result.time[np.argmax(result["mechanism.phase"] == p)] for p in (2, 3)])
    assert np.allclose(*times, atol=0.0201)


def test_relative_momenta_stay_in_orbit_too():
    """Gravity and J2 on both: the relative linear momentum changes by tides of 1e-6 m/s2 times the
    mass and no more over the contact; the rates agree with the rates in deep space to 1e-6.
    """
    orbit = {
        f"{x}.{name}": value
        for x in ("servicer", "target")
        for name, value in {"mu": 3.986004415e14, "use_J2": 1, "a": 0}.items()
    }
    r, v = np.array((7e6, 1e6, 2e6)), np.array((-1e3, 7e3, 1e3))
    place = np.array((0.6 + 0.01 + 1.1, 0.006, -0.004))
    near = START | {
        "servicer.r_0_N": r + place,
        "servicer.v_0_N": v + START["servicer.v_0_N"],
        "target.r_0_N": r,
        "target.v_0_N": v,
    }
    high = simulate(step=0.01, stop=10, **(orbit | near))
    deep = simulate(step=0.01, stop=10, offset=(0.006, -0.004), tip=0.01, **START)
    assert 2 in high["mechanism.phase"]
    for name in ("servicer.omega_SN_S", "target.omega_TN_T"):
        assert np.allclose(high[name], deep[name], atol=2e-5)


# ---- the latched pair


def hard_pair(h=0.002, stop=2.0, damping=(0.0, 0.0), **more):
    """Caught and seated at once at rest, then left with what START gives."""
    return simulate(
        tip=-0.12,
        speed=0,
        step=h,
        stop=stop,
        **{
            "mechanism.trip_force": 0,
            "mechanism.latch_dwell": 0,
            "mechanism.draw_delay": 1e-9,
            "mechanism.draw_time": 1e-9,
            "mechanism.hard_rate": 1,
            "mechanism.hard_speed": 1,
            "mechanism.latch_speed": 1,
            "mechanism.latch_rate": 1,
            "mechanism.c_hard": damping[0],
            "mechanism.c_rot_hard": damping[1],
        },
        **more,
    )


def mode_rates(k, k_r):
    """Eigenvalues of W diag(k, k, k, k_r, k_r, k_r): sums over both bodies at the tip (T axes)."""

    def tilde(d):
        return np.cross(np.eye(3), d)

    W = np.zeros((6, 6))
    W[:3, :3] = np.eye(3) / M_RED
    half_turn = np.diag((-1.0, -1, 1))
    levers = ((half_turn @ J_S @ half_turn, (-1.1, 0, 0)), (J_T, (0.48, 0, 0)))
    for J, d in levers:
        D, K = tilde(np.array(d)), np.linalg.inv(J)
        W += np.block([[-D @ K @ D, -D @ K], [K @ D, K]])
    return np.sort(np.sqrt(eigvals(W @ np.diag((k,) * 3 + (k_r,) * 3)).real))


def test_modes_of_the_latched_pair_match_its_stiffness():
    """Axial and roll sqrt(k/m): read from the run; all six from the formula of the page."""
    hard, soft = mode_rates(20000, 20000), mode_rates(100, 40)
    assert hard == pytest.approx([14.53, 17.32, 18.26, 18.64, 21.52, 23.54], abs=6e-3)
    assert soft == pytest.approx([0.651, 0.775, 0.839, 1.291, 1.519, 1.654], abs=6e-4)
    axial = hard_pair(**{"servicer.v_0_N": (-1e-3, 0, 0)})
    roll = hard_pair(**{"servicer.omega_SN_S_0": (1e-3, 0, 0)})
    for result, name, axis, expected in (
        (axial, "mechanism.tip_Q", 0, np.sqrt(20000 / M_RED)),
        (roll, "mechanism.omega_PQ_Q", 0, np.sqrt(20000 * (1 / 200 + 1 / 100))),
    ):
        x = result[name][2:, axis] - result[name][2:, axis].mean() * (name.endswith("tip_Q"))
        crossings = np.flatnonzero(np.diff(np.sign(x)))
        at = result.time[2:][crossings] + 0.002 * x[crossings] / (x[crossings] - x[crossings + 1])
        assert np.pi / np.diff(at)[1:-1].mean() == pytest.approx(expected, rel=2e-3)
        assert np.abs(hard - expected).min() < 1e-9 * expected


@pytest.mark.parametrize("h", [0.01, 0.02, 0.05, 0.1])
def test_hold_takes_what_the_closed_form_states_from_an_undamped_mode(h):
    """Energy of the axial mode: times cos theta + theta sin theta/2 a step."""
    result = hard_pair(h, stop=max(2.0, 60 * h), **{"servicer.v_0_N": (-1e-3, 0, 0)})
    x = result["mechanism.tip_Q"][:, 0] + 0.12
    v = result["mechanism.dtip_Q"][:, 0]
    theta = h * np.sqrt(20000 / M_RED)
    factor = np.cos(theta) + theta * np.sin(theta) / 2
    # the amplitude of x_n = r^n cos(n phi): r^2 is the determinant of one step of the oscillator
    D = np.array([[x[i] * v[i + 1] - x[i + 1] * v[i]] for i in range(3, 40)])[:, 0]
    assert D[1:] / D[:-1] == pytest.approx(factor, rel=2e-4)


@pytest.mark.parametrize("h", [0.01, 0.1])
def test_the_latch_is_stable_up_to_a_tenth_of_a_second(h):
    """Its own damping only; all six modes excited."""
    kick = {"servicer.v_0_N": (-2e-3, 1e-3, 1e-3), "servicer.omega_SN_S_0": (2e-3, 1e-3, -1e-3)}
    result = hard_pair(h, stop=20, damping=(110, 140), **kick)
    force = result["mechanism.load_force"]
    assert force[-20:].max() < 0.02 * force.max() and (result["mechanism.phase"][-1]) == 3


# ---- published reference values


SIMBODY = [
    (0.1, -1.0), (0.1, 0.0), (0.2, 0.5), (0.4, -0.3), (0.5, 1.0), (0.8, 0.2), (0.8, -1.0),
]  # fmt: skip


@pytest.mark.parametrize(("depth", "rate"), SIMBODY)
def test_parameters_of_simbodys_test_of_hunt_and_crossley(depth, rate):
    """TestHuntCrossleyForce (Apache-2): sphere R = 0.8, k 1 and 2 (s_i = k_i^(2/3)), dissipation
    0.5 and 1; f = 4/3 s x sqrt(R s x) (1 + 1.5 d v), never below 0; tolerance 1e-10.
    """
    s1, s2, R = 1.0, 2 ** (2 / 3), 0.8
    s = s1 * s2 / (s1 + s2)
    d = (0.5 * s2 + 1.0 * s1) / (s1 + s2)
    required = max(0.0, 4 / 3 * s * depth * np.sqrt(R * s * depth) * (1 + 1.5 * d * rate))
    port = {
        "mechanism.k_contact": 4 / 3 * s * np.sqrt(R * s),
        "mechanism.damping_contact": 1.5 * d,
        "mechanism.friction": 0,
    } | FLOOR_ONLY
    result = simulate(tip=-0.12 - depth, speed=rate, step=0.001, stop=0.001, **NO_LATCH, **port)
    assert result["mechanism.normal_force"][1] == pytest.approx(required, abs=1e-10)


def test_two_spheres_of_jeod_on_a_linear_spring_and_damper():
    """SIM_contact RUN_point (NASA Open Source Agreement 1.3, numbers only): 100 kg each, 20 lbf/in,
    0.4 lbf s/in, closing at 2 m/s. The latch is linear: caught at first touch it is that contact.
    """
    k, c = 3502.5367049295273, 70.05073409859055
    masses = {"servicer.mass_0": 100, "target.mass": 100, "mechanism.mass_T": 100}
    latch = {"k_soft": k, "c_soft": c, "draw_delay": 1e3, "latch_speed": 3, "break_force": 1e9}
    free = {"latch_dwell": 0, "trip_force": 0}
    given = {f"mechanism.{name}": value for name, value in (latch | free).items()}
    h = 0.001
    result = simulate(tip=-0.115, speed=2.0, step=h, stop=0.4, **masses, **given)
    x = result["servicer.r_SN_N"][:, 0] - result["target.r_TN_N"][:, 0]
    x, v = x - x[0], result["servicer.v_SN_N"][:, 0] - result["target.v_TN_N"][:, 0]
    assert -x.min() == pytest.approx(0.2109028871556693, rel=1e-5)
    out = np.flatnonzero((x[1:] >= 0) & (v[1:] > 0))[0] + 1
    part = x[out - 1] / (x[out - 1] - x[out])
    assert h * (out - 1 + part) == pytest.approx(0.37667778892089376, rel=1e-4)
    assert v[out - 1] + part * (v[out] - v[out - 1]) == pytest.approx(1.536153591564529, rel=1e-4)
    turn = np.flatnonzero(np.diff(np.sign(v)))[0]
    part = v[turn] / (v[turn] - v[turn + 1])
    assert h * (turn + part) == pytest.approx(0.17829193067750335, rel=1e-4)
    assert result["mechanism.load_force"][1] == pytest.approx(140.1014681971811, rel=0.03)


def test_docking_of_jeod_ends_with_the_rate_of_the_assembly():
    """SIM_verif_attach_detach RUN_simple_attach_detach (NASA Open Source Agreement 1.3, numbers
    only): 1 kg and 2 kg, 10 m apart, 1 m/s across, 0.2 rad/s; rigid from then on: -0.8/29 rad/s.
    Here through a damped latch.
    """
    J1, J2 = np.diag((10.0,) * 3), np.diag((20.0,) * 3)
    bodies = {
        "servicer.mass_0": 1,
        "mechanism.mass_S": 1,
        "servicer.J_S": J1,
        "mechanism.J_S": J1,
        "servicer.A_w": np.eye(3) / 10,
        "target.mass": 2,
        "mechanism.mass_T": 2,
        "target.J_T": J2,
        "mechanism.J_T": J2,
        "servicer.r_0_N": (-5, 10, 0),
        "servicer.v_0_N": (0, 1, 0),
        "servicer.sigma_SN_0": (0, 0, 0),
        "target.r_0_N": (5, 10, 0),
        "target.omega_TN_T_0": (0, 0, 0.2),
        "mechanism.p_PS_S": (5, 0, 0),
        "mechanism.q_QT": (0, 0, 0, 1),
        "mechanism.p_QT_T": (-5.12, 0, 0),
    }
    latch = {"k_soft": 200, "c_soft": 60, "k_rot_soft": 200, "c_rot_soft": 150, "draw_delay": 1e3}
    window = {"latch_speed": 9, "latch_rate": 9, "latch_dwell": 0, "trip_force": 0}
    limits = {"break_force": 1e9, "break_moment": 1e9}
    given = {f"mechanism.{name}": value for name, value in (latch | window | limits).items()}
    result = simulate(step=0.01, stop=100, **bodies, **given)
    assert result["mechanism.phase"][-1] == 2
    # the latch stretches by the centrifugal force, 2.5 mm of 10 m: inertia 30 + 2/3 d^2
    d = np.linalg.norm((result["servicer.r_SN_N"] - result["target.r_TN_N"])[-1])
    stretched = -0.8 / 29 * (30 + 200 / 3) / (30 + 2 / 3 * d**2)
    for name in ("servicer.omega_SN_S", "target.omega_TN_T"):
        assert result[name][-1, 2] == pytest.approx(stretched, rel=2e-6)
    assert abs(d - 10) < 0.01
