# SPDX-License-Identifier: BSD-2-Clause
"""Numbers that an agent reads and sets in a simulation: their places, units, bounds and scales, and
the spaces that they form.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium.spaces import Box

from harness.authoring.policy import Ports
from harness.errors import UsageError
from harness.master.changes import apply
from harness.master.simulation import Simulation
from harness.results.result import Array
from harness.spelling import did_you_mean
from harness.system.graph import Wire, build_graph, constants
from harness.system.model import System
from harness.system.values import base, elements_of, with_arrays
from harness.system.wiring import split

FAR = 1e12
"""Bound of an observation for which the FMU declares none."""

Bound = float | tuple[float, float]
"""Bounds of an action: -x to x, or the least and the largest value."""

Limits = Sequence[Mapping[str, Bound]]
"""Bounds by name: of the user, of actuators, of the mission; the first that is there counts."""


class Signal(NamedTuple):
    """One number that an agent reads or sets: its name, unit, place, and bounds."""

    name: str
    unit: str
    wire: Wire
    low: float
    high: float


def _observed(simulation: Simulation, names: Sequence[str]) -> list[Signal]:
    """Return what is observed: these variables, or all connected inputs of the open
    components.
    """
    nodes = {n.component.name: n for n in simulation.graph.nodes}
    if not names:
        opened = [(c, w) for c in simulation.system.without for w in nodes[c].inputs]
        return [_signal(f"{c}.{w.variable.name}", w) for c, w in opened]
    found = []
    for name in names:
        try:
            component, variable = split(name, nodes)
        except ValueError as error:
            raise UsageError(f"observe {error}") from None
        wired = (*nodes[component].inputs, *nodes[component].outputs)
        wires = {wire.variable.name: wire for wire in wired}
        if not (elements := elements_of(variable, wires)):
            close = did_you_mean(variable, with_arrays(wires))
            raise UsageError(f"observe {name}: no output or connected input{close}")
        found += [_signal(f"{component}.{e}", wires[e]) for e in elements]
    return found


def _acted(simulation: Simulation, names: Sequence[str], limits: Limits) -> list[Signal]:
    """Return what the agent sets: these outputs of the open components, or outputs of which
    other components read an element.
    """
    without, nodes = simulation.system.without, simulation.graph.nodes
    read = {
        wire.slot: (node.component.name, wire.variable)
        for node in nodes
        if node.component.name not in without
        for wire in node.inputs
    }
    outputs = [
        (f"{node.component.name}.{wire.variable.name}", wire)
        for node in nodes
        if node.component.name in without
        for wire in node.outputs
    ]
    chosen = {*names} or {base(name) for name, wire in outputs if wire.slot in read}
    known = {base(name) for name, _ in outputs}
    if unknown := sorted(chosen - known):
        close = did_you_mean(unknown[0], known)
        raise UsageError(f"act {unknown[0]}: no output of an open component{close}")
    return [
        _bounded(name, wire, read.get(wire.slot, ("", wire.variable)), limits)
        for name, wire in outputs
        if base(name) in chosen
    ]


def actuator_limits(system: System) -> dict[str, Bound]:
    """Return limits of actuators, `component.name_max` or its elements, in the parameter set for
    comparisons; without the component for outputs that reach an actuator through others.
    """
    changed = apply(system, params=system.compared) if system.compared else system
    values = ((slot.name, x) for slot, x in constants(build_graph(changed)))
    found: dict[str, Bound] = {n: x for n, x in values if base(n).endswith("_max") and 0 < x < FAR}
    return {name.partition(".")[2]: x for name, x in found.items()} | found


def _signal(name: str, wire: Wire) -> Signal:
    v = wire.variable
    low, high = (d if x is None else x for x, d in ((v.low, -FAR), (v.high, FAR)))
    return Signal(name, v.unit or "1", wire, low, high)


def _bounded(name: str, wire: Wire, reader: tuple[str, Any], limits: Limits) -> Signal:
    """Return an action with its bounds: given by name, or declared by the FMUs, or the limit
    `X_max` of the component that reads `X_cmd`.
    """
    signal, (component, target) = _signal(name, wire), reader
    whole = base(target.name)
    stem, element = re.sub(r"_(cmd|safe).*", "", whole), target.name.removeprefix(whole)
    own, far = f"{component}.{stem}_max", f"{stem}_max"
    ways = (name, base(name), f"{own}{element}", own, f"{far}{element}", far)
    limit = next((table[way] for table in limits for way in ways if way in table), FAR)
    least, most = (-limit, limit) if isinstance(limit, int | float) else limit
    low = max(least, signal.low, -FAR if target.low is None else target.low)
    high = min(most, signal.high, FAR if target.high is None else target.high)
    if high >= FAR or low <= -FAR:
        raise UsageError(
            f"{name}: no limit is known; give one: bounds={{{base(name)!r}: 1.0}} [{signal.unit}]"
        )
    return signal._replace(low=low, high=high)


# ---- spaces


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
        seen, acted = _observed(simulation, names[0]), _acted(simulation, names[1], limits)
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
