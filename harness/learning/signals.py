# SPDX-License-Identifier: BSD-2-Clause
"""Numbers that an agent reads and sets in a simulation, with their units and bounds."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from harness.errors import UsageError
from harness.master.changes import apply
from harness.master.simulation import Simulation
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


def observed(simulation: Simulation, names: Sequence[str]) -> list[Signal]:
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


def acted(simulation: Simulation, names: Sequence[str], limits: Limits) -> list[Signal]:
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
