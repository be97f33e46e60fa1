# SPDX-License-Identifier: BSD-2-Clause
"""Names of scalar variables and their structure: `J[1,2]` is element (1, 2) of `J`.

FMI knows scalars only, so the structure stands in the names. Here it is read; everything else asks.
Indices may begin anywhere (`x[0]`), and other tools put blanks between them (`J[1, 2]`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping
from functools import lru_cache
from typing import NamedTuple

Index = tuple[int, ...]


class Name(NamedTuple):
    """Name of a scalar variable: that of the vector or matrix it belongs to, and its place in it,
    () for a scalar.
    """

    variable: str
    element: Index = ()

    @classmethod
    def read(cls, text: str) -> Name:
        """The name as an FMU or a user writes it."""
        return _read(text)

    def __str__(self) -> str:
        if not self.element:
            return self.variable
        return f"{self.variable}[{','.join(map(str, self.element))}]"


_ELEMENT = re.compile(r"(.+)\[(\d{1,9}(?: *, *\d{1,9})*)\]", re.ASCII | re.DOTALL)


@lru_cache(maxsize=1 << 16)
def _read(text: str) -> Name:
    match = _ELEMENT.fullmatch(text)
    return Name(match[1], tuple(map(int, match[2].split(",")))) if match else Name(text)


def base(text: str) -> str:
    """Name of the vector or matrix that a scalar variable is an element of."""
    return _read(text).variable


def index(text: str) -> Index:
    """Indices of an element; () for a scalar."""
    return _read(text).element


def elements_of(port: str, names: Collection[str]) -> list[str]:
    """Scalar variables that `port` stands for: itself, or all elements of the vector or matrix in
    order.
    """
    return [port] if port in names else list(_arrays(tuple(names)).get(port, ()))


def with_arrays(names: Collection[str]) -> tuple[str, ...]:
    """Names of scalar variables, and of the vectors and matrices that they are elements of."""
    return (*names, *_arrays(tuple(names)))


@lru_cache(maxsize=64)
def _arrays(names: tuple[str, ...]) -> Mapping[str, tuple[str, ...]]:
    """Elements in order by the vector or matrix that they belong to."""
    found: dict[str, list[str]] = {}
    for name in names:
        if index(name):
            found.setdefault(base(name), []).append(name)
    return {array: tuple(sorted(elements, key=index)) for array, elements in found.items()}


class Grid(NamedTuple):
    """The indices of a whole vector or matrix: of its first element, and how many there are."""

    first: Index
    shape: Index

    def place(self, element: Index) -> Index:
        """Where an element stands in an array, counted from 0."""
        return tuple(i - first for i, first in zip(element, self.first, strict=True))


def grid(elements: Iterable[Index]) -> Grid | None:
    """The grid that is filled by these elements exactly; None if some are missing or of another
    dimension.
    """
    found = set(elements)
    if len({len(element) for element in found}) != 1:
        return None
    first = tuple(min(column) for column in zip(*found, strict=True))
    last = tuple(max(column) for column in zip(*found, strict=True))
    shape = tuple(b - a + 1 for a, b in zip(first, last, strict=True))
    return Grid(first, shape) if math.prod(shape) == len(found) else None
