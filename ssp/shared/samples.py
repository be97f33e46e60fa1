# SPDX-License-Identifier: BSD-2-Clause
"""Alignment of the rows of a sampled component with the rows of the plants.

A row contains the states of the plants at its time, and the outputs of a sampled component from the
states at its last sample, one sample earlier. Where every sample was recorded, the outputs for a
state are therefore in the next row. With rows further apart than samples the same row is used, and
an error contains the motion during one sample.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.results.result import Array, Result

PERIOD = "sample_period"
"""Parameter of sampled components [s]; 0: at every step."""


def is_late(result: Result, name: str) -> bool:
    """Return whether the outputs for a row are in the next row, for a variable of a sampled
    component.

    The schedule of the run defines it. If the result has no schedule, the first two rows show it,
    which are then equal: the outputs at the start and at the first sample.
    """
    known = result.provenance
    component = name.partition(".")[0]
    slot = next((s for s in (known.schedule if known else ()) if s.component == component), None)
    if known is None or slot is None or not known.step or len(result.time) < 2:
        values = result[name]
        return len(values) > 1 and np.array_equal(values[0], values[1])
    sampled = f"{component}.{PERIOD}"
    held = result.holds(parameters=(sampled,))
    period = max(slot.every * known.step, float(result.parameter(sampled)) if held else 0.0)
    return float(result.time[1] - result.time[0]) <= period * (1 + 1e-9)


def aligned(
    actual: Array, reference: Array, error: Callable[[Array, Array], Array], late: bool
) -> Array:
    """Return the error of every row against its reference; the last row, which has no next row,
    repeats the error of the row before.
    """
    if not late or len(actual) < 2:
        return error(actual, reference)
    errors = error(actual[:-1], reference[1:])
    return np.concatenate((errors, errors[-1:]))
