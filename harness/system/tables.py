# SPDX-License-Identifier: BSD-2-Clause
"""Tables of a TOML file: parameters, in one table per component and a table `shared` for all
components that have a parameter of the same name; and the check of tables against declared types,
which yields all problems at once, one line each.

A table with known entries is declared as a msgspec.Struct, or as `Struct | None` if it may be
missing. A table with arbitrary entries is a `dict[str, X]`. Entries have one of the types below, or
another type of msgspec. After the check, msgspec.convert(table, Struct) makes an object from a
table.
"""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Iterator, Mapping
from functools import cache
from pathlib import Path
from sys import float_info
from types import NoneType
from typing import Annotated, Any, get_args, get_origin

import msgspec
from msgspec import Meta
from msgspec.structs import FieldInfo

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
"""Largest size of a TOML file [bytes]."""


def read_toml(path: Path) -> dict[str, Any]:
    """Return the content of a TOML file; raise StructureError if it is invalid, UsageError if it
    cannot be read or is longer than LONGEST.
    """
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
    """Parameters that are assigned to components, and the problems found while assigning, one line
    each.
    """

    def __init__(self, interfaces: Interfaces) -> None:
        self.interfaces = interfaces
        self.parameters: dict[str, dict[str, Parameter]] = {name: {} for name in interfaces}
        self.problems: list[str] = []

    def tables(self, tables: Any) -> None:
        """Assign a table per component and the table `shared`, whose values the tables of
        components override.
        """
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
            unknown = "" if name in known else ", and no component has this name"
            self.problems.append(f"{name}: expected a table per component{unknown}{close}")

    def shared(self, name: str, value: Any, written: bool = False) -> None:
        """Set a parameter of every component that has a parameter `name`; written: whether the
        value is a text that a user has typed, from which the value must be parsed.
        """
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
        """Set a scalar, vector or matrix of one component, or add a problem; known: permitted names
        of scalar variables (default: all that can be set).
        """
        interface = self.interfaces[component]
        found = interface.variables.get(name)
        if found is not None and known is None and not found.settable:
            self.problems.append(f"{component}.{name}: {unsettable(found, interface.settable())}")
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
        """Set a variable to a value that a user has typed as text: a variable of type String to the
        text, any other variable to the number or list that the text contains.
        """
        variable = self.interfaces[component].variables.get(name)
        is_text = variable is not None and variable.type == "String"
        self.set(component, name, parse_text(text) if is_text else parse(text))

    def over(self, component: str, parameters: Parameters) -> Parameters:
        """Return the parameters of a component, overridden by the values that are assigned here."""
        own = self.parameters[component]
        return {**parameters, **own} if own else parameters


# ---- types of tables


LARGEST = float_info.max

Text = Annotated[str, Meta(description="a text")]
Flag = Annotated[bool, Meta(description="true or false")]
Number = Annotated[float, Meta(ge=-LARGEST, le=LARGEST, description="a finite number")]
Positive = Annotated[float, Meta(gt=0, le=LARGEST, description="a finite number above 0")]
Whole = Annotated[int, Meta(ge=0, description="a whole number of at least 0")]
Count = Annotated[int, Meta(ge=1, description="a whole number of at least 1")]


def problems(given: Any, kind: Any, place: str = "") -> Iterator[str]:
    """Yield the problems of a value that should have a type, one line each: entry, rule and value.

    given: the value; kind: the type; place: name of the entry, "" for the whole file.
    """
    if NoneType in get_args(kind):  # TOML has no None, so only the other type counts
        (kind,) = (each for each in get_args(kind) if each is not NoneType)
    table = get_origin(kind) is dict
    if not table and not _is_struct(kind):
        try:
            msgspec.convert(given, kind)
        except msgspec.ValidationError as error:
            yield f"{place}: must be {_words(kind, error)}, not {given!r:.80}"
    elif not isinstance(given, Mapping):
        yield f"{place}: must be a table, not {given!r:.80}"
    elif table:
        for name, value in given.items():
            yield from problems(value, get_args(kind)[1], _inside(place, name))
    else:
        yield from _of_entries(given, kind, place)


def _of_entries(given: Mapping[str, Any], kind: type[msgspec.Struct], place: str) -> Iterator[str]:
    fields = _fields(kind)
    for name, value in given.items():
        if name in fields:
            yield from problems(value, fields[name].type, _inside(place, name))
        else:
            close = did_you_mean(name, fields)
            yield f"{_inside(place, name)}: there is no such entry{close}"
    for name, field in fields.items():
        if field.required and name not in given:
            yield f"{_inside(place, name)}: is missing"


@cache
def _fields(kind: type[msgspec.Struct]) -> dict[str, FieldInfo]:
    """Return the fields of a struct by the names of their entries in a table."""
    return {field.encode_name: field for field in msgspec.structs.fields(kind)}


def _is_struct(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, msgspec.Struct)


def _inside(place: str, name: str) -> str:
    return f"{place}.{name}" if place else name


def _words(kind: Any, error: Exception) -> str:
    """Return the rule that a value breaks as text: the description of the type `kind`, or else the
    message of `error` from msgspec.
    """
    metas = [each for each in get_args(kind)[1:] if isinstance(each, Meta) and each.description]
    return str(metas[0].description if metas else str(error).removeprefix("Expected "))
