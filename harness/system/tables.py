# SPDX-License-Identifier: BSD-2-Clause
"""Parameter tables as people write them in TOML: one per component, and `shared` for all that know
a parameter.
"""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

from harness.errors import StructureError, UsageError
from harness.spelling import did_you_mean
from harness.system.interface import Interface
from harness.system.model import Parameter, Parameters
from harness.system.values import Value, assign, base, coerce, elements_of, leaves

SHARED = "shared"


def read_toml(path: Path) -> dict[str, Any]:
    """Content of a TOML file; StructureError if it is not one, UsageError if it is not there."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise StructureError([f"{path}: not a readable TOML file ({error})"]) from error


class Assignments:
    """Parameters by component, and the problems met on the way (one line each)."""

    def __init__(self, interfaces: Mapping[str, Interface]) -> None:
        self.interfaces = interfaces
        self.parameters: dict[str, dict[str, Parameter]] = {name: {} for name in interfaces}
        self.problems: list[str] = []

    def tables(self, tables: Mapping[str, Any]) -> None:
        """Take over a table per component and the table `shared`, which the others override."""
        self._shared(tables.get(SHARED, {}))
        for component, table in tables.items():
            if component == SHARED:
                continue
            if component not in self.interfaces or not isinstance(table, Mapping):
                close = did_you_mean(component, (SHARED, *self.interfaces))
                self.problems.append(
                    f"{component}: parameters stand in a table per component, and this is "
                    f"none{close}"
                )
                continue
            for name, value in leaves(table):
                self.set(component, name, value)

    def _shared(self, table: Mapping[str, Any]) -> None:
        for name, value in leaves(table):
            owners = [
                c for c, i in self.interfaces.items() if elements_of(name, i.named("parameter"))
            ]
            for component in owners:
                self.set(component, name, value)
            if not owners:
                known = {base(p) for i in self.interfaces.values() for p in i.named("parameter")}
                self.problems.append(
                    f"{SHARED}.{name}: no component has such a parameter{did_you_mean(name, known)}"
                )

    def set(
        self, component: str, name: str, value: Value, known: Collection[str] | None = None
    ) -> None:
        """Set a scalar, vector or matrix of one component; known: the names allowed (default:
        whatever can be set).
        """
        interface = self.interfaces[component]
        try:
            scalars = assign(name, value, interface.settable() if known is None else known)
            for element, scalar in scalars.items():
                variable = interface.variables[element]
                self.parameters[component][element] = Parameter(
                    coerce(scalar, variable.type), variable.unit
                )
        except ValueError as error:
            self.problems.append(f"{component}.{name}: {error}")

    def over(self, component: str, parameters: Parameters) -> Parameters:
        """The parameters of a component with what was assigned here put over them."""
        return {**parameters, **self.parameters[component]}
