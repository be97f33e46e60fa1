# SPDX-License-Identifier: BSD-2-Clause
"""Tables of TOML against their declarations: every mistake is a line with entry, rule and value."""

from typing import Any

import msgspec
import pytest

from harness.system.tables import Count, Flag, Number, Positive, Text, Whole, problems


class Inner(msgspec.Struct, frozen=True):
    text: Text
    flag: Flag = False


class Table(msgspec.Struct, frozen=True):
    step: Positive
    runs: Count = 1
    inner: Inner | None = None
    numbers: dict[str, Number] = {}


class Outer(msgspec.Struct, frozen=True):
    tables: dict[str, Inner]


def test_a_valid_table_has_no_problems() -> None:
    assert not list(problems({"step": 1, "runs": 3, "numbers": {"a": -1}}, Table))


@pytest.mark.parametrize(
    ("value", "kind"),
    [
        (True, Number), (float("nan"), Number), (float("inf"), Number), (10**400, Number),
        ("1", Number), (0, Positive), (float("inf"), Positive), (1.0, Whole), (-1, Whole),
        (0, Count), (True, Count), (1, Text), (1, Flag), ([1.0], Number), (1, dict[str, Text]),
    ],
)  # fmt: skip
def test_a_wrong_value_is_named_with_its_rule(value: Any, kind: Any) -> None:
    (line,) = problems(value, kind, "here")
    assert line.startswith("here: must be ")
    assert f", not {value!r:.80}" in line


def test_all_mistakes_are_reported_at_once_with_their_places() -> None:
    given = {"tables": {"one": {"txt": "a"}, "two": 3, "three": {"text": 1, "flag": 0}}}
    assert list(problems(given, Outer)) == [
        "tables.one.txt: there is no such entry (close: text)",
        "tables.one.text: is missing",
        "tables.two: must be a table, not 3",
        "tables.three.text: must be a text, not 1",
        "tables.three.flag: must be true or false, not 0",
    ]


def test_the_whole_file_has_no_place() -> None:
    found = list(problems({"step": -1, "inner": {"text": 2}, "numbers": {"a": "b"}}, Table))
    assert found == [
        "step: must be a finite number above 0, not -1",
        "inner.text: must be a text, not 2",
        "numbers.a: must be a finite number, not 'b'",
    ]
