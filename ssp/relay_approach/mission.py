# SPDX-License-Identifier: BSD-2-Clause
"""Mission: relay approach."""

from __future__ import annotations

from ..shared.approach import approach
from .claims import PAPER
from .figures import FIGURES

MISSION = approach(FIGURES, (PAPER,))
