# SPDX-License-Identifier: BSD-2-Clause
"""Methods of studies against known answers: subset simulation, Morris, Sobol, HSIC, CMA-ES,
stopping rules.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from harness.studies.analyses import probability, sensitivity, worst
from harness.studies.campaign import stopping
from tests.harness.studies.known_failures import (
    CASES,
    answer,
    indices_of_sobol_g,
    ishigami,
    linear,
    sobol_g,
)

N = 1000


def subsets(name, seeds):
    d, margin, _ = CASES[name]
    return [answer(probability.one_subset(d, [s], N), margin) for s in range(seeds)]


def covered(found, p):
    """Share of single subset simulations whose own interval holds p."""
    widths = 1.96 * np.sqrt(np.log1p([each.cov**2 for each in found]))
    return np.mean(np.abs(np.log([each.p / p for each in found])) < widths)


@pytest.mark.parametrize("seeds", [30, pytest.param(200, marks=pytest.mark.long)])
@pytest.mark.parametrize("name", [name for name in CASES if name != "valley"])
def test_subset_simulation_finds_known_probabilities(name, seeds):
    """Limits of 200 seeds; 30 of them scatter by a factor of 2.6 more."""
    found, p = subsets(name, seeds), CASES[name].p
    parts = np.array([each.p for each in found])
    loose = 1 if seeds > 100 else 2.6
    trap = name == "trap"
    if seeds > 100:
        assert 0.93 <= parts.mean() / p <= 1.1
    else:
        assert abs(parts.mean() / p - 1) < loose * (0.3 if trap else 0.1)
    most = {"linear": 3800, "linear, rare": 6200, "trap": 6200}.get(name, 4700)
    assert np.mean([each.runs for each in found]) <= most
    five = [probability.pooled(found[k : k + 5]) for k in range(0, seeds, 5)]
    assert np.mean([e.low <= p <= e.high for e in five]) >= (0.9 if seeds > 100 else 0.6)
    warned = np.mean([bool(e.warning) for e in five])
    if trap:
        assert warned >= (0.9 if seeds > 100 else 0.6)
        return
    assert parts.std() / parts.mean() <= (0.5 if p < 1e-5 else 0.35) * math.sqrt(loose)
    assert covered(found, p) >= (0.85 if seeds > 100 else 0.7)
    assert warned <= (0.05 if seeds > 100 else 0.2)


def test_repeats_that_find_different_regions_are_reported():
    estimate = answer(probability.subset(2, 3, 40_000), CASES["trap"].margin)
    assert "different regions" in estimate.warning
    assert estimate.runs <= 40_000


def test_a_failure_that_no_level_reaches_is_an_upper_bound():
    estimate = answer(probability.subset(10, 1, 3000), lambda z: 100 + z[:, 0])
    assert "0 of 5 repeats reached a failure" in estimate.warning
    assert estimate.low == 0 < estimate.high


def test_runs_that_fail_fail_in_every_method():
    fails = lambda z: np.where(z[:, 0] > 1.5, -math.inf, 1 - 0.1 * z[:, 0])  # noqa: E731
    p = stats.norm.sf(1.5)
    for found in (
        answer(probability.random(3, 0, 2000), fails),
        answer(probability.subset(3, 0, 6000), fails),
    ):
        assert found.low < p < found.high
    assert answer(worst.search(3, 0, 60), fails).margin == -math.inf


def test_random_runs_have_the_interval_of_clopper_and_pearson():
    d, margin, _ = linear(4, 1.0)
    found = answer(probability.random(d, 5, 700), margin)
    required = stats.binomtest(round(700 * found.p), 700).proportion_ci(0.95, method="exact")
    assert (found.low, found.high) == pytest.approx((required.low, required.high), abs=1e-12)
    rows = [np.random.default_rng([5, k]).standard_normal(4) for k in range(700)]
    assert found.p == np.mean(margin(np.array(rows)) < 0)


BUDGETS = [1400, *(pytest.param(n, marks=pytest.mark.long) for n in (5000, 20_000))]
STATES = ("linear", "two sides", "four branches", "valley", "outside a sphere")


def estimates(name, runs, seeds):
    """Estimates of subset simulation as the study has them, and the known probability."""
    d, margin, p = CASES[name]
    return [answer(probability.subset(d, seed, runs), margin) for seed in range(seeds)], p


@pytest.mark.parametrize("runs", BUDGETS)
@pytest.mark.parametrize("name", STATES)
def test_an_interval_holds_the_probability_or_is_not_trusted(name, runs):
    """At a required probability equal to the true one "met" is always wrong."""
    found, p = estimates(name, runs, 200 if runs > 1400 else 60)
    assert np.mean([e.low <= p <= e.high or bool(e.warning) for e in found]) >= 0.9
    assert np.mean([probability._verdict(e, p, True) == "met" for e in found]) <= 0.025
    if name != "valley":
        assert np.mean([bool(e.warning) for e in found]) <= 0.1


@pytest.mark.parametrize("runs", BUDGETS)
def test_the_larger_of_two_regions_is_never_missed(runs):
    """Planes at three and at four standard deviations: the farther one alone has p = 3.2e-5."""
    found, p = estimates("two sides", runs, 60)
    assert p == pytest.approx(1.38e-3, rel=2e-3)
    for below in (1e-4, 1e-3):
        assert "met" not in {probability._verdict(e, below, True) for e in found}
    assert np.mean([probability._verdict(e, 0.02, True) == "met" for e in found]) > 0.5


def test_a_margin_of_zero_that_holds_is_no_failure():
    """Margins of 0 at least, as of what saturates."""
    holds = lambda z: np.maximum(z[:, 0], 0.0)  # noqa: E731
    assert answer(probability.random(2, 0, 200), holds).p == 0
    found = answer(probability.subset(2, 0, 1400), holds)
    assert found.low == 0
    assert found.high > 0.3
    assert "0 of 5 repeats reached a failure" in found.warning
    assert answer(worst.search(2, 0, 24), holds).first == -1


@pytest.mark.parametrize("nothing", [math.nan, math.inf])
def test_margins_without_a_number_beside_the_limit_of_a_level_change_nothing(nothing):
    """Exactly the lowest tenth of the first level has a number."""
    edge = []

    def margin(z):
        edge.append(np.sort(z[:, 0])[-N // 10])
        return np.where(z[:, 0] >= edge[0], 3.5 - z[:, 0], nothing)

    p = answer(probability.one_subset(3, [1], N), margin).p
    assert 0.5 < p / stats.norm.sf(3.5) < 2


def test_a_level_without_numbers_is_an_upper_bound():
    rare = lambda z: np.where(z[:, 0] > 2, 3 - z[:, 0], math.nan)  # noqa: E731
    found = answer(probability.subset(2, 0, 1400), rare)
    assert (found.low, found.high) == (0, 1)
    assert "p is an upper bound" in found.warning


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


def test_hsic_sees_all_three_factors_of_ishigami_and_none_that_is_not_there():
    z = np.random.default_rng(1).standard_normal((500, 5))
    found = sensitivity.hsic([[0], [1], [2], [3, 4]], z, ishigami(z[:, :3]))
    assert (found.p[:3] < 0.05).all()
    assert found.p[3] > 0.05
    assert found.value[0] == found.value.max()


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
    found = answer(worst.search(12, seed, 1200), quadratic(seed))
    assert found.margin < -0.99
    assert found.first < 200
    assert np.abs(found.numbers).max() <= 3


def test_a_search_repeats_its_questions_beside_another_user_of_numpy_random():
    requested = []
    for disturbed in (False, True):
        rows = []

        def stated(z, rows=rows, disturbed=disturbed):
            if disturbed:
                np.random.random(7)
            rows.append(z.copy())
            return z.sum(axis=1)

        found = answer(worst.search(6, 4, 66), stated)
        assert sum(map(len, rows)) == 66
        requested.append((np.concatenate(rows), found))
    assert np.array_equal(requested[0][0], requested[1][0])
    assert requested[0][1].margin == requested[1][1].margin


# ---- how many runs


def test_runs_that_wilks_demands():
    found = [
        stopping.wilks(0.05, 0.95),
        stopping.wilks(0.05, 0.95, failures=1),
        stopping.wilks(0.01, 0.95),
        stopping.wilks(0.01, 0.95, failures=1),
        stopping.wilks(0.001, 0.95),
        stopping.wilks(1e-4, 0.95),
    ]
    assert found == [59, 93, 299, 473, 2995, 29956]


@pytest.mark.parametrize("failures", [0, 1, 3, 50, 99, 100])
def test_the_interval_of_clopper_and_pearson_matches_scipy(failures):
    required = stats.binomtest(failures, 100).proportion_ci(0.95, method="exact")
    found = stopping.clopper_pearson(failures, 100)
    assert found == pytest.approx((required.low, required.high), abs=1e-12)


def test_intervals_of_clopper_and_pearson_in_figures():
    assert stopping.clopper_pearson(0, 59) == pytest.approx((0, 0.06061), abs=5e-6)
    assert stopping.clopper_pearson(3, 100) == pytest.approx((0.00623, 0.08518), abs=5e-6)


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
