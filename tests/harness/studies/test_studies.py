# SPDX-License-Identifier: BSD-2-Clause
"""Adaptive studies of a system whose margins are known: what they find, that they go on where they
were interrupted, and what they reject before the first run.

twice.y = k n + d over rows n = 0..6, so the margin of `small` is 20 - 6 k - d.
"""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pytest
from scipy import stats

from harness import Evaluator, campaign, read, run, sensitivity, worst
from harness.cli import main
from harness.errors import HarnessError, InterruptionError, RunError, StructureError, UsageError
from harness.report.campaign import of_dataset
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from harness.studies.analyses import driver as driving
from harness.studies.analyses import worst as searches
from harness.studies.campaign import stopping
from harness.studies.campaign.campaign import like
from harness.studies.campaign.store import Store
from tests.harness import demo

pytestmark = pytest.mark.usefixtures("trusted")

TOML = (
    demo.TOML
    + """[requirements]
small = "twice.y <= 20"
flag = "twice.y != 5"
"""
)
K, Z = {"normal": {"mean": 2.0, "sigma": 0.5}}, 8 / 3
"""Draw of k, and where `small` begins to fail: 6 (2 + z / 2) = 20."""
P = float(stats.norm.sf(Z))


@pytest.fixture
def system(fmus, tmp_path):
    write_ssp(system_of(tomllib.loads(TOML), fmus), tmp_path / "demo.ssp")
    return tmp_path / "demo.ssp"


def table(system, **more):
    factors = {"twice.k": K, "bad.t_fail": {"uniform": {"low": 50.0, "high": 60.0}}}
    return {"system": str(system), "factors": factors, "seed": 3, **more}


def k_of(z):
    return 2 + z / 2


def test_runs_are_margins_of_numbers(system):
    z = np.array([[0.0, 0.0], [1.0, -2.0], [3.0, 1.0]])
    with Evaluator(table(system), workers=0) as evaluator:
        assert (evaluator.d, evaluator.names) == (2, ["small", "flag"])
        assert evaluator.groups == {"twice.k": [0], "bad.t_fail": [1]}
        assert evaluator(z)[:, 0] == pytest.approx(20 - 6 * k_of(z[:, 0]), abs=1e-12)
        with pytest.raises(UsageError, match=r"expected an array of shape \(rows, 2\)"):
            evaluator(np.zeros((3, 1)))


def test_a_run_that_failed_has_failed_everything(system):
    given = table(system)
    given["factors"]["bad.t_fail"] = {"uniform": {"low": 0.0, "high": 12.0}}
    with Evaluator(given, workers=0) as evaluator:
        margins = evaluator(np.array([[0.0, -1.0], [0.0, 1.0]]))
    assert (margins[0] == -np.inf).all()
    assert margins[1, 0] == pytest.approx(8)


def found_by(study):
    """Numbers, margins and status of a dataset."""
    return [study.store.array(n) for n in ("numbers", "margin", "status")]


def test_worst_finds_the_corner_and_its_run_repeats(system, tmp_path):
    study = worst(table(system, worst={"of": "small", "runs": 120}), tmp_path / "w.zarr", workers=0)
    found = study.estimate["of"]["small"]
    assert found["margin"] == pytest.approx(20 - 6 * k_of(3), abs=0.05)
    assert found["nominal"] == pytest.approx(8)
    assert not study.verdict
    numbers, margins, status = found_by(study)
    assert (len(numbers), status.min()) == (121, 1)
    assert found["run"] == 1 + np.argmin(margins[1:, 0])
    changes = like(f"{tmp_path / 'w.zarr'}#{found['run']}")[1]
    again = run(system, **changes)
    assert 20 - again["twice.y"].max() == found["margin"]
    retained = read(tmp_path / "w_worst" / "small.nc")
    assert (retained["twice.y"] == again["twice.y"]).all()
    assert f"--like {tmp_path / 'w.zarr'}#{found['run']}" in study.summary()
    assert "small: NOT MET, worst margin -0.99" in study.summary()
    assert "twice.k +3.0 sigma" in study.summary()
    page = of_dataset(tmp_path / "w.zarr")
    assert all(
        each in page for each in ("Result of the study", "worst so far", "the worst 30 runs")
    )


def test_every_requirement_has_a_results_file_of_its_own(system, tmp_path):
    """Also one called nominal, and names that differ only in characters unsafe in file names."""
    names = {
        "nominal": "twice.y <= 20",
        "a b": "twice.y <= 21",
        "a_b": "time < 5 s or twice.y >= 1",
    }
    given = table(system, requirements=names, worst={"of": list(names), "runs": 24})
    study = worst(given, tmp_path / "w.zarr", workers=0)
    files = searches.confirmed(tmp_path / "w.zarr", study.estimate["of"])
    assert list(files) == ["nominal", "worst nominal", "worst a b", "worst a_b"]
    assert {file.name for file in files.values()} == {
        "nominal.nc", "nominal_2.nc", "a_b.nc", "a_b_2.nc"}  # fmt: skip
    highest = [read(file)["twice.y"].max() for file in files.values()]
    assert highest[0] == pytest.approx(12)
    assert min(highest[1:3]) > 20
    assert highest[3] < 12


def interrupted(monkeypatch, after):
    """Ctrl-C in the runs after so many parts of generations."""
    count, simulate_case = [0], Evaluator.run

    def simulated(self, values):
        count[0] += 1
        if count[0] > after:
            raise KeyboardInterrupt
        return simulate_case(self, values)

    monkeypatch.setattr(Evaluator, "run", simulated)


def killed(monkeypatch):
    """Runs that wait for their block are lost."""
    monkeypatch.setattr(driving.Driver, "close", lambda self: self._life.close())


def test_a_resumed_study_has_the_same_bits_with_every_executor(system, tmp_path, monkeypatch):
    given = table(system, worst={"of": "small", "runs": 36})
    whole = found_by(worst(given, tmp_path / "a.zarr", workers=0))
    four = found_by(worst(given, tmp_path / "b.zarr", workers=4))
    with monkeypatch.context() as patch:
        interrupted(patch, 3)
        with pytest.raises(KeyboardInterrupt):
            worst(given, tmp_path / "c.zarr", workers=0)
    assert there(tmp_path / "c.zarr") == 25
    resumed = found_by(worst(given, tmp_path / "c.zarr", workers=0, resume=True))
    once_more = found_by(worst(given, tmp_path / "c.zarr", workers=0, resume=True))
    for others in (four, resumed, once_more):
        for ours, theirs in zip(whole, others, strict=True):
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize(("block", "retained"), [(5, 20), (12, 24), (200, 0)])
def test_a_killed_study_has_its_full_blocks_and_continues_to_the_same_bits(
    system, tmp_path, monkeypatch, block, retained
):
    given = table(system, worst={"of": "small", "runs": 36})
    whole = found_by(worst(given, tmp_path / "a.zarr", workers=0))
    monkeypatch.setattr(driving, "LARGEST_BLOCK", block)
    with monkeypatch.context() as patch:
        interrupted(patch, {5: 6, 12: 3, 200: 3}[block])
        killed(patch)
        with pytest.raises(KeyboardInterrupt):
            worst(given, tmp_path / "c.zarr", workers=0)
    assert there(tmp_path / "c.zarr") == retained
    resumed = found_by(worst(given, tmp_path / "c.zarr", workers=0, resume=True))
    for ours, theirs in zip(whole, resumed, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_a_study_that_has_lost_a_run_repeats_it_and_all_later_ones(system, tmp_path):
    given = table(system, worst={"of": "small", "runs": 36})
    store = worst(given, tmp_path / "a.zarr", workers=0).store
    whole = [store.array(n) for n in ("numbers", "margin", "status")]
    store.group["status"][17] = 0
    store.group["margin"][17:] = 0.0
    resumed = found_by(worst(given, tmp_path / "a.zarr", workers=0, resume=True))
    for ours, theirs in zip(whole, resumed, strict=False):
        np.testing.assert_array_equal(ours, theirs)


def there(path):
    """Runs that a dataset has."""
    return int((Store.open(path).array("status") != 0).sum())


def test_runs_requested_by_another_version_are_rejected(system, tmp_path):
    given = table(system, worst={"of": "small", "runs": 60})
    study = worst(given, tmp_path / "a.zarr", workers=0)
    study.store.group["numbers"][20, 0] = 7.0
    with pytest.raises(
        UsageError, match="draws run 20 with other values, as after a change of a package"
    ):
        worst(given, tmp_path / "a.zarr", workers=0, resume=True)


def test_a_requirement_that_holds_at_its_limit_does_not_fail(system):
    """At its start the system has y = 0 in every run, and both limits are 0."""
    given = table(system, requirements={"closed": "twice.y >= 0", "open": "twice.y > 0"})
    with Evaluator(given, workers=0) as evaluator:
        ((_, _, holds, fails),) = evaluator(np.zeros((1, 2)))
    assert fails < 0 <= holds


# ---- runs that are no evidence


def margins_become(monkeypatch, change):
    """Change the margin of `small` of every run by its k."""
    original = Evaluator.run

    def changed(self, values):
        rows, k = original(self, values), [each.get("twice.k", 2.0) for each in values]
        return [
            row._replace(margins=(change(each, row.margins[0]), *row.margins[1:]))
            for row, each in zip(rows, k, strict=True)
        ]

    monkeypatch.setattr(Evaluator, "run", changed)


@pytest.mark.parametrize("nothing", [np.nan, np.inf])
def test_runs_without_a_margin_are_counted_and_nothing_is_met(
    nothing, system, tmp_path, monkeypatch
):
    """Beyond k = 2.5, a third of the way to failing, no run has a margin."""
    margins_become(monkeypatch, lambda k, margin: nothing if k > 2.5 else margin)
    entries = {
        "worst": {"of": "small", "runs": 24},
        "sensitivity": {"of": "small", "runs": 30},
    }
    studies = {"sensitivity": sensitivity, "worst": worst}
    for kind, study in studies.items():
        given = table(system, **{kind: entries[kind]})
        found = study(given, tmp_path / f"{kind}.zarr", workers=0)
        _, margins, _ = found_by(found)
        count = int((~np.isfinite(margins[:, 0])).sum())
        assert count > 0
        assert f"small: {count} of {len(margins)} runs are no evidence" in found.summary()
        assert found.verdict is (kind != "worst")
        assert "exactly not" not in found.summary()
        if kind == "worst":
            assert "no failure in 24 runs" in found.summary()
            assert "random ones would say" not in found.summary()
            again = study(given, found.path, workers=0, resume=True)
            assert again.estimate == found.estimate


def test_an_effect_of_margins_without_any_number_is_none(system, tmp_path, monkeypatch):
    margins_become(monkeypatch, lambda k, margin: margin if k == 2.0 else np.nan)
    with pytest.raises(UsageError, match="small: no run of 30 has a finite margin"):
        sensitivity(
            table(system, sensitivity={"of": "small", "runs": 30}),
            tmp_path / "s.zarr",
            workers=0,
        )


def test_effects_beside_runs_that_failed_are_not_exact(system, tmp_path):
    """A factor may act in the runs that failed: 0 is its effect in the others."""
    given = table(system, sensitivity={"of": "small", "runs": 30})
    given["factors"]["bad.t_fail"] = {"uniform": {"low": 0.0, "high": 12.0}}
    summary = sensitivity(given, tmp_path / "s.zarr", workers=0).summary()
    assert "runs have no finite margin and count with the smallest finite margin" in summary
    assert "exactly not" not in summary


@pytest.mark.parametrize("where", ["other seeds", "own step"])
def test_a_failure_beside_the_worst_run_of_a_search_is_one(where, system, tmp_path, monkeypatch):
    """The search meets no failure; a further seed or the macro step of the system does."""
    given = table(system, worst={"of": "small", "runs": 24}, seeds=["count.n_0"])
    given["factors"]["twice.k"] = {"normal": {"mean": 1.0, "sigma": 0.1}}
    runs = []

    def change(_, margin):
        runs.append(margin)
        return -1.0 if where == "other seeds" and len(runs) == 1 + 24 + 3 else 5.0

    margins_become(monkeypatch, change)
    own = -0.5 if where == "own step" else 5.0
    monkeypatch.setattr(searches, "margin", lambda result, text: own)
    study = worst(given, tmp_path / "w.zarr", workers=0)
    assert not study.verdict
    assert "no failure in 24 runs" in study.summary()
    text = {"other seeds": "with 10 other seeds: margin >= -1", "own step": "margin is -0.5"}
    assert text[where] in study.summary()


@pytest.fixture
def failing(system, tmp_path, monkeypatch):
    """Search whose worst run ends with an error at the step of the system."""

    def search(error):
        class Fails(searches.ReusedSimulation):
            def run(self, *_):
                raise error

        monkeypatch.setattr(searches, "ReusedSimulation", Fails)
        given = table(system, worst={"of": "small", "runs": 24})
        given["factors"]["twice.k"] = {"normal": {"mean": 1.0, "sigma": 0.1}}
        return worst(given, tmp_path / "w.zarr", workers=0)

    return search


@pytest.mark.parametrize("error", [RunError("bad", 0.0, "no step"), UsageError("must be > 0")])
def test_a_worst_run_that_leaves_nothing_with_the_step_of_the_system_fails(
    failing, tmp_path, error
):
    study = failing(error)
    assert not study.verdict
    assert "NOT MET with the system's own macro step the margin is -inf" in study.summary()
    assert not list((tmp_path / "w_worst").iterdir())


def test_ctrl_c_ends_the_search_in_its_worst_run_too(failing):
    with pytest.raises(KeyboardInterrupt):
        failing(InterruptionError("system", 0.0))


def test_a_search_in_which_all_margins_are_infinite_ends_without_a_warning(
    system, tmp_path, monkeypatch
):
    margins_become(monkeypatch, lambda *_: np.inf)
    study = worst(table(system, worst={"of": "small", "runs": 24}), tmp_path / "w.zarr", workers=0)
    assert not study.verdict


def test_a_run_that_fails_only_with_the_step_of_the_search_is_named(system, tmp_path, monkeypatch):
    margins_become(monkeypatch, lambda k, margin: -np.inf if k > 2.5 else margin)
    monkeypatch.setattr(searches, "margin", lambda result, text: 3.0)
    study = worst(table(system, worst={"of": "small", "runs": 24}), tmp_path / "w.zarr", workers=0)
    assert "worst margin -inf (the run failed, or a value is not a number)" in study.summary()
    assert "with the system's own macro step the margin is +3" in study.summary()


def test_sensitivity_finds_slopes_and_exact_zeros(system, tmp_path):
    """Over u = Phi(z) k is no straight line: the effect is the effect over the four levels."""
    for method, runs in (("morris", 30), ("sobol", 100)):
        entry = {"of": "small", "method": method, "runs": runs}
        path = tmp_path / f"{method}.zarr"
        study = sensitivity(
            table(system, sensitivity=entry), path, workers=0, notify=lambda _: None
        )
        value = study.estimate["of"]["small"]["value"]
        assert value[1] == 0
        step = 3 * np.diff(stats.norm.ppf([0.125, 0.625])).item() / 0.5
        assert value[0] == pytest.approx(step if method == "morris" else 1, rel=0.1)
        assert "without any effect: bad.t_fail" in study.summary()
        assert "small: importance, with 95 % intervals" in of_dataset(path)


REJECTED = {
    "no such requirement": (worst, {"worst": {"of": "smalls"}}, "close: small"),
    "flag has no slope": (worst, {"worst": {"of": "flag"}}, "change gradually"),
    "one generation": (worst, {"worst": {"of": "small", "runs": 11}}, "at least 12 "),
    "box": (worst, {"worst": {"box": -1.0}}, "worst.box: must be a finite number above 0"),
    "entry": (worst, {"worst": {"run": 9}}, "close: runs"),
    "method": (sensitivity, {"sensitivity": {"method": "sobols"}}, "must be morris or sobol"),
    "paths": (sensitivity, {"sensitivity": {"runs": 3}}, "at least 6 "),
    "a list": (worst, {"factors": {"twice.k": {"list": [1, 2]}}}, "cannot vary a list or range"),
    "a range": (
        sensitivity,
        {"factors": {"twice.k": {"range": {"first": 1.0, "last": 2.0, "count": 3}}}},
        "cannot vary a list or range",
    ),
    "no draw": (worst, {"factors": {}}, "no random factor is defined"),
    "no box": (
        worst,
        {"worst": {"of": "small", "box": 0.0}},
        "worst.box: must be a finite number above",
    ),
    "no run": (sensitivity, {"sensitivity": {"of": "small", "runs": 0}}, "at least 1,"),
    "no such study": (worst, {"worsd": {"of": "small"}}, "close: worst"),
    "no table": (worst, {"worst": "small"}, "must be a table"),
}


@pytest.mark.parametrize("name", REJECTED)
def test_wrong_use_is_rejected(name, system, tmp_path):
    study, more, problem = REJECTED[name]
    with pytest.raises((UsageError, StructureError), match=problem):
        study(table(system) | more, tmp_path / "x.zarr", workers=0)
    assert not (tmp_path / "x.zarr").exists()


def test_a_factor_that_is_not_there_is_reported_with_the_file(system, tmp_path):
    text = f"""
        system = "{system}"
        [factors]
        "twice.kk" = {{normal = {{mean = 2.0, sigma = 0.5}}}}
    """
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(StructureError, match=r"^mine.toml: factors.twice.kk: .*close: k"):
        worst(tmp_path / "mine.toml", tmp_path / "x.zarr", workers=0)


def test_a_system_without_requirements_and_a_campaign_without_any_are_rejected(fmus, tmp_path):
    write_ssp(system_of(tomllib.loads(demo.TOML), fmus), tmp_path / "bare.ssp")
    with pytest.raises(
        UsageError, match=r"the system has no requirement; define one in \[requirements\]"
    ):
        worst(table(tmp_path / "bare.ssp"), tmp_path / "x.zarr", workers=0)


def test_a_flag_is_allowed_where_no_slope_is_needed(system, tmp_path):
    given = table(system, sensitivity={"of": "flag", "runs": 6})
    study = sensitivity(given, tmp_path / "s.zarr", workers=0)
    assert [*study.estimate["of"]] == ["flag"]


def test_without_cma_a_search_states_how_to_get_it(system, tmp_path, monkeypatch):
    monkeypatch.setattr("harness.errors.find_spec", lambda name: None)
    with pytest.raises(HarnessError, match=r"pip install 'servicing-fmus\[verify\]'"):
        worst(table(system, worst={"of": "small"}), tmp_path / "x.zarr", workers=0)


def test_runs_of_sobol_are_rounded_to_a_power_of_two_and_this_is_reported(system, tmp_path):
    reported = []
    given = table(system, sensitivity={"of": "small", "method": "sobol", "runs": 20})
    study = sensitivity(given, tmp_path / "s.zarr", workers=0, notify=reported.append)
    assert reported == ["sobol: 8 points x 4 = 32 runs"]
    assert study.store.runs == 1 + 32


def test_a_nominal_run_that_fails_is_reported_first_and_sensitivity_continues(system, tmp_path):
    reported = []
    given = table(system, sensitivity={"of": "small", "runs": 6})
    given["factors"] = {"twice.k": {"normal": {"mean": 4.0, "sigma": 0.5}}}
    study = sensitivity(given, tmp_path / "s.zarr", workers=0, notify=reported.append)
    assert reported[0] == "small: the nominal run fails, with a margin of -4"
    assert study.estimate["of"]["small"]["value"][0] > 1


def test_all_runs_of_a_generation_that_fail_end_the_study(system, tmp_path):
    given = table(system, worst={"of": "small", "runs": 60}, fixed={"set": {"bad.t_fail": 3.0}})
    given["factors"] = {"twice.k": K}
    with pytest.raises(
        UsageError, match=r"all 12 runs of a generation failed; first message: .*bad"
    ):
        worst(given, tmp_path / "x.zarr", workers=0)


def test_another_study_is_not_gone_on_with(system, tmp_path):
    given = table(system, worst={"of": "small", "runs": 24}, sensitivity={"runs": 24})
    worst(given, tmp_path / "a.zarr", workers=0)
    with pytest.raises(UsageError, match="it is not the dataset of a sensitivity"):
        sensitivity(given, tmp_path / "a.zarr", workers=0, resume=True)
    with pytest.raises(UsageError, match="already exists"):
        worst(given, tmp_path / "a.zarr", workers=0)


def test_seeds_of_sensors_are_drawn_again_for_the_worst_run(system, tmp_path):
    given = table(system, worst={"of": "small", "runs": 24}, seeds=["count.n_0"])
    with Evaluator({**given, "seeds": []}, workers=0):
        pass
    study = worst(given, tmp_path / "a.zarr", workers=0)
    assert len(study.estimate["of"]["small"]["other seeds"]) == 10
    assert len(found_by(study)[0]) == 1 + 24 + 10


def test_the_command_states_what_it_found_and_ends_with_status_1(system, tmp_path, capsys):
    text = f"""
        system = "{system}"
        [factors]
        "twice.k" = {{normal = {{mean = 2.0, sigma = 0.5}}}}
        [requirements]
        positive = "twice.y >= -9"
        [worst]
        of = "small"
        runs = 60
    """
    (tmp_path / "my.toml").write_text(text)
    out = str(tmp_path / "o.zarr")
    assert main(["worst", str(tmp_path / "my.toml"), "-o", out, "--workers", "0"]) == 1
    assert "small: NOT MET" in capsys.readouterr().out
    safe = text.replace('of = "small"', 'of = "positive"').replace("= 60", "= 24")
    (tmp_path / "my.toml").write_text(safe)
    out = str(tmp_path / "p.zarr")
    assert main(["worst", str(tmp_path / "my.toml"), "-o", out, "--workers", "0"]) == 0
    reported = capsys.readouterr().out
    assert "no failure in 24 runs" in reported
    assert "a search cannot prove that no run fails; 24 random runs without" in reported
    assert "would prove a failure probability below 1" in reported


def test_study_runs_every_study_that_a_file_of_the_project_describes(
    system, tmp_path, monkeypatch, capsys
):
    text = f"""
        system = "{system}"
        runs = 3
        [factors]
        "twice.k" = {{normal = {{mean = 2.0, sigma = 0.5}}}}
        [requirements]
        positive = "twice.y >= -9"
        [worst]
        of = "positive"
        runs = 24
        [sensitivity]
        of = "small"
        runs = 6
    """
    (tmp_path / "my.toml").write_text(text)
    monkeypatch.setattr("harness.mission.library.campaigns", lambda: {"my": tmp_path / "my.toml"})
    monkeypatch.chdir(tmp_path)
    study = ["study", "my", "--workers", "0"]
    assert main(study) == 0
    reported = capsys.readouterr().out
    assert reported.index("small: share of the mean effects") < reported.index(
        "no failure in 24 runs"
    )
    names = {path.name for path in (tmp_path / "results").glob("*.zarr")}
    assert names == {"my_sensitivity.zarr", "my_worst.zarr"}
    assert main(["campaign", "my", "--workers", "0", "-o", "plain.zarr"]) == 0
    assert "3 runs" in capsys.readouterr().out
    assert main(["worst", "my", "--workers", "0", "-o", "worst.zarr"]) == 0
    assert "no failure in 24 runs" in capsys.readouterr().out
    assert main([*study, "-o", "both.zarr"]) == 2
    assert "the file defines 2 studies; run one: harness sensitivity my" in capsys.readouterr().err


# ---- plain campaigns


def test_campaigns_retain_margins_with_their_units(system, tmp_path):
    given = table(system, runs=5, requirements={"own": "time < 3 s or twice.y >= 1"})
    store = campaign(given, tmp_path / "c.zarr", workers=0).store
    k = store.array("twice.k")
    assert store.array("requirement").tolist() == ["small", "flag", "own"]
    required = np.stack([20 - 6 * k, 3 * k - 1], axis=1)
    assert store.array("margin")[:, [0, 2]] == pytest.approx(required)
    assert json.loads(store.group.attrs["definition"])["requirements"] == given["requirements"]


@pytest.mark.parametrize("limit", [20, 17])
def test_a_campaign_ends_when_it_is_decided(system, tmp_path, limit):
    given = table(system, until={"success": 0.9, "confidence": 0.9}, success=f"twice.y <= {limit}")
    if limit == 20:
        del given["success"]  # that is what the requirements of the system demand
    found = campaign(given, tmp_path / "c.zarr", workers=0)
    log = np.log([0.2, (1 - 0.02) / (1 - 0.1)])
    failed = np.cumsum(found.store.array("success") != 1)
    ratio = failed * log[0] + (np.arange(1, len(failed) + 1) - failed) * log[1]
    assert (failed[-1] > 0) == (limit < 20)
    assert ratio[-1] >= np.log(10)
    assert (ratio[:-1] < np.log(10)).all()
    assert "success above 90 % at 90 % confidence: shown by" in found.summary()
    again = campaign(given, tmp_path / "c.zarr", workers=0, resume=True)
    assert again.store.runs == len(failed)


def test_a_campaign_of_as_many_runs_as_wilks_demands(system, tmp_path):
    until = {"success": 0.9, "confidence": 0.9, "fixed": True}
    found = campaign(table(system, until=until, success="twice.y <= 99"), tmp_path / "c", workers=0)
    assert found.store.runs == 22
    assert "shown by 22 runs, 0 failed (Wilks: 22 runs without a failure)" in found.summary()


ENDS = (stopping.LEAST, 0.5, 1 - 2**-53)


@pytest.mark.parametrize("success", ENDS)
@pytest.mark.parametrize("confidence", ENDS)
@pytest.mark.parametrize("fixed", [True, False])
def test_every_rule_that_is_accepted_gives_a_number_of_runs_and_a_verdict(
    success, confidence, fixed
):
    rule = stopping.Until(success, confidence, fixed)
    assert rule.runs >= 1
    for failed in ([], [True], [False], [True, False] * 3):
        assert rule.decided(failed) in (None, *range(1, len(failed) + 1))
        assert rule.verdict(sum(failed), len(failed)).startswith("success above ")


@pytest.mark.parametrize(
    ("more", "problem"),
    [
        ({"until": {"success": 2}}, "until.success: must be a number between 0 and 1"),
        *(
            ({"until": {"success": x}}, "until.success: must be a number between 0 and 1, at least")
            for x in (0.0, 5e-324, 1e-300, 1e-17, 1.0)
        ),
        ({"until": {"success": 0.9, "confidence": 1e-300}}, "until.confidence: must be a number"),
        ({"until": {"success": 1 - 2**-53}}, "runs are defined, more than the limit of 10000000"),
        ({"until": {"succeed": 0.9}}, "until.success: is missing"),
        (
            {"until": {"success": 0.9}, "runs": 5},
            "until: cannot be combined with `runs`",
        ),
        (
            {"until": {"success": 0.9}, "factors": {"twice.k": {"list": [1.0]}}},
            "until: cannot be combined with",
        ),
        ({"requirements": {"own": "twice.z > 1"}}, r"requirements: own: .* \(close: twice.y"),
        ({"requirements": {"own": "twice.y"}}, "is not a condition"),
    ],
)
def test_wrong_entries_of_a_campaign_are_rejected(more, problem, system, tmp_path):
    with pytest.raises(StructureError, match=problem):
        campaign(table(system) | more, tmp_path / "x.zarr", workers=0)
