# SPDX-License-Identifier: BSD-2-Clause
"""Expressions over a result: one row of them is that row of the whole, and nothing is kept."""

import gc
import re
import weakref

import numpy as np
import pytest

from harness.results.evaluation import evaluate, history, resolved, unit_in
from harness.results.expressions import FUNCTIONS, parsed
from harness.results.result import Result
from tests.each import each

ROWS = 5


@pytest.fixture
def result():
    rng = np.random.default_rng(3)
    names = [f"a.{v}[{i}]" for v in ("r", "s") for i in range(3)]
    names += [f"a.w[{i}]" for i in range(ROWS)] + ["a.x", "a.y"]
    given = ["a.p[0]", "a.p[1]", "a.p[2]", "a.k"]
    parameters = Result("", np.zeros(1), tuple(given), ("m",) * 4, np.array([[0.1, 0.2, 0.3, 7.0]]))
    values = rng.normal(size=(ROWS, len(names)))
    time = np.arange(ROWS) / 10
    return Result("", time, tuple(names), ("m",) * len(names), values, parameters=parameters)


def whole(text, result):
    """The value without the short way: the history of what is indexed, then the index."""
    inner, _, index = text.rpartition("[")
    return evaluate(parsed(inner), lambda path: history(result, path))[int(index[:-1])]


def value(text, result):
    return evaluate(parsed(text), lambda path: history(result, path))


@each("row", [-1, 0, 2, -ROWS, ROWS - 1])
@each(
    "text",
    [
        "a.x",
        "(a.x - a.y)",
        "(a.x / 2 + -a.y)",
        "abs(sqrt(abs(a.x)) - exp(a.y))",
        "norm(a.r - a.s)",
        "total(a.w)",
        "(norm(a.r) * a.x > 0.1)",
        "(a.r - parameter(a.p))",
        "norm(a.r + parameter(a.k))",
        "(time * 2)",
        "(norm(a.x) * a.r)",
        "(max(a.x) - a.x)",
        "(a.r[:, 1] - a.x)",
        "norm(a.w)",
    ],
)
def test_one_row_of_an_expression_is_that_row_of_the_whole(text, row, result):
    """norm(a.x) is of all rows, (a.x - max(a.x)) knows them: no row of these stands alone."""
    one, all_ = value(f"{text}[{row}]", result), whole(f"{text}[{row}]", result)
    assert np.asarray(one).tobytes() == np.asarray(all_).tobytes()
    if row == -1:
        assert np.asarray(value(f"last({text})", result)).tobytes() == np.asarray(all_).tobytes()


@pytest.mark.parametrize(
    "text",
    [
        "(a.x * a.r)",  # (rows,) beside (rows, 3)
        "(a.x - parameter(a.p))",  # (rows,) beside (3,)
        "(norm(a.r) - a.r)",
        "norm(a.x)",  # a number
        "parameter(a.k)",
    ],
)
def test_shapes_that_do_not_fit_fit_in_no_single_row(text, result):
    with pytest.raises((ValueError, IndexError)):
        value(f"{text}[-1]", result)


@pytest.mark.parametrize("row", [ROWS, -ROWS - 1])
def test_a_row_that_does_not_exist_is_none(row, result):
    with pytest.raises(IndexError):
        value(f"norm(a.r)[{row}]", result)


def test_only_the_rows_that_are_asked_for_are_read(result):
    """Of 18 000 rows of a flight the last one costs a hundredth."""
    read = []

    class Watched(np.ndarray):
        def __array_finalize__(self, _):
            read.append(self.shape)

    def look_up(path):
        return history(result, path).view(Watched)

    evaluate(parsed("norm(a.r - a.s)[-1]"), look_up)
    assert (1, 3) in read
    read.clear()
    evaluate(parsed("max(norm(a.r - a.s))"), look_up)
    assert (1, 3) not in read


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("sin(a.x, a.x)", "sin(x): expected 1 argument, got 2"),
        ("sin()", "sin(x): expected 1 argument, got 0"),
        ("max(a.r, 0, a.x)", "max(x): expected 1 argument, got 3"),
        ("percentile(a.x)", "percentile(x, percent): expected 2 arguments, got 1"),
        ("settling_time(time, a.x)", "settling_time(time, error, band): expected 3 arguments"),
        ("steady(time, a.x, 1)", "steady(time, error): expected 2 arguments, got 3"),
    ],
)
def test_a_function_has_its_own_number_of_arguments(text, wanted, result):
    """The second argument of a function of numpy is where it writes to."""
    before = result.values.tobytes()
    with pytest.raises(ValueError, match=re.escape(wanted)):
        value(text, result)
    assert result.values.tobytes() == before


def test_every_function_takes_as_many_arguments_as_it_says(result):
    given = {"x": "abs(a.r)", "time": "time", "error": "a.x", "band": "9", "percent": "50"}
    given |= {"q": "a.r", "p": "a.r"}
    for name, function in FUNCTIONS.items():
        arguments = ", ".join(given[each] for each in function.arguments)
        assert np.isfinite(value(f"{name}({arguments})", result)).all()


def test_nothing_can_write_into_a_result(result):
    for array in (result.values, result.time, result["a.r"], result["a.x"]):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    table = np.zeros((2, 1))
    Result("", np.zeros(2), ("a.x",), ("m",), table)
    table[:] = 1  # whoever has filled it may go on


@pytest.mark.parametrize(
    ("text", "limit"),
    [
        ("a.x > " + "1" * 301, "a number has more than 300 digits"),
        ("a.x > " + "1_" * 200 + "1", "a number has more than 300 digits"),
        ("a.x > " + "1" * 30_000, "it is longer than 10000 characters"),
        ("a.x > 0x" + "f" * 9_000, "there is no number beyond 1e300"),
        (" + ".join(["a.x"] * 300), "it has more than 200 levels, of which each term is one"),
        (" + ".join(["a.x"] * 1_600), "it has more than 200 levels, of which each term is one"),
        (" + ".join(["a.x"] * 2_000), "it is longer than 10000 characters"),
        ("- " * 250 + "a.x", "it has more than 200 levels, of which each term is one"),
        ("abs(" * 190 + "-" * 20 + "a.x" + ")" * 190, "it has more than 200 levels"),
        ("time<1or a.x > 2", "it is not an expression"),
        ("a.x[True]", "an index must be a whole number"),
    ],
)
def test_digits_and_terms_have_limits_that_are_told(text, limit):
    with pytest.raises(ValueError, match=limit):
        parsed(text)


def test_what_is_within_the_limits_has_a_value(result):
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


@pytest.mark.parametrize("text", ["norm(a.r)[-1] < 5", "norm(a.r)[-1] < 5 cm"])
def test_a_result_is_free_once_its_expression_is_known(text, result):
    """Else the tables of many flights stay in memory until garbage is collected."""
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
