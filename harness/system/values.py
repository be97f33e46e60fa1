# SPDX-License-Identifier: BSD-2-Clause
"""Names and values of scalar variables, in FMUs and as users write them.

FMI 2.0 has scalars only, so names contain the structure: `J[1,2]` is element (1, 2) of `J`. Only
this module splits names in this style. Indices may begin at any number (`x[0]`), and
other tools write blanks between them (`J[1, 2]`).

A vector `rho = [0, 20, 0]` represents `rho[1]`, `rho[2]`, `rho[3]`; a matrix `J = [[1, 2], [3, 4]]`
represents `J[1,1]` ... `J[2,2]`; a table `M = {bias = 1.0}` represents `M.bias`. Systems in TOML,
`--set` and `--params` all use this module.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias

from harness.spelling import did_you_mean

Index = tuple[int, ...]


class Name(NamedTuple):
    """Name of a scalar variable: name of its vector or matrix, and its indices, () for a scalar."""

    variable: str
    element: Index = ()

    def __str__(self) -> str:
        if not self.element:
            return self.variable
        return f"{self.variable}[{','.join(map(str, self.element))}]"


_ELEMENT = re.compile(r"(.+)\[(\d{1,9}(?: *, *\d{1,9})*)\]", re.ASCII | re.DOTALL)


@lru_cache(maxsize=1 << 16)
def parts_of(text: str) -> Name:
    """Split the name of a scalar variable into the name of its vector or matrix and its indices."""
    match = _ELEMENT.fullmatch(text)
    return Name(match[1], tuple(map(int, match[2].split(",")))) if match else Name(text)


def base(text: str) -> str:
    """Return the name of the vector or matrix of which a scalar variable is an element, the name
    itself for a scalar.
    """
    return parts_of(text).variable


def index(text: str) -> Index:
    """Return the indices of an element; () for a scalar."""
    return parts_of(text).element


def elements_of(port: str, names: Collection[str]) -> list[str]:
    """Return the scalar variables among `names` that the name `port` represents: `port` itself for
    a scalar, all elements in order for a vector or matrix; [] if there are none.
    """
    return [port] if port in names else list(_arrays(tuple(names)).get(port, ()))


def with_arrays(names: Collection[str]) -> tuple[str, ...]:
    """Return the given names of scalar variables, and the names of the vectors and matrices that
    these variables form.
    """
    return (*names, *_arrays(tuple(names)))


@lru_cache(maxsize=64)
def _arrays(names: tuple[str, ...]) -> Mapping[str, tuple[str, ...]]:
    """Return a mapping from the name of every vector and matrix to the names of its elements, in
    order.
    """
    found: dict[str, list[str]] = {}
    for name in names:
        if index(name):
            found.setdefault(base(name), []).append(name)
    return {array: tuple(sorted(elements, key=index)) for array, elements in found.items()}


class Grid(NamedTuple):
    """Indices of a complete vector or matrix. first: indices of its first element; shape: number of
    elements per dimension.
    """

    first: Index
    shape: Index

    def place(self, element: Index) -> Index:
        """Return the position of an element in an array, counted from 0; element: its indices."""
        return tuple(i - first for i, first in zip(element, self.first, strict=True))


def grid(elements: Iterable[Index]) -> Grid | None:
    """Return the Grid of the vector or matrix whose elements have these indices. Return None if
    elements are missing in it, or have different numbers of indices.
    """
    found = set(elements)
    if len({len(element) for element in found}) != 1:
        return None
    first = tuple(min(column) for column in zip(*found, strict=True))
    last = tuple(max(column) for column in zip(*found, strict=True))
    shape = tuple(b - a + 1 for a, b in zip(first, last, strict=True))
    return Grid(first, shape) if math.prod(shape) == len(found) else None


# ---- values

Scalar = float | int | bool | str
Value: TypeAlias = "Scalar | Sequence[Value]"
"""Scalar, vector or matrix as a value in TOML."""


def parse(text: str) -> Value:
    """Return the value of `--set name=text`: a number, or any value that the text has in TOML, such
    as true, a (nested) list or a text without its quotes; otherwise the text itself.
    """
    try:
        number = float(text)
    except ValueError:
        pass
    else:  # a number too large for a double stays a text
        return text if math.isinf(number) and any(c.isdigit() for c in text) else number
    try:
        value: Value = tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):  # not TOML, too many digits, nested too deeply
        return text
    return text if too_deep(value) else value


DEEPEST = 50
"""Largest depth of nested tables and lists, not counting the outermost one."""


def too_deep(value: Any) -> bool:
    """Return whether tables and lists in a value are nested more deeply than DEEPEST."""
    nodes, levels = [value], 0
    while nodes and levels <= DEEPEST:
        levels += 1
        parts = (n.values() if isinstance(n, Mapping) else n for n in nodes if _holds(n))
        nodes = [each for part in parts for each in part if _holds(each)]
    return bool(nodes)


def _holds(value: Any) -> bool:
    return isinstance(value, list | tuple | Mapping)


def plain(value: Any) -> Any:
    """Return a Python value in the types of TOML: arrays and tuples become lists, numbers of numpy
    become Python numbers.
    """
    if hasattr(value, "tolist"):
        return value.tolist()
    if isinstance(value, Mapping):
        return {name: plain(each) for name, each in value.items()}
    return [plain(each) for each in value] if isinstance(value, list | tuple) else value


def parse_text(text: str) -> str:
    """Return the value of `--set name=text` for a String: the text without TOML quotes."""
    value = parse(text)
    return value if isinstance(value, str) else text


def leaves(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values in a nested table with their dotted names: {"M": {"bias": 1}} gives
    ("M.bias", 1).
    """
    for key, value in table.items():
        if isinstance(value, Mapping):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def expand(name: str, value: Value, first: Index = ()) -> dict[str, Scalar]:
    """Return a dictionary with the scalars in a value, by name: `name` for a number, `name[i]` for
    a list, `name[i,j]` for a list of lists; raise ValueError for an empty list. first: indices of
    the first element, () for index 1 or indices 1,1.
    """
    elements = list(_elements(value, (), first))
    if not elements:
        raise ValueError("an empty list has no elements")
    return {str(Name(name, index)): element for index, element in elements}


def _elements(value: Value, index: Index, first: Index) -> Iterator[tuple[Index, Scalar]]:
    if isinstance(value, Sequence) and not isinstance(value, str):
        begin = first[len(index)] if len(index) < len(first) else 1
        for i, item in enumerate(value, start=begin):
            yield from _elements(item, (*index, i), first)
    else:
        yield index, value


def assign(name: str, value: Value, known: Collection[str]) -> dict[str, Scalar]:
    """Return the scalars that `name = value` sets, by name; known: existing scalar variables.

    Raises ValueError: unknown name (with close matches), wrong number of elements, or NaN.
    """
    elements = elements_of(name, known)
    if not elements:
        raise ValueError(f"there is no such variable{did_you_mean(name, with_arrays(known))}")
    given = _by_element(name, value, elements)
    for element, scalar in given.items():
        if isinstance(scalar, float) and math.isnan(scalar):
            raise ValueError(f"{element if element != name else 'it'} must not be NaN")
    return given


def _by_element(name: str, value: Value, elements: Sequence[str]) -> dict[str, Scalar]:
    """Return the scalars in a value, by the names of the elements to which they belong. elements:
    names of all elements of the variable in the FMU. Raise ValueError if the value has another
    shape.
    """
    is_scalar = elements == [name]
    whole = None if is_scalar else grid(map(index, elements))
    by_place = expand(name, value, whole.first if whole else ())
    places = {e: e if is_scalar else str(parts_of(e)) for e in elements}
    if by_place.keys() != set(places.values()):
        required = "a number" if is_scalar else _shape(elements)
        got = _quoted(value) if isinstance(value, str) else _shape([*by_place])
        raise ValueError(f"expected {required}, got {got}{_as_a_list(value, elements)}")
    return {element: by_place[place] for element, place in places.items()}


def _as_a_list(value: Value, elements: Sequence[str]) -> str:
    """Return the end of an error message about a value with a wrong number of elements: for a
    number or text, how to write the value as a list ("" if that is not possible); for a list, that
    the FMU fixes the number of elements.
    """
    if isinstance(value, str):
        return f"; write [{value}]" if "," in value else ""
    if isinstance(value, Sequence):
        return "; the FMU fixes the number of elements"
    is_vector = isinstance(value, int | float) and len(index(elements[0])) == 1
    return f"; write [{', '.join([f'{value:.12g}'] * len(elements))}]" if is_vector else ""


def _shape(names: Sequence[str]) -> str:
    """Return the shape of a variable from the names of its elements, in words: `a number`, `3
    elements`, `3 x 3 elements`.
    """
    indices = [index(name) for name in names]
    if indices == [()]:
        return "a number"
    whole = grid(indices)
    if whole is None:
        return "a ragged list"
    sizes = list(whole.shape)
    return " x ".join(map(str, sizes)) + (" element" if sizes == [1] else " elements")


def coerce(value: Scalar, kind: str, access: str = "") -> Scalar:
    """Return a value in an FMI type (`kind`: Real, Integer, Enumeration, Boolean, String); raise
    ValueError if it does not fit.

    access: type in the names of the FMI functions that set the variable, such as UInt8 in
    fmi3SetUInt8. A whole number must fit into the number of bits in this type, or into 32 bits if
    the type has no number (Integer or "").
    """
    if kind == "String":
        return _checked_text(str(value).lower() if isinstance(value, bool) else str(value))
    if not isinstance(value, (int, float)):
        raise ValueError(f"{_quoted(str(value))} is not a number")
    if kind == "Real":
        return _float(value)
    if kind == "Boolean" and value in (0, 1):
        return bool(value)
    if kind in INTEGERS and _float(value).is_integer():
        return _integer(int(value), access)
    raise ValueError(f"{value} is not {'true or false' if kind == 'Boolean' else 'a whole number'}")


INTEGERS = ("Integer", "Enumeration")


def _integer(value: int, access: str) -> int:
    bits = int(re.sub(r"\D", "", access) or 32)
    low = 0 if access.startswith("U") else -(2 ** (bits - 1))
    high = 2**bits - 1 if access.startswith("U") else 2 ** (bits - 1) - 1
    if not low <= value <= high:
        kind = access if access.endswith(str(bits)) else "the integers of FMI"
        raise ValueError(f"{value} is beyond {kind}, {low} to {high}")
    return value


def _float(value: float) -> float:
    try:
        return float(value)
    except OverflowError:
        raise ValueError("the number exceeds the range of a double, about 1.8e308") from None


def _checked_text(text: str) -> str:
    """Return a text unchanged if C can store it; raise ValueError otherwise."""
    if re.search("[\0\ud800-\udfff]", text):
        raise ValueError(f"{_quoted(text)} contains a zero character or is not valid UTF-8")
    return text


def _quoted(text: str) -> str:
    """Return a text for an error message, printable and shortened."""
    shown = text if len(text) <= 60 else f"{text[:57]}..."
    return repr(shown) if not shown.isprintable() or "'" in shown else f"'{shown}'"


# ---- variables of an FMU, in any version of FMI

EXACT = 2**53
"""Largest number up to which a double represents every whole number exactly. The signals between
components are doubles, so that a larger whole number could not be transferred.
"""


@dataclass(frozen=True)
class Variable:
    """Scalar variable, or one element of an array of FMI 3.0; unit: None if undeclared; settable:
    may be set before initialization.

    type: Real, Integer, Boolean, Enumeration, String or Binary; access: type in the name of the FMI
    functions that read and set it (Real, Float64, UInt8, ...); reference: value reference, which in
    FMI 3.0 is the reference of the whole array; element: position in the array, counted from 0;
    size: number of elements of the array.

    items: values of an enumeration by their names; type_name: name of the enumeration; start: start
    value as a number (None: there is none, or the type is String or Binary); begin: start value in
    any type; low, high: declared limits; optional: whether an input may remain unconnected, because
    an annotation permits its start value or its type is Binary; modes: for a variable whose values
    0, 1, ... are modes, their names, such as "far|hold 1|closing"; "" for any other variable.
    """

    name: str
    reference: int
    type: str
    causality: str
    unit: str | None
    description: str
    settable: bool
    items: Mapping[str, int] = field(default_factory=dict)
    type_name: str = ""
    start: float | None = None
    low: float | None = None
    high: float | None = None
    begin: float | str | None = None
    optional: bool = False
    access: str = ""
    element: int = 0
    size: int = 1
    modes: str = ""


def resting(variable: Variable) -> Scalar:
    """Return the value of a variable that is not set: its start value, or else 0 or ""."""
    if variable.begin is not None:
        return variable.begin
    return "" if variable.type == "String" else 0


STRUCTURAL = "structuralParameter"
"""Causality of parameters in FMI 3.0 that determine the sizes of arrays."""


def unsettable(variable: Variable, settable: Iterable[str]) -> str:
    """Return why a variable cannot be set, with close matches; settable: names that can be set."""
    close = did_you_mean(variable.name, settable)
    article = "an" if variable.causality[0] in "aeiou" else "a"
    return f"is {article} {variable.causality} and cannot be set{close}"
