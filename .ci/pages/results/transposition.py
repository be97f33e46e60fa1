# SPDX-License-Identifier: BSD-2-Clause
"""Transposition: parameter sets, finite differences of the patent, iterations of the plan."""

from __future__ import annotations

from typing import Any

import numpy as np
from results import Column, of_runs, result_of

SETS = ("ideal", "cluster", "earth_pointing", "printed_law")
SCHEMES = {
    "as in E.4": "transposition",
    "as printed": "transposition --set guidance.scheme=2",
    "second difference corrected": "transposition --set guidance.scheme=1",
}
MOMENTUM = "max(norm(assembly.h_cmg_S))"
ROTATION = "degrees(max(assembly.rotation))"


def saturated(result: Any) -> str:
    """Return the time when the gyros are first saturated, as text."""
    rows = np.flatnonzero(result["assembly.saturated"])
    return f"{result.time[rows[0]]:.0f} s" if len(rows) else "never"


def by_set() -> str:
    """Return a table with a row per parameter set."""
    return of_runs("set", {s: f"transposition --params {s}" for s in SETS}, [
        Column("largest momentum [N m s]", MOMENTUM, "{:.1f}"),
        Column("largest rotation [deg]", ROTATION, "{:.1f}"),
        Column("largest tracking error [deg]", "tracking error", "{:.3g}"),
        Column("saturated from", saturated),
    ])  # fmt: skip


def planned(result: Any) -> tuple[float, float]:
    """Return the planned peak of the momentum [N m s] and the largest planned rotation [deg]."""
    last = int(result["guidance.iterations"][-1])
    return result["guidance.peak"][-1][last], np.degrees(result["guidance.rotation"][-1][last])


def by_scheme() -> str:
    """Return a table with a row per scheme of finite differences of the plan: as in E.4 of
    docs/models.md, as printed in the patent, and as printed with the second difference corrected.
    """
    return of_runs("differences", SCHEMES, [
        Column("peak as planned [N m s], at a rotation of [deg]", planned, "{:.0f}, {:.1f}"),
        Column("largest momentum [N m s]", MOMENTUM, "{:.0f}"),
        Column("saturated from", saturated),
    ])  # fmt: skip


def steps() -> str:
    """Return, as text, the peak of the momentum and the largest rotation before each iteration of
    the plan and after the last.
    """
    result = result_of("transposition --params ideal")
    n = int(result["guidance.iterations"][-1]) + 1
    peaks = ", ".join(f"{peak:.0f}" for peak in result["guidance.peak"][-1][:n])
    turns = ", ".join(f"{turn:.3g}" for turn in np.degrees(result["guidance.rotation"][-1][:n]))
    return f"{peaks} N m s at rotations of {turns} deg"


VALUES = {"transposition_sets": by_set, "transposition_plan": steps,
           "transposition_schemes": by_scheme}  # fmt: skip
