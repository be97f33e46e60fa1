# SPDX-License-Identifier: BSD-2-Clause
"""attitude_filter.fmu: against dense matrices, Farrenkopf's steady state, gate, delay."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from tests.close import close
from tests.reference import kalman
from tests.reference.attitude import conjugate, dcm, mrp_of_quaternion, multiply
from tests.reference.cases import quaternion
from tests.reference.kalman import err, rot, turn

from .driver import bits
from .estimates import estimate, put_covariance
from .rejections import rejection
from .sensor_cases import turn_between, unit_vector

T = 0.1
NEVER_BEYOND = chi2.isf(1e-9, 3)
"""A gate that one undisturbed star of 1e9 misses: of the default gate it is one of 1000."""
IDENTITY = np.array((1.0, 0, 0, 0))
NOTHING = {"gyro_valid": 0, "star_valid": 0, "gyro_time": -1, "star_time": -1}


class World:
    """A tumbling servicer with gyro and star tracker, numpy only."""

    def __init__(self, rng, rate=0.3, **p):
        self.rng, self.rate = rng, rate
        self.p = {"sigma_v": 2e-4, "sigma_u": 1e-5, "sigma_A": np.array((2e-3, 3e-4, 5e-4))} | p
        self.q_AS = p.get("q_AS", quaternion(rng))
        self.q, self.b = [quaternion(rng)], p.get("b", 1e-3 * rng.normal(size=3))
        self.w = rate * rng.normal(size=3)

    def gyro(self, k):
        """Inputs of the increment to sample k."""
        u = NOTHING | {"gyro_time": k * T}
        if k == 0:
            return u
        self.w = 0.95 * self.w + 0.3 * self.rate * self.rng.normal(size=3)
        phi = T * self.w
        self.q.append(multiply(self.q[-1], turn(phi)))
        p, before = self.p, self.b
        self.b = before + p["sigma_u"] * np.sqrt(T) * self.rng.normal(size=3)
        sigma = np.sqrt(p["sigma_v"] ** 2 * T + p["sigma_u"] ** 2 * T**3 / 12)
        m = phi + T * (before + self.b) / 2 + sigma * self.rng.normal(size=3)
        return u | {"gyro_valid": 1, "dtheta_S": m}

    def star(self, m):
        noise = rot(self.p["sigma_A"] * self.rng.normal(size=3))
        q_AN = multiply(multiply(self.q[m], self.q_AS), noise)
        return {"star_time": m * T, "star_valid": 1, "q_AN": q_AN}

    def filter(self, fmu, **other):
        names = ("sigma_v", "sigma_u", "sigma_A")
        parameters = {n: self.p[n] for n in names} | {"q_AS": self.q_AS} | other
        return fmu("attitude_filter", parameters)

    def reference(self, **other):
        names = ("sigma_v", "sigma_u", "sigma_A")
        return kalman.Attitude(**{n: self.p[n] for n in names}, q_AS=self.q_AS, **other)


def same(unit, reference, tolerance=1e-9):
    x, P = estimate(unit)
    sigma = np.sqrt(np.diag(reference.P)) + 1e-30
    assert turn_between(x[:4], reference.q) < tolerance
    assert x[4:7] == pytest.approx(reference.b, abs=tolerance)
    assert np.abs((P - reference.P) / np.outer(sigma, sigma)).max() < tolerance
    assert unit.get("sigma_theta_S") == pytest.approx(sigma[:3], rel=tolerance)
    assert unit.get("sigma_bias_S") == pytest.approx(sigma[3:], rel=tolerance)
    assert unit.get("star_nis") == pytest.approx(reference.track.nis, rel=1e-6, abs=1e-9)
    assert unit.get("star_rejected") == reference.track.rejected
    assert unit.get("omega_SN_S") == pytest.approx(reference.omega, abs=1e-9)


@pytest.mark.parametrize("late", [0, 1, 4, 15])
def test_filter_is_the_dense_one(fmu, rng, late):
    """Stars every fifth sample, `late` samples old, some far outside the gate: of ten rejected
    three lead to the wrong attitude and three back, four stand alone.
    """
    world = World(rng)
    unit = world.filter(fmu, reset_after=3, gate=NEVER_BEYOND)
    reference = world.reference(track=kalman.Track(NEVER_BEYOND, reset_after=3))
    for k in range(120):
        u = world.gyro(k)
        if k % 5 == 0 and k >= late:
            u |= world.star(k - late)
            if 60 <= k < 75 or k in (30, 40, 50, 90):
                u["q_AN"] = multiply(u["q_AN"], rot((0.1, 0.05, 0.2)))
        unit.step(T, u)
        reference.sample(k, {"dtheta_S": np.zeros(3)} | u)
        same(unit, reference)
    assert reference.track.rejected == 10


@pytest.mark.verifies("F.4-6")
def test_a_missing_increment_counts_as_no_turn(fmu, rng):
    world = World(rng)
    unit, reference = world.filter(fmu), world.reference()
    for k in range(60):
        u = world.gyro(k)
        if k % 7 == 3:
            u["gyro_valid"] = 0
        if k % 11 == 5:
            u["gyro_time"] -= 2 * T  # seen before
        if k >= 3 and k % 5 == 0:
            u |= world.star(k - 3)
        unit.step(T, u)
        reference.sample(k, {"dtheta_S": np.zeros(3)} | u)
        same(unit, reference)


def test_transition_is_the_derivative_of_the_propagation(fmu, rng):
    """Columns of Phi from a covariance of one error at a time, against central differences of
    q turn(dtheta - T b): 1e-6 at |phi| = 0.06.
    """
    phi = 0.06 * unit_vector(rng)
    u = NOTHING | {"gyro_valid": 1, "dtheta_S": phi, "gyro_time": T}

    def moved(d):
        true = multiply(rot(d[:3]), turn(phi - T * d[3:]))
        return np.concatenate((err(multiply(conjugate(turn(phi)), true)), d[3:]))

    for i, e in enumerate(np.eye(6)):
        h = 1e-4
        column = (moved(h * e) - moved(-h * e)) / (2 * h)
        unit = fmu("attitude_filter", {"sigma_v": 0, "sigma_u": 0})
        unit.step(T, NOTHING | {"gyro_time": 0})
        put_covariance(unit, np.outer(e, e))
        unit.step(T, u)
        P = estimate(unit)[1]
        assert P[i] * np.sign(P[i, i]) / np.sqrt(P[i, i]) == pytest.approx(column, abs=1e-6)


# ---- Farrenkopf

CASES = {
    "cross terms": (5e-5, 1e-5, 1e-6, 2.0, 0.5),
    "defaults": (2.9e-5, 2.04e-5, 8e-8, 0.5, 0.1),
}
"""Star tracker, angle and rate random walk, time between stars, sample period. The published
example is simulated by tests/external.
"""


def farrenkopf(s, v, u, tau):
    S_u, S_v = u * tau**1.5 / s, v * tau**0.5 / s
    g = np.sqrt(1 + S_v**2 / 4 + S_u**2 / 48)
    z = g + S_u / 4 + np.sqrt(2 * g * S_u + S_v**2 + S_u**2 / 3) / 2
    return s * np.sqrt(z**2 - 1), s * np.sqrt(1 - 1 / z**2)


def steady_state(fmu, s, v, u, tau, period, steps):
    """Attitude before and after the update; body at rest."""
    p = {"sigma_A": [s] * 3, "sigma_v": v, "sigma_u": u, "sample_period": period}
    unit, every = fmu("attitude_filter", p), round(tau / period)
    at_rest = {"gyro_valid": 1, "q_AN": IDENTITY, "dtheta_S": np.zeros(3)}
    for k in range(steps * every + 1):
        star = {"star_time": k * period, "star_valid": float(k % every == 0)}
        unit.step(period, at_rest | {"gyro_time": k * period} | star)
    after = unit.get("sigma_theta_S")
    return 1 / np.sqrt(1 / after**2 - 1 / s**2), after  # information adds


@pytest.mark.parametrize("case", CASES)
def test_steady_state_is_farrenkopfs(fmu, case):
    """1e-6; the gyro step inside tau does not matter."""
    s, v, u, tau, period = CASES[case]
    steps = {"cross terms": 500, "defaults": 3000}[case]
    before, after = steady_state(fmu, s, v, u, tau, period, steps)
    expected = farrenkopf(s, v, u, tau)
    assert before == pytest.approx(expected[0], rel=1e-6)
    assert after == pytest.approx(expected[1], rel=1e-6)


# ---- consistency


def consistency(fmu, runs, samples, rng):
    """Mean NEES and NIS over the runs, after each star but the first."""
    nees, nis = [], []
    for _ in range(runs):
        world = World(rng, rate=0.05, b=1e-3 * rng.normal(size=3))
        unit = world.filter(fmu, gate=1e9)
        nees.append([])
        nis.append([])
        for k in range(samples):
            u = world.gyro(k)
            unit.step(T, u | (world.star(k) if k % 5 == 0 else {}))
            if k % 5 == 0 and k:
                x, P = estimate(unit)
                e = np.concatenate((err(multiply(conjugate(x[:4]), world.q[k])), world.b - x[4:]))
                nees[-1].append(e @ np.linalg.solve(P, e))
                nis[-1].append(unit.get("star_nis"))
    return np.array(nees), np.array(nis)


def inside(values, degrees):
    """Part of the instants at which the mean over the runs lies within 95 % of chi-square."""
    N = len(values)
    low, high = chi2.ppf((0.025, 0.975), N * degrees) / N
    mean = values.mean(axis=0)
    return np.mean((low <= mean) & (mean <= high))


@pytest.mark.verifies("F.4-5")
def test_errors_are_as_large_as_claimed(fmu):
    """NEES 6 and NIS 3 by chi-square: 24 runs of 20 s; 3 sigma of a mean of 24 x 39 dependent
    values is 0.4 of 6.
    """
    nees, nis = consistency(fmu, 24, 200, np.random.default_rng(4))
    assert nees.mean() == pytest.approx(6, abs=0.45)
    assert nis.mean() == pytest.approx(3, abs=0.3)
    assert inside(nees, 6) > 0.85
    assert inside(nis, 3) > 0.85


@pytest.mark.long
def test_errors_are_as_large_as_claimed_over_many_runs(fmu):
    nees, nis = consistency(fmu, 200, 600, np.random.default_rng(5))
    assert nees.mean() == pytest.approx(6, abs=0.15)
    assert nis.mean() == pytest.approx(3, abs=0.06)
    assert inside(nees, 6) >= 0.9
    assert inside(nis, 3) >= 0.9


# ---- acquisition, gate, delay


def settled(fmu, world, samples=101):
    unit = world.filter(fmu)
    for k in range(samples):
        unit.step(T, world.gyro(k) | (world.star(k) if k % 5 == 0 else {}))
    return unit


@pytest.mark.verifies("F.4-1")
def test_first_star_sets_the_attitude(fmu, rng):
    world = World(rng)
    unit = world.filter(fmu, sigma_SN_0=[0.3, 0.2, -0.9])
    start = rot(4 * np.array((0.3, 0.2, -0.9)))
    assert turn_between(unit.get("q_SN"), start) < 1e-14
    star = world.star(0)
    unit.step(T, world.gyro(0) | star)
    x, P = estimate(unit)
    assert turn_between(x[:4], multiply(star["q_AN"], conjugate(world.q_AS))) < 1e-14
    C = dcm(world.q_AS)
    R = C.T @ np.diag(world.p["sigma_A"] ** 2) @ C
    assert P[:3, :3] == pytest.approx(R, abs=1e-18)
    assert P[3:, 3:] == pytest.approx(1e-6 * np.eye(3), abs=1e-20)
    assert not P[:3, 3:].any()
    assert (unit.get("star_nis"), unit.get("star_age"), unit.get("attitude_valid")) == (0, 0, 1)


def test_acquire_0_starts_from_the_start_values(fmu, rng):
    world = World(rng)
    sigma = mrp_of_quaternion(world.q[0])
    unit = world.filter(fmu, acquire=0, sigma_SN_0=sigma, sigma_att_0=0.01)
    star = world.star(0)
    unit.step(T, world.gyro(0) | star)
    assert unit.get("star_nis") > 0
    assert turn_between(unit.get("q_SN"), multiply(star["q_AN"], conjugate(world.q_AS))) > 1e-7
    assert unit.get("attitude_valid") == 1


@pytest.mark.verifies("F.4-2")
@pytest.mark.parametrize("change", ["earlier", "future", "repeated", "invalid"])
def test_stars_that_cannot_be_used_change_nothing(fmu, rng, change):
    """Taken before the last one, from the future, seen before, not valid."""
    world = World(rng)
    unit, k = settled(fmu, world), 101
    stamp = {"earlier": k * T - 1.6, "future": k * T + T, "repeated": 10.0, "invalid": k * T}[
        change
    ]
    star = world.star(100) | {"star_time": stamp, "star_valid": float(change != "invalid")}
    quiet, saved = world.gyro(k), unit.slave.getFMUState()
    unit.step(T, quiet)
    expected = bits(unit)
    unit.slave.setFMUState(saved)
    unit.slave.freeFMUState(saved)
    unit.time = k * T
    unit.step(T, quiet | star)
    assert bits(unit) == expected


@pytest.mark.verifies("F.4-2")
def test_a_star_of_before_the_first_sample_is_ignored(fmu, rng):
    world = World(rng)
    unit = fmu("attitude_filter", {}, {}, 2.0)
    unit.step(T, NOTHING | world.star(0) | {"star_time": 1.9})
    assert unit.get("q_SN").tolist() == [1, 0, 0, 0]
    unit.step(T, NOTHING | world.star(0) | {"star_time": 2.0})
    assert turn_between(unit.get("q_SN"), IDENTITY) > 1e-3


@pytest.mark.verifies("F.4-3")
def test_a_star_far_outside_the_gate_counts_and_is_forgotten(fmu, rng):
    world = World(rng)
    unit = settled(fmu, world)
    before = estimate(unit)
    unit.step(T, NOTHING | world.star(100) | {"star_time": 101 * T, "q_AN": quaternion(rng)})
    for a, b in zip(estimate(unit), before, strict=True):
        assert (a == b).all()
    assert unit.get("star_rejected") == 1
    assert unit.get("star_nis") > 16.27
    assert unit.get("star_age") == pytest.approx(0.1)


@pytest.mark.verifies("F.4-4")
def test_validity_ends_with_the_age(fmu, rng):
    world = World(rng)
    unit = world.filter(fmu, age_max=1)
    unit.step(T, world.gyro(0))
    assert (unit.get("attitude_valid"), unit.get("star_age")) == (0, 1)
    for k in range(1, 14):
        unit.step(T, world.gyro(k) | (world.star(1) if k == 1 else {}))
        assert unit.get("attitude_valid") == (k <= 11)
        assert unit.get("star_age") == pytest.approx((k - 1) * T)


def test_rate_is_the_mean_of_the_last_period_less_the_bias(fmu, rng):
    world = World(rng)
    unit = settled(fmu, world)
    u = world.gyro(101)
    unit.step(T, u)
    close(unit.get("omega_SN_S"), u["dtheta_S"] / T - estimate(unit)[0][4:], rel=1e-14)
    unit.step(T, NOTHING)
    assert not unit.get("omega_SN_S").any()


@pytest.mark.verifies("F.4-7")
def test_finer_master_steps_give_the_same_bits(fmu, rng):
    """Inputs as they are at each sample; between samples they may have any value."""
    world = World(rng)
    coarse, fine = world.filter(fmu), world.filter(fmu)
    for k in range(40):
        u = world.gyro(k) | (world.star(k) if k % 5 == 0 else {})
        coarse.step(T, u)
        fine.step(0.04, u)
        fine.step(0.06, NOTHING | {"dtheta_S": [9, 9, 9]})
        assert bits(fine) == bits(coarse)


@pytest.mark.verifies("F.4-8")
@pytest.mark.parametrize(
    ("parameters", "rule"),
    [
        ({"sample_period": 0}, "sample_period = 0: must be > 0"),
        ({"sigma_att_0": -1}, "sigma_att_0 = -1: must be >= 0"),
        ({"sigma_bias_0": -1}, "sigma_bias_0 = -1: must be >= 0"),
        ({"gate": -1}, "gate = -1: must be >= 0"),
        ({"q_AS": [0.5, 0, 0, 0]}, "|q_AS| = 0.5: must be a unit quaternion"),
        ({"acquire": 2}, "acquire = 2: must be 0 or 1"),
    ],
)
def test_rejected_with_the_rule(parameters, rule, tmp_path):
    assert rule in rejection("attitude_filter", parameters, tmp_path)


def test_quaternions_of_either_sign_are_the_same_attitude(fmu, rng):
    world = World(rng)
    a, b = world.filter(fmu), world.filter(fmu)
    for k in range(20):
        u = world.gyro(k) | (world.star(k) if k % 5 == 0 else {})
        a.step(T, u)
        b.step(T, u | ({"q_AN": -u["q_AN"]} if "q_AN" in u else {}))
        assert bits(a) == bits(b)
