# SPDX-License-Identifier: BSD-2-Clause
"""Figures in print: curves that differ without colour, ticks, the end of the run, symbols, jumps,
least values, comparisons that say who is missing.
"""

from __future__ import annotations

import json
from functools import cache
from itertools import combinations

import numpy as np
import pytest
from matplotlib.figure import Figure as MplFigure

from harness import run
from harness.figures.choice import compared, figures_of
from harness.figures.finish import finish, look_of, mathematical, plain_number
from harness.figures.plots import overlay, paint
from harness.figures.style import PAPER, SERIF
from harness.mission import Curve, Figure, Level, Panel
from harness.report.run import of_run
from harness.results.result import Result
from tests.each import Each
from tests.harness.report_page import Page

RUNS = {
    "sync_approach": {"stop": 1300.0, "every": 5},
    "relay_approach": {"stop": 300.0, "every": 5},
    "ppc_tracking": {"stop": 20.0},
    "arch_rendezvous": {"stop": 2000.0, "every": 50},
    "space_robot": {"params": "joint_motion", "stop": 600.0},
    "transposition": {"stop": 2400.0},
    "servicing_mission": {"stop": 20.0},
    "arm_capture": {"stop": 40.0, "every": 10},
    "sync_approach_navigated": {"stop": 30.0},
}
PLAIN = "sync_approach"


@cache
def result_of(system):
    return run(system, **RUNS[system])


def table(time, **columns):
    """A result of columns name -> values."""
    names = tuple(name.replace("__", ".") for name in columns)
    return Result("table", time, names, ("1",) * len(names), np.stack([*columns.values()], axis=1))


def one_panel(result, **about):
    panel = Panel("value [m]", (Curve("a.x", "x", **about.pop("curve", {})),), **about)
    with PAPER.used():
        return paint(Figure("f", "F", (panel,)), result, PAPER).axes[0]


def assert_curves_differ(result):
    """Of every pair of curves of different colours in every figure."""
    drawn = 0
    for figure in figures_of(result):
        if figure.is_empty(result):
            continue
        with PAPER.used():
            for axes in paint(figure, result, PAPER).axes:
                lines = [line for line in axes.get_lines() if np.size(line.get_xdata()) > 1]
                drawn += len(lines)
                for one, other in combinations(lines, 2):
                    if str(one.get_color()) != str(other.get_color()):
                        assert look_of(one) != look_of(other), (figure.name, axes.get_ylabel())
    assert drawn > 5


# ---- without colour


def test_curves_differ_in_grey():
    assert_curves_differ(result_of(PLAIN))


@pytest.fixture
def system():
    return Each(RUNS)


@pytest.mark.long
def test_curves_of_every_system_differ_in_grey(system):
    assert_curves_differ(result_of(system))


def test_the_legend_shows_the_dashes_of_its_curves():
    result = result_of(PLAIN)
    (figure,) = (f for f in figures_of(result) if f.name == "trajectory")
    with PAPER.used():
        axes = paint(figure, result, PAPER).axes[1]
        shown = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
        for handle in axes.get_legend().legend_handles:
            assert look_of(handle)[0] == look_of(shown[handle.get_label()])[0]
        paths = [look_of(shown[name])[0] for name in ("servicer", "reference")]
    assert paths[0] != paths[1]


# ---- axes


@pytest.mark.parametrize("span", [(2.0, 3.0), (1.0, 15.0), (0.011, 0.012), (1e-7, 1e3)])
def test_a_logarithmic_axis_has_three_ticks_with_labels(span):
    time = np.linspace(0, 10, 60)
    axes = one_panel(table(time, a__x=np.geomspace(*span, 60)), log=True)
    low, high = axes.get_ylim()
    axes.figure.canvas.draw()
    inside = [t for t in axes.get_yticklabels() if low <= t.get_position()[1] <= high]
    assert len([t for t in inside if t.get_text()]) >= 3


@pytest.mark.parametrize("end", [17.3, 100.0, 8999.0])
def test_the_axis_of_time_ends_where_the_run_ends(end):
    time = np.linspace(0, end, 50)
    axes = one_panel(table(time, a__x=time))
    seconds = 3600.0 if end > 7200 else 1.0
    assert axes.get_xlim() == pytest.approx((0, end / seconds))
    assert axes.get_xticks()[-1] == pytest.approx(end / seconds)
    assert axes.get_xticklabels()[-1].get_text() == f"{end / seconds:.5g}"


def test_a_jump_breaks_a_curve_and_loses_no_row():
    time = np.arange(10.0)
    values = np.where(time < 5, 0.1 * time, -0.9)
    result = table(time, a__x=values)
    whole, broken = (
        one_panel(result, curve={"jump": jump}).get_lines()[0].get_ydata() for jump in (np.inf, 1.0)
    )
    np.testing.assert_array_equal(whole, values)
    assert np.isnan(broken[5])
    np.testing.assert_array_equal(np.delete(broken, 5), values)


def test_the_least_value_is_marked_where_it_matters():
    time = np.linspace(0, 10, 101)
    result = table(time, a__x=4 + (time - 7) ** 2)
    axes = one_panel(result, least=True, level=Level("to be held:", 4.0))
    (mark,) = (line for line in axes.get_lines() if line.get_label() == "least 4 m at 7 s")
    assert (mark.get_xdata()[0], mark.get_ydata()[0]) == pytest.approx((7, 4))
    assert not [x for x in one_panel(result).get_lines() if str(x.get_label()).startswith("least")]


# ---- words and symbols


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("rho_ref [m]", r"$\rho_{\mathrm{ref}}$ [m]"),
        ("x_N [m/s2]", "$x_{N}$ [m/s\u00b2]"),
        ("omega of S [kg.m2]", "$\\omega$ of S [kg\u00b7m\u00b2]"),
        ("guidance.rho_ref_N [m]", "guidance.rho_ref_N [m]"),
        ("range [m]", "range [m]"),
        ("$x$", "$x$"),
    ],
)
def test_symbols_match_formulas_and_names_of_variables_stay(text, expected):
    assert mathematical(text) == expected


def test_numbers_of_ticks():
    assert [plain_number(x) for x in (0.03, 2e6, 1e-7)] == [
        "0.03",
        "2\u00d710\u2076",
        "10\u207b\u2077",
    ]


def test_no_text_of_a_page_has_mark_up_of_formulas():
    page = Page(of_run(result_of(PLAIN)))
    assert "$" not in json.dumps(page.data) + page.text
    assert "mathdefault" not in json.dumps(page.data)


def test_letters_of_stix_on_demand():
    figure = Figure("f", "F", (Panel("rho_ref [m]", (Curve("a.x"),)),))
    result = table(np.arange(5.0), a__x=np.arange(5.0))
    for style, family in ((SERIF, "STIXGeneral"), (PAPER, "")):
        with style.used():
            label = paint(figure, result, style).axes[0].yaxis.label
            assert (label.get_fontname() == family) == bool(family)
            assert label.get_text() == r"$\rho_{\mathrm{ref}}$ [m]"


def test_titles_have_symbols_too():
    canvas = MplFigure()
    axes = canvas.subplots()
    axes.set_title("Reach, X_E along x")
    axes.text(0.5, 0.5, "rho_M 4 m")
    finish(canvas, None, distinct=True)
    assert axes.get_title() == "Reach, $X_{E}$ along x"
    assert [text.get_text() for text in axes.texts] == [r"$\rho_{M}$ 4 m"]


# ---- comparisons


def test_variables_of_one_run_alone_are_not_compared_and_the_missing_run_is_named(
    tmp_path, caplog, sketches
):
    ours = run("ppc_tracking", stop=5.0)
    other = run("ppc_tracking", stop=5.0, swap=["controller=pid_controller"])
    names = {path.stem for path in overlay({"ppc": ours, "pid": other}, tmp_path)}
    assert "compared_range" in names
    alone = [record.message for record in caplog.records if "one run alone" in record.message]
    assert all(
        name.split(" (")[0] not in names for m in alone for name in m.split(": ")[1].split(", ")
    )
    without = compared({"a": ours, "b": other, "c": run("relay_approach", stop=5.0)})[0]
    titles = [figure.title for figure, runs in without if len(runs) == 2]
    assert titles
    assert all(title.endswith("; without c") for title in titles)
    assert not any("without" in figure.title for figure, _ in compared({"a": ours, "b": other})[0])
