# SPDX-License-Identifier: BSD-2-Clause
"""Requirements of the system in every run of a campaign, success in their grammar, and what of both
decides on the exit status.
"""

from __future__ import annotations

import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
import tomli_w
from scipy import stats

from harness import campaign
from harness.cli.app import main
from harness.errors import StructureError
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from harness.studies.campaign import summary
from harness.studies.campaign.store import Store
from tests.harness import demo

pytestmark = pytest.mark.usefixtures("trusted")

TOML = (
    demo.TOML
    + """[requirements]
small = "twice.y <= 20"
late = "time < 4 s or twice.y >= 10"
"""
)
# count.n counts calls from n_0; over the 7 rows y = k n
MET, NOT_MET, NOT_EXERCISED = 1, 2, 3


@pytest.fixture
def system(fmus, tmp_path):
    write_ssp(system_of(tomllib.loads(TOML), fmus), tmp_path / "demo.ssp")
    return tmp_path / "demo.ssp"


def table(system, **more):
    gains = {"twice.k": {"list": [0.5, 2.0, 3.0, 4.0]}}
    return {"system": str(system), "factors": gains, "metrics": {"end": "last(twice.y)"}, **more}


def test_requirements_of_the_system_are_evaluated_in_every_run(system, tmp_path):
    store = campaign(table(system), tmp_path / "c.zarr", workers=0).store
    n = np.arange(7.0)
    required = [
        [MET if k * n.max() <= 20 else NOT_MET, MET if (k * n[4:] >= 10).all() else NOT_MET]
        for k in (0.5, 2.0, 3.0, 4.0)
    ]
    assert store.array("requirement").tolist() == ["small", "late"]
    assert store.array("requirement_text").tolist()[0] == "twice.y <= 20"
    assert store.array("verdict").tolist() == required
    assert len({tuple(row) for row in required}) == 3
    assert store.array("success").tolist() == [float(row == [MET, MET]) for row in required]
    assert store.array("message")[0] == "late: not met, worst 2 at 4 s"


def test_a_requirement_that_was_never_exercised_is_neither_met_nor_missed(system, tmp_path):
    found = campaign(table(system, fixed={"stop": 3.0}), tmp_path / "c.zarr", workers=0)
    assert found.store.array("verdict")[:, 1].tolist() == [NOT_EXERCISED] * 4
    share = summary.requirements(found.store)["late"]
    assert (share.met, share.evaluated, share.unjudged) == (0, 0, [0, 1, 2, 3])
    assert np.isnan(found.store.array("success")).all()
    line = "requirement late: not exercised in 4 of 4 runs, first run 0 (it does not apply up"
    assert line in found.summary()
    assert "requirement small: 4 of 4, 100.0 %" in found.summary()


def test_a_run_that_fails_has_met_nothing(system, tmp_path):
    given = table(system, fixed={"set": {"bad.t_fail": 3.0}})
    found = campaign(given, tmp_path / "c.zarr", workers=0)
    assert found.store.array("verdict").tolist() == [[0, 0]] * 4
    assert "requirement small: 0 of 4, 0.0 %" in found.summary()
    assert "success: 0 of 4, 0.0 %" in found.summary()


@pytest.mark.parametrize(
    ("text", "successes"),
    [
        ("twice.y <= 15", [1, 1, 0, 0]),  # 3, 12, 18, 24 at the end
        ("time < 5 s or twice.y >= 10", [0, 1, 1, 1]),
        ("time < 0.1 min or last(twice.y) > 20", [0, 0, 0, 1]),
        ("last(twice.y) > 15", [0, 0, 1, 1]),
        ("max(twice.y) > 10 and not (max(twice.y) > 20)", [0, 1, 1, 0]),
    ],
)
def test_success_is_stated_as_a_requirement_is(system, tmp_path, text, successes):
    store = campaign(table(system, success=text), tmp_path / "c.zarr", workers=0).store
    assert store.array("success").tolist() == successes
    for run, met in enumerate(successes):
        assert ("success: not met" in store.array("message")[run]) != bool(met)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("time < 7 s or twice.y > 1", "it does not apply up to the end at 6 s"),
        ("twice.y", "is not a condition"),
        ("time < 2 kg or twice.y > 1", "kg"),
    ],
)
def test_a_success_that_no_run_can_state_is_rejected_before_the_first(system, tmp_path, text, why):
    with pytest.raises(StructureError, match=f"^campaign: success: .*{why}"):
        campaign(table(system, success=text), tmp_path / "c.zarr", workers=0)
    assert not (tmp_path / "c.zarr").exists()


# ---- what decides on the exit status


def held(system, tmp_path, *options, **more):
    """Exit status of a campaign on the command line."""
    text = tomli_w.dumps(table(system, **more))
    (tmp_path / "c.toml").write_text(text)
    command = ["campaign", "c.toml", "-o", "c.zarr", "--workers", "0"]
    return main([*command, *options])


# of k = 0.5, 2, 3, 4: small is missed by 4 (y = 24 at the end), late by 0.5 and 2 (y = 4 k at 4 s)
LOWER_3_OF_4 = 0.30064184258240


MET_TOO = (
    "success >= 25 %",
    "success >= 0.25",
    "met(small) >= 75 %",
    f"lower(small) >= {LOWER_3_OF_4 - 1e-12}",
    "max(end) <= 24",
    "mean(end) > 14.24 and percentile(end, 50) == 15",
)
MISSED = (
    "success > 25 %",
    f"lower(small) >= {LOWER_3_OF_4 + 1e-12}",
    "lower( success ) >= 25 %",
    "end <= 23",  # in every run
    "max(end) <= 23",
)


def demanded(texts):
    return [word for text in texts for word in ("--require", text)]


def test_conditions_on_shares_and_metrics_that_are_met(system, tmp_path, capsys):
    assert held(system, tmp_path, *demanded(MET_TOO)) == 0
    assert "NOT MET" not in capsys.readouterr().err


def test_conditions_on_shares_and_metrics_that_are_missed_decide(system, tmp_path, capsys):
    assert held(system, tmp_path, *demanded([*MET_TOO, *MISSED])) == 1
    stated = [x for x in capsys.readouterr().err.splitlines() if "requirement NOT MET: " in x]
    reported = [line.partition("NOT MET: ")[2].partition("; ")[0] for line in stated]
    assert reported == list(MISSED)
    assert stated[-2].endswith(": end <= 23; worst 24 in run 3")
    assert stated[-1].endswith(": max(end) <= 23; worst 24")


def test_one_condition_that_is_missed_decides(system, tmp_path):
    assert held(system, tmp_path, "--require", MISSED[0]) == 1


def test_the_bound_matches_wilson():
    found = stats.binomtest(3, 4).proportion_ci(0.95, method="wilson")
    assert abs(found.low - LOWER_3_OF_4) < 1e-12


def test_a_condition_on_what_was_not_exercised_is_not_met(system, tmp_path, capsys):
    fixed = {"stop": 3.0}
    assert held(system, tmp_path, "--require", "met(late) >= 0 %", fixed=fixed) == 1
    assert "requirement NOT EXERCISED: met(late) >= 0 %" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("xsuccess >= 99 %", "there is no such metric or variable: xsuccess (close: success)"),
        ("met(smallx) >= 99 %", "no requirement smallx (close: small)"),
        ("success", "is not a condition; write one like `success >= 99 %`"),
        ("success >= 99 m", "m"),
        ("twice.y >= 3", "twice.y belongs to a single run; use a metric or a requirement"),
    ],
)
def test_a_condition_that_makes_no_sense_is_rejected_before_the_first_run(
    system, tmp_path, capsys, text, why
):
    assert held(system, tmp_path, "--require", text) == 2
    stated = capsys.readouterr().err
    assert stated.startswith(f"harness: --require {text}: ")
    assert why in stated
    assert not (tmp_path / "c.zarr").exists()


@pytest.mark.parametrize(
    ("expected", "strict", "status"),
    [
        ({"end": [14.0, 15.0]}, True, 0),  # mean 14.25
        ({"end": [14.3, 15.0]}, True, 1),
        ({"end": [14.3, 15.0]}, False, 0),
        ({"success": [0.2, 0.3]}, True, 0),
        ({"success": [0.6, 1.0]}, True, 1),
        ({}, True, 1),  # nothing is expected: every run must succeed
        ({}, False, 0),
    ],
)
def test_expectations_of_a_campaign_decide_if_strict(
    system, tmp_path, capsys, expected, strict, status
):
    more = {"expected": expected} if expected else {}
    assert held(system, tmp_path, *(["--strict"] if strict else []), **more) == status
    stated = capsys.readouterr()
    for name in expected:
        assert f"{name}: mean " in stated.out
        assert (f"harness: expectation {name}: mean" in stated.err) == bool(status)


def test_every_run_without_success_is_listed_with_why_and_its_command(system, tmp_path, capsys):
    gains = {"twice.k": {"list": [0.5, 3.0, 4.0, 0.25]}, "bad.t_fail": {"list": [100.0, 3.0]}}
    assert held(system, tmp_path, factors=gains) == 0
    out = capsys.readouterr().out
    required = {
        0: "late: not met, worst 2 at 4 s",
        1: "bad: step failed",
        3: "bad: step failed",
        4: "small: not met, worst 24 at 6 s",
        5: "bad: step failed",
        6: "late: not met, worst 1 at 4 s",
        7: "bad: step failed",
    }
    assert main(["report", "c.zarr", "-o", "c.html"]) == 0
    for gate in (["--strict"], ["--require", "guidance.range >= 1000 m"]):
        assert main(["report", "c.zarr", "-o", "d.html", *gate]) == 2
        assert "only a page is made" in capsys.readouterr().err
    assert not (tmp_path / "d.html").exists()
    page = (tmp_path / "c.html").read_text()
    for run, why in required.items():
        assert f"failed: run {run}: {why}" in out
        assert f"\n    harness run demo --like c.zarr#{run}\n" in out
        assert why in page
        assert f"harness run demo --like c.zarr#{run}<" in page
    assert "run 2:" not in out
    store = Store.open(tmp_path / "c.zarr")
    assert [k for k, text in enumerate(store.array("message")) if text] == [*required]
    assert store.group.attrs["repeat"] == "harness run demo --like DATASET#RUN"


def test_without_a_terminal_a_line_a_minute_states_how_far_it_is(
    system, tmp_path, capsys, monkeypatch
):
    clock = iter(range(0, 10_000, 45))
    monkeypatch.setattr("harness.master.progress.time", SimpleNamespace(monotonic=clock.__next__))
    assert held(system, tmp_path) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("c: ")]
    assert lines == ["c: 2 of 4, 0 failed, 2 min left", "c: 4 of 4, 0 failed, 0 min left"]
    (tmp_path / "c.zarr").rename(tmp_path / "d.zarr")
    assert held(system, tmp_path, "--quiet") == 0
    assert not [x for x in capsys.readouterr().err.splitlines() if x.startswith("c: ")]


# ---- what matters


def test_influences_that_may_be_chance_are_left_out_and_counted():
    """Of ten factors that do not matter one is beyond the limit in about one campaign of twenty."""
    limit = summary.chance(10, 200)
    rng = np.random.default_rng(7)
    largest = [
        max(
            abs(stats.spearmanr(rng.normal(size=200), rng.normal(size=200)).statistic)
            for _ in range(10)
        )
        for _ in range(400)
    ]
    beyond = np.mean(np.array(largest) > limit)
    assert 0.02 < beyond < 0.09
    x = rng.normal(size=200)
    factors = {"gain": x, "a": rng.normal(size=200), "b": rng.normal(size=200)}
    assert [*summary.ranked(factors, x + 0.1 * rng.normal(size=200))] == ["gain"]
    line = summary.left_out("end", factors, x)
    size = f"{summary.chance(3, 200):.2f}"
    reason = f"correlate by at most {size}, as 200 runs may by chance"
    assert line == f"end: 2 of 3 factors {reason}"


def test_a_metric_is_shown_with_its_mean_deviation_ends_and_percentiles():
    values = np.random.default_rng(5).normal(size=50)
    heads, row = summary._table({"end": np.append(values, np.nan)}, {})
    assert heads.split() == ["mean", "std", "least", "5", "%", "50", "%", "95", "%", "most"]
    found = [values.mean(), values.std(), values.min(), *np.percentile(values, [5, 50, 95])]
    assert row.split() == ["end", *(f"{x:.5g}" for x in [*found, values.max()])]


def test_a_share_is_shown_with_its_interval():
    low, high = stats.binomtest(3, 4).proportion_ci(0.95, "wilson")
    shown = f"3 of 4, 75.0 % (95 %: {100 * low:.1f} to {100 * high:.1f} %), 1 without a verdict"
    assert str(summary.Share(3, 4, [1], [4])) == shown
    assert str(summary.Share(0, 0, [], [0, 1])) == "0 of 0, 2 without a verdict"


def test_factors_that_vary_are_those_with_more_than_one_number():
    known = {
        "still": np.full(3, 2.0),
        "moved": np.array([2.0, 2.0, 3.0]),
        "unknown": np.full(3, np.nan),
        "partly": np.array([np.nan, 1.0, 2.0]),
        "text": np.array(["b", "a", "b"], dtype=object),
        "lopsided": np.arange(12.0).reshape(3, 2, 2),
        "wide": np.arange(18.0).reshape(3, 2, 3),
    }
    store = SimpleNamespace(names=lambda role: [*known], array=known.__getitem__)
    names = ["moved", "partly"]
    names += [f"lopsided[{i},{k}]" for i in (1, 2) for k in (1, 2)]
    names += [f"wide[{i},{k}]" for i in (1, 2) for k in (1, 2, 3)]
    assert [*summary.varying_factors(store)] == names
    assert [*summary.categories(store)] == ["text"]


def test_a_symmetric_factor_has_one_row_per_element(tmp_path):
    spread = {
        "servicer.J_S": {"inertia": {"principal": [200, 250, 150], "spread": 0.1, "axes": 0.1}}
    }
    given = {"system": "sync_approach", "fixed": {"stop": 0.2}, "runs": 3, "factors": spread}
    found = campaign(given, tmp_path / "c.zarr", workers=0)
    names = [f"servicer.J_S[{k}]" for k in ("1,1", "1,2", "1,3", "2,2", "2,3", "3,3")]
    assert [*summary.varying_factors(found.store)] == names
    assert (
        summary.factor_columns(found.store)["servicer.J_S[2,3]"]
        == found.store.array("servicer.J_S")[:, 2, 1]
    ).all()
