# SPDX-License-Identifier: BSD-2-Clause
"""What the rendezvous benchmark hands the engine."""

from __future__ import annotations

from ..shared.approach import approach
from .claims import PAPERS
from .figures import FIGURES

MISSION = approach(FIGURES, PAPERS)
