# SPDX-License-Identifier: BSD-2-Clause
"""Variants of a comparison: every combination of the options with several values, which are factors
as in a campaign.
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
    """Run of a comparison: a unique label, and its changes to the system."""

    label: str
    changes: Changes
    file: str = ""
    """Label as a unique stem of a file name."""
    varied: frozenset[str] = frozenset()
    """Parameters that --vary sets, not --set."""


def combinations(fixed: Changes, varied: Sequence[tuple[str, str]]) -> list[Variant]:
    """Return all combinations, the last option changing fastest.

    fixed: changes common to all; varied: option (params, algorithm, swap, latency, set) and its
    values separated by commas, for the last three after `component=` or `component.parameter=`; a
    parameter may also be given as a range first:last:step. Only options with several values appear
    in the labels. Raises UsageError if there is nothing to compare.
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
    """Return an option with its values as a factor."""
    shown = f"--{'vary' if option == 'set' else option}"
    named = option in ("swap", "latency", "set")
    name, given = next(pairs(shown, [text])) if named else ("", text)
    if option == "set" and kind_of(name):
        raise UsageError(f"{shown} {text}: expected component.parameter")
    texts = pieces(given)
    if option == "set":
        texts = [value for each in texts for value in _range(each, f"{shown} {name}={each}")]
    for value, times in Counter(texts).items():
        if not value or times > 1:
            wrong = f"{value} is given twice" if value else "a value is missing"
            raise UsageError(f"{shown} {text}: {wrong}")
    return Factor(name if option == "set" else ".".join(filter(None, (option, name))), tuple(texts))


def _given(factor: str) -> str:
    """Return the option that gives a factor."""
    option, name = option_of(factor)
    return f"--{'vary' if option == 'set' else option} {name}".rstrip()


def _range(text: str, place: str) -> Sequence[str]:
    """Return the numbers of `first:last:step`, both ends included; any other text is a single
    value.
    """
    parts = text.split(":")
    if len(parts) != 3 and (len(parts) == 1 or not all(map(is_number, parts))):
        return [text]
    needed = "a range first:last:step that ends at last after whole steps"
    wrong = UsageError(f"{place}: expected {needed}, not more than the limit of {MAX_RUNS} values")
    try:
        first, last, step = map(float, parts)
        count = round((last - first) / step)
    except (ValueError, ZeroDivisionError, OverflowError) as error:
        raise wrong from error
    if not 0 <= count < MAX_RUNS or abs(first + count * step - last) > 1e-9 * abs(step):
        raise wrong
    return [f"{first + k * step:.12g}" for k in range(count + 1)]


def _labels(factor: Factor, several: Sequence[Factor]) -> dict[str, str]:
    """Return the labels of a factor's values: FMUs and files by their stems unless these are equal,
    with the component if FMUs of several components are compared.
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
    """Return every variant with the names of ports that its FMUs have; raise UsageError for a name
    that no FMU has.
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
    """Return every variant with a unique file, also on file systems that do not
    distinguish cases.
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
