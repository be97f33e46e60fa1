# SPDX-License-Identifier: BSD-2-Clause
"""Requirements evaluated by the row with the least margin, and steady errors from their own rows,
against the evaluation of all rows.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from unittest import mock

import numpy as np
import pytest

from harness.results import requirements
from harness.results.evaluation import fitted, history
from harness.results.expressions import steady_error
from harness.results.program import evaluate
from harness.results.requirements import finding
from harness.results.result import Result
from harness.results.verdict import Verdict
from tests.each import each

TEXTS = (
    "a.x >= 1 m",
    "a.x < 0.5 km",
    "norm(a.v) <= 3 m",
    "abs(a.v) < 2 m",
    "a.v > parameter(a.k)",
    "first(a.x) - a.x <= 1 m",
    "last(a.x) <= 1 m",
    "time < 5 s or a.x <= 1 m",
    "a.x <= 1 m or time < 5 s or time > 15 s",
    "time < 100 s or a.x <= 1 m",
    "implies(a.flag >= 1, a.x <= 1 m)",
    "implies(a.flag >= 1 or a.x < 0, a.v <= 1 m)",
    "implies(a.v > 0, a.x <= 1 m)",
    "time < 5 s or (a.x <= 1 m and a.flag < 2)",
)
ODD = ((), (np.nan,), (np.inf, -np.inf), (np.nan, np.inf))


def _result(seed, odd=(), rows=20):
    rng = np.random.default_rng(seed)
    values = rng.integers(-2, 4, (rows, 5)) * 0.5
    for value in odd:
        values[rng.integers(rows), rng.integers(5)] = value
    values[:, 1] = rng.random(rows) < 0.2  # a flag
    names, units = ("a.x", "a.flag", "a.v[1]", "a.v[2]", "a.v[3]"), ("m", "1", "m", "m", "m")
    fixed = Result("r", np.zeros(1), ("a.k",), ("cm",), np.array([[25.0]]))
    return Result("r", np.arange(rows) * 1.0, names, units, values, parameters=fixed)


@each("text", TEXTS)
def test_the_row_with_the_least_margin_gives_the_finding_of_all_rows(text):
    for seed in range(12):
        result = replace(_result(seed, ODD[seed % 4]), complete=seed % 3 > 0)
        with mock.patch.object(requirements, "_of_one_row", return_value=None):
            expected = finding(result, "r", text)
        assert repr(finding(result, "r", text)) == repr(expected), (text, seed)


def test_one_row_decides_without_the_instructions_of_all_rows():
    result = _result(1)
    with mock.patch.object(requirements, "_evaluated", side_effect=AssertionError):
        assert finding(result, "r", "time < 5 s or norm(a.v) <= 1 m").value > 1


@pytest.mark.parametrize("text", [
    "implies(a.flag >= 1, a.x <= 9 m)", "implies(a.flag >= 1 or a.x < 0, a.v <= 9 m)"
])  # fmt: skip
def test_a_premise_that_is_not_a_number_is_not_passed_over(text):
    """One row violates the conclusion: it does not matter without the premise, and decides where
    the premise is unknown.
    """
    result, found = _result(1), []
    for flag in (0.0, np.nan):
        values = result.values.copy()
        values[7] = (20.0, flag, 20.0, 20.0, 20.0)
        found.append(finding(replace(result, values=values), "r", text))
    assert [one.verdict for one in found] == [Verdict.MET, Verdict.NOT_MET]
    assert found[1].margin == -np.inf


@pytest.mark.parametrize("rows", [1, 2, 20])
@each("text", ("norm(a.v)", "next(a.x)", "previous(next(a.x - previous(a.v[1])))", "abs(a.v)"))
def test_a_steady_error_is_computed_from_its_own_rows(text, rows):
    result = _result(3, rows=rows)
    expected = steady_error(result.time, evaluate(fitted(result, text), partial(history, result)))
    read = []

    def look_up(name):
        read.append(name)
        return history(result, name)

    assert evaluate(fitted(result, f"steady(time, {text})"), look_up) == expected
    assert {"time"} < {*read}
