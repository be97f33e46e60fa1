# SPDX-License-Identifier: BSD-2-Clause
"""Figures of every system: which are drawn, that they show the numbers of the result, and what
happens without them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from matplotlib.image import imread

from harness import run
from harness.cli.app import main
from harness.errors import ResultsError
from harness.figures.choice import figures_of
from harness.figures.plots import overlay, paint, paint_overlay, plot
from harness.results.files import ResultFile
from harness.results.result import Result
from ssp.shared.relative_motion import attitude_error, position_error
from ssp.space_robot.pitch import strobe
from tests.missions import FIGURES, OVERLAYS

SYNC = {
    "trajectory",
    "range",
    "force",
    "tracking_error",
    "estimated_mass",
    "attitude_error",
}
SYNC |= {"safety_margins", "alignment"}  # wheels and inertias rest for 1200 s
LINE_OF_SIGHT = {
    "safety_margins",
    "trajectory",
    "range",
    "alignment",
    "line_of_sight",
    "acceleration",
    "quaternion",
    "los_error",
    "torque",
    "force",
    "tracking_error",
    "attitude_error",
}
RELAY = {
    "safety_margins",
    "trajectory",
    "range",
    "coordinates",
    "rates",
    "transition",
    "speeds",
    "firing",
    "engines",
    "phase_planes",
    "force",
    "attitude_error",
}
EXPECTED = {
    ("sync_approach", "adaptive_controller"): SYNC,
    ("sync_approach", "pid_controller"): {
        "safety_margins",
        "trajectory",
        "force",
        "tracking_error",
        "attitude_error",
        "range",
        "alignment",
        "acceleration",
        "los_error",
    },
    ("sync_approach_thrusters", "adaptive_controller"): SYNC | {"firing"},
    ("relay_approach", "relay_controller"): RELAY,
    ("space_robot", "joint_controller"): {"pitch", "attitude", "joints", "momentum"},
    ("ppc_tracking", "ppc_controller"): LINE_OF_SIGHT | {"funnel"},
    ("ppc_tracking", "theta_d_controller"): LINE_OF_SIGHT,
    ("ppc_tracking", "adaptive_controller"): {
        "safety_margins",
        "trajectory",
        "range",
        "alignment",
        "line_of_sight",
        "quaternion",
        "torque",
    }
    | {"estimated_mass", "attitude_error", "inertia_estimates", "tracking_error", "force"},
}


@cache
def recording(system: str, controller: str) -> Result:
    component = "joints" if system == "space_robot" else "controller"
    return run(system, swap={component: controller}, stop=60.0)


def figure(name: str, result: Result):
    (found,) = (f for f in FIGURES if f.name == name and f.fits(result))
    return paint(found, result)


def without(result: Result, *names: str) -> Result:
    retained = [i for i, column in enumerate(result.columns) if not column.startswith(names)]
    columns, units = (tuple(part[i] for i in retained) for part in (result.columns, result.units))
    return replace(
        result, columns=columns, units=units, descriptions=(), values=result.values[:, retained]
    )


# ---- which, and that they are pictures


@pytest.mark.parametrize(("system", "controller"), EXPECTED)
def test_a_run_gets_the_figures_that_its_variables_allow(system, controller):
    result = recording(system, controller)
    drawn = {f.name for f in figures_of(result) if not f.is_empty(result)}
    assert drawn == EXPECTED[system, controller]


@pytest.mark.parametrize(
    ("system", "controller"),
    [
        ("space_robot", "joint_controller"),
        *(
            pytest.param(*case, marks=pytest.mark.long)
            for case in EXPECTED
            if case[0] != "space_robot"
        ),
    ],
)
def test_the_files_are_pictures_of_what_the_run_gets(system, controller, tmp_path):
    paths = plot(recording(system, controller), tmp_path / "new")
    assert {path.stem for path in paths} == EXPECTED[system, controller]
    for path in paths:
        ink = imread(path)[..., :3].min(axis=2) < 0.9
        assert 0.003 < ink.mean() < 0.6, path.name


def test_names_of_figures_that_fit_one_result_differ():
    for system, controller in EXPECTED:
        names = [f.name for f in FIGURES if f.fits(recording(system, controller))]
        assert len(names) == len(set(names))


@pytest.mark.parametrize(("ending", "head"), [("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_figures_for_print_are_written_on_demand(tmp_path, sketches, ending, head):
    results = tmp_path / "x.nc"
    ResultFile(results).write(recording("space_robot", "joint_controller"))
    assert main(["plot", str(results), "--format", ending]) == 0
    assert (tmp_path / "x_figures" / f"joints.{ending}").read_bytes().startswith(head)


# ---- that they show the numbers


def lines(axes):
    return {line.get_label(): np.asarray(line.get_data(orig=True)) for line in axes.get_lines()}


def test_coordinates_match_the_result():
    result = recording("relay_approach", "relay_controller")
    axes = figure("coordinates", result).axes[1]
    assert np.array_equal(lines(axes)["servicer"], [result.time, result["servicer.r_SN_N"][:, 1]])
    assert np.array_equal(lines(axes)["target"], [result.time, result["target.r_TN_N"][:, 1]])


def test_in_orbit_positions_are_drawn_relative_to_the_target():
    result = run("relay_approach", params="geo", stop=20.0)
    axes = figure("coordinates", result).axes[0]
    assert lines(axes)["servicer"][1] == pytest.approx(
        result["servicer.r_SN_N"][:, 0] - result["target.r_TN_N"][:, 0]
    )
    assert not lines(axes)["target"][1].any()


def test_required_rates_are_actual_ones_plus_their_error():
    result = recording("relay_approach", "relay_controller")
    axes = figure("rates", result).axes[2]
    gap = lines(axes)["required"][1] - lines(axes)["actual"][1]
    assert gap == pytest.approx(result["controller.domega_S"][:, 2], abs=1e-15)


def test_the_desired_quaternion_has_the_sign_of_the_actual_one():
    result = recording("ppc_tracking", "ppc_controller")
    column = result.columns.index("guidance.q_DN[1]")
    values = result.values.copy()
    values[500:, column : column + 4] *= -1
    for axes, k in zip(
        figure("quaternion", replace(result, values=values)).axes, (1, 2, 3), strict=True
    ):
        assert np.abs(lines(axes)["desired"][1] - lines(axes)["actual"][1])[-1] < 1e-2, k


def test_funnels_are_plus_and_minus_the_bound():
    result = recording("ppc_tracking", "ppc_controller")
    for axes, name in zip(
        figure("funnel", result).axes, ("range", "elevation", "azimuth"), strict=False
    ):
        z, upper, lower = (line.get_ydata() for line in axes.get_lines())
        assert np.array_equal(z, result[f"controller.z.{name}"])
        assert np.array_equal(upper, result[f"controller.alpha.{name}"])
        assert np.array_equal(lower, -upper)


def test_the_firing_chart_has_a_row_per_engine_that_ever_fires():
    result = recording("relay_approach", "relay_controller")
    axes = figure("firing", result).axes[0]
    thrust = result["propulsion.thrust"]
    exist = np.flatnonzero(thrust.any(axis=0))
    names = [*(f"P{i}" for i in range(1, 9)), *(f"P'{i}" for i in range(1, 6))]
    assert [label.get_text() for label in axes.get_yticklabels()] == [names[i] for i in exist]
    (image,) = axes.get_images()
    shown = np.asarray(image.get_array())
    assert shown.shape == (len(exist), min(len(result.time), 1500))
    assert shown.max(axis=1) == pytest.approx(np.ones(len(exist)))


def test_a_pulse_of_one_row_is_seen_in_a_chart_of_many():
    result = recording("relay_approach", "relay_controller")
    rows = 40001
    values = np.zeros((rows, len(result.columns)))
    values[12345, result.columns.index("propulsion.thrust[3]")] = 0.5
    long = replace(result, time=np.arange(rows) * 1.0, values=values)
    (image,) = figure("firing", long).axes[0].get_images()
    (column,) = np.flatnonzero(image.get_array()[0])
    assert column == pytest.approx(12345 / rows * 1500, abs=1)


def test_switching_lines_pass_through_the_thresholds():
    """Where the derivative is 0 the relays switch at error = threshold / Kp; all points lie on
    sigma = Kp e + Kd e'.
    """
    result = recording("relay_approach", "relay_controller")
    Kp, Kd, off, on = (
        result.parameter(f"controller.{n}") for n in ("Kp_v", "Kd_v", "rho1", "rho2")
    )
    points, *switches = figure("phase_planes", result).axes[0].get_lines()
    e, de = points.get_data()
    assert Kp * e + Kd * de == pytest.approx(result["controller.sigma_v"], abs=1e-12)
    crossings = [np.interp(0, line.get_ydata()[::-1], line.get_xdata()[::-1]) for line in switches]
    assert sorted(crossings) == pytest.approx(sorted([on / Kp, -on / Kp, off / Kp, -off / Kp]))


def test_phase_planes_need_the_parameters_of_the_run():
    result = replace(recording("relay_approach", "relay_controller"), parameters=None)
    assert not any(f.name == "phase_planes" and f.fits(result) for f in FIGURES)


# ---- several runs


def controllers():
    return {
        name: recording("ppc_tracking", name)
        for name in ("ppc_controller", "theta_d_controller", "adaptive_controller")
    }


def test_an_overlay_has_one_line_per_run_and_panel_and_one_legend(tmp_path):
    results = controllers()
    (errors,) = (f for f in OVERLAYS if f.name == "compared_errors")
    canvas = paint_overlay(errors, results, {label: f"C{i}" for i, label in enumerate(results)})
    for axes, derived, factor in zip(
        canvas.axes, (position_error, attitude_error), (1, np.degrees(1)), strict=True
    ):
        for line, result in zip(axes.get_lines(), results.values(), strict=True):
            assert line.get_ydata() == pytest.approx(factor * derived(result))
    (legend,) = canvas.legends
    assert [text.get_text() for text in legend.get_texts()] == list(results)


def test_a_run_without_a_variable_is_left_out_and_the_others_retain_their_colours(
    tmp_path, sketches
):
    results = dict(reversed(controllers().items()))
    (figure_,) = (f for f in OVERLAYS if f.name == "compared_acceleration")
    runs = {label: r for label, r in results.items() if figure_.fits(r)}
    assert list(runs) == ["theta_d_controller", "ppc_controller"]
    colours = {label: f"C{i}" for i, label in enumerate(results)}
    canvas = paint_overlay(figure_, runs, colours)
    assert [line.get_color() for line in canvas.axes[0].get_lines()] == ["C1", "C2"]
    names = {path.stem for path in overlay(results, tmp_path)}
    assert {
        "compared_range",
        "compared_errors",
        "compared_acceleration",
        "compared_line_of_sight",
    } <= names
    assert {"compared_trajectory", "compared_quaternion"} <= names


def test_compared_paths_are_relative_to_the_target_in_the_colours_of_the_runs():
    results = controllers()
    (paths,) = (f for f in OVERLAYS if f.name == "compared_trajectory")
    canvas = paint_overlay(paths, results, {label: f"C{i + 3}" for i, label in enumerate(results)})
    shown = {line.get_label(): line for line in canvas.axes[1].get_lines()}
    for i, (label, result) in enumerate(results.items()):
        path = result["servicer.r_SN_N"] - result["target.r_TN_N"]
        assert np.array_equal(shown[label].get_xdata(), path[:, 0])
        assert np.array_equal(shown[label].get_ydata(), path[:, 2])
        assert shown[label].get_color() == f"C{i + 3}"


def test_engines_are_compared_where_there_are_any():
    (engines,) = (f for f in OVERLAYS if f.name == "compared_engines")
    assert engines.fits(recording("relay_approach", "relay_controller"))
    assert not engines.fits(recording("ppc_tracking", "ppc_controller"))


def test_sections_of_several_eccentricities_make_the_bifurcation_diagram():
    results = {
        f"e={e}": run("space_robot", set={"robot.e": e}, step=60.0, stop=30000.0)
        for e in (0.01, 0.05)
    }
    (sections,) = (f for f in OVERLAYS if f.name == "compared_sections")
    assert all(sections.fits(r) for r in results.values())
    canvas = paint_overlay(sections, results, {label: f"C{i}" for i, label in enumerate(results)})
    for line, points, (label, result) in zip(
        canvas.axes[1].get_lines(), canvas.axes[0].get_lines(), results.items(), strict=True
    ):
        pitch, rate = strobe(result)
        assert set(line.get_xdata()) == {float(label[2:])}
        assert line.get_ydata() == pytest.approx(np.degrees(pitch))
        assert points.get_ydata() == pytest.approx(rate)


# ---- what cannot be drawn


def test_a_result_in_which_nothing_moves_has_no_figures(tmp_path):
    other = Result("other", np.arange(3.0), ("a.b",), ("",), np.zeros((3, 1)))
    with pytest.raises(ResultsError, match="all variables are constant"):
        plot(other, tmp_path)
    assert overlay({"x": other}, tmp_path) == []


def test_a_result_of_no_known_mission_has_a_figure_of_every_component(tmp_path):
    values = np.array([[0.0, 1.0, 5.0], [1.0, 1.0, 6.0]])
    other = Result("other", np.arange(2.0), ("a.b", "a.still", "c.d"), ("", "", "m"), values)
    assert [path.name for path in plot(other, tmp_path)] == ["a.png", "c.png"]
    assert [panel.ylabel for panel in figures_of(other)[1].panels] == ["c.d [m]"]


def test_a_figure_without_one_of_its_variables_is_left_out():
    result = without(recording("ppc_tracking", "ppc_controller"), "controller.kappa")
    assert {figure.name for figure in figures_of(result)} == LINE_OF_SIGHT


def test_a_folder_that_cannot_be_written_is_reported_in_one_line(tmp_path, sketches):
    (tmp_path / "file").write_text("")
    for draw in (
        lambda: plot(recording("sync_approach", "pid_controller"), tmp_path / "file"),
        lambda: overlay(controllers(), tmp_path / "file"),
    ):
        with pytest.raises(ResultsError, match="cannot be written"):
            draw()
