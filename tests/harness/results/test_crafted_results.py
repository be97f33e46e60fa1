# SPDX-License-Identifier: BSD-2-Clause
"""Results files that were crafted or damaged: one line each, in every command that reads them."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import netCDF4
import numpy as np
import pytest
import tomli_w

from harness import read, run
from harness.cli import main
from harness.errors import ResultsError
from harness.files.checksums import sha256
from harness.results.files import FORMATS
from harness.results.formats import netcdf
from harness.results.result import Result


@pytest.fixture(scope="module")
def result():
    return run("sync_approach", stop=1.0, every=2, latency=["controller=1"])


def commands(path, tmp_path, capsys, only=slice(None)):
    """Exit status and lines of everything that reads a result."""
    out = str(tmp_path / "again.nc")
    every = (
        ["report", str(path)],
        ["plot", str(path), "-o", str(tmp_path / "figures")],
        ["convert", str(path), "-o", str(tmp_path / "other.csv")],
        ["convert", str(path), "-o", str(tmp_path / "other.oem")],
        ["run", "--like", str(path), "-q", "-o", out],
    )
    for command in every[only]:
        yield command[0], main(command), capsys.readouterr().err.splitlines()


ABOUT = {
    "swaps of lists": ({"provenance_swaps": "[[[1], 2, 3]]"}, "swaps: must be `str`, got `array`"),
    "swaps of text": (
        {"provenance_swaps": '"abc"'},
        "swaps: must be `array`, got `str`, not 'abc'",
    ),
    "no JSON": ({"provenance_set": "[[["}, "set: expected a list as JSON"),
    "deep JSON": ({"provenance_set": "[" * 9000}, "set: expected a list as JSON"),
    "deep value": (
        {"provenance_set": '[["a.b", ' + "[" * 99 + "]" * 99 + "]]"},
        "set: lists are nested too deeply",
    ),
    "JSON of a number": ({"provenance_latency": 5}, "latency: expected a list as JSON"),
    "latency of text": (
        {"provenance_latency": '[["a", "b"]]'},
        "latency: must be `int`, got `str`",
    ),
    "schedule": (
        {"provenance_schedule": '[["a", "b"]]'},
        "schedule: must be `array` of length 4, got 2",
    ),
    "requirement": (
        {"provenance_requirements": '[["a", 5]]'},
        "requirements: must be `str`, got `int`",
    ),
    "step of text": ({"provenance_step": "x"}, "step: must be a finite number, not 'x'"),
    "stop nan": ({"provenance_stop": np.nan}, "stop: must be a finite number, not nan"),
    "every 0": ({"provenance_every": 0}, "every: must be a whole number of at least 1, not 0"),
    "source 5": ({"provenance_source": 5}, "source: must be `str`, got `int`, not 5"),
    "system 5": ({"system": 5}, "system: expected a text, got"),
    "message 5": ({"message": 5}, "message: expected a text, got"),
}


def by_some(cases):
    """Each case by one of the commands in turn; by all of them in `make test-long`."""
    few = [(case, slice(k % 5, k % 5 + 1)) for k, case in enumerate(cases)]
    all_ = [pytest.param(case, slice(None), marks=pytest.mark.long) for case in cases]
    return [*few, *all_]


@pytest.mark.parametrize(("case", "only"), by_some(ABOUT))
def test_attributes_of_another_kind(result, tmp_path, capsys, case, only):
    attributes, problem = ABOUT[case]
    path = result.save(tmp_path / "crafted.nc")
    with netCDF4.Dataset(path, "a") as file:
        file.setncatts(attributes)
    for command, status, lines in commands(path, tmp_path, capsys, only):
        assert (status, len(lines)) == (1, 1), (command, lines)
        assert lines[0].startswith(f"harness: {path}: cannot be read ({problem}"), lines


def crafted(path, name, values, **about):
    with netCDF4.Dataset(path, "a") as file:
        if name not in file.variables:
            file.createVariable(name, values.dtype, ("time",))
        file[name][...] = values
        file[name].setncatts(about)


VARIABLES = {
    "nan time": ("time", np.array([0, np.nan, 2, 3, 4, 5.0]), {}, "row 1 has the time nan"),
    "inf time": ("time", np.array([0, 1, 2, 3, 4, np.inf]), {}, "row 5 has the time inf"),
    "back": ("time", np.array([0, 1, 2, 1, 4, 5.0]), {}, "row 3 is earlier than the one before"),
    "unit 5": ("guidance.range", np.zeros(6), {"units": 5}, "unit of variable guidance.range: "),
    "name 5": ("guidance.range", np.zeros(6), {"long_name": 5}, "description of variable guidanc"),
    "text": (
        "a.text",
        np.array(list("abcdef"), dtype="S1"),
        {},
        "a.text: expected numbers, found the type |S1",
    ),
    "elements": ("a.v", np.zeros(6), {"elements": "x\ny"}, "variables: expected 6 rows of "),
    "twice": (
        "a.v",
        np.zeros(6),
        {"elements": "guidance.range"},
        "variable guidance.range occurs twice",
    ),
}


@pytest.mark.parametrize(("case", "only"), by_some(VARIABLES))
def test_variables_of_another_kind(result, tmp_path, capsys, case, only):
    name, values, about, problem = VARIABLES[case]
    path = result.save(tmp_path / "crafted.nc")
    crafted(path, name, values, **about)
    for command, status, lines in commands(path, tmp_path, capsys, only):
        assert (status, len(lines)) == (1, 1), (command, lines)
        assert lines[0].startswith(f"harness: {path}: cannot be read ({problem}"), lines


SIDECARS = {
    "columns": ({"columns": 5}, "columns: expected a TOML table, got 5"),
    "units": ({"columns": {"units": [1]}}, "units: expected a TOML table, got [1]"),
    "unit": ({"columns": {"units": {"guidance.range": 5}}}, "unit of variable guidance.range: exp"),
    "parameters": ({"parameters": {"values": {"a.k": "x"}}}, "parameter a.k: expected a number"),
    "no table": ({"parameters": 7}, "parameters: expected a TOML table, got 7"),
    "provenance": ({"provenance": "x"}, "provenance: expected a TOML table, got 'x'"),
    "step": ({"provenance": {"step": "x"}}, "step: must be a finite number"),
    "swaps": ({"provenance": {"swaps": [["a"]]}}, "swaps: must be `array` of length 3"),
}


@pytest.mark.parametrize("case", SIDECARS)
def test_damaged_descriptions_beside_the_numbers_are_rejected(result, tmp_path, case):
    changes, problem = SIDECARS[case]
    path = result.save(tmp_path / "crafted.csv")
    beside = path.with_name("crafted.csv.toml")
    about = tomllib.loads(beside.read_text(encoding="utf-8")) | changes
    assert about["sha256"] == sha256(path)
    beside.write_text(tomli_w.dumps(about), encoding="utf-8")
    with pytest.raises(ResultsError) as rejected:
        read(path)
    assert f"cannot be read ({problem}" in str(rejected.value)


@pytest.mark.parametrize(
    ("axes", "problem"),
    [
        (("time", "time"), "time: expected one value per row, got an array of 3 x 3"),
        (("other",), "a.x: 3 rows instead of 2"),
    ],
)
def test_a_time_on_other_axes_is_rejected(tmp_path, axes, problem):
    with netCDF4.Dataset(tmp_path / "crafted.nc", "w") as file:
        file.createDimension("time", 3)
        file.createDimension("other", 2)
        for name, dimensions in (("time", axes), ("a.x", ("time",))):
            file.createVariable(name, "f8", dimensions)[...] = 0
    with pytest.raises(ResultsError) as rejected:
        read(tmp_path / "crafted.nc")
    assert f"cannot be read ({problem})" in str(rejected.value)


def test_a_table_without_rows_is_no_result(tmp_path):
    (tmp_path / "empty.csv").write_text("time,a.x\n")
    with pytest.raises(ResultsError, match=r"cannot be read"):
        read(tmp_path / "empty.csv")
    nothing = Result("s", np.zeros(0), ("a.x",), ("m",), np.zeros((0, 1)), ("",))
    for ending in FORMATS.keys() - {".csv"}:
        with pytest.raises(ResultsError, match="cannot be read"):
            read(nothing.save(tmp_path / f"empty{ending}"))


# ---- sizes


def test_a_nc_that_unpacks_to_gigabytes_is_rejected_before_it_is_read(tmp_path, monkeypatch):
    path = tmp_path / "bomb.nc"
    with netCDF4.Dataset(path, "w") as file:
        file.createDimension("time", 3_000_000_000)
        file.createVariable("time", "f8", ("time",), zlib=True)
    assert path.stat().st_size < 20_000
    with pytest.raises(ResultsError, match=r"unpacks? to 24 GB"):
        read(path)
    monkeypatch.setattr(netcdf, "_memory", lambda: 2**50)  # even where the memory suffices
    with pytest.raises(
        ResultsError, match=r"the file of .* kB unpacks to 24 GB, which cannot be " "a result"
    ):
        read(path)


@pytest.mark.parametrize("kind", ["_FillValue", "missing_value"])
def test_values_that_a_third_party_file_declares_missing_are_not_numbers(tmp_path, kind):
    with netCDF4.Dataset(tmp_path / "x.nc", "w") as file:
        file.createDimension("time", 3)
        filled = {"fill_value": -999} if kind == "_FillValue" else {}
        for name, kind_of, values in (
            ("time", "f8", [0, 1, 2]), ("a.x", "f4", [1, -999, 3]), ("a.n", "i2", [-999, 2, 3]),
        ):  # fmt: skip
            variable = file.createVariable(name, kind_of, ("time",), **filled)
            variable[:] = values
            if not filled:
                variable.missing_value = np.array(-999, dtype=kind_of)
    found = read(tmp_path / "x.nc")
    assert np.array_equal(found["a.x"], [1, np.nan, 3], equal_nan=True)
    assert np.array_equal(found["a.n"], [np.nan, 2, 3], equal_nan=True)


def test_a_file_larger_than_half_of_the_memory_is_rejected(result, tmp_path, monkeypatch):
    path = result.save(tmp_path / "out.nc")
    assert np.array_equal(read(path).time, result.time)
    monkeypatch.setattr(netcdf, "SMALL", 0)
    monkeypatch.setattr(netcdf, "_memory", lambda: result.values.nbytes)
    with pytest.raises(
        ResultsError, match=r"it unpacks to .* more than half of the memory of this machine"
    ):
        read(path)


def test_a_file_of_constants_is_a_result(tmp_path):
    """The content that compresses best of all that we write."""
    rows = 2 * netcdf.SMALL // 8 // 8
    flat = Result("s", np.arange(float(rows)), ("a.x",), ("",), np.zeros((rows, 1)), ("",))
    path = flat.save(tmp_path / "flat.nc")
    assert read(path).complete
    assert replace(flat, time=flat.time[:1], values=flat.values[:1]).save(path)
