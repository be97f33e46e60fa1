# SPDX-License-Identifier: BSD-2-Clause
"""Shared parts of the tests of the sensors."""

from __future__ import annotations

import numpy as np

from tests.reference.attitude import angle, conjugate, multiply

from .driver import bits


def turn_between(a, b) -> float:
    """Angle from one attitude to another [rad]."""
    return angle(multiply(conjugate(a), b))


def same_bits_for_any_steps(fmu, name, parameters, inputs, stop=6.0, step=0.1):
    """Constant inputs: for any steps of the master, the outputs at the end are the same bits."""
    seen = set()
    for cuts in ([step] * round(stop / step), [step / 2] * round(2 * stop / step), [stop]):
        unit = fmu(name, parameters, inputs)
        for h in cuts:
            unit.step(h)
        seen.add(bits(unit))
    uneven = fmu(name, parameters, inputs)
    while uneven.time < stop - 1e-9:
        uneven.step(min(0.37, stop - uneven.time))
    return len(seen | {bits(uneven)}) == 1


def unit_vector(rng):
    a = rng.normal(size=3)
    return a / np.linalg.norm(a)
