# SPDX-License-Identifier: BSD-2-Clause
"""What an FMU of the project says about parameters that it refuses: `mass_0 = -5: must be > 0`, all
of them in one message, in the words of fmus/core/adapter/fmu.h.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any

from harness.errors import HarnessError, RunError, UsageError
from harness.system.names import base

_ONE = r"(\S+) = (\S+): (.+?)"
_ALL = re.compile(rf"(?:fmi2\w+: )?({_ONE}(?:; {_ONE})*)", re.DOTALL)
_EACH = re.compile(rf"{_ONE}(?:; (?=\S+ = )|$)", re.DOTALL)


def refusals(message: str, parameters: Collection[str]) -> dict[str, str]:
    """Rules by the names of the parameters that break them; {} if the message is about anything
    else.
    """
    match = _ALL.fullmatch(message)
    if match is None:
        return {}
    found = {name: rule for name, _, rule in _EACH.findall(match[1])}
    return found if all({name, base(name)} & {*parameters} for name in found) else {}


def as_typed(error: RunError, given: Mapping[str, Any]) -> HarnessError:
    """The error in the words of the user, if it is about values that were given to --set only.

    given: values by `component.variable`, as they were typed.
    """
    names = [name.removeprefix(f"{error.component}.") for name in given]
    found = refusals(error.message, names)
    lines = []
    for name, rule in found.items():
        typed = name if f"{error.component}.{name}" in given else base(name)
        value = given[f"{error.component}.{typed}"]
        element = "" if typed == name else f"{name} "
        lines.append(f"--set {error.component}.{typed}={value}: {element}{rule}")
    return UsageError("\n".join(lines)) if lines else error
