# SPDX-License-Identifier: BSD-2-Clause
"""Texts of values, and the scalar variables that they represent."""

from __future__ import annotations

import pytest

from harness.system.values import assign, base, coerce, elements_of, expand, index, leaves, parse
from tests.each import each

KNOWN = [
    "mass",
    "rho[1]",
    "rho[2]",
    "rho[3]",
    "J[1,1]",
    "J[1,2]",
    "J[2,1]",
    "J[2,2]",
    "M.bias[1]",
    "M.bias[2]",
]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1.5", 1.5),
        ("-3", -3.0),
        (".5", 0.5),
        ("1e-3", 1e-3),
        ("[1, 2.5, -3]", [1, 2.5, -3]),
        ("[[1, 2], [3, 4]]", [[1, 2], [3, 4]]),
        ("true", True),
        ("quick", "quick"),
    ],
)
def test_a_value_is_a_number_a_list_or_a_text(text, value):
    assert parse(text) == value


def test_vectors_and_matrices_expand_to_one_based_elements():
    assert expand("m", 2.0) == {"m": 2.0}
    assert expand("r", [1, 2]) == {"r[1]": 1, "r[2]": 2}
    assert expand("J", [[1, 2], [3, 4]]) == {"J[1,1]": 1, "J[1,2]": 2, "J[2,1]": 3, "J[2,2]": 4}


def test_tables_give_dotted_names():
    table = {"M": {"bias": [1, 2], "start": 3}, "mass": 4}
    assert list(leaves(table)) == [("M.bias", [1, 2]), ("M.start", 3), ("mass", 4)]


def test_names_split_into_base_and_indices():
    assert (base("J[1,2]"), index("J[1,2]")) == ("J", (1, 2))
    assert (base("M.bias[3]"), index("M.bias[3]")) == ("M.bias", (3,))
    assert (base("mass"), index("mass")) == ("mass", ())


def test_a_port_represents_its_elements_in_order_of_their_numbers():
    names = [f"e[{i}]" for i in (10, 2, 1)]
    assert elements_of("e", names) == ["e[1]", "e[2]", "e[10]"]
    assert elements_of("e[2]", names) == ["e[2]"]
    assert elements_of("f", names) == []


def test_assignment_fits_the_shape_of_the_variable():
    assert assign("M.bias", [1, 2], KNOWN) == {"M.bias[1]": 1, "M.bias[2]": 2}
    assert assign("J[2,1]", 7.0, KNOWN) == {"J[2,1]": 7.0}


@each(
    ("name", "value", "problem"),
    [
        ("mas", 1.0, r"there is no such variable \(close: mass\)"),
        ("rho", [1, 2], "expected 3 elements, got 2 elements"),
        ("rho", [1, 2, 3, 4], "expected 3 elements, got 4 elements"),
        ("rho", 1.0, r"expected 3 elements, got a number; write \[1, 1, 1\]"),
        ("mass", [1.0], "expected a number, got 1 element"),
        ("J", [1, 2, 3, 4], "expected 2 x 2 elements, got 4 elements"),
        ("J", [[1, 2]] * 3, "got 3 x 2 elements; the FMU fixes the number of elements"),
        ("J", [[1, 2], [3]], "expected 2 x 2 elements, got a ragged list"),
        ("J", [[1, 2], 3], "expected 2 x 2 elements, got a ragged list"),
        ("rho", [], "an empty list has no elements"),
        ("mass", float("nan"), "it must not be NaN"),
        ("rho", [1, float("nan"), 3], r"rho\[2\] must not be NaN"),
    ],
)
def test_a_misfit_is_described(name, value, problem):
    with pytest.raises(ValueError, match=problem):
        assign(name, value, KNOWN)


def test_values_take_the_type_of_the_variable():
    assert coerce(1, "Real") == 1.0
    assert isinstance(coerce(1, "Real"), float)
    assert coerce(2.0, "Integer") == 2
    assert isinstance(coerce(2.0, "Integer"), int)
    assert coerce(1.0, "Boolean") is True
    assert coerce(1.5, "String") == "1.5"
