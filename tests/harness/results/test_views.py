# SPDX-License-Identifier: BSD-2-Clause
"""A result in a notebook: texts, tables of xarray and pandas, figures, files; arrays of numpy."""

from __future__ import annotations

import sys
from dataclasses import replace

import numpy as np
import pytest
import xarray

from harness import Simulation, campaign, load, read, run
from harness.api import _texts
from harness.errors import ResultsError, UsageError
from harness.results.result import Result
from ssp.shared.samples import is_late


@pytest.fixture(scope="module")
def result():
    return run("sync_approach", stop=1.0)


def test_a_result_is_reported_in_one_line(result):
    columns = len(result.columns)
    assert repr(result) == f"<Result sync_approach: 0 to 1 s, 11 rows, {columns} columns>"
    ended = replace(result, complete=False, message="a.b: the reason")
    assert repr(ended).endswith("columns, incomplete: a.b: the reason>")
    nothing = replace(result, time=result.time[:0], values=result.values[:0])
    assert "nothing recorded, 0 rows" in repr(nothing)
    assert "nothing recorded, 0 rows" in nothing._repr_html_()


def test_a_notebook_shows_the_settings_and_every_variable_with_its_unit(result):
    page = result._repr_html_()
    assert all(f"<span>{name}</span>" in page for name in result.vectors)
    assert "<dd>m</dd>" in page
    assert "sha256 " + result.provenance.sha256[:12] in page


def test_without_xarray_a_notebook_shows_the_line(result, monkeypatch):
    monkeypatch.setitem(sys.modules, "xarray", None)
    monkeypatch.setattr("harness.results.result.find_spec", lambda name: None)
    assert result._repr_html_() is None


def test_third_party_text_is_text_on_a_page():
    name = "<script>alert(1)</script>"
    odd = Result(name, np.zeros(1), (name,), (name,), np.zeros((1, 1)), (name,), False, name)
    assert "<script>" not in odd._repr_html_()


def test_xarray_has_what_it_reads_from_the_file(result, tmp_path):
    path = result.save(tmp_path / "out.nc")
    with xarray.open_dataset(path) as data:
        assert result.to_xarray().identical(data)
    assert result.to_xarray()["servicer.r_SN_N"].attrs["units"] == "m"


def test_pandas_has_a_column_per_scalar(result):
    frame = result.to_dataframe()
    assert frame["servicer.r_SN_N[2]"].tolist() == result["servicer.r_SN_N"][:, 1].tolist()
    assert frame.index.tolist() == result.time.tolist()
    assert frame.attrs["units"]["guidance.range"] == result.unit("guidance.range") == "m"


def test_a_sampled_output_is_late_in_rows_as_dense_as_its_samples():
    dense, sparse = (run("sync_approach", stop=1, every=every) for every in (1, 5))
    assert is_late(dense, "controller.epsilon")
    assert not is_late(sparse, "controller.epsilon")
    assert dense.time[1] == 0.1 and sparse.time[1] == 0.5


def test_variables_and_figures_are_drawn(result):
    canvas = result.plot("guidance.range", "servicer.r_SN_N")
    drawn = canvas.axes[0].lines[0]
    assert drawn.get_ydata().tolist() == result["guidance.range"].tolist()
    assert canvas._repr_png_().startswith(b"\x89PNG")
    assert result.plot().axes
    with pytest.raises(UsageError, match=r"guidance\.rang"):
        result.plot("guidance.rang")
    bare = Result("x", np.zeros(1), ("a.b",), ("m",), np.zeros((1, 1)))
    with pytest.raises(ResultsError, match="name some variables"):
        bare.plot()


def test_an_incomplete_result_is_saved_as_partial(result, tmp_path):
    ended = replace(result, complete=False, message="why")
    path = ended.save(str(tmp_path / "out.csv"))
    assert path.name == "out.partial.csv"
    assert read(path).message == "why"


# ---- arrays of numpy


def test_arrays_are_values_of_parameters_everywhere():
    inertia = np.diag([200.0, 250.0, 151.0])
    changes = {"servicer.J_S": inertia, "servicer.mass_0": np.float64(99), "servicer.use_J2": True}
    assert run("sync_approach", set=changes, stop=0.1).parameter("servicer.J_S")[2, 2] == 151
    with load("sync_approach") as system, Simulation(system, set=changes, stop=0.1) as simulation:
        rows = {"servicer.rho_0_H": (0, np.int64(18), 0), "servicer.J_S": list(inertia)}
        found = simulation.run(set=rows, stop=np.float64(0.1))
    assert found.parameter("servicer.J_S").tolist() == inertia.tolist()
    assert found.parameter("servicer.rho_0_H").tolist() == [0, 18, 0]


def test_a_wrong_shape_is_still_rejected():
    with pytest.raises(UsageError, match="expected 3 x 3 elements, got 3 elements"):
        run("sync_approach", set={"servicer.J_S": np.ones(3)}, stop=0.1)


def test_arrays_are_values_side_by_side():
    given = {"a.x": np.linspace(0, 1, 3), "a.v": [np.array([1.0, 2.0]), [3, 4]]}
    assert _texts(given) == ["a.x=0.0,0.5,1.0", "a.v=[1.0, 2.0],[3, 4]"]


def test_arrays_are_values_of_a_campaign(tmp_path):
    table = {
        "system": "sync_approach",
        "fixed": {"stop": 0.1, "set": {"servicer.J_S": np.diag([200.0, 250.0, 151.0])}},
        "factors": {"servicer.mass_0": {"list": np.array([90.0, 110.0])}},
        "metrics": {"mass": "parameter(servicer.mass_0)", "J": "parameter(servicer.J_S)[3,3]"},
    }
    data = campaign(table, tmp_path / "out.zarr", workers=0).data
    assert data["mass"].values.tolist() == [90, 110]
    assert data["J"].values.tolist() == [151, 151]
