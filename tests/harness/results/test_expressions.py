# SPDX-License-Identifier: BSD-2-Clause
"""Expressions over a result: one row of them is that row of the whole, and nothing is cached."""

import gc
import re
import weakref
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from harness.results.evaluation import history, resolved, unit_in
from harness.results.expressions import FUNCTIONS, parsed
from harness.results.program import evaluate
from harness.results.result import Result
from tests.close import close
from tests.each import each

ROWS = 5


@pytest.fixture
def result():
    rng = np.random.default_rng(3)
    names = [f"a.{v}[{i}]" for v in ("r", "s") for i in (1, 2, 3)]
    names += [f"a.w[{i}]" for i in range(ROWS)] + ["a.x", "a.y"]
    given = [*(f"a.p[{i}]" for i in (1, 2, 3)), "a.k"]
    given += [f"a.m[{i},{j}]" for i in (1, 2) for j in (1, 2)]
    fixed = np.array([[0.1, 0.2, 0.3, 7.0, 1.0, 2.0, 3.0, 4.0]])
    parameters = Result("", np.zeros(1), tuple(given), ("m",) * 8, fixed)
    values = rng.normal(size=(ROWS, len(names)))
    time = np.arange(ROWS) / 10
    return Result("", time, tuple(names), ("m",) * len(names), values, parameters=parameters)


def value(text, result):
    plain = resolved(parsed(text), lambda path: unit_in(result, path))
    return evaluate(plain, lambda path: history(result, path))


@each("row", [0, 2, ROWS - 1])
@each(
    "text",
    [
        "a.x",
        "(a.x - a.y)",
        "(a.x / 2 + -a.y)",
        "abs(sqrt(abs(a.x / 1 m)) - exp(a.y / 1 m))",
        "norm(a.r - a.s)",
        "total(a.w)",
        "(norm(a.r) * a.x > 0.1)",
        "(a.r - parameter(a.p))",
        "norm(a.r + parameter(a.k))",
        "(time * 2)",
        "(norm(a.x) * a.r)",
        "(max(a.x) - a.x)",
        "(a.r[1] - a.x)",
        "(a.r - a.s)[3]",
        "norm(a.w)",
        "(a.x * a.r)",
        "(a.x - parameter(a.p))",
        "angle(a.r, parameter(a.p))",
    ],
)
def test_one_row_of_an_expression_is_that_row_of_the_whole(text, row, result):
    """(a.x - max(a.x)) knows all rows: none of its rows is independent."""
    all_ = np.asarray(value(text, result))[row]
    names = {0: f"first({text})", ROWS - 1: f"last({text})"}
    for one in (f"at({text}, {row / 10} s)", names.get(row)):
        assert one is None or np.asarray(value(one, result)).tobytes() == all_.tobytes(), one


@each(
    ("text", "wanted"),
    [
        ("a.x * a.r", lambda r: r["a.x"][:, None] * r["a.r"]),
        ("a.x - parameter(a.p)", lambda r: r["a.x"][:, None] - r.parameter("a.p")),
        ("norm(a.x)", lambda r: np.abs(r["a.x"])),
        ("total(a.x)", lambda r: r["a.x"]),
        ("norm(parameter(a.k))", lambda r: np.float64(7)),
        ("norm(last(a.r))", lambda r: np.linalg.norm(r["a.r"][-1])),
        ("a.r[2]", lambda r: r["a.r"][:, 1]),
        ("(a.r - a.s)[2]", lambda r: r["a.r"][:, 1] - r["a.s"][:, 1]),
        ("last(a.r - a.s)[2]", lambda r: r["a.r"][-1, 1] - r["a.s"][-1, 1]),
        ("parameter(a.p[2]) + parameter(a.p)[2]", lambda r: np.float64(0.4)),
        ("total(parameter(a.m))", lambda r: np.float64(10)),
        ("parameter(a.m[2,1]) + 0 * parameter(a.m)[1, 2]", lambda r: np.float64(3)),
        ("at(a.x, 0.25 s)", lambda r: r["a.x"][2]),
        ("at(a.x, 200 ms)", lambda r: r["a.x"][2]),
    ],
)
@each("rows", [1, 3, 4, ROWS])
def test_a_row_and_an_element_are_distinguished_for_any_numbers(text, wanted, rows, result):
    """With 3 rows a scalar history is as long as a vector, with 4 as a matrix."""
    if "at(" in text and rows < 4:
        return
    short = replace(result, time=result.time[:rows], values=result.values[:rows])
    np.testing.assert_array_equal(value(text, short), wanted(short), strict=True)


@each(
    ("text", "reason"),
    [
        ("at(a.x, 0.5 s)", r"at\(\): expected a time from 0 to 0.4 s, got 0.5 s"),
        ("at(a.x, -1 ms)", r"at\(\): expected a time from 0 to 0.4 s, got -0.001 s"),
        ("at(a.x, a.y)", r"at\(x, time\): expected a time as `60 s`, got `a.y`"),
        ("last(parameter(a.p))", r"last\(\): `parameter\(a.p\)` has no rows"),
        ("first(max(a.x))", r"first\(\): `max\(a.x\)` has no rows"),
        ("(a.r - a.s)[4]", r"`a.r - a.s` has 3 elements"),
        ("norm(a.r)[2]", r"`norm\(a.r\)` has 1 elements"),
        ("(a.r - a.s)[0]", r"an index is the number of an element, counted from 1, not \[0\]"),
        ("a.r[-1]", r"not \[-1\]; for a row, write first\(x\), last\(x\) or at\(x, 60 s\)"),
        ("a.r[:, 1]", r"not \[:, 1\]; for a row, write first\(x\), last\(x\) or at"),
        ("a.r[1:2]", r"not \[1:2\]"),
        ("a.r[True]", r"not \[True\]"),
        ("settling_time(time, a.r, 1)", r"error is a vector; write norm\(error\)"),
    ],
)
def test_a_row_or_element_that_does_not_exist_is_an_error(text, reason, result):
    with pytest.raises(ValueError, match=reason):
        value(text, result)


def test_only_the_requested_rows_are_read(result):
    """Of 18 000 rows of a run the last one costs a hundredth."""
    read = []

    class Watched(np.ndarray):
        def __array_finalize__(self, _):
            read.append(self.shape)

    def look_up(path):
        return history(result, path).view(Watched)

    evaluate(parsed("last(norm(a.r - a.s))"), look_up)
    assert (1, 3) in read
    read.clear()
    evaluate(parsed("max(norm(a.r - a.s))"), look_up)
    assert (1, 3) not in read


@pytest.mark.parametrize(
    ("text", "required"),
    [
        ("sin(a.x, a.x)", "sin(x): expected 1 argument, got 2"),
        ("sin()", "sin(x): expected 1 argument, got 0"),
        ("max(a.r, 0, a.x)", "max(x): expected 1 argument, got 3"),
        ("percentile(a.x)", "percentile(x, percent): expected 2 arguments, got 1"),
        ("settling_time(time, a.x)", "settling_time(time, error, band): expected 3 arguments"),
        ("steady(time, a.x, 1)", "steady(time, error): expected 2 arguments, got 3"),
    ],
)
def test_a_function_has_its_own_number_of_arguments(text, required, result):
    """The second argument of a function of numpy is where it writes to."""
    before = result.values.tobytes()
    with pytest.raises(ValueError, match=re.escape(required)):
        value(text, result)
    assert result.values.tobytes() == before


def test_every_function_takes_as_many_arguments_as_it_states(result):
    given = {"x": "abs(a.r)", "time": "time", "error": "a.x", "band": "9", "percent": "50"}
    given |= {"q": "a.r", "p": "a.r", "r": "a.r", "v": "a.s"}
    given |= {"u": "a.r", "sigma": "a.r", "inc": "1", "argp": "2", "raan": "3", "nu": "4"}
    for name, function in FUNCTIONS.items():
        arguments = ", ".join(given[each] for each in function.arguments)
        arguments = {"at": "abs(a.r), 0.2"}.get(name, arguments)
        arguments = {"sin": "a.r / 1 m", "cos": "a.r / 1 m"}.get(name, arguments)
        arguments = {"turned": "hill(a.r, a.s), a.r"}.get(name, arguments)
        assert np.isfinite(value(f"{name}({arguments})", result)).all()


def test_attitudes_of_parameters_and_of_orbits(result):
    """Against rotations of scipy: x of the Hill frame by angles, a vector turned by parameters."""
    r, v = np.array(result["a.r"][0]), np.array(result["a.s"][0])
    sigma = r / (1 + np.linalg.norm(r))
    found = FUNCTIONS["turned"].value(FUNCTIONS["mrp"].value(sigma), v)
    close(found, Rotation.from_mrp(sigma).apply(np.array(v)), rel=1e-14)
    q = FUNCTIONS["orbit"].value(0.7, 0.3, 2.0, -1.1)
    axes = Rotation.from_euler("ZXZ", [2.0, 0.7, 0.3 - 1.1])
    for axis in np.eye(3):
        close(FUNCTIONS["turned"].value(q, axis), axes.apply(axis), rel=1e-14)
    angle = np.arccos(r @ v / np.linalg.norm(r) / np.linalg.norm(v))
    assert FUNCTIONS["angle_between"].value(r, v) == pytest.approx(angle, rel=1e-12)


def test_nothing_can_write_into_a_result(result):
    for array in (result.values, result.time, result["a.r"], result["a.x"]):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    table = np.zeros((2, 1))
    Result("", np.zeros(2), ("a.x",), ("m",), table)
    table[:] = 1  # its owner may go on after filling it


@pytest.mark.parametrize(
    ("text", "limit"),
    [
        ("a.x > " + "1" * 301, "a number in the expression has more than 300 digits"),
        ("a.x > " + "1_" * 200 + "1", "a number in the expression has more than 300 digits"),
        ("a.x > " + "1" * 30_000, "expression is longer than 10000 characters"),
        ("a.x > 0x" + "f" * 9_000, "a number exceeds 1e300"),
        (
            " + ".join(["a.x"] * 300),
            r"expression is nested too deeply \(limit 200 levels, one per term",
        ),
        (
            " + ".join(["a.x"] * 1_600),
            r"expression is nested too deeply \(limit 200 levels, one per term",
        ),
        (" + ".join(["a.x"] * 2_000), "expression is longer than 10000 characters"),
        ("- " * 250 + "a.x", r"expression is nested too deeply \(limit 200 levels, one per term"),
        ("abs(" * 190 + "-" * 20 + "a.x" + ")" * 190, "expression is nested too deeply"),
        ("time<1or a.x > 2", "is not an expression"),
        ("a.x > 1 # and a.y > 2", "`# and a.y > 2`: an expression cannot contain a comment"),
        ("a.x > 1 & a.y > 2", "`1 & a.y`: write `and`, `or`, `not` for"),
        ("(a.x > 1) | (a.y > 2)", r"`\(a.x > 1\) \| \(a.y > 2\)`: write `and`, `or`, `not` for"),
        ("~(a.x > 1)", r"`~\(a.x > 1\)`: write `and`, `or`, `not` for"),
    ],
)
def test_digits_and_terms_have_limits_that_are_reported(text, limit):
    with pytest.raises(ValueError, match=limit):
        parsed(text)


def test_an_expression_within_the_limits_has_a_value(result):
    sum_of = value(" + ".join(["a.x"] * 190), result)
    assert np.allclose(sum_of, 190 * result["a.x"], rtol=1e-12)
    assert not value("a.x > 0x" + "f" * 200, result).any()
    assert not value("a.x > " + "9" * 300, result).any()
    assert value(" and ".join(["a.x < 9"] * 800), result).all()
    assert value("-" * 190 + "a.x", result).tolist() == result["a.x"].tolist()


@each("width", range(1, 13))
@each("rows", [1, 2, 1000])
def test_lengths_and_sums_of_rows_have_the_bits_of_numpy(rows, width):
    rng = np.random.default_rng(7)
    table = rng.normal(size=(rows, 20)) * 10.0 ** rng.uniform(-140, 140, size=(rows, 20))
    table[0, 3], table[rows // 2, 2 + width] = np.inf, np.nan
    for x in (table[:, 3 : 3 + width], table[:, 3 : 3 + width].copy(), table[0, :width]):
        norm, total = (FUNCTIONS[name].value(x) for name in ("norm", "total"))
        assert norm.tobytes() == np.asarray(np.linalg.norm(x, axis=-1)).tobytes()
        assert total.tobytes() == np.asarray(np.sum(x, axis=-1)).tobytes()


@pytest.mark.parametrize("text", ["last(norm(a.r)) < 5", "last(norm(a.r)) < 5 cm"])
def test_a_result_is_free_once_its_expression_is_known(text, result):
    """Else the tables of many runs stay in memory until garbage is collected."""
    again = Result("", result.time, result.columns, result.units, result.values.copy())
    gone = weakref.ref(again)
    gc.disable()
    try:
        plain = resolved(parsed(text), lambda path, of=again: unit_in(of, path))
        evaluate(plain, lambda path, of=again: history(of, path))
        del again
        assert gone() is None
    finally:
        gc.enable()
