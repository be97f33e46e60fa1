# SPDX-License-Identifier: BSD-2-Clause
"""Plan of the guidance of a transposition: its commands over the time span of the system, from a
run of the guidance alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack

import numpy as np

from harness.errors import UsageError
from harness.master.changes import Changes, apply
from harness.master.isolated import simulate
from harness.results.result import Result
from harness.ssp.library import load
from harness.system.graph import read_interfaces
from harness.system.model import Parameter, System

PLANNED = ("iterations", "status", "peak", "rotation", "momentum_max", "rotation_largest")
"""Outputs that every guidance with a plan has; the names lack the prefix `guidance.`."""

STATUS = "guidance.status"
ADVICE = {2: "; more iterations (iterations_max), a longer window, or a larger momentum_share"}
"""Advice on parameters to change, by the status of a plan; it ends the text of the outcome."""


@dataclass(frozen=True)
class Plan:
    """Outputs of the guidance over the time span of the system: with the plan (`after`), and
    without a plan (`before`), where the guidance commands rest in the flight attitude, pointing to
    the Earth.
    """

    after: Result
    before: Result

    @property
    def status(self) -> int:
        """Return the status that the guidance publishes: 0 for a plan, else the number of the
        reason why there is none.
        """
        return int(self.after[STATUS][0])

    @property
    def histories(self) -> Mapping[str, Result]:
        """Return the histories without and with a plan."""
        return {"flight attitude": self.before, "planned": self.after}

    @property
    def good(self) -> bool:
        """Return whether the planned momentum stays below its limit, or no plan was requested."""
        return self.status <= 1

    def text(self) -> str:
        """Return a table of the iterations of the planner, and the verdict."""
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        first = {name: self.after[f"guidance.{name}"][0] for name in PLANNED}
        saturation = float(self.after.parameter("guidance.H_sat"))
        limit = saturation * float(self.after.parameter("guidance.momentum_share"))
        yield "iter   largest momentum [N m s]    / saturation   largest rotation [deg]"
        for k in range(int(first["iterations"]) + 1):
            peak, rotation = first["peak"][k], np.degrees(first["rotation"][k])
            yield f"{k:4}   {peak:24.1f}   {peak / saturation:13.3f}   {rotation:22.2f}"
        outcome = self.after.mode(STATUS, self.status) + ADVICE.get(self.status, "")
        yield f"saturation of the gyros {saturation:g} N m s, limit {limit:g} N m s: {outcome}"


def plan(system: str | Path | System, **changes: Unpack[Changes]) -> Plan:
    """Return the commands of the guidance of a system with its plan and without a plan, from two
    runs of the guidance alone; changes: changes of the system, such as `set` and `params`.

    Raises UsageError if the system has no guidance that plans, or the errors of a simulation.
    """
    with load(system) as found:
        alone = _guidance_alone(apply(found, **changes))
        return Plan(simulate(alone), simulate(_unplanned(alone)))


def _guidance_alone(system: System) -> System:
    """Return the system reduced to its guidance, without connections; raise UsageError if the
    system has no guidance that plans.
    """
    interface = read_interfaces(system).get("guidance")
    if interface is None or any(
        name not in {n.partition("[")[0] for n in interface.outputs()} for name in PLANNED
    ):
        raise UsageError(
            f"{system.name}: the system has no guidance that plans; use the system transposition"
        )
    guidance = tuple(c for c in system.components if c.name == "guidance")
    return replace(
        system, components=guidance, connections=(), sets=(), alternatives=(), declared={}
    )


def _unplanned(system: System) -> System:
    (guidance,) = system.components
    parameters = {**guidance.parameters, "use_plan": Parameter(0.0)}
    return replace(system, components=(replace(guidance, parameters=parameters),))
