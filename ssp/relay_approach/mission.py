# SPDX-License-Identifier: BSD-2-Clause
"""Mission: approach to a drifting target with relay control of on-off thrusters."""

from __future__ import annotations

from dataclasses import replace

from ..shared.approach import approach
from .bound import BOUND
from .claims import PAPER
from .figures import FIGURES

MISSION = replace(approach(FIGURES, (PAPER,)), bounds=(BOUND,))
