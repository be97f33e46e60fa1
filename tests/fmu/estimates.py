# SPDX-License-Identifier: BSD-2-Clause
"""State and whole covariance of a navigation filter, read from and written into its FMU state: the
ports carry standard deviations only. The estimate is the first member of the state of a filter;
states and outputs are the last doubles of the snapshot.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import c_double

import numpy as np

from .driver import Unit

TRACK, RING = 7, 16
RELATIVE = 24 + 23 * 23
"""rho, v, q, w, kappa, d, a and P"""
STATES = {
    "attitude_filter": 7 + 36 + 4 + TRACK + 4 * RING,
    "orbit_filter": 6 + 36 + 2 + 4 + TRACK,
    "relative_filter": 2 * RELATIVE + 4 + TRACK + 13 * RING,
}
"""Doubles in the states of the filters."""
ORDERS = {"attitude_filter": (7, 6), "orbit_filter": (6, 6), "relative_filter": (24, 23)}
"""Elements of the state vector, of the error."""


@contextmanager
def memory(unit: Unit) -> Iterator[np.ndarray]:
    """The doubles of the filter's state; what is changed in them is put back."""
    name = unit.kind.description.modelName
    snapshot = unit.slave.getFMUState()
    outputs = sum(v.causality == "output" for v in unit.kind.description.modelVariables)
    size = unit.slave.serializeFMUState(snapshot)
    count = STATES[name]
    first = snapshot.value + len(size) - 8 * (count + outputs)
    yield np.ctypeslib.as_array((c_double * count).from_address(first))
    unit.slave.setFMUState(snapshot)
    unit.slave.freeFMUState(snapshot)


def estimate(unit: Unit, anchor: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """State vector and covariance of the head, or of the anchor of relative_filter."""
    n, m = ORDERS[unit.kind.description.modelName]
    with memory(unit) as x:
        x = x[n + m * m :] if anchor else x
        return x[:n].copy(), x[n : n + m * m].reshape(m, m).copy()


def put_covariance(unit: Unit, P: np.ndarray) -> None:
    n, m = ORDERS[unit.kind.description.modelName]
    with memory(unit) as x:
        x[n : n + m * m] = P.ravel()


def named(x: np.ndarray) -> dict[str, np.ndarray]:
    """Parts of the state vector of relative_filter."""
    parts = np.split(x, [3, 6, 10, 13, 18, 21])
    return dict(zip(("rho", "v", "q", "w", "kappa", "d", "a"), parts, strict=True))
