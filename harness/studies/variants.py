# SPDX-License-Identifier: BSD-2-Clause
"""What a comparison runs: every combination of the options that were given several values."""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from harness.errors import UsageError
from harness.master.changes import Changes, joined, pairs, unmapped
from harness.spelling import is_number
from harness.system.values import parse

NAMED = ("swap", "latency", "set")
"""Options whose values stand after `component=` or `component.parameter=`."""

MAX_RUNS = 10_000
"""Runs of one comparison."""


@dataclass(frozen=True)
class Variant:
    """One run: a label that tells it from the others, and what is changed in the system."""

    label: str
    changes: Changes
    file: str = ""
    """The label as the stem of a file name, which no other variant has."""
    varied: frozenset[str] = frozenset()
    """Parameters that --vary gives, not --set."""


class _Choice(NamedTuple):
    """One value of one option: its label and the change it stands for."""

    label: str
    option: str
    value: str | tuple[str, str]


def combinations(fixed: Changes, varied: Sequence[tuple[str, str]]) -> list[Variant]:
    """All combinations, the last option changing fastest.

    fixed: changes common to all; varied: option (params, algorithm, swap, latency, set) and its
    values separated by commas, for the last three after `component=` or `component.parameter=`; a
    parameter may also be given as a range first:last:step. Only options with several values appear
    in the labels. Raises UsageError if there is nothing to compare.
    """
    choices = [list(_choices(option, text)) for option, text in varied]
    _refuse_doubles(choices)
    several = [len(each) > 1 for each in choices]
    if (count := math.prod(map(len, choices))) > MAX_RUNS:
        raise UsageError(f"these are {count} runs, more than the limit of {MAX_RUNS}")
    if not any(several):
        raise UsageError(
            "there is nothing to compare: give several values, e.g. --swap controller=A,B or "
            "--params A,B"
        )
    swaps = [each[0].option for each, many in zip(choices, several, strict=True) if many]
    if swaps.count("swap") > 1:
        for each in choices:
            if each[0].option == "swap":  # several are swapped: whose is the FMU of a label?
                each[:] = [c._replace(label=f"{c.value[0]}={c.label}") for c in each]
    variants = [
        _variant(fixed, combination, several) for combination in itertools.product(*choices)
    ]
    return with_files(_with_maps(variants))


def _with_maps(variants: Sequence[Variant]) -> Sequence[Variant]:
    """Every variant with those names of ports that its FMUs know; UsageError if one is for none."""
    names = dict(pairs("--map", variants[0].changes.get("map", ())))
    if not names:
        return variants
    swaps = [dict(pairs("--swap", v.changes.get("swap", ()))) for v in variants]
    strange = [unmapped(each, names) for each in swaps]
    for name in names:
        if all(name in each for each in strange):
            raise UsageError(f"--map {name}: no FMU that is swapped has such a port")
    return [
        replace(v, changes={**v.changes, "map": {a: b for a, b in names.items() if a not in each}})
        for v, each in zip(variants, strange, strict=True)
    ]


def with_files(variants: Sequence[Variant]) -> list[Variant]:
    """Every variant with a file of its own, on file systems too that do not tell cases apart."""
    taken: set[str] = set()
    found = []
    for variant in variants:
        stem = re.sub(r"[^\w.+-]+", "_", variant.label)[:100].strip(".") or "run"
        stem = re.sub(r"\.partial$", "_partial", stem, flags=re.IGNORECASE)
        names = itertools.chain([stem], (f"{stem}-{n}" for n in itertools.count(2)))
        file = next(name for name in names if name.casefold() not in taken)
        taken.add(file.casefold())
        found.append(replace(variant, file=file))
    return found


def _refuse_doubles(choices: Sequence[Sequence[_Choice]]) -> None:
    named = [
        (c[0].option, c[0].value if isinstance(c[0].value, str) else c[0].value[0]) for c in choices
    ]
    for option, name in named:
        if option in NAMED and named.count((option, name)) > 1:
            raise UsageError(f"--{'vary' if option == 'set' else option} {name}: is given twice")


def _choices(option: str, text: str) -> Iterator[_Choice]:
    shown = f"--{'vary' if option == 'set' else option}"
    name, given = next(pairs(shown, [text])) if option in NAMED else ("", text)
    values = [each for piece in _split(given) for each in _values(piece.strip(), option, name)]
    stems = [Path(value).stem for value in values]
    counts, alike = Counter(values), Counter(stems)
    meanings = Counter(_meaning(value, option) for value in values)
    for value, stem in zip(values, stems, strict=True):
        if not value:
            raise UsageError(f"{shown} {text}: a value is missing")
        if counts[value] > 1 or meanings[_meaning(value, option)] > 1:
            raise UsageError(f"{shown} {text}: {value} is given twice")
        labels = {
            "swap": value if alike[stem] > 1 else stem,
            "latency": f"{name} {'on time' if value == '0' else f'{value} late'}",
            "set": f"{name}={value}",
        }
        yield _Choice(labels.get(option, value), option, (name, value) if name else value)


def _meaning(value: str, option: str) -> Any:
    """What is equal for equal values: 1 and +1, under all options that take numbers."""
    return _hashable(parse(value)) if option in ("set", "latency") else value


def _hashable(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(map(_hashable, value))
    return repr(value) if isinstance(value, dict) else value


def _split(text: str) -> Iterator[str]:
    """The pieces between commas that stand outside all brackets."""
    piece, depth = "", 0
    for character in text:
        depth += (character == "[") - (character == "]")
        if character == "," and depth == 0:
            yield piece
            piece = ""
        else:
            piece += character
    yield piece


def _values(text: str, option: str, name: str) -> Sequence[str]:
    """The numbers of `first:last:step`, both ends included; anything else is itself."""
    parts = text.split(":")
    ranged = len(parts) == 3 or (len(parts) > 1 and all(map(is_number, parts)))
    return _range(text, name) if option == "set" and ranged else [text]


def _range(text: str, name: str) -> Sequence[str]:
    place = f"--vary {name}={text}"
    try:
        first, last, step = map(float, text.split(":"))
        count = round((last - first) / step)
    except (ValueError, ZeroDivisionError, OverflowError) as error:
        raise UsageError(
            f"{place}: a range of values is first:last:step, three numbers, as in 0:1:0.1"
        ) from error
    if count >= MAX_RUNS:
        raise UsageError(f"{place}: are {count + 1} values, more than the limit of {MAX_RUNS}")
    if count < 0 or abs(first + count * step - last) > 1e-9 * abs(step):
        raise UsageError(
            f"{place}: the range does not end at {text.split(':')[1]} after whole steps"
        )
    return [f"{first + k * step:.12g}" for k in range(count + 1)]


def _variant(fixed: Changes, combination: Sequence[_Choice], several: Sequence[bool]) -> Variant:
    changes = fixed
    for choice in combination:
        value = choice.value if isinstance(choice.value, str) else dict([choice.value])
        changes = joined(changes, {choice.option: value})  # type: ignore[misc]
    return Variant(
        ", ".join(c.label for c, varies in zip(combination, several, strict=True) if varies),
        changes,
        varied=frozenset(c.value[0] for c in combination if c.option == "set"),
    )
