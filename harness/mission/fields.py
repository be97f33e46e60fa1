# SPDX-License-Identifier: BSD-2-Clause
"""Checks of the data of a mission: fields of its records, values of its functions.

What a mission gets wrong is then one line with its place, instead of an error of the engine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import fields
from functools import cache
from numbers import Real
from types import UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from harness.errors import HarnessError

T = TypeVar("T")


class Checked:
    """Dataclass whose fields have the annotated types, else it raises TypeError."""

    def __post_init__(self) -> None:
        record: Any = type(self)
        for name, (kind, text) in _types(record).items():
            if not _fits(value := getattr(self, name), kind):
                raise TypeError(f"{name}: expected {text}, got {value!r:.60}")


@cache
def _types(record: Any) -> dict[str, tuple[Any, str]]:
    """Return type and its text by field of a dataclass."""
    hints = get_type_hints(record)
    return {field.name: (hints[field.name], str(field.type)) for field in fields(record)}


def _fits(value: Any, kind: Any) -> bool:
    """Return whether a value has a type; lists pass for tuples, every real number for a float."""
    origin, parts = get_origin(kind) or kind, get_args(kind)
    if origin is UnionType:
        return any(_fits(value, part) for part in parts)
    if origin is tuple:
        several = isinstance(value, tuple | list)
        return several and (parts[-1] is not ... or all(_fits(each, parts[0]) for each in value))
    return isinstance(value, Real if origin is float else origin)


def place_of(function: Any) -> str:
    """Return file and line of a function of Python, "" of anything else, for the head of a line."""
    code = getattr(function, "__code__", None)
    return f"{code.co_filename}, line {code.co_firstlineno}: " if code else ""


def one(kind: type[T], function: Callable[..., Any], *given: Any) -> T:
    """Return the value of a mission's function; raise HarnessError with the place of the function
    if the value has another type.
    """
    if isinstance(found := function(*given), kind):
        return found
    raise HarnessError(f"{place_of(function)}expected {kind.__name__}, got {found!r:.60}")


def several(kind: type[T], function: Callable[..., Any], *given: Any) -> list[T]:
    """Return all values of a mission's function, for example a generator; raise HarnessError with
    the place of the function if one of them has another type.
    """
    found = function(*given)
    iterable = isinstance(found, Iterable) and not isinstance(found, str)
    values = list(found) if iterable else []
    if wrong := [value for value in values if not isinstance(value, kind)] if iterable else [found]:
        text = f"expected an iterator of {kind.__name__}, got {wrong[0]!r:.60}"
        raise HarnessError(f"{place_of(function)}{text}")
    return values
