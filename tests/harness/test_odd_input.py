# SPDX-License-Identifier: BSD-2-Clause
"""For any input of a user: a result or a reason, never a traceback, an internal error or a hang."""

from __future__ import annotations

import io
import tomllib
import unicodedata
import zipfile
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import psutil
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from harness.cli.app import main
from harness.errors import HarnessError, RunError
from harness.master import isolated
from harness.master.changes import apply
from harness.master.simulation import Simulation
from harness.results.files import read
from harness.ssp.build import system_of
from harness.ssp.library import load
from harness.ssp.writer import write_ssp
from harness.studies.variants import combinations
from harness.system.values import coerce, parse
from tests.harness.demo import TOML

LONG = 2000
"""Macro steps of runs that are not worth their time here."""

ODD = [
    "", " ", "nan", "inf", "-inf", "1e300", "1e-320", "-1", "0", "1e400", "9" * 400, "1" * 5000,
    str(2**31), str(2**32), str(2**63), str(2**64), "true", "[", "[" * 9000, "[]", "[[]]",
    "[1,[2]]", "{a=1}", "'", '"', '"""', "2020-01-01", "07:32:00", "1979-05-27T07:32:00Z", "0x10",
    "1_000", "1,2", "1:2", "1:2:3", "0:1:0", "a=b", "=", "x" * 5000, "\x00", "\x1b[31m", "\n",
    "a\nb = 1", "\udce4", "ü", "%s%n", "../../x", "/", ".", "\\", "count.n",
]  # fmt: skip
TEXT = st.one_of(
    st.sampled_from(ODD),
    st.text(max_size=12),
    st.floats().map(repr),
    st.integers(-(2**70), 2**70).map(str),
    st.lists(st.floats(allow_nan=False), max_size=4).map(repr),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory, fmus):
    folder = tmp_path_factory.mktemp("odd")
    write_ssp(system_of(tomllib.loads(TOML), fmus), folder / "demo.ssp")
    return folder


@pytest.fixture(autouse=True)
def _short_runs(monkeypatch, folder, project_fmus):
    """Runs in this process, and no long ones."""
    monkeypatch.chdir(folder)

    def simulate(system, **options):
        for name in ("in_process", "patience", "progress"):
            options.pop(name, None)
        simulation = Simulation(system, **options)
        if simulation.steps > LONG:
            raise RunError("demo", 0.0, "too long for a test")
        with simulation:
            simulation.advance()
            return simulation.result()

    monkeypatch.setattr(isolated, "simulate", simulate)


def outcome(*arguments):
    out, err = io.StringIO(), io.StringIO()
    with redirect_stdout(out), redirect_stderr(err):
        status = main(list(arguments))
    lines = err.getvalue().splitlines()
    assert status in (0, 1, 2)
    assert "internal error" not in err.getvalue()
    assert "Traceback" not in err.getvalue()
    assert all(line.startswith("harness: ") for line in lines), lines
    assert bool(lines) or status == 0
    odd = {unicodedata.category(c) for line in lines for c in line if c != "\t"}
    assert not odd & {"Cc", "Cf", "Cs", "Zl", "Zp"}, lines
    return status


OPTIONS = {
    "--stop": "{}", "--step": "{}", "--every": "{}", "--params": "{}", "--algorithm": "{}",
    "--executor": "{}",
    "--set": "twice.k={}", "--swap": "twice={}", "--latency": "twice={}", "-o": "{}.csv",
}  # fmt: skip


@pytest.mark.parametrize("option", OPTIONS)
@given(text=TEXT)
def test_values_of_options_of_run(option, text):
    value = OPTIONS[option].format(text)
    if option == "-o":
        if "/" in text or len(text) > 20:
            return
        outcome("run", "demo.ssp", "-o", f"out/{value}")
    else:
        outcome("run", "demo.ssp", "-q", "-o", "out/x.csv", option, value)


@pytest.mark.parametrize("every", [6, pytest.param(1, marks=pytest.mark.long)])
@pytest.mark.parametrize("option", [option for option in OPTIONS if option != "-o"])
def test_known_odd_values_of_options_of_run(option, every):
    """A sixth of the values for each option, all of them for six options after one another."""
    first = list(OPTIONS).index(option) % every
    for text in ODD[first::every]:
        value = OPTIONS[option].format(text)
        outcome("run", "demo.ssp", "-q", "-o", "out/x.csv", option, value)


@pytest.mark.parametrize("option", ["--set", "--swap", "--latency"])
@given(text=TEXT)
def test_whole_assignments(option, text):
    outcome("run", "demo.ssp", "-q", "-o", "out/x.csv", option, text)


@given(text=TEXT, option=st.sampled_from(["--at", "--step", "--set"]))
@example("nan", "--at")
@example("1e300", "--at")
@example("0", "--step")
@example("1e-320", "--step")
def test_values_of_options_of_linearize(folder, text, option):
    fmu = next(iter(load_demo(folder)))
    value = f"k={text}" if option == "--set" else text
    try:
        if option == "--at" and 100 < float(text) < 1e12:
            return  # a long way to go
    except ValueError:
        pass
    if option == "--step" and value not in ("0", "nan", "inf", "1e-320", "-1"):
        return
    outcome("linearize", fmu, "-o", "out/model.npz", option, value)


def load_demo(folder):
    with load(folder / "demo.ssp") as system:
        yield str(next(c.fmu for c in system.components if c.name == "twice"))


@pytest.mark.parametrize(
    "command",
    [
        *("run", "check", "list", "draw", "compare", "linearize", "plot", "report", "convert"),
        *("requirements", "campaign", "worst", "sensitivity"),
    ],
)
@given(text=TEXT)
@example("a" * 300)
def test_names_of_systems_and_files(command, text):
    if text.startswith("-") or text in ("demo.ssp",):
        return
    further = {
        "compare": ["--algorithm", "jacobi,gauss-seidel"],
        "linearize": ["-o", "out/m.npz"],
        "convert": ["-o", "out/x.csv"],
    }
    outcome(command, text, *further.get(command, []))


@given(texts=st.lists(TEXT, max_size=3), name=st.sampled_from(["twice.k", "bad.t_fail", "x", ""]))
def test_values_side_by_side(folder, texts, name):
    """Only what compare would run is made: runs of their own take too long here."""
    for option in ("set", "swap", "latency", "params", "algorithm"):
        value = ",".join(texts)
        try:
            variants = combinations({}, [(option, f"{name}={value}")])
            assert len({variant.file for variant in variants}) == len(variants)
            with load(folder / "demo.ssp") as system:
                for variant in variants[:3]:
                    apply(system, **variant.changes)
        except HarnessError as error:
            assert str(error)


# ---- TOML

VALUES = st.recursive(
    st.one_of(st.booleans(), st.integers(), st.floats(), st.text(max_size=5), st.dates()),
    lambda inner: st.one_of(
        st.lists(inner, max_size=3), st.dictionaries(st.text(max_size=3), inner, max_size=3)
    ),
    max_leaves=6,
)
KEYS = st.sampled_from(["shared", "parameters", "twice", "bad", "k", "t_fail", "", "x"])


@given(tables=st.dictionaries(KEYS, st.one_of(VALUES, st.dictionaries(KEYS, VALUES, max_size=3))))
def test_tables_of_parameters(folder, tables):
    from harness.system.graph import read_interfaces
    from harness.system.tables import Assignments

    with load(folder / "demo.ssp") as system:
        values = Assignments(read_interfaces(system))
    values.tables(tables)
    assert all(isinstance(problem, str) for problem in values.problems)


@given(
    text=TEXT,
    key=st.sampled_from(["shared", "parameters", "twice.k", "[twice]\nk", "[[twice]]\nk"]),
)
@example("[1]", "shared")
@example("[" * 9000, "twice.k")
@example("1" * 5000, "twice.k")
def test_files_of_parameters(folder, text, key):
    (folder / "p.toml").write_text(f"{key} = {text}", encoding="utf-8", errors="surrogateescape")
    outcome("run", "demo.ssp", "-q", "-o", "out/x.csv", "--params", "p.toml")


@given(
    table=st.sampled_from(
        ["name", "experiment", "components", "connections", "parameters", "open", "sets", "swap"]
    ),
    value=VALUES,
)
def test_systems_in_toml(fmus, table, value):
    try:
        system_of(tomllib.loads(TOML) | {table: value}, fmus)
    except HarnessError as error:
        assert str(error)


# ---- numbers


@given(st.integers())
def test_integers_are_never_wrapped(number):
    try:
        assert coerce(number, "Integer") == number
    except ValueError:
        assert not -(2**31) <= number < 2**31


@given(st.text())
def test_any_text_has_a_value(text):
    value = parse(text)
    for kind in ("Real", "Integer", "Boolean", "String", "Enumeration"):
        try:
            coerce(value, kind)
        except ValueError as error:
            assert str(error)


# ---- names in FMUs

NAMES = st.text(st.characters(codec="utf-8", exclude_characters="\x00"), min_size=1, max_size=8)


def renamed(fmu, path, name):
    """The FMU `counter` with another name for its first output."""
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(path, "w") as new:
        for entry in old.namelist():
            data = old.read(entry)
            if entry == "modelDescription.xml":
                escaped = quoteattr(name, {"\n": "&#10;", "\r": "&#13;", "\t": "&#9;"})
                data = data.decode().replace('name="n"', f"name={escaped}", 1).encode()
            new.writestr(entry, data)


@given(name=NAMES, ending=st.sampled_from([".csv", ".nc"]))
@example("p/q", ".nc")
@example("p\nq", ".csv")
@example("0\r", ".csv")
@example("\r", ".csv")
@example("\x85", ".csv")
@example("x[4000000000]", ".nc")
@example("x[0]", ".nc")
@example("x[" + "9" * 5000 + "]", ".csv")
def test_names_of_variables(folder, fmus, name, ending):
    renamed(fmus["counter"], folder / "renamed.fmu", name)
    text = 'name = "odd"\n[experiment]\nstop = 2.0\nstep = 1.0\n[components]\na = "odd"\n'
    try:
        system = system_of(tomllib.loads(text), {"odd": folder / "renamed.fmu"})
        write_ssp(system, folder / "odd.ssp")
    except HarnessError:
        return
    status = outcome("run", "odd.ssp", "-q", "-o", f"out/odd{ending}")
    if status == 0:
        back = read(folder / "out" / f"odd{ending}")
        assert f"a.{name}" in back.columns
        assert np.array_equal(back[f"a.{name}"], [0, 1, 2])


# ---- files that never end, texts for numbers


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="needs /dev/zero")
@pytest.mark.parametrize("ending", [".toml", ".ssv", ".ssp", ".fmu", ".csv", ".nc"])
def test_a_device_that_never_ends_is_rejected_and_not_read_to_its_end(folder, ending):
    file = folder / f"zeros{ending}"
    file.unlink(missing_ok=True)
    file.symlink_to("/dev/zero")
    command = {
        ".toml": ("campaign", file.name),
        ".ssv": ("run", "demo.ssp", "--params", file.name),
        ".ssp": ("run", file.name),
        ".fmu": ("check", file.name),
    }.get(ending, ("plot", file.name))
    with _memory_limit(4 << 30):
        assert outcome(*command) in (1, 2)


@contextmanager
def _memory_limit(size):
    """Limit of further memory [bytes], so that a mistake costs no other program its life."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_AS)
    used = psutil.Process().memory_info().vms
    resource.setrlimit(resource.RLIMIT_AS, (used + size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def test_a_toml_file_has_a_limit(folder, monkeypatch, capsys):
    monkeypatch.setattr("harness.system.tables.LONGEST", 100)
    (folder / "long.toml").write_text("# a comment\n" * 10)
    assert main(["campaign", "long.toml"]) == 2
    assert capsys.readouterr().err == (
        "harness: long.toml: cannot be read (longer than the limit of 100 bytes)\n"
    )


@pytest.mark.parametrize(
    "text", [".".join(["a"] * 3000) + " = 1", "x = " + "[" * 60 + "]" * 60, "[" + "a." * 60 + "b]"]
)
def test_a_toml_file_that_is_nested_too_deep_is_rejected(folder, text, capsys):
    (folder / "deep.toml").write_text(text)
    for command in (["campaign", "deep.toml"], ["run", "demo.ssp", "--params", "deep.toml"]):
        assert outcome(*command) in (1, 2)
    assert main(["run", "demo.ssp", "--params", "deep.toml"]) == 1
    reason = "not a readable TOML file (nested too deep)"
    assert capsys.readouterr().err == f"harness: deep.toml: {reason}\n"


def test_a_value_that_is_nested_too_deep_is_a_text(folder):
    for text in ("{" + "a." * 3000 + "b = 1}", "[" * 60 + "]" * 60):
        assert parse(text) == text
        assert outcome("run", "demo.ssp", "-q", "-o", "out/x.csv", "--set", f"twice.k={text}") == 2


def test_a_text_for_a_number_of_a_linear_model_is_called_one(folder, fmus, capsys):
    (folder / "gain.fmu").write_bytes(fmus["gain"].read_bytes())
    assert main(["linearize", "gain.fmu", "-o", "x.npz", "--set", "k=[1,2"]) == 2
    assert capsys.readouterr().err == "harness: --set k: '[1,2' is not a number\n"
