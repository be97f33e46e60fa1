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
from harness.files.paths import contents
from harness.spelling import did_you_mean
from harness.system.interface import Interfaces
from harness.system.model import Parameter, Parameters
from harness.system.values import (
    Value,
    assign,
    base,
    coerce,
    elements_of,
    leaves,
    parse,
    parse_text,
    too_deep,
    unsettable,
)

SHARED = "shared"

LONGEST = 16 * 1024**2
"""Bytes of a TOML file."""


def read_toml(path: Path) -> dict[str, Any]:
    """Content of a TOML file; StructureError if it is not one, UsageError if it is not there."""
    try:
        table = tomllib.loads(contents(path, LONGEST).decode())
        if too_deep(table):
            raise RecursionError
    except RecursionError as error:
        raise StructureError([f"{path}: not a readable TOML file (nested too deep)"]) from error
    except OSError as error:
        raise UsageError(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:  # not TOML, not UTF-8, or a number of thousands of digits
        raise StructureError([f"{path}: not a readable TOML file ({error})"]) from error
    return table


class Assignments:
    """Parameters by component, and the problems met on the way (one line each)."""

    def __init__(self, interfaces: Interfaces) -> None:
        self.interfaces = interfaces
        self.parameters: dict[str, dict[str, Parameter]] = {name: {} for name in interfaces}
        self.problems: list[str] = []

    def tables(self, tables: Any) -> None:
        """Take over a table per component and the table `shared`, which the others override."""
        if not isinstance(tables, Mapping):
            self.problems.append("parameters: must be a table of tables, one per component")
            return
        known = {SHARED, *self.interfaces}
        good = {c: t for c, t in tables.items() if c in known and isinstance(t, Mapping)}
        odd = [c for c in tables if c not in good]
        for name, value in leaves(good.pop(SHARED, {})):
            self.shared(name, value)
        for component, table in good.items():
            for name, value in leaves(table):
                self.set(component, name, value)
        for name in odd:
            close = did_you_mean(name, sorted(known - {name}))
            fault = f"parameters stand in a table per component, and this is none{close}"
            self.problems.append(f"{name}: {fault}")

    def shared(self, name: str, value: Any, written: bool = False) -> None:
        """Set a parameter of every component that has it; written: as a user has typed it."""
        owners = [c for c, i in self.interfaces.items() if elements_of(name, i.named("parameter"))]
        for component in owners:
            (self.write if written else self.set)(component, name, value)
        if not owners:
            known = {base(p) for i in self.interfaces.values() for p in i.named("parameter")}
            close = did_you_mean(name, known)
            self.problems.append(f"{SHARED}.{name}: no component has such a parameter{close}")

    def set(
        self, component: str, name: str, value: Value, known: Collection[str] | None = None
    ) -> None:
        """Set a scalar, vector or matrix of one component; known: the names allowed (default:
        whatever can be set).
        """
        interface = self.interfaces[component]
        found = interface.variables.get(name)
        if found is not None and known is None and not found.settable:
            self.problems.append(f"{component}.{name}: {unsettable(found)}")
            return
        try:
            scalars = assign(name, value, interface.settable() if known is None else known)
            for element, scalar in scalars.items():
                variable = interface.variables[element]
                self.parameters[component][element] = Parameter(
                    coerce(scalar, variable.type, variable.access), variable.unit
                )
        except ValueError as error:
            self.problems.append(f"{component}.{name}: {error}")

    def write(self, component: str, name: str, text: str) -> None:
        """Set what a user has written as text: for a String that text, else a number or list."""
        variable = self.interfaces[component].variables.get(name)
        is_text = variable is not None and variable.type == "String"
        self.set(component, name, parse_text(text) if is_text else parse(text))

    def over(self, component: str, parameters: Parameters) -> Parameters:
        """The parameters of a component with what was assigned here put over them."""
        return {**parameters, **self.parameters[component]}
