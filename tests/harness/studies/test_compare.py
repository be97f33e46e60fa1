# SPDX-License-Identifier: BSD-2-Clause
"""harness compare: runs in parallel, one table, and runs that fail."""

from __future__ import annotations

import csv
import os
import signal
import subprocess
import sys
import tomllib

import numpy as np
import pytest

from harness import run
from harness.cli.app import main
from harness.errors import StructureError, UsageError
from harness.figures import plots
from harness.mission import Curve, Figure, Panel
from harness.report.comparison import _results
from harness.results.files import ResultFile, read
from harness.results.requirements import Finding
from harness.results.result import Result
from harness.results.verdict import Verdict
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from harness.studies.compare import ComparisonRuns, _thinning, compare, table, verdicts
from harness.studies.variants import combinations
from tests.harness.demo import TOML
from tests.harness.interrupts import LONGEST, start, until
from tests.harness.third_party_fmu import Model, build, p, u, y


@pytest.fixture
def system(fmus, tmp_path):
    write_ssp(system_of(tomllib.loads(TOML), fmus), tmp_path / "demo.ssp")
    return tmp_path / "demo.ssp"


@pytest.fixture
def crashing(tmp_path):
    """Replacement for `gain` that ends the whole process in its first step."""
    model = Model("crashing", [u("u"), y("y"), p("k")], "y = u;", "abort();")
    return build(model, tmp_path)


def simulated(system, tmp_path, *varied, **changes):
    return compare(system, combinations(changes, varied), tmp_path / "out")


def test_every_run_gives_the_bits_of_a_run_of_its_own(system, fmus, tmp_path):
    plus_one = fmus["plus_one"]
    found = simulated(system, tmp_path, ("swap", f"twice={fmus['gain']},{plus_one}"), stop=4.0)
    assert found.failures == []
    alone = run(system, swap={"twice": plus_one}, stop=4.0)
    assert found.results["plus_one"].values.tobytes() == alone.values.tobytes()
    assert found.results["gain"]["twice.y"].tolist() == [0, 2, 4, 6, 8]
    assert read(tmp_path / "out" / "plus_one.nc")["twice.y"].tolist() == [1, 2, 3, 4, 5]


def test_the_fused_executor_gives_the_same_bits_and_rejects_no_one(system, tmp_path, caplog):
    def fused(system, *varied, **changes):
        chosen = combinations(changes, varied)
        return compare(system, chosen, tmp_path / "out", executor="fused").results

    run("space_robot", stop=1.0, executor="fused")  # compiled once, for all workers
    found = fused("space_robot", ("set", "robot.e=0,0.1"), stop=50.0)
    for e, result in zip((0.0, 0.1), found.values(), strict=True):
        alone = run("space_robot", set={"robot.e": e}, stop=50.0)
        assert result.values.tobytes() == alone.values.tobytes()
        assert result.provenance.executor == "fused"
    assert not caplog.text
    third_party = fused(system, ("algorithm", "jacobi,gauss-seidel"), stop=4.0)["jacobi"]
    alone = run(system, algorithm="jacobi", stop=4.0)
    assert third_party.values.tobytes() == alone.values.tobytes()
    assert caplog.text.count("runs with the executor c: ") == 1
    with pytest.raises(UsageError, match="there is no executor rust, only c, python and fused"):
        compare(system, [], tmp_path / "out", executor="rust")


def test_the_table_has_one_line_per_run_and_is_retained_with_all_digits(system, tmp_path):
    found = simulated(system, tmp_path, ("algorithm", "jacobi,gauss-seidel"))
    lines = table(found.metrics, [*found.outcomes]).splitlines()
    assert [line.split()[0] for line in lines[-2:]] == ["jacobi", "gauss-seidel"]
    with (tmp_path / "out" / "comparison.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["run"] for row in rows] == ["jacobi", "gauss-seidel"]
    assert all(float(row["macro step [us]"]) > 0 for row in rows)
    assert {row["range error [m]"] for row in rows} == {""}


def test_verdicts_are_a_table_of_runs_and_requirements():
    required = {"above": Finding("above", "x >= 1", Verdict.MET, 2.0, "m", 1.0)}
    required["later"] = Finding("later", "y >= 1", Verdict.NOT_EXERCISED, reason="it ends at 1 s")
    failed = Finding("above", "x >= 1", Verdict.NOT_MET, 0.5, "m", 3.0)
    shown = verdicts({"a": [*required.values()], "another": [failed]}).splitlines()
    assert [line.split() for line in shown] == [
        ["above", "later"],
        ["a", "met", "2", "m", "not", "exercised"],
        ["another", "NOT", "MET", "0.5", "m", "-"],
    ]
    assert len(set(map(len, shown[1:]))) == 1


def test_results_of_an_earlier_comparison_are_not_taken_for_results_of_a_crashed_run(
    system, crashing, fmus, tmp_path
):
    (tmp_path / "out").mkdir()
    ResultFile(tmp_path / "out" / "crashing.nc").write(run(system))
    old = (tmp_path / "out" / "crashing.nc").read_bytes()
    found = simulated(system, tmp_path, ("swap", f"twice={crashing},{fmus['gain']}"))
    assert list(found.results) == ["crashing", "gain"]
    assert len(found.results["crashing"].time) == 1
    assert (tmp_path / "out" / "crashing.nc").read_bytes() == old
    shown = _results(tmp_path / "out", ["crashing", "gain"])
    assert [len(result.time) for result in shown.values()] == [1, len(found.results["gain"].time)]


@pytest.mark.parametrize(
    ("steps", "every"), [(1, 1), (20_000, 1), (20_001, 3), (400_000, 20), (50_000, 4), (21_000, 2)]
)
def test_long_runs_are_thinned_to_twenty_thousand_rows_with_the_end_if_possible(steps, every):
    assert _thinning(steps) == every


def test_values_of_a_parameter_are_compared(system, tmp_path):
    found = simulated(system, tmp_path, ("set", "twice.k=3,-1"), set=["bad.t_fail=50"], stop=2.0)
    assert {label: r["twice.y"].tolist() for label, r in found.results.items()} == {
        "twice.k=3": [0, 3, 6],
        "twice.k=-1": [0, -1, -2],
    }


def test_a_warning_about_a_run_comes_once(system, fmus, tmp_path, caplog):
    simulated(system, tmp_path, ("swap", f"bad={fmus['counter']},{fmus['failing']}"))
    assert caplog.messages == ["bad: counter.fmu does not have these parameters of failing: t_fail"]


def test_progress_counts_the_runs(system, tmp_path):
    seen = []
    compare(
        system,
        combinations({}, [("algorithm", "jacobi,gauss-seidel")]),
        tmp_path / "out",
        progress=seen.append,
    )
    assert seen == [1, 2]


def test_a_run_that_fails_ends_early_and_the_others_continue(system, tmp_path):
    found = simulated(system, tmp_path, ("params", "default,hot"))
    assert found.failures == [
        "hot: bad: step failed: burnt through after too much heat (at t = 3 s)"
    ]
    assert found.results["default"].complete
    assert not found.results["hot"].complete
    assert found.results["hot"].time[-1] == 3.0
    assert table(found.metrics, [*found.outcomes]).splitlines()[-1].split() == ["hot", "-"]


def test_a_crash_inside_an_fmu_takes_no_other_run_with_it(system, fmus, crashing, tmp_path):
    found = simulated(system, tmp_path, ("swap", f"twice={crashing},{fmus['gain']}"))
    assert found.failures == ["crashing: twice: fmi2DoStep crashed (SIGABRT, aborted) (at t = 0 s)"]
    assert {label: r.complete for label, r in found.results.items()} == {
        "crashing": False,
        "gain": True,
    }


@pytest.mark.parametrize(
    ("varied", "error", "problem"),
    [
        (("params", "hot,cold"), UsageError, "--params cold: demo has no such parameter set"),
        (("swap", "twice=gone,gain"), UsageError, "gone: there is no such FMU"),
        (("latency", "twice=0,7"), StructureError, "twice: latency must lie in"),
    ],
)
def test_errors_of_a_run_are_found_before_any_run_starts(system, tmp_path, varied, error, problem):
    with pytest.raises(error, match=problem):
        simulated(system, tmp_path, varied)
    assert not (tmp_path / "out").exists()


def test_errors_in_the_parameters_of_every_run_are_found_too(system, tmp_path):
    with pytest.raises(UsageError, match=r"--set twice\.q: there is no such variable"):
        simulated(system, tmp_path, ("algorithm", "jacobi,gauss-seidel"), set=["twice.q=1"])


# ---- the command


def test_the_command_prints_the_table_and_fails_with_one_line_per_failed_run(
    system, tmp_path, capsys, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert main(["compare", str(system), "--params", "default,hot", "--stop", "5"]) == 1
    out, err = capsys.readouterr()
    assert out.splitlines()[-1] == "results, comparison.csv and 3 figures in results/demo"
    assert err == "harness: hot: bad: step failed: burnt through after too much heat (at t = 3 s)\n"
    left = {path.name for path in (tmp_path / "results" / "demo").iterdir()}
    assert {name for name in left if not name.endswith(".png")} == {
        "comparison.csv",
        "default.nc",
        "hot.partial.nc",
    }


@pytest.mark.parametrize(
    "arguments", [["compare"], ["compare", "demo.ssp"], ["compare", "demo.ssp", "--swap", "x"]]
)
def test_wrong_use_of_the_command_exits_with_status_2_and_one_line(
    system, tmp_path, capsys, monkeypatch, arguments
):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.fixture
def comparing(fmus, tmp_path):
    """A comparison of runs that take hours, already stepping."""
    toml = 'name = "long"\n[experiment]\nstop = 1e7\nstep = 1.0\n[components]\na = "slow"\n'
    write_ssp(system_of(tomllib.loads(toml), fmus), tmp_path / "long.ssp")
    command = [
        sys.executable,
        "-m",
        "harness",
        "compare",
        "long.ssp",
        "--algorithm",
        "jacobi,gauss-seidel",
    ]
    process = start(
        command,
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
    )
    until((tmp_path / "stepping").exists, "step")
    yield process
    process.kill()
    process.wait()


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_ends_all_runs_with_one_line(comparing):
    comparing.send_signal(signal.SIGINT)
    assert comparing.communicate(timeout=LONGEST) == ("", "harness: interrupted\n")
    assert comparing.returncode == 1


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_no_run_continues_when_the_comparison_is_killed(comparing):
    comparing.kill()
    comparing.communicate(timeout=LONGEST)  # returns when no process holds the pipes any more
    assert comparing.returncode == -signal.SIGKILL


class Ended(ComparisonRuns):
    """Whose process ends."""

    def run(self, part):
        os._exit(3)


def test_a_run_whose_process_is_ended_is_reported_in_one_line(system, tmp_path, monkeypatch):
    monkeypatch.setattr("harness.studies.compare.ComparisonRuns", Ended)
    found = simulated(system, tmp_path, ("algorithm", "jacobi,gauss-seidel"))
    why = "the process of this run was killed from outside, or crashed inside an FMU"
    assert found.failures == [f"jacobi: {why}", f"gauss-seidel: {why}"]


# ---- many variants


def test_ten_variants_have_a_scale_of_colours_and_bands_instead_of_a_legend():
    names = [f"k={value}" for value in range(1, 11)]
    time_ = np.linspace(0.0, 1.0, 5)
    results = {
        name: Result("s", time_, ("y",), ("1",), np.full((5, 1), float(k)))
        for k, name in enumerate(names)
    }
    figure = Figure("f", "title", (Panel("y", (Curve("y"),)),))
    few, many = dict(list(results.items())[:9]), results
    canvas = plots.paint_overlay(figure, few, plots._colours(list(few)))
    assert (len(canvas.legends), len(canvas.axes)) == (1, 1)
    canvas = plots.paint_overlay(figure, many, plots._colours(names))
    assert (len(canvas.legends), len(canvas.axes)) == (0, 2)
    panel, scale = canvas.axes
    assert (scale.get_ylabel(), scale.get_ylim()) == ("k", (1.0, 10.0))
    assert panel.get_lines()[-1].get_ydata().tolist() == [4.5] * 5  # the median of 0 .. 9
    band = panel.collections[0].get_paths()[0].vertices[:, 1]
    assert (band.min(), band.max()) == pytest.approx((0.45, 8.55))


def test_no_figures_are_drawn_if_none_are_required(system, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(plots, "overlay", lambda *_: pytest.fail("drawn"))
    assert main(["compare", "demo.ssp", "--algorithm", "jacobi,gauss-seidel", "--no-figures"]) == 0
    assert "results and comparison.csv in results/demo" in capsys.readouterr().out


# ---- which limits are in force, and how the table reads

LIMITED = (
    TOML
    + """
[sets.small]
description = "a small gain"
[sets.small.twice]
k = 0.5
[compare]
set = "small"
"""
)


@pytest.fixture
def limited(fmus, tmp_path):
    write_ssp(system_of(tomllib.loads(LIMITED), fmus), tmp_path / "limited.ssp")
    return tmp_path / "limited.ssp"


def test_a_comparison_takes_the_set_that_the_system_has_for_it(limited, tmp_path):
    found = simulated(limited, tmp_path, ("set", "count.n_0=0,10"))
    assert [r.parameter("twice.k") for r in found.results.values()] == [0.5, 0.5]
    head = (
        "parameters: set small, a small gain (twice.k = 0.5); --params default: the values of "
        "the system"
    )
    assert found.text().splitlines()[0] == head
    assert run(limited).parameter("twice.k") == 2.0


def test_unless_stated_otherwise(limited, tmp_path):
    found = simulated(limited, tmp_path, ("params", "default,hot"))
    assert found.results["default"].parameter("twice.k") == 2.0
    head = "parameters: values of --params default, hot; without --params: set small"
    assert found.text().splitlines()[0] == head


def test_a_set_for_comparisons_that_is_not_there_is_rejected(fmus):
    text = LIMITED.replace('set = "small"', 'set = "smallx"')
    with pytest.raises(
        StructureError, match=r"compare.smallx: the system defines no such name \(close: small"
    ):
        system_of(tomllib.loads(text), fmus)


def test_the_controllers_of_an_approach_are_compared_with_its_actuators(tmp_path, capsys):
    """The law that peaks at 154 N if nothing limits it has 2, 1, 1 N on the axes here."""
    several = ("swap", "controller=adaptive_controller,pid_controller")
    found = compare("sync_approach", combinations({"stop": 60.0}, [several]), tmp_path / "out")
    peaks = found.metrics["peak force", "N"]
    assert 1.0 < peaks["pid_controller"] <= np.sqrt(6)
    text = found.text()
    assert text.startswith("parameters: set limited, actuators of such a servicer")
    assert "propulsion.F_max = 2.0 1.0 1.0" in " ".join(text.split())
    assert max(map(len, text.splitlines())) <= 120
    metric = next(m for m in found.mission.metrics if m.name == "attitude settles")
    assert metric.about(found.limits, found.results) == "1 deg from 1200 s"
    lines = text.splitlines()
    head = next(k for k, line in enumerate(lines) if line.split()[:2] == ["distance", "tracking"])
    assert [line.split()[:2] for line in lines[head + 1 : head + 3]] == [
        ["adaptive_controller", "met"],
        ["pid_controller", "met"],
    ]
    (tracking,) = (line for line in lines if "not exercised: tracking" in line)
    assert tracking.startswith("adaptive_controller, pid_controller: ")
    names = text.splitlines()[-60:]
    assert any("corridor" in line for line in names)
    chosen = found.text(["peak force", "first violated"])
    assert "settles" not in chosen.partition("[N]")[0]
    free = compare(
        "sync_approach",
        combinations({"stop": 60.0, "params": "default"}, [several]),
        tmp_path / "o",
    )
    warning = next(x for x in free.text().splitlines() if x.startswith("warning: peak force: "))
    assert "pid_controller" in warning
    assert "warning: peak force" not in text
    (limited,) = (x for x in text.splitlines() if x.startswith("warning: pid_controller: "))
    assert "force at limit 100 %, more than 20 %" in limited
    assert "force" in text.partition("settles:")[0].rpartition("saturated")[2]
    assert found.metrics["force at limit", "%"]["adaptive_controller"] == 0
    assert ("torque at limit", "%") in found.metrics
    assert "torque at limit" not in " ".join(found.text().split())
    assert "at limit" not in " ".join(free.text().split())


def test_quiet_is_quiet_and_metrics_are_chosen(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = ["compare", "sync_approach", "--vary", "guidance.beta=0.005,0.008", "--stop", "1"]
    assert main([*command, "--no-figures", "-q"]) == 0
    assert capsys.readouterr() == ("", "")
    assert main([*command, "--no-figures", "--metrics", "peak force,delta-v"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split() for line in lines if "delta-v" in line] == [["delta-v", "peak"]]
    assert main([*command, "--metrics", "peak forces"]) == 2
    close = "(close: peak force, peak torque)"
    stated = f"harness: --metrics peak forces: there is no such metric {close}\n"
    assert capsys.readouterr().err == stated
