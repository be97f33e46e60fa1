# SPDX-License-Identifier: BSD-2-Clause
"""The studies by the name of their table in the file of a campaign."""

from __future__ import annotations

from collections.abc import Callable

from harness.studies.inquiry.boundary import boundary_map
from harness.studies.inquiry.probability import probability
from harness.studies.inquiry.sensitivity import sensitivity
from harness.studies.inquiry.study import Study
from harness.studies.inquiry.tuning import tune
from harness.studies.inquiry.worst import worst

STUDIES: dict[str, Callable[..., Study]] = {
    "sensitivity": sensitivity,
    "worst": worst,
    "probability": probability,
    "map": boundary_map,
    "tune": tune,
}
