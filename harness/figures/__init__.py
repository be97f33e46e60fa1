# SPDX-License-Identifier: BSD-2-Clause
"""Figures of results as tables, one file per system; a figure is drawn if the result holds what it
needs.
"""

from __future__ import annotations

from harness.figures import (
    arch_rendezvous,
    navigation,
    overlay,
    ppc_tracking,
    relay_approach,
    safety,
    space_robot,
    sync_approach,
    transposition,
)
from harness.figures.figure import Curve, Drawing, Figure, Level, Overlay, Panel

FIGURES: tuple[Figure | Drawing, ...] = (
    *sync_approach.FIGURES,
    *relay_approach.FIGURES,
    *arch_rendezvous.FIGURES,
    *ppc_tracking.FIGURES,
    *space_robot.FIGURES,
    *transposition.FIGURES,
    *navigation.FIGURES,
    *safety.FIGURES,
)
OVERLAYS: tuple[Figure | Overlay, ...] = (*overlay.FIGURES, *transposition.OVERLAYS)

__all__ = ["FIGURES", "OVERLAYS", "Curve", "Drawing", "Figure", "Level", "Overlay", "Panel"]
