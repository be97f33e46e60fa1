# SPDX-License-Identifier: BSD-2-Clause
"""Arithmetic on histories of vectors (rows, elements), column by column: numpy takes several times
as long for many rows of a few elements. The bits are those of the plain operations.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from harness.results.result import Array

PAIRWISE = 8
"""So many numbers in a row numpy adds in pairs, fewer from the first to the last."""


def _is_narrow(x: Any) -> bool:
    """Whether an array is a history of a few numbers; one of another class, as one that records how
    it was made, goes the plain way.
    """
    return (
        type(x) is np.ndarray
        and x.dtype == np.float64
        and x.ndim == 2
        and 0 < x.shape[1] < PAIRWISE
    )


def _each(function: Callable[..., Any], plain: Callable[[Any, Any], Any], a: Any, b: Any) -> Any:
    if not (_is_narrow(a) and _is_narrow(b) and a.shape == b.shape):
        return plain(a, b)
    result = np.empty(a.shape)
    for k in range(a.shape[1]):
        function(a[:, k], b[:, k], out=result[:, k])
    return result


plus = partial(_each, np.add, operator.add)
minus = partial(_each, np.subtract, operator.sub)


def norm(x: Any) -> Array:
    """Length of every row."""
    array = np.asarray(x, dtype=np.float64)
    if not _is_narrow(array):
        return np.asarray(np.sqrt(total(np.square(array))))
    squares = np.square(array[:, 0])
    for k in range(1, array.shape[1]):
        squares += np.square(array[:, k])
    return np.asarray(np.sqrt(squares))


def total(x: Any) -> Array:
    """Sum over the elements of every row."""
    if not _is_narrow(x):
        return np.asarray(np.sum(x, axis=-1))
    result = x[:, 0].copy()
    for k in range(1, x.shape[1]):
        result += x[:, k]
    return np.asarray(result)
