# SPDX-License-Identifier: BSD-2-Clause
"""Lessons of the site: every exercise begins unsolved and is solved by the settings of its answer,
here and in the browser.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from harness import Simulation, run
from harness.api import write_page
from harness.cli.app import main
from harness.errors import StructureError
from harness.report.arrays import Arrays
from harness.report.live import programs, read_lesson
from harness.report.run import canvas_of
from harness.results.requirements import finding, rejected
from harness.results.verdict import Verdict
from harness.ssp.library import load
from tests.harness.chromium import opened, wait

ROOT = Path(__file__).parents[2]
FILES = {path.parents[1].name: path for path in sorted((ROOT / "ssp").glob("*/lessons/*.toml"))}
WORKS = {"sync_approach", "ppc_tracking", "space_robot", "transposition", "relay_approach"}
QUICK = ("ppc_tracking", "transposition")


def changes(lesson, settings=None):
    params = {"params": lesson.params} if lesson.params else {}
    return params | ({"set": dict(settings)} if settings else {})


def test_each_of_the_five_works_has_a_lesson_with_three_exercises():
    assert set(FILES) == WORKS
    for name, file in FILES.items():
        lesson = read_lesson(file)
        assert (lesson.system, len(lesson.exercises), bool(lesson.equations)) == (name, 3, True)
        with load(name) as system:
            required = {each.question: each.solved for each in lesson.exercises}
            assert rejected(system, required) == []
            for each in lesson.exercises:
                for slider, value in each.settings.items():
                    low, high = system.sliders[slider]
                    assert low <= value <= high, (name, slider)


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in QUICK else pytest.mark.long) for n in sorted(WORKS)]
)
def test_every_exercise_begins_unsolved_and_its_answer_solves_it(name):
    lesson = read_lesson(FILES[name])
    first = run(name, **changes(lesson))
    for each in lesson.exercises:
        assert finding(first, "", each.solved).verdict is Verdict.NOT_MET
        solved = run(name, **changes(lesson, each.settings))
        assert finding(solved, "", each.solved).verdict is Verdict.MET


def test_the_page_has_an_instruction_list_per_exercise():
    lesson = read_lesson(FILES["ppc_tracking"])
    result = run("ppc_tracking", stop=1.0)
    found = programs(result, canvas_of(result, Arrays()), lesson)["exercises"]
    assert [each["text"] for each in found] == [each.solved for each in lesson.exercises]
    assert not any("rejected" in each for each in found)


def test_mistakes_of_a_lesson_are_named_together(tmp_path, capsys):
    (tmp_path / "x.toml").write_text(
        'title = "x"\nsystem = "ppc_tracking"\ntext = 3\n[[exercises]]\nquestion = "?"\n'
        'solved = "y > 0"\nhint = "h"\nanswer = "a"\nsetings = {}\n'
    )
    with pytest.raises(StructureError) as caught:
        read_lesson(tmp_path / "x.toml")
    lines = str(caught.value).splitlines()
    assert any(line.startswith("x.toml: text: must be a text, not 3") for line in lines), lines
    assert any("exercises 1" in line and "settings" in line for line in lines), lines
    run("ppc_tracking", stop=1.0).save(tmp_path / "x.nc")
    given = ["report", str(tmp_path / "x.nc"), "--lesson", str(tmp_path / "x.toml")]
    assert main(given) == 2
    assert "a live page needs" in capsys.readouterr().err
    assert main([*given, "-o", str(tmp_path / "x.html")]) == 1
    assert "x.toml: text: must be a text" in capsys.readouterr().err


@pytest.mark.browser
@pytest.mark.parametrize("name", sorted(WORKS))
def test_the_browser_shows_which_exercises_are_solved(chromium, tmp_path, name):
    pytest.importorskip("ziglang", reason="needs ziglang: make test-browser installs it")
    lesson = read_lesson(FILES[name])
    with load(name) as system:
        every = max(1, Simulation(system).steps // 4000)
    result = run(name, every=every, **changes(lesson))
    path = write_page(result, tmp_path / "lesson.html", lesson=FILES[name])
    with opened(chromium, path) as page:
        wait(page, "report.live && report.live.ready")
        names = page.eval_on_selector_all(
            "#live .slider code", "all => all.map(e => e.textContent)"
        )
        base = [slider["base"] for slider in page.evaluate("report.live.sliders")]
        page.evaluate("settings => report.live.run(settings)", base)
        assert page.evaluate("report.live.exercises") == [False] * 3
        for k, each in enumerate(lesson.exercises):
            settings = [each.settings.get(n, b) for n, b in zip(names, base, strict=True)]
            page.evaluate("settings => report.live.run(settings)", settings)
            assert page.evaluate("report.live.exercises")[k]
        states = page.eval_on_selector_all(
            ".exercises .state", "all => all.map(e => e.textContent)"
        )
        assert states == ["solved"] * 3
