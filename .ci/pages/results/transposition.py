# SPDX-License-Identifier: BSD-2-Clause
"""Transposition: its sets, the differences of the patent, the steps of the plan."""

from __future__ import annotations

from typing import Any

import numpy as np

from results import Column, flown, of_runs

SETS = ("ideal", "cluster", "earth_pointing", "printed_law")
SCHEMES = {
    "those of E.4": "transposition",
    "as printed": "transposition --set guidance.scheme=2",
    "second difference corrected": "transposition --set guidance.scheme=1",
}
MOMENTUM = "max(norm(assembly.h_cmg_S))"
ROTATION = "degrees(max(assembly.rotation))"


def saturated(result: Any) -> str:
    """When the gyros first have less momentum left than is asked for."""
    rows = np.flatnonzero(result["assembly.saturated"])
    return f"{result.time[rows[0]]:.0f} s" if len(rows) else "never"


def by_set() -> str:
    """The sets side by side."""
    return of_runs("set", {s: f"transposition --params {s}" for s in SETS}, [
        Column("largest momentum [N m s]", MOMENTUM, "{:.1f}"),
        Column("largest rotation [deg]", ROTATION, "{:.1f}"),
        Column("largest tracking error [deg]", "tracking error", "{:.3g}"),
        Column("saturated from", saturated),
    ])  # fmt: skip


def planned(result: Any) -> tuple[float, float]:
    """Peak of the momentum as planned [N m s], rotation of the plan [deg]."""
    last = int(result["guidance.iterations"][-1])
    return result["guidance.peak"][-1][last], np.degrees(result["guidance.rotation"][-1][last])


def by_scheme() -> str:
    """The plan with the differences of the patent."""
    return of_runs("differences", SCHEMES, [
        Column("peak as planned [N m s], at a rotation of [deg]", planned, "{:.0f}, {:.1f}"),
        Column("largest momentum [N m s]", MOMENTUM, "{:.0f}"),
        Column("saturated from", saturated),
    ])  # fmt: skip


def steps() -> str:
    """Peaks and rotations of the plan from step to step."""
    result = flown("transposition --params ideal")
    n = int(result["guidance.iterations"][-1]) + 1
    peaks = ", ".join(f"{peak:.0f}" for peak in result["guidance.peak"][-1][:n])
    turns = ", ".join(f"{turn:.3g}" for turn in np.degrees(result["guidance.rotation"][-1][:n]))
    return f"{peaks} N m s at rotations of {turns} deg"


FIGURES = {"transposition_sets": by_set, "transposition_plan": steps,
           "transposition_schemes": by_scheme}  # fmt: skip
