# SPDX-License-Identifier: BSD-2-Clause
"""Look of figures: sizes and colours of the styles, scales, limits, levels, names, what is left
out, figures of any variables.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from matplotlib import rcParams
from matplotlib.image import imread
from matplotlib.transforms import Bbox

from harness import run
from harness.cli.app import main
from harness.errors import UsageError
from harness.figures.choice import figure_of
from harness.figures.plots import overlay, paint, paint_overlay, plot
from harness.figures.style import (
    PAPER,
    SCREEN,
    legend_above,
    new_canvas,
    save,
    style_of,
)
from harness.mission import Curve, Figure, Level, Panel
from harness.results.files import ResultFile
from harness.results.result import Result
from ssp.shared.paths_in_space import draw_paths
from tests.missions import FIGURES

OKABE_ITO = {"#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#F0E442"}


@cache
def recording(system, stop=20.0, **changes) -> Result:
    return run(system, stop=stop, **changes)


def table(rows=50, span=10.0, **columns) -> Result:
    """A result of columns name -> (unit, function of time)."""
    time = np.linspace(0, span, rows)
    names = tuple(name.replace("__", ".") for name in columns)
    values = np.stack([np.broadcast_to(f(time), time.shape) for _, f in columns.values()], axis=1)
    return Result("table", time, names, tuple(unit for unit, _ in columns.values()), values)


def painted(name, result):
    (found,) = (f for f in FIGURES if f.name == name and f.fits(result))
    return paint(found, result)


def drawn(axes):
    return {line.get_label(): np.asarray(line.get_ydata()) for line in axes.get_lines()}


# ---- styles


def test_a_figure_of_a_paper_has_the_width_of_a_column_at_300_dots(tmp_path):
    result = recording("sync_approach")
    (path,) = plot(result, tmp_path, style=style_of("paper"), variables=["guidance.range"])
    assert imread(path).shape[1] == 3.5 * 300


def test_drawings_with_two_views_go_across_the_page(tmp_path):
    with PAPER.used():
        canvas = new_canvas("two views", (11, 5), PAPER)
        assert imread(save(canvas, tmp_path / "x.png")).shape[1] == 2100


def test_the_text_of_a_paper_has_8_points_and_every_colour_a_style_of_its_own():
    with PAPER.used():
        canvas = paint(figure_of(recording("sync_approach"), ["controller.eta_hat"]),
                       recording("sync_approach"), PAPER)  # fmt: skip
        axes = canvas.axes[0]
        texts = [axes.xaxis.label, axes.yaxis.label, *axes.get_xticklabels()]
        assert {text.get_fontsize() for text in texts} == {8.0}
        cycle = rcParams["axes.prop_cycle"].by_key()
    assert set(cycle["color"]) == OKABE_ITO
    assert len(set(map(str, cycle["linestyle"]))) == len(cycle["color"])
    looks = {(line.get_color(), str(line._unscaled_dash_pattern)) for line in axes.get_lines()}
    assert len(looks) == len(OKABE_ITO)  # of twelve elements the last four begin anew


def test_a_paper_has_captions_in_place_of_titles():
    with PAPER.used():
        assert new_canvas("title", (8, 3), PAPER)._suptitle is None
    assert new_canvas("title", (8, 3), SCREEN)._suptitle.get_text() == "title"


def test_a_style_leaves_nothing_behind():
    before = dict(rcParams)
    with PAPER.used():
        assert rcParams["font.size"] == 8
    assert dict(rcParams) == before


def test_an_unknown_style_is_reported_in_one_line():
    with pytest.raises(UsageError, match="no style poster, only screen, paper, serif"):
        style_of("poster")


# ---- axes


def test_panels_share_their_axis_of_time_in_hours_where_they_suit():
    short, long = (table(a__y=("m", np.sin), b__z=("s", np.cos), span=s) for s in (7199.0, 7201.0))
    for result, unit, end in ((short, "s", 7199.0), (long, "h", 7201.0 / 3600)):
        upper, lower = paint(figure_of(result, ["a.y", "b.z"]), result).axes
        assert (upper.get_xlabel(), lower.get_xlabel()) == ("", f"time [{unit}]")
        assert upper.get_shared_x_axes().joined(upper, lower)
        assert lower.get_lines()[0].get_xdata()[-1] == pytest.approx(end)


def test_paths_in_space_have_one_scale():
    canvas = new_canvas("", (11, 5))
    path = np.array([[0.0, 0, 0], [100, 10, -30]])
    draw_paths(canvas, {"path": (path, "-")}, ("x", "y", "z"), (0, 1))
    canvas.draw_without_rendering()
    space, flat = canvas.axes
    lengths = [np.ptp(limits) for limits in (space.get_xlim(), space.get_ylim(), space.get_zlim())]
    assert space._box_aspect / lengths == pytest.approx(
        np.full(3, space._box_aspect[0] / lengths[0])
    )
    assert flat.get_aspect() == 1.0


def test_rounding_beside_a_signal_in_the_same_unit_is_a_line_at_zero():
    result = table(a__y=("m", np.sin), a__z=("m", lambda t: 1e-17 * np.cos(9 * t)))
    signal, noise = paint(figure_of(result, ["a.y", "a.z"]), result).axes
    assert noise.get_ylim() == signal.get_ylim()
    assert [text.get_text() for text in noise.texts] == ["rounding below 1e-17"]
    assert not signal.texts


def test_a_constant_is_not_its_last_bits():
    result = table(a__y=("kg", lambda t: 100.0 + 1e-13 * np.sin(t)))
    (axes,) = paint(figure_of(result, ["a.y"]), result).axes
    assert axes.get_ylim() == pytest.approx((95.0, 105.0))


def test_a_small_signal_retains_its_own_scale():
    result = table(a__y=("m", np.sin), a__z=("m", lambda t: 1e-6 * np.cos(9 * t)))
    _, small = paint(figure_of(result, ["a.y", "a.z"]), result).axes
    assert max(small.get_ylim()) < 2e-6


def test_a_legend_covers_no_curve():
    result = recording("sync_approach")
    canvas = paint(figure_of(result, ["propulsion.F_S"]), result)
    canvas.draw_without_rendering()
    (axes,) = canvas.axes
    legend = axes.get_legend().get_window_extent()
    assert not Bbox.intersection(legend, axes.get_window_extent().padded(-1))


def test_no_text_of_a_legend_is_clipped():
    canvas = new_canvas("", (3.5, 2))
    axes = canvas.subplots()
    for name in ("grasp axis to relative position", "arm to the direction of the target"):
        axes.plot([0, 1], label=name)
    legend_above(axes)
    canvas.draw_without_rendering()
    box = axes.get_legend().get_window_extent()
    assert 0 <= box.x0 < box.x1 <= canvas.bbox.width


# ---- what the figures of the systems say


def test_the_range_to_be_held_matches_the_run():
    relay = painted("range", recording("relay_approach")).axes[0]
    assert drawn(relay)["to be held: 50 m"][0] == 50.0
    sync = run("sync_approach", set={"guidance.rho_M": 6.0}, stop=20.0)
    assert drawn(painted("range", sync).axes[0])["to be held: 6 m"][0] == 6.0
    unknown = painted("range", replace(sync, parameters=None)).axes[0]
    assert not [name for name in drawn(unknown) if name.startswith("to be held")]


def test_true_inertias_are_drawn_in_the_colours_of_their_estimates():
    result = recording("sync_approach")
    diagonal, *_ = painted("inertia_estimates", result).axes
    estimates, true = diagonal.get_lines()[:3], diagonal.get_lines()[3:]
    assert [line.get_ydata()[0] for line in true] == [200.0, 250.0, 150.0]
    assert [line.get_ydata()[0] for line in estimates] == [180.0, 240.0, 160.0]
    assert [e.get_color() for e in estimates] == [t.get_color() for t in true]


def test_thrusters_bear_the_names_of_their_system():
    named = painted("firing", recording("sync_approach_thrusters")).axes[0].get_yticklabels()
    thrust = recording("sync_approach_thrusters")["propulsion.thrust"]
    ways = ["+x"] * 4 + ["-x"] * 4 + ["+y"] * 2 + ["-y"] * 2 + ["+z"] * 2 + ["-z"] * 2
    firing = np.flatnonzero(thrust.any(axis=0))
    assert [text.get_text() for text in named] == [f"{i + 1} ({ways[i]})" for i in firing]


def test_rates_that_are_rounding_are_no_signal():
    (x, y, _) = painted("rates", recording("relay_approach", 60.0)).axes
    assert np.abs(drawn(x)["actual"]).max() < 1e-15
    assert x.get_ylim() == y.get_ylim() or max(x.get_ylim()) > 1e-5


def test_a_phase_plane_is_drawn_where_something_turns():
    result = recording("relay_approach", 60.0)
    labels = [axes.get_xlabel() for axes in painted("phase_planes", result).axes]
    assert "rate error about x [rad/s]" not in labels
    assert len(labels) == 1 + np.count_nonzero(np.abs(result["controller.domega_S"]).max(0) > 1e-9)


# ---- what is left out


def test_panels_of_zeros_are_left_out_and_named_in_the_title():
    result = recording("space_robot", 3000.0)
    canvas = painted("joints", result)
    assert [axes.get_ylabel() for axes in canvas.axes] == [
        "angle [deg]",
        "torque of the lock [N\u00a0m]",
    ]
    assert "zero throughout: rate [deg/s], torque [N\u00a0m]" in canvas._suptitle.get_text()


def test_a_figure_in_which_nothing_changes_is_left_out_with_a_note(tmp_path, caplog, sketches):
    paths = plot(recording("space_robot", 3000.0), tmp_path)
    assert "poincare" not in {path.stem for path in paths}
    assert "figures not drawn, since they are empty or constant: poincare" in caplog.text


def test_torque_on_a_frozen_attitude_is_shaded():
    result = run("ppc_tracking", set={"servicer.t_att": 12.0}, stop=20.0)
    (axes,) = painted("torque", result).axes
    (frozen,) = axes.patches
    assert frozen.get_label() == "attitude frozen: no effect"
    assert (frozen.get_x(), frozen.get_width()) == (0.0, 12.0)
    assert not painted("torque", recording("ppc_tracking")).axes[0].patches


def test_several_runs_that_do_nothing_are_left_out(tmp_path, sketches):
    result = recording("sync_approach")
    names = {path.stem for path in overlay({"a": result, "b": result}, tmp_path)}
    assert "compared_range" in names
    assert not names & {"compared_wheels", "compared_torque"}


# ---- several runs


FORCE = Figure("f", "force", (Panel("F [N]", (Curve("a.F"),), level=Level("limit", 2.0)),))


def compared(*forces):
    runs = {f"k={k}": table(a__F=("N", force), rows=2001) for k, force in enumerate(forces)}
    return paint_overlay(FORCE, runs, {label: f"C{k % 8}" for k, label in enumerate(runs)})


def test_many_runs_have_a_scale_and_no_legend_that_eats_the_plot():
    canvas = compared(*[lambda t, k=k: k * np.sin(t) for k in range(41)])
    assert not canvas.legends
    assert canvas.axes[-1].get_ylabel() == "k"
    entries = canvas.axes[0].get_legend().get_texts()
    assert [text.get_text() for text in entries] == ["limit 2 N"]


# ---- any variables


def test_vectors_are_one_panel_with_their_unit_and_matrices_by_element():
    result = recording("sync_approach")
    position, mass, eta = paint(
        figure_of(result, ["servicer.r_SN_N", "servicer.mass", "controller.eta_hat"]), result
    ).axes
    assert position.get_ylabel() == "servicer.r_SN_N [m]"
    assert list(drawn(position)) == ["x", "y", "z"]
    assert np.array_equal(drawn(position)["y"], result["servicer.r_SN_N"][:, 1])
    assert mass.get_ylabel() == "servicer.mass [kg]"
    assert list(drawn(eta))[:2] == ["1", "2"]


def test_the_command_draws_variables_elements_and_groups(tmp_path, capsys):
    file = tmp_path / "out.nc"
    ResultFile(file).write(recording("ppc_tracking"))
    names = "servicer.r_SN_N[2], guidance.los"
    assert main(["plot", str(file), "--var", names, "--style", "paper", "--format", "pdf"]) == 0
    (path,) = capsys.readouterr().out.split("\n")[:-1]
    assert path == str(tmp_path / "out_figures" / "servicer.r_SN_N_2_guidance.los.pdf")
    figure = figure_of(recording("ppc_tracking"), ["servicer.r_SN_N[2]", "guidance.los"])
    assert [panel.ylabel for panel in figure.panels] == [
        "servicer.r_SN_N[2] [m]",
        "guidance.los.range [m]",
        "guidance.los.elevation [rad]",
        "guidance.los.azimuth [rad]",
    ]


@pytest.mark.parametrize(
    ("name", "states"),
    [
        ("guidance.rang", r"no such variable \(close: guidance\.range, guidance\.(?!range)"),
        ("guidance.rho_M", r"is a parameter \(4\."),
    ],
)
def test_a_variable_that_cannot_be_drawn_is_reported_in_one_line(name, states):
    with pytest.raises(UsageError, match=rf"--var {name}: .*{states}"):
        figure_of(recording("sync_approach"), [name])
