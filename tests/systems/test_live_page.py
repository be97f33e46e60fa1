# SPDX-License-Identifier: BSD-2-Clause
"""Scripts of the live page in node: values, verdicts and arrays equal those in the harness. Run by
make test-wasm.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from harness import run
from harness.report import live
from harness.report import run as report
from harness.report.arrays import Arrays
from harness.report.timeline import replay
from harness.results.evaluation import fitted, history
from harness.results.expressions import FUNCTIONS
from harness.results.program import OPERATIONS, SPECIAL, TABLES, WINDOWED, Program, value_of
from harness.results.provenance import Provenance
from harness.results.requirements import finding
from harness.results.result import Result
from tests.systems.recordings import SCRIPT, node

pytestmark = pytest.mark.wasm

EXPRESSIONS = (
    "a.x >= -2 m", "a.x < 1", "norm(a.v) <= 3 m", "norm(a.v - a.w) >= 10 cm", "a.v <= 2 m",
    "not a.x > 1", "a.x > 0 or a.y > 0", "a.x < a.far", "a.far - a.x > 90 cm",
    "a.x > 0 and a.y > 0", "not (a.x > 0) or a.y <= 0.5",
    "time < 3 s or a.x >= -0.5", "time < 90 s or a.x >= -0.5", "time > 2 s and time < 50 s",
    "(time < 3 s or time > 5 s) or a.y < 0.2", "not (time > 3 s and a.x < 0)",
    "abs(a.x) <= parameter(a.limit)", "a.v[1] <= max(parameter(a.gain))", "max(a.x) > 0.9",
    "mean(a.x) < 0.1", "rms(a.v) < 2", "std(a.y) < 0.4", "percentile(a.x, 90) < 0.95",
    "first(a.x) == 0", "last(a.x) != 0", "min(a.v) > -5", "total(a.v) < 4", "steady(time, a.y) < 1",
    "settling_time(time, abs(a.y), 0.9) < 5 s", "degrees(a.y) < 60", "angle(a.q, a.p) <= 40 deg",
    "sqrt(abs(a.y)) + exp(a.y) - log(a.y + 3) < 3", "sin(a.y) + cos(a.y) ** 2 <= 1.2",
    "a.m[1,2] > -1", "(a.v - a.w)[3] < 2 m", "at(a.v, 3.05 s)[1] < 50 cm",
    "a.gap > 0", "a.gap > 0 or a.x > -3", "not a.gap > 0", "a.flag",
    "a.flag > 0 or a.x < 2", "eventually(a.x > 0.9)", "always(a.x > -2)", "always(a.x > 0, 2 s)",
    "eventually(always(a.y > 0.2, 1 s), 4 s)", "always(eventually(a.x > 0, 4 s), 5 s)",
    "until(a.x > -0.1, a.y < 0, 8 s)", "until(a.y > 0, a.x > 0.8, 1 s, 3 s)",
    "always(time < 3 s or a.x > -2)", "not always(a.x > 0)", "always(a.gap > 0)",
    "always(a.x > 0, 2 s, 90 s)", "eventually(a.x > 5, 90 s)",
    "always(a.x > -2) and always(a.y > -2)",
    "always(a.x > 0) or eventually(a.y > 0.5, 3 s)", "a.x > 1e300 * 1e300", "-a.x + +a.y > -3",
    "a.x / a.zero > 0", "a.v > a.w", "1 >= a.x", "time >= 0 s", "time > 1 s",
)  # fmt: skip

VALUES = (
    "time", "a.x", "a.m", "parameter(a.gain)", "a.v - a.w", "a.x * a.v / (1 + a.y ** 2)",
    "-a.y + +a.zero", "a.y ** -1 + abs(a.y) ** 0.5 + 2 ** 3", "norm(a.v)", "norm(a.x)",
    "total(a.v)", "(a.v - a.w)[3]", "a.y < a.flag", "not (a.x < 0 or a.gap > 5) and a.flag",
    "degrees(a.y)", "sqrt(abs(a.x))", "max(a.v)", "min(a.gap)", "mean(a.x)", "mean(a.far)",
    "rms(a.y)", "std(a.y)", "mean(parameter(a.gain))", "percentile(a.x, 90)", "percentile(a.x, 31)",
    "percentile(a.gap, 50)", "first(a.v)", "last(norm(a.v - a.w))", "at(a.v, 3.05 s)[1]",
    "at(a.x, 11 s)", "last(a.x - max(a.x))", "settling_time(time, abs(a.y), 0.9)",
    "settling_time(time, a.gap, 0)", "steady(time, a.y)", "steady(time, a.v)", "next(a.v)",
    "previous(a.gap)", "next(previous(a.v) - a.w)", "sum(a.x)", "sum(a.x > 0)",
    "9 ** 9 ** 9 * a.x", "a.v[1] - True",
)  # fmt: skip
"""Expressions whose values have the same bits in Python and in the page."""
NEARLY = (
    "sin(a.y)", "cos(a.y)", "exp(a.y)", "log(a.y + 3)", "angle(a.q, a.p)", "hill(a.v, a.w)",
    "angle_between(a.v, a.w)", "mrp(a.v)", "turned(a.q, a.v)", "turned(mrp(last(a.v)), last(a.w))",
    "orbit(a.y, 2 * a.y, 3 * a.y, 4 * a.y)",
    "norm(hill(last(a.v), last(a.w)))", "std(a.v)", "rms(a.u)", "norm(a.u)", "total(a.u)",
    "a.y ** 3",
)  # fmt: skip
"""Expressions of functions that each C library and browser rounds in its own way, or of sums whose
order depends on the layout of the numbers in memory.
"""


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
        **{f"a.u[{i + 1}]": waves[i] * 10.0 ** (i - 4) for i in range(9)},
        **{f"a.m[{i + 1},{j + 1}]": waves[3 * i + j] for i in range(2) for j in range(3)},
        "a.gap": gap, "a.flag": (t > 2).astype(float), "a.zero": 0 * t,
        "a.far": 1e-3 + 0 * t,
    }  # fmt: skip
    units = ["m" if name.startswith(("a.v", "a.w", "a.x")) else "1" for name in columns]
    units[-1] = "km"
    table = Result("s", np.zeros(1), ("a.limit", "a.gain[1]", "a.gain[2]"), ("m", "m", "m"),
                   np.array([[0.95, 0.5, 1.5]]))  # fmt: skip
    values = np.array(list(columns.values())).T
    about = Provenance(system="s")
    return Result("s", t, tuple(columns), tuple(units), values, complete=complete,
                  parameters=table, provenance=about)  # fmt: skip


def plain(values):
    return [None if np.isnan(x) else float(x) for x in np.ravel(values)]


def in_node(folder, result, **about):
    """Return what the page computes from the rows and parameters of a result."""
    names = {constant for operation, _, constant in about["program"] if operation == "look up"}
    values = {name: np.asarray(history(result, name), dtype=float) for name in names}
    sizes = {name: 1 if name.startswith("parameter ") else len(result.time) for name in names}
    about |= {
        "time": result.time.tolist(),
        "complete": result.complete,
        "tables": {n: [sizes[n], v.size // sizes[n], plain(v)] for n, v in values.items()},
    }
    file = folder / "run.json"
    file.write_text(json.dumps(about), encoding="utf-8")
    return node(SCRIPT.with_name("program.js"), file)


def verdicts_of(folder, result, texts):
    """Return the verdicts of the page."""
    program = Program()
    wanted = [live.requirement(result, program, text, text) for text in texts]
    return in_node(folder, result, program=program.data(), requirements=wanted)["verdicts"]


def both(folder, result, texts):
    """Yield text, value in Python, and value in the page; an error is its text."""
    program, wanted, ours = Program(), [], []
    for text in texts:
        wanted.append(program.expression(fitted(result, text)))
        try:
            ours.append(np.asarray(value_of(result, text), dtype=float).ravel())
        except ValueError as error:
            ours.append(str(error))
    found = in_node(folder, result, program=program.data(), wanted=wanted)["values"]
    for text, mine, theirs in zip(texts, ours, found, strict=True):
        yield text, mine, theirs if isinstance(theirs, str) else numbers(theirs[2])


def numbers(texts):
    return np.array([float(x.replace("Infinity", "inf")) for x in texts])


def test_values_have_the_same_bits_in_python_and_in_the_page(tmp_path):
    for text, ours, theirs in both(tmp_path, sample(), VALUES):
        if isinstance(ours, str):
            assert theirs == ours, text
        else:
            np.testing.assert_array_equal(theirs, ours, strict=True, err_msg=text)


def test_functions_that_libraries_round_differ_in_the_last_digits_only(tmp_path):
    for text, ours, theirs in both(tmp_path, sample(), NEARLY):
        np.testing.assert_allclose(theirs, ours, rtol=4e-15, atol=1e-15, err_msg=text)


@pytest.mark.parametrize("complete", [True, False])
def test_the_page_gives_the_verdicts_of_the_harness(tmp_path, complete):
    result = sample(complete)
    for text, found in zip(EXPRESSIONS, verdicts_of(tmp_path, result, EXPRESSIONS), strict=True):
        required = finding(result, text, text)
        assert (found["kind"], found["verdict"]) == (
            required.verdict.value,
            required.statement.split(",")[0],
        ), text
        if required.verdict.value != "none":
            assert found["detail"] == required.detail, text
        assert (found["time"] is None) == (required.time is None), text


def test_every_kind_of_verdict_is_among_them():
    kinds = {finding(sample(), text, text).verdict.value for text in EXPRESSIONS}
    assert kinds == {"good", "bad", "idle", "none"}


def test_the_page_has_every_operation(tmp_path):
    known = {*OPERATIONS, *FUNCTIONS, *TABLES, *WINDOWED, *SPECIAL, "look up"}
    assert set(in_node(tmp_path, sample(), program=[])["operations"]) == known


@pytest.mark.parametrize("system", ["sync_approach", "transposition", "servicing_mission"])
def test_samples_of_the_replay_match_the_report(tmp_path, system):
    result = run(system, every=20)
    canvas = report.canvas_of(result, Arrays())
    report.content(canvas, result)
    about = live.programs(result, canvas)
    given = {"samples": list(about["samples"].values()), "rows": about["rows"]}
    found = in_node(tmp_path, result, program=about["program"], **given)["samples"]
    assert len(found) > 3
    for name, (_, _, ours) in zip(about["samples"], found, strict=True):
        expected = canvas.arrays.take(name).ravel()
        np.testing.assert_allclose(numbers(ours), expected, rtol=1e-6, atol=1e-6, err_msg=name)


def course(folder, scene, arrays, end, verdicts=()):
    """Events that the page reports for a scene with the arrays of another run."""
    names = [scene["time"], *(rule["state"] for rule in scene.get("rules", ()))]
    names += [each["values"] for each in scene["numbers"] if "words" in each]
    names += [scene["course"]["values"]] if "course" in scene else []
    names += [scene["sun"]["shadow"]] if "sun" in scene else []
    stated = {
        "scene": scene,
        "end": end,
        "verdicts": verdicts,
        "arrays": {name: plain(arrays(name)) for name in names},
    }
    file = folder / "scene.json"
    file.write_text(json.dumps(stated), encoding="utf-8")
    return node(SCRIPT.with_name("course.js"), file)


def replayed(system, **changes):
    """The scene of a run as its page has it, the run, and its arrays."""
    result, arrays = run(system, every=10, **changes), Arrays()
    return replay(result, arrays), result, arrays.take


def test_phases_and_events_of_another_run_match_its_own_page(tmp_path):
    """From the arrays of a run the page reports the same events as the report of that run, to an
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
    required, got = ([e for e in s["events"] if e["kind"] in kinds] for s in (scene, found))
    assert sorted(e["kind"] for e in required) == sorted(e["kind"] for e in got)
    assert np.allclose(*(sorted(e["time"] for e in each) for each in (required, got)), atol=slack)


def test_rules_and_verdicts_of_another_run_are_marked(tmp_path):
    """First violations by the states of the rules; a run that ends early has no later events."""
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
