# SPDX-License-Identifier: BSD-2-Clause
"""Methods of studies against known answers: Morris, Sobol, CMA-ES, stopping rules."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from harness.studies.analyses import sensitivity, worst
from harness.studies.campaign import stopping
from tests.harness.studies.known_indices import answer, indices_of_sobol_g, ishigami, sobol_g

# ---- sensitivity

THREE, EIGHT = [[k] for k in range(3)], [[k] for k in range(8)]


def test_sobol_indices_of_ishigami_and_of_the_g_function():
    first, total = indices_of_sobol_g()
    for seed in range(3):
        found = answer(sensitivity.sobol(THREE, 3, 2048, seed), ishigami)
        assert found.first == pytest.approx([0.3139, 0.4424, 0], abs=0.05)
        assert found.value == pytest.approx([0.5576, 0.4424, 0.2437], abs=0.02)
        assert (found.low < found.value).all()
        assert (found.value < found.high).all()
        found = answer(sensitivity.sobol(EIGHT, 8, 2048, seed), sobol_g)
        assert found.first == pytest.approx(first, abs=0.05)
        assert found.value == pytest.approx(total, abs=0.02)


def test_sobol_indices_match_scipy():
    found = answer(sensitivity.sobol(THREE, 3, 256, 4), ishigami)
    u = stats.qmc.Sobol(6, rng=4).random(256).clip(2**-53, 1 - 2**-53)
    a, b = stats.norm.ppf(u[:, :3]), stats.norm.ppf(u[:, 3:])
    mixed = [np.where(np.arange(3) == k, b, a) for k in range(3)]
    values = {"f_A": ishigami(a)[None], "f_B": ishigami(b)[None]}
    values["f_AB"] = np.array([ishigami(each)[None] for each in mixed])
    required = stats.sobol_indices(func=values, n=256)
    assert found.first == pytest.approx(required.first_order.ravel(), abs=1e-9)
    assert found.value == pytest.approx(required.total_order.ravel(), abs=1e-9)


def test_groups_of_numbers_are_one_factor():
    """y = x0 + x1 + x2 of unit variance each, in groups of two and one."""
    plane = lambda z: z[:, :3].sum(axis=1)  # noqa: E731
    groups = [[0, 1], [2], [3]]
    found = answer(sensitivity.sobol(groups, 4, 1024, 0), plane)
    assert found.value == pytest.approx([2 / 3, 1 / 3, 0], abs=0.02)
    assert answer(sensitivity.morris(groups, 4, 10, 0), plane).value[2] == 0


def test_morris_orders_the_factors_of_the_g_function():
    right = 0
    for seed in range(20):
        found = answer(sensitivity.morris(EIGHT, 8, 10, seed), sobol_g)
        right += np.argsort(-found.value)[:4].tolist() == [0, 1, 2, 3]
    assert right >= 19


def test_morris_finds_slopes_and_leaves_runs_that_failed_to_the_least_margin():
    found = answer(sensitivity.morris(THREE, 3, 5, 1), lambda z: stats.norm.cdf(z) @ [2, -3, 0])
    assert found.value == pytest.approx([2, 3, 0], abs=1e-12)
    assert (found.value == found.low).all() or found.low == pytest.approx(found.value)
    fails = answer(
        sensitivity.morris(THREE, 3, 5, 1), lambda z: np.where(z[:, 0] > 0, -math.inf, z[:, 1])
    )
    assert fails.failed > 0
    assert np.isfinite(fails.value).all()


# ---- worst


def quadratic(seed):
    """-1 at the distance 2 of the origin in 12 dimensions, 0 at the origin, condition 100."""
    rng = np.random.default_rng(seed)
    turn, _ = np.linalg.qr(rng.normal(size=(12, 12)))
    place = rng.normal(size=12)
    place *= 2 / np.linalg.norm(place)
    form = turn @ np.diag(np.logspace(0, 2, 12)) @ turn.T
    form /= place @ form @ place
    return lambda z: np.einsum("ij,jk,ik->i", z - place, form, z - place) - 1


@pytest.mark.parametrize("seed", range(5))
def test_the_search_finds_the_minimum_of_a_quadratic(seed):
    found = worst.search(quadratic(seed), 12, seed, 1200)
    assert found.margin < -0.99
    assert found.first < 200
    assert np.abs(found.numbers).max() <= 3


def test_a_run_that_fails_is_the_worst():
    fails = lambda z: np.where(z[:, 0] > 1.5, -math.inf, 1 - 0.1 * z[:, 0])  # noqa: E731
    assert worst.search(fails, 3, 0, 60).margin == -math.inf


def test_a_margin_of_zero_that_holds_is_no_failure():
    """Margins of 0 at least, as of what saturates."""
    assert worst.search(lambda z: np.maximum(z[:, 0], 0.0), 2, 0, 24).first == -1


def test_a_search_repeats_its_questions_beside_another_user_of_numpy_random():
    requested = []
    for disturbed in (False, True):
        rows = []

        def stated(z, rows=rows, disturbed=disturbed):
            if disturbed:
                np.random.random(7)
            rows.append(z.copy())
            return z.sum(axis=1)

        found = worst.search(stated, 6, 4, 66)
        assert sum(map(len, rows)) == 66
        requested.append((np.concatenate(rows), found))
    assert np.array_equal(requested[0][0], requested[1][0])
    assert requested[0][1].margin == requested[1][1].margin


# ---- how many runs


def test_runs_that_wilks_demands():
    required = {0.05: 59, 0.01: 299, 0.001: 2995, 1e-4: 29956, 1e-10: 29957322735}
    for probability, n in required.items():
        assert stopping.wilks(probability, 0.95) == n
        fewer, enough = (np.exp(k * np.log1p(-probability)) for k in (n - 1, n))
        assert enough <= 0.05 < fewer


def decisions(p, campaigns, most):
    """Decision of Wald's test on p < 0.01 by campaign, looked at after every run, and its run."""
    rng = np.random.default_rng(1)
    for _ in range(campaigns):
        failures = np.flatnonzero(rng.random(most) < p)
        # only a failure moves the ratio down; up it goes steadily: look where either may cross
        places = sorted({*failures + 1, *np.arange(50, most + 1, 50)})
        for n in places:
            reported = stopping.wald(int(np.searchsorted(failures, n)), int(n), 0.01, 0.95)
            if reported is not None:
                yield reported, n
                break


def test_a_test_that_is_looked_at_all_the_time_claims_too_much_in_five_percent_at_most():
    reported = [claim for claim, _ in decisions(0.01, 400, 5000)]
    assert sum(reported) / 400 <= 0.06


@pytest.mark.long
def test_false_claims_of_two_thousand_campaigns():
    reported = [claim for claim, _ in decisions(0.01, 2000, 10_000)]
    assert sum(reported) / 2000 <= 0.06


def test_a_test_decides_early_where_the_truth_is_clear():
    found = list(decisions(0.002, 200, 10_000))
    assert np.mean([claim for claim, _ in found]) >= 0.9
    assert np.median([n for _, n in found]) <= 600
