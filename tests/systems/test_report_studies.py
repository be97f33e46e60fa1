# SPDX-License-Identifier: BSD-2-Clause
"""Pages of comparisons and campaigns: their numbers equal those in the table and in the dataset."""

from __future__ import annotations

import csv
import re
import shutil
from dataclasses import replace

import numpy as np
import pytest
import zarr

from harness import campaign, compare, read, worst
from harness.api import write_page
from harness.cli.app import main
from harness.errors import ResultsError
from harness.results.files import ResultFile
from harness.results.requirements import findings
from harness.studies.campaign.summary import rank_correlation
from tests.harness.report_page import Page


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Folder and page of four runs: two controllers, two masses."""
    folder = tmp_path_factory.mktemp("compared") / "runs"
    compare(
        "sync_approach",
        folder,
        swap={"controller": ["adaptive_controller", "pid_controller"]},
        vary={"servicer.mass_0": [95, 120]},
        set={"servicer.t_att": 25},
        stop=40.0,
    )
    page = write_page(folder, folder / "report.html")
    return folder, Page(page.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """Campaign and page of 24 runs."""
    path = tmp_path_factory.mktemp("campaign") / "spread.zarr"
    definition = {
        "system": "sync_approach",
        "runs": 24,
        "success": "parameter(servicer.mass_0) < 105",
        "fixed": {"stop": 20.0},
        "factors": {"servicer.mass_0": {"uniform": {"low": 80.0, "high": 130.0}}},
        "metrics": {"miss": "last(norm(servicer.r_SN_N - target.r_TN_N))", "cost": "delta-v"},
        "record": {"bands": ["guidance.range"]},
    }
    found = campaign(definition, path, workers=0)
    return found, Page(write_page(path, path.parent / "c.html").read_text(encoding="utf-8"))


# ---- comparison


def test_a_comparison_shows_its_table(compared):
    folder, page = compared
    assert page.is_closed()
    with (folder / "comparison.csv").open() as file:
        heads, *rows = csv.reader(file)
    assert len(rows) == 4
    for row in rows:
        assert row[0] in page.text
        for head, cell in zip(heads[1:], row[1:], strict=True):
            if cell and np.isfinite(float(cell)):
                assert head.removesuffix(" [1]") in page.text
                words = ("none", "keep-out", "corridor", "speed", "passive", "plume", "navigation")
                worded = head == "first violated [1]"
                shown = words[int(float(cell))] if worded else f"{float(cell):.4g}"
                assert shown in page.text


def test_a_comparison_shows_the_verdicts_of_its_runs_and_warns_of_limits(compared):
    """A law at the limit of its actuators all the time may meet a requirement far from the target:
    the page shows what the other requirements say, and the warning of `harness compare`.
    """
    folder, page = compared
    assert f"{folder.name}: 4 runs of sync_approach" in page.headings
    for label in page.data["runs"]:
        result = read(folder / f"{label.replace(', servicer.mass_0=', '_servicer.mass_0_')}.nc")
        found = findings(result)
        assert len(found) == 4
        for each in found:
            assert each.name in page.text
            assert each.detail in page.text
    with (folder / "comparison.csv").open() as file:
        rows = list(csv.DictReader(file))
    shares = {row["run"]: float(row["force at limit [%]"]) for row in rows}
    warned = {name for name in shares if f"{name}: force at limit" in page.text}
    assert warned == {name for name, share in shares.items() if share > 20}
    assert warned
    assert warned != shares.keys()


def test_every_run_is_in_every_plot_with_its_own_numbers(compared):
    folder, page = compared
    plots = page.figures()["compared_range"]
    for plot in plots:
        assert [c["group"] for c in plot["curves"]] == page.data["runs"]
        assert len({(c["colour"], c["dash"]) for c in plot["curves"]}) == 4
    for curve in plots[0]["curves"]:
        controller, _, mass = curve["group"].partition(", servicer.mass_0=")
        result = read(folder / f"{controller}_servicer.mass_0_{mass}.nc")
        assert float(result.parameter("servicer.mass_0")) == float(mass)
        distance = np.linalg.norm(result["servicer.r_SN_N"] - result["target.r_TN_N"], axis=1)
        rows = np.searchsorted(result.time.astype("f4"), page.array(curve["x"]))
        np.testing.assert_array_equal(page.array(curve["y"]), distance.astype("f4")[rows])


def test_all_servicers_run_in_one_replay(compared):
    folder, page = compared
    scene = page.data["scene"]
    assert [b["name"] for b in scene["bodies"]] == [*page.data["runs"], "target"]
    paths = [page.array(b["r"]) for b in scene["bodies"][:-1]]
    assert all(not np.array_equal(paths[0], other) for other in paths[1:])
    time = page.array(scene["time"])
    for name, path in zip(page.data["runs"], paths, strict=True):
        file = name.replace(", servicer.mass_0=", "_servicer.mass_0_")
        result = read(folder / f"{file}.nc")
        rows = np.searchsorted(result.time.astype("f4"), time)
        rho = (result["servicer.r_SN_N"] - result["target.r_TN_N"])[rows]
        np.testing.assert_allclose(path, rho, atol=1e-5)


def test_the_replay_states_the_course_of_every_run(compared):
    """Phases, events and the state of the rules, each with the label of its run."""
    folder, page = compared
    scene = page.data["scene"]
    time = page.array(scene["time"])
    for label in page.data["runs"]:
        phases = [p for p in scene["phases"] if p["run"] == label]
        assert [(p["text"], p["begin"], p["end"]) for p in phases] == [
            ("attitude frozen", 0, 25),
            ("attitude tracked", 25, 40),
        ]
        events = {e["text"]: e["time"] for e in scene["events"] if e["text"].startswith(label)}
        assert events[f"{label}: attitude control on"] == 25
        result = read(folder / f"{label.replace(', servicer.mass_0=', '_servicer.mass_0_')}.nc")
        worst = min(result.time, key=lambda t: result["guidance.range"][result.time == t][0])
        (own,) = (each for text, each in events.items() if ": distance: " in text)
        assert own == pytest.approx(worst)
        (rule,) = (each for each in scene["rules"] if each["name"] == label)
        names = [f"monitor.{name.replace('-', '_')}_margin" for name in rule["words"]]
        margins = np.array([result[name] for name in names])
        first = np.flatnonzero((margins < 0).any(axis=0))
        assert (rule["violated"] is None) == (len(first) == 0)
        ends = np.append(np.searchsorted(result.time.astype("f4"), time), len(result.time))
        for k, state in enumerate(page.array(rule["state"])):
            span = slice(ends[k], max(ends[k + 1], ends[k] + 1))
            assert (state == 2) == bool((margins[:, span] < 0).any())
            if state == 2:
                which = int(page.array(rule["which"])[k])
                assert (margins[which, span] < 0).any()


def test_a_run_that_ended_early_is_named_at_the_top(compared, tmp_path):
    folder, _ = compared
    partial = tmp_path / "runs"
    partial.mkdir()
    for file in folder.glob("*.nc"):
        (partial / file.name).write_bytes(file.read_bytes())
    (partial / "comparison.csv").write_bytes((folder / "comparison.csv").read_bytes())
    ended = partial / "pid_controller_servicer.mass_0_95.nc"
    result = read(ended)
    half = len(result.time) // 2
    short = replace(
        result,
        time=result.time[:half],
        values=result.values[:half],
        complete=False,
        message="target.q_TN: is not a number",
    )
    ended.unlink()
    ResultFile(ended).write_partial(short)
    (partial / "adaptive_controller_servicer.mass_0_95.nc").unlink()
    page = Page(write_page(partial, tmp_path / "r.html").read_text(encoding="utf-8"))
    reported = " ".join(page.alerts)
    assert "pid_controller, servicer.mass_0=95. target.q_TN: is not a number" in reported
    assert "adaptive_controller, servicer.mass_0=95. there is no results file" in reported
    assert len(page.data["runs"]) == 3
    stays = page.array(page.body("pid_controller, servicer.mass_0=95")["r"])
    assert np.array_equal(stays[-1], stays[-2])
    ends = [e["time"] for e in page.data["scene"]["events"] if e["text"].endswith("the run ends")]
    assert ends == [pytest.approx(short.time[-1])]


# ---- campaign


def test_a_campaign_shows_its_success_and_its_metrics(simulated):
    found, page = simulated
    data = found.data
    succeeded = int((data.success.values > 0).sum())
    assert 0 < succeeded < 24
    assert f"{succeeded} of 24" in page.text
    assert re.search(rf"24 runs of \w+: success in {succeeded} of 24,", page.text)
    for name in ("miss", "cost"):
        for number in (data[name].values.mean(), data[name].values.max()):
            assert f"{number:.5g}" in page.text
    assert not page.alerts
    assert page.is_closed()


def test_histograms_count_every_run(simulated):
    found, page = simulated
    for plot in page.figures()["histograms"]:
        x, y = (page.array(plot["curves"][0][key]) for key in ("x", "y"))
        values = found.data[plot["title"].partition(" [")[0]].values
        counted = [
            ((values >= a - 1e-6) & (values <= b + 1e-6)).sum()
            for a, b in zip(x[1:-1:2], x[2::2], strict=True)
        ]
        assert y[1:-1:2].sum() == 24
        assert np.abs(np.array(counted) - y[1:-1:2]).max() <= 1


def test_metrics_are_drawn_against_the_factors_with_their_correlation(simulated):
    found, page = simulated
    mass = found.data["servicer.mass_0"].values
    plots = {p["y"]: p for p in page.figures()["factors"]}
    for name, unit in (("miss", "m"), ("cost", "m/s")):
        values, plot = found.data[name].values, plots[f"{name} [{unit}]"]
        curve = plot["curves"][0]
        np.testing.assert_array_equal(page.array(curve["x"]), mass.astype("f4"))
        np.testing.assert_array_equal(page.array(curve["y"]), values.astype("f4"))
        assert f"{rank_correlation(mass, values):+.2f}" in plot["title"]


def test_bands_are_percentiles_of_the_runs(simulated):
    found, page = simulated
    (plot,) = page.figures()["bands"]
    band = found.data["guidance.range_band"].values[:, :, 0]
    outer, inner, median = plot["curves"]
    assert (outer["name"], inner["name"]) == ("5 to 95 %", "25 to 75 %")
    assert set(page.array(outer["y"])) == set(band[[0, -1]].astype("f4").ravel())
    np.testing.assert_array_equal(page.array(median["y"]), band[2].astype("f4"))


def test_the_worst_runs_come_with_the_command_that_repeats_them(simulated):
    found, page = simulated
    worst = int(np.argmax(found.data["cost"].values))
    assert f"harness run sync_approach --like {found.path}#{worst}" in page.text


def test_runs_to_come_and_failed_runs_are_reported(simulated, tmp_path):
    found, _ = simulated
    path = tmp_path / "part.zarr"
    shutil.copytree(found.path, path)
    group = zarr.open_group(path, mode="r+")
    group["status"][3:7] = 0
    group["status"][9] = 2
    group["message"][9] = "servicer: mass is not positive"
    page = Page(write_page(path, tmp_path / "p.html").read_text(encoding="utf-8"))
    assert " ".join(page.alerts) == "Incomplete campaign. 4 runs have not completed."
    assert "run 9: servicer: mass is not positive" in page.text


# ---- what is neither


def test_other_folders_and_damaged_tables_are_reported_in_one_line(tmp_path, capsys):
    assert main(["report", str(tmp_path), "-o", str(tmp_path / "r.html")]) == 2
    assert "neither comparison.csv nor the dataset" in capsys.readouterr().err
    (tmp_path / "comparison.csv").write_text("run,range [m]\na,1,2\n")
    assert main(["report", str(tmp_path), "-o", str(tmp_path / "r.html")]) == 1
    assert capsys.readouterr().err.count("\n") == 1
    (tmp_path / "comparison.csv").write_text("run,range [m]\na,1\n")
    with pytest.raises(ResultsError, match="contains none of the results"):
        write_page(tmp_path, tmp_path / "r.html")
    (tmp_path / "c.zarr").mkdir()
    (tmp_path / "c.zarr" / "zarr.json").write_text("{}")
    with pytest.raises(ResultsError, match="is not the dataset of a campaign"):
        write_page(tmp_path / "c.zarr", tmp_path / "r.html")


def test_the_worst_run_of_a_search_is_beside_the_nominal_one(tmp_path):
    """Same replay and plots, labels in the order of the colours; a campaign has neither."""
    definition = {
        "system": "sync_approach",
        "fixed": {"stop": 20.0},
        "factors": {"servicer.rho_0_H": {"normal": {"mean": [0.0, 20.0, 0.0], "sigma": 0.5}}},
        "worst": {"of": "distance", "runs": 12},
    }
    study = worst(definition, tmp_path / "w.zarr", workers=0)
    page = Page(write_page(study.path, tmp_path / "w.html").read_text(encoding="utf-8"))
    assert page.data["runs"] == ["nominal", "worst distance"]
    assert [b["name"] for b in page.data["scene"]["bodies"]] == [*page.data["runs"], "target"]
    (plot, *_) = page.figures()["compared_range"]
    for curve, name in zip(plot["curves"], ("nominal", "distance"), strict=True):
        result = read(tmp_path / "w_worst" / f"{name}.nc")
        distance = np.linalg.norm(result["servicer.r_SN_N"] - result["target.r_TN_N"], axis=1)
        rows = np.searchsorted(result.time.astype("f4"), page.array(curve["x"]))
        np.testing.assert_array_equal(page.array(curve["y"]), distance.astype("f4")[rows])
    assert {"beside", "replay"} <= page.ids
    (tmp_path / "w_worst" / "distance.nc").unlink()
    (tmp_path / "w_worst" / "nominal.nc").unlink()
    bare = Page(write_page(study.path, tmp_path / "bare.html").read_text(encoding="utf-8"))
    assert bare.data["scene"] is None
    assert "beside" not in bare.ids
