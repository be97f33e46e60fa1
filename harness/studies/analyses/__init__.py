# SPDX-License-Identifier: BSD-2-Clause
"""Analyses with adaptive runs: sensitivity, worst case, probability of failure, boundary, tuning.

A method is a generator that does not depend on the simulation. It yields standard normal
coordinates (rows, d), one row per run, and receives their margins (rows,), negative for a failure,
-inf for a failed run. Its return value is its estimate. `evaluator.py` runs coordinates
with the worker pool of a campaign. `driver.py` stores every run in the dataset of a campaign, which
supplies the answers again when an interrupted analysis is resumed.
"""

from __future__ import annotations

from collections.abc import Callable

from harness.studies.analyses import boundary, probability, sensitivity, tuning, worst
from harness.studies.analyses.study import Study

STUDIES: dict[str, Callable[..., Study]] = {
    "sensitivity": sensitivity.sensitivity,
    "worst": worst.worst,
    "probability": probability.probability,
    "boundary": boundary.boundary,
    "tune": tuning.tune,
}
"""Functions of the analyses by the name of their table in the file of a campaign."""
