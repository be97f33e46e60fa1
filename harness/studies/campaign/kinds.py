# SPDX-License-Identifier: BSD-2-Clause
"""Of what kind the entries of a campaign are, judged before any of them is understood."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple


class Kind(NamedTuple):
    """What a value must be: a test and its words."""

    holds: Callable[[Any], bool]
    words: str


def is_number(value: Any) -> bool:
    """Whether it is a number that a double holds; true and false are none."""
    return isinstance(value, float) or (is_whole(value) and abs(value) < 2**1023)


def is_whole(value: Any) -> bool:
    """Whether it is a whole number."""
    return isinstance(value, int) and not isinstance(value, bool)


def _is_text(value: Any) -> bool:
    return isinstance(value, str | Path)


def _are_texts(value: Any) -> bool:
    return isinstance(value, Sequence) and not _is_text(value) and all(map(_is_text, value))


def _is_table(value: Any) -> bool:
    return isinstance(value, Mapping)


TEXT = Kind(_is_text, "a text")
TEXT_OR_TABLE = Kind(lambda v: _is_text(v) or _is_table(v), "a text or a table")
TEXTS = Kind(_are_texts, "a list of texts")
TABLE = Kind(_is_table, "a table")
NUMBER = Kind(is_number, "a number")
COUNT = Kind(lambda v: is_whole(v) and v >= 1, "a whole number of at least 1")
STEPS = Kind(lambda v: is_whole(v) and v >= 0, "a whole number of at least 0")
PAIRS = Kind(lambda v: _is_table(v) or _are_texts(v), "a table, or a list of name=value")

ENTRIES = {
    "system": TEXT,
    "sampler": TEXT,
    "fixed": TABLE,
    "factors": TABLE,
    "seeds": TEXTS,
    "metrics": TABLE,
    "success": TEXT,
    "worst": TEXT_OR_TABLE,
    "keep": TABLE,
    "expected": TABLE,
    "requirements": TABLE,
}
CHANGES = {
    "params": TEXT,
    "set": PAIRS,
    "swap": PAIRS,
    "map": PAIRS,
    "on": PAIRS,
    "latency": PAIRS,
    "step": NUMBER,
    "stop": NUMBER,
    "algorithm": TEXT,
    "epoch": TEXT,
}
"""Changes of run() that a campaign may fix."""
KEPT = {"histories": TEXTS, "bands": TEXTS, "rows": COUNT}
NAMED = {"swap": TEXT, "latency": STEPS}
"""Changes of one component each, as factors."""


def wrong_entries(definition: Mapping[str, Any]) -> Iterator[str]:
    """Entries of a wrong kind, a line each."""
    yield from _wrong("", definition, ENTRIES)
    for name, kinds in (("fixed", CHANGES), ("keep", KEPT)):
        if _is_table(table := definition.get(name, {})):
            yield from _wrong(f"{name}.", table, kinds)
    if _is_table(metrics := definition.get("metrics", {})):
        yield from _wrong("metrics.", metrics, dict.fromkeys(metrics, TEXT))


def _wrong(place: str, table: Mapping[str, Any], kinds: Mapping[str, Kind]) -> Iterator[str]:
    for name, kind in kinds.items():
        if name in table and not kind.holds(table[name]):
            yield f"{place}{name}: must be {kind.words}, not {str(table[name])[:80]}"


def wrong_choices(name: str, choices: Sequence[Any]) -> Iterator[str]:
    """Listed values of a factor that are of a wrong kind, a line each."""
    kind = CHANGES.get(name) or NAMED.get(name.partition(".")[0])
    for choice in choices:
        if kind and not kind.holds(choice):
            yield f"must be {kind.words}, not {str(choice)[:80]}"
