# SPDX-License-Identifier: BSD-2-Clause
"""Spaces of observations and actions: where their numbers are, their units, bounds and scales."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from harness.authoring.policy import Ports
from harness.errors import UsageError
from harness.learning import signals
from harness.learning.signals import Limits
from harness.master.simulation import Simulation
from harness.results.result import Array
from harness.system.values import base


class Spaces:
    """Numbers that an agent observes and sets in simulations of one system."""

    def __init__(
        self,
        simulation: Simulation,
        names: tuple[Sequence[str], Sequence[str]],
        limits: Limits,
        scale: Mapping[str, float] | None,
    ) -> None:
        """Look up the names of what is observed and set; scale: see harness.environment()."""
        seen, acted = (
            signals.observed(simulation, names[0]),
            signals.acted(simulation, names[1], limits),
        )
        self.observed = [f"{s.name} [{s.unit}]" for s in seen]
        self.acted = [f"{s.name} [{s.unit}]" for s in acted]
        self.sizes = np.array([dict(scale or {}).get(base(s.name), 1.0) for s in seen])
        self._slots = np.array([s.wire.slot for s in seen], dtype=np.intp)
        self._factors = np.array([s.wire.change.factor for s in seen]) / self.sizes
        self._offsets = np.array([s.wire.change.offset for s in seen]) / self.sizes
        low, high = np.array([(s.low, s.high) for s in seen]).reshape(-1, 2).T / self.sizes
        self.observation = Box(low, high, dtype=np.float64)
        self.low, self.high = np.array([(s.low, s.high) for s in acted]).T
        self.scaled = scale is not None
        one = np.ones(len(acted))
        ends = (-one, one) if self.scaled else (self.low, self.high)
        self.action = Box(*ends, dtype=np.float64)
        self.variables = list(dict.fromkeys(base(s.name) for s in acted))

    def seen(self, buses: Array) -> Array:
        """Return observations (..., n) from buses (..., slots)."""
        found: Array = buses[..., self._slots] * self._factors + self._offsets
        return found

    def commands(self, actions: Any) -> Array:
        """Return the commanded numbers (..., n) of actions."""
        given = np.asarray(actions, dtype=np.float64)
        if self.scaled:
            given = self.low + 0.5 * (given + 1.0) * (self.high - self.low)
        return given

    def ports(self, simulation: Simulation) -> list[tuple[Array, slice]]:
        """Return the arrays of a simulation to which the parts of a command are written."""
        found = [simulation.port(name).reshape(-1) for name in self.variables]
        last = np.cumsum([port.size for port in found]).tolist()
        return [(p, slice(n - p.size, n)) for p, n in zip(found, last, strict=True)]

    def of_policy(self, simulation: Simulation, values: Array, period: float) -> Ports:
        """Return the ports of a policy in the place of the open component; values: of the slots at
        the start. Raises UsageError with several open components, or for a name that is none in C.
        """
        opened, nodes = simulation.system.without, simulation.graph.nodes
        if len(opened) > 1:
            raise UsageError(f"a policy takes the place of one component, not of {len(opened)}")
        seen, acted = _ports(self.observed), _ports(self.acted)
        read = {wire.slot for node in nodes for wire in node.inputs}
        commanded = {name for name, _, _ in acted}
        starts: dict[str, tuple[str, str, list[float]]] = {}
        for wire in next(n for n in nodes if n.component.name == opened[0]).outputs:
            name = base(wire.variable.name)
            if wire.slot in read or name in commanded:
                value = float(values[wire.slot])
                starts.setdefault(name, (name, wire.variable.unit or "1", []))[2].append(value)
        bounds = self.low.tolist(), self.high.tolist()
        return Ports(seen, acted, self.sizes.tolist(), *bounds, self.scaled,
                     [*starts.values()], period)  # fmt: skip


def _ports(names: Sequence[str]) -> list[tuple[str, str, int]]:
    """Return variables with their units and numbers of elements, without their components."""
    found: dict[str, tuple[str, str, int]] = {}
    for text in names:
        name, _, unit = text.rpartition(" ")
        variable = base(name).partition(".")[2]
        if not variable.isidentifier() or found.get(variable, (name,))[0] not in (name, variable):
            raise UsageError(f"{name}: cannot be a port of a policy, which is written in C")
        count = found.get(variable, ("", "", 0))[2] + 1
        found[variable] = variable, unit.strip("[]"), count
    return list(found.values())
