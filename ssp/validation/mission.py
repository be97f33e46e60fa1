# SPDX-License-Identifier: BSD-2-Clause
"""Mission: published cases, with which `harness validate` compares the FMUs."""

from __future__ import annotations

from collections.abc import Sequence

from harness.mission import Mission
from harness.mission.claim import Row, Validation

from .case import cases
from .library import Library
from .simulations import evaluate


def _names() -> list[str]:
    return [case.id for case in cases()]


def _answer(names: Sequence[str]) -> list[Row]:
    with Library() as library:
        return [row for case in cases(list(names)) for row in evaluate(case, library)]


MISSION = Mission(validations=(Validation(_names, _answer),))
