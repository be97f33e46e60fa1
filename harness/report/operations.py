# SPDX-License-Identifier: BSD-2-Clause
"""A list of operations on arrays that a page repeats: kept once each, written for the page, and
repeated with numpy.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from harness.results.result import Array

Operation = tuple[str, tuple[int, ...], str]
"""Name, operations whose results it takes, what else it is told (JSON)."""

UFUNCS = (
    "absolute", "add", "arccos", "arcsin", "arctan", "arctan2", "ceil", "copysign", "cos",
    "deg2rad", "degrees", "divide", "equal", "exp", "fabs", "floor", "fmax", "fmin", "greater",
    "greater_equal", "hypot", "isfinite", "isinf", "isnan", "less", "less_equal", "log", "log10",
    "logical_and", "logical_not", "logical_or", "maximum", "minimum", "multiply", "negative",
    "not_equal", "positive", "power", "rad2deg", "radians", "reciprocal", "remainder", "rint",
    "sign", "sin", "sqrt", "square", "subtract", "tan",
)  # fmt: skip
"""Operations on elements; the page has the same names."""


class Operations:
    """Operations by place, each once."""

    def __init__(self) -> None:
        self._known: dict[Operation, int] = {}
        self.about: list[dict[str, Any]] = []

    def add(self, name: str, parts: tuple[int, ...], about: dict[str, Any]) -> int:
        """Place of an operation on the results of others."""
        key = (name, parts, json.dumps(about))
        if key not in self._known:
            self._known[key] = len(self._known)
            self.about.append(about)
        return self._known[key]

    @property
    def operations(self) -> list[Any]:
        """What the page repeats: name, places, what else it is told."""
        return [
            [name, list(parts), about]
            for (name, parts, _), about in zip(self._known, self.about, strict=True)
        ]

    def written(self, asked: set[int]) -> tuple[dict[int, int], list[Any], list[list[int]]]:
        """These operations and all whose results they take, for the page: their numbers by place,
        the operations, and the long lists of places, once each.
        """
        every, listed = self.operations, []
        numbers = {place: k for k, place in enumerate(_needed(every, asked))}
        lists: dict[tuple[int, ...], int] = {}
        for place in numbers:
            name, parts, about = every[place]
            told = {key: _shared(value, lists) for key, value in about.items()}
            listed.append([name, [numbers[part] for part in parts], told])
        return numbers, listed, list(map(list, lists))

    def evaluate(self, roots: Mapping[str, Array]) -> Callable[[int], Array]:
        """Results of the operations by place, with other numbers at the roots."""
        listed, known = self.operations, dict[int, Any]()

        def value(place: int) -> Array:
            if place not in known:
                name, parts, about = listed[place]
                arrays = [value(part) for part in parts]
                known[place] = repeated(name, arrays, about, roots)
            return np.asarray(known[place])

        return value


def _needed(every: list[Any], asked: set[int]) -> list[int]:
    """These operations and all whose results they take, in order."""
    open_ = list(asked)
    while open_:
        further = set(every[open_.pop()][1]) - asked
        asked |= further
        open_ += further
    return sorted(asked)


def _shared(value: Any, lists: dict[tuple[int, ...], int]) -> Any:
    """What an operation is told, with the number of a list of places in its place."""
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return [
            {"t": lists.setdefault(tuple(part["t"]), len(lists))} if "t" in part else part
            for part in value
        ]
    return value


def repeated(
    name: str, a: list[Any], p: Mapping[str, Any], roots: Mapping[str, Array] | None = None
) -> Any:
    """One operation with numpy, as the page does it."""
    with np.errstate(all="ignore"):
        if name in UFUNCS:
            return getattr(np, name)(*a)
        return REPEATED[name](a, p, roots or {})


REPEATED: Mapping[str, Callable[[list[Any], Mapping[str, Any], Mapping[str, Array]], Any]] = {
    "concatenate": lambda a, p, _: np.concatenate(a, axis=p["axis"]),
    "constant": lambda _, p, __: np.array([float(x) for x in p["values"]]).reshape(p["shape"]),
    "cross": lambda a, _, __: np.cross(*a),
    "einsum": lambda a, p, _: np.einsum(p["letters"], *a),
    "full": lambda _, p, __: np.full(p["shape"], p["value"]),
    "pick": lambda a, p, _: a[0][tuple(map(_index, p["index"]))],
    "reduce": lambda a, p, _: getattr(np, p["by"]).reduce(a[0], axis=p["axis"], keepdims=p["keep"]),
    "reduceat": lambda a, p, _: getattr(np, p["by"]).reduceat(a[0], p["places"], axis=0),
    "reshape": lambda a, p, _: a[0].reshape(p["shape"]),
    "root": lambda _, p, roots: roots[p["name"]],
    "stack": lambda a, p, _: np.stack(a, axis=p["axis"]),
    "transpose": lambda a, p, _: a[0].transpose(p["axes"]),
    "where": lambda a, _, __: np.where(a[0] != 0, a[1], a[2]),
}


def _index(part: Mapping[str, Any]) -> Any:
    if "n" in part:
        return None
    return slice(*part["s"]) if "s" in part else part["i"] if "i" in part else part["t"]
