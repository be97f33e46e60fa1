# SPDX-License-Identifier: BSD-2-Clause
"""Analyses (studies) that choose further runs from the results of earlier ones: sensitivity and
worst case.

The methods know nothing of the simulation. A method requests runs by an array of standard normal
coordinates (rows, d), one row per run and d coordinates per row. It receives the margins of one
requirement in these runs (rows,), which are negative where the requirement fails and -inf for a
failed run. `evaluator.py` performs the runs with the worker pool of a campaign. `driver.py` stores
every run in the dataset of a campaign, from which a resumed analysis takes the margins of earlier
runs.
"""

from __future__ import annotations

from collections.abc import Callable

from harness.studies.analyses import sensitivity, worst
from harness.studies.analyses.study import Study

STUDIES: dict[str, Callable[..., Study]] = {
    "sensitivity": sensitivity.sensitivity,
    "worst": worst.worst,
}
"""Function that performs each analysis, by the name of its table in the file of a campaign."""
