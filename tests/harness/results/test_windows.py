# SPDX-License-Identifier: BSD-2-Clause
"""Windows of requirements: always, eventually, until, and the margin of a run that failed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from harness.results.requirements import finding, has_slope, margin
from harness.results.result import Result
from harness.results.verdict import Verdict
from harness.results.windows import always, eventually, until, windows
from tests.each import each

T = np.arange(6.0)
X = np.array([3, 1, -2, 4, 0.5, 2])
Y = np.array([-1, -1, 2, 1, -3, 5.0])
OPEN = math.nan

BY_HAND = {
    "always[0, 2] x": (lambda: always(X, windows(T, 0, 2)), [-2, -2, -2, 0.5, OPEN, OPEN]),
    "eventually[0, 2] x": (lambda: eventually(X, windows(T, 0, 2)), [3, 4, 4, 4, OPEN, OPEN]),
    "always x": (lambda: always(X, windows(T)), [-2, -2, -2, 0.5, 0.5, 2]),
    "always[1, 3] x": (lambda: always(X, windows(T, 1, 3)), [-2, -2, 0.5, OPEN, OPEN, OPEN]),
    "x until[0, 2] y": (lambda: until(X, Y, windows(T, 0, 2)), [1, 1, 2, 1, 0.5, 5]),
    "eventually always[0, 1] x": (
        lambda: eventually(always(X, windows(T, 0, 1)), windows(T)),
        [1, 0.5, 0.5, 0.5, 0.5, OPEN],
    ),
}


@pytest.mark.parametrize("name", BY_HAND)
def test_six_rows_by_hand(name):
    found, expected = BY_HAND[name]
    np.testing.assert_array_equal(found(), expected)


def by_definition(time, x, y, begin, end):
    """always, eventually and until of every row, by trying all rows of its window."""
    found = np.full((3, len(time)), math.nan)
    for i, t in enumerate(time):
        rows = [j for j in range(len(time)) if t + begin <= time[j] <= t + end]
        over = bool(rows) and (math.isinf(end) or t + end <= time[-1])
        if over:
            found[:2, i] = x[rows].min(), x[rows].max()
        witness = max((min(y[j], *x[i:j], math.inf) for j in rows), default=math.nan)
        if over or witness >= 0:
            found[2, i] = witness
    return found


@pytest.mark.parametrize(
    "window", [(0, 2.0), (1, 5), (0, math.inf), (3, math.inf), (0.5, 0.5), (2, 2.4), (0, 0)]
)
def test_over_uneven_rows_they_are_what_their_definitions_state(window):
    rng = np.random.default_rng(3)
    time = np.cumsum(rng.uniform(0.05, 0.2, 150))
    x, y = rng.normal(0.5, 1, (2, 150))
    within = windows(time, *window)
    found = always(x, within), eventually(x, within), until(x, y, within)
    np.testing.assert_array_equal(found, by_definition(time, x, y, *window))


def run_of(complete=True):
    """x falls from 10 to 0 m within 10 s; on until 4 s."""
    time = np.arange(11.0)
    values = np.column_stack([10 - time, time < 5])
    return Result("demo", time, ("a.x", "a.on"), ("m", "1"), values, complete=complete)


@each(
    ("text", "verdict", "expected"),
    [
        ("a.x >= -20 cm", Verdict.MET, 0.2),
        ("a.x >= 1 m", Verdict.NOT_MET, -1.0),
        ("time < 7 s or a.x <= 3.5 m", Verdict.MET, 0.5),
        ("time < 1 h or a.x > 99", Verdict.NOT_EXERCISED, None),
        ("always(a.x >= 1 cm, 9 s)", Verdict.MET, 0.99),
        ("always(a.x > 0)", Verdict.NOT_MET, 0.0),
        ("eventually(always(a.x <= 4, 2 s), 0.2 min)", Verdict.NOT_EXERCISED, None),
        ("eventually(always(a.x <= 4, 2 s), 8 s)", Verdict.MET, 2.0),
        ("eventually(always(a.x <= 1, 2 s))", Verdict.NOT_MET, -1.0),
        ("always(a.x <= 8, 2 s, 3 s)", Verdict.MET, 0.0),
        ("always(time < 5 or a.x < 5.5)", Verdict.MET, 0.5),
        ("not eventually(a.x < 2, 0.1 min)", Verdict.MET, 2.0),
        ("until(a.x > 3, a.on < 0.5, 6 s)", Verdict.MET, 0.5),
        ("always(a.x >= 0, 20 s)", Verdict.NOT_EXERCISED, None),
        ("eventually(a.x < 3) and always(a.x >= 0, 20 s)", Verdict.NOT_EXERCISED, None),
        ("eventually(a.x < 3) or always(a.x >= 0, 20 s)", Verdict.MET, 3.0),
        ("always(a.x >= 0, 0.4 s, 0.6 s)", Verdict.NOT_EXERCISED, None),
        ("eventually(always(a.x >= 0, 0.4 s, 0.6 s), 3 s)", Verdict.NOT_EXERCISED, None),
        ("always(a.x >= 0, 0.4 s, 1.1 s)", Verdict.MET, 9.0),
    ],
)
def test_margin_and_verdict(text, verdict, expected):
    found = finding(run_of(), "x", text)
    assert (found.verdict, found.margin) == (verdict, pytest.approx(expected, abs=1e-12))
    if expected is not None:
        assert margin(run_of(), text) == found.margin


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("always(a.x >= 0, 0.4 s, 0.6 s)", "no recorded row lies in a window of 0.4 to 0.6 s"),
        ("eventually(a.x < 0, 9.5 s, 9.9 s)", "no recorded row lies in a window of 9.5 to 9.9 s"),
        ("always(a.x >= 0, 9.5 s, 20 s)", "the run ends at 10 s, before its window is over"),
    ],
)
def test_a_window_between_two_rows_is_distinguished_from_one_after_the_end(text, reason):
    found = finding(run_of(), "x", text)
    assert (found.verdict, found.reason) == (Verdict.NOT_EXERCISED, reason)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a.x >= -1", -math.inf),
        ("time < 1 h or a.x > 99", -math.inf),
        ("a.x >= 5", -math.inf),
        ("always(a.x >= 0)", -math.inf),
        ("eventually(a.x < 3)", -math.inf),
        ("always(a.x >= 0, 20 s)", -math.inf),
        ("always(a.x >= 0.5, 9 s)", 0.5),
        ("eventually(always(a.x <= 4, 2 s), 8 s)", 2.0),
    ],
)
def test_a_failed_run_fails_every_requirement_that_it_did_not_reach(text, expected):
    found = finding(run_of(complete=False), "x", text)
    assert found.margin == expected
    assert (found.verdict is Verdict.NOT_MET) == (expected < 0)
    if expected < 0 and text != "a.x >= 5":
        assert "the run ended early, at 10 s" in str(found)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("always(a.x > 0) and a.x > 3", "write always(a.x > 3)"),
        ("time < 5 or always(a.x > 0)", "write always(time < 5)"),
        ("always(a.x > 1, 3 deg)", "deg"),
        ("always(a.x > 1, 3, 2)", "expected 0 <= begin <= end, got a window of 3 to 2 s"),
        ("always(a.x > 1, a.x)", "expected a time as `60 s`, got `a.x`"),
        ("until(a.x > 1)", "expected x and y, then at most two times"),
        ("alwayss(a.x > 1)", "close: always"),
        ("norm(always(a.x > 1)) > 2", "always(), eventually() and until() are conditions"),
    ],
)
def test_a_window_that_makes_no_sense_is_not_judged(text, problem):
    found = finding(run_of(), "x", text)
    assert found.verdict is Verdict.NOT_JUDGED
    assert problem in found.reason


def test_nan_fails_a_requirement_also_under_negation():
    values = run_of().values.copy()
    values[3, 0] = math.nan
    found = finding(replace(run_of(), values=values), "x", "not eventually(a.x < -1)")
    assert (found.verdict, found.margin) == (Verdict.NOT_MET, -math.inf)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a.x >= 0", True),
        ("time < 5 or always(a.x >= 0)", True),
        ("a.on == 1", False),
        ("a.x >= 0 and a.on == 1", False),
        ("not (a.x > 0)", True),
        ("time < 5", False),
    ],
)
def test_flags_and_equations_have_no_slope(text, expected):
    assert has_slope(text) is expected
