# SPDX-License-Identifier: BSD-2-Clause
"""Analyses (studies) that choose further runs from the results of earlier ones: sensitivity and
worst case.

The method of an analysis does not depend on the simulation. It requests runs by standard normal
coordinates (rows, d), one row per run, and receives the margins of a requirement in these runs
(rows,), which are negative where it fails and -inf for a failed run. `evaluator.py` performs the
runs with the worker pool of a campaign. `driver.py` stores every run in the dataset of a campaign,
from which a resumed analysis takes the margins of earlier runs.
"""

from __future__ import annotations

from collections.abc import Callable

from harness.studies.analyses import sensitivity, worst
from harness.studies.analyses.study import Study

STUDIES: dict[str, Callable[..., Study]] = {
    "sensitivity": sensitivity.sensitivity,
    "worst": worst.worst,
}
"""Functions of the analyses by the name of their table in the file of a campaign."""
