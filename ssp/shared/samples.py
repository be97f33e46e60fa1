# SPDX-License-Identifier: BSD-2-Clause
"""Alignment of the outputs of sampled components with the states of the plants.

A row contains the states of the plants at its time, and the outputs that a sampled component has
computed at its last sample, from the states one sample earlier. If every sample is recorded, the
outputs for a state are therefore in the next row. If rows are further apart than samples, outputs
and states of the same row are compared, and the error contains the motion during one sample.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.results.result import Array, Result

PERIOD = "sample_period"
"""Parameter of sampled components: time between two samples [s], 0: a sample at every step."""


def is_late(result: Result, name: str) -> bool:
    """Return whether the outputs that a sampled component computes from the states of a row are in
    the next row; name: one of these outputs.

    The answer follows from the schedule of the run. For a result without a schedule it is true if
    the first two values of the variable are equal, since the outputs at the start and at the first
    sample are computed from the same states.
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
    """Return error(actual, reference) for every row; actual: states of the plants; reference:
    outputs of a sampled component, taken from the next row if `late`. The last row, which has no
    next row, then repeats the error of the row before.
    """
    if not late or len(actual) < 2:
        return error(actual, reference)
    errors = error(actual[:-1], reference[1:])
    return np.concatenate((errors, errors[-1:]))
