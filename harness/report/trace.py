# SPDX-License-Identifier: BSD-2-Clause
"""What code for numpy computes from the rows of a result, as a list of operations: a page repeats
them over the rows of another flight.

An array of rows that is Traced knows the operation that made it. What numpy makes of it is Traced
too, where the table of operations has a word for it; everything else gives plain arrays, whose
numbers are then those of this result. `Trace.evaluate` repeats the operations: whoever compares
that with the code itself finds what was lost on the way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.report.operations import UFUNCS, Operations, repeated

Array = NDArray[Any]
LOGICAL = {"bitwise_and": "logical_and", "bitwise_or": "logical_or", "invert": "logical_not"}
"""Of truth values."""


class Traced(np.ndarray[Any, Any]):
    """An array that knows by which operation of which trace it was made (-1: it does not)."""

    owner: Trace
    place: int

    def __array_finalize__(self, source: Any) -> None:
        self.place = -1

    def __array_ufunc__(
        self, ufunc: np.ufunc, method: str, *inputs: Any, out: Any = None, **about: Any
    ) -> Any:
        trace = next((x.owner for x in _arrays(inputs) if x.place >= 0), None)
        told = {k: _plain(v) for k, v in about.items()}
        outs = {} if out is None else {"out": tuple(map(_plain, out))}
        value = getattr(ufunc, method)(*map(_plain, inputs), **told, **outs)
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
        found = own(*args, **kwargs) if own else None
        return func(*_plain(args), **_plain(kwargs)) if found is None else found

    def __getitem__(self, index: Any) -> Any:
        value = _plain(self)[_plain(index)]
        spelt = None if self.place < 0 else _spelt(index, self.shape)
        if spelt is None:
            return value
        return self.owner.wrap(value, self.owner.note("pick", [self], index=spelt))

    def __iter__(self) -> Iterator[Any]:
        if len(self) > MOST_ITEMS:  # rows, one by one: nothing for a page
            return iter(_plain(self))
        return (self[k] for k in range(len(self)))

    def view(self, *kind: Any, **about: Any) -> Any:
        """The same numbers, of the same kind unless told otherwise."""
        own = super().view
        return own(*kind, **about) if kind or about else self._noted(own(np.ndarray), "")

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

    def copy(self, *_: Any) -> Any:
        """The same numbers."""
        return self._noted(_plain(self).copy(), "positive")

    __copy__ = copy

    def mean(self, axis: Any = None, **_: Any) -> Any:  # type: ignore[override]
        """The mean of all elements, or along an axis."""
        return _mean(self, axis)

    def __deepcopy__(self, _: Any) -> Any:
        return self.copy()

    def _noted(self, value: Array, name: str, **about: Any) -> Any:
        """The value of an operation of that name; "": of the one that made this array."""
        if self.place < 0:
            return value
        place = self.owner.note(name, [self], **about) if name else self.place
        return self.owner.wrap(value, place)


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
    """One part of an index: a new axis, a slice, a place or places."""
    if part is None:
        return {"n": 1}
    if isinstance(part, slice):
        ends = (part.start, part.stop, part.step)
        return {"s": [None if x is None else int(x) for x in ends]}
    if isinstance(part, int | np.integer):
        return {"i": int(part)}
    places = _places(part)
    return None if places is None else {"t": places}


def _places(part: Any) -> list[int] | None:
    """Places of an array of whole numbers or truth values, which are not those of rows."""
    if isinstance(part, Traced):
        return None
    array = np.array(part)
    if array.ndim != 1:
        return None
    if array.dtype == bool:
        array = np.flatnonzero(array)
    return [int(x) for x in array] if array.dtype.kind in "iu" else None


# ---- functions of numpy


def _reduced(name: str) -> Callable[..., Any]:
    def function(x: Any, axis: Any = None, keepdims: Any = False, **other: Any) -> Any:
        if other:
            return None
        return getattr(np, name).reduce(x, axis=axis, keepdims=bool(keepdims))

    return function


def _mean(x: Any, axis: Any = None, **other: Any) -> Any:
    if other or not isinstance(axis, int | None):
        return None
    count = x.size if axis is None else x.shape[axis]
    return np.add.reduce(x, axis=axis) / count


def _norm(x: Any, ord: Any = None, axis: Any = None, keepdims: Any = False) -> Any:
    if ord is not None or not (isinstance(axis, int) or (axis is None and x.ndim == 1)):
        return None
    return np.sqrt(
        np.add.reduce(x * x, axis=axis or 0 if axis is None else axis, keepdims=keepdims)
    )


def _cross(a: Any, b: Any, **other: Any) -> Any:
    return None if other or np.shape(a)[-1] != 3 else _note("cross", [a, b])


def _where(condition: Any, *either: Any) -> Any:
    return _note("where", [condition, *either]) if len(either) == 2 else None


def _stack(arrays: Any, axis: int = 0, **_: Any) -> Any:
    return _note("stack", list(arrays), axis=axis)


def _concatenate(arrays: Any, axis: int = 0, **_: Any) -> Any:
    return _note("concatenate", list(arrays), axis=axis)


def _einsum(letters: Any, *arrays: Any, **other: Any) -> Any:
    if other or len(arrays) != 2 or "." in letters or "->" not in letters:
        return None
    return _note("einsum", list(arrays), letters=letters)


def _clip(x: Any, low: Any, high: Any, **_: Any) -> Any:
    return np.minimum(np.maximum(x, low), high)


def _like(value: float) -> Callable[..., Any]:
    def function(x: Any, *_: Any, **__: Any) -> Any:
        made = np.full(x.shape, value)
        place = x.owner.note("full", [], shape=list(x.shape), value=value)
        return x.owner.wrap(made, place)

    return function


def _nan_to_num(x: Any, **other: Any) -> Any:
    return None if other else np.where(np.isnan(x), 0.0, x)


def _atleast(axes: int) -> Callable[..., Any]:
    def function(x: Any) -> Any:
        return x if x.ndim >= axes else x.reshape(*[1] * (axes - x.ndim), *x.shape)

    return function


def _note(name: str, arrays: list[Any], **about: Any) -> Any:
    """What the page makes of arrays by an operation, and the operation."""
    trace = next(_arrays(arrays)).owner
    value = repeated(name, list(map(_plain, arrays)), about)
    return trace.wrap(value, trace.note(name, arrays, **about))


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "all": _reduced("logical_and"),
    "amax": _reduced("maximum"),
    "amin": _reduced("minimum"),
    "any": _reduced("logical_or"),
    "atleast_1d": _atleast(1),
    "atleast_2d": _atleast(2),
    "clip": _clip,
    "concatenate": _concatenate,
    "copy": lambda x, **_: x.copy(),
    "cross": _cross,
    "einsum": _einsum,
    "max": _reduced("maximum"),
    "mean": _mean,
    "min": _reduced("minimum"),
    "nan_to_num": _nan_to_num,
    "nanmax": _reduced("fmax"),
    "nanmin": _reduced("fmin"),
    "norm": _norm,
    "ones_like": _like(1.0),
    "ravel": lambda x, **_: x.ravel(),
    "reshape": lambda x, *shape, **_: x.reshape(*shape),
    "stack": _stack,
    "sum": _reduced("add"),
    "transpose": lambda x, axes=None: x.transpose(*(axes or ())),
    "where": _where,
    "zeros_like": _like(0.0),
}
"""Functions of numpy in words of the page; None: it has none for such arguments."""


# ---- the list


class Trace(Operations):
    """The operations behind traced arrays; roots: the arrays that a flight brings, by name."""

    def root(self, name: str, values: Array) -> Any:
        """The array of that name, with the numbers of this result."""
        return self.wrap(values, self.add("root", (), {"name": name}))

    def wrap(self, value: Any, place: int) -> Any:
        """A value of an operation; plain where there is none."""
        if place < 0 or isinstance(value, tuple):
            return value
        made = np.array(value, copy=None).view(Traced)
        made.owner, made.place = self, place
        return made

    def note(self, name: str, arrays: Sequence[Any], **about: Any) -> int:
        """The operation of that name on these arrays; -1 if one of them is no number."""
        parts = tuple(map(self._part, arrays))
        return -1 if -1 in parts else self.add(name, parts, about)

    def ufunc(self, name: str, method: str, inputs: Sequence[Any], about: Mapping[str, Any]) -> int:
        """An operation on elements, or along an axis; -1: the page has no word for it."""
        told = {key: value for key, value in about.items() if value is not None and key != "dtype"}
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

    def _part(self, value: Any) -> int:
        if isinstance(value, Traced) and value.place >= 0:
            return value.place
        array = np.asarray(_plain(value))
        if array.dtype.kind not in "fiub" or array.size > MOST:
            return -1
        values = [x if np.isfinite(x) else repr(x) for x in map(float, array.ravel())]
        return self.add("constant", (), {"shape": list(array.shape), "values": values})


MOST = 20_000
"""Numbers of a constant."""
MOST_ITEMS = 64
"""Items of an array that is taken apart."""


# ---- numpy that hands traces on

KEEPING = ("asarray", "ascontiguousarray", "asanyarray")


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
