# SPDX-License-Identifier: BSD-2-Clause
"""`harness show`: every variable with its shape, unit, values, limits and wires, and a table that
fits the page.
"""

from __future__ import annotations

import re
import tomllib
import unicodedata
import zipfile

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness import HarnessError, show
from harness.cli import showing
from harness.cli.app import main
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from harness.studies.show import Part, Shown, Signal, differences

TOML = """
name = "pair"
description = "a source and a vector"
[experiment]
stop = 2.0
step = 0.5
[components]
from = "source"
to = "vector"
[parameters.to]
J = [[1, 2], [3, 4]]
[sets.other]
[sets.other.to]
M.bias = 7.5
"""


@pytest.fixture
def folder(fmus, project_fmus, tmp_path, monkeypatch):
    """pair.ssp in the working directory, and the small FMUs by name."""
    text = TOML + '[connections]\n"to.v" = "from.v"\n'
    write_ssp(system_of(tomllib.loads(text), fmus), tmp_path / "pair.ssp")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def rows(shown):
    return {row.name: row for row in shown.rows}


def test_a_system_shows_its_components(folder):
    shown = show("pair.ssp")
    assert shown.title == "pair: a source and a vector"
    assert shown.rows == (
        Part("from", "source", 0.5, None, ""),
        Part("to", "vector", 0.5, None, ""),
    )


def test_elements_are_gathered_with_shape_unit_value_and_default(folder):
    found = rows(show("pair.ssp.to"))
    assert list(found) == ["v", "w", "J", "M.bias"]
    assert (found["v"].shape, found["v"].unit, found["v"].wires) == ((3,), "m", ("from.v",))
    assert found["v"].value is None  # driven
    assert found["J"].shape == (2, 2)
    assert found["J"].value == [[1.0, 2.0], [3.0, 4.0]]
    assert found["J"].default == [[0.0, 0.0], [0.0, 0.0]]
    assert (found["M.bias"].shape, found["M.bias"].value) == ((), 1.0)


def test_outputs_state_who_reads_them(folder):
    (port,) = show("pair.ssp.from").rows
    assert (port.name, port.causality, port.wires) == ("v", "output", ("to.v",))


def test_values_follow_the_chosen_set_and_single_values(folder):
    chosen = show("pair.ssp.to", params="other", set=["to.J=[[1,0],[0,1]]"])
    assert rows(chosen)["M.bias"].value == 7.5
    assert rows(chosen)["J"].value == [[1.0, 0.0], [0.0, 1.0]]


def test_a_word_chooses_rows_by_name_and_by_text(folder):
    assert list(rows(show("pair.ssp.to", "bias"))) == ["M.bias"]
    assert list(rows(show("pair.ssp", "TO"))) == ["to"]


def test_an_fmu_alone_has_defaults_and_no_values(folder):
    found = rows(show("gain"))
    assert found["k"] == Signal("k", "parameter", "Real", (), "1", 2.0, None, None, None, "")


def test_limits_and_texts_of_a_component_of_ours():
    found = rows(show("sync_approach.servicer"))
    assert found["use_J2"][-4:-1] == (0.0, 1.0, "1: oblateness of the planet acts on the orbit")
    assert (found["mass_0"].value, found["mass_0"].low, found["mass_0"].high) == (100.0, 0.0, None)
    assert found["rho_0_H"].value == [0.0, 20.0, 0.0]
    assert found["wheel_accel_cmd"].wires == ("controller.wheel_accel_cmd",)


def test_the_limits_of_a_type_count_for_its_variables(folder, fmus):
    path = folder / "typed.fmu"
    with zipfile.ZipFile(fmus["gain"]) as old, zipfile.ZipFile(path, "w") as new:
        for entry in old.namelist():
            data = old.read(entry).decode() if entry.endswith(".xml") else old.read(entry)
            if entry == "modelDescription.xml":
                share = '<SimpleType name="Share"><Real min="0" max="1" unit="1"/></SimpleType>'
                data = data.replace("</TypeDefinitions>", f"{share}</TypeDefinitions>")
                head, tail = data.split('name="k"')
                tail = tail.replace("<Real ", '<Real declaredType="Share" ', 1)
                data = f'{head}name="k"{tail}'
            new.writestr(entry, data)
    k = rows(show(path))["k"]
    assert (k.default, k.low, k.high) == (2.0, 0.0, 1.0)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["pair.ssp.tow"], "pair has no component tow (close: to)"),
        (["gian"], "gian: there is no such system or FMU (close: gain)"),
        (["pair.ssp.to", "zzz"], "zzz: no name or description contains this word"),
        (["gain", "--params", "hot"], "--params: is valid only for a system, not the FMU gain"),
        (["pair.ssp.to", "--set", "to.M.bisa=1"], "--set to.M.bisa: there is no such variable"),
    ],
)
def test_a_missing_name_is_reported_in_one_line(folder, capsys, arguments, line):
    assert main(["show", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"harness: {line}")
    assert err.count("\n") == 1


@pytest.mark.parametrize("columns", [20, 70, 85, 100, 300])
def test_the_table_fits_the_page(monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", str(columns))
    text = showing.text(show("sync_approach.controller"))
    width = min(max(columns, 70), 100)
    assert max(map(len, text.splitlines())) <= width
    assert not any(line != line.rstrip() for line in text.splitlines())
    for name in rows(show("sync_approach.controller")):
        assert width < 85 or any(line.startswith(f"{name}  ") for line in text.splitlines())


def test_a_matrix_is_folded_between_its_rows(monkeypatch):
    monkeypatch.setenv("COLUMNS", "70")
    text = showing.text(show("sync_approach.servicer", "arm about S"))
    assert re.findall(r"\[+\d+, \d+, \d+\]+", text) == [
        "[[200, 0, 0]",
        "[0, 250, 0]",
        "[0, 0, 150]]",
    ]


CELLS = st.text(max_size=60)


@given(
    name=CELLS,
    text=CELLS,
    unit=CELLS,
    values=st.lists(st.floats(), min_size=1, max_size=8),
    long=st.booleans(),
)
def test_no_name_text_or_value_breaks_the_table(name, text, unit, values, long):
    row = Signal(name, "input", "Real", (8,), unit, None, values, None, 1e300, text, ())
    lines = showing.text(Shown(text, (row, row) if long else (row,))).splitlines()
    odd = {unicodedata.category(character) for line in lines for character in line}
    assert not odd & {"Cc", "Cf", "Cs", "Zl", "Zp"}


@given(name=st.text(max_size=20), word=st.text(max_size=8))
def test_any_name_and_word_is_a_table_or_a_reason(folder, name, word):
    for each in (name, f"pair.ssp{name}", f"pair.ssp.{name}"):
        try:
            assert show(each, word).rows
        except HarnessError as error:
            assert str(error)


# ---- what a set changes


def test_differences_are_the_values_that_a_set_changes(folder):
    found = differences("pair.ssp", before={}, after={"params": "other", "set": {"to.M.bias": 8.0}})
    assert found.title == "pair.ssp: values that differ"
    assert [row[:4] for row in found.rows] == [("to.M.bias", "1", 1.0, 8.0)]
    matrix = {"set": {"to.J[1,2]": 5.0}}
    (row,) = differences("pair.ssp.to", before={"params": "other"}, after=matrix).rows[:1]
    assert row[:4] == ("to.J", "1", [[1.0, 2.0], [3.0, 4.0]], [[1.0, 5.0], [3.0, 4.0]])
    assert not differences("pair.ssp.from", before={}, after={"params": "other"}).rows


def test_the_command_shows_differences_of_a_set_and_of_two_sets(folder, capsys):
    assert main(["show", "pair.ssp", "--changed", "--params", "other"]) == 0
    assert re.search(r"^to\.M\.bias +1 +1 +7\.5$", capsys.readouterr().out, re.MULTILINE)
    assert main(["show", "pair.ssp", "--diff", "other,default"]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"^value +unit +other +default +description$", shown, re.MULTILINE)
    assert re.search(r"^to\.M\.bias +1 +7\.5 +1$", shown, re.MULTILINE)
    assert main(["show", "pair.ssp.from", "--changed", "--params", "other"]) == 0
    assert "no value differs" in capsys.readouterr().out


@pytest.mark.parametrize(
    "options", [["--diff", "other"], ["--diff", "other,default", "--params", "other"]]
)
def test_wrong_use_of_differences_is_one_line(folder, capsys, options):
    assert main(["show", "pair.ssp", *options]) == 2
    assert "expected SET1,SET2" in capsys.readouterr().err


def test_an_fmu_has_no_differences(folder, capsys):
    assert main(["show", "source", "--changed"]) == 2
    assert "expected SYSTEM or SYSTEM.component" in capsys.readouterr().err
