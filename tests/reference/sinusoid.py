# SPDX-License-Identifier: BSD-2-Clause
"""Disturbance record: bias + amplitude sin(frequency t + phase) per axis from `start` on, zero
before.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import sin

import numpy as np

from .attitude import Array

ZERO3 = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Sinusoid:
    bias: Sequence[float] = ZERO3
    amplitude: Sequence[float] = ZERO3
    frequency: Sequence[float] = ZERO3
    """rad/s"""
    phase: Sequence[float] = ZERO3
    """rad"""
    start: float = 0.0
    """s"""

    def active(self, t: float) -> bool:
        return t >= self.start and (any(self.bias) or any(self.amplitude))

    def __call__(self, t: float) -> Array:
        if t < self.start:
            return np.zeros(3)
        axes = zip(self.bias, self.amplitude, self.frequency, self.phase, strict=True)
        return np.array([b + a * sin(w * t + p) for b, a, w, p in axes])
