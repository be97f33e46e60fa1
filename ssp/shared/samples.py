# SPDX-License-Identifier: BSD-2-Clause
"""Which rows of a sampled component belong to which rows of the plants.

A row holds the states of the plants at its time, and what a sampled component made of the states at
its last sample, one sample earlier. Where every sample was recorded, what belongs to a state
therefore stands in the next row. With rows further apart than samples the same row is taken, and an
error contains the motion during one sample.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.results.result import Array, Result

PERIOD = "sample_period"
"""Parameter of sampled components [s]; 0: at every step."""


def is_late(result: Result, name: str) -> bool:
    """Whether what belongs to a row stands in the next one, for a variable of a sampled component.

    The schedule of the run says it; where the result holds none, the first two rows do, which are
    the same: the outputs at the start and those of the first sample.
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
    """Error of every row against the reference that belongs to it; the last row, which has no next
    one, repeats the error of the row before.
    """
    if not late or len(actual) < 2:
        return error(actual, reference)
    errors = error(actual[:-1], reference[1:])
    return np.concatenate((errors, errors[-1:]))
