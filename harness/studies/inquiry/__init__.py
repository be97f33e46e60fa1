# SPDX-License-Identifier: BSD-2-Clause
"""Studies that ask on: what matters, what is the worst, how probable is it, how many runs.

A method is a generator that knows nothing of flights: it yields numbers (rows, d), independent and
normal, one row per flight, and is sent their margins (rows,), negative where a flight fails, -inf
where it died. What it returns is its estimate. `flights.py` makes flights of numbers with the crew
of a campaign; `driver.py` keeps every flight in the dataset of a campaign, which answers again when
an interrupted study goes on.
"""

from __future__ import annotations

from collections.abc import Callable

from harness.studies.inquiry import boundary, probability, sensitivity, tuning, worst
from harness.studies.inquiry.study import Study

STUDIES: dict[str, Callable[..., Study]] = {
    "sensitivity": sensitivity.sensitivity,
    "worst": worst.worst,
    "probability": probability.probability,
    "map": boundary.boundary,
    "tune": tuning.tune,
}
"""By the name of their table in the file of a campaign."""
