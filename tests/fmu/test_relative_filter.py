# SPDX-License-Identifier: BSD-2-Clause
"""relative_filter.fmu: against dense matrices that filter the whole history anew, closed forms of
orbit and attitude, delay, gate, parts that are not estimated.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm

from tests.close import close
from tests.each import Each
from tests.reference import kalman
from tests.reference.attitude import conjugate, dcm, multiply
from tests.reference.cases import quaternion
from tests.reference.kalman import SLICES, err, rot
from tests.reference.orbit import hill_axes

from .driver import bits
from .estimates import estimate, memory, named, put_covariance
from .rejections import rejection
from .relative_cases import NO_POSE, World
from .sensor_cases import turn_between
from .theory import MU

T = 0.1


@pytest.fixture
def rng():
    return Each(range(2)).map(np.random.default_rng)


WIDE = {"kappa": [0.01] * 5, "d": [0.05, 0.1, 0.15]}
MOUNTED = {"p_KS_S": (0.5, -0.4, 0.3), "q_KS": (0.8, 0.0, 0.6, 0.0)}


def difference(x, expected):
    """Error vector of 23 numbers: expected less x, attitude on the right."""
    parts = [expected[n] - x[n] for n in ("rho", "v")]
    parts += [err(multiply(conjugate(x["q"]), expected["q"]))]
    return np.concatenate(parts + [expected[n] - x[n] for n in ("w", "kappa", "d", "a")])


def same(unit, expected, P, tolerance=1e-9):
    """State to a billionth of the standard deviations, covariance to a billionth of their products;
    floor: rounding of positions of 7e6 m.
    """
    x, ours = estimate(unit)
    sigma = np.sqrt(np.diag(P))
    floor = np.repeat((1e-8, 1e-10, 1e-13, 1e-13, 1e-15), (3, 3, 3, 3, 11))
    assert (np.abs(difference(named(x), expected)) <= tolerance * sigma + floor).all()
    assert (np.abs(ours - P) <= tolerance * np.outer(sigma, sigma) + 1e-30).all()


@pytest.mark.parametrize("late", [0, 3, 12, 15])
@pytest.mark.parametrize("sigma_0", [{}, WIDE], ids=["15 states", "23 states"])
def test_filter_is_the_dense_one(fmu, late, sigma_0):
    """Thrust, delay, outliers up to a new acquisition; poses every fifth sample, each filtered at
    its stamp by a reference that begins at the start again.
    """
    world = World(
        np.random.default_rng(late), sigma_0=sigma_0, sigma_kappa=1e-4 * bool(sigma_0), **MOUNTED
    )
    world.model.reset_after = 3
    unit, poses = fmu("relative_filter", world.parameters()), {}
    for k in range(76):
        u, m = world.inputs(k), k - late
        if m >= 0 and m % 5 == 0:
            poses[m] = world.pose(m, wrong=(1, -1, 0.5) if 30 <= m < 45 else (0, 0, 0))
            u |= world.port(m, poses[m])
        unit.step(T, u)
        if k in (0, 40, 75):
            x, P, track = world.model.history(world.start, world.slots[: k + 1], poses)
            same(unit, x, P)
            assert unit.get("pose_nis") == pytest.approx(track.nis, rel=1e-7, abs=1e-9)
            assert unit.get("pose_rejected") == track.rejected
            assert unit.get("pose_late") == 0
    assert track.rejected >= 3


@pytest.mark.verifies("F.6-5")
@pytest.mark.parametrize("gap", [14, 15, 16, 17, 40])
def test_anchor_crosses_a_gap_longer_than_the_ring(fmu, rng, gap):
    """No pose for longer than 16 samples, under thrust: the anchor follows through samples that are
    about to leave the ring.
    """
    world = World(rng, thrust=200.0, sigma_thrust=0.0)
    unit = fmu("relative_filter", world.parameters())
    poses = {}
    for k in range(gap + 8):
        u = world.inputs(k)
        if k in (0, gap + 5):
            m = max(0, k - 5)
            poses[m] = world.pose(m)
            u |= world.port(m, poses[m])
        unit.step(T, u)
    x, P, _ = world.model.history(world.start, world.slots, poses)
    assert unit.get("pose_late") == 0
    same(unit, x, P)


# ---- equations of motion


def moved(world, x, error, slot):
    """State after one RK4 step from x and an error."""
    return world.model.propagate(world.model.corrected(x, error), np.zeros((23, 23)), slot)[0]


def transition_by_differences(world, x, slot):
    """Central differences of one RK4 step, column by column."""
    after, sizes = (
        moved(world, x, np.zeros(23), slot),
        np.repeat((1, 0.1, 1e-4, 1e-5, 1e-3), (3, 3, 3, 3, 11)),
    )
    columns = []
    for e, h in zip(np.eye(23), sizes, strict=True):
        ends = [difference(after, moved(world, x, sign * h * e, slot)) for sign in (1, -1)]
        columns.append((ends[0] - ends[1]) / (2 * h))
    return np.array(columns).T


def transition(fmu, world, x):
    """Phi of the FMU, from a covariance of one error at a time; sign by the diagonal, which is
    near 1.
    """
    columns = []
    for e in np.eye(23):
        unit = fmu("relative_filter", world.parameters(omega_TN_T_0=x["w"], sigma_thrust=0))
        unit.step(world.model.T, world.inputs(0))
        put_covariance(unit, np.outer(e, e))
        unit.step(world.model.T, world.inputs(1))
        P, i = estimate(unit)[1], int(np.argmax(e))
        columns.append(P[i] / np.sqrt(P[i, i]))
    return np.array(columns).T


def transition_error(fmu, T):
    silent = {"sigma_a": 0, "sigma_alpha": 0, "sigma_acc": 0}
    world = World(np.random.default_rng(2), rate=0.0, T=T, **silent)
    x = world.start | {"w": 0.1 * np.array((2, -1, 2)) / 3}
    world.x[0] = x
    world.inputs(1)
    return np.abs(transition(fmu, world, x) - transition_by_differences(world, x, world.slots[0]))


def test_transition_is_the_derivative_of_the_motion(fmu):
    """2e-5 at 0.1 rad/s, where A is frozen over the step."""
    error = transition_error(fmu, 0.1)
    assert error.max() < 2e-5
    assert error[:6].max() < 1e-6


def test_error_of_the_transition_falls_with_the_square_of_the_period(fmu):
    """At least: 4 (1 +- 5 %) or more from half the period."""
    errors = [transition_error(fmu, period).max() for period in (0.4, 0.2)]
    assert errors[0] / errors[1] > 3.8


CIRCULAR = 7.0e6


def cw_transition(n, t):
    """State transition of Clohessy and Wiltshire, Hill axes, velocity as seen in H."""
    A = np.zeros((6, 6))
    A[:3, 3:] = np.eye(3)
    A[3, 0], A[5, 2], A[3, 4], A[4, 3] = 3 * n**2, -(n**2), 2 * n, -2 * n
    return expm(A * t)


def seen_in_N(C_HN, n):
    """(rho, drho as seen in H) in H axes to (rho, v as seen in N) in N axes."""
    w = np.array([[0, -n, 0], [n, 0, 0], [0, 0, 0]])
    return np.block([[C_HN.T, np.zeros((3, 3))], [C_HN.T @ w, C_HN.T]])


@pytest.fixture(scope="module")
def coasting(kind):
    """A filter alone for 1000 s beside a target on a circular orbit, without J2: start, state and
    covariance then, transition by theory.
    """
    from .driver import Unit

    n = np.sqrt(MU / CIRCULAR**3)
    rho, drho = np.array((1.0, 20.0, -3.0)), np.array((0.002, -0.003, 0.001))
    C = np.array([[1, 0, 0], [0, 0.8, 0.6], [0, -0.6, 0.8]])  # of the target at t = 0
    p = {"use_J2": 0, "sigma_a": 0, "sigma_acc": 0, "sigma_acc_0": 0, "sigma_alpha": 0}
    p |= {"sigma_rho_0": 0.7, "sigma_drho_0": 1e-3, "mu": MU}

    def target(t):
        c, s = np.cos(n * t), np.sin(n * t)
        r, v = C.T @ (c, s, 0), C.T @ (-s, c, 0)
        return CIRCULAR * r, CIRCULAR * n * v, hill_axes(r, v)

    def servicer(t):
        """Two-body motion of the servicer about the same planet, from its exact start."""
        return kepler(r_0, v_0, t)

    r_T, v_T, C_HN = target(0.0)
    to_N = seen_in_N(C_HN, n)
    start = to_N @ np.concatenate((rho, drho))
    r_0, v_0 = r_T + start[:3], v_T + start[3:]
    own = hill_axes(r_0, v_0)
    p |= {"rho_0_H": own @ start[:3]}
    turning = np.cross(r_0, v_0) / (r_0 @ r_0)
    p |= {"drho_0_H": own @ (start[3:] - np.cross(turning, start[:3]))}
    unit = Unit(kind("relative_filter"), p, {}, 0.0)
    for k in range(10001):
        r, v = servicer(k * T)
        unit.step(T, NO_POSE | {"r_SN_N_hat": r, "v_SN_N_hat": v})
    Psi = seen_in_N(target(1000.0)[2], n) @ cw_transition(n, 1000.0) @ np.linalg.inv(to_N)
    yield Psi, start, *estimate(unit)
    unit.close()


def kepler(r, v, t):
    """Two-body motion by Lagrange's coefficients with the eccentric anomaly."""
    R, a = np.linalg.norm(r), 1 / (2 / np.linalg.norm(r) - v @ v / MU)
    n, s, c = np.sqrt(MU / a**3), r @ v / np.sqrt(MU * a), 1 - R / a
    E = n * t
    for _ in range(20):
        E -= (E + s * (1 - np.cos(E)) - c * np.sin(E) - n * t) / (1 + s * np.sin(E) - c * np.cos(E))
    f = 1 - a / R * (1 - np.cos(E))
    g = t - (E - np.sin(E)) / n
    now = f * r + g * v
    df = -np.sqrt(MU * a) / (np.linalg.norm(now) * R) * np.sin(E)
    dg = 1 - a / np.linalg.norm(now) * (1 - np.cos(E))
    return now, df * r + dg * v


def test_relative_motion_matches_clohessy_and_wiltshire(coasting):
    """Second order in rho/a: 20^2/7e6 grown by the drift, 0.5 mm; a Coriolis term too many would be
    metres.
    """
    Psi, start, x, _ = coasting
    expected = Psi @ start
    assert x[:3] == pytest.approx(expected[:3], abs=5e-4)
    assert x[3:6] == pytest.approx(expected[3:], abs=1e-6)


def test_covariance_of_relative_motion_matches_clohessy_and_wiltshire(coasting):
    """3e-4 of the standard deviations over 1000 s: A is frozen over a step."""
    Psi, _, _, P = coasting
    expected = Psi @ np.diag(np.repeat((0.7**2, 1e-6), 3)) @ Psi.T
    sigma = np.sqrt(np.diag(expected))
    assert np.abs((P[:6, :6] - expected) / np.outer(sigma, sigma)).max() < 3e-4
    assert not P[12:].any()


def test_symmetric_target_nutates_as_in_the_closed_form(fmu):
    """J = diag(90, 90, 150): w turns about z at (I3 - It)/It w3; rotation of T checked by the
    momentum, which is constant in N.
    """
    w_0 = np.array((0.03, -0.04, 0.12))
    p = {
        "mu": 0,
        "J_T": np.diag((90, 90, 150)),
        "omega_TN_T_0": w_0,
        "sigma_TN_0": [0.1, 0.3, -0.2],
    }
    unit = fmu("relative_filter", p)
    still = NO_POSE | {"r_SN_N_hat": [0, 0, 0], "v_SN_N_hat": [0, 0, 0]}
    h_N = dcm(unit.get("q_TN")).T @ (np.diag((90, 90, 150)) @ w_0)
    for k in range(1001):
        unit.step(T, still)
        if k % 100 == 0:
            phase = (150 - 90) / 90 * w_0[2] * k * T
            turned = (w_0[0] + 1j * w_0[1]) * np.exp(1j * phase)
            w = unit.get("omega_TN_T")
            assert w == pytest.approx((turned.real, turned.imag, w_0[2]), abs=1e-9)
            assert dcm(unit.get("q_TN")).T @ (np.diag((90, 90, 150)) @ w) == pytest.approx(
                h_N, abs=1e-6
            )


# ---- measurement


def test_measurement_matrix_is_the_derivative_of_the_measurement(rng):
    """H_1 of the reference, which the filter agrees with, by differences: 1e-6."""
    world = World(rng, **MOUNTED)
    x, q_SN = world.start, world.slots[0]["q"]
    H = world.model.position_matrix(x, q_SN)
    for i, e in enumerate(np.eye(23)):
        ends = [
            world.model.predicted(world.model.corrected(x, s * 1e-5 * e), q_SN) for s in (1, -1)
        ]
        assert H[:, i] == pytest.approx((ends[0] - ends[1]) / 2e-5, abs=1e-6)


def test_acquisition_is_the_scatter_of_what_it_computes(fmu):
    """2000 acquisitions by the pose formula with noise in pose and d: the covariance of the FMU
    holds their errors, 10 % of the products of the standard deviations.
    """
    rng = np.random.default_rng(1)
    world = World(rng, sigma_0=WIDE, sigma_mount=0.0, **MOUNTED)
    unit = fmu("relative_filter", world.parameters())
    u = world.inputs(0)
    unit.step(T, u | world.port(0, world.pose(0, noise=0.0)))
    P = estimate(unit)[1]
    true, q_SN = world.x[0], world.slots[0]["q"]
    errors = []
    for _ in range(2000):
        d = true["d"] + np.array(WIDE["d"]) * rng.normal(size=3)
        x, _ = world.model.acquired(true | {"d": d}, q_SN, world.pose(0))
        errors.append(difference(x, true))
    at = np.r_[0:3, 6:9, 17:20]
    scatter, sigma = np.cov(np.array(errors)[:, at].T), np.sqrt(np.diag(P))[at]
    assert np.abs((scatter - P[np.ix_(at, at)]) / np.outer(sigma, sigma)).max() < 0.1


def test_acquisition_sets_position_and_attitude_only(fmu, rng):
    world = World(rng, sigma_0=WIDE, **MOUNTED)
    unit = fmu("relative_filter", world.parameters())
    unit.step(T, world.inputs(0) | world.port(0, world.pose(0, noise=0.0)))
    x = named(estimate(unit)[0])
    assert x["rho"] == pytest.approx(world.x[0]["rho"], abs=1e-12)
    assert turn_between(x["q"], world.x[0]["q"]) < 1e-14
    for name in ("v", "w", "kappa", "d", "a"):
        assert x[name] == pytest.approx(world.start[name], abs=1e-15)
    expected = world.model.acquired(world.start, world.slots[0]["q"], world.pose(0, noise=0.0))[1]
    assert estimate(unit)[1] == pytest.approx(expected, abs=1e-12)
    assert (unit.get("pose_nis"), unit.get("pose_age"), unit.get("relative_valid")) == (0, 0, 1)


def filtered(fmu, world, late, samples=60, every=5, **p):
    unit = fmu("relative_filter", world.parameters(**p))
    for k in range(samples):
        u, m = world.inputs(k), k - late
        if m >= 0 and m % every == 0:
            u |= world.port(m, world.poses.setdefault(m, world.pose(m)))
        unit.step(T, u)
    return unit


@pytest.mark.verifies("F.6-1")
def test_delay_does_not_change_the_anchor(fmu, rng):
    """The same poses 0, 3 and 12 samples late: the same anchor after the same pose, bits."""
    world, seen = World(rng), set()
    world.poses = {}
    for late in (0, 3, 12):
        unit = filtered(fmu, world, late, samples=41 + late)
        seen.add(b"".join(part.tobytes() for part in estimate(unit, anchor=True)))
    assert len(seen) == 1


@pytest.mark.verifies("F.6-1")
def test_head_of_a_late_filter_is_its_anchor_carried_on(fmu, rng):
    """As the filter without delay that has had no pose since."""
    world = World(rng)
    world.poses = {}
    late = filtered(fmu, world, 12, samples=53)
    prompt = filtered(fmu, world, 0, samples=41)
    for k in range(41, 53):
        prompt.step(T, world.inputs(k))
    for a, b in zip(estimate(late), estimate(prompt), strict=True):
        assert (a == b).all()


def test_ignored_time_stamps_take_a_pose_for_one_of_its_arrival(fmu, rng):
    world = World(rng)
    unit = fmu("relative_filter", world.parameters(use_time_stamp=0))
    poses = {}
    for k in range(40):
        u = world.inputs(k)
        if k >= 3 and k % 5 == 0:
            poses[k] = world.pose(k)
            u |= world.port(k - 3, poses[k])
        unit.step(T, u)
    x, P, _ = world.model.history(world.start, world.slots, poses)
    same(unit, x, P)
    assert unit.get("pose_age") == pytest.approx(0.7)


def twins(fmu, rng, samples=41):
    """Two filters that have gone the same way, and the world."""
    world = World(rng)
    world.poses = {}
    return world, filtered(fmu, world, 0, samples), filtered(fmu, world, 0, samples)


@pytest.mark.verifies("F.6-2")
@pytest.mark.parametrize("change", ["late", "future", "repeated", "invalid"])
def test_poses_that_cannot_be_used_change_nothing_but_their_count(fmu, rng, change):
    """Older than the anchor, from the future, seen before, not valid."""
    world, a, b = twins(fmu, rng)
    stamp = {"late": 39, "future": 43, "repeated": 40, "invalid": 41}[change]
    u = world.inputs(41)
    other = world.port(min(stamp, 41), world.pose(41)) | {"pose_time": stamp * T}
    if change == "late":
        for unit in (a, b):  # the anchor is at 40: a stamp of 39 is news only if 40 were not
            with memory(unit) as x:
                x[2 * 553 + 4] = 3.0
    a.step(T, u)
    b.step(T, u | other | {"pose_valid": float(change != "invalid")})
    assert b.get("pose_late") == (change in ("late", "future"))
    for name, value in a.outputs().items():
        assert name == "pose_late" or np.array_equal(value, b.get(name)), name
    for part in range(2):
        assert (estimate(a)[part] == estimate(b)[part]).all()
        assert (estimate(a, anchor=True)[part] == estimate(b, anchor=True)[part]).all()


def test_a_pose_stamped_in_the_future_makes_all_earlier_ones_late(fmu, rng):
    world, a, b = twins(fmu, rng)
    b.step(T, world.inputs(41) | world.port(0, world.pose(41)) | {"pose_time": 44 * T})
    a.step(T, world.inputs(41))
    for k in (42, 43, 44):
        for unit in (a, b):
            unit.step(T, world.inputs(k) | world.port(k, world.poses.setdefault(k, world.pose(k))))
        assert b.get("pose_late") == 1
        assert b.get("pose_age") == pytest.approx((k - 40) * T)
    assert a.get("pose_age") == 0


@pytest.mark.verifies("F.6-3")
def test_a_pose_far_outside_the_gate_counts_and_moves_only_the_anchor(fmu, rng):
    world, a, b = twins(fmu, rng)
    u = world.inputs(41)
    a.step(T, u)
    b.step(T, u | world.port(41, world.pose(41, wrong=(5, 5, 5))))
    for one, other in zip(estimate(a), estimate(b), strict=True):
        assert (one == other).all()
    with memory(a) as x, memory(b) as y:
        assert (x[2 * 553 + 2], y[2 * 553 + 2]) == (40, 41)
    assert b.get("pose_rejected") == 1
    assert b.get("pose_nis") > 22.46
    assert b.get("pose_age") == pytest.approx(a.get("pose_age"))


@pytest.mark.verifies("F.6-3")
def test_gate_tests_position_and_attitude_together(fmu, rng):
    """Each alone would pass, both together not."""
    world, a, b = twins(fmu, rng)
    u = world.inputs(41)
    clean = world.pose(41, noise=0.0)

    def alone(dr, a_0):
        saved = a.slave.getFMUState()
        pose = {"r": clean["r"] + dr, "q": multiply(clean["q"], rot(a_0))}
        a.step(T, u | world.port(41, pose))
        nis = a.get("pose_nis")
        a.slave.setFMUState(saved)
        a.slave.freeFMUState(saved)
        a.time -= T
        return nis

    dr, turned, none = np.array((0.3, 0, 0)), np.array((0.1, 0, 0)), np.zeros(3)
    dr, turned = (dr * np.sqrt(16 / alone(dr, none)), turned * np.sqrt(16 / alone(none, turned)))
    assert max(alone(dr, none), alone(none, turned)) < 22.46 < alone(dr, turned)
    b.step(T, u | world.port(41, {"r": clean["r"] + dr, "q": multiply(clean["q"], rot(turned))}))
    assert b.get("pose_rejected") == 1


def test_rows_of_parts_that_are_not_estimated_stay_exactly_zero(fmu, rng):
    world = World(rng, sigma_0={"d": [0, 0.1, 0]})
    world.poses = {}
    unit = filtered(fmu, world, 3)
    x, P = estimate(unit)
    assert not P[SLICES["kappa"]].any()
    assert not P[[17, 19]].any()
    assert P[18, 18] > 0
    assert (named(x)["kappa"] == world.start["kappa"]).all()


def test_covariance_stays_symmetric_and_not_negative(fmu, rng):
    world = World(rng, sigma_0=WIDE)
    unit = fmu("relative_filter", world.parameters())
    for k in range(60):
        unit.step(T, world.inputs(k) | (world.port(k, world.pose(k)) if k % 5 == 0 else {}))
        P = estimate(unit)[1]
        assert (P == P.T).all()
        scale = np.sqrt(np.diag(P))
        assert np.linalg.eigvalsh(P / np.outer(scale, scale)).min() > -1e-12


def test_half_a_turn_of_a_symmetric_target_is_resolved(fmu, rng):
    """The pose that is half a turn about flip_axis off counts as the one that is not."""
    axis = np.array((0.0, 0.6, 0.8))
    world = World(rng)
    plain = fmu("relative_filter", world.parameters(flip_axis=axis, acquire=0))
    other = fmu("relative_filter", world.parameters(flip_axis=axis, acquire=0, resolve_flip=1))
    for k in range(31):
        u = world.inputs(k)
        pose = world.pose(k)
        plain.step(T, u | (world.port(k, pose) if k % 5 == 0 else {}))
        flipped = pose | {"q": multiply(pose["q"], (0, *axis))}
        use = flipped if k % 10 == 0 else pose
        other.step(T, u | (world.port(k, use) if k % 5 == 0 else {}))
    assert other.get("pose_rejected") == 0
    assert turn_between(plain.get("q_TN"), other.get("q_TN")) < 1e-12
    assert plain.get("r_TN_N") == pytest.approx(other.get("r_TN_N"), abs=1e-8)


def test_quaternions_of_either_sign_are_the_same_attitude(fmu, rng):
    world = World(rng)
    a, b = (fmu("relative_filter", world.parameters()) for _ in range(2))
    for k in range(20):
        u = world.inputs(k) | (world.port(k, world.pose(k)) if k % 5 == 0 else {})
        a.step(T, u)
        b.step(T, u | {n: -np.asarray(u[n]) for n in ("q_SN_hat", "q_TK") if n in u})
        assert bits(a) == bits(b)


def test_servicer_goes_through_as_read_at_the_sample(fmu, rng):
    """So that r_S - r_T is rho for any delays in front."""
    world = World(rng)
    unit = fmu("relative_filter", world.parameters())
    for k in range(10):
        u = world.inputs(k)
        unit.step(T, u)
        assert (unit.get("r_SN_N") == u["r_SN_N_hat"]).all()
        assert (unit.get("v_SN_N") == u["v_SN_N_hat"]).all()
        assert (unit.get("omega_SN_S") == u["omega_SN_S_hat"]).all()
        close(unit.get("q_SN"), kalman.canonical(u["q_SN_hat"]), rel=1e-14)
        rho = named(estimate(unit)[0])["rho"]
        assert unit.get("r_SN_N") - unit.get("r_TN_N") == pytest.approx(rho, abs=2e-9)


@pytest.mark.verifies("F.6-4")
def test_start_values_are_published_and_not_valid(fmu, rng):
    world = World(rng)
    u = world.inputs(0)
    unit = fmu("relative_filter", world.parameters(), u)
    rho = unit.get("r_SN_N") - unit.get("r_TN_N")
    assert rho == pytest.approx(world.start["rho"], abs=2e-9)
    assert unit.get("v_SN_N") - unit.get("v_TN_N") == pytest.approx(world.start["v"], abs=1e-11)
    assert turn_between(unit.get("q_TN"), world.start["q"]) < 1e-14
    assert (unit.get("relative_valid"), unit.get("pose_age")) == (0, 1)
    other = world.inputs(5)
    unit.step(T, other)  # the first sample starts anew, from its inputs
    C_HN, own = (hill_axes(world.slots[k]["r"], world.slots[k]["v"]) for k in (0, 5))
    moved_rho = unit.get("r_SN_N") - unit.get("r_TN_N")
    assert moved_rho == pytest.approx(own.T @ C_HN @ world.start["rho"], abs=1e-8)


@pytest.mark.verifies("F.6-7")
def test_finer_master_steps_give_the_same_bits(fmu, rng):
    world = World(rng)
    coarse, fine = (fmu("relative_filter", world.parameters()) for _ in range(2))
    for k in range(40):
        u = world.inputs(k)
        if k >= 3 and k % 5 == 3:
            u |= world.port(k - 3, world.pose(k - 3))
        coarse.step(T, u)
        fine.step(0.03, u)
        fine.step(0.07, NO_POSE | {"F_cmd_S": [9, 9, 9], "q_SN_hat": quaternion(rng)})
        assert bits(coarse) == bits(fine)


@pytest.mark.verifies("F.6-5")
def test_a_sample_lost_to_rounding_does_no_harm(fmu, rng):
    """The master's time 0.9e-9 s off once: sample 1 falls between two steps, the servicer coasts
    through it.
    """
    world = World(rng, thrust=0.0)
    world.turning = np.zeros(3)
    plain, jittered = (fmu("relative_filter", world.parameters()) for _ in range(2))
    for k in range(6):
        u = world.inputs(k) | (world.port(k, world.pose(k)) if k == 0 else {})
        plain.step(T, u)
        jittered.set(u)
        jittered.slave.doStep(k * T + 0.9e-9 * (k == 0), T)
    for a, b in zip(estimate(plain), estimate(jittered), strict=True):
        assert a == pytest.approx(b, rel=1e-6, abs=1e-9)


def test_filter_in_deep_space(fmu):
    """mu = 0: straight lines, no gradient; one pose, then a minute alone."""
    p = {"mu": 0, "rho_0_H": [0, 0, 0], "omega_TN_T_0": [0, 0, 0], "p_GT_T": [0, 0, 0]}
    unit = fmu("relative_filter", p | {"p_KS_S": [0, 0, 0], "drho_0_H": [0.01, 0, 0]})
    still = NO_POSE | {"r_SN_N_hat": [0, 0, 0], "v_SN_N_hat": [0, 0, 0]}
    unit.step(T, still | {"r_GK_K": [20, 0, 0], "pose_time": 0, "pose_valid": 1})
    for _ in range(600):
        unit.step(T, still)
    assert unit.get("r_TN_N") == pytest.approx([20 - 0.6, 0, 0], abs=1e-9)


@pytest.mark.verifies("F.6-8")
@pytest.mark.parametrize(
    ("parameters", "rule"),
    [
        ({"sample_period": 0}, "sample_period = 0: must be > 0"),
        ({"sigma_rho_0": -1}, "sigma_rho_0 = -1: must be >= 0"),
        ({"sigma_inertia_0": [0, -1, 0, 0, 0]}, "sigma_inertia_0[2] = -1: must be >= 0"),
        ({"sigma_p_0": [0, 0, -1]}, "sigma_p_0[3] = -1: must be >= 0"),
        ({"gate": -1}, "gate = -1: must be >= 0"),
        ({"q_KS": [0, 0, 0, 0]}, "|q_KS| = 0: must be a unit quaternion"),
        ({"flip_axis": [1, 1, 0]}, "must be a unit vector"),
        ({"J_T": np.diag((100, 150, 40))}, "must satisfy the triangle inequality"),
        ({"mass_hat": 0}, "mass_hat = 0: must be > 0"),
    ],
)
def test_rejected_with_the_rule(parameters, rule, tmp_path):
    assert rule in rejection("relative_filter", parameters, tmp_path)
