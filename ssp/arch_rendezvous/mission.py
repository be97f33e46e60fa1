# SPDX-License-Identifier: BSD-2-Clause
"""Mission: rendezvous benchmark."""

from __future__ import annotations

from ..shared.approach import approach
from .claims import PAPERS
from .figures import FIGURES

MISSION = approach(FIGURES, PAPERS)
