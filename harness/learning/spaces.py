# SPDX-License-Identifier: BSD-2-Clause
"""Variables that an agent observes and sets in a simulation, with units, bounds and scales, and the
observation and action spaces that they form.
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
"""Absolute bound of a variable for which the FMU declares none."""

Bound = float | tuple[float, float]
"""Bounds of an action: x for -x to x, or the smallest and the largest value."""

Limits = Sequence[Mapping[str, Bound]]
"""Three tables of bounds by name: bounds from the user, limits of the actuators, and bounds from
the mission. The first table that contains a name applies.
"""


class Signal(NamedTuple):
    """Scalar that an agent observes or sets: its name, its unit, the input or output in the graph
    of the system (`wire`), and its bounds.
    """

    name: str
    unit: str
    wire: Wire
    low: float
    high: float


def _observed(simulation: Simulation, names: Sequence[str]) -> list[Signal]:
    """Return the scalars that the agent observes: elements of the named variables, or, if there are
    no names, of all connected inputs of the open components. Raises UsageError for an unknown name.
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
    """Return the scalars that the agent sets: elements of the named outputs of open components, or,
    without names, of all that other components read. Raises UsageError (unknown name, no bounds).
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
    """Return the limits of the actuators of a system: the values of all parameters
    `component.name_max`, or of their elements, that are above 0 and below FAR, by name. The values
    are from the parameter set that the system defines for comparisons, if there is one.

    The same limits are also returned under `name_max`, without the component, for outputs that
    reach an actuator through other components.
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
    """Return an output that the agent sets, with its bounds; raise UsageError if it has none.

    The bounds are the intersection of the limits that the FMUs declare for the output and for the
    input that reads it, and of the first entry in `limits` for this output. The name of such an
    entry is the name of the output with its component, or it is derived from the name of the input:
    `_cmd` or `_safe` and all that follows are removed if present, and `_max` is appended; the
    component may be omitted. So `propulsion.F_max` or `F_max` limits an output that drives
    `propulsion.F_cmd_S`. An entry for a vector applies to each of its elements.

    reader: component that reads the output ("": none), and its input.
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
            f"{name}: has no bounds; give some: bounds={{{base(name)!r}: 1.0}} [{signal.unit}]"
        )
    return signal._replace(low=low, high=high)


# ---- spaces


class Spaces:
    """Variables that an agent observes and sets in simulations of one system.

    observed, acted: names, with units, of the observed variables and of the outputs that are set;
    observation, action: spaces of Gymnasium; sizes: number by which each observation is divided;
    low, high: bounds of the outputs; scaled: whether actions lie between -1 and 1.
    """

    def __init__(
        self,
        simulation: Simulation,
        names: tuple[Sequence[str], Sequence[str]],
        limits: Limits,
        scale: Mapping[str, float] | None,
    ) -> None:
        """Find the variables in the simulation. Raises UsageError.

        names: variables to observe, and outputs to set. Without names of variables, all connected
        inputs of the open components are observed; without names of outputs, all outputs of these
        components that other components read are set. scale: number by which an observation is
        divided, by variable (None: do not scale actions either).
        """
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
        """Return the observations (..., n) of n variables for the values (..., m) of all m signals
        of simulations.
        """
        return np.asarray(buses[..., self._slots] * self._factors + self._offsets)

    def commands(self, actions: Any) -> Array:
        """Return the values (..., n) of the n outputs that the agent sets, in the units of the
        outputs, for actions (..., n).
        """
        given = np.asarray(actions, dtype=np.float64)
        if self.scaled:
            given = self.low + 0.5 * (given + 1.0) * (self.high - self.low)
        return given

    def ports(self, simulation: Simulation) -> list[tuple[Array, slice]]:
        """Return, for each output variable, the array of the simulation to which its value must be
        written, and the slice of a command (n,) with its value.
        """
        found = [simulation.port(name).reshape(-1) for name in self.variables]
        last = np.cumsum([port.size for port in found]).tolist()
        return [(p, slice(n - p.size, n)) for p, n in zip(found, last, strict=True)]

    def of_policy(self, simulation: Simulation, values: Array, period: float) -> Ports:
        """Return the inputs and outputs of a policy that replaces the open component.

        values: values of all m signals at the start (m,); period: time between two actions [s].
        Raises UsageError if there are several open components, or if a name is not a valid name in
        C.
        """
        opened, nodes = simulation.system.without, simulation.graph.nodes
        if len(opened) > 1:
            raise UsageError(f"open: a policy replaces one component, not {len(opened)}")
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
    """Return (name, unit, number of elements) of every variable, without the name of the component.

    names: names of all elements, with units. Raises UsageError for a name that is not an
    identifier, or that variables of two components have.
    """
    found: dict[str, tuple[str, str, int]] = {}
    for text in names:
        name, _, unit = text.rpartition(" ")
        whole = base(name)
        variable = whole.partition(".")[2]
        others = [found[key][0] for key in found if key != whole]
        if not variable.isidentifier() or variable in others:
            raise UsageError(f"{name}: must be a unique, valid name in C, the language of a policy")
        count = found.get(whole, ("", "", 0))[2] + 1
        found[whole] = variable, unit.strip("[]"), count
    return list(found.values())
