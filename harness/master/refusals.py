# SPDX-License-Identifier: BSD-2-Clause
"""What an FMU of the project says about parameters that it refuses: `mass_0 = -5: must be > 0`, all
of them in one message, in the words of fmus/core/adapter/fmu.h.

The name may be that of a whole vector or matrix (`J_S`), or of what is made of several parameters
(`|q_KS|`, `range.lambda * range.beta`); the rule may name others (`must be below rho2`).
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from typing import Any, NamedTuple

from harness.errors import HarnessError, RefusalError, UsageError
from harness.system.values import base

_ONE = r"([^;=]+) = (\S+): (.+?)"
_CALL = re.compile(r"fmi[23]\w+: ")
_ALL = re.compile(rf"{_ONE}(?:; {_ONE})*", re.DOTALL)
_EACH = re.compile(rf"{_ONE}(?:; (?=[^;=]+ = )|$)", re.DOTALL)
_NAME = re.compile(r"[^\W\d]\w*(?:\.\w+)*")
_ARTICLE = re.compile(r"\ba (?=[a-z])")
"""Before a word, for a parameter may be called `a` too."""


class Refusal(NamedTuple):
    """One rule that is broken: what it is about, with its value, as the FMU writes them."""

    name: str
    value: str
    rule: str

    def __str__(self) -> str:
        return f"{self.name} = {self.value}: {self.rule}"

    def about(self, names: Iterable[str]) -> list[str]:
        """Which of these parameters it is about; if none, which of them its rule speaks of."""
        known = list(names)
        return _among(known, self.name) or _among(known, _ARTICLE.sub("", self.rule))


def _among(names: Iterable[str], text: str) -> list[str]:
    """The names that a text is, holds, or is an element of."""
    if text in (known := list(names)):
        return [text]
    whole, words = base(text), _NAME.findall(text)
    if whole != text:  # an element: not the other ones of its vector
        return [name for name in known if name == whole]
    return [name for name in known if base(name) in words]


def refusals(message: str, parameters: Collection[str]) -> tuple[Refusal, ...]:
    """The rules that are broken; () if the message is about anything but parameters of these names.

    parameters: names of scalar variables, or of whole vectors and matrices.
    """
    text = _CALL.sub("", message, count=1)
    if not _ALL.fullmatch(text):
        return ()
    found = tuple(Refusal(*each) for each in _EACH.findall(text))
    known = {*parameters, *map(base, parameters)}
    return found if all(_among(known, refusal.name) for refusal in found) else ()


def as_typed(error: RefusalError, given: Mapping[str, Any], prefix: str) -> HarnessError:
    """The error in the words of the user, if it is about values that were given to --set only.

    given: values by name, as they were typed; prefix: what stands before the names of this
    component.
    """
    names = [name.removeprefix(prefix) for name in given if name.startswith(prefix)]
    lines = []
    for refusal in error.refusals:
        if not (typed := refusal.about(names)):
            return error
        values = " ".join(f"--set {prefix}{name}={given[prefix + name]}" for name in typed)
        lines.append(f"{values}: {_told(refusal, typed)}")
    return UsageError("\n".join(lines))


def without(error: RefusalError, names: Collection[str]) -> RefusalError | None:
    """The error as far as it is about none of these parameters, `component.parameter`."""
    prefix = f"{error.component}."
    inner = [name.removeprefix(prefix) for name in names if name.startswith(prefix)]
    kept = tuple(refusal for refusal in error.refusals if not refusal.about(inner))
    return RefusalError(error.component, error.time, kept) if kept else None


def _told(refusal: Refusal, typed: Collection[str]) -> str:
    """What is wrong beside what was typed: `must be > 0`, of an element `K_rho[2] must be >= 0`, of
    anything else with its value.
    """
    if refusal.name in typed:
        return refusal.rule
    if base(refusal.name) in typed:
        return f"{refusal.name} {refusal.rule}"
    return f"{refusal.name} = {refusal.value} {refusal.rule}"
