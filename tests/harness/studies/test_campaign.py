# SPDX-License-Identifier: BSD-2-Clause
"""Campaigns: draws, bad files, the same runs on any worker, failures, interruptions."""

from __future__ import annotations

import copy
import datetime
import errno
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import tomllib

import numpy as np
import psutil
import pytest
from scipy import stats

from harness import campaign, run
from harness.cli.app import main
from harness.errors import HarnessError, ResultsError, StructureError, UsageError
from harness.figures.style import SCREEN
from harness.mission.library import campaigns
from harness.report.campaign import pictures
from harness.results.files import read
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from harness.studies import pool as pools
from harness.studies.campaign import engine, factors, metrics, summary
from harness.studies.campaign.campaign import like
from harness.studies.campaign.draft import read_plan
from harness.studies.campaign.engine import Block
from harness.studies.campaign.factors import factor
from harness.studies.campaign.store import Store
from harness.studies.campaign.worker import COMPLETE, FAILED
from harness.system.tables import problems
from harness.system.units import with_unit
from tests.each import some
from tests.harness.interrupts import LONGEST, start, until
from tests.harness.third_party_fmu import Model, build, p, u, y

pytestmark = pytest.mark.usefixtures("trusted")

TOML = """
name = "demo"
[experiment]
stop = 6.0
step = 1.0
[components]
count = "counter"
twice = "gain"
bad = "failing"
slow = "slow"
[connections]
"twice.u" = "count.n"
[parameters.bad]
t_fail = 100.0
"""


@pytest.fixture(scope="module")
def system(fmus, tmp_path_factory):
    path = tmp_path_factory.mktemp("system") / "demo.ssp"
    write_ssp(system_of(tomllib.loads(TOML), fmus), path)
    return path


def table(system, **more):
    return {
        "system": str(system),
        "runs": 8,
        "seed": 5,
        "factors": {
            "twice.k": {"normal": {"mean": 2.0, "sigma": 0.5}},
            "count.n_0": {"uniform": {"low": 0.0, "high": 10.0}},
        },
        "metrics": {"end": "last(twice.y)", "most": "max(twice.y) - first(count.n)"},
        **more,
    }


def arrays(store):
    return {name: store.array(name) for name, _ in store.group.arrays()}


def same(a, b):
    one, two = arrays(a), arrays(b)
    assert one.keys() == two.keys()
    for name in one:
        if one[name].dtype == object:
            assert one[name].tolist() == two[name].tolist(), name
        else:
            assert one[name].tobytes() == two[name].tobytes(), name
    return True


# ---- draws


def sample(kind, n=4000, **given):
    made = factor("x", {kind: given})
    numbers = factors.numbers("random", n, made.draw.numbers, 7)
    return np.array([made.draw.value(row) for row in numbers])


def test_normal_log_normal_uniform_and_truncated_draws_have_their_distributions():
    cases = {
        "normal": ({"mean": 3.0, "sigma": 2.0}, stats.norm(3.0, 2.0)),
        "log_normal": ({"median": 3.0, "sigma": 0.5}, stats.lognorm(0.5, scale=3.0)),
        "uniform": ({"low": -1.0, "high": 4.0}, stats.uniform(-1.0, 5.0)),
    }
    for kind, (given, distribution) in cases.items():
        assert stats.kstest(sample(kind, **given), distribution.cdf).pvalue > 1e-3
    for a, b in ((-0.5, 2.0), (2.0, 9.0), (-12.0, -11.0), (11.0, 12.0)):
        cut = sample("normal", mean=0.0, sigma=1.0, within=[a, b])
        assert a <= cut.min() < cut.max() <= b
        assert stats.kstest(cut, stats.truncnorm(a, b).cdf).pvalue > 1e-3
    with pytest.raises(ValueError, match="limits `within` nearer to the mean"):
        sample("normal", mean=0.0, sigma=1.0, within=[50.0, 60.0])


def test_normal_quantiles_are_exact_in_both_tails():
    p = np.concatenate([10.0 ** -np.arange(1, 300), np.linspace(0.01, 0.99, 99), [1 - 2.0**-53]])
    assert factors.normal_quantile(p) == pytest.approx(stats.norm.ppf(p), rel=1e-13, abs=1e-15)


def test_correlated_draws_have_their_covariance():
    covariance = np.array([[4.0, 1.2, 0.0], [1.2, 1.0, -0.3], [0.0, -0.3, 0.5]])
    x = sample("normal", n=20_000, mean=[1.0, 2.0, 3.0], covariance=covariance.tolist())
    assert x.mean(axis=0) == pytest.approx([1, 2, 3], abs=5 * 2.0 / 20_000**0.5)
    assert np.cov(x.T) == pytest.approx(covariance, abs=5 * 4.0 * (2 / 20_000) ** 0.5)


def test_larger_numbers_give_larger_draws():
    """Also correlated ones: what a seed has drawn once it draws again."""
    covariance = [[4.0, 1.2], [1.2, 1.0]]
    made = factor("x", {"normal": {"mean": [1.0, 2.0], "covariance": covariance}})
    few, many = (np.array(made.draw.value(np.full(2, u))) for u in (0.25, 0.75))
    assert (few < [1.0, 2.0]).all()
    assert (many > [1.0, 2.0]).all()


NOT_TO_BE_DRAWN = [
    ("normal", {"mean": 1.0, "sigma": 0.0}, "expected a positive sigma, not 0.0"),
    ("normal", {"mean": 1.0}, "expected either sigma or covariance"),
    ("normal", {"mean": [1.0], "sigma": [1.0, 2.0], "within": [2.0, 1.0]}, "the smaller limit"),
    ("log_normal", {"median": 1.0, "sigma": 0.0}, "expected a positive sigma, not 0.0"),
    ("log_normal", {"median": 0.0, "sigma": 1.0}, "expected a positive median, not 0.0"),
    ("uniform", {"low": 1.0, "high": 1.0}, "expected a low that is smaller than high, not 1.0"),
    ("uniform", {"low": [1.0, 2.0, 3.0], "high": [2.0, 4.0]}, "expected vectors of one length"),
    ("uniform", [1.0, 2.0], "x.uniform: must be a table"),
    ("uniform", {"low": [[1.0]], "high": 2.0}, "x.uniform.low: must be a number or a vector"),
    ("rotation", {"sigma": 0.0}, "expected a positive sigma, not 0.0"),
    ("rotation", {"sigma": 1.0, "attitude": [1.0, 0.0, 0.1, 0.0]}, "that is a unit quaternion"),
    ("inertia", {"principal": [1.0, 2.0], "spread": 0.1}, "expected three principal moments"),
    (
        "inertia",
        {"principal": [1.0, 2.0, 3.0], "spread": 0.1},
        "each smaller than the sum of the others",
    ),
    ("inertia", {"principal": [2.0, 2.0, 3.0], "spread": -0.1}, "spread and axes of at least 0"),
    (
        "inertia",
        {"principal": [2.0, 2.0, 3.0], "spread": 0.1, "axes": -0.1},
        "spread and axes of at least 0",
    ),
    ("range", {"first": 0.0, "last": 1.0}, "x.range.count: is missing"),
    ("range", {"first": 0.0, "last": 1.0, "count": 0}, "a whole number from 1 to 1000000, not 0"),
    ("range", {"first": 0.0, "last": 1.0, "count": 10**6 + 1}, "from 1 to 1000000, not 1000001"),
]


@pytest.mark.parametrize(("kind", "given", "states"), NOT_TO_BE_DRAWN)
def test_an_invalid_distribution_is_rejected(kind, given, states):
    wrong = list(problems({kind: given}, factors.Varied, "x"))
    if not wrong:
        with pytest.raises(ValueError, match=f"^{kind}: ") as caught:
            factor("x", {kind: given})
        wrong = [str(caught.value)]
    (line,) = wrong
    assert states in line


def test_a_range_has_both_its_ends():
    made = factor("x", {"range": {"first": 0.0, "last": 1.0, "count": 5}})
    assert list(made.choices) == [0.0, 0.25, 0.5, 0.75, 1.0]


def test_rotations_turn_an_attitude_by_vectors_of_their_deviation():
    phi = sample("rotation", sigma=0.1)
    assert phi.std(axis=0) == pytest.approx([0.1] * 3, rel=0.06)
    start = np.array([0.5, 0.5, -0.5, 0.5])
    q = sample("rotation", sigma=0.1, attitude=start.tolist())
    assert np.linalg.norm(q, axis=1) == pytest.approx(np.ones(len(q)), abs=1e-12)
    angle = 2 * np.arccos(np.clip(np.abs(q @ start), 0, 1))
    assert angle == pytest.approx(np.linalg.norm(phi, axis=1), abs=1e-7)


def test_inertias_are_positive_definite_and_obey_the_triangle_rule_however_wide_the_spread():
    j = sample("inertia", n=500, principal=[10.0, 12.0, 20.0], spread=1.5, axes=1.0)
    assert np.array_equal(j, np.swapaxes(j, 1, 2))
    moments = np.linalg.eigvalsh(j)
    assert (moments > 0).all()
    assert (moments[:, 0] + moments[:, 1] >= moments[:, 2] * (1 - 1e-12)).all()
    still = sample("inertia", n=2, principal=[10.0, 12.0, 20.0], spread=0.0)
    assert still[0] == pytest.approx(np.diag([10.0, 12.0, 20.0]), abs=1e-12)


@pytest.mark.parametrize("sampler", ["latin-hypercube", "sobol"])
def test_samples_fill_every_stratum(sampler):
    numbers = factors.numbers(sampler, 64, 3, 1)
    for column in numbers.T:
        assert sorted((column * 64).astype(int)) == list(range(64))


def test_run_i_of_a_random_campaign_does_not_depend_on_the_number_of_runs(system):
    factors = {"twice.k": {"normal": {"mean": 2.0, "sigma": 0.5}}}
    given = table(system, seeds=["count.n_0"], factors=factors)
    short, long = (read_plan({**given, "runs": n})[0] for n in (5, 50))
    assert [short.values(i) for i in range(5)] == [long.values(i) for i in range(5)]
    assert len({long.values(i)["count.n_0"] for i in range(50)}) == 50


def test_listed_values_are_a_grid_and_every_cell_has_the_same_draws(system):
    given = table(system, runs=3)
    given["factors"] |= {"bad.t_fail": {"list": [50.0, 60.0]}, "latency.count": {"list": [0, 1]}}
    plan, _ = read_plan(given)
    values = [plan.values(i) for i in range(plan.runs)]
    assert plan.runs == 12
    cells = [(v["bad.t_fail"], v["latency.count"]) for v in values]
    assert cells[:4] == [(50.0, 0), (50.0, 1), (60.0, 0), (60.0, 1)]
    assert len({v["twice.k"] for v in values[:4]}) == 1
    assert len({v["twice.k"] for v in values}) == 3
    assert plan.changes(values[1])["latency"] == {"count": 1}


# ---- files that make no sense


def test_everything_that_is_wrong_is_reported_at_once_and_before_the_first_run(system, tmp_path):
    bad = table(
        system,
        runs=0,
        seed=2**64,
        sampler="sobel",
        colour="red",
        factors={
            "twice.q": {"normal": {"mean": 1.0, "sigma": 1.0}},
            "twice.k": {"normal": {"mean": 1.0, "sigma": -1.0}},
            "count.n_0": {"list": []},
            "bad.t_fail": {"normal": {"mean": [1.0, 2.0], "covariance": [[1.0, 2.0], [2.0, 1.0]]}},
            "bad.status": {"gaussian": {}},
            "swap.twice": {"list": ["nothing"]},
        },
        metrics={"end": "twice.y[-1", "other": "delta v", "third": "open('x')"},
        success="nonsense(twice.y)",
    )
    with pytest.raises(StructureError) as caught:
        campaign(bad, tmp_path / "out.zarr", workers=0)
    text = str(caught.value)
    for line in (
        "colour: there is no such entry",
        "runs: must be a whole number from 1 to 10000000, not 0",
        "seed: must be a whole number from 0 to 2^63 - 1, not 18446744073709551616",
        "sampler: must be random, latin-hypercube or sobol, not 'sobel'",
        "factors.twice.q: twice.q: there is no such variable",
        "factors.twice.k: normal: expected a positive sigma, not -1.0",
        "factors.count.n_0.list: must be values in brackets, not []",
        "factors.bad.t_fail: normal: expected a symmetric, positive definite covariance, 2 x 2",
        "factors.bad.status.gaussian: there is no such entry",
        "factors.swap.twice: nothing: there is no such FMU",
        "metrics.end: is neither a known metric nor an expression",
        "metrics.other: is neither a known metric nor an expression (close: delta-v)",
        "metrics.third: there is no function open",
        "success: there is no function nonsense",
    ):
        assert line in text
    assert not (tmp_path / "out.zarr").exists()


def test_metrics_and_histories_of_variables_that_do_not_exist_are_rejected(system, tmp_path):
    bad = table(
        system, metrics={"end": "last(twice.yy)"}, record={"bands": ["count.m"], "band": []}
    )
    with pytest.raises(StructureError) as caught:
        campaign(bad, tmp_path / "out.zarr", workers=0)
    assert "metrics.end: there is no variable twice.yy (close: twice.y)" in str(caught.value)
    assert "record.bands: there is no variable count.m" in str(caught.value)
    assert "record.band: there is no such entry (close: bands)" in str(caught.value)


@pytest.mark.parametrize("worst", ["success", "-success", "--end", "none"])
def test_a_ranking_by_what_is_no_metric_is_rejected(system, tmp_path, worst):
    metrics = {"end": "last(twice.y)"}
    given = table(system, metrics=metrics, success="last(twice.y) >= 0", worst=worst)
    with pytest.raises(StructureError, match=r"worst: there is no metric"):
        campaign(given, tmp_path / "out.zarr", workers=0)


def test_expectations_of_what_does_not_exist_or_of_no_interval_are_rejected(system, tmp_path):
    metrics = {"end": "last(twice.y)", "first": "first(twice.y)", "least": "min(twice.y)"}
    expected = {"ends": [0, 1], "end": [2.0, 1.0], "first": 3.0, "least": [0, True]}
    with pytest.raises(StructureError) as caught:
        campaign(table(system, metrics=metrics, expected=expected), tmp_path / "out.zarr")
    text = str(caught.value)
    assert "expected.ends: there is no metric ends (close: end)" in text
    assert "expected.end: expected [least, largest], got [2.0, 1.0]" in text
    for name, given in (("first", "3.0"), ("least", "[0, True]")):
        assert f"expected.{name}: must be [least, largest] mean, not {given}" in text


def test_a_verdict_is_given_on_the_mean_of_a_metric(system, tmp_path):
    metrics = {"end": "last(twice.y)", "mean": "mean(twice.y)"}
    mean = float(
        np.mean(campaign(table(system, metrics=metrics), tmp_path / "a", workers=0).data["end"])
    )
    expected = {"end": [mean - 1e-3, mean + 1e-3], "mean": [mean + 1.0, mean + 2.0]}
    found = campaign(table(system, metrics=metrics, expected=expected), tmp_path / "b", workers=0)
    text = found.summary()
    assert f"end: mean {mean:.5g}, expected {mean - 1e-3:g} to {mean + 1e-3:g}: as expected" in text
    assert f"expected {mean + 1:g} to {mean + 2:g}: NOT as expected" in text


def test_an_invalid_combination_is_reported_once_and_not_for_every_value(system, tmp_path):
    bad = table(system, runs=1, factors={"twice.k": {"range": {"first": 1, "last": 2, "count": 9}}})
    bad["factors"]["latency.count"] = {"list": [0, 1, 2, 3]}
    with pytest.raises(StructureError) as caught:
        campaign(bad, tmp_path / "out.zarr", workers=0)
    assert str(caught.value).splitlines() == [
        f"campaign: run {k}: count: latency must lie in 0..1 macro steps under gauss-seidel, "
        f"not {k}"
        for k in (2, 3)
    ]


def test_a_factor_of_the_wrong_shape_is_rejected(system, tmp_path):
    bad = table(system, factors={"twice.k": {"normal": {"mean": [1.0, 2.0], "sigma": 1.0}}})
    with pytest.raises(StructureError, match=r"factors\.twice\.k: .* expected a number"):
        campaign(bad, tmp_path / "out.zarr", workers=0)


# ---- metrics


@pytest.mark.parametrize(
    "text",
    ["().__class__", "twice.y.__class__()", "[1]", "lambda: 1", "max(twice.y, key=1)", "f'{1}'"],
)
def test_an_expression_holds_nothing_but_numbers(text, tmp_path):
    with pytest.raises(ValueError, match=r"expression|function"):
        metrics.metric(text, tmp_path)


def test_expressions_compute_what_they_state(system):
    result = run(system)
    for text, value in {
        "last(twice.y)": 12.0,
        "mean(count.n)": 3.0,
        "rms(count.n - 3)": 2.0,
        "parameter(twice.k) ** 2": 4.0,
        "at(count.n, 2 s) < 3 and last(time) == 6": 1.0,
        "-max(count.n) / 2": -3.0,
        "percentile(count.n, 50)": 3.0,
    }.items():
        assert metrics.metric(text, system.parent)(result) == value


def test_a_function_of_the_user_is_a_metric(system, tmp_path):
    (tmp_path / "mine.py").write_text(
        "def spread(result):\n    return 7.5 + result['count.n'][0] * 0\n"
    )
    given = table(system, runs=2, metrics={"mine": f"{tmp_path}/mine.py:spread"})
    found = campaign(given, tmp_path / "out.zarr", workers=0)
    assert found.store.array("mine").tolist() == [7.5, 7.5]


def test_no_block_of_runs_repeats_the_warnings_of_its_runs(system, tmp_path, caplog):
    """The first block of a process made its reused simulation, which silenced that block only."""
    (tmp_path / "loud.py").write_text(
        "import logging\n\ndef loud(result):\n"
        "    logging.getLogger('harness').warning('from a run')\n    return 1.0\n"
    )
    given = table(system, runs=4, metrics={"loud": f"{tmp_path}/loud.py:loud"})
    campaign(given, tmp_path / "out.zarr", workers=0)
    assert "from a run" not in caplog.text


# ---- runs


@pytest.fixture(scope="module")
def serial(system, tmp_path_factory):
    """The campaign, run by this process alone."""
    folder = tmp_path_factory.mktemp("serial")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)  # an FMU leaves a file
        return campaign(with_bands(system), folder / "serial.zarr", workers=0)


def with_bands(system):
    record = {"histories": ["twice.y"], "bands": ["count.n"], "rows": 4}
    return table(system, record=record, success="last(twice.y) > 20")


def test_every_run_is_a_run_of_its_own_to_the_bit(system, serial):
    store = serial.store
    for k in (0, 3, 7):
        alone = run(system, **like(f"{serial.path}#{k}", system)[1])
        assert store.array("last")[k].tobytes() == alone.values[-1].tobytes()
        assert store.array("end")[k] == alone["twice.y"][-1]
        assert store.array("twice.y")[k, :, 0].tobytes() == alone["twice.y"][::2].tobytes()
    assert set(store.array("status")) == {1}


def test_the_last_row_is_retained_though_no_stride_ends_there(system, tmp_path):
    record = {"histories": ["count.n"], "rows": 3}
    for every, steps in ((1, [0, 3, 6]), (4, [0, 4, 6]), (5, [0, 5, 6]), (9, [0, 6])):
        made = campaign(
            table(system, runs=2, record=record, every=every), tmp_path / f"{every}.zarr", workers=0
        )
        starts = made.store.array("count.n_0")
        assert made.data["time"].values.tolist() == steps
        assert made.store.array("count.n")[:, :, 0].tolist() == (starts[:, None] + steps).tolist()
    made = campaign(
        table(system, runs=2, record={"histories": ["count.n"], "rows": 2}, every=1),
        tmp_path / "two.zarr",
        workers=0,
    )
    assert made.data["time"].values.tolist() == [0, 4, 6]


def test_every_row_of_a_block_is_at_its_run(system, tmp_path):
    given = table(system, runs=64, metrics={"seen": "parameter(twice.k)"})
    store = campaign(given, tmp_path / "c.zarr", workers=0).store
    assert store.block == 8
    assert store.array("seen").tolist() == store.array("twice.k").tolist()
    assert len({*store.array("seen")}) == 64


def test_blocks_of_fused_runs_are_multiples_of_the_runs_in_lanes(system):
    """On every machine, so that a dataset does not depend on the width of its vectors."""
    alone, fused = (read_plan(table(system, executor=name))[1] for name in ("c", "fused"))
    assert [alone.block(n) for n in (0, 1, 3, 18, 200)] == [1, 1, 3, 18, 200]
    assert [fused.block(n) for n in (0, 1, 3, 18, 200)] == [8, 8, 8, 16, 200]
    assert fused.piece % 8 == 0


def test_bands_are_the_percentiles_of_all_histories(serial):
    starts = serial.store.array("count.n_0")
    required = np.percentile(starts[:, None] + [0, 2, 4, 6], [5, 25, 50, 75, 95], axis=0)
    assert serial.store.array("count.n_band")[:, :, 0] == pytest.approx(required, rel=1e-14)
    assert serial.store.names("history") == ["twice.y"]


def test_xarray_opens_the_dataset_with_labelled_factors_and_metrics(serial):
    data = serial.data
    assert data["end"].dims == ("run",)
    assert data.sizes == {"run": 8, "column": 6, "time": 4, "percentile": 5} | {
        k: v for k, v in data.sizes.items() if k.endswith("_element")
    }
    assert float(data["end"][3]) == serial.store.array("end")[3]
    assert data["time"].values.tolist() == [0, 2, 4, 6]


def workers_of(pid):
    """Worker processes of a campaign: forked from a server, or started on their own."""
    ours = {child: " ".join(child.cmdline()) for child in psutil.Process(pid).children()}
    servers = [child for child, text in ours.items() if "multiprocessing.forkserver" in text]
    spawned = [child.pid for child, text in ours.items() if "multiprocessing.spawn" in text]
    return [child.pid for server in servers for child in server.children()] or spawned


def test_two_workers_give_the_bits_of_one_process_also_if_one_of_them_is_killed(
    system, serial, tmp_path
):
    killed = []

    def kill(progress):
        if not killed:
            killed.append(workers_of(os.getpid())[-1])
            os.kill(killed[0], signal.SIGKILL)

    found = campaign(with_bands(system), tmp_path / "two.zarr", workers=2, progress=kill)
    assert killed
    assert same(found.store, serial.store)


def test_a_run_that_ends_every_worker_is_a_failed_run(system, tmp_path):
    """A metric of the user's own may do that; the others of its block are run once more."""
    (tmp_path / "mine.py").write_text(
        "import os\n\ndef end(result):\n    y = result['twice.y'][-1]\n"
        "    return y if y != 8 else os._exit(3)\n"
    )
    given = {
        "system": str(system),
        "fixed": {"stop": 2.0},
        "factors": {"twice.k": {"list": [1.0, 2.0, 3.0, 4.0]}},
        "metrics": {"mine": f"{tmp_path}/mine.py:end"},
    }
    found = campaign(given, tmp_path / "out.zarr", workers=1).store
    assert found.array("status").tolist() == [1, 1, 1, 2]
    assert found.array("mine")[:3].tolist() == [2.0, 4.0, 6.0]
    assert found.array("message")[3] == (
        "the process of this run was killed from outside, or crashed inside an FMU"
    )


CTRL_C_AFTER_FOUR = """
import os, signal, sys
from harness.cli import main
from harness.studies.campaign.store import Store
stored = Store.write
def write(store, first, values, rows, further):
    stored(store, first, values, rows, further)
    if first == 3:
        os.kill(os.getpid(), signal.SIGINT)
Store.write = write
sys.exit(main())
"""


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_an_interrupted_campaign_continues_where_it_was(system, tmp_path):
    given = with_bands(system)
    text = f"""
system = "{system}"
runs = 8
seed = 5
success = "{given["success"]}"
[metrics]
end = "{given["metrics"]["end"]}"
most = "{given["metrics"]["most"]}"
[record]
histories = ["twice.y"]
bands = ["count.n"]
rows = 4
[fixed]
stop = 60.0
[factors]
"twice.k" = {{normal = {{mean = 2.0, sigma = 0.5}}}}
"count.n_0" = {{uniform = {{low = 0.0, high = 10.0}}}}
"""
    (tmp_path / "c.toml").write_text(text)
    out = tmp_path / "c.zarr"
    command = [sys.executable, "-c", CTRL_C_AFTER_FOUR, "campaign", "c.toml", "-o", "c.zarr", "-q"]
    process = start(
        [*command, "--workers", "0"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
    )
    _, errors = process.communicate(timeout=LONGEST)
    assert (errors, process.returncode) == ("harness: interrupted\n", 1)
    done = int((Store.open(out).array("status") != 0).sum())
    assert done == 4
    with pytest.raises(UsageError, match="already exists"):
        campaign(tmp_path / "c.toml", out, workers=0)
    seen = []
    found = campaign(
        tmp_path / "c.toml", out, workers=0, resume=True, progress=lambda p: seen.append(p.done)
    )
    assert seen[0] == done + 1
    whole = campaign(tmp_path / "c.toml", tmp_path / "whole.zarr", workers=0)
    assert same(found.store, whole.store)


def test_another_campaign_is_not_resumed(system, serial):
    with pytest.raises(
        UsageError, match="cannot resume: changed since its first run: seed, record"
    ):
        campaign(table(system, seed=6), serial.path, workers=0, resume=True)


def test_runs_that_fail_are_data(system, tmp_path):
    given = table(system, runs=1, success="last(twice.y) > 0", record={"bands": ["count.n"]})
    given["factors"] = {"bad.t_fail": {"list": [3.0, 50.0]}, "bad.status": {"list": [3.0, 4.0]}}
    found = campaign(given, tmp_path / "out.zarr", workers=0)
    store = found.store
    assert store.array("status").tolist() == [2, 2, 1, 1]
    required = "bad: step failed: burnt through after too much heat (at t = 3 s)"
    assert store.array("message").tolist() == [required, required, "", ""]
    assert store.array("end_time").tolist() == [3.0, 3.0, 6.0, 6.0]
    assert store.array("last")[0, 0] == 3.0
    text = found.summary()
    assert text.startswith("4 runs, 2 failed\nsuccess: 2 of 4, 50.0 %")
    end = dict(zip(("failed", "complete"), store.array("end")[[0, 2]], strict=True))
    assert end["failed"] < end["complete"]
    assert re.search(rf"^end +{end['complete']:g} +0 ", text, re.MULTILINE)  # mean, std
    assert f"failed: run 0: {required}" in text


def test_a_rejected_value_that_is_fixed_retains_a_campaign_from_starting(tmp_path):
    given = {"system": "relay_approach", "runs": 4, "fixed": {"stop": 1.0}, "metrics": {}}
    given["factors"] = {"guidance.rho1": {"uniform": {"low": -1.0, "high": 1.0}}}
    given["fixed"]["set"] = {"guidance.rho2": 0.001, "guidance.zeta2": 1e9}
    with pytest.raises(StructureError) as caught:
        campaign(given, tmp_path / "out.zarr", workers=0)
    assert str(caught.value) == "campaign: fixed: guidance.zeta2=1000000000.0: must be below zeta1"
    assert not (tmp_path / "out.zarr").exists()
    given["fixed"]["set"] = {"guidance.rho2": 0.001}
    store = campaign(given, tmp_path / "out.zarr", workers=0).store
    for value, message in zip(store.array("guidance.rho1"), store.array("message"), strict=True):
        assert message == f"guidance.rho1={value}: must be {'below rho2' if value > 0 else '>= 0'}"


def test_an_fmu_that_crashes_costs_its_own_run_only(fmus, tmp_path):
    model = Model("crash_if", [u("u"), y("y"), p("k")], "y = u;", "if (k > 0.5) abort();")
    toml = TOML.replace('"failing"', '"crash_if"').replace("t_fail = 100.0", "k = 0.0")
    toml = toml.replace("[connections]", '[connections]\n"bad.u" = "count.n"')
    known = fmus | {"crash_if": build(model, tmp_path)}
    write_ssp(system_of(tomllib.loads(toml), known), tmp_path / "crash.ssp")
    given = table(tmp_path / "crash.ssp", runs=1, metrics={"end": "last(bad.y)"})
    given["factors"] = {"bad.k": {"list": [0.0, 0.0, 1.0, 0.0]}}
    store = campaign(given, tmp_path / "out.zarr", workers=2).store
    assert store.array("status").tolist() == [1, 1, 2, 1]
    assert store.array("message")[2].startswith("bad: fmi2DoStep crashed (SIGABRT, aborted)")
    assert store.array("end")[[0, 1, 3]].tolist() == [6.0, 6.0, 6.0]


# ---- numbers


@pytest.mark.parametrize(("successes", "n"), [(0, 10), (10, 10), (3, 20), (81, 263)])
def test_the_wilson_interval_matches_scipy(successes, n):
    required = stats.binomtest(successes, n).proportion_ci(0.95, method="wilson")
    assert summary.wilson(successes, n) == pytest.approx((required.low, required.high), abs=1e-12)


def test_rank_correlation_matches_scipy():
    rng = np.random.default_rng(1)
    x = rng.integers(0, 5, 200).astype(float)
    z = x**3 + rng.normal(size=200)
    z[7] = np.nan
    required = stats.spearmanr(np.delete(x, 7), np.delete(z, 7)).statistic
    assert summary.rank_correlation(x, z) == pytest.approx(required, abs=1e-12)


# ---- the command


def test_the_command_shows_the_summary_and_repeats_a_run(system, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(system, "demo.ssp")
    (tmp_path / "few.toml").write_text(
        'system = "demo.ssp"\nruns = 12\nsuccess = "last(twice.y) > 0"\n'
        + '[factors]\n"twice.k" = {uniform = {low = 1.0, high = 2.0}}\n'
        + '[metrics]\nend = "last(twice.y)"\n[record]\nbands = ["twice.y"]\n'
    )
    command = ["campaign", "few.toml", "--workers", "0", "-o"]
    assert main([*command, "quiet.zarr", "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    assert main([*command, "few.zarr"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("12 runs, 0 failed\nsuccess: 12 of 12, 100.0 % (95 %: 75.8 to 100.0 %)\n")
    assert "end: twice.k +1.00" in out
    assert out.endswith("dataset few.zarr\nnext: harness report few.zarr -o few.html\n")
    assert not list(tmp_path.glob("*_figures"))
    assert main(["campaign", "few.toml", "--workers", "0", "-o", "drawn.zarr", "--figures"]) == 0
    assert "dataset drawn.zarr, 3 figures in drawn_figures\n" in capsys.readouterr().out
    assert main(["plot", "few.zarr", "--format", "svg", "-o", "few"]) == 0
    names = ("histograms", "end", "band_twice.y")
    assert capsys.readouterr().out.split() == [f"few/campaign_{name}.svg" for name in names]
    assert main(["plot", "few.zarr", "--var", "twice.y"]) == 2
    assert "--var: few.zarr is a dataset; give the results file" in capsys.readouterr().err
    ends = Store.open(tmp_path / "few.zarr").array("end")
    worst = int(np.argmax(ends))
    command = f"harness run demo --like few.zarr#{worst}"
    assert next(line for line in out.splitlines() if command in line)
    arguments = ["run", "demo.ssp", "--like", f"few.zarr#{worst}", "-o", "again.csv"]
    assert main(arguments) == 0
    assert "next: harness report again.csv -o again.html\n" in capsys.readouterr().out
    assert not list(tmp_path.glob("again_*"))
    assert read(tmp_path / "again.csv")["twice.y"][-1] == ends[worst]


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("few", "expected a dataset and the number of a run"),
        ("serial.zarr#99", "the dataset has runs 0 to 7"),
    ],
)
def test_runs_that_do_not_exist_cannot_be_repeated(system, serial, monkeypatch, text, problem):
    monkeypatch.chdir(serial.path.parent)
    with pytest.raises(UsageError, match=problem):
        like(text, system)


@pytest.mark.parametrize("name", some(campaigns(), 8))
def test_the_studies_of_the_project_make_sense(name):
    plan, _ = read_plan(campaigns()[name])
    assert plan.runs > 1


def test_the_studies_of_the_project_are_listed_and_a_name_gets_a_hint(capsys):
    assert main(["study"]) == 0
    assert set(campaigns()) == set(capsys.readouterr().out.split())
    assert "space_robot_rotation" in campaigns()
    assert main(["study", "space_robot_rotaton"]) == 2
    assert "close: space_robot_rotation" in capsys.readouterr().err


def test_two_listed_factors_are_drawn_as_a_map(system, tmp_path):
    given = table(system, runs=1, metrics={"end": "last(twice.y)"})
    given["factors"] = {
        "twice.k": {"range": {"first": 1.0, "last": 2.0, "count": 3}},
        "count.n_0": {"list": [0.0, 5.0]},
    }
    found = campaign(given, tmp_path / "out.zarr", workers=0)
    names = [path.name for path in pictures(found.path, tmp_path, "svg", SCREEN)]
    assert names == ["campaign_histograms.svg", "campaign_map_end.svg"]


def test_a_plain_script_may_run_a_campaign_on_several_processes(system, tmp_path):
    """Processes that import the script which starts them would start processes of their own. They
    have the current environment, not the first campaign's.
    """
    (tmp_path / "script.py").write_text(
        f"""import os
from harness import campaign

print("once")
given = {table(system)!r}
for name in ("arenas", "threads", "level"):
    given["metrics"][name] = f"worker.py:{{name}}"
for level in ("3", "4"):
    os.environ["LEVEL"] = level
    done = campaign(given, f"out{{level}}.zarr", workers=2).store
    print(*(set(done.array(name).tolist()) for name in ("status", "arenas", "threads", "level")))
"""
    )
    (tmp_path / "worker.py").write_text(
        "import os\n\nimport psutil\n\n\n"
        "def arenas(result):\n    return float(os.environ['MALLOC_ARENA_MAX'])\n"
        "\n\ndef threads(result):\n    server = psutil.Process(os.getppid())\n"
        "    kinds = ('OMP', 'MKL', 'OPENBLAS')\n"
        "    return float({server.environ()[f'{k}_NUM_THREADS'] for k in kinds} == {'1'})\n"
        "\n\ndef level(result):\n    return float(os.environ['LEVEL'])\n"
    )
    ended = subprocess.run(
        [sys.executable, "script.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        env={n: v for n, v in os.environ.items() if not n.endswith("_NUM_THREADS")}
        | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
    )
    required = "once\n{1} {1.0} {1.0} {3.0}\n{1} {1.0} {1.0} {4.0}\n"
    assert (ended.stdout, ended.stderr) == (required, "")


@pytest.mark.parametrize("workers", [0, 2])
@pytest.mark.parametrize("writing", ["zarr.Group.create_array", "zarr.Array.__setitem__"])
def test_a_full_disk_is_an_error_that_names_the_dataset(
    system, tmp_path, monkeypatch, writing, workers
):
    """Not one of standard output, nor of a worker."""

    def fail(*_, **__):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(writing, fail)
    with pytest.raises(ResultsError, match=r"out.zarr: cannot be written \(No space left"):
        campaign(table(system), tmp_path / "out.zarr", workers=workers)


@pytest.mark.parametrize("runs", [1, 5, 6, 7, 24])
def test_the_last_blocks_are_simulated_in_pieces(runs):
    blocks = [Block(k, [{}] * min(3, runs - k)) for k in range(0, runs, 3)]
    given = list(engine.last_in_pieces(blocks, 2, 2))
    assert [block for block, _ in given] == blocks
    whole = max(0, len(blocks) - 2)
    assert [piece for _, piece in given] == [3] * whole + [2] * (len(blocks) - whole)


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_workers_end_with_a_campaign_that_is_interrupted_while_they_start(
    system, tmp_path, monkeypatch
):
    """Else they are closed at the exit of Python, with a traceback if they are slow."""
    begin, begun = pools._Worker.begin, []
    earlier = signal.signal(signal.SIGINT, signal.default_int_handler)  # may have been ignored

    def interrupted(worker):
        begin(worker)
        begun.append(worker._process)
        signal.pthread_kill(threading.main_thread().ident, signal.SIGINT)

    monkeypatch.setattr(pools._Worker, "begin", interrupted)
    try:
        with pytest.raises(KeyboardInterrupt):
            campaign(table(system), tmp_path / "out.zarr", workers=2)
    finally:
        signal.signal(signal.SIGINT, earlier)
    assert [process.is_alive() for process in begun] == [False, False]


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_reaches_us_alone_and_the_workers_state_nothing(system, tmp_path):
    (tmp_path / "long.toml").write_text(
        f'system = "{system}"\nruns = 320\n[fixed]\nstop = 600.0\n'
        '[factors]\n"twice.k" = {uniform = {low = 1.0, high = 2.0}}\n'
    )
    command = [sys.executable, "-m", "harness", "campaign", "long.toml", "-o", "long.zarr"]
    process = start(
        [*command, "--workers", "2"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
    )
    until((tmp_path / "long.zarr" / "status" / "c" / "0").exists, "first block")
    assert len(workers_of(process.pid)) == 2
    os.killpg(process.pid, signal.SIGINT)  # as the terminal does it
    output, errors = process.communicate(timeout=LONGEST)
    assert (output, errors, process.returncode) == ("", "harness: interrupted\n", 1)


# ---- what the numbers are


def test_a_dataset_states_units_and_meanings_of_factors_metrics_and_bands(tmp_path):
    """CF attributes; a metric has the unit that follows from its text, or none."""
    (tmp_path / "mine.py").write_text("def rows(result):\n    return len(result.time)\n")
    apart = "last(norm(servicer.r_SN_N - target.r_TN_N))"
    done = campaign(
        {
            "system": "sync_approach",
            "fixed": {"stop": 1.0},
            "factors": {
                "servicer.mass_0": {"list": [90.0, 100.0]},
                "target.omega_TN_T_0": {"list": [[0.01, 0.02, 0.0]]},
                "latency.guidance": {"list": [0]},
            },
            "metrics": {
                "miss": apart,
                "cost": "delta-v",
                "turn": f"degrees({apart} / 1000 m)",
                "rows": f"{tmp_path / 'mine.py'}:rows",
                "area": f"{apart} * {apart}",
            },
            "success": f"{apart} < 2 km",
            "record": {"bands": ["guidance.range"]},
        },
        tmp_path / "out.zarr",
        workers=0,
    )
    found = {name: v.attrs.get("units") for name, v in done.data.variables.items()}
    assert found["servicer.mass_0"] == "kg"
    assert found["target.omega_TN_T_0"] == "rad/s"
    assert (found["miss"], found["cost"], found["turn"]) == ("m", "m/s", "deg")
    assert (found["success"], found["end_time"]) == ("1", "s")
    assert found["guidance.range_band"] == "m"
    assert found["area"] == "m2"
    assert not {found["rows"], found["latency.guidance"]} - {None}
    assert done.data["servicer.mass_0"].attrs["long_name"].startswith("start mass")
    assert done.data["miss"].attrs["long_name"] == apart
    status = done.data["status"].attrs
    flags = dict(zip(status["flag_meanings"].split(), status["flag_values"], strict=True))
    assert flags == {"pending": 0, "complete": COMPLETE, "failed": FAILED}
    units = dict(zip(done.data["column"].values, done.data["column_units"].values, strict=True))
    assert units["servicer.v_SN_N[2]"] == "m/s"
    assert "\ncost [m/s] " in done.summary()
    assert "\nrows  " in done.summary()
    assert with_unit("target.omega_TN_T_0[2]", done.store.units()) == (
        "target.omega_TN_T_0[2] [rad/s]"
    )


# ---- odd tables

ODD = [
    None, 0, -1, 2.5, float("nan"), float("inf"), 10**400, 2**63, "", "x", [], [[]], [1, "a"],
    [[1], [2, 3]], {}, {"a": {"b": []}}, True, datetime.date(2026, 1, 1), "count.n", -0.0, 1e308,
]  # fmt: skip


def ordinary(system):
    return table(
        system,
        runs=2,
        fixed={"stop": 3.0, "set": {"bad.status": 3.0}},
        factors={
            "twice.k": {"normal": {"mean": 2.0, "sigma": 0.5}},
            "latency.twice": {"list": [0, 1]},
            "stop": {"range": {"first": 2.0, "last": 3.0, "count": 2}},
        },
        seeds=[],
        record={"histories": ["count.n"], "rows": 5},
        expected={"end": [0.0, 9.0]},
        worst="-end",
        success="last(twice.y) > 0",
        sampler="sobol",
        patience=5.0,
        every=1,
    )


def entries(given, place=()):
    """Places of all entries of nested tables and lists."""
    if isinstance(given, list):
        given = dict(enumerate(given))
    for key, value in given.items() if isinstance(given, dict) else ():
        yield (*place, key)
        yield from entries(value, (*place, key))


def changed(given, place, value):
    changed_one = copy.deepcopy(given)
    inner = changed_one
    for key in place[:-1]:
        inner = inner[key]
    inner[place[-1]] = value
    return changed_one


@pytest.mark.parametrize("every", [8, pytest.param(1, marks=pytest.mark.long)])
def test_every_entry_of_a_campaign_may_be_anything(system, every):
    """Each entry in turn is something else: a plan or a line per problem, never another error.

    Every eighth pair of the two has every entry and, since ODD has an odd length, every value.
    """
    given = ordinary(system)
    read_plan(given)
    pairs = [(place, value) for place in entries(given) for value in ODD]
    for place, value in pairs[::every]:
        try:
            plan, found = read_plan(changed(given, place, value))
        except HarnessError as error:
            assert str(error)
            assert "object" not in str(error).replace("objects cannot", ""), (place, value)
        else:
            assert found.steps > 0
            assert plan.changes(plan.values(0))


@pytest.mark.parametrize(
    ("place", "value", "line"),
    [
        (("seeds",), "count.n_0", "seeds: must be a list of texts, not 'count.n_0'"),
        (("record", "rows"), 0, "record.rows: must be a whole number of at least 1, not 0"),
        (("fixed", "stop"), "6 s", "fixed.stop: must be a finite number, not '6 s'"),
        (("metrics",), ["x"], "metrics: must be a table, not ['x']"),
        (
            ("factors", "latency.twice", "list"),
            [0, 0.5],
            "factors.latency.twice: must be a whole number of at least 0, not 0.5",
        ),
    ],
)
def test_an_entry_of_a_wrong_kind_is_reported_with_the_expected_kind(system, place, value, line):
    with pytest.raises(StructureError) as caught:
        read_plan(changed(ordinary(system), place, value))
    assert str(caught.value).splitlines()[0] == f"campaign: {line}"
