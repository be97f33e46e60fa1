# SPDX-License-Identifier: BSD-2-Clause
"""The published cases, as `harness validate` asks for them."""

from __future__ import annotations

from collections.abc import Sequence

from harness.mission import Mission
from harness.mission.claim import Row, Validation

from .case import cases
from .judge import judge
from .library import Library


def _names() -> list[str]:
    return [case.id for case in cases()]


def _answer(names: Sequence[str]) -> list[Row]:
    with Library() as library:
        return [row for case in cases(list(names)) for row in judge(case, library)]


MISSION = Mission(validations=(Validation(_names, _answer),))
