# SPDX-License-Identifier: BSD-2-Clause
"""Statements of a result about its origin: in every file, of every kind of run; and the same run
again.
"""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import fields, replace

import numpy as np
import pytest

from harness import Simulation, compare, load, read, run
from harness.claims.case import SHOWN, listed, unlike
from harness.cli import main
from harness.errors import UsageError
from harness.files import paths
from harness.mission import Case, Paper
from harness.results.files import ResultFile
from harness.results.provenance import (
    Provenance,
    Slot,
    differences,
    flat,
    from_flat,
    from_table,
    table,
)
from harness.studies.rerun import again, agreement
from harness.system.model import Swap

SHORT = {"stop": 2.0}


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture(scope="module")
def changed():
    """A run with a change of every kind."""
    return run(
        "sync_approach",
        params="robust",
        set={"servicer.J_S": np.diag([200, 250.0, 151]), "servicer.mass_0": "120"},
        swap={"controller": "pid_controller"},
        latency=["controller=1"],
        step=0.1,
        algorithm="jacobi",
        every=2,
        **SHORT,
    )


# ---- what it holds


def test_a_run_states_all_that_was_changed(changed, monkeypatch):
    found = changed.provenance
    assert (found.system, found.source, found.params) == (
        "sync_approach",
        "sync_approach",
        "robust",
    )
    assert found.sha256 == digest(paths.systems()["sync_approach"])
    fmu = digest(paths.fmus()["pid_controller"])
    assert found.swaps == (Swap("controller", "pid_controller", fmu),)
    matrix = [[200.0, 0.0, 0.0], [0.0, 250.0, 0.0], [0.0, 0.0, 151.0]]
    assert found.set == (("servicer.J_S", matrix), ("servicer.mass_0", "120"))
    assert found.latency == (("controller", 1),)
    assert (found.algorithm, found.step, found.stop, found.every) == ("jacobi", 0.1, 2.0, 2)
    assert found.schedule[:2] == (
        Slot("guidance", "sync_guidance", 1, 0),
        Slot("controller", "pid_controller", 1, 1),
    )
    assert found.command is None
    assert changed.parameter("servicer.J_S")[2, 2] == 151


def test_the_date_matches_the_source_if_it_is_given(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    assert run("sync_approach", stop=0.1).provenance.date == "1970-01-02T00:00:00Z"


@pytest.mark.parametrize("given", ["253402300800", "9" * 30, "9" * 5000, "-1", "x", "1.5", "٣"])
def test_a_date_that_is_none_is_rejected_before_the_run(given, tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", given)
    out = tmp_path / "out.nc"
    assert main(["run", "sync_approach", "--stop", "1", "-o", str(out)]) == 2
    line = (
        f"harness: SOURCE_DATE_EPOCH={given[:40]}: expected whole seconds since 1970, at most 2534"
    )
    assert capsys.readouterr().err.startswith(line)
    assert not out.exists()


def test_a_parameter_file_is_retained_with_its_hash(tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("[servicer]\nmass_0 = 111\n", encoding="utf-8")
    found = run("sync_approach", params=file, **SHORT).provenance
    assert (found.params, found.params_sha256) == (str(file), digest(file))


def test_a_reused_simulation_gives_every_run_its_own():
    with load("sync_approach") as system, Simulation(system) as simulation:
        first = simulation.run(set={"servicer.mass_0": 90}, **SHORT)
        second = simulation.run(latency={"controller": 1}, **SHORT)
    assert first.provenance.set == (("servicer.mass_0", 90),)
    assert (second.provenance.set, second.provenance.latency) == ((), (("controller", 1),))
    assert first.provenance.sha256 == second.provenance.sha256


def test_every_run_of_a_comparison_has_its_own(tmp_path):
    found = compare(
        "sync_approach", tmp_path, vary={"servicer.mass_0": [90, 110]}, swap=(), **SHORT
    )
    given = [result.provenance.set for result in found.results.values()]
    assert given == [(("servicer.mass_0", "90"),), (("servicer.mass_0", "110"),)]


# ---- as it is stored


def test_every_field_survives_both_tables(changed):
    whole = replace(changed.provenance, command="harness run 'a b'", maps=(("a.x", "b.y"),))
    assert from_table(table(whole)) == from_flat(flat(whole)) == whole
    assert from_table({**table(whole), "later": 1}) == whole
    assert {f.name for f in fields(Provenance)} == table(whole).keys() | {"later"} - {"later"}


@pytest.mark.parametrize("ending", [".nc", ".csv"])
def test_it_reads_back_from_every_file(changed, tmp_path, ending):
    path = tmp_path / f"out{ending}"
    ResultFile(path).write(changed)
    assert read(path).provenance == changed.provenance
    assert read(str(path)).parameter("servicer.J_S").tolist() == np.diag([200, 250, 151]).tolist()


# ---- the same run again


@pytest.mark.parametrize("ending", [".nc", ".csv"])
def test_like_repeats_a_run_to_the_bit(changed, tmp_path, capsys, monkeypatch, ending):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / f"out{ending}"
    ResultFile(path).write(changed)
    assert main(["run", "--like", str(path)]) == 0
    assert f"the bits agree: {len(changed.time)} rows" in capsys.readouterr().out
    assert (tmp_path / "results" / "sync_approach_again.nc").is_file()
    assert "run --like" in read(tmp_path / "results/sync_approach_again.nc").provenance.command


def test_another_bit_is_found_with_its_place(changed):
    values = changed.values.copy()
    column = changed.columns.index("servicer.r_SN_N[2]")
    values[3, column] = np.nextafter(values[3, column], np.inf)
    equal, line = agreement(replace(changed, values=values), changed)
    assert not equal
    assert f"differ in 1 of {values.size} values, first at 0.6 s: servicer.r_SN_N[2]" in line


def test_a_sign_of_zero_is_a_bit_and_a_nan_is_a_nan(changed):
    values = np.zeros_like(changed.values)
    values[1, 1] = np.nan
    zero = replace(changed, values=values)
    assert agreement(zero, zero)[0]
    values = values.copy()
    values[2, 2] = -0.0
    assert not agreement(zero, replace(changed, values=values))[0]


def test_other_times_parameters_and_schedules_are_other_bits(changed):
    """As of a file that was changed by hand."""
    time = changed.time.copy()
    time[4] = np.nextafter(time[4], 1)
    fixed = changed.parameters.values.copy()
    column = changed.parameters.columns.index("servicer.mass_0")
    fixed[0, column] = 121.0
    heavier = replace(changed.parameters, values=fixed)
    schedule = (changed.provenance.schedule[0]._replace(every=2), *changed.provenance.schedule[1:])
    for forged, line in (
        ({"time": time}, "the bits differ: row 4 is at 0.8 s instead of 0.8000000000000002 s"),
        (
            {"parameters": heavier},
            "the bits differ: parameter servicer.mass_0 is 120.0 instead of 121.0",
        ),
        (
            {"parameters": replace(heavier, columns=(*heavier.columns[:-1], "a.b"))},
            "the bits differ: parameter servicer.mass_0 is 120.0 instead of 121.0",
        ),
        (
            {"parameters": replace(changed.parameters, columns=("a.b", *heavier.columns[1:]))},
            "the bits differ: parameter a.b is in one of the two runs only",
        ),
        (
            {"provenance": replace(changed.provenance, schedule=schedule)},
            "bits not compared: the runs differ in schedule",
        ),
        (
            {"provenance": replace(changed.provenance, step=0.2)},
            "bits not compared: the runs differ in step",
        ),
    ):
        assert agreement(replace(changed, **forged), changed) == (False, line)
    assert agreement(changed, changed)[0]


def test_a_forged_file_ends_with_status_1(changed, tmp_path, capsys):
    time = changed.time.copy()
    time[-1] += 1e-9
    path, out = tmp_path / "out.nc", str(tmp_path / "again.nc")
    ResultFile(path).write(replace(changed, time=time))
    assert main(["run", "--like", str(path), "-q", "-o", out]) == 1
    assert "the bits differ: row 10 is at 2.0 s" in capsys.readouterr().out


def test_a_thinned_run_is_repeated_with_its_last_row(tmp_path, capsys):
    path = run("sync_approach", stop=1.0, every=3).save(tmp_path / "out.nc")
    assert read(path).time.tolist() == [0.0, 0.30000000000000004, 0.6000000000000001, 0.9, 1.0]
    assert main(["run", "--like", str(path), "-o", str(tmp_path / "again.nc")]) == 0
    assert "the bits agree: 5 rows" in capsys.readouterr().out


def test_a_run_that_is_changed_on_the_way_is_not_held_against_its_model(changed, tmp_path, capsys):
    path, other = tmp_path / "out.nc", tmp_path / "other.nc"
    ResultFile(path).write(changed)
    assert main(["run", "--like", str(path), "--set", "servicer.k=1", "-o", str(other)]) == 2
    mass = ["--set", "servicer.mass_0=130"]
    assert main(["run", "--like", str(path), *mass, "-o", str(other)]) == 0
    assert "bits not compared: the runs differ in set" in capsys.readouterr().out
    found = read(other)
    assert found.parameter("servicer.mass_0") == 130
    assert found.parameter("servicer.J_S")[2, 2] == 151


def test_another_epoch_is_a_difference_of_settings():
    found = run("sync_approach", stop=0.1).provenance
    assert differences(found, replace(found, epoch="2026-03-01T00:00:00")) == ["epoch"]


def test_a_run_with_another_epoch_is_not_held_against_its_model(tmp_path, capsys):
    path = run("sync_approach_navigated", stop=1.0).save(tmp_path / "out.nc")
    command = ["run", "sync_approach_navigated", "--like", str(path), "--epoch", "2026-03-01"]
    assert main([*command, "-o", str(tmp_path / "again.nc")]) == 0
    assert "bits not compared" in capsys.readouterr().out


def test_a_system_or_fmu_that_was_changed_or_is_gone_is_named(tmp_path, caplog):
    system, fmu, out = tmp_path / "mine.ssp", tmp_path / "my.fmu", tmp_path / "out.nc"
    shutil.copy(paths.systems()["sync_approach"], system)
    shutil.copy(paths.fmus()["pid_controller"], fmu)
    ResultFile(out).write(run(system, swap={"controller": str(fmu)}, **SHORT))

    shutil.copy(paths.systems()["sync_approach_thrusters"], system)
    shutil.copy(paths.fmus()["ppc_controller"], fmu)
    again(str(out), None, {})
    lines = [record.getMessage() for record in caplog.records]
    assert [line.partition(" (")[0] for line in lines] == [
        "mine.ssp: differs from the recorded file",
        "my.fmu: differs from the recorded file",
    ]
    fmu.unlink()
    with pytest.raises(UsageError, match=r"my\.fmu: there is no such FMU"):
        again(str(out), None, {})
    system.unlink()
    with pytest.raises(UsageError, match=r"mine\.ssp: there is no such system"):
        again(str(out), None, {})


def test_without_a_word_on_its_origin_nothing_is_repeated(changed, tmp_path):
    path = tmp_path / "out.nc"
    ResultFile(path).write(replace(changed, provenance=None))
    with pytest.raises(UsageError, match="the file has no record of the run"):
        again(str(path), None, {})
    ResultFile(path).write(replace(changed, provenance=replace(changed.provenance, source="")))
    with pytest.raises(UsageError, match="its system was made in Python"):
        again(str(path), None, {})


def test_run_requires_a_system(capsys):
    assert main(["run"]) == 2
    assert "SYSTEM is missing: give a name" in capsys.readouterr().err


# ---- the case of a paper


CASE = Case("sync_approach", free=("stop",))


def about(*cases):
    """A paper about these cases."""
    return Paper("", (), (), cases=cases)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({}, []),
        ({"set": {"guidance.rho_M": 4}}, []),
        ({"set": {"guidance.rho_M": 6}}, ["guidance.rho_M 6 instead of 4 m"]),
        ({"step": 0.05}, ["macro step 0.05 s instead of 0.1 s"]),
        ({"algorithm": "jacobi"}, ["jacobi instead of gauss-seidel"]),
        (
            {"swap": {"controller": "pid_controller"}},
            ["controller pid_controller instead of adaptive_controller"],
        ),
        (
            {"latency": {"controller": 1}},
            ["controller (period, latency) (1, 1) instead of (1, 0) macro steps"],
        ),
    ],
)
def test_differences_from_a_case_are_named(changes, words):
    result = run("sync_approach", **{"stop": 1.0, **changes})
    assert unlike(about(CASE), result) == words


def test_the_nearest_of_several_cases_counts():
    result = run("sync_approach", params="robust", stop=1.0)
    assert unlike(about(CASE, replace(CASE, params="robust")), result) == []
    (end,) = unlike(about(Case("sync_approach", "robust")), result)
    assert end == "the run ends at 1 s instead of 1800 s"
    assert unlike(about(Case("relay_approach")), result)[0].startswith("system sync_approach")


def test_a_result_without_parameters_is_not_known_to_be_a_case():
    result = run("sync_approach", stop=1.0)
    (line,) = unlike(about(CASE), replace(result, parameters=None))
    assert line == "the file does not contain the parameters of the run"
    assert unlike(about(), replace(result, parameters=None)) == []


def test_a_long_list_of_deviations_is_cut():
    texts = [str(n) for n in range(SHOWN + 2)]
    assert listed(texts).endswith("; and 2 more")
    assert "more" not in listed(texts[:SHOWN])
