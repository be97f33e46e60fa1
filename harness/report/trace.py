# SPDX-License-Identifier: BSD-2-Clause
"""What code for numpy computes from the rows of a result, as a list of operations: a page repeats
them over the rows of another flight.

An array of rows that is Traced knows the operation that made it. What numpy makes of it is Traced
too, where the page has a word for it; everything else gives arrays without an operation, whose
numbers are then those of this result. Functions of numpy are left to numpy itself as far as it
writes them in operations on elements, slices and shapes. `Trace.evaluate` repeats the operations:
whoever compares that with the code itself finds what was lost on the way.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

UFUNCS = (
    "absolute", "add", "arccos", "arcsin", "arctan", "arctan2", "ceil", "clip", "copysign", "cos",
    "deg2rad", "degrees", "divide", "equal", "exp", "fabs", "floor", "fmax", "fmin", "greater",
    "greater_equal", "hypot", "isfinite", "isinf", "isnan", "less", "less_equal", "log", "log10",
    "logical_and", "logical_not", "logical_or", "maximum", "minimum", "multiply", "negative",
    "not_equal", "positive", "power", "rad2deg", "radians", "reciprocal", "remainder", "rint",
    "sign", "sin", "sqrt", "square", "subtract", "tan",
)  # fmt: skip
"""Operations on elements; the page has the same names."""
LOGICAL = {"bitwise_and": "logical_and", "bitwise_or": "logical_or", "invert": "logical_not"}
"""Of truth values."""
MOST, MOST_ITEMS = 20_000, 64
"""Numbers of a constant; items of an array that is taken apart."""
KEEPING = ("asarray", "ascontiguousarray", "asanyarray")


class Traced(np.ndarray[Any, Any]):
    """An array that knows by which operation of which trace it was made (-1: it does not)."""

    owner: Trace
    place: int

    def __array_finalize__(self, source: Any) -> None:
        self.place = -1

    def __array_ufunc__(
        self, ufunc: np.ufunc, method: str, *inputs: Any, out: Any = None, **about: Any
    ) -> Any:
        outs = {} if out is None else {"out": tuple(map(_plain, out))}
        value = getattr(ufunc, method)(*map(_plain, inputs), **_plain(about), **outs)
        trace = next((x.owner for x in _arrays(inputs) if x.place >= 0), None)
        if trace is None:
            return value
        place = trace.ufunc(ufunc.__name__, method, inputs, about)
        if out is None:
            return trace.wrap(value, place)
        if isinstance(out[0], Traced):
            out[0].place = place
        return out[0]

    def __array_function__(self, func: Any, types: Any, args: Any, kwargs: Any) -> Any:
        own = FUNCTIONS.get(func.__name__)
        known = own and any(x.place >= 0 for x in _arrays(args))
        found = own(*args, **kwargs) if own and known else None
        return super().__array_function__(func, types, args, kwargs) if found is None else found

    def __getitem__(self, index: Any) -> Any:
        value = _plain(self)[_plain(index)]
        spelt = None if self.place < 0 else _spelt(index, self.shape)
        return value if spelt is None else self._noted(value, "pick", index=spelt)

    def __iter__(self) -> Iterator[Any]:
        if len(self) > MOST_ITEMS:  # rows, one by one: nothing for a page
            return iter(_plain(self))
        return (self[k] for k in range(len(self)))

    def view(self, *kind: Any, **about: Any) -> Any:
        """The same numbers, of the same kind unless told otherwise."""
        made = super().view(*kind, **about)
        return made if kind or about or self.place < 0 else self.owner.wrap(made, self.place)

    def reshape(self, *shape: Any, **_: Any) -> Any:
        """The same elements in another shape."""
        value = _plain(self).reshape(*shape)
        if value.shape == self.shape:
            return self
        return self._noted(value, "reshape", shape=list(value.shape))

    def ravel(self, *_: Any, **__: Any) -> Any:
        """The same elements in one row."""
        return self.reshape(-1)

    def transpose(self, *axes: Any) -> Any:
        """Other axes first."""
        order = axes[0] if len(axes) == 1 and not isinstance(axes[0], int) else axes
        order = list(order or range(self.ndim - 1, -1, -1))
        return self._noted(_plain(self).transpose(order), "transpose", axes=order)

    @property
    def T(self) -> Any:
        """All axes in the other order."""
        return self.transpose()

    def astype(self, dtype: Any, **_: Any) -> Any:  # type: ignore[override]
        """Truth values as numbers."""
        value = _plain(self).astype(dtype)
        return self._noted(value, "positive") if np.dtype(dtype).kind == "f" else value

    def copy(self, *_: Any, **__: Any) -> Any:
        """The same numbers."""
        return self._noted(_plain(self).copy(), "positive")

    __copy__ = __deepcopy__ = copy

    def _noted(self, value: Array, name: str, **about: Any) -> Any:
        """The value of an operation of that name on this array."""
        return value if self.place < 0 else self.owner.noted(value, name, [self], **about)


def _arrays(values: Any) -> Iterator[Traced]:
    for value in values:
        if isinstance(value, Traced):
            yield value
        elif isinstance(value, list | tuple):
            yield from _arrays(value)


def _plain(value: Any) -> Any:
    """The same without a trace, inside lists too."""
    if isinstance(value, Traced):
        return value.view(np.ndarray)
    if isinstance(value, list | tuple):
        return type(value)(map(_plain, value))
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    return value


def _spelt(index: Any, shape: Sequence[int]) -> list[dict[str, Any]] | None:
    """An index for the page; None if it has no word for it."""
    parts = list(index) if isinstance(index, tuple) else [index]
    wide = sum(part is not None and part is not Ellipsis for part in parts)
    found: list[dict[str, Any]] = []
    for part in parts:
        if part is Ellipsis:
            found += [{"s": [None, None, None]}] * (len(shape) - wide)
        elif word := _word(part):
            found.append(word)
        else:
            return None
    return found if sum("t" in each for each in found) <= 1 else None


def _word(part: Any) -> dict[str, Any] | None:
    """One part of an index: a new axis, a slice, a place, or places that are not those of rows."""
    if part is None:
        return {"n": 1}
    if isinstance(part, slice):
        ends = (part.start, part.stop, part.step)
        return {"s": [None if x is None else int(x) for x in ends]}
    if isinstance(part, int | np.integer):
        return {"i": int(part)}
    array = np.array(part)
    if isinstance(part, Traced) or array.ndim != 1 or array.dtype.kind not in "iub":
        return None
    places = np.flatnonzero(array) if array.dtype == bool else array
    return {"t": [int(x) for x in places]}


# ---- functions of numpy that are operations of the page, or that numpy does not write in them


def _noted(name: str, arrays: Sequence[Any], **about: Any) -> Any:
    """What the page makes of arrays by an operation, and the operation."""
    value = repeated(name, list(map(_plain, arrays)), about)
    owner = next(x.owner for x in _arrays(arrays) if x.place >= 0)
    return owner.noted(value, name, arrays, **about)


def _norm(x: Any, ord: Any = None, axis: Any = None, keepdims: Any = False) -> Any:
    if ord is not None or not (isinstance(axis, int) or (axis is None and x.ndim == 1)):
        return None
    return np.sqrt(np.add.reduce(x * x, axis=axis or 0, keepdims=keepdims))


def _einsum(letters: Any, *arrays: Any, **other: Any) -> Any:
    if other or len(arrays) != 2 or "." in letters or "->" not in letters:
        return None
    return _noted("einsum", arrays, letters=letters)


def _full(x: Any, value: float) -> Any:
    return x.owner.noted(np.full(x.shape, value), "full", [], shape=list(x.shape), value=value)


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "concatenate": lambda arrays, axis=0: _noted("concatenate", arrays, axis=axis),
    "copy": lambda x, **_: x.copy(),
    "cross": lambda a, b: _noted("cross", [a, b]) if np.shape(a)[-1] == 3 else None,
    "einsum": _einsum,
    "nan_to_num": lambda x: np.where(np.isnan(x), 0.0, x),
    "nanmax": lambda x, axis=None: np.fmax.reduce(x, axis=axis),
    "nanmin": lambda x, axis=None: np.fmin.reduce(x, axis=axis),
    "norm": _norm,
    "ones_like": lambda x, **_: _full(x, 1.0),
    "stack": lambda arrays, axis=0: _noted("stack", arrays, axis=axis),
    "where": lambda condition, *either: _noted("where", [condition, *either]) if either else None,
    "zeros_like": lambda x, **_: _full(x, 0.0),
}
"""Functions of numpy in words of the page; None: it has none for such arguments."""
REPEATED: Mapping[str, Callable[[list[Any], Mapping[str, Any]], Any]] = {
    "concatenate": lambda a, p: np.concatenate(a, axis=p["axis"]),
    "constant": lambda _, p: np.array([float(x) for x in p["values"]]).reshape(p["shape"]),
    "cross": lambda a, _: np.cross(*a),
    "einsum": lambda a, p: np.einsum(p["letters"], *a),
    "full": lambda _, p: np.full(p["shape"], p["value"]),
    "pick": lambda a, p: a[0][tuple(map(_index, p["index"]))],
    "reduce": lambda a, p: getattr(np, p["by"]).reduce(a[0], axis=p["axis"], keepdims=p["keep"]),
    "reduceat": lambda a, p: getattr(np, p["by"]).reduceat(a[0], p["places"], axis=0),
    "reshape": lambda a, p: a[0].reshape(p["shape"]),
    "stack": lambda a, p: np.stack(a, axis=p["axis"]),
    "transpose": lambda a, p: a[0].transpose(p["axes"]),
    "where": lambda a, _: np.where(a[0] != 0, a[1], a[2]),
}


def repeated(name: str, arrays: list[Any], about: Mapping[str, Any]) -> Any:
    """One operation with numpy, as the page does it."""
    with np.errstate(all="ignore"):
        return getattr(np, name)(*arrays) if name in UFUNCS else REPEATED[name](arrays, about)


def _index(part: Mapping[str, Any]) -> Any:
    """A part of an index from its word."""
    ((kind, value),) = part.items()
    if kind == "n":
        return None
    return slice(*value) if kind == "s" else value


# ---- the list


class Trace:
    """The operations behind traced arrays, each once: name, places of those whose results it takes,
    what else it is told; roots: the arrays that a flight brings, by name.
    """

    def __init__(self) -> None:
        self.operations: list[tuple[str, tuple[int, ...], dict[str, Any]]] = []
        self._places: dict[str, int] = {}

    def root(self, name: str, values: Array) -> Any:
        """The array of that name, with the numbers of this result."""
        return self.wrap(values, self._add("root", (), {"name": name}))

    def wrap(self, value: Any, place: int) -> Any:
        """A value of an operation; plain where there is none."""
        if place < 0 or isinstance(value, tuple):
            return value
        made = np.array(value, copy=None).view(Traced)
        made.owner, made.place = self, place
        return made

    def noted(self, value: Any, name: str, arrays: Sequence[Any], /, **about: Any) -> Any:
        """The value of the operation of that name on these arrays."""
        return self.wrap(value, self.note(name, arrays, **about))

    def note(self, name: str, arrays: Sequence[Any], **about: Any) -> int:
        """The operation of that name on these arrays; -1 if one of them is no number."""
        parts = tuple(map(self._part, arrays))
        return -1 if -1 in parts else self._add(name, parts, about)

    def ufunc(self, name: str, method: str, inputs: Sequence[Any], about: Mapping[str, Any]) -> int:
        """An operation on elements, or along an axis; -1: the page has no word for it."""
        idle = {"dtype", "casting", "subok"}
        told = {k: v for k, v in about.items() if v is not None and k not in idle}
        if any(np.asarray(_plain(x)).dtype == bool for x in inputs[:1]):
            name = LOGICAL.get(name, name)
        if name not in UFUNCS or told.pop("where", True) is not True:
            return -1
        if method == "__call__" and not told:
            return self.note(name, inputs)
        axis, keep = told.pop("axis", None if "axis" in about else 0), told.pop("keepdims", False)
        if method == "reduce" and not told and isinstance(axis, int | None):
            return self.note("reduce", inputs[:1], by=name, axis=axis, keep=bool(keep))
        if method == "reduceat" and not told and axis == 0 and not isinstance(inputs[1], Traced):
            places = [int(x) for x in np.asarray(inputs[1])]
            return self.note("reduceat", inputs[:1], by=name, places=places)
        return -1

    def _add(self, name: str, parts: tuple[int, ...], about: dict[str, Any]) -> int:
        place = self._places.setdefault(json.dumps([name, parts, about]), len(self.operations))
        if place == len(self.operations):
            self.operations.append((name, parts, about))
        return place

    def _part(self, value: Any) -> int:
        if isinstance(value, Traced) and value.place >= 0:
            return value.place
        array = np.asarray(_plain(value))
        if array.dtype.kind not in "fiub" or array.size > MOST:
            return -1
        values = [x if np.isfinite(x) else repr(x) for x in map(float, array.ravel())]
        return self._add("constant", (), {"shape": list(array.shape), "values": values})

    def written(self, asked: set[int]) -> tuple[dict[int, int], list[Any], list[Any]]:
        """These operations and all whose results they take, for the page: their numbers by place,
        the operations, and the long lists of places, once each.
        """
        listed, lists = [], dict[tuple[int, ...], int]()
        numbers = {place: k for k, place in enumerate(self._needed(asked))}
        for place in numbers:
            name, parts, about = self.operations[place]
            if name == "pick":
                about = {"index": [_shared(part, lists) for part in about["index"]]}
            listed.append([name, [numbers[part] for part in parts], about])
        return numbers, listed, list(lists)

    def _needed(self, asked: set[int]) -> list[int]:
        """These operations and all whose results they take, which come before them, in order."""
        found = set(asked)
        for place in range(len(self.operations) - 1, -1, -1):
            if place in found:
                found.update(self.operations[place][1])
        return sorted(found)

    def evaluate(self, roots: Mapping[str, Array]) -> Callable[[int], Array]:
        """Results of the operations by place, with other numbers at the roots."""
        known: dict[int, Any] = {}

        def value(place: int) -> Array:
            if place not in known:
                name, parts, about = self.operations[place]
                arrays = list(map(value, parts))
                root = name == "root"
                known[place] = roots[about["name"]] if root else repeated(name, arrays, about)
            return np.asarray(known[place])

        return value


def _shared(part: dict[str, Any], lists: dict[tuple[int, ...], int]) -> dict[str, Any]:
    """A part of an index, with the number of a list of places in its place."""
    return {"t": lists.setdefault(tuple(part["t"]), len(lists))} if "t" in part else part


# ---- numpy that hands traces on


@contextmanager
def traces_kept() -> Iterator[None]:
    """Within the block these functions of numpy hand on a Traced array of numbers as it is."""
    before = {name: getattr(np, name) for name in KEEPING}
    try:
        for name, own in before.items():
            setattr(np, name, _keeping(own))
        yield
    finally:
        for name, own in before.items():
            setattr(np, name, own)


def _keeping(own: Callable[..., Any]) -> Callable[..., Any]:
    def function(x: Any, dtype: Any = None, *args: Any, **kwargs: Any) -> Any:
        known = isinstance(x, Traced) and x.place >= 0
        if known and (dtype is None or np.dtype(dtype).kind == x.dtype.kind):
            return x
        return own(_plain(x), dtype, *args, **kwargs)

    return function
