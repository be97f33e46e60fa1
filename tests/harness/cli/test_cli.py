# SPDX-License-Identifier: BSD-2-Clause
"""The command line: exit status, one line per error, nothing lost, no traceback."""

from __future__ import annotations

import inspect
import os
import re
import signal
import subprocess
import sys
import tomllib
import zipfile

import numpy as np
import pytest

from harness.cli import app, look, models
from harness.cli.app import main
from harness.results import files as result_files
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from tests.harness.demo import TOML
from tests.harness.interrupts import LONGEST, start, until


@pytest.fixture
def folder(fmus, project_fmus, tmp_path, monkeypatch):
    """Working directory with demo.ssp, which represents a system of the project too."""
    write_ssp(system_of(tomllib.loads(TOML), fmus), tmp_path / "demo.ssp")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("harness.files.paths.systems", lambda: {"demo": tmp_path / "demo.ssp"})
    return tmp_path


@pytest.fixture
def command(folder, capsys):
    """Run a command line; gives exit status, stdout and stderr as lines."""

    def run_command(*arguments):
        status = main([str(a) for a in arguments])
        captured = capsys.readouterr()
        return status, captured.out.splitlines(), captured.err.splitlines()

    return run_command


# ---- what works


def test_run_writes_the_results_and_states_so_in_one_line(command, folder):
    status, out, err = command("run", "demo", "-o", "x.csv")
    assert (status, err) == (0, [])
    size = (folder / "x.csv").stat().st_size / 1000
    reported = rf"demo: 6 s in \d+\.\d+ s, 7 rows in x\.csv \({size:.1f} kB\)"
    assert re.fullmatch(reported, "\n".join(out))
    assert (folder / "x.csv").read_text().splitlines()[
        0
    ] == "time,count.n,count.t_last,count.h_last,twice.y,bad.y"
    assert result_files.read(folder / "x.csv")["twice.y"].tolist() == [0, 2, 4, 6, 8, 10, 12]


def test_run_is_quiet_on_demand_and_writes_to_results_by_default(command, folder):
    assert command("run", "demo", "--quiet") == (0, [], [])
    assert result_files.read(folder / "results" / "demo.nc").complete


def test_run_takes_a_path_and_all_options(command, folder):
    status, _, err = command(
        "run", folder / "demo.ssp", "-o", "y.csv", "--params", "hot", "--set", "bad.t_fail=9",
        "--set", "twice.k=3", "--swap", "count=counter", "--step", "0.5", "--stop", "3",
        "--algorithm", "jacobi", "--executor", "python", "--every", "2",
    )  # fmt: skip
    assert (status, err) == (0, [])
    result = result_files.read(folder / "y.csv")
    assert result.time.tolist() == [0, 1, 2, 3]
    assert result["twice.y"].tolist() == [0, 3, 9, 15]


def test_requirements_are_listed_as_in_their_file(command, folder, fmus):
    text = f"{TOML}[requirements]\nsmall = \"twice.y <= 20\"\nslow = 'time < 3 s or bad.y < 1'\n"
    write_ssp(system_of(tomllib.loads(text), fmus), folder / "own.ssp")
    status, out, err = command("requirements", folder / "own.ssp")
    assert (status, err) == (0, [])
    assert out == ["small = 'twice.y <= 20'", "slow = 'time < 3 s or bad.y < 1'"]
    status, _, err = command("requirements", folder / "own.ssp", "--stl")
    assert (status, err[0]) == (2, "harness: No such option: --stl")


def test_list_shows_systems_with_sets_components_and_fmus(command):
    status, out, err = command("list")
    assert (status, err) == (0, [])
    text = "\n".join(out)
    assert "demo" in text
    assert "count (counter), twice (gain), bad (failing)" in text
    assert "default, hot" in text
    assert "hot: fails at 3 s" in text
    assert re.search(r"^  not_a_number\b", text, re.MULTILINE)


def test_a_second_list_reads_no_file_but_to_compare_its_bytes(command, folder, fmus, monkeypatch):
    first = command("list")
    with monkeypatch.context() as patch:
        patch.setattr("harness.cli.showing.listed", None)
        assert command("list") == first
    other = system_of({**tomllib.loads(TOML), "description": "another"}, fmus)
    write_ssp(other, folder / "demo.ssp")
    assert any("another" in line for line in command("list")[1])


def test_check_finds_nothing_wrong_with_a_good_system_and_a_good_fmu(command):
    assert command("check", "demo") == (
        0,
        ["demo: fine (3 components, 1 connections, 2 parameter sets)"],
        [],
    )
    assert command("check", "gain") == (
        0,
        ["gain.fmu: fine (1 inputs, 1 outputs, 1 parameters)"],
        [],
    )


def test_help_names_every_command(command):
    for arguments in ((), ("--help",)):
        status, out, _ = command(*arguments)
        assert status == 0
        for name in (
            "run",
            "list",
            "check",
            "export",
            "draw",
            "linearize",
            "plot",
            "report",
        ):
            assert any(line.strip().startswith(name) for line in out)


def test_the_head_of_a_module_lists_its_own_commands():
    own = {}
    for name, each in app.group().commands.items():
        own.setdefault(inspect.unwrap(each.callback).__module__, set()).add(name)
    assert list(app.group().commands) == list(app.HOMES)
    assert {f"harness.cli.{module}" for module in app.HOMES.values()} == set(own)
    for module in (look, models):
        listed = re.search(r"`harness ([a-z |\n]+)`", module.__doc__)[1].replace("\n", " ")
        assert set(listed.split(" | ")) == own[module.__name__]


# ---- what does not


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["run", "dmo"], "dmo: there is no such system (close: demo)"),
        (
            ["run", "demo", "-o", "x.txt"],
            "x.txt: results are written as .csv, .nc, not as '.txt'",
        ),
        (
            ["run", "demo", "--set", "twice.kk=1"],
            "--set twice.kk: there is no such variable (close: k)",
        ),
        (["run", "demo", "--set", "twice.k=nan"], "--set twice.k: it must not be NaN"),
        (["run", "demo", "--set", "twice.k"], "--set twice.k: expected name=value"),
        (
            ["run", "demo", "--params", "cold"],
            "--params cold: demo has no such parameter set, only default, hot",
        ),
        (["run", "demo", "--swap", "count=nothing"], "nothing: there is no such FMU"),
        (
            ["run", "demo", "--swap", "cuont=gain"],
            "--swap cuont: demo has no such component (close: count)",
        ),
        (
            ["run", "demo", "--executor", "rust"],
            "there is no executor rust, only c, python and fused",
        ),
        (["run", "demo", "--every", "0"], "--every must be at least 1, not 0"),
        (["check", "gian"], "gian: there is no such system or FMU (close: gain)"),
    ],
)
def test_wrong_use_exits_with_status_2_and_one_line(command, arguments, line):
    status, out, err = command(*arguments)
    assert (status, out) == (2, [])
    assert err == [f"harness: {line}"]


@pytest.mark.parametrize(
    ("arguments", "mentioned"),
    [
        (["run", "demo", "--stop", "soon"], "--stop"),
        (["run", "demo", "--fast"], "--fast"),
        (["run"], "SYSTEM"),
        (["simulate"], "simulate"),
        (["worst", "nothing"], "nothing: there is no such file or campaign; `harness study` lists"),
        (["campaign", "nothing"], "nothing: there is no such file or campaign"),
        (["worst", "n" * 300], "nnn: there is no such file or campaign"),
    ],
)
def test_a_wrong_command_line_exits_with_status_2_and_one_line(command, arguments, mentioned):
    status, out, err = command(*arguments)
    assert (status, out) == (2, [])
    assert len(err) == 1
    assert err[0].startswith("harness: ")
    assert mentioned in err[0]


@pytest.mark.skipif(os.name != "posix", reason="devices of POSIX")
def test_a_campaign_is_read_from_a_device_or_pipe_without_ending(command):
    """As from `harness campaign <(...)`."""
    assert command("campaign", "/dev/null") == (1, [], ["harness: null: system: is missing"])


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (
            ["--stop", "5.5"],
            r"the stop time 5\.5 s is not a multiple of the macro step 1 s; nearest: 5 s and 6 s",
        ),
        (
            ["--step", "-1"],
            r"the macro step must be a positive number of seconds, not -1\.0: "
            r"give one with --step",
        ),
        (["--algorithm", "newton"], r"algorithm: there is no newton, only gauss-seidel and jacobi"),
        (
            ["--swap", "count=gain"],
            r"--swap count=gain\.fmu: it has no output n, which twice\.u needs",
        ),
        (["-o", "demo.ssp/x.csv"], r"demo\.ssp/x\.csv: cannot be written \(.*\)"),
    ],
)  # fmt: skip
def test_an_impossible_run_exits_with_status_1_and_one_line(command, arguments, line):
    output = () if "-o" in arguments else ("-o", "x.csv")
    status, out, err = command("run", "demo", *output, *arguments)
    assert (status, out) == (1, [])
    assert any(re.fullmatch(f"harness: {line}", each) for each in err)


def test_the_output_is_tried_before_the_run(command, folder, monkeypatch):
    simulate = "harness.master.isolated.simulate"
    monkeypatch.setattr(simulate, lambda *_, **__: pytest.fail("it ran"))
    (folder / "x.csv").mkdir()
    assert command("run", "demo", "-o", "x.csv") == (
        1,
        [],
        ["harness: x.csv: is a folder; give the name of a file, such as x.csv/results.nc"],
    )


def test_a_failing_fmu_leaves_everything_before_in_the_file(command, folder):
    status, out, err = command("run", "demo", "--params", "hot", "-o", "x.csv")
    assert (status, out) == (1, [])
    assert err == [
        "harness: bad: step failed: burnt through after too much heat (at t = 3 s);"
        " 4 recorded rows are in x.partial.csv"
    ]
    retained = result_files.read(folder / "x.partial.csv")
    assert not retained.complete
    assert retained["count.n"].tolist() == [0, 1, 2, 3]


def repacked(path, change):
    """Rewrite an archive with some of its files changed (None: left out)."""
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in (files | change(files)).items():
            if data is not None:
                archive.writestr(name, data)


SSD = "SystemStructure.ssd"


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (
            lambda f: {"resources/gain.fmu": None},
            "demo.ssp: component twice: resources/gain.fmu is not in the archive",
        ),
        (
            lambda f: {"resources/gain.fmu": f["resources/gain.fmu"][:500]},
            "twice: gain.fmu: damaged or not a zip archive (File is not a zip file)",
        ),
        (
            lambda f: {SSD: f[SSD].replace(b'startConnector="n"', b'startConnector="t_last"')},
            "twice.u: expected unit 1, count.t_last has s",
        ),
        (
            lambda f: {SSD: re.sub(rb"(<ssd:Connection [^>]*/>)", rb"\1\1", f[SSD])},
            "twice.u: is driven 2 times, by count.n and count.n; connect only one of them",
        ),
        (
            lambda f: {SSD: re.sub(rb"(?s)<ssd:Connections>.*</ssd:Connections>", b"", f[SSD])},
            "twice.u: no output of this name: connect it in [connections] or list it in [open]",
        ),
        (
            lambda f: {"resources/bad.ssv": f["resources/bad.ssv"].replace(b"100.0", b"NaN")},
            "demo.ssp: component bad: parameter t_fail: must not be NaN",
        ),
    ],
)  # fmt: skip
def test_a_broken_system_exits_with_status_1_and_one_line_under_run_and_check(
    command, folder, change, line
):
    repacked(folder / "demo.ssp", change)
    for arguments in (["run", "demo.ssp", "-o", "x.csv"], ["check", "demo.ssp"]):
        status, out, err = command(*arguments)
        assert (status, out) == (1, [])
        assert err[0].startswith(f"harness: {line}")
    assert not (folder / "x.csv").exists()


def test_a_truncated_system_exits_with_status_1_and_one_line(command, folder):
    path = folder / "demo.ssp"
    path.write_bytes(path.read_bytes()[:-1000])
    status, _, err = command("run", "demo.ssp")
    assert status == 1
    assert len(err) == 1
    assert "demo.ssp: cannot be unpacked, the file is damaged" in err[0]


def test_check_prints_everything_that_is_wrong_with_an_fmu(command, folder, fmus):
    path = folder / "odd.fmu"
    path.write_bytes(fmus["gain"].read_bytes())
    repacked(
        path,
        lambda f: {
            "modelDescription.xml": f["modelDescription.xml"].replace(b'unit="1"', b'unit="parsec"')
        },
    )
    status, out, err = command("check", path)
    assert (status, out) == (0, ["odd.fmu: fine (1 inputs, 1 outputs, 1 parameters), 3 warnings"])
    assert len(err) == 3  # u, y and k
    assert all(line.startswith("harness: warning: odd.fmu: ") for line in err)
    assert all("parsec" in line for line in err)
    status, out, strict = command("check", path, "--strict")
    assert (status, out) == (1, [])
    assert [line.replace("odd.fmu: warning", "warning: odd.fmu") for line in strict] == err
    repacked(
        path,
        lambda f: {
            "modelDescription.xml": f["modelDescription.xml"].replace(b"fmiVersion", b"version")
        },
    )
    assert command("check", path)[0] == 1


def test_plot_and_report_of_a_file_that_is_no_result_are_reported_in_one_line(command, folder):
    (folder / "x.csv").write_text("hello\n")
    for name in ("plot", "report"):
        status, _, err = command(name, "x.csv")
        assert status == 1
        assert err == ["harness: x.csv: cannot be read (the first column must be named time)"]


def test_an_internal_error_is_one_line_unless_a_traceback_is_requested(command, monkeypatch):
    monkeypatch.setattr("harness.cli.showing.listed", lambda _: 1 / 0)
    status, _, err = command("list")
    assert status == 1
    assert err == [
        "harness: internal error (HARNESS_TRACEBACK=1 prints the traceback): "
        "ZeroDivisionError: division by zero"
    ]
    monkeypatch.setenv("HARNESS_TRACEBACK", "1")
    with pytest.raises(ZeroDivisionError):
        command("list")


def test_an_error_of_another_stream_is_not_reported_as_one_of_standard_output(command, monkeypatch):
    def unreachable(_):
        raise OSError("AF_UNIX path too long")

    monkeypatch.setattr("harness.cli.showing.listed", unreachable)
    status, _, err = command("list")
    assert (status, err) == (
        1,
        [
            "harness: internal error (HARNESS_TRACEBACK=1 prints the traceback): "
            "OSError: AF_UNIX path too long"
        ],
    )


# ---- as a process


def process(*arguments, **options):
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    return start(
        [sys.executable, "-m", "harness", *map(str, arguments)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        **options,
    )


@pytest.mark.parametrize("executor", ["c", "python"])
def test_ctrl_c_ends_the_run_with_one_line_and_retains_what_was_recorded(fmus, tmp_path, executor):
    text = 'name = "endless"\n[experiment]\nstop = 1e6\nstep = 1.0\n[components]\na = "slow"\n'
    write_ssp(system_of(tomllib.loads(text), fmus), tmp_path / "endless.ssp")
    running = process("run", "endless.ssp", "-o", "x.csv", "--executor", executor, cwd=tmp_path)
    until((tmp_path / "stepping").exists, "step")
    running.send_signal(signal.SIGINT)
    out, err = running.communicate(timeout=LONGEST)
    assert running.returncode == 1
    assert out == ""
    assert re.fullmatch(
        r"harness: endless: interrupted \(at t = \d+ s\); "
        r"\d+ recorded rows are in x\.partial\.csv\n",
        err,
    )
    retained = result_files.read(tmp_path / "x.partial.csv")
    assert not retained.complete
    assert retained["a.n"].tolist() == list(range(len(retained.time)))


def test_no_progress_bar_in_a_pipe(folder):
    out, err = process("run", "demo.ssp", "-o", "x.csv", cwd=folder).communicate(timeout=LONGEST)
    assert err == ""
    assert len(out.splitlines()) == 1


def test_a_reader_that_closes_the_pipe_causes_no_error_message(folder):
    running = process("list", "demo.ssp", cwd=folder)
    running.stdout.close()
    assert "Traceback" not in running.stderr.read()
    running.stderr.close()
    running.wait(timeout=LONGEST)


# ---- linearize


def test_linearize_writes_matrices_with_names(command, folder):
    status, out, err = command(
        "linearize", "integrator", "--step", "0.5", "--set", "u=2", "-o", "new/model.npz"
    )
    assert (status, err) == (0, [])
    assert out == ["new/model.npz: 1 states, 1 inputs, 1 outputs"]
    with np.load(folder / "new" / "model.npz") as model:
        assert model["x_names"].tolist() == ["y"]
        assert model["A"].tolist() == [[pytest.approx(1.0)]]
        assert model["B"].tolist() == [[pytest.approx(0.5)]]


@pytest.mark.parametrize(
    ("arguments", "status", "line"),
    [
        (["integratr", "-o", "x.npz"], 2, "integratr: there is no such FMU (close: integrator)"),
        (["integrator", "-o", "x.npz", "--set", "v=1"], 2, "--set v: there is no such variable"),
        (
            ["integrator", "-o", "demo.ssp/x.npz"],
            1,
            "demo.ssp/x.npz: cannot be written (File exists)",
        ),
    ],
)
def test_an_impossible_linear_model_is_reported_in_one_line(command, arguments, status, line):
    assert command("linearize", *arguments) == (status, [], [f"harness: {line}"])
