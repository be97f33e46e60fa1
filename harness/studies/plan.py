# SPDX-License-Identifier: BSD-2-Clause
"""What a mission plans before anything is run."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Unpack

from harness.errors import UsageError
from harness.master.changes import Changes
from harness.mission import Plan
from harness.mission.library import everything, mission
from harness.ssp.library import load
from harness.system.model import System

Planner = Callable[..., Plan]


def plan(system: str | Path | System, **changes: Unpack[Changes]) -> Plan:
    """The plan of a system by its mission; changes: those of run().

    Raises UsageError if its mission plans nothing, else what run() raises.
    """
    with load(system) as found:
        own = mission(found.mission) if found.mission else everything()
        planners = own.plans if own else ()
        if not planners:
            raise UsageError(f"{found.name}: its mission plans nothing")
        return _first(planners, found, **changes)


def _first(planners: tuple[Planner, ...], system: System, **changes: Unpack[Changes]) -> Plan:
    """The plan of the first planner that the system is for: of a system without a mission every
    one is asked.
    """
    *others, last = planners
    for planner in others:
        with suppress(UsageError):
            return planner(system, **changes)
    return last(system, **changes)
