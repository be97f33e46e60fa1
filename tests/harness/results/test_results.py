# SPDX-License-Identifier: BSD-2-Clause
"""Results: vectors by name, and files that read back as they were written."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray

from harness.errors import ResultsError, UsageError
from harness.results.files import ResultFile, read
from harness.results.result import Result

MATRIX = ("a.J[1,1]", "a.J[1,2]", "a.J[2,1]", "a.J[2,2]")
NAMES = ("a.r[1]", "a.r[2]", "a.r[3]", *MATRIX, "a.m", "b.M.bias[1]", "b.M.bias[2]", "b.lone[2]")
UNITS = ("m", "m", "m", "kg.m2", "kg.m2", "kg.m2", "kg.m2", "kg", "N.m", "N.m", "1")


@pytest.fixture
def result():
    numbers = np.random.default_rng(7)
    values = numbers.standard_normal((5, len(NAMES))) * 10.0 ** numbers.integers(
        -300, 300, (5, len(NAMES))
    )
    values[0, :4] = 0.1 + 0.2, -0.0, 5e-324, 1.7976931348623157e308
    time = np.arange(5) * 0.1
    return Result("demo", time, NAMES, UNITS, values, tuple(f"meaning of {name}" for name in NAMES))


@pytest.fixture
def simulated(result):
    """With parameters: a scalar, a vector and a matrix."""
    names = ("a.k", "a.p[1]", "a.p[2]", "b.M.A[1,1]", "b.M.A[1,2]")
    table = Result(
        "demo",
        np.zeros(1),
        names,
        ("1", "m", "m", "kg", "kg"),
        np.array([[0.1, 1, 2, 3, 4]]),
        names,
    )
    return replace(result, parameters=table)


def written(result, path):
    ResultFile(path).write(result)
    return path


# ---- by name


def test_vectors_matrices_scalars_and_elements_have_their_shapes(result):
    assert result["a.r"].shape == (5, 3)
    assert result["a.J"].shape == (5, 2, 2)
    assert result["a.m"].shape == (5,)
    assert result["a.J[2,1]"].tolist() == result["a.J"][:, 1, 0].tolist()
    assert result["b.M.bias"].shape == (5, 2)
    assert (result.unit("a.r"), result.unit("a.J[1,2]")) == ("m", "kg.m2")
    assert result.description("a.r") == "meaning of a.r[1]"


def test_an_incomplete_vector_has_elements_only(result):
    assert "b.lone[2]" in result
    assert "b.lone" not in result


def test_an_unknown_name_offers_close_ones(result):
    with pytest.raises(KeyError, match=r"a\.R \(close: a\.r"):
        result["a.R"]


def test_parameters_have_their_shapes(simulated):
    assert simulated.parameter("a.k").shape == ()
    assert simulated.parameter("a.p").tolist() == [1, 2]
    assert simulated.parameter("b.M.A").tolist() == [[3, 4]]
    with pytest.raises(KeyError, match=r"a\.P \(close: a\.p"):
        simulated.parameter("a.P")


def test_parameters_that_were_not_retained_are_missed_by_name(result):
    with pytest.raises(KeyError, match=r"a\.k: the result does not hold the parameters of the run"):
        result.parameter("a.k")


# ---- files


def test_netcdf_retains_the_parameters_as_variables_without_time(simulated, tmp_path):
    path = written(simulated, tmp_path / "demo.nc")
    with xarray.open_dataset(path) as data:
        assert (data["a.k"].dims, data["a.p"].shape, data["b.M.A"].shape) == ((), (2,), (1, 2))
        assert data["a.p"].attrs == {"units": "m", "long_name": "a.p[1]"}
    back = read(path)
    assert set(back.columns) == set(simulated.columns)
    for name in ("a.k", "a.p", "b.M.A"):
        assert back.parameter(name).tolist() == simulated.parameter(name).tolist()
    assert back.parameters.unit("b.M.A") == "kg"


def test_the_file_beside_a_csv_has_parameters_units_and_meanings(simulated, tmp_path):
    back = read(written(simulated, tmp_path / "demo.csv"))
    assert back.parameters.columns == simulated.parameters.columns
    assert back.parameters.values.tobytes() == simulated.parameters.values.tobytes()
    assert (back.units, back.descriptions) == (simulated.units, simulated.descriptions)
    assert (back.system, back.parameters.unit("b.M.A")) == ("demo", "kg")


def test_a_csv_alone_is_a_bare_table(simulated, tmp_path):
    path = written(simulated, tmp_path / "demo.csv")
    (tmp_path / "demo.csv.toml").unlink()
    assert read(path).parameters is None
    assert pandas_like(path) == (6, 1 + len(NAMES))


def pandas_like(path):
    """Rows with the heading, and columns, of a reader that knows nothing but commas."""
    with path.open(newline="") as file:
        table = list(csv.reader(file))
    assert len({len(row) for row in table}) == 1
    return len(table), len(table[0])


def test_the_description_of_another_csv_is_not_used(simulated, tmp_path, caplog):
    path = written(simulated, tmp_path / "demo.csv")
    path.write_text("time,a.x\n0,1\n", encoding="utf-8")
    assert read(path).parameters is None
    assert (
        "demo.csv.toml: ignored, because it belongs to another version of demo.csv" in caplog.text
    )


@pytest.mark.parametrize("text", ["= 1", 'sha256 = "\udcff"'], ids=["no TOML", "no UTF-8"])
def test_an_unreadable_file_beside_a_csv_is_reported_in_one_line(simulated, tmp_path, caplog, text):
    path = written(simulated, tmp_path / "demo.csv")
    (tmp_path / "demo.csv.toml").write_bytes(text.encode(errors="surrogateescape"))
    assert len(read(path).time) == 5
    assert "demo.csv.toml: cannot be read" in caplog.text


def test_csv_is_lossless_to_the_bit(result, tmp_path):
    back = read(written(result, tmp_path / "demo.csv"))
    assert back.values.tobytes() == result.values.tobytes()
    assert back.time.tobytes() == result.time.tobytes()
    assert back.columns == result.columns
    assert back.complete
    assert back.system == "demo"


def test_csv_is_flat_with_a_header_that_any_reader_understands(result, tmp_path):
    with written(result, tmp_path / "x.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["time", *NAMES]
    assert len(rows) == 6
    assert all(len(row) == len(rows[0]) for row in rows)


def test_netcdf_has_vectors_with_units_and_long_names(result, tmp_path):
    path = written(result, tmp_path / "demo.nc")
    with xarray.open_dataset(path) as data:
        assert data["a.r"].dims == ("time", "axis")
        assert data["a.J"].shape == (5, 2, 2)
        assert data["a.r"].attrs == {"units": "m", "long_name": "meaning of a.r[1]"}
        assert data["time"].attrs["units"] == "s"
        assert data.attrs["system"] == "demo"
    back = read(path)
    assert set(back.columns) == set(result.columns)
    for name in NAMES:
        assert back[name].tobytes() == result[name].tobytes()
        assert back.unit(name) == result.unit(name)
    assert back.description("a.m") == "meaning of a.m"


@pytest.mark.parametrize("ending", [".csv", ".nc"])
def test_an_incomplete_run_stays_marked_as_such(result, tmp_path, ending):
    partial = replace(
        result, complete=False, message="a: step failed: burnt through (at t = 0.4 s)"
    )
    back = read(written(partial, tmp_path / f"x{ending}"))
    assert not back.complete
    assert back.message == partial.message
    assert back.values.shape == result.values.shape


# ---- what cannot be written or read


def test_a_missing_folder_is_made(result, tmp_path):
    assert written(result, tmp_path / "new" / "folder" / "x.csv").is_file()


@pytest.mark.parametrize(
    ("path", "error", "problem"),
    [
        (
            "x.txt",
            UsageError,
            r"results are written as \.csv, \.nc, not as '\.txt'",
        ),
        ("x", UsageError, "not as 'x'"),
        ("folder.csv", ResultsError, "is a folder; give the name of a file"),
        ("file/x.csv", ResultsError, r"cannot be written \(.*file is not a folder\)"),
    ],
)
def test_an_unwritable_output_is_reported_before_the_run(tmp_path, path, error, problem):
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "file").write_text("")
    with pytest.raises(error, match=problem):
        ResultFile(tmp_path / path)


def test_looking_whether_it_can_be_written_leaves_nothing_and_touches_nothing(tmp_path):
    ResultFile(tmp_path / "new" / "x.nc")
    assert list(tmp_path.iterdir()) == []
    old = tmp_path / "x.csv"
    old.write_text("old")
    ResultFile(old)
    assert [p.name for p in tmp_path.iterdir()] == ["x.csv"]
    assert old.read_text() == "old"


@pytest.mark.parametrize("ending", [".csv", ".nc"])
def test_a_failure_while_writing_is_reported_in_one_line_and_leaves_the_old_file(
    result, tmp_path, monkeypatch, ending
):
    path = tmp_path / f"x{ending}"
    path.write_text("old")
    file = ResultFile(path)
    monkeypatch.setattr(
        Path, "replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left on device"))
    )
    with pytest.raises(
        ResultsError, match=rf"x\{ending}: cannot be written \(No space left on device\)"
    ):
        file.write(result)
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_reported_in_one_line(result, tmp_path):
    (tmp_path / "full.csv").symlink_to("/dev/full")
    with pytest.raises(
        ResultsError, match=r"full\.csv: cannot be written \(No space left on device\)"
    ):
        ResultFile(tmp_path / "full.csv").write(result)


@pytest.mark.parametrize(
    ("name", "content", "problem"),
    [
        ("a.csv", "x,y\n1,2\n", "the first column must be named time"),
        ("b.csv", "", "the first column must be named time"),
        ("c.csv", "time,a.b\n1,two\n", "cannot be read"),
        ("d.csv", "time,a.b\n1,2,3\n", "2 names for 3 columns"),
        ("e.nc", "no netcdf", "cannot be read"),
    ],
)
def test_a_file_that_is_no_result_is_reported_in_one_line(tmp_path, name, content, problem):
    (tmp_path / name).write_text(content)
    with pytest.raises(ResultsError, match=problem) as caught:
        read(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_other_endings_and_missing_files_cannot_be_read_back(tmp_path):
    with pytest.raises(UsageError, match=r"expected a results file \(\.csv, \.nc\)"):
        read(tmp_path / "x.txt")
    for ending in (".csv", ".nc"):
        with pytest.raises(ResultsError, match="No such file"):
            read(tmp_path / f"gone{ending}")
