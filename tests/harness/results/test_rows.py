# SPDX-License-Identifier: BSD-2-Clause
"""Values of programs in single rows: the functions of Python give what the interpreter gives."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from harness.results.evaluation import fitted, history, unit_in
from harness.results.margins import Requirement
from harness.results.program import Program, evaluate
from harness.results.result import Result
from harness.results.rows import RowProgram
from tests.close import close

TEXTS = [
    "a.x + 2 * a.y - a.x / 3", "abs(a.r - a.s)[2]", "norm(a.r)", "total(a.r * a.y)", "-a.x",
    "sin(a.x) * cos(a.y) + exp(a.x)", "log(a.y)", "sqrt(a.x)", "a.x / a.z", "a.z ** -1",
    "a.x ** 0.5", "degrees(a.x) ** 2", "angle(a.q, a.p)", "(a.x > 0 and a.y < 1) * 3",
    "(a.x > 0 or not a.y < 1) * 3", "time * parameter(a.k)", "max(parameter(a.m)) * a.x",
    "a.x - parameter(a.m)[2]", "exp(1000 * a.y)", "norm(turned(a.q, a.r) - a.s)",
    "angle_between(a.r, a.s)", "angle(mrp(a.r), hill(a.s, a.r))",
    "angle(mrp(a.r), orbit(a.x, a.y, a.z, a.r[1]))",
]  # fmt: skip


@pytest.fixture(scope="module")
def result():
    rng = np.random.default_rng(7)
    names = [f"a.{v}[{i}]" for v in ("r", "s") for i in (1, 2, 3)]
    names += [f"a.{v}[{i}]" for v in ("q", "p") for i in (1, 2, 3, 4)] + ["a.x", "a.y", "a.z"]
    values = rng.normal(size=(9, len(names)))
    values[::3, -1] = 0.0
    values[4, -3] = np.nan
    given = np.array([[7.0, 1.0, 2.0]])
    parameters = Result("", np.zeros(1), ("a.k", "a.m[1]", "a.m[2]"), ("",) * 3, given)
    units = ("",) * len(names)
    return Result("", np.arange(9.0), tuple(names), units, values, parameters=parameters)


@np.errstate(all="ignore")
@pytest.mark.parametrize("text", TEXTS)
def test_a_row_has_the_value_of_the_interpreter(result, text):
    program, tree = Program(), fitted(result, text)
    of_row = RowProgram(result, program, [program.expression(tree)])
    constants = of_row.constants(result.parameters.values[0])
    found = [of_row(row, constants, time)[0]
             for row, time in zip(result.values, result.time, strict=True)]  # fmt: skip
    expected = evaluate(tree, partial(history, result)).astype(float)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    finite = np.isfinite(expected)
    np.testing.assert_array_equal(np.array(found)[~finite], expected[~finite])
    close(np.array(found)[finite], expected[finite], rel=1e-15)


CONDITIONS = [
    "a.x > 0 and a.y > 100", "a.y > 100 and a.x > 0", "a.x > 0 or a.y < 100",
    "a.y < 100 or a.x > 0", "not (a.x >= 0 and a.r[1] < 1)", "implies(time < 3, a.x != a.y)",
    "norm(a.r) <= 1 or time < 2", "a.x == a.z",
]  # fmt: skip


@pytest.mark.parametrize("text", CONDITIONS)
def test_margins_of_rows_with_what_is_no_number(result, text):
    """Row 4 of a.x is NaN: where the other part decides, it counts alone."""
    program, tree = Program(), fitted(result, text)
    wanted = Requirement(tree, partial(unit_in, result), program)
    of_row = RowProgram(result, program, [wanted.margin])
    values = program.run(partial(history, result))[wanted.margin]
    constants = of_row.constants(result.parameters.values[0])
    for row, time, expected in zip(result.values, result.time, values[:, 0], strict=True):
        assert of_row(row, constants, time) == (expected,)


def test_constants_belong_to_the_run(result):
    """A parameter that another run changes changes the value, without a further compilation."""
    program = Program()
    of_row = RowProgram(
        result, program, [program.expression(fitted(result, "parameter(a.k) - a.x"))]
    )
    other = replace(result, parameters=replace(result.parameters, values=np.array([[5.0, 1, 2]])))
    row = result.values[0]
    first, second = (
        of_row(row, of_row.constants(r.parameters.values[0]), 0.0)[0] for r in (result, other)
    )
    assert first - second == pytest.approx(2.0, rel=1e-14)
