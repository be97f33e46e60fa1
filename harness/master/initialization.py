# SPDX-License-Identifier: BSD-2-Clause
"""How a system starts: parameters are set, and initial values go round until nothing changes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from harness.master.fmu import Instance

MAX_ROUNDS = 200
"""Rounds of initial propagation; a loop of two units and gain 1/2 has settled to the last bit after
half of them.
"""


def initialize(
    instances: Sequence[Instance], bus: NDArray[np.float64], start: float, stop: float
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Bring instances that are not initialised to the start time [s], their outputs onto the bus.

    Returns for every slot the round in which it changed last, and whether it was still changing
    when the rounds were over. Raises RunError: a refused parameter, a failing FMU, or an output
    that is not finite.
    """
    for instance in instances:
        instance.set_start_values(start)
        instance.enter_initialization(start, stop)
    settled, undecided = _settle(instances, bus, start)
    for instance in instances:
        instance.exit_initialization(start)
    for instance in instances:
        instance.propagate_outputs(bus, start)
        instance.check_outputs(start)
    return settled, undecided


def _settle(
    instances: Sequence[Instance], bus: NDArray[np.float64], start: float
) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Rounds of GET and SET until nothing changes; a chain of n units needs n + 1.

    Where flight software reads back its own command there is a loop. If it does not settle, its
    last values are taken.
    """
    settled = np.zeros(len(bus), dtype=np.intp)
    changed = np.zeros(len(bus), dtype=np.bool_)
    for count in range(1, MAX_ROUNDS + 1):
        changed = _round(instances, bus, start)
        settled[changed] = count
        if not changed.any():
            break
    return settled, changed


def _round(
    instances: Sequence[Instance], bus: NDArray[np.float64], start: float
) -> NDArray[np.bool_]:
    """One round of initial propagation; returns which slots it has changed (NaN counts as a
    value).
    """
    before = bus.copy()
    for instance in instances:
        instance.propagate_outputs(bus, start)
    for instance in instances:
        instance.propagate_inputs(bus, start)
    return np.asarray(bus.view(np.uint64) != before.view(np.uint64))
