# SPDX-License-Identifier: BSD-2-Clause
"""The scripts of the page that flies in node: its verdicts and arrays are those of the harness. Run
by make test-wasm.
"""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from harness import run
from harness.report import conditions, fly
from harness.report.arrays import Arrays
from harness.report.story import replay
from harness.results.expressions import FUNCTIONS
from harness.results.provenance import Provenance
from harness.results.requirements import finding
from harness.results.result import Result
from tests.systems.flights import SCRIPT, node

pytestmark = pytest.mark.wasm
PAGE = Path(conditions.__file__).parent / "page"

EXPRESSIONS = (
    "a.x >= -2 m", "a.x < 1", "norm(a.v) <= 3 m", "norm(a.v - a.w) >= 10 cm", "a.v <= 2 m",
    "not a.x > 1", "a.x > 0 or a.y > 0", "a.x > 0 and a.y > 0", "~(a.x > 0) | (a.y <= 0.5)",
    "time < 3 s or a.x >= -0.5", "time < 90 s or a.x >= -0.5", "time > 2 s and time < 50 s",
    "(time < 3 s or time > 5 s) or a.y < 0.2", "not (time > 3 s and a.x < 0)",
    "abs(a.x) <= parameter(a.limit)", "a.v[:, 0] <= max(parameter(a.gain))", "max(a.x) > 0.9",
    "mean(a.x) < 0.1", "rms(a.v) < 2", "std(a.y) < 0.4", "percentile(a.x, 90) < 0.95",
    "first(a.x) == 0", "last(a.x) != 0", "min(a.v) > -5", "total(a.v) < 4", "steady(time, a.y) < 1",
    "settling_time(time, abs(a.y), 0.9) < 5 s", "degrees(a.x) < 60", "angle(a.q, a.p) <= 40 deg",
    "sqrt(abs(a.x)) + exp(a.y) - log(a.y + 3) < 3", "sin(a.x) + cos(a.x) ** 2 <= 1.2",
    "a.m[:, 0, 1] > -1", "a.gap > 0", "a.gap > 0 or a.x > -3", "not a.gap > 0", "a.flag",
    "a.flag > 0 or a.x < 2", "eventually(a.x > 0.9)", "always(a.x > -2)", "always(a.x > 0, 2 s)",
    "eventually(always(a.y > 0.2, 1 s), 4 s)", "always(eventually(a.x > 0, 4 s), 5 s)",
    "until(a.x > -0.1, a.y < 0, 8 s)", "until(a.y > 0, a.x > 0.8, 1 s, 3 s)",
    "always(time < 3 s or a.x > -2)", "not always(a.x > 0)", "always(a.gap > 0)",
    "always(a.x > 0, 2 s, 90 s)", "eventually(a.x > 5, 90 s)",
    "always(a.x > -2) and always(a.y > -2)",
    "always(a.x > 0) or eventually(a.y > 0.5, 3 s)", "a.x > 1e300 * 1e300", "-a.x + +a.y > -3",
    "a.x / a.zero > 0", "a.v > a.w", "1 >= a.x", "time >= 0 s", "time > 1 s",
)  # fmt: skip


def sample(complete=True, rows=101):
    """Ten seconds of waves, with a vector, a matrix, attitudes, and gaps that are no numbers."""
    t = np.linspace(0, 10, rows)
    waves = [np.sin(0.7 * t + k) * (1 + 0.3 * k) for k in range(9)]
    half = 0.1 * t
    gap = np.where((t > 4) & (t < 4.3), np.nan, t + 1)
    columns = {
        "a.x": np.sin(t), "a.y": np.cos(0.5 * t),
        **{f"a.v[{i + 1}]": waves[i] for i in range(3)},
        **{f"a.w[{i + 1}]": waves[3 + i] for i in range(3)},
        "a.q[1]": np.cos(half), "a.q[2]": np.sin(half), "a.q[3]": 0 * t, "a.q[4]": 0 * t,
        **{f"a.p[{i + 1}]": np.full(rows, float(i == 0)) for i in range(4)},
        **{f"a.m[{i + 1},{j + 1}]": waves[3 * i + j] for i in range(2) for j in range(3)},
        "a.gap": gap, "a.flag": (t > 2).astype(float), "a.zero": 0 * t,
    }  # fmt: skip
    units = ["m" if name.startswith(("a.v", "a.w", "a.x")) else "1" for name in columns]
    table = Result("s", np.zeros(1), ("a.limit", "a.gain[1]", "a.gain[2]"), ("m", "m", "m"),
                   np.array([[0.95, 0.5, 1.5]]))  # fmt: skip
    values = np.array(list(columns.values())).T
    about = Provenance(system="s")
    return Result("s", t, tuple(columns), tuple(units), values, complete=complete,
                  parameters=table, provenance=about)  # fmt: skip


def plain(values):
    return [None if np.isnan(x) else float(x) for x in np.ravel(values)]


def judged(folder, result, texts):
    """Verdicts of the page."""

    def named(table, rows):
        return {n: [list(table[n].shape if rows else table[n][0].shape),
                    plain(table[n] if rows else table[n][0])]
                for n in (*table.columns, *table.vectors)}  # fmt: skip

    told = {
        "time": result.time.tolist(),
        "complete": result.complete,
        "columns": named(result, True),
        "parameters": named(result.parameters, False),
        "requirements": [conditions.requirement(result, text, text) for text in texts],
    }
    file = folder / "run.json"
    file.write_text(json.dumps(told), encoding="utf-8")
    return node(SCRIPT.with_name("judge.js"), file)


@pytest.mark.parametrize("complete", [True, False])
def test_the_page_gives_the_verdicts_of_the_harness(tmp_path, complete):
    result = sample(complete)
    for text, found in zip(EXPRESSIONS, judged(tmp_path, result, EXPRESSIONS), strict=True):
        wanted = finding(result, text, text)
        assert (found["kind"], found["verdict"]) == (
            wanted.verdict.value,
            wanted.told.split(",")[0],
        ), text
        if wanted.verdict.value != "none":
            assert found["detail"] == wanted.detail, text
        assert (found["time"] is None) == (wanted.time is None), text


def test_every_kind_of_verdict_is_among_them():
    kinds = {finding(sample(), text, text).verdict.value for text in EXPRESSIONS}
    assert kinds == {"good", "bad", "idle", "none"}


def test_the_page_has_every_function_of_an_expression():
    listed = re.search(r"const FUNCTIONS = \{(.*?)\n  \};", (PAGE / "judge.js").read_text(), re.S)
    names = set(re.findall(r"(?:^|[,{])\s*(\w+)(?=[:,]|$)", listed[1], re.M))
    assert names >= set(FUNCTIONS) == conditions.TRANSLATED


@pytest.mark.parametrize("system", ["sync_approach", "transposition", "servicing_mission"])
def test_arrays_of_the_page_are_those_of_the_report(tmp_path, system):
    result = run(system, every=20)
    content = fly.traced(result, [])
    roots = fly._other(result, [])
    made = content.canvas.traced.made
    listed, names = content.operations(), sorted(made)
    told = {
        **listed,
        "places": [listed["made"][name] for name in names],
        "roots": {name: [list(v.shape), v.ravel().tolist()] for name, v in roots.items()},
    }
    file = tmp_path / "page.json"
    file.write_text(json.dumps(told), encoding="utf-8")
    found = node(SCRIPT.with_name("arrays.js"), file)["found"]
    value = content.trace.evaluate(roots)
    for name, ours in zip(names, found, strict=True):
        wanted = value(made[name])
        assert ours["shape"] == list(wanted.shape)
        numbers = np.array([float(x.replace("Infinity", "inf")) for x in ours["data"]])
        np.testing.assert_allclose(numbers, wanted.ravel(), rtol=1e-9, atol=1e-9)
    assert len(names) > 5


def course(folder, scene, arrays, end, verdicts=()):
    """What the page tells of a scene whose arrays are those of another flight."""
    names = [scene["time"], *(rule["state"] for rule in scene.get("rules", ()))]
    names += [each["values"] for each in scene["numbers"] if "words" in each]
    names += [scene["course"]["values"]] if "course" in scene else []
    names += [scene["sun"]["shadow"]] if "sun" in scene else []
    told = {
        "scene": scene,
        "end": end,
        "verdicts": verdicts,
        "arrays": {name: plain(arrays(name)) for name in names},
    }
    file = folder / "scene.json"
    file.write_text(json.dumps(told), encoding="utf-8")
    return node(SCRIPT.with_name("course.js"), file)


def replayed(system, **changes):
    """The scene of a run as its page has it, the run, and its arrays."""
    result, arrays = run(system, every=10, **changes), Arrays()
    return replay(result, arrays), result, arrays.take


def test_phases_and_events_of_another_flight_are_those_of_its_own_page(tmp_path):
    """Over the arrays of a flight the page tells what the report of that flight does, to an
    instant of the replay.
    """
    scene, result, take = replayed("arm_capture")
    other = scene | {"phases": [], "events": [], "rules": []}
    found = course(tmp_path, other, take, float(result.time[-1]))
    slack = 1.01 * float(np.diff(take(scene["time"])).max())
    assert [p["text"] for p in found["phases"]] == [p["text"] for p in scene["phases"]]
    for ours, theirs in zip(scene["phases"], found["phases"], strict=True):
        assert theirs["begin"] == pytest.approx(ours["begin"], abs=slack)
        assert theirs["end"] == pytest.approx(ours["end"], abs=slack)
    kinds = ("phase", "capture", "abort")
    wanted, got = ([e for e in s["events"] if e["kind"] in kinds] for s in (scene, found))
    assert sorted(e["kind"] for e in wanted) == sorted(e["kind"] for e in got)
    assert np.allclose(*(sorted(e["time"] for e in each) for each in (wanted, got)), atol=slack)


def test_rules_and_verdicts_of_another_flight_are_marked(tmp_path):
    """First violations by the states of the rules; a flight that ends early has nothing later."""
    scene, result, take = replayed("sync_approach", set={"servicer.rho_0_H": [0, 3.5, 0]})
    blank = scene | {"events": [], "rules": [r | {"violated": None} for r in scene["rules"]]}
    last = float(result.time[-1])
    verdict = {
        "name": "mine",
        "kind": "bad",
        "verdict": "NOT MET",
        "detail": "worst 3 m",
        "time": 7,
    }
    found = course(tmp_path, blank, take, last, [verdict])
    slack = 1.01 * float(np.diff(take(scene["time"])).max())
    broken = {r["name"]: r["violated"] for r in scene["rules"] if r["violated"] is not None}
    assert broken
    assert {r["name"] for r in found["rules"] if r["violated"] is not None} == set(broken)
    for rule in found["rules"]:
        assert rule["violated"] == pytest.approx(broken.get(rule["name"]), abs=slack)
    assert {"time": 7, "text": "mine: NOT MET, worst 3 m", "kind": "violation"} in found["events"]
    early = course(tmp_path, blank, take, 5.0, [verdict])
    assert max(e["time"] for e in early["events"]) == 5.0
    assert early["events"][-1]["text"] == "the run ends"
