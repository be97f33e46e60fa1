# SPDX-License-Identifier: BSD-2-Clause
"""Mission: tracking with prescribed performance. Its figures are in ssp.shared, since its
line-of-sight controllers can be used in every approach.
"""

from __future__ import annotations

from dataclasses import replace

from ..shared.approach import approach
from .bound import BOUND
from .claims import PAPERS

MISSION = replace(approach(claims=PAPERS), bounds=(BOUND,))
