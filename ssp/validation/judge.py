# SPDX-License-Identifier: BSD-2-Clause
"""How far our answer is from the published one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from harness.mission.claim import Row
from harness.results.result import Array

from .case import Case
from .flights import expected, fly
from .library import Library
from .orbits import angle_between


def judge(case: Case, library: Library) -> list[Row]:
    """Fly a case and compare all its quantities."""
    worst = dict.fromkeys(case.tolerance, 0.0)
    for row, ours in zip(case.rows, fly(case, library), strict=True):
        for name in expected(row):
            worst[name] = float(np.fmax(worst[name], difference(name, ours[name], row[name])))
            if not np.all(np.isfinite(ours[name])):
                worst[name] = np.inf
    return [
        Row(case.id, case.tests, case.source, name, worst[name], limit, case.units[name])
        for name, limit in case.tolerance.items()
    ]


def difference(name: str, ours: Array, theirs: Any) -> float:
    """Euclidean norm; of C the angle; of a bound {above, below} what is beyond it."""
    if isinstance(theirs, Mapping):
        return float(
            max(
                0.0,
                np.max(theirs.get("above", -np.inf) - ours),
                np.max(ours - theirs.get("below", np.inf)),
            )
        )
    if name == "C":
        return angle_between(ours.reshape(3, 3), np.reshape(theirs, (3, 3)))
    return float(np.linalg.norm(ours - np.ravel(theirs)))
