# SPDX-License-Identifier: BSD-2-Clause
"""`harness export`: one file with everything inside that runs like the original with its
options.
"""

from __future__ import annotations

import shutil
import tomllib
import zipfile

import numpy as np
import pytest

from harness import run
from harness.authoring.export import export
from harness.cli.app import main
from harness.errors import FmuError, ResultsError, StructureError, UsageError
from harness.ssp import reader as ssp
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from tests.harness.ssp.test_third_party_ssp import nested
from tests.harness.third_party_ssp import component, inline, linear, ssm, ssv, system, write

TOML = """
name = "demo"
[experiment]
stop = 6.0
step = 1.0
[components]
count = "counter"
twice = "gain"
store = "integrator"
[schedule.store]
every = 2
[connections]
"twice.u" = "count.n"
"store.u" = "twice.y"
[parameters.twice]
k = 0.1
[sets.steep]
[sets.steep.twice]
k = 0.7
"""


@pytest.fixture
def demo(fmus, tmp_path):
    path = tmp_path / "demo.ssp"
    write_ssp(system_of(tomllib.loads(TOML), fmus), path)
    return path


def same(a, b):
    assert a.columns == b.columns
    assert a.units == b.units
    assert np.array_equal(a.time, b.time)
    assert np.array_equal(a.values, b.values)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"params": "steep"},
        {"set": {"twice.k": 1 / 3, "count.n_0": 7}, "step": 0.1, "stop": 2.0},
        {"algorithm": "jacobi", "set": ["store.y_0=1e-3"]},
    ],
)
def test_running_the_export_gives_the_bits_of_the_original_with_its_options(
    demo, tmp_path, options
):
    exported = export(demo, tmp_path / "out", **options)
    assert exported == tmp_path / "out" / "demo.ssp"
    same(run(exported), run(demo, **options))


def test_exporting_twice_and_exporting_the_export_give_the_same_bytes(demo, tmp_path):
    options = {"params": "steep", "set": ["count.n_0=3"], "stop": 4.0}
    first = export(demo, tmp_path / "a.ssp", **options).read_bytes()
    assert export(demo, tmp_path / "b.ssp", **options).read_bytes() == first
    assert export(tmp_path / "a.ssp", tmp_path / "c.ssp").read_bytes() == first


def test_an_fmu_swapped_in_from_a_path_is_inside(demo, fmus, tmp_path):
    mine = tmp_path / "elsewhere" / "my own.fmu"
    mine.parent.mkdir()
    shutil.copyfile(fmus["plus_one"], mine)
    options = {"swap": {"twice": str(mine)}}
    expected = run(demo, **options)
    exported = export(demo, tmp_path / "x.ssp", **options)
    shutil.rmtree(mine.parent)
    same(run(exported), expected)
    with zipfile.ZipFile(exported) as archive:
        assert archive.read("resources/my own.fmu") == fmus["plus_one"].read_bytes()


def test_two_fmus_of_one_file_name_stay_apart(demo, fmus, tmp_path):
    mine = tmp_path / "counter.fmu"
    shutil.copyfile(fmus["plus_one"], mine)
    exported = export(demo, tmp_path / "x.ssp", swap={"twice": mine})
    same(run(exported), run(demo, swap={"twice": mine}))


def test_a_system_of_another_tool_becomes_flat_and_retains_its_numbers(fmus, tmp_path):
    elements, wires = nested()
    wires = [wire + f" {linear(0.1, 3)}" for wire in wires]
    elements += [
        component("s", "source"),
        component("far", "kilometres"),
        component("mode", "moded"),
    ]
    mapping = ssm(f"length far.k {linear(2)}", "m mode.mode", "gone nobody")
    values = inline(ssv("length=70 m", "m=hold!", "gone=1"), mapping) + inline(
        ssv("count.n_0=1", "plant.tank.rate=3")
    )
    path = write(
        tmp_path / "x.ssp", system("top", elements, [*wires, "s.v[1] far.u"], bindings=values), fmus
    )
    exported = export(path, tmp_path / "out.ssp")
    same(run(exported), run(path))
    with ssp.opened(exported) as found:
        assert found.component("mode").parameters["mode"].value == "hold"
        assert not found.component("far").parameters["k"].hops


def test_a_run_that_cannot_be_is_not_exported(demo, tmp_path):
    with pytest.raises(StructureError, match="not a multiple"):
        export(demo, tmp_path / "x.ssp", stop=0.5)
    with pytest.raises(UsageError, match="no such system"):
        export("nothing", tmp_path / "x.ssp")
    (tmp_path / "file").write_text("")
    with pytest.raises(ResultsError, match="cannot be created as a folder"):
        export(demo, tmp_path / "file" / "x.ssp")
    with pytest.raises(FmuError):
        export(demo, tmp_path / "x.ssp", swap={"twice": tmp_path / "file"})
    assert not (tmp_path / "x.ssp").exists()


def test_the_command_states_which_file_it_wrote(demo, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    arguments = [
        "export",
        str(demo),
        "out",
        "--params",
        "steep",
        "--set",
        "count.n_0=2",
        "--swap",
        f"twice={tmp_path}/p.fmu",
    ]
    assert main(arguments) == 2
    assert capsys.readouterr().err == f"harness: {tmp_path}/p.fmu: there is no such FMU\n"
    assert main(arguments[:-2]) == 0
    assert capsys.readouterr().out == "out/demo.ssp\n"


# ---- one FMU


def test_a_system_with_other_sources_is_no_single_fmu(demo, tmp_path):
    line = r"x\.fmu: the system cannot be one FMU, export it as \.ssp: .*counter.* sources"
    with pytest.raises(UsageError, match=line):
        export(demo, tmp_path / "x.fmu")
    assert not (tmp_path / "x.fmu").exists()
