# SPDX-License-Identifier: BSD-2-Clause
"""Phase plots of an approach: a quantity against its rate."""

from __future__ import annotations

import numpy as np

from harness.mission import Phase
from harness.mission.figure import DEGREES, scaled
from harness.results.result import Array, Result

from .relative_motion import SERVICER, TARGET, VELOCITIES, range_, release_time


def _range_rate(result: Result) -> Array:
    """Derivative of the range, (rows,) [m/s]."""
    rho = result[SERVICER] - result[TARGET]
    drho = result[VELOCITIES[0]] - result[VELOCITIES[1]]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sum(rho * drho, axis=1) / range_(result))


PHASES = (
    Phase(
        "Range", "range [m]", "its rate [m/s]", (SERVICER, TARGET, *VELOCITIES), range_, _range_rate
    ),
    Phase(
        "Attitude error",
        "MRP of S relative to D",
        "rate error [deg/s]",
        ("controller.epsilon", "controller.domega_S"),
        scaled("controller.epsilon"),
        scaled("controller.domega_S", DEGREES),
        after=release_time,
    ),
)
