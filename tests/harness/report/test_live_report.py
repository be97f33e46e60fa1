# SPDX-License-Identifier: BSD-2-Clause
"""Live page, as far as it needs neither a compiler nor a browser: instructions behind curves and
samples, sliders of a system, rejections.
"""

from __future__ import annotations

import importlib.util
import tomllib
from functools import partial

import numpy as np
import pytest

from harness import load, run
from harness.api import write_page
from harness.errors import HarnessError, StructureError, UsageError
from harness.figures.plots import paint
from harness.files import paths
from harness.master import fused
from harness.mission.figure import Curve, Figure, Panel
from harness.report import live
from harness.report import run as report
from harness.report.arrays import Arrays, Canvas
from harness.report.plots import PAGE, painted
from harness.results.evaluation import history
from harness.results.program import Program
from harness.ssp.build import system_of
from harness.system.graph import read_interfaces
from harness.system.sliders import problems, sliders
from tests.close import close
from tests.each import some

OF_FUNCTIONS = {
    "sync_approach": {"range", "attitude_error", "trajectory", "force", "safety_margins"},
    "space_robot": {"poincare"},
    "transposition": {"plan", "assembly_tracking"},
}
"""Figures with curves that Python functions compute; of `range` the marker of the least value."""


def content_of(result):
    """Return the canvas of a page, plots of figures by name, and plots of signals."""
    canvas = report.canvas_of(result, Arrays())
    data = report.content(canvas, result)
    figures = {f["name"]: f["plots"] for part in data["figures"] for f in part["figures"]}
    return canvas, figures, [plot for part in data["signals"] for plot in part["plots"]]


@pytest.mark.parametrize("system", OF_FUNCTIONS)
def test_every_curve_of_an_expression_has_instructions_that_give_it(system):
    result = run(system, every=40)
    canvas, figures, signals = content_of(result)
    values = canvas.arrays.program.run(partial(history, result))
    curves = [c for plots in (*figures.values(), signals) for p in plots for c in p["curves"]]
    follow = [curve for curve in curves if "source" in curve]
    for curve in follow:
        x, y, begin = (curve["source"][name] for name in ("x", "y", "begin"))
        first = int(np.searchsorted(result.time, begin - 1e-9 * max(1, begin)))
        points = (np.ravel(values[k]).astype(np.float32)[first:] for k in (x, y))
        drawn = set(zip(*points, strict=True))
        arrays = (canvas.arrays.take(curve[axis]) for axis in "xy")
        for point in zip(*arrays, strict=True):
            assert point in drawn or np.isnan(point).any(), curve["name"]
    assert {n for n, plots in figures.items() for p in plots for c in p["curves"]
            if "source" not in c} == OF_FUNCTIONS[system]  # fmt: skip
    assert all("source" in curve for plot in signals for curve in plot["curves"])


BY_FUNCTION = {
    "sync_approach": {"x optimum"},
    "ppc_tracking": set(),
    "space_robot": {"rotation number"},
    "transposition": set(),
}
"""Headline values that only Python functions compute."""
MOVED = {
    "sync_approach": ({"stop": 400}, {"target.omega_TN_T_0[2]": 0.02, "servicer.t_att": 290.5}),
    "ppc_tracking": ({"stop": 20}, {"servicer.mass_0": 80.0}),
    "space_robot": ({"stop": 400, "every": 10}, {"robot.e": 0.1}),
    "transposition": ({"stop": 900}, {"assembly.m1": 24000.0}),
}
"""Options of two runs by system, and parameters of the second."""


@pytest.mark.parametrize("system", BY_FUNCTION)
def test_instructions_of_headline_values_apply_to_another_run(system):
    """The instructions of the run in the file, over the rows of a run with other parameters."""
    options, moved = MOVED[system]
    program, result = Program(), run(system, **options)
    shown = list(live.headline_values(result, program))
    assert {m.name for m, _, number in shown if number is None} <= BY_FUNCTION[system]
    other = run(system, **options, set=moved)
    for rows in (result, other):
        values, expected = program.run(partial(history, rows)), dict(report.metrics(rows))
        for metric, _, number in shown:
            if number is None:
                continue
            found, wanted = float(values[number]), expected[metric]
            if np.isfinite(wanted):
                close(found, wanted, rel=1e-9)
            else:
                assert not np.isfinite(found), metric.name
    assert any(expected[metric] != value for metric, value, _ in shown)


def test_a_converted_or_broken_curve_has_no_instructions():
    result = run("space_robot", stop=50.0)
    pitch = result["robot.pitch"]
    figure = Figure("f", "F", (Panel("", (
        Curve("robot.pitch", "as it is"),
        Curve("robot.pitch", "converted", np.sqrt),
        Curve("robot.pitch", "broken", jump=float(np.abs(np.diff(pitch)).max()) / 2),
        Curve(lambda r: r["robot.pitch"], "function"),
    )),))  # fmt: skip
    with np.errstate(invalid="ignore"), PAGE.used():
        (plot,) = painted(Canvas(Arrays(), 100), paint(figure, result, PAGE), result)
    assert [c["name"] for c in plot["curves"] if "source" in c] == ["as it is"]


def test_samples_are_rows_means_and_extremes_from_one_instant_to_the_next():
    result, arrays = run("space_robot", stop=50.0), Arrays()
    rows, values = np.array([0, 3, 10]), result["robot.h_N"]
    parts = np.split(values, rows[1:])
    expected = {"row": values[rows], "mean": [p.mean(axis=0) for p in parts],
                "least": [p.min(axis=0) for p in parts],
                "largest": [p.max(axis=0) for p in parts]}  # fmt: skip
    for over, wanted in expected.items():
        name = arrays.sample(result, rows, "robot.h_N", over)
        np.testing.assert_allclose(arrays.take(name), wanted, rtol=1e-6)
        assert (arrays.samples[name].time == result.time[rows]).all()


def test_equal_arrays_of_two_expressions_are_two_arrays():
    """In another run they differ."""
    result, arrays, rows = run("space_robot", stop=2.0), Arrays(), np.arange(2)
    names = [arrays.sample(result, rows, text) for text in ("0 * time", "0 * robot.pitch")]
    assert len(set(names)) == 2
    assert arrays.sample(result, rows, "0 * time") == names[0]


def test_a_requirement_that_cannot_be_evaluated_is_stated_with_its_reason():
    result = run("space_robot", stop=2.0)
    found = live.requirement(result, Program(), "rates", "norm(robot.omega_SN_S) <= 1 kg")
    assert "cannot be converted" in found["rejected"] and "truth" not in found


@pytest.mark.parametrize("system", some(sorted(paths.systems()), 3))
def test_every_system_names_sliders_that_hold_its_own_values(system):
    with load(system) as found:
        interfaces = read_interfaces(found)
        named = list(sliders(found.sliders, interfaces))
        assert list(problems(found.sliders, interfaces)) == []
        assert len(named) == len(found.sliders) >= 3
        for slider in named:
            component, _, variable = slider.name.partition(".")
            given = found.component(component).parameters.get(variable)
            value = slider.variable.start if given is None else given.value
            assert slider.low <= value <= slider.high, slider.name


def test_sliders_without_parameter_or_range_are_named():
    with load("sync_approach") as found:
        stated = list(problems({
            "servicer.mass_1": (1.0, 2.0),
            "servicer.rho_0_H[2]": (None, None),
            "servicer.mass_0": (9.0, 3.0),
            "controller.use_wheels": (0.0, 4.0),
        }, read_interfaces(found)))  # fmt: skip
    assert "servicer.mass_1: there is no such parameter" in stated[0] and "mass_0" in stated[0]
    assert "the FMU declares no range" in stated[1]
    assert "expected [least, largest], got [9, 3]" in stated[2]
    assert "exceeds the range of the FMU" in stated[3]


def test_a_range_of_a_slider_is_two_numbers_or_the_one_of_the_fmu():
    toml = paths.PACKAGE.parent / "ssp" / "sync_approach" / "system.toml"
    source = tomllib.loads(toml.read_text(encoding="utf-8"))
    wrong = {"servicer.mass_0": [1.0, 2.0, 3.0], "servicer.Isp": ["a", 2], "servicer.rho_0_H": 3.0}
    source["live"] = {"sliders": {"controller.use_wheels": [], **wrong}}
    with pytest.raises(StructureError) as rejected:
        system_of(source, paths.fmus())
    line = "live.sliders.{}: must be [least, largest], or [] for the range in the FMU, not {}"
    assert list(rejected.value.problems) == [line.format(*each) for each in wrong.items()]


def test_without_the_compiler_one_line_states_how_to_get_it(monkeypatch, tmp_path):
    result = run("space_robot", stop=2.0)
    there = importlib.util.find_spec
    monkeypatch.setattr(
        "harness.errors.find_spec", lambda n: None if n == fused.LIBRARY else there(n)
    )
    with pytest.raises(
        HarnessError, match=r"library ziglang: pip install 'servicing-fmus\[live\]'"
    ):
        write_page(result, tmp_path / "page.html", live=True)
    assert not (tmp_path / "page.html").exists()


def test_a_result_without_its_system_has_no_page_that_runs(tmp_path):
    from dataclasses import replace

    result = replace(run("space_robot", stop=2.0), provenance=None)
    with pytest.raises(UsageError, match="does not name its system"):
        write_page(result, tmp_path / "page.html", live=True)
