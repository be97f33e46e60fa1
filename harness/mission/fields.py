# SPDX-License-Identifier: BSD-2-Clause
"""Checks of a mission: types of the fields of its dataclasses, and types of the values that its
functions return.

A mistake in a mission is then reported in one line with its place, instead of causing an error
elsewhere in the harness.
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
    """Base class of dataclasses that raise TypeError if a field has another type than annotated."""

    def __post_init__(self) -> None:
        record: Any = type(self)
        for name, (kind, text) in _types(record).items():
            if not _fits(value := getattr(self, name), kind):
                raise TypeError(f"{name}: expected {text}, got {value!r:.60}")


@cache
def _types(record: Any) -> dict[str, tuple[Any, str]]:
    """Return for every field of a dataclass, by name, its type as an object and as text."""
    hints = get_type_hints(record)
    return {field.name: (hints[field.name], str(field.type)) for field in fields(record)}


def _fits(value: Any, kind: Any) -> bool:
    """Return whether a value fits the annotated type `kind`. A list is accepted for a tuple, any
    real number for a float.
    """
    origin, parts = get_origin(kind) or kind, get_args(kind)
    if origin is UnionType:
        return any(_fits(value, part) for part in parts)
    if origin is tuple:
        several = isinstance(value, tuple | list)
        return several and (parts[-1] is not ... or all(_fits(each, parts[0]) for each in value))
    return isinstance(value, Real if origin is float else origin)


def place_of(function: Any) -> str:
    """Return file and line of a Python function as the beginning of an error message, "" for any
    other object.
    """
    code = getattr(function, "__code__", None)
    return f"{code.co_filename}, line {code.co_firstlineno}: " if code else ""


def one(kind: type[T], function: Callable[..., Any], *given: Any) -> T:
    """Call a function of a mission and return its value; raise HarnessError with the place of the
    function if the value is not of type `kind`.
    """
    if isinstance(found := function(*given), kind):
        return found
    raise HarnessError(f"{place_of(function)}expected {kind.__name__}, got {found!r:.60}")


def several(kind: type[T], function: Callable[..., Any], *given: Any) -> list[T]:
    """Call a function of a mission, such as a generator, and return all its values; raise
    HarnessError with the place of the function if a value is not of type `kind`.
    """
    found = function(*given)
    iterable = isinstance(found, Iterable) and not isinstance(found, str)
    values = list(found) if iterable else []
    if wrong := [value for value in values if not isinstance(value, kind)] if iterable else [found]:
        text = f"expected an iterator of {kind.__name__}, got {wrong[0]!r:.60}"
        raise HarnessError(f"{place_of(function)}{text}")
    return values
