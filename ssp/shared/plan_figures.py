# SPDX-License-Identifier: BSD-2-Clause
"""Figure of the plan of the fuel-optimal law (docs/models.md N): remaining velocity increment,
convergence of its iterations, and number of nodes at each constraint.
"""

from __future__ import annotations

from functools import partial

from harness.mission.figure import Curve, Figure, Panel
from harness.results.result import Result

PLANNERS = ("controller", "optimal")
"""Components that may publish a plan."""


def _is_planned(planner: str, result: Result) -> bool:
    """Return whether the component `planner` followed its present plan in any row (`mode` 0)."""
    return bool((result[f"{planner}.mode"] == 0).any())


def _figure(planner: str) -> Figure:
    def panel(label: str, log: bool = False, **curves: str) -> Panel:
        shown = (Curve(f"{planner}.{name}", text) for name, text in curves.items())
        return Panel(label, tuple(shown), log=log)

    return Figure(
        "plan",
        "Plan of the fuel-optimal law",
        (
            panel("increment left [m/s]", dv_left=""),
            panel(
                "residual [m]", log=True, residual_p="constraints", change_p="change", miss="goal"
            ),
            panel(
                "nodes at", count_box="limit of force", count_cone="cone", count_slab="slab, ball"
            ),
        ),
        only=partial(_is_planned, planner),
    )


FIGURES = tuple(map(_figure, PLANNERS))
