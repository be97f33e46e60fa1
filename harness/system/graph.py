# SPDX-License-Identifier: BSD-2-Clause
"""Graph of a system: the bus, with one slot per scalar output, and the components that read and
write its slots.

The bus carries numbers (Real, Integer, Boolean, Enumeration). String and Binary outputs have no
slot. All problems are reported at once.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain
from typing import NamedTuple

from harness.errors import FmuError, StructureError
from harness.system.conversion import final, way
from harness.system.interface import Interface, read_interface
from harness.system.model import Component, Port, System
from harness.system.problems import problems, size_problems, value_problems
from harness.system.schedule import macro_steps
from harness.system.units import IDENTITY, Affine
from harness.system.values import STRUCTURAL, Scalar, Variable

_log = logging.getLogger("harness")


class Slot(NamedTuple):
    """Place of one number on the bus. name: name of the output, `component.variable[i]`; unit: ""
    if undeclared; modes: names of the values 0, 1, .., separated by `|`, if the output is a mode
    (its values have names), else "".
    """

    name: str
    unit: str
    description: str
    modes: str = ""


Texts = tuple[str, ...]


def columns(slots: Sequence[Slot]) -> tuple[Texts, Texts, Texts, Texts]:
    """Return four tuples: names, units, descriptions and modes of slots, for the columns of a
    Result.
    """
    names, units, descriptions, modes = zip(*slots, strict=True) if slots else ((), (), (), ())
    return names, units, descriptions, modes


class Wire(NamedTuple):
    """Input or output of a component with the slot of the bus from which the input is read or to
    which the output is written. change: conversion of the value of an input.
    """

    variable: Variable
    slot: int
    change: Affine = IDENTITY


class Setting(NamedTuple):
    """Variable of a component and the value that it gets before initialization."""

    variable: Variable
    value: Scalar


@dataclass(frozen=True)
class Node:
    """Component with its FMU: the slots that it reads, the slots that it writes, and the values
    that are set before the run; parameters: all parameters except strings, each with a Slot that
    contains its name and unit.
    """

    component: Component
    interface: Interface
    inputs: tuple[Wire, ...]
    outputs: tuple[Wire, ...]
    settings: tuple[Setting, ...]
    parameters: tuple[tuple[Variable, Slot], ...]

    @cached_property
    def constants(self) -> tuple[tuple[Slot, float], ...]:
        """Return a pair of Slot (name, unit) and value in the run for every parameter except
        strings.
        """
        given = {setting.variable.name: setting.value for setting in self.settings}
        values = [(slot, given.get(v.name, v.start)) for v, slot in self.parameters]
        return tuple([(slot, float(value)) for slot, value in values if value is not None])


@dataclass(frozen=True)
class Graph:
    """System ready to be loaded: nodes in execution order, and slots of the bus, in which the
    outputs of a node are adjacent.
    """

    nodes: tuple[Node, ...]
    slots: tuple[Slot, ...]


def build_graph(system: System) -> Graph:
    """Check a system against its FMUs and assign slots of the bus.

    Raises FmuError if an FMU cannot be read, else StructureError with every problem, e.g.
    components or variables that do not exist (with close matches), wrong causality, unequal types,
    units that cannot be converted, inputs with several connections, unknown or ill-typed
    parameters, schedule; of a `strict` system also unequal units and required inputs without
    connection and value.
    """
    interfaces = read_interfaces(system)
    if found := [*problems(system, interfaces), *size_problems(system, interfaces)]:
        raise StructureError(found)
    ports = [Port(name, v) for name, interface in interfaces.items() for v in interface.outputs()]
    slot_of = {port: slot for slot, port in enumerate(ports)}
    slots = tuple(_slot(p, interfaces[p.component].variables[p.variable]) for p in ports)
    driven = {c.target: (slot_of[c.source], way(c, interfaces)) for c in system.connections}
    nodes = (_node(c, interfaces[c.name], slot_of, driven) for c in system.components)
    return Graph(tuple(nodes), slots)


class Checked(NamedTuple):
    """System ready to run: its graph, and the number of macro steps."""

    graph: Graph
    steps: int


def checked(system: System) -> Checked:
    """Return the graph and the number of macro steps of a system; raise the errors of build_graph()
    and macro_steps().
    """
    graph = build_graph(system)
    steps = macro_steps(system.experiment, [c.every for c in system.components])
    for note in _uneven_samples(graph, system.experiment.step or 0.0):
        _log.warning("%s", note)
    return Checked(graph, steps)


SAMPLE_PERIOD = "sample_period"


def _uneven_samples(graph: Graph, macro_step: float) -> Iterator[str]:
    """Yield a warning per component whose sampling instants are not all at the ends of the steps of
    the component; the warning also states what to change.
    """
    every = {node.component.name: node.component.every for node in graph.nodes}
    for slot, period in constants(graph):
        component, _, name = slot.name.partition(".")
        step = every[component] * macro_step
        if name == SAMPLE_PERIOD and period > 0 and _is_uneven(period / step):
            yield (
                f"{slot.name} = {period:g} s is not a multiple of the step of {component}, "
                f"{step:g} s: a sample between two steps reads inputs that are up to {step:g} s "
                f"old and acts at the end of its step; another --step or "
                f"--set {slot.name}={step * max(1, round(period / step)):.12g} avoids that"
            )


def _is_uneven(steps: float) -> bool:
    return steps < 1 - 1e-9 or (steps < 1e9 and abs(steps - round(steps)) > 1e-9 * steps)


def rechecked(system: System, known: System, graph: Graph) -> Checked:
    """Return the result of checked() for a system; parts of `graph`, the graph of the system
    `known`, are reused where the systems agree.
    """
    graph = rebuilt(system, known, graph)
    return Checked(graph, macro_steps(system.experiment, [c.every for c in system.components]))


def rebuilt(system: System, known: System, graph: Graph) -> Graph:
    """Return the result of build_graph() for a system; parts of `graph`, the graph of the system
    `known`, are reused where the systems agree.
    """
    if not _same_structure(system, known, graph):
        return build_graph(system)
    pairs = list(zip(graph.nodes, system.components, strict=True))
    others = [(node, c) for node, c in pairs if c is not node.component]
    changed = [new for node, c in others if (new := _with_new_values(node, c)).parameters]
    interfaces = {node.component.name: node.interface for node in graph.nodes}
    lost = any(node.component.parameters.keys() - c.parameters.keys() for node, c in others)
    # an input becomes open only if its value is removed; strict=False avoids the search otherwise
    looked = system if lost else replace(system, strict=False)
    if any(value_problems(looked, interfaces, changed)):
        return build_graph(system)  # raises an error with all problems of the system
    return replace(graph, nodes=tuple(_adapted(*pair) for pair in pairs))


def _same_structure(system: System, known: System, graph: Graph) -> bool:
    """Return whether `system` and `known` differ only in values (parameters, schedule, experiment).
    graph: graph of `known`.
    """
    return (
        system.connections == known.connections
        and system.strict == known.strict
        and system.declared == known.declared
        and len(system.components) == len(graph.nodes)
        and all(
            component.name == node.component.name
            and component.fmu == node.component.fmu
            and read_interface(component.fmu) is node.interface
            for component, node in zip(system.components, graph.nodes, strict=True)
        )
    )


def _with_new_values(node: Node, component: Component) -> Component:
    """Return the component with only the parameters that differ from the parameters of the node."""
    known = node.component.parameters
    new = {name: p for name, p in component.parameters.items() if known.get(name) is not p}
    return replace(component, parameters=new)


def _adapted(node: Node, component: Component) -> Node:
    """Return the node for `component`, which has the FMU of `node`. Settings are computed again
    only for parameters that differ from the parameters of `node`; others are taken from `node`.
    """
    if component is node.component:
        return node
    new = {s.variable.name: s for s in _settings(_with_new_values(node, component), node.interface)}
    if not new and component.parameters.keys() == node.component.parameters.keys():
        return replace(node, component=component)
    known = {setting.variable.name: setting for setting in node.settings} | new
    settings = tuple(known[name] for name in component.parameters if name in known)
    return replace(node, component=component, settings=settings)


def read_interfaces(system: System) -> dict[str, Interface]:
    """Return the interface of every component by name; raise FmuError with a line per problem of
    the FMUs that cannot be read.
    """
    interfaces, unreadable = readable_interfaces(system)
    if unreadable:
        raise FmuError("\n".join(unreadable))
    return interfaces


def readable_interfaces(system: System) -> tuple[dict[str, Interface], list[str]]:
    """Return the interfaces of components whose FMU can be read, by name of the component, and a
    line per problem of the FMUs that cannot be read.
    """
    interfaces, unreadable = {}, []
    for component in system.components:
        try:
            interfaces[component.name] = read_interface(component.fmu)
        except FmuError as error:
            unreadable += [f"{component.name}: {line}" for line in str(error).splitlines()]
    return interfaces, unreadable


def log_warnings(*systems: System) -> None:
    """Log a line for each FMU of the systems that deviates from the FMI standard, if it can be
    read.
    """
    for fmu in dict.fromkeys(c.fmu for system in systems for c in system.components):
        with suppress(FmuError):
            log_warnings_of(read_interface(fmu))


def log_warnings_of(interface: Interface) -> None:
    """Log in one line the first deviation of an FMU from the FMI standard and the number of further
    deviations.
    """
    first, count = interface.warnings[:1], len(interface.warnings)
    more = f", and {count - 1} more (harness check lists them)" if count > 1 else ""
    for warning in first:
        _log.warning("%s: %s%s", interface.path.name, warning, more)


def _slot(port: Port, variable: Variable) -> Slot:
    return Slot(str(port), variable.unit or "", variable.description, variable.modes)


Drives = Mapping[Port, tuple[int, Affine]]
"""For every connected input: slot of the output that drives it, and conversion of the value."""


def _node(
    component: Component, interface: Interface, slot_of: Mapping[Port, int], driven: Drives
) -> Node:
    def port(variable: Variable) -> Port:
        return Port(component.name, variable.name)

    inputs = interface.named("input").values()
    parameters = (v for v in interface.named("parameter").values() if v.type != "String")
    return Node(
        component,
        interface,
        inputs=tuple(Wire(v, *driven[port(v)]) for v in inputs if port(v) in driven),
        outputs=tuple(Wire(v, slot_of[port(v)]) for v in interface.outputs().values()),
        settings=tuple(_settings(component, interface)),
        parameters=tuple((v, _slot(port(v), v)) for v in parameters),
    )


def _settings(component: Component, interface: Interface) -> Iterator[Setting]:
    for name, parameter in component.parameters.items():
        variable = interface.variables.get(name)
        # a structural parameter is the size of an array, which cannot be set
        if variable is not None and variable.causality != STRUCTURAL:
            yield Setting(variable, final(parameter, variable, interface))


def constants(graph: Graph) -> Iterator[tuple[Slot, float]]:
    """Yield a pair of Slot (name, unit) and value in the run for every parameter of every component
    except strings.
    """
    return chain.from_iterable(node.constants for node in graph.nodes)
