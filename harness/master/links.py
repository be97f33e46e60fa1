# SPDX-License-Identifier: BSD-2-Clause
"""What a component on another processor has cost there, asked of the link that stands for it."""

from __future__ import annotations

import ctypes
from typing import NamedTuple

from harness.errors import FmuError
from harness.master.fmu import Instance


class Cost(NamedTuple):
    """Steps of a component on its processor.

    steps: number; total, largest: instructions of all steps, and of the dearest (0: not counted);
    when: communication point of the dearest [s]; stack: used by the steps [bytes]; memory:
    allocated by the instance [bytes]; late: answers after their deadline.
    """

    steps: int
    total: int
    largest: int
    when: float
    stack: int
    memory: int
    late: int

    @property
    def mean(self) -> float:
        """Instructions of a step."""
        return self.total / self.steps if self.steps else 0.0


class _Statistics(ctypes.Structure):
    """Struct LinkStatistics of link_statistics.h."""

    _fields_ = [
        ("steps", ctypes.c_uint64),
        ("total", ctypes.c_uint64),
        ("largest", ctypes.c_uint64),
        ("when", ctypes.c_double),
        ("stack", ctypes.c_uint32),
        ("memory", ctypes.c_uint32),
        ("late", ctypes.c_uint64),
    ]


def cost(instance: Instance) -> Cost:
    """Cost of the steps so far; FmuError if the instance is no link, or its board is silent."""
    ask = getattr(instance.library, "slnk_statistics", None)
    if ask is None:
        raise FmuError(f"{instance.name}: runs in the simulation, not on a processor of its own")
    ask.restype = ctypes.c_bool
    found = _Statistics()
    if not ask(instance.handle, ctypes.byref(found)):
        raise FmuError(f"{instance.name}: its board does not say what its steps have cost")
    return Cost(*(getattr(found, name) for name in Cost._fields))
