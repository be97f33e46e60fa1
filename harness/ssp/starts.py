# SPDX-License-Identifier: BSD-2-Clause
"""`[start]` of a TOML: start values of bodies from files of other tools.

Who reads such files stands above, in harness.exchange, and is attached here by harness itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from harness.system.model import System


Begun = tuple[Mapping[str, Any], str]
"""Values of parameters by name, and the UTC of t = 0."""

_readers: list[Callable[[System], Begun]] = []


def attach(reader: Callable[[System], Begun]) -> None:
    """Take what turns the `starts` of a system into values and an epoch; HarnessError."""
    _readers[:] = [reader]


def read(system: System) -> Begun:
    """What the `starts` of a system give at its epoch; HarnessError."""
    return _readers[0](system)


def begun(table: Mapping[str, Any], system: System) -> dict[str, Any]:
    """The tables of a system with the values of its `starts` among the parameters, and with its
    epoch; HarnessError.
    """
    values, epoch = read(system)
    parameters = {c: dict(own) for c, own in table.get("parameters", {}).items()}
    for name, value in values.items():
        component, _, parameter = name.partition(".")
        parameters.setdefault(component, {})[parameter] = value
    experiment = {**table["experiment"], "epoch": epoch}
    return {**table, "parameters": parameters, "experiment": experiment}
