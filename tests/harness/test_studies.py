# SPDX-License-Identifier: BSD-2-Clause
"""Studies that ask on, over a system whose margins are known: what they find, that they go on where
they were interrupted, and what they refuse before the first flight.

twice.y = k n + d over rows n = 0..6, so the margin of `small` is 20 - 6 k - d.
"""

from __future__ import annotations

import json
import tomllib

import numpy as np
import pytest
from scipy import stats

from harness import Flights, boundary, campaign, probability, read, run, sensitivity, tune, worst
from harness.cli import main
from harness.errors import StructureError, UsageError
from harness.report.campaign import of_dataset
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from harness.studies.campaign.campaign import like
from harness.studies.campaign.store import Store
from harness.studies.inquiry import driver as driving
from harness.studies.inquiry import worst as searches
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


def test_flights_are_margins_of_numbers(system):
    z = np.array([[0.0, 0.0], [1.0, -2.0], [3.0, 1.0]])
    with Flights(table(system), workers=0) as flights:
        assert (flights.d, flights.names) == (2, ["small", "flag"])
        assert flights.groups == {"twice.k": [0], "bad.t_fail": [1]}
        assert flights(z)[:, 0] == pytest.approx(20 - 6 * k_of(z[:, 0]), abs=1e-12)
        with pytest.raises(UsageError, match=r"expected numbers \(rows, 2\)"):
            flights(np.zeros((3, 1)))


def test_a_flight_that_died_has_failed_everything(system):
    given = table(system)
    given["factors"]["bad.t_fail"] = {"uniform": {"low": 0.0, "high": 12.0}}
    with Flights(given, workers=0) as flights:
        margins = flights(np.array([[0.0, -1.0], [0.0, 1.0]]))
    assert (margins[0] == -np.inf).all()
    assert margins[1, 0] == pytest.approx(8)


def found_by(study):
    """Numbers, margins and status of a dataset."""
    return [study.store.array(n) for n in ("numbers", "margin", "status", "generation")]


def test_worst_finds_the_corner_and_its_flight_repeats(system, tmp_path):
    study = worst(
        table(system, worst={"of": "small", "flights": 120}), tmp_path / "w.zarr", workers=0
    )
    found = study.estimate["of"]["small"]
    assert found["margin"] == pytest.approx(20 - 6 * k_of(3), abs=0.05)
    assert found["nominal"] == pytest.approx(8)
    assert not study.verdict
    numbers, margins, status, _ = found_by(study)
    assert (len(numbers), status.min()) == (121, 1)
    assert found["run"] == 1 + np.argmin(margins[1:, 0])
    changes = like(f"{tmp_path / 'w.zarr'}#{found['run']}")[1]
    again = run(system, **changes)
    assert 20 - again["twice.y"].max() == found["margin"]
    kept = read(tmp_path / "w_worst" / "small.nc")
    assert (kept["twice.y"] == again["twice.y"]).all()
    assert f"--like {tmp_path / 'w.zarr'}#{found['run']}" in study.summary()
    assert "small: NOT MET, worst margin -0.99" in study.summary()
    assert "twice.k +3.0 sigma" in study.summary()
    page = of_dataset(tmp_path / "w.zarr")
    assert all(each in page for each in ("What was found", "worst so far", "the worst 30 flights"))


def interrupted(monkeypatch, after):
    """Ctrl-C in the flights after so many parts of generations."""
    count, fly = [0], Flights.fly

    def flown(self, values):
        count[0] += 1
        if count[0] > after:
            raise KeyboardInterrupt
        return fly(self, values)

    monkeypatch.setattr(Flights, "fly", flown)


def killed(monkeypatch):
    """What waits for its block is lost."""
    monkeypatch.setattr(driving.Driver, "close", lambda self: self._life.close())


def test_a_study_goes_on_to_the_same_bits_whoever_flies(system, tmp_path, monkeypatch):
    given = table(system, worst={"of": "small", "flights": 36})
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


@pytest.mark.parametrize(("block", "kept"), [(5, 20), (12, 24), (200, 0)])
def test_a_killed_study_has_its_full_blocks_and_goes_on_to_the_same_bits(
    system, tmp_path, monkeypatch, block, kept
):
    given = table(system, worst={"of": "small", "flights": 36})
    whole = found_by(worst(given, tmp_path / "a.zarr", workers=0))
    monkeypatch.setattr(driving, "LARGEST_BLOCK", block)
    with monkeypatch.context() as patch:
        interrupted(patch, {5: 6, 12: 3, 200: 3}[block])
        killed(patch)
        with pytest.raises(KeyboardInterrupt):
            worst(given, tmp_path / "c.zarr", workers=0)
    assert there(tmp_path / "c.zarr") == kept
    resumed = found_by(worst(given, tmp_path / "c.zarr", workers=0, resume=True))
    for ours, theirs in zip(whole, resumed, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def there(path):
    """Flights that a dataset has."""
    return int((Store.open(path).array("status") != 0).sum())


def test_flights_asked_by_another_version_are_refused(system, tmp_path):
    given = table(system, worst={"of": "small", "flights": 60})
    study = worst(given, tmp_path / "a.zarr", workers=0)
    study.store.group["numbers"][20, 0] = 7.0
    with pytest.raises(UsageError, match="run 20 was asked by other versions"):
        worst(given, tmp_path / "a.zarr", workers=0, resume=True)


LONG = pytest.mark.long


@pytest.mark.parametrize(
    ("method", "flights", "low", "high"),
    [
        ("random", 80, 0.0, 4.0),
        pytest.param("random", 400, 0.0, 4.0, marks=LONG),
        pytest.param("subset", 1400, 0.4, 2.5, marks=LONG),
        pytest.param("importance", 4000, 0.6, 1.6, marks=LONG),
    ],
)
def test_probability_by_three_methods(method, flights, low, high, system, tmp_path):
    below = 0.05 if flights >= 400 else 0.1
    entry = {"of": "small", "method": method, "flights": flights, "below": below}
    study = probability(table(system, probability=entry), tmp_path / "p.zarr", workers=0)
    found = study.estimate["of"]["small"]
    assert low <= found["p"] / P < high
    assert found["low"] < P < found["high"]
    assert len(found_by(study)[0]) <= flights + 1
    assert study.verdict is (found["verdict"] == "met") is True
    assert f"by {method}" in study.summary()
    drawn = "probability of less than a margin" in of_dataset(tmp_path / "p.zarr")
    assert drawn is (method != "random")


@LONG
def test_centres_may_come_from_another_study(system, tmp_path):
    entry = {"of": "small", "flights": 3000}
    probability(table(system, probability=entry), tmp_path / "s.zarr", workers=0)
    entry = {"method": "importance", "flights": 400, "centres": str(tmp_path / "s.zarr")}
    study = probability(table(system, probability=entry), tmp_path / "i.zarr", workers=0)
    found = study.estimate["of"]["small"]
    assert found["low"] < P < found["high"]
    assert found["cov"] < 0.2


def test_sensitivity_measures_slopes_and_exact_zeros(system, tmp_path):
    """Over u = Phi(z) k is no straight line: the effect is that of the four levels."""
    for method, flights in (("morris", 30), ("sobol", 100)):
        entry = {"of": "small", "method": method, "flights": flights}
        path = tmp_path / f"{method}.zarr"
        study = sensitivity(table(system, sensitivity=entry), path, workers=0, said=lambda _: None)
        value = study.estimate["of"]["small"]["value"]
        assert value[1] == 0
        step = 3 * np.diff(stats.norm.ppf([0.125, 0.625])).item() / 0.5
        assert value[0] == pytest.approx(step if method == "morris" else 1, rel=0.1)
        assert "exactly not: bad.t_fail" in study.summary()
        assert "small: what matters" in of_dataset(path)


def test_a_campaign_that_has_flown_says_what_mattered(system, tmp_path):
    campaign(table(system, runs=60), tmp_path / "c.zarr", workers=0)
    study = sensitivity(tmp_path / "c.zarr")
    found = dict(zip(study.estimate["factors"], study.estimate["of"]["small"]["p"], strict=True))
    assert found["twice.k"] < 0.01 < found["bad.t_fail"]
    assert "twice.k" in study.summary()


def test_a_map_follows_the_boundary(system, tmp_path):
    given = table(system, map={"of": "small", "flights": 60})
    given["factors"]["twice.k"] = {"uniform": {"low": 0.0, "high": 10.0}}
    study = boundary(given, tmp_path / "m.zarr", workers=0)
    k, margin = study.store.array("twice.k"), study.store.array("margin")[:, 0]
    assert margin == pytest.approx(20 - 6 * k)
    assert k[margin < 0].min() - k[margin >= 0].max() < 0.5
    assert "fails with twice.k from 3." in study.summary()


@LONG
def test_gains_are_tuned_against_draws_and_an_archive(system, tmp_path):
    """`small` wants a small k, `large` a large one: the margins meet at k = 2.5."""
    given = table(system)
    gain = {"twice.k": {"log_normal": {"median": 1.0, "sigma": 0.5}}}
    given["factors"] = {"bad.t_fail": given["factors"]["bad.t_fail"]}
    given["requirements"] = {"large": "time < 6 s or twice.y >= 10"}
    archived = {**given, "worst": {"of": "small", "flights": 24}}
    worst(archived, tmp_path / "w.zarr", workers=0)
    entry = {"gains": gain, "of": ["small", "large"], "draws": 3, "flights": 450}
    entry["archive"] = str(tmp_path / "w.zarr")
    study = tune({**given, "tune": entry}, tmp_path / "t.zarr", workers=0)
    found = study.estimate["of"]["small, large"]
    scale = np.abs([20 - 6, 6 - 10])
    k = found["gains"]["twice.k"]
    # the best is 5 / 9, where both are equal
    assert 0.45 < min((20 - 6 * k) / scale[0], (6 * k - 10) / scale[1]) <= 5 / 9
    assert found["start_unseen"] == pytest.approx([14, -4])
    assert found["best_unseen"] == pytest.approx([20 - 6 * k, 6 * k - 10])
    assert "--set 'twice.k=" in study.summary()


REFUSED = {
    "no such requirement": (worst, {"worst": {"of": "smalls"}}, "close: small"),
    "flag has no slope": (worst, {"worst": {"of": "flag"}}, "without a slope"),
    "flag has no levels": (probability, {"probability": {"of": "flag"}}, "without a slope"),
    "one generation": (worst, {"worst": {"of": "small", "flights": 11}}, "at least 12,"),
    "box": (worst, {"worst": {"box": -1.0}}, "worst.box: must be a finite number above 0"),
    "entry": (worst, {"worst": {"flight": 9}}, "close: flights"),
    "method": (
        probability,
        {"probability": {"method": "subsets"}},
        "must be subset, random or importance",
    ),
    "levels": (probability, {"probability": {"of": "small", "flights": 900}}, "at least 1400,"),
    "paths": (sensitivity, {"sensitivity": {"flights": 3}}, "at least 6,"),
    "gains": (tune, {"tune": {"of": "small"}}, "a draw per gain"),
    "two factors": (boundary, {"map": {"of": "small", "factors": ["twice.k"]}}, "expected two"),
    "a list": (worst, {"factors": {"twice.k": {"list": [1, 2]}}}, "listed values"),
    "a range": (
        probability,
        {"factors": {"twice.k": {"range": {"first": 1.0, "last": 2.0, "count": 3}}}},
        "listed values",
    ),
    "no draw": (worst, {"factors": {}}, "nothing is drawn"),
    "no box": (
        worst,
        {"worst": {"of": "small", "box": 0.0}},
        "worst.box: must be a finite number above",
    ),
    "certain": (probability, {"probability": {"of": "small", "below": 1.0}}, "must be a probabil"),
    "no repeat": (probability, {"probability": {"of": "small", "flights": 0}}, "at least 1,"),
    "small map": (
        boundary,
        {"map": {"of": "small", "factors": ["twice.k", "bad.t_fail"], "flights": 24}},
        "at least 25,",
    ),
    "no table": (worst, {"worst": "small"}, "must be a table"),
    "nominal": (
        probability,
        {
            "fixed": {"set": {"twice.k": 9}},
            "factors": {"count.n_0": K},
            "probability": {"of": "small"},
        },
        "the nominal flight fails",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_wrong_use_is_refused(name, system, tmp_path):
    study, more, problem = REFUSED[name]
    with pytest.raises((UsageError, StructureError), match=problem):
        study(table(system) | more, tmp_path / "x.zarr", workers=0)
    assert name == "nominal" or not (tmp_path / "x.zarr").exists()


def test_a_gain_that_is_not_there_is_told_with_the_file(system, tmp_path):
    text = f"""
        system = "{system}"
        [factors]
        "twice.k" = {{normal = {{mean = 2.0, sigma = 0.5}}}}
        [tune.gains]
        "twice.kk" = {{log_normal = {{median = 1.0, sigma = 0.5}}}}
    """
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(StructureError, match=r"^mine.toml: factors.twice.kk: .*close: k"):
        tune(tmp_path / "mine.toml", tmp_path / "x.zarr", workers=0)


def test_a_system_without_requirements_and_a_campaign_without_any_are_refused(fmus, tmp_path):
    write_ssp(system_of(tomllib.loads(demo.TOML), fmus), tmp_path / "bare.ssp")
    with pytest.raises(
        UsageError, match=r"no requirement to ask about: \[requirements\] makes one"
    ):
        worst(table(tmp_path / "bare.ssp"), tmp_path / "x.zarr", workers=0)


def test_without_a_name_the_first_requirement_is_asked_about(system, tmp_path):
    given = table(system, probability={"method": "random", "flights": 5})
    assert [*probability(given, tmp_path / "p.zarr", workers=0).estimate["of"]] == ["small"]


def test_a_flag_is_allowed_where_no_slope_is_needed(system, tmp_path):
    """No draw makes twice.y exactly 5."""
    given = table(system, probability={"of": "flag", "method": "random", "flights": 30})
    found = probability(given, tmp_path / "p.zarr", workers=0).estimate["of"]["flag"]
    assert (found["p"], found["flights"]) == (0, 30)


def test_without_cma_a_search_says_how_to_get_it(system, tmp_path, monkeypatch):
    monkeypatch.setattr(searches, "find_spec", lambda name: None)
    entry = {"gains": {"twice.k": K}, "of": "small"}
    for study, given in ((worst, {"worst": {"of": "small"}}), (tune, {"tune": entry})):
        with pytest.raises(UsageError, match=r"pip install 'servicing-fmus\[verify\]'"):
            study(table(system) | given, tmp_path / "x.zarr", workers=0)


def test_flights_of_sobol_are_rounded_to_a_power_of_two_and_this_is_said(system, tmp_path):
    said = []
    given = table(system, sensitivity={"of": "small", "method": "sobol", "flights": 20})
    study = sensitivity(given, tmp_path / "s.zarr", workers=0, said=said.append)
    assert said == ["sobol: 8 x 4 = 32 flights"]
    assert study.store.runs == 1 + 32


def test_a_nominal_flight_that_fails_is_said_first_and_sensitivity_goes_on(system, tmp_path):
    said = []
    given = table(system, sensitivity={"of": "small", "flights": 6})
    given["factors"] = {"twice.k": {"normal": {"mean": 4.0, "sigma": 0.5}}}
    study = sensitivity(given, tmp_path / "s.zarr", workers=0, said=said.append)
    assert said[0] == "small: the nominal flight fails, with a margin of -4"
    assert study.estimate["of"]["small"]["value"][0] > 1


def test_all_flights_of_a_generation_that_die_end_the_study(system, tmp_path):
    given = table(system, worst={"of": "small", "flights": 60}, fixed={"set": {"bad.t_fail": 3.0}})
    given["factors"] = {"twice.k": K}
    with pytest.raises(
        UsageError, match=r"all 12 flights of a generation died; the first one: .*bad"
    ):
        worst(given, tmp_path / "x.zarr", workers=0)


def test_another_study_is_not_gone_on_with(system, tmp_path):
    given = table(system, worst={"of": "small", "flights": 24}, sensitivity={"flights": 24})
    worst(given, tmp_path / "a.zarr", workers=0)
    with pytest.raises(UsageError, match="is no sensitivity of this file"):
        sensitivity(given, tmp_path / "a.zarr", workers=0, resume=True)
    with pytest.raises(UsageError, match="already exists"):
        worst(given, tmp_path / "a.zarr", workers=0)


def test_seeds_of_sensors_are_drawn_again_for_the_worst_flight(system, tmp_path):
    given = table(system, worst={"of": "small", "flights": 24}, seeds=["count.n_0"])
    with Flights({**given, "seeds": []}, workers=0):
        pass
    study = worst(given, tmp_path / "a.zarr", workers=0)
    assert len(study.estimate["of"]["small"]["other seeds"]) == 10
    assert len(found_by(study)[0]) == 1 + 24 + 10


def test_the_command_says_what_it_found_and_ends_with_status_1(system, tmp_path, capsys):
    text = f"""
        system = "{system}"
        [factors]
        "twice.k" = {{normal = {{mean = 2.0, sigma = 0.5}}}}
        [requirements]
        positive = "twice.y >= -9"
        [worst]
        of = "small"
        flights = 60
    """
    (tmp_path / "my.toml").write_text(text)
    out = str(tmp_path / "o.zarr")
    assert main(["worst", str(tmp_path / "my.toml"), "-o", out, "--workers", "0"]) == 1
    assert "small: NOT MET" in capsys.readouterr().out
    safe = text.replace('of = "small"', 'of = "positive"').replace("= 60", "= 24")
    (tmp_path / "my.toml").write_text(safe)
    out = str(tmp_path / "p.zarr")
    assert main(["worst", str(tmp_path / "my.toml"), "-o", out, "--workers", "0"]) == 0
    said = capsys.readouterr().out
    assert "no failure in 24 flights" in said
    assert "this is no proof; 0 of 24 random ones would say p < 1" in said


def test_a_file_of_the_project_is_asked_all_that_it_describes(
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
        flights = 24
        [sensitivity]
        of = "small"
        flights = 6
    """
    (tmp_path / "my.toml").write_text(text)
    monkeypatch.setattr("harness.mission.library.campaigns", lambda: {"my": tmp_path / "my.toml"})
    monkeypatch.chdir(tmp_path)
    study = ["study", "my", "--workers", "0"]
    assert main(study) == 0
    said = capsys.readouterr().out
    assert said.index("small: share of the mean effects") < said.index("no failure in 24 flights")
    names = {path.name for path in (tmp_path / "results").glob("*.zarr")}
    assert names == {"my_sensitivity.zarr", "my_worst.zarr"}
    assert main(["campaign", "my", "--workers", "0", "-o", "plain.zarr"]) == 0
    assert "3 runs" in capsys.readouterr().out
    assert main(["worst", "my", "--workers", "0", "-o", "worst.zarr"]) == 0
    assert "no failure in 24 flights" in capsys.readouterr().out
    assert main([*study, "-o", "both.zarr"]) == 2
    assert "2 studies; ask one, as harness sensitivity my" in capsys.readouterr().err


# ---- plain campaigns


def test_campaigns_keep_margins_with_their_units(system, tmp_path):
    given = table(system, runs=5, requirements={"own": "time < 3 s or twice.y >= 1"})
    store = campaign(given, tmp_path / "c.zarr", workers=0).store
    k = store.array("twice.k")
    assert store.array("requirement").tolist() == ["small", "flag", "own"]
    wanted = np.stack([20 - 6 * k, 3 * k - 1], axis=1)
    assert store.array("margin")[:, [0, 2]] == pytest.approx(wanted)
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
    assert "success above 90 % at 90 %: shown by" in found.summary()
    again = campaign(given, tmp_path / "c.zarr", workers=0, resume=True)
    assert again.store.runs == len(failed)


def test_a_campaign_of_as_many_runs_as_wilks_demands(system, tmp_path):
    until = {"success": 0.9, "confidence": 0.9, "fixed": True}
    found = campaign(table(system, until=until, success="twice.y <= 99"), tmp_path / "c", workers=0)
    assert found.store.runs == 22
    assert "shown by 22 runs, 0 failed (Wilks: 22 runs without a failure)" in found.summary()


@pytest.mark.parametrize(
    ("more", "problem"),
    [
        ({"until": {"success": 2}}, "until.success: must be a number between 0 and 1"),
        ({"until": {"succeed": 0.9}}, "until.success: is missing"),
        ({"until": {"success": 0.9}, "runs": 5}, "until: counts draws, it cannot be beside runs"),
        (
            {"until": {"success": 0.9}, "factors": {"twice.k": {"list": [1.0]}}},
            "until: counts draws",
        ),
        ({"requirements": {"own": "twice.z > 1"}}, r"requirements: own: .* \(close: twice.y"),
        ({"requirements": {"own": "twice.y"}}, "is not a condition"),
    ],
)
def test_wrong_entries_of_a_campaign_are_refused(more, problem, system, tmp_path):
    with pytest.raises(StructureError, match=problem):
        campaign(table(system) | more, tmp_path / "x.zarr", workers=0)
