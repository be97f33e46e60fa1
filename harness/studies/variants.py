# SPDX-License-Identifier: BSD-2-Clause
"""Variants of a comparison: all combinations of the values of options with several values. Each of
these options is treated like a factor with listed values in a campaign.
"""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from harness.errors import UsageError
from harness.master.changes import Changes, joined, no_port, pairs, unmapped
from harness.spelling import is_number, pieces
from harness.studies.campaign.factors import Factor
from harness.studies.campaign.plan import changes_of, kind_of, option_of

MAX_RUNS = 10_000
"""Largest number of runs of one comparison."""


@dataclass(frozen=True)
class Variant:
    """Run of a comparison: a unique label, and the changes of the system."""

    label: str
    changes: Changes
    file: str = ""
    """Stem of the name of the results file: the label, made unique and valid for file systems."""
    varied: frozenset[str] = frozenset()
    """Parameters whose values the user gave by --vary, not by --set."""


def combinations(fixed: Changes, varied: Sequence[tuple[str, str]]) -> list[Variant]:
    """Return a variant for every combination of the values of all options; from one variant to the
    next, the last option changes fastest. Labels contain only options with several values.

    fixed: changes common to all variants; varied: pairs of option and text, e.g. ("params", "A,B"),
    ("swap", "component=FMU1,FMU2"), ("latency", "component=0,1"), ("set", "component.name=1,2") or
    ("set", "component.name=first:last:step"). Raises UsageError for a wrong option or value, for
    too many runs, and if there is nothing to compare.
    """
    factors = [_factor(option, text) for option, text in varied]
    for name, times in Counter(f.name for f in factors).items():
        if times > 1:
            raise UsageError(f"{_given(name)}: is given twice")
    several = [f for f in factors if len(f.choices) > 1]
    if (count := math.prod(len(f.choices) for f in factors)) > MAX_RUNS:
        raise UsageError(f"{count} runs are defined, more than the limit of {MAX_RUNS}")
    if not several:
        raise UsageError("there is nothing to compare: give several values, e.g. --params A,B")
    labels = {f.name: _labels(f, several) for f in several}
    own = frozenset(f.name for f in factors if option_of(f.name)[0] == "set")
    variants = []
    for values in itertools.product(*(f.choices for f in factors)):
        run = dict(zip((f.name for f in factors), values, strict=True))
        label = ", ".join(known[run[name]] for name, known in labels.items())
        variants.append(Variant(label, joined(fixed, changes_of(run)), varied=own))
    return with_files(_with_maps(variants))


def _factor(option: str, text: str) -> Factor:
    """Return an option and the text of its values as a factor; raise UsageError if a value is
    missing or given twice.
    """
    shown = f"--{'vary' if option == 'set' else option}"
    named = option in ("swap", "latency", "set")
    name, given = next(pairs(shown, [text])) if named else ("", text)
    if option == "set" and kind_of(name):
        raise UsageError(f"{shown} {text}: {name} is an option; expected component.parameter")
    texts = pieces(given)
    if option == "set":
        texts = [value for each in texts for value in _range(each, f"{shown} {name}={each}")]
    for value, times in Counter(texts).items():
        if not value or times > 1:
            wrong = f"{value} is given twice" if value else "a value is missing"
            raise UsageError(f"{shown} {text}: {wrong}")
    return Factor(name if option == "set" else ".".join(filter(None, (option, name))), tuple(texts))


def _given(factor: str) -> str:
    """Return the option and name by which the user gives a factor, such as `--vary
    component.parameter`.
    """
    option, name = option_of(factor)
    return f"--{'vary' if option == 'set' else option} {name}".rstrip()


def _range(text: str, place: str) -> Sequence[str]:
    """Return the numbers of a range `first:last:step`, both ends included, as texts; for a text
    that is no range, return this text as the only value. A text with two colons, or with numbers
    between its colons, counts as a range; raise UsageError if it is wrong. place: option and text
    for an error message.
    """
    parts = text.split(":")
    if len(parts) != 3 and (len(parts) == 1 or not all(map(is_number, parts))):
        return [text]
    needed = "a range first:last:step, a whole number of steps from first to last"
    wrong = UsageError(f"{place}: expected {needed}, at most {MAX_RUNS} values")
    try:
        first, last, step = map(float, parts)
        count = round((last - first) / step)
    except (ValueError, ZeroDivisionError, OverflowError) as error:
        raise wrong from error
    if not 0 <= count < MAX_RUNS or abs(first + count * step - last) > 1e-9 * abs(step):
        raise wrong
    return [f"{first + k * step:.12g}" for k in range(count + 1)]


def _labels(factor: Factor, several: Sequence[Factor]) -> dict[str, str]:
    """Return the label of each value of a factor, by value. The label of an FMU file is its stem,
    or the whole text if two stems are equal; the component precedes it if FMUs of several
    components are compared.

    several: all factors with more than one value.
    """
    option, name = option_of(factor.name)
    if option == "set":
        return {value: f"{name}={value}" for value in factor.choices}
    if option == "latency":
        late = {v: "on time" if v == "0" else f"{v} late" for v in factor.choices}
        return {value: f"{name} {text}" for value, text in late.items()}
    if option != "swap":
        return {value: value for value in factor.choices}
    alike = Counter(Path(value).stem for value in factor.choices)
    swaps = [f for f in several if option_of(f.name)[0] == "swap"]
    before = f"{name}=" if len(swaps) > 1 else ""
    stems = {value: Path(value).stem for value in factor.choices}
    return {value: before + (value if alike[s] > 1 else s) for value, s in stems.items()}


def _with_maps(variants: Sequence[Variant]) -> Sequence[Variant]:
    """Return every variant with only those entries of --map that name ports of its swapped FMUs;
    raise UsageError for an entry that applies to no variant.
    """
    names = dict(pairs("--map", variants[0].changes.get("map", ())))
    if not names:
        return variants
    swaps = [dict(pairs("--swap", v.changes.get("swap", ()))) for v in variants]
    strange = [unmapped(each, names) for each in swaps]
    for name in names:
        if all(name in each for each in strange):
            raise UsageError(no_port(name))
    return [
        replace(v, changes={**v.changes, "map": {a: b for a, b in names.items() if a not in each}})
        for v, each in zip(variants, strange, strict=True)
    ]


def with_files(variants: Sequence[Variant]) -> list[Variant]:
    """Return every variant with the stem of its results file, which is unique also on file systems
    that do not distinguish upper and lower case.
    """
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
