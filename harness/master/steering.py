# SPDX-License-Identifier: BSD-2-Clause
"""Steering of a simulation from outside: open components, whose outputs the user sets between macro
steps, and unconnected inputs.

An open component is loaded and initialised, which gives the start values of its outputs, but is not
stepped. The values that the user has set are published at the instants at which the component would
have published its own outputs. The run pauses where the component would have read its inputs. If
the user sets the outputs that the component would have had, the results are bit-identical to a run
without open components.
"""

from __future__ import annotations

import itertools
from collections.abc import Collection, Sequence
from copy import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.master.executors import library
from harness.master.fmu import Instance
from harness.system.graph import Graph
from harness.system.model import Port
from harness.system.schedule import Action, Verb, schedule
from harness.system.values import grid, index
from harness.system.wiring import ports


def steered(
    algorithm: str, instances: Sequence[Instance], names: Collection[str]
) -> tuple[list[Action[Instance]], int]:
    """Return the actions of a macro step in which the caller sets the outputs of the named (open)
    components, and the index of the action before which the run pauses, because the first open
    component would read its inputs there (0 also if no component is open).
    """
    plan = schedule(algorithm, [_held(i) if i.name in names else i for i in instances])
    opened = [action.instance.name in names for action in plan]
    reads = [k for k, a in enumerate(plan) if opened[k] and a.verb is Verb.SET]
    remain = [not opened[k] or a.verb is Verb.GET for k, a in enumerate(plan)]
    rest = [action for action, remains in zip(plan, remain, strict=True) if remains]
    return rest, sum(remain[: min(reads, default=0)])


def _held(instance: Instance) -> Instance:
    """Return a copy of an instance for an open component. The copy uses the buffers of the
    instance, does not step, and publishes the values in the buffers as its outputs.
    """
    other, function = copy(instance), f"held_{instance.node.interface.fmi}"
    outputs = [copy(transfer) for transfer in instance.transfers[Verb.GET]]
    for transfer in outputs:
        transfer.function = getattr(library(), function)
    other.transfers = {Verb.SET: [], Verb.STEP: [], Verb.GET: outputs}
    other.ours = False  # so that the executors check the values that the user sets
    return other


class Ports:
    """Access to outputs and inputs of a running system by `component.variable`: a scalar, an
    element, or a whole vector or matrix.
    """

    def __init__(
        self,
        graph: Graph,
        instances: Sequence[Instance],
        bus: NDArray[np.float64],
        names: Collection[str],
    ) -> None:
        self._bus, self._open = bus, names
        self._instances = {instance.name: instance for instance in instances}
        self._nodes = {node.component.name: node for node in graph.nodes}
        self._interfaces = {name: node.interface for name, node in self._nodes.items()}
        self._slots = {slot.name: i for i, slot in enumerate(graph.slots)}

    def view(self, name: str) -> NDArray[Any]:
        """Return an output as an array that shows its present value, for an open component the
        value that the component publishes next; raise UsageError if there is no such output.
        """
        component, elements = self._elements(name, "output")
        if component not in self._open:
            slots = [self._slots[str(Port(component, e))] for e in elements]
            return _part(self._bus, slots, name, elements)
        for transfer in self._instances[component].transfers[Verb.GET]:
            if elements[0] in transfer.names:
                places = [int(transfer.at[transfer.names.index(e)]) for e in elements]
                return _part(transfer.view, places, name, elements)
        raise UsageError(f"{name}: is not a number; only numbers can be read and set")

    def get(self, name: str) -> NDArray[np.float64]:
        """Return the present value of an output or of a connected input; raise UsageError if there
        is no such variable.
        """
        try:
            return np.array(self.view(name), dtype=np.float64)
        except UsageError:
            component, elements = self._elements(name, "input", "output")
        wires = {w.variable.name: w for w in self._nodes[component].inputs}
        if missing := [e for e in elements if e not in wires]:
            raise UsageError(f"{name}: {missing[0]} is not connected; it can only be set")
        values = [wires[e].change(float(self._bus[wires[e].slot])) for e in elements]
        return np.array(values).reshape(_shape(elements))

    def set(self, name: str, value: Any, time: float) -> None:
        """Set an output of an open component or an unconnected input; raise UsageError for another
        name or shape, RunError if the FMU rejects the value.
        """
        component, elements = self._elements(name, "input", "output")
        given = np.asarray(value, dtype=np.float64)
        if given.shape not in ((), shape := _shape(elements)):
            raise UsageError(f"{name}: expected shape {shape}, got {given.shape}")
        if component in self._open and elements[0] in self._interfaces[component].outputs():
            self.view(name)[...] = given
            return
        wired = {w.variable.name for w in self._nodes[component].inputs}
        variables = self._interfaces[component].named("input")
        if not set(elements) <= variables.keys() - wired:
            connected = elements[0] in variables
            hint = "the output that drives it" if connected else f"open=[{component!r}]"
            text = "is neither an output of an open component nor an unconnected input"
            raise UsageError(f"{name}: {text}; set {hint}")
        chosen = [variables[e] for e in elements]
        self._instances[component].put(chosen, np.broadcast_to(given, shape).ravel(), time)

    def _elements(self, name: str, *causalities: str) -> tuple[str, list[str]]:
        """Return the component and the names of all scalar variables (elements) of a name
        `component.variable`; raise UsageError if there is no variable of these causalities.
        """
        try:
            found = ports(self._interfaces, name, *causalities)
        except ValueError as error:
            raise UsageError(str(error)) from None
        return found[0].component, [port.variable for port in found]


def _shape(elements: Sequence[str]) -> tuple[int, ...]:
    whole = grid(map(index, elements))
    return (len(elements),) if whole is None else whole.shape


def _part(
    values: NDArray[Any], places: Sequence[int], name: str, elements: Sequence[str]
) -> NDArray[Any]:
    """Return the elements of `values` at `places` as a view in the shape of the variable `name`;
    raise UsageError if these elements are not adjacent. elements: names of the scalar variables.
    """
    if any(b - a != 1 for a, b in itertools.pairwise(places)):
        raise UsageError(f"{name}: its elements are not adjacent in the FMU; name one element")
    return values[places[0] : places[-1] + 1].reshape(_shape(elements))
