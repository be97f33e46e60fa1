"""What a comparison flies: every combination of the options that were given several values."""

from __future__ import annotations

import itertools
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from harness.errors import UsageError
from harness.overrides import Changes, pairs

BY_COMPONENT = ("swap", "latency")
"""Options whose values stand after `component=`."""


@dataclass(frozen=True)
class Case:
    """One flight: a label that tells it from the others, and what is changed in the system."""

    label: str
    changes: Changes

    @property
    def file(self) -> str:
        """The label as the stem of a file name."""
        return re.sub(r"[^\w.-]+", "_", self.label)


class _Choice(NamedTuple):
    """One value of one option: its label and the change it stands for."""

    label: str
    option: str
    value: str | tuple[str, str]


def cases(fixed: Changes, varied: Sequence[tuple[str, str]]) -> list[Case]:
    """All combinations, the last option changing fastest.

    fixed: changes common to all; varied: option (params, algorithm, swap, latency) and its values separated by commas,
    for swap and latency after `component=`. Only options with several values appear in the labels. Raises UsageError if
    there is nothing to compare.
    """
    choices = [list(_choices(option, text)) for option, text in varied]
    several = [len(each) > 1 for each in choices]
    if not any(several):
        raise UsageError("there is nothing to compare: give several values, e.g. --swap controller=A,B or --params A,B")
    return [_case(fixed, combination, several) for combination in itertools.product(*choices)]


def _choices(option: str, text: str) -> Iterator[_Choice]:
    component, given = next(pairs(f"--{option}", [text])) if option in BY_COMPONENT else ("", text)
    values = [value.strip() for value in given.split(",")]
    names = [Path(value).stem if option == "swap" else value for value in values]
    for value, name in zip(values, names, strict=True):
        if not value:
            raise UsageError(f"--{option} {text}: a value is missing")
        if values.count(value) > 1:
            raise UsageError(f"--{option} {text}: {value} stands there twice")
        label = value if Counter(names)[name] > 1 else name
        label = _delay(component, value) if option == "latency" else label
        yield _Choice(label, option, (component, value) if component else value)


def _delay(component: str, steps: str) -> str:
    return f"{component} {'on time' if steps == '0' else f'{steps} late'}"


def _case(fixed: Changes, combination: Sequence[_Choice], several: Sequence[bool]) -> Case:
    changes = fixed.copy()
    for choice in combination:
        if isinstance(choice.value, str):
            changes[choice.option] = choice.value  # type: ignore[literal-required]
        else:
            earlier = dict(changes.get(choice.option, {}))  # type: ignore[call-overload]
            changes[choice.option] = earlier | dict([choice.value])  # type: ignore[literal-required]
    return Case(", ".join(c.label for c, varies in zip(combination, several, strict=True) if varies), changes)
