# SPDX-License-Identifier: BSD-2-Clause
"""What tracking with prescribed performance hands the engine; its figures are those of the
line-of-sight controllers, which fly in every approach.
"""

from __future__ import annotations

from ..shared.approach import approach
from .claims import PAPERS

MISSION = approach(claims=PAPERS)
