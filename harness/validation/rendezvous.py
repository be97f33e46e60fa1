"""The rendezvous benchmark SPRE as the system arch_rendezvous flies it.

Units of the benchmark: m, min, kg; a gain is kg/min2 on positions and kg/min on velocities.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from harness.validation.units import Library, fly_system

if TYPE_CHECKING:
    from harness.validation.case import Case

MINUTE = 60.0
POSITION, RATE = "controller.rho_H", "controller.drho_H"


def rendezvous(case: Case, library: Library) -> list[dict[str, NDArray[np.float64]]]:
    """Positions [m] and velocities [m/min] in the Hill frame at the rows; over the whole run the
    least margins of the three constraints.
    """
    del library
    raise NotImplementedError(fly_system, POSITION, RATE)
