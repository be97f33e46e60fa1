# SPDX-License-Identifier: BSD-2-Clause
"""Conditions on campaigns whose runs die and whose metrics are missing, infinite or no number: what
no run has exercised is not met, and the evaluator of requirements agrees with one by hand.
"""

from __future__ import annotations

import math
import operator
import random
import tomllib

import numpy as np
import pytest
import tomli_w

from harness import campaign
from harness.cli.app import main
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from harness.studies.campaign import gate, summary
from harness.studies.campaign.worker import COMPLETE, FAILED
from tests.harness import demo

pytestmark = pytest.mark.usefixtures("trusted")

RUNS = 6
NAN, INF = math.nan, math.inf


@pytest.fixture(scope="module")
def folder(fmus, tmp_path_factory):
    """A system without requirements, one with, and metrics that equal a factor."""
    path = tmp_path_factory.mktemp("gates")
    for name, more in (("demo", ""), ("held", '[requirements]\nsmall = "twice.y <= 20"\n')):
        write_ssp(system_of(tomllib.loads(demo.TOML + more), fmus), path / f"{name}.ssp")
    (path / "mine.py").write_text(
        "def number(result):\n"
        "    return [float('nan'), float('inf'), 3.0][int(result.parameter('twice.k'))]\n"
    )
    return path


def table(folder, system, **more):
    metrics = {"m": "mine.py:number", "n": "last(twice.y)"}
    gains = {"twice.k": {"list": [0.0, 1.0, 2.0]}}
    given = {"system": str(folder / f"{system}.ssp"), "factors": gains, "metrics": metrics}
    return {**given, **more}


def status(folder, tmp_path, *options, **given):
    """Exit status of a campaign on the command line."""
    (folder / "c.toml").write_text(tomli_w.dumps(table(folder, "demo", **given)))
    command = ["campaign", str(folder / "c.toml"), "-o", str(tmp_path / "c.zarr"), *options]
    return main([*command, "--workers", "0"])


# ---- every run fails


DEAD = (
    "n <= 1",
    "n > 1",
    "max(n) <= 1",
    "not percentile(n, 95) > 1",
    "n <= 1 or n > 1",
)


def test_a_campaign_in_which_every_run_fails_meets_nothing(folder, tmp_path, capsys):
    given = {"fixed": {"set": {"bad.t_fail": 3.0}}}
    demanded = [word for text in DEAD for word in ("--require", text)]
    assert status(folder, tmp_path, *demanded, "--strict", **given) == 1
    reported = [x.partition("requirement ")[2] for x in capsys.readouterr().err.splitlines()]
    assert reported[-6:-1] == [f"NOT EXERCISED: {text}; no run has completed" for text in DEAD]
    assert reported[-1].startswith("NOT MET: completion of every run; 0 of 3, 0.0 % (")


def test_one_run_that_fails_is_seen_by_strict(folder, tmp_path):
    ends = {"bad.t_fail": {"list": [100.0, 3.0]}}
    assert status(folder, tmp_path, "--strict", factors=ends, metrics={}) == 1


# ---- numbers that are none


@pytest.fixture(scope="module")
def store(folder, tmp_path_factory):
    """A campaign of six runs, whose metrics and states the tests replace."""
    gains = {"twice.k": {"list": [float(k) for k in range(RUNS)]}}
    metrics = {"m": "first(twice.y)", "n": "last(twice.y)"}
    given = table(folder, "held", factors=gains, metrics=metrics)
    return campaign(given, tmp_path_factory.mktemp("store") / "c.zarr", workers=0).store


@pytest.fixture
def holding(store):
    """Replace the numbers and states of the runs."""

    def replaced(m, n=(0.0,) * RUNS, status=(COMPLETE,) * RUNS):
        for name, values in (("m", m), ("n", n), ("status", status)):
            store.group[name][...] = np.array(values)
        return store

    return replaced


def line_of(store, text):
    """The line of a condition that is not fulfilled, "" of one that is."""
    return "".join(gate.failures(store, [text], strict=False)).removeprefix("requirement ")


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("not m > 1", " in run 2"),
        ("m != 1", " in run 2"),
        ("m == m", " in run 2"),
        ("implies(m > 1, n > 1)", " in run 2"),
        ("not max(m) > 1", ""),
        ("not percentile(m, 95) > 1", ""),
        ("not m > 1 or not n < 1", " in run 2"),
        ("not (m > 1 and lower(success) >= 0)", " in run 2"),
    ],
)
def test_a_metric_that_is_not_a_number_meets_nothing(holding, text, place):
    found = holding([0.0, 0.5, NAN, 0.0, 0.5, 0.0])
    shown = line_of(found, text)
    assert shown.startswith(f"NOT MET: {text}; ")
    assert shown.endswith(f"not a number{place}")


def test_where_another_part_decides_a_metric_that_is_not_a_number_does_not_matter(holding):
    found = holding([0.0, 0.5, NAN, 0.0, 0.5, 0.0])
    assert line_of(found, "m <= 1 or n <= 1") == ""
    assert line_of(found, "not (m <= 1 and n > 1)") == ""


def test_the_worst_run_is_named(holding):
    found = holding([0.0, 9.5, 7.0, 0.0, INF, 0.0])
    assert line_of(found, "m <= 9") == "NOT MET: m <= 9; worst inf in run 4"
    assert (
        line_of(found, "m - n >= 0.5 or m > 1")
        == "NOT MET: m - n >= 0.5 or m > 1; worst 0 in run 0"
    )
    assert line_of(found, "min(m) >= 1") == "NOT MET: min(m) >= 1; worst 0"
    assert line_of(found, "implies(m < 0, n > 1)") == (
        "NOT EXERCISED: implies(m < 0, n > 1); its condition applies in no run"
    )


def test_runs_that_failed_have_no_metrics_and_count_by_their_number(holding):
    state = [COMPLETE, FAILED, COMPLETE, COMPLETE, FAILED, COMPLETE]
    found = holding([0.0, 9.5, 7.0, 0.0, INF, 0.0], status=state)
    assert line_of(found, "m <= 6") == "NOT MET: m <= 6; worst 7 in run 2"
    assert line_of(found, "m <= 7") == ""


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("time < 3", "time belongs to a single run; use a metric or a requirement"),
        ("always(m < 3, 2 s)", "a window of time is valid only in a requirement"),
        ("metric.k < 3", "metric.k belongs to a single run"),
        ("parameter(twice.k) < 3", "parameter twice.k belongs to a single run"),
        ("1 < m < 3", "an expression cannot contain"),
    ],
)
def test_a_condition_that_is_none_of_a_campaign_is_rejected(text, why):
    (line,) = gate.wrong([text], ["success"], {"m": "m"})
    assert line.startswith(f"--require {text}: ")
    assert why in line


def test_letters_that_python_reads_as_others_name_the_metric_of_the_file(folder, tmp_path, capsys):
    """The micro sign of a keyboard is the Greek letter to Python."""
    metrics = {"\N{MICRO SIGN}": "last(twice.y)", "\N{LATIN SMALL LIGATURE FI}t": "last(twice.y)"}
    texts = [f"{name} {limit}" for name in metrics for limit in ("<= 99", "> 99")]
    demanded = [word for text in texts for word in ("--require", text)]
    assert status(folder, tmp_path, *demanded, metrics=metrics) == 1
    reported = [x.partition("NOT MET: ")[2] for x in capsys.readouterr().err.splitlines()[-2:]]
    assert reported == [f"{text}; worst 0 in run 0" for text in texts[1::2]]


# ---- against an evaluator by hand

COMPARE = {
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge,
    "==": operator.eq, "!=": operator.ne,
}  # fmt: skip
OVER_ALL = {"max": np.max, "min": np.min, "mean": np.mean, "last": lambda x: x[-1]}
VALUES = [0.0, 1.0, 2.0, -1.0, NAN, INF, -INF]


def a_condition(rng, depth=2):
    """A random condition as (text, truth of a run by its row: True, False or None where it hangs
    on what is no number).
    """
    kind = rng.choice(["compare", "and", "or", "not"] if depth else ["compare"])
    if kind == "compare":
        return a_comparison(rng)
    parts = [a_condition(rng, depth - 1) for _ in range(1 if kind == "not" else 2)]
    texts, truths = zip(*parts, strict=True)
    if kind == "not":
        return f"not ({texts[0]})", lambda *row: inverse(truths[0](*row))
    decides = kind == "or"

    def joined(*row):
        known = [truth(*row) for truth in truths]
        return decides if decides in known else None if None in known else not decides

    return f"({texts[0]} {kind} {texts[1]})", joined


def inverse(truth):
    return None if truth is None else not truth


def a_comparison(rng):
    name, word, limit = rng.choice("mn"), rng.choice([*COMPARE]), rng.choice([0.0, 1.0, 2.0])
    function = rng.choice([*OVER_ALL, "", "", ""])
    text = f"{function}({name}) {word} {limit:g}" if function else f"{name} {word} {limit:g}"

    def truth(columns, row):
        with np.errstate(all="ignore"):
            x = OVER_ALL[function](columns[name]) if function else columns[name][row]
        return None if math.isnan(x) else bool(COMPARE[word](x, limit))

    return text, truth


def a_demand(rng, columns, rows):
    """A random condition, now and then one that counts in some runs only, and whether it is met."""
    text, truth = a_condition(rng)
    known = [truth(columns, row) for row in range(rows)]
    if rng.random() < 0.3:
        when, guard = a_condition(rng, 0)
        guards = [guard(columns, row) for row in range(rows)]
        known = [
            True if g is False or t is True else None if g is None else t
            for g, t in zip(guards, known, strict=True)
        ]
        if all(g is False for g in guards):
            known = []  # not exercised
        text = f"implies({when}, {text})"
    return text, bool(known) and all(truth is True for truth in known)


def test_conditions_agree_with_an_evaluator_by_hand(holding):
    """300 random conditions over random campaigns with dying runs."""
    rng, seen = random.Random(7), {True: 0, False: 0}
    for k in range(20):
        state = [rng.choice([COMPLETE, COMPLETE, COMPLETE, FAILED]) for _ in range(RUNS)]
        few = VALUES[: rng.choice([2, 4, len(VALUES)])]
        drawn = {name: [rng.choice(few) for _ in range(RUNS)] for name in "mn"}
        found = holding(**drawn, status=[FAILED] * RUNS if k % 10 == 9 else state)
        rows = np.flatnonzero(found.array("status") == COMPLETE)
        columns = {name: np.array(values)[rows] for name, values in drawn.items()}
        wanted = dict(a_demand(rng, columns, len(rows)) for _ in range(15))
        lines = gate.failures(found, [*wanted], strict=False)
        missed = {line.partition(": ")[2].partition("; ")[0] for line in lines}
        assert missed == {text for text, met in wanted.items() if not met}, columns
        for met in wanted.values():
            seen[met] += 1
    assert min(seen.values()) > 50


# ---- what is expected


@pytest.mark.parametrize(
    ("m", "line"),
    [
        ([3.0, INF, INF, INF], "mean inf, infinite in 3 of 4 runs, expected 2.9 to 3.1: NOT as"),
        ([3.0, INF, -INF, 3.0], "mean nan, infinite in 2 of 4 runs, expected 2.9 to 3.1: not ex"),
        (
            [3.0, NAN, 3.0, 3.0],
            "mean 3, missing in 1 of 4 runs, expected 2.9 to 3.1: not ex",
        ),
        ([4.0, NAN, 3.0, 3.0], "mean 3.3333, missing in 1 of 4 runs, expected 2.9 to 3.1: NOT as"),
        ([NAN] * 4, "mean nan, missing in 4 of 4 runs, expected 2.9 to 3.1: not exercised"),
        ([3.0] * 4, "mean 3, expected 2.9 to 3.1: as expected"),
    ],
)
def test_infinite_and_missing_values_are_counted_and_never_as_expected(
    holding, monkeypatch, m, line
):
    state = [COMPLETE] * 4 + [0, 0]  # pending
    found = holding([*m, NAN, NAN], status=state)
    definition = {"expected": {"m": [2.9, 3.1]}}
    monkeypatch.setattr(type(found), "definition", lambda _: (definition, None))
    (each,) = summary.expectations(found)
    assert each.text.startswith(f"m: {line}")
    assert each.verdict.fulfilled == line.endswith(": as expected")


def test_runs_that_failed_are_missing_from_what_is_expected(holding, monkeypatch):
    found = holding([3.0] * RUNS, status=[COMPLETE] * 4 + [FAILED] * 2)
    monkeypatch.setattr(type(found), "definition", lambda _: ({"expected": {"m": [2, 4]}}, None))
    (each,) = summary.expectations(found)
    assert each.text == "m: mean 3, missing in 2 of 6 runs, expected 2 to 4: not exercised"


def test_summary_and_page_count_infinite_values_and_show_them_first(folder, tmp_path, capsys):
    expected = {"m": [2.9, 3.1]}
    assert status(folder, tmp_path, "--strict", expected=expected) == 1
    out = capsys.readouterr().out
    assert "m: no value in 1 of 3 runs, first run 0" in out
    assert "m: infinite in 1 of 3 runs, first run 1" in out
    assert "mean inf, missing in 1 of 3 runs, infinite in 1 of 3 runs, expected" in out
    worst = out.partition("worst by m\n")[2].splitlines()
    assert [line.split()[0] for line in worst[:2]] == ["inf", "3"]
    assert main(["report", str(tmp_path / "c.zarr"), "-o", str(tmp_path / "c.html")]) == 0
    page = (tmp_path / "c.html").read_text()
    assert "m: infinite in 1 of 3 runs, first run 1" in page
