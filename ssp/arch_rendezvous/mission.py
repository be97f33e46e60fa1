# SPDX-License-Identifier: BSD-2-Clause
"""Mission: spacecraft rendezvous, benchmark SPRE of the verification competition ARCH-COMP."""

from __future__ import annotations

from dataclasses import replace

from ..shared.approach import approach
from .bound import BOUND
from .claims import PAPERS
from .figures import FIGURES

MISSION = replace(approach(FIGURES, PAPERS), bounds=(BOUND,))
