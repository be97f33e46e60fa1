# SPDX-License-Identifier: BSD-2-Clause
"""The page that flies, as far as no compiler and no browser is needed: operations recorded from
code for numpy, sliders of a system, refusals.
"""

from __future__ import annotations

import importlib.util
import json
import tomllib

import numpy as np
import pytest

from harness import load, run
from harness.errors import HarnessError, StructureError, UsageError
from harness.files import paths
from harness.master import fused
from harness.report import conditions, fly, template
from harness.report.html import write
from harness.report.trace import Trace, Traced, traces_kept
from harness.results.expressions import FUNCTIONS
from harness.ssp.build import system_of
from harness.system.graph import read_interfaces
from harness.system.sliders import problems, sliders
from tests.each import each, some

ROWS = np.linspace(-3, 4, 60).reshape(12, 5)
OTHER = np.sin(ROWS) + 2


def normed(v):
    return np.asarray(np.linalg.norm(v[:, :3], axis=1))


def in_place(v):
    w = v[:, :3] * 1.0
    w /= np.linalg.norm(w, axis=1)[:, None]
    return w


FORMULAS = {
    "elements": lambda v: np.degrees(np.arctan2(v[:, 0], v[:, 1])) ** 2 - abs(v[:, 2]),
    "norm": normed,
    "in place": in_place,
    "cross": lambda v: np.cross(v[:, :3], v[:, 2:]),
    "stack": lambda v: np.stack([v[:, 0], 2 * v[:, 1]], axis=1),
    "einsum": lambda v: np.einsum("kij,kj->ki", v[:, :4].reshape(-1, 2, 2), v[:, :2]),
    "means": lambda v: np.add.reduceat(v, [0, 3, 7], axis=0) / np.array([3.0, 4, 5])[:, None],
    "chosen": lambda v: v[[1, 5, 2]][:, [0, 2]].T,
    "mask": lambda v: v[:, np.array([True, False, True, False, True])],
    "clip": lambda v: np.clip(v, -1, 1).mean(axis=0),
    "where": lambda v: np.where(v > 0.5, np.sqrt(np.abs(v)), np.nan),
    "logic": lambda v: np.asarray(((v > 0) & ~(v > 1)).any(axis=1), dtype=bool),
    "unpacked": lambda v: sum(v[:, :4].T),
    "ends": lambda v: np.concatenate((v[1:], v[-1:])) - v[..., None][..., 0],
    "largest": lambda v: v / np.nanmax(np.abs(v)),
}  # fmt: skip


@each("name", FORMULAS)
def test_recorded_operations_give_the_numbers_of_the_code_over_other_rows(name):
    trace, formula = Trace(), FORMULAS[name]
    with traces_kept():
        made = formula(trace.root("values", ROWS))
    assert isinstance(made, Traced) and made.place >= 0
    assert np.array_equal(made.view(np.ndarray), formula(ROWS), equal_nan=True)
    found = trace.evaluate({"values": OTHER})(made.place)
    assert np.array_equal(found, formula(OTHER), equal_nan=True)


def test_numpy_is_as_before_after_the_block():
    before = np.asarray
    with traces_kept():
        assert np.asarray is not before
    assert np.asarray is before


def test_what_has_no_word_loses_its_trace_and_is_found_out(monkeypatch):
    """A curve computed through scipy's back door: its array is that of the file alone."""
    result = run("space_robot", stop=50.0)

    def content(canvas, rows):
        lost = np.array([float(x) for x in rows["robot.pitch_rate"]])
        return {
            "good": canvas.arrays.keep(rows["robot.pitch_rate"] * 2),
            "lost": canvas.arrays.keep(lost),
            "still": canvas.arrays.keep(np.ones(3)),
        }

    monkeypatch.setattr(fly.run, "content", content)
    content = fly.traced(result, [])
    assert content.fixed == {content.data["lost"]}
    assert set(content.canvas.traced.made) == {content.data["good"]}


def test_the_replay_and_every_figure_of_an_approach_follow_another_run():
    result = run("sync_approach", stop=20.0)
    canvas, data, _, fixed = fly.traced(result, ["servicer.mass_0"])
    plots = [p for part in data["figures"] for figure in part["figures"] for p in figure["plots"]]
    marks = {c[axis] for p in plots for c in p["curves"] if "marker" in c for axis in ("x", "y")}
    assert fixed <= marks  # a mark with its number in words goes
    assert len(canvas.drawn) > 100 and len(canvas.traced.made) > 20


def test_a_body_whose_size_comes_from_parameters_is_written():
    result = run("arm_capture", stop=1.0)
    data = fly.traced(result, []).data
    (links,) = [b["links"] for b in data["scene"]["bodies"] if b["name"] == "servicer"]
    assert any(isinstance(p["radius"], Traced) for link in links for p in link["parts"])
    written = json.loads(template._json(data))["scene"]["bodies"]
    sizes = [p["radius"] for b in written for link in b["links"] for p in link["parts"]]
    assert sizes and all(0.01 < size < 1 for size in sizes)


def test_the_page_translates_every_function_or_names_the_one_it_lacks(monkeypatch):
    result = run("space_robot", stop=2.0)
    assert set(FUNCTIONS) == conditions.TRANSLATED
    monkeypatch.setattr(conditions, "TRANSLATED", conditions.TRANSLATED - {"norm"})
    told = conditions.requirement(result, "rates", "norm(robot.omega_SN_S) <= 1 deg/s")
    assert told["refused"] == "the page has no function norm" and "tree" not in told


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
        told = list(problems({
            "servicer.mass_1": (1.0, 2.0),
            "servicer.rho_0_H[2]": (None, None),
            "servicer.mass_0": (9.0, 3.0),
            "controller.use_wheels": (0.0, 4.0),
        }, read_interfaces(found)))  # fmt: skip
    assert "servicer.mass_1: there is no such parameter" in told[0] and "mass_0" in told[0]
    assert "has no range of its own" in told[1]
    assert "9 to 3 is no range" in told[2]
    assert "goes beyond what the FMU allows" in told[3]


def test_a_range_of_a_slider_is_two_numbers_or_that_of_the_fmu():
    toml = paths.PACKAGE.parent / "ssp" / "sync_approach" / "system.toml"
    source = tomllib.loads(toml.read_text(encoding="utf-8"))
    wrong = {"servicer.mass_0": [1.0, 2.0, 3.0], "servicer.Isp": ["a", 2], "servicer.rho_0_H": 3.0}
    source["fly"] = {"sliders": {"controller.use_wheels": [], **wrong}}
    with pytest.raises(StructureError) as refused:
        system_of(source, paths.fmus())
    line = "fly.sliders.{}: must be [least, largest] or [], not {}"
    assert list(refused.value.problems) == [line.format(*each) for each in wrong.items()]


def test_without_the_compiler_one_line_says_how_to_get_it(monkeypatch, tmp_path):
    result = run("space_robot", stop=2.0)
    there = importlib.util.find_spec
    monkeypatch.setattr(
        fused.importlib.util, "find_spec", lambda n: None if n == fused.LIBRARY else there(n)
    )
    with pytest.raises(HarnessError, match=r"needs ziglang: pip install 'servicing-fmus\[fly\]'"):
        write(result, tmp_path / "page.html", fly=True)
    assert not (tmp_path / "page.html").exists()


def test_a_result_without_its_system_has_no_page_that_flies(tmp_path):
    from dataclasses import replace

    result = replace(run("space_robot", stop=2.0), provenance=None)
    with pytest.raises(UsageError, match="does not name its system"):
        write(result, tmp_path / "page.html", fly=True)
