# SPDX-License-Identifier: BSD-2-Clause
"""Errors name what the user typed: option, value, rule, and what to write instead."""

from __future__ import annotations

import re
import tomllib
import zipfile

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from harness.authoring.build import build
from harness.cli.app import main
from harness.errors import RejectedValueError, UsageError
from harness.files import paths
from harness.master.messages import as_typed, rejections, without
from harness.spelling import did_you_mean
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from harness.system.values import base


@pytest.fixture
def reported(capsys):
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
def test_a_rejected_value_is_reported_as_it_was_typed(reported, value, line):
    assert reported("run", *SHORT, "--set", value) == (2, [f"harness: {line}"])


@pytest.mark.parametrize(
    ("base", "place", "values", "sizes"),
    [
        ("sync_approach_thrusters", "propulsion.thrust_nominal", [0.5] * 17, ("16", "17")),
        ("sync_approach_thrusters", "propulsion.thrust_nominal", [0.5] * 12, ("16", "12")),
        (
            "sync_approach_thrusters",
            "allocation.thruster_position",
            [[1, 0, 0]] * 17,
            ("16 x 3", "17 x 3"),
        ),
        ("sync_approach", "servicer.A_w", [[12, 0, 0, 1]] * 3, ("3 x 3", "3 x 4")),
        ("sync_approach", "servicer.wheel_speed_0", [0, 0, 0, 0], ("3", "4")),
    ],
)
def test_another_number_of_thrusters_or_wheels_is_reported_in_one_line_before_the_first_step(
    reported, tmp_path, base, place, values, sizes
):
    component, name = place.split(".")
    (tmp_path / "mine.toml").write_text(
        f'extends = "{base}"\nname = "mine"\n[parameters.{component}]\n{name} = {values}\n'
    )
    line = (
        f"harness: mine.toml: parameters.{place}: expected {sizes[0]} elements, got {sizes[1]} "
        "elements; the FMU fixes the number of elements"
    )
    for command in (["check"], ["run", "-o", tmp_path / "x.nc"]):
        assert reported(command[0], tmp_path / "mine.toml", *command[1:]) == (1, [line])
    assert not (tmp_path / "x.nc").exists()


def test_two_rejected_values_are_two_lines(reported):
    status, lines = reported(
        "run", *SHORT, "--set", "servicer.mass_0=-5", "--set", "servicer.t_att=-1",
        "--set", "servicer.max_step=-1",
    )  # fmt: skip
    assert status == 2
    assert lines[0] == "harness: --set servicer.mass_0=-5: must be > 0"
    assert lines[1:] == ["harness: --set servicer.max_step=-1: must be > 0"]


def test_a_rejected_value_of_a_file_names_component_and_parameter(reported, tmp_path):
    (tmp_path / "p.toml").write_text("[servicer]\nmass_0 = -5\n")
    assert reported("run", *SHORT, "--params", tmp_path / "p.toml") == (
        1,
        ["harness: servicer: mass_0 = -5: must be > 0 (at t = 0 s)"],
    )


@pytest.mark.parametrize(
    ("system", "values", "lines"),
    [
        (
            "sync_approach",
            ["servicer.J_S=[[1,0,0],[0,1,0],[0,0,5]]"],
            [
                "must satisfy the triangle inequality "
                "(no principal moment above the sum of the other two)",
                "J_S - A_w = -14 must be positive definite",
            ],
        ),
        ("sync_approach", ["servicer.J_S[1,2]=1"], ["J_S = 1 must be symmetric", "J_S - A_w = 1 "]),
        ("sync_approach", ["guidance.p_T=[1,1,0]"], ["must be a unit vector"]),
        ("relay_approach", ["guidance.rho2=0.001"], ["rho1 = 0.004 must be below rho2"]),
        (
            "ppc_tracking",
            ["controller.range.beta=1e9"],
            ["range.lambda * range.beta = 4.3e+09 must be below 1"],
        ),
        (
            "sync_approach_navigated",
            ["relative_filter.q_KS=[1,1,0,0]"],
            ["|q_KS| = 1.41421356 must be a unit quaternion"],
        ),
        ("transposition", ["guidance.swing_duration=1e5"], ["window = 5400 must not end before "]),
    ],
)
def test_a_rule_over_several_numbers_blames_what_was_typed(reported, system, values, lines):
    changes = [text for value in values for text in ("--set", value)]
    status, stated = reported("run", system, "-q", "-o", "x.nc", *changes)
    assert status == 2
    typed = " ".join(f"--set {value}" for value in values)
    assert len(stated) == len(lines)
    for line, required in zip(stated, lines, strict=True):
        assert line.startswith(f"harness: {typed}: {required}")


def test_linearize_states_a_rejected_value_as_it_was_typed(reported, tmp_path):
    required = (2, ["harness: --set mass_0=-5: must be > 0"])
    assert (
        reported("linearize", "servicer", "-o", tmp_path / "x.npz", "--set", "mass_0=-5")
        == required
    )


MANY = settings().max_examples * (2 if settings().max_examples < 100 else 8)
"""Examples of what costs little."""


def rejected(message, names):
    return RejectedValueError("servicer", 0.0, rejections(message, names))


def test_only_values_that_were_typed_are_blamed():
    error = rejected("mass_0 = -5: must be > 0; e = 2: must be below 1", ["mass_0", "e"])
    assert str(error) == ("servicer: mass_0 = -5: must be > 0; e = 2: must be below 1 (at t = 0 s)")
    assert as_typed(error, {"servicer.mass_0": "-5"}, "servicer.") is error
    assert as_typed(error, {"target.mass_0": "-5", "target.e": "2"}, "servicer.") is error
    both = as_typed(error, {"servicer.mass_0": "-5", "servicer.e": "2"}, "servicer.")
    assert isinstance(both, UsageError)
    assert str(both).splitlines() == [
        "--set servicer.mass_0=-5: must be > 0",
        "--set servicer.e=2: must be below 1",
    ]


def test_a_value_is_not_blamed_for_another_element_or_for_an_article():
    names = ["K[1]", "K[2]", "a", "p"]
    other = rejected("K[2] = -1: must be >= 0", names)
    assert as_typed(other, {"servicer.K[1]": "-1"}, "servicer.") is other
    axis = rejected("p = 2: must be a unit vector", names)
    assert as_typed(axis, {"servicer.a": "1"}, "servicer.") is axis
    start = rejected("p = 0: must be > 0 when the start is given by elements (a > 0)", names)
    assert str(as_typed(start, {"servicer.a": "1"}, "servicer.")).startswith(
        "--set servicer.a=1: p = 0 must be > 0"
    )


def test_errors_of_fixed_values_are_reported_apart_from_errors_of_varied_ones():
    names = ["rho1", "rho2", "e"]
    error = rejected("rho1 = 5: must be below rho2; e = 2: must be below 1", names)
    assert [r.name for r in without(error, ["servicer.rho2"]).rejections] == ["e"]
    assert without(error, ["servicer.rho1", "servicer.e"]) is None
    assert len(without(error, ["target.rho1"]).rejections) == 2


@settings(max_examples=MANY)
@given(st.text(), st.lists(st.text(max_size=5), max_size=3))
@example("K[2] = -1: must be >= 0", ["K[1]", "K[2]"])
@example("J - A = -14: must be positive definite; e = 2: no", ["e", "J[1,1]"])
def test_any_message_is_about_known_parameters_or_about_none(message, names):
    for rejection in rejections(message, names):
        assert any(name in rejection.name or base(name) in rejection.name for name in names)


# ---- check


@pytest.mark.parametrize(
    "changes",
    [
        ("--set", "servicer.mass_0=-5"),
        ("--set", "servicer.J_S=[[1,0,0],[0,1,0],[0,0,5]]"),
        ("--swap", "controller=target"),
        ("--swap", "controller=nothing"),
        ("--params", "nothing"),
        ("--on", "controller=abacus"),
        ("--map", "a=b"),
        ("--latency", "controller=-1"),
        ("--step", "7"),
        ("--require", "guidance.nothing > 3"),
    ],
    ids=" ".join,
)
def test_check_reports_for_changes_what_a_run_with_them_reports(reported, changes):
    status, lines = reported("check", "sync_approach", *changes)
    run_status, run_lines = reported("run", "sync_approach", "-q", "-o", "x.nc", *changes)
    assert lines == run_lines
    assert status in (1, run_status)
    assert run_status != 0


def test_check_evaluates_the_values_of_a_system_and_of_all_its_parameter_sets(reported, tmp_path):
    toml = (
        'name = "heavy"\n[open]\n"a.F_S" = [0, 0, 0]\n"a.M_S" = [0, 0, 0]\n"a.mdot" = 0\n'
        '"a.wheel_accel_cmd" = [0, 0, 0]\n'
        '[experiment]\nstop = 2.0\nstep = 1.0\n[components]\na = "servicer"\n'
        "[sets.light.a]\nmass_0 = -1.0\n"
    )
    path = tmp_path / "heavy.ssp"
    write_ssp(system_of(tomllib.loads(toml), paths.fmus()), path)
    line = "harness: a: mass_0 = -1: must be > 0 (at t = 0 s)"
    assert reported("check", path) == (1, [line])
    assert reported("check", path, "--params", "default") == (0, [])
    assert reported("run", path, "-q", "-o", tmp_path / "x.nc", "--params", "light") == (1, [line])


def test_check_knows_no_changes_of_an_fmu(reported):
    assert reported("check", "servicer", "--set", "servicer.mass_0=5") == (
        2,
        ["harness: --set: is valid only for a system, and servicer is an FMU"],
    )


# ---- compare


@pytest.mark.parametrize(
    ("value", "line"),
    [
        *(
            (
                f"servicer.mass_0={text}",
                f"--vary servicer.mass_0={text}: expected a range first:last:step, a whole number",
            )
            for text in ("0:1", "1:b:2", "0:1:0.3")
        ),
        (
            "servicer.mass=1,2",
            "--vary servicer.mass: is an output and cannot be set (close: mass_0",
        ),
        ("servicer.rho_0_H=1,2", "--vary servicer.rho_0_H: expected 3 elements, got a number"),
        ("servicer.mass_0", "--vary servicer.mass_0: expected name=value"),
        ("servicer.mass_0=1,,2", "--vary servicer.mass_0=1,,2: a value is missing"),
        ("servicer.mass_0=1,1", "--vary servicer.mass_0=1,1: 1 is given twice"),
    ],
)
def test_a_mistake_in_vary_is_not_blamed_on_set(reported, value, line):
    status, lines = reported("compare", "sync_approach", "--vary", value)
    assert status == 2
    assert len(lines) == 1
    assert lines[0].startswith(f"harness: {line}")


def test_a_comparison_is_rejected_for_a_fixed_value_and_continues_after_a_varied_one(
    reported, tmp_path
):
    given = "compare", "relay_approach", "--vary", "guidance.rho1=5,0.001", "--stop", "1", "-q"
    given += "--no-figures", "-o", tmp_path
    status, lines = reported(*given, "--set", "guidance.zeta2=1e9")
    assert status == 2
    assert lines == ["harness: --set guidance.zeta2=1e9: must be below zeta1"]
    assert not list(tmp_path.iterdir())
    status, lines = reported(*given)
    assert status == 1
    assert lines == ["harness: guidance.rho1=5: --vary guidance.rho1=5: must be below rho2"]
    assert (tmp_path / "guidance.rho1_0.001.nc").is_file()


def test_an_error_in_set_is_reported_for_set(reported):
    status, lines = reported(
        "compare", "sync_approach", "--vary", "servicer.mass_0=1,2", "--set", "servicer.mas_0=1"
    )
    assert status == 2
    assert lines[0].startswith("harness: --set servicer.mas_0: there is no such variable")


def test_a_note_on_all_variants_is_reported_once(reported, tmp_path, caplog):
    status, _ = reported(
        "compare", "sync_approach", "--vary", "servicer.mass_0=90,100,110", "--stop", "0.5",
        "--set", "controller.sample_period=0.25", "-o", tmp_path, "--no-figures", "-q",
    )  # fmt: skip
    assert status == 0
    assert len([m for m in caplog.messages if "controller.sample_period = 0.25" in m]) == 1


# ---- times, systems, FMUs


@pytest.mark.parametrize("option", ["--stop", "--step"])
@pytest.mark.parametrize("text", ["10min", "1h", "0.1s", "soon", "1,5", ""])
def test_a_time_that_is_no_number_is_reported_with_its_unit(reported, option, text):
    assert reported("run", "sync_approach", option, text) == (
        2,
        [f"harness: Invalid value for '{option}': {text}: expected a number of seconds, as in 600"],
    )


@pytest.mark.parametrize("text", ["0", "-1", "nan"])
def test_patience_must_be_some_time(reported, text):
    line = f"Invalid value for '--patience': {text}: expected a number of seconds above 0, as in 60"
    assert reported("run", "sync_approach", "--patience", text) == (2, [f"harness: {line}"])


def test_a_system_without_times_is_not_reported_to_run_none(fmus, tmp_path, capsys):
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


@pytest.mark.parametrize("version", ["1.0", "4.0"])
def test_an_fmu_of_another_version_is_named_as_such(reported, fmus, tmp_path, version):
    path = tmp_path / "odd.fmu"
    with zipfile.ZipFile(fmus["gain"]) as old, zipfile.ZipFile(path, "w") as new:
        for entry in old.namelist():
            data = old.read(entry)
            if entry == "modelDescription.xml":
                data = data.replace(b'fmiVersion="2.0"', f'fmiVersion="{version}"'.encode())
            new.writestr(entry, data)
    status, lines = reported("run", *SHORT, "--swap", f"controller={path}")
    assert status == 1
    assert lines == [
        f"harness: odd.fmu: FMI {version} is not supported; use an FMU of FMI 2.0 or FMI 3.0"
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


def test_the_exception_of_an_fmu_in_python_is_reported(reported, tmp_path):
    (tmp_path / "broken.py").write_text(BROKEN)
    path = build(tmp_path / "broken.py")
    text = 'name = "tea"\n[experiment]\nstop = 2.0\nstep = 1.0\n[components]\na = "broken"\n'
    write_ssp(system_of(tomllib.loads(text), {"broken": path}), tmp_path / "tea.ssp")
    status, lines = reported("run", tmp_path / "tea.ssp", "-q", "-o", "x.nc")
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
            "--set servicer.J_S: expected 3 x 3 elements, got 3 elements; the FMU fixes the number "
            "of elements",
        ),
        (["new", "my_pd"], "new my_pd: expected `harness new controller|sensor|plant|"),
        (["build", "text.txt"], "text.txt: expected an existing .c or .py file"),
        (["draw", "sync_approach", "-o", "x.docx"], "x.docx: a diagram is written as"),
        (["export", "sync_approach", "x.zip"], "x.zip: a system is written to NAME.ssp, NAME.fmu"),
        (["linearize", "servicer", "-o", "x.txt"], "--output x.txt: expected a file NAME.npz"),
    ],
)
def test_common_mistakes_are_answered_with_what_to_type(
    reported, tmp_path, monkeypatch, arguments, line
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.txt").write_text("hello\n")
    status, lines = reported(*arguments)
    assert status == 2
    assert len(lines) == 1
    assert lines[0].startswith(f"harness: {line}")
    assert {path.name for path in tmp_path.iterdir()} == {"text.txt"}
