# SPDX-License-Identifier: BSD-2-Clause
"""Statements of the safety filter (docs/models.md M), each against brute force: the least
acceleration of a hold, the nearest point of half spaces, accelerations as seen in turning frames,
drift, pyramid.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from tests.close import close
from tests.reference import published_filters as published
from tests.reference import safety_filter as reference
from tests.reference.filter_runs import Loop

MORE = pytest.mark.long


@pytest.fixture(scope="module")
def loop():
    return Loop()


# ---- (6), (7) ----
def worst_of_hold(d, w, a, a_b, P):
    """Least gap at 65 points of a hold with constant acceleration, and the barrier at its end."""
    t = np.linspace(0, P, 65)[:, None]
    gap = d + w * t + a * t * t / 2
    return gap.min(axis=0), np.where(w + a * P < 0, gap[-1] - (w + a * P) ** 2 / (2 * a_b), gap[-1])


def random_gaps(seed, count):
    """Gaps inside the set and up to twice too fast."""
    rng = np.random.default_rng(seed)
    a_b, P = 10 ** rng.uniform(-3, 0.7, count), 10 ** rng.uniform(-2, 0.3, count)
    d = a_b * P**2 * 10 ** rng.uniform(-2, 4, count)
    w = rng.uniform(-1.5, 0.5, count) * np.sqrt(2 * a_b * d)
    return d, w, a_b, P


def test_the_least_acceleration_saves_the_gap_and_one_percent_less_does_not():
    d, w, a_b, P = random_gaps(1, 5000)
    alpha = np.array(
        [reference.least_acceleration(*x, 0.02) for x in zip(d, w, a_b, P, strict=True)]
    )
    gap, h = worst_of_hold(d, w, alpha, a_b, P)
    size = d + np.abs(w) * P
    assert np.all(gap >= -1e-12 * size) and np.all(h >= -1e-9 * size)
    gap, h = worst_of_hold(d, w, alpha - 0.01 * a_b, a_b, P)
    # the least gap inside the hold is a point between two of the 65
    inside = 2 * d + P * w < 0
    assert np.all((np.minimum(gap, h) < 0) | (inside & (gap < 1e-3 * size)))
    assert np.count_nonzero(inside) > 300


def test_inside_the_set_the_brake_in_hand_is_enough():
    d, w, a_b, P = random_gaps(2, 5000)
    for x in zip(d, w, a_b, P, strict=True):
        if reference.barrier(*x[:3]) >= 0:
            assert reference.least_acceleration(*x, 0.02) <= x[2] * (1 + 1e-9)


# ---- (21) ----
def random_rows(rng, count):
    """Half spaces about a box, some of them parallel, opposite or through one point."""
    n = rng.normal(size=(count, 3))
    n /= np.linalg.norm(n, axis=1)[:, None]
    c = rng.normal(size=count) - 0.7
    for i in range(2, count):
        kind = rng.random()
        if kind < 0.1:
            n[i], c[i] = n[i - 1], c[i - 1] + rng.normal() * 0.1
        elif kind < 0.15:
            n[i], c[i] = -n[i - 1], -c[i - 1] - rng.choice((0.2, -0.1))
    box = list(reference.box_rows(reference.Settings(F_max=(2, 1, 1))))
    return np.array([r.n for r in box] + list(n)), np.array([r.c for r in box] + list(c))


def by_least_squares(n, c, u_0):
    """Least distance programming by nonnegative least squares (Lawson & Hanson); None: empty."""
    E = np.vstack((n.T, c - n @ u_0))
    f = np.array((0, 0, 0, 1.0))
    y, rest = nnls(E, f, maxiter=1000)
    r = E @ y - f
    return None if rest < 1e-9 else u_0 - r[:3] / r[3]


def agree(loop, n, c, u_0, expected):
    rows = [reference.Row(0, *row) for row in zip(n, c, strict=True)]
    tol = 1e-9 * 6**0.5
    ours, i = reference.nearest(rows, u_0, tol)
    found, j = loop.nearest(n, c, u_0, tol)
    assert j == (-1 if i is None else i)
    assert (expected is None) == (i is not None)
    if expected is not None:
        close(ours, expected, rel=1e-7, of=10)
        close(found, ours, rel=1e-12, of=10)


@pytest.mark.parametrize("count", [400, pytest.param(20000, marks=MORE)])
def test_the_nearest_point_is_the_one_of_least_squares(loop, count):
    empty = 0
    for seed in range(count):
        rng = np.random.default_rng([3, seed])
        n, c = random_rows(rng, int(rng.integers(1, 17)))
        u_0 = rng.normal(size=3) * rng.choice((1, 5))
        expected = by_least_squares(n, c, u_0)
        empty += expected is None
        agree(loop, n, c, u_0, expected)
    assert 0.05 < empty / count < 0.9


@pytest.mark.parametrize("count", [40, pytest.param(5000, marks=MORE)])
def test_the_nearest_point_is_the_best_of_all_active_sets(loop, count):
    for seed in range(count):
        rng = np.random.default_rng([4, seed])
        n, c = random_rows(rng, int(rng.integers(1, 8)))
        u_0 = rng.normal(size=3) * 3
        rows = [reference.Row(0, *row) for row in zip(n, c, strict=True)]
        agree(loop, n, c, u_0, reference.by_enumeration(rows, u_0, slack=1e-8))


def test_relaxation_gives_the_first_row_all_that_the_box_has(loop):
    p = reference.Settings(F_max=(2, 1, 1))
    for seed in range(100):
        rng = np.random.default_rng([5, seed])
        n, c = random_rows(rng, 6)
        n, c = n[6:], np.abs(c[6:]) + 2.5
        rows = [*reference.box_rows(p), *(reference.Row(1, *row) for row in zip(n, c, strict=True))]
        program = reference.Program(p, rows, rng.normal(size=3))
        u = program.solve()
        assert program.relaxed == 1 and np.all(np.abs(u) <= np.array(p.F_max) + 1e-8)
        most = np.abs(n[0]) @ np.array(p.F_max)
        if most < c[0]:
            # the point nearest to one 1e3 |F_max| away is not quite the farthest along n
            assert most - np.linalg.norm(p.F_max) / 2e3 <= n[0] @ u <= most + 1e-8


# ---- (2), (3) ----
def units_of_one(rng):
    """A state in which radius, period over 2 pi and gravitational parameter are about 1, so that
    differences of positions lose no digits.
    """
    plane = Rotation.random(random_state=rng).as_matrix()
    r, v = plane[0], 1.1 * plane[1]
    turn = Rotation.random(random_state=rng)
    return reference.Inputs(
        r_TN_N=r,
        v_TN_N=v,
        q_TN=np.roll(turn.as_quat(), 1),
        omega_TN_T=rng.normal(size=3),
        r_SN_N=r + 0.05 * rng.normal(size=3),
        v_SN_N=v + 0.05 * rng.normal(size=3),
        q_SN=np.roll(Rotation.random(random_state=rng).as_quat(), 1),
        omega_SN_S=np.zeros(3),
        F_cmd_S=np.zeros(3),
    )


def second_difference(f, h=2e-3):
    """Second derivative at 0 from five points, error h^4."""
    return (-f(-2 * h) + 16 * f(-h) - 30 * f(0) + 16 * f(h) - f(2 * h)) / (12 * h * h)


@pytest.mark.parametrize("seed", range(5))
def test_accelerations_are_those_seen_in_the_turning_frames(seed):
    u = units_of_one(np.random.default_rng(seed))
    g = reference.Geometry(reference.Settings(mu=1), u, 0.1)
    start = np.concatenate((u.r_TN_N, u.v_TN_N, u.r_SN_N, u.v_SN_N))

    def motion(t, x):
        falls = [reference.gravity(1, x[i : i + 3]) for i in (0, 6)]
        return np.concatenate((x[3:6], falls[0], x[9:], falls[1]))

    def relative(t):
        if t == 0:
            x = start
        else:
            x = solve_ivp(motion, (0, t), start, "DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
        return x[6:9] - x[:3]

    for w, seen, v in ((g.W, g.a_T, g.v_T), (g.w_H, g.a_H, g.v_H)):
        turned = lambda t, w=w: Rotation.from_rotvec(-w * t).apply(relative(t))  # noqa: E731
        close(second_difference(turned), seen, rel=1e-6)
        first = (turned(1e-4) - turned(-1e-4)) / 2e-4
        close(first, v, rel=1e-6)


# ---- (15) ----
@pytest.mark.parametrize("alpha", [0.1, 0.35, 1.2])
def test_the_pyramid_is_inscribed_in_the_cone(alpha):
    axis = np.array((0.6, 0, 0.8))
    p = reference.Settings(corridor_half_angle=alpha, corridor_axis=axis, corridor_length=2)
    faces = np.array([n for n, offset in reference.pyramid(p) if offset == 0])
    edges = np.cross(faces, np.roll(faces, -1, axis=0))
    edges *= np.sign(edges @ axis)[:, None]
    off = np.arccos(edges @ axis / np.linalg.norm(edges, axis=1))
    close(off, np.full(8, alpha), rel=1e-12)
    assert np.all(faces @ axis > 0)
    close(np.linalg.norm(faces, axis=1), np.ones(8), rel=1e-14)


# ---- (18) ----
def test_the_drift_is_the_integral_of_its_equations():
    n, t = 1.1e-3, 700.0
    x = np.array((3.0, -12, 5, 0.02, -0.01, 0.03))

    def hill(t, s):
        a = (3 * n * n * s[0] + 2 * n * s[4], -2 * n * s[3], -n * n * s[2])
        return np.concatenate((s[3:], a))

    end = solve_ivp(hill, (0, t), x, "DOP853", rtol=1e-12, atol=1e-14).y[:3, -1]
    rr, rv = reference.clohessy_wiltshire(n, t)
    close(rr @ x[:3] + rv @ x[3:], end, rel=1e-9)


# ---- filters of the literature (docs/models.md M.11) ----
def test_a_condition_at_the_sample_lets_a_held_force_exceed_the_limit():
    """The published condition, the published switch, and the condition over the hold."""
    least = {
        name: min(
            published.simulate(published.FILTERS[name], seed, 150)["least"] for seed in (1, 3)
        )
        for name in ("explicit switching", "explicit optimisation", "safety_filter, least change")
    }
    assert least["explicit switching"] < 0
    assert least["explicit optimisation"] < 0
    assert least["safety_filter, least change"] > 0.05


def test_the_row_of_the_published_condition_is_its_derivative():
    rng = np.random.default_rng(2)
    x, u = rng.normal(size=6) * np.repeat((50, 0.1), 3), rng.normal(size=3)
    g = published.gradient(x)
    step = 1e-6
    ahead = x + step * (published.A @ x + published.B @ u)
    rate = (published.margin(ahead) - published.margin(x)) / step
    assert g @ (published.A @ x + published.B @ u) == pytest.approx(rate, rel=1e-5)
