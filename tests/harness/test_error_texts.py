# SPDX-License-Identifier: BSD-2-Clause
"""Errors speak of what the user typed: option, value, rule, and what to write instead."""

from __future__ import annotations

import re
import tomllib
import zipfile

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.authoring.build import build
from harness.cli.app import main
from harness.errors import RunError, UsageError
from harness.master.refusals import as_typed, refusals
from harness.spelling import did_you_mean
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp


@pytest.fixture
def said(capsys):
    """Run a command line; gives exit status and the lines on stderr."""

    def run(*arguments):
        status = main([str(a) for a in arguments])
        return status, capsys.readouterr().err.splitlines()

    return run


SHORT = ("sync_approach", "-q", "-o", "x.nc", "--stop", "0.1")


@pytest.mark.parametrize(
    ("value", "line"),
    [
        ("servicer.mass_0=-5", "--set servicer.mass_0=-5: must be > 0"),
        ("servicer.use_J2=0.5", "--set servicer.use_J2=0.5: must be 0 or 1"),
        (
            "controller.K_rho=[1,-1,1]",
            "--set controller.K_rho=[1,-1,1]: K_rho[2] must be >= 0",
        ),
        (
            "servicer.rho_0_H=0.01,0.02,0",
            "--set servicer.rho_0_H: expected 3 elements, got '0.01,0.02,0'; write [0.01,0.02,0]",
        ),
        (
            "servicer.rho_0_H=5",
            "--set servicer.rho_0_H: expected 3 elements, got a number; write [5, 5, 5]",
        ),
    ],
)
def test_a_refused_value_is_told_as_it_was_typed(said, value, line):
    assert said("run", *SHORT, "--set", value) == (2, [f"harness: {line}"])


def test_two_refused_values_are_two_lines(said):
    status, lines = said(
        "run", *SHORT, "--set", "servicer.mass_0=-5", "--set", "servicer.t_att=-1",
        "--set", "servicer.max_step=-1",
    )  # fmt: skip
    assert status == 2
    assert lines[0] == "harness: --set servicer.mass_0=-5: must be > 0"
    assert lines[1:] == ["harness: --set servicer.max_step=-1: must be > 0"]


def test_a_refused_value_of_a_file_names_component_and_parameter(said, tmp_path):
    (tmp_path / "p.toml").write_text("[servicer]\nmass_0 = -5\n")
    assert said("run", *SHORT, "--params", tmp_path / "p.toml") == (
        1,
        ["harness: servicer: mass_0 = -5: must be > 0 (at t = 0 s)"],
    )


def test_only_values_that_were_typed_are_blamed():
    error = RunError("servicer", 0.0, "mass_0 = -5: must be > 0; e = 2: must be below 1")
    assert as_typed(error, {"servicer.mass_0": "-5"}) is error
    assert as_typed(error, {"target.mass_0": "-5", "target.e": "2"}) is error
    both = as_typed(error, {"servicer.mass_0": "-5", "servicer.e": "2"})
    assert isinstance(both, UsageError)
    assert str(both).splitlines() == [
        "--set servicer.mass_0=-5: must be > 0",
        "--set servicer.e=2: must be below 1",
    ]


@settings(max_examples=200)
@given(st.text(), st.lists(st.text(max_size=5), max_size=3))
def test_any_message_is_about_known_parameters_or_about_none(message, names):
    assert all(name in names or name.split("[")[0] in names for name in refusals(message, names))


# ---- compare


@pytest.mark.parametrize(
    ("value", "line"),
    [
        (
            "servicer.mass_0=0:1",
            "--vary servicer.mass_0=0:1: a range of values is first:last:step, three numbers, as "
            "in 0:1:0.1",
        ),
        (
            "servicer.mass_0=1:b:2",
            "--vary servicer.mass_0=1:b:2: a range of values is first:last:step, three numbers, as "
            "in 0:1:0.1",
        ),
        (
            "servicer.mass_0=0:1:0.3",
            "--vary servicer.mass_0=0:1:0.3: the range does not end at 1 after whole steps",
        ),
        ("servicer.mass=1,2", "--vary servicer.mass: there is no such variable"),
        ("servicer.rho_0_H=1,2", "--vary servicer.rho_0_H: expected 3 elements, got a number"),
        ("servicer.mass_0", "--vary servicer.mass_0: expected name=value"),
        ("servicer.mass_0=1,,2", "--vary servicer.mass_0=1,,2: a value is missing"),
        ("servicer.mass_0=1,1.0", "--vary servicer.mass_0=1,1.0: 1 is given twice"),
    ],
)
def test_a_mistake_in_vary_is_not_blamed_on_set(said, value, line):
    status, lines = said("compare", "sync_approach", "--vary", value)
    assert status == 2
    assert len(lines) == 1
    assert lines[0].startswith(f"harness: {line}")


def test_a_mistake_in_set_stays_one_of_set(said):
    status, lines = said(
        "compare", "sync_approach", "--vary", "servicer.mass_0=1,2", "--set", "servicer.mas_0=1"
    )
    assert status == 2
    assert lines[0].startswith("harness: --set servicer.mas_0: there is no such variable")


def test_a_note_on_all_variants_is_said_once(said, tmp_path, caplog):
    status, _ = said(
        "compare", "sync_approach", "--vary", "servicer.mass_0=90,100,110", "--stop", "0.5",
        "--set", "controller.sample_period=0.25", "-o", tmp_path, "--no-figures", "-q",
    )  # fmt: skip
    assert status == 0
    assert len([m for m in caplog.messages if "controller.sample_period = 0.25" in m]) == 1


# ---- times, systems, FMUs


@pytest.mark.parametrize("option", ["--stop", "--step"])
@pytest.mark.parametrize("text", ["10min", "1h", "0.1s", "soon", "1,5", ""])
def test_a_time_that_is_no_number_is_told_with_its_unit(said, option, text):
    assert said("run", "sync_approach", option, text) == (
        2,
        [f"harness: Invalid value for '{option}': {text}: expected a number of seconds, as in 600"],
    )


def test_a_system_without_times_is_not_said_to_run_none(fmus, tmp_path, capsys):
    text = 'name = "bare"\n[experiment]\nstop = 2.0\nstep = 1.0\n[components]\na = "counter"\n'
    path = tmp_path / "bare.ssp"
    write_ssp(system_of(tomllib.loads(text), fmus), path)
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    ssd = files["SystemStructure.ssd"].decode()
    bare = re.sub(r' stopTime="[^"]*"', "", ssd)
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in (files | {"SystemStructure.ssd": bare.encode()}).items():
            archive.writestr(name, data)
    status = main(["list", str(path)])
    out, err = capsys.readouterr()
    assert (status, err) == (0, "")
    assert "None" not in out
    assert "with --stop" in out


@pytest.mark.parametrize("version", ["1.0", "3.0"])
def test_an_fmu_of_another_version_is_named_as_such(said, fmus, tmp_path, version):
    path = tmp_path / "odd.fmu"
    with zipfile.ZipFile(fmus["gain"]) as old, zipfile.ZipFile(path, "w") as new:
        for entry in old.namelist():
            data = old.read(entry)
            if entry == "modelDescription.xml":
                data = data.replace(b'fmiVersion="2.0"', f'fmiVersion="{version}"'.encode())
            new.writestr(entry, data)
    status, lines = said("run", *SHORT, "--swap", f"controller={path}")
    assert status == 1
    assert lines == [
        "harness: odd.fmu: only FMI 2.0 co-simulation FMUs can be run, this one is FMI " + version
    ]


BROKEN = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real

class Broken(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y = 0.0
        self.register_variable(Real("y", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        raise ValueError("divided by the price of tea")
"""


def test_the_exception_of_an_fmu_in_python_is_told(said, tmp_path):
    (tmp_path / "broken.py").write_text(BROKEN)
    path = build(tmp_path / "broken.py").path
    text = 'name = "tea"\n[experiment]\nstop = 2.0\nstep = 1.0\n[components]\na = "broken"\n'
    write_ssp(system_of(tomllib.loads(text), {"broken": path}), tmp_path / "tea.ssp")
    status, lines = said("run", tmp_path / "tea.ssp", "-q", "-o", "x.nc")
    assert status == 1
    assert lines[-1].startswith("harness: a: step failed: ")
    assert "ValueError('divided by the price of tea')" in lines[-1]


def test_doubled_names_are_offered_once():
    assert did_you_mean("aab", ["aaa", "aaa", "aaa"]) == " (close: aaa)"
    many = [f"name_{i}" for i in range(50)] * 2
    assert did_you_mean("name_7x", many).count("name_7,") <= 1


# ---- first steps of a newcomer


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["run", ""], "(nothing): there is no such system"),
        (["show", ""], "(nothing): there is no such system or FMU"),
        (["run", "sync_approach", "--swap", "controller="], "--swap controller=: expected name="),
        (["run", "sync_approach", "--swap", "=target"], "--swap =target: expected name=value"),
        (["run", "sync_approach", "--set", "=1"], "--set =1: expected name=value"),
        (
            ["run", "sync_approach", "--swap", "controller=pid_controller", "--map", "="],
            "--map =: expected name=value",
        ),
        (
            ["run", "sync_approach", "--set", "servicer.J_S=[1,2,3]"],
            "--set servicer.J_S: expected 3 x 3 elements, got 3 elements; write its rows, as in [[",
        ),
        (["new", "my_pd"], "new my_pd: write harness new controller NAME"),
        (["new", "plant", "x"], "new plant: write harness new controller NAME"),
        (["build", "text.txt"], "text.txt: an FMU is built from a .c or .py file"),
        (["draw", "sync_approach", "-o", "x.docx"], "x.docx: a diagram is written as"),
        (["export", "sync_approach", "x.zip"], "x.zip: a system is written to NAME.ssp, NAME.fmu"),
        (["linearize", "servicer", "-o", "x.txt"], "--output x.txt: a linear model is written to"),
    ],
)
def test_what_a_newcomer_gets_wrong_is_answered_with_what_to_write(
    said, tmp_path, monkeypatch, arguments, line
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.txt").write_text("hello\n")
    status, lines = said(*arguments)
    assert status == 2
    assert len(lines) == 1
    assert lines[0].startswith(f"harness: {line}")
    assert {path.name for path in tmp_path.iterdir()} == {"text.txt"}
