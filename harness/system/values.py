# SPDX-License-Identifier: BSD-2-Clause
"""Values as people write them, and the scalar variables they stand for.

A vector `rho = [0, 20, 0]` stands for `rho[1]`, `rho[2]`, `rho[3]`; a matrix `J = [[1, 2], [3, 4]]`
for `J[1,1]` ... `J[2,2]`; a table `M = {bias = 1.0}` for `M.bias`. Systems in TOML, `--set` and
`--params` all come through here.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

from harness.spelling import did_you_mean

Scalar = float | int | bool | str
Value: TypeAlias = "Scalar | Sequence[Value]"
"""A scalar, vector or matrix as TOML has it."""


def parse(text: str) -> Value:
    """Value of `--set name=text`: a number, a (nested) list or true/false as in TOML; else the text
    itself.
    """
    try:
        return float(text)
    except ValueError:
        pass
    try:
        value: Value = tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text
    return value


def leaves(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted names and values of a (nested) table: {"M": {"bias": 1}} gives ("M.bias", 1)."""
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def expand(name: str, value: Value) -> dict[str, Scalar]:
    """Scalar variables of a value: a number is `name`, a list `name[i]`, a list of lists
    `name[i,j]` (1-based).
    """
    elements = list(_elements(value, ()))
    if not elements:
        raise ValueError("an empty list has no elements")
    return {name + _suffix(index): element for index, element in elements}


def _elements(value: Value, index: tuple[int, ...]) -> Iterator[tuple[tuple[int, ...], Scalar]]:
    if isinstance(value, Sequence) and not isinstance(value, str):
        for i, item in enumerate(value, start=1):
            yield from _elements(item, (*index, i))
    else:
        yield index, value


def _suffix(index: tuple[int, ...]) -> str:
    return f"[{','.join(map(str, index))}]" if index else ""


def base(name: str) -> str:
    """Name of the vector or matrix that a scalar variable is an element of: `J_T[1,2]` gives
    `J_T`.
    """
    return name[: name.rindex("[")] if name.endswith("]") and "[" in name else name


def index(name: str) -> tuple[int, ...]:
    """Indices of an element, 1-based: `J_T[1,2]` gives (1, 2); a scalar gives ()."""
    digits = name[len(base(name)) :].strip("[]").split(",")
    return tuple(int(d) for d in digits) if all(d.strip().isdigit() for d in digits) else ()


def elements_of(port: str, names: Collection[str]) -> list[str]:
    """Scalar variables that `port` stands for: itself, or all elements of the vector or matrix in
    order.
    """
    if port in names:
        return [port]
    return sorted((name for name in names if base(name) == port), key=index)


def assign(name: str, value: Value, known: Collection[str]) -> dict[str, Scalar]:
    """Scalar variables set by `name = value`, given the names that exist.

    Raises ValueError: unknown name (with close matches), wrong number of elements, or NaN.
    """
    elements = elements_of(name, known)
    if not elements:
        raise ValueError(
            f"there is no such variable{did_you_mean(name, {*known, *map(base, known)})}"
        )
    given = expand(name, value)
    if given.keys() != set(elements):
        shapes = f"expected {_shape(elements)}, got {_shape(list(given))}"
        raise ValueError(shapes + _as_a_list(value, elements))
    for element, scalar in given.items():
        if isinstance(scalar, float) and math.isnan(scalar):
            raise ValueError(f"{element if element != name else 'it'} must not be NaN")
    return given


def _as_a_list(value: Value, elements: Sequence[str]) -> str:
    """What to write instead of one number or of numbers without brackets, as the end of a line."""
    if isinstance(value, str) and "," in value:
        return f"; write [{value}]"
    if isinstance(value, int | float) and all(len(index(e)) == 1 for e in elements):
        return f"; write [{', '.join([f'{value:.12g}'] * len(elements))}]"
    return ""


def _shape(names: list[str]) -> str:
    """Shape of a variable in words: `a number`, `3 elements`, `3 x 3 elements`."""
    indices = [index(name) for name in names]
    if indices == [()]:
        return "a number"
    if len({len(i) for i in indices}) > 1:
        return "a ragged list"
    sizes = [max(column) for column in zip(*indices, strict=True)]
    if math.prod(sizes) != len(names):
        return "a ragged list"
    return " x ".join(map(str, sizes)) + (" element" if sizes == [1] else " elements")


def coerce(value: Scalar, kind: str) -> Scalar:
    """A value as an FMI type (Real, Integer, Enumeration, Boolean, String) holds it; ValueError if
    it cannot.
    """
    if kind == "String":
        return str(value)
    if isinstance(value, str):
        raise ValueError(f"'{value}' is not a number")
    if kind == "Real":
        return float(value)
    if kind == "Boolean" and value in (0, 1):
        return bool(value)
    if kind in ("Integer", "Enumeration") and float(value).is_integer():
        return int(value)
    raise ValueError(f"{value} is not {'true or false' if kind == 'Boolean' else 'a whole number'}")
