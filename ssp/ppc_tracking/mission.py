# SPDX-License-Identifier: BSD-2-Clause
"""Mission: tracking with prescribed performance. Its figures belong to the line-of-sight
controllers, which are available in every approach.
"""

from __future__ import annotations

from dataclasses import replace

from ..shared.approach import approach
from .bound import BOUND
from .claims import PAPERS

MISSION = replace(approach(claims=PAPERS), bounds=(BOUND,))
