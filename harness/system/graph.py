# SPDX-License-Identifier: BSD-2-Clause
"""From a System and the descriptions of its FMUs to the bus: one slot per output scalar, and who
reads which slot.

The bus carries numbers (Real, Integer, Boolean, Enumeration); String outputs have no slot. All
problems are reported at once.
"""

from __future__ import annotations

import logging
import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NamedTuple

from harness.errors import FmuError, StructureError
from harness.files.archive import MAX_UNPACKED
from harness.spelling import did_you_mean
from harness.system.conversion import final, is_unconverted, way
from harness.system.interface import Interface, Variable, read_interface, units_agree
from harness.system.model import Component, Connection, Parameter, Port, System
from harness.system.schedule import macro_steps
from harness.system.schedule import problems as schedule_problems
from harness.system.units import IDENTITY, Affine, UndefinedUnitError, Unit, compose
from harness.system.values import Scalar

_log = logging.getLogger("harness")


class Slot(NamedTuple):
    """One place of the bus: the output it holds (`component.variable[i]`), its unit ("" if
    undeclared) and meaning.
    """

    name: str
    unit: str
    description: str


class Wire(NamedTuple):
    """A variable of a unit and the slot it is written to (outputs) or read from (inputs), changed
    on the way.
    """

    variable: Variable
    slot: int
    change: Affine = IDENTITY


class Setting(NamedTuple):
    """A variable of a unit and the value it gets before initialization."""

    variable: Variable
    value: Scalar


@dataclass(frozen=True)
class Node:
    """One component with its FMU: what it reads from the bus, what it writes to it, what is set
    before.
    """

    component: Component
    interface: Interface
    inputs: tuple[Wire, ...]
    outputs: tuple[Wire, ...]
    settings: tuple[Setting, ...]


@dataclass(frozen=True)
class Graph:
    """The system ready to be loaded: nodes in execution order, slots of the bus (contiguous per
    node).
    """

    nodes: tuple[Node, ...]
    slots: tuple[Slot, ...]


def build_graph(system: System) -> Graph:
    """Check a system against its FMUs and lay out the bus.

    Raises FmuError if an FMU cannot be read, else StructureError with every problem: components or
    variables that do not exist (with close matches), wrong causality, unequal units or types,
    doubly driven or open inputs, unknown or ill-typed parameters, schedule.
    """
    interfaces = read_interfaces(system)
    if found := [*problems(system, interfaces), *size_problems(system, interfaces)]:
        raise StructureError(found)
    ports = [Port(name, v) for name, interface in interfaces.items() for v in interface.outputs()]
    slot_of = {port: slot for slot, port in enumerate(ports)}
    slots = tuple(
        _slot(port, interfaces[port.component].variables[port.variable]) for port in ports
    )
    driven = {c.target: (slot_of[c.source], way(c, interfaces)) for c in system.connections}
    return Graph(
        tuple(_node(c, interfaces[c.name], slot_of, driven) for c in system.components), slots
    )


class Checked(NamedTuple):
    """A system ready to run: its graph, and the number of macro steps."""

    graph: Graph
    steps: int


def checked(system: System) -> Checked:
    """The graph and the number of macro steps of a system; raises what build_graph() and
    macro_steps() raise.
    """
    graph = build_graph(system)
    steps = macro_steps(system.experiment, [c.every for c in system.components])
    for note in _uneven_samples(graph, system.experiment.step or 0.0):
        _log.warning("%s", note)
    return Checked(graph, steps)


SAMPLE_PERIOD = "sample_period"


def _uneven_samples(graph: Graph, macro_step: float) -> Iterator[str]:
    """Components whose samples do not all fall onto the ends of their steps."""
    for slot, period in constants(graph):
        component, _, name = slot.name.partition(".")
        if name != SAMPLE_PERIOD or not period > 0:
            continue
        every = next(n.component.every for n in graph.nodes if n.component.name == component)
        step = every * macro_step
        ratio = period / step
        if ratio < 1 - 1e-9 or abs(ratio - round(ratio)) > 1e-9 * ratio:
            yield _uneven(slot.name, component, period, step, macro_step)


def _uneven(name: str, component: str, period: float, step: float, macro_step: float) -> str:
    """What comes of samples between communication points, and what to do about it."""
    common = math.gcd(round(1e9 * period), round(1e9 * step)) / 1e9
    finer = f"--step {common * macro_step / step:.12g} or " if common > step / 100 else ""
    nearest = step * max(1, round(period / step))
    return (
        f"{name} = {period:g} s is no multiple of the step of {component}, {step:g} s: a sample "
        f"between two steps reads inputs that are up to {step:g} s old and acts at the end of its "
        f"step; {finer}--set {name}={nearest:.12g} avoids that"
    )


def rechecked(system: System, known: System, graph: Graph) -> Checked:
    """What checked() gives; from the graph of `known` is taken whatever has not changed since."""
    if not _same_structure(system, known, graph):
        return checked(system)
    pairs = zip(graph.nodes, system.components, strict=True)
    changed = [c for node, c in pairs if c.parameters != node.component.parameters]
    interfaces = {node.component.name: node.interface for node in graph.nodes}
    if any(_value_problems(system, interfaces, changed)):
        return checked(system)  # it raises, with every problem
    nodes = tuple(_adapted(*pair) for pair in zip(graph.nodes, system.components, strict=True))
    steps = macro_steps(system.experiment, [c.every for c in system.components])
    return Checked(replace(graph, nodes=nodes), steps)


def _same_structure(system: System, known: System, graph: Graph) -> bool:
    """Whether two systems differ in values only: parameters, schedule, experiment."""
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


def _value_problems(
    system: System, interfaces: Mapping[str, Interface], changed: Sequence[Component]
) -> Iterator[str]:
    """Problems that new values alone can cause."""
    yield from schedule_problems(system.experiment.algorithm, system.components)
    if system.strict and changed:
        yield from _open_inputs(system, interfaces)
    for component in changed:
        yield from _parameter_problems(component, interfaces[component.name])


def _adapted(node: Node, component: Component) -> Node:
    """The node with another component of the same FMU; settings are made anew if they differ."""
    if component.parameters == node.component.parameters:
        return replace(node, component=component)
    settings = tuple(_settings(component, node.interface))
    return replace(node, component=component, settings=settings)


def read_interfaces(system: System) -> dict[str, Interface]:
    """Interface of every component by name; FmuError with one line per FMU that cannot be read."""
    interfaces, unreadable = readable_interfaces(system)
    if unreadable:
        raise FmuError("\n".join(unreadable))
    return interfaces


def readable_interfaces(system: System) -> tuple[dict[str, Interface], list[str]]:
    """Interfaces of the components whose FMUs can be read, and what is wrong with the others."""
    interfaces, unreadable = {}, []
    for component in system.components:
        try:
            interfaces[component.name] = read_interface(component.fmu)
        except FmuError as error:
            unreadable += [f"{component.name}: {line}" for line in str(error).splitlines()]
    return interfaces, unreadable


def say_warnings(*systems: System) -> None:
    """What is not by the book in the FMUs of systems, in the log: a line per FMU that can be
    read.
    """
    for fmu in dict.fromkeys(c.fmu for system in systems for c in system.components):
        with suppress(FmuError):
            say_warnings_of(read_interface(fmu))


def say_warnings_of(interface: Interface) -> None:
    """What is not by the book in one FMU, in the log: one line."""
    first, count = interface.warnings[:1], len(interface.warnings)
    more = f", and {count - 1} more (harness check lists them)" if count > 1 else ""
    for warning in first:
        _log.warning("%s: %s%s", interface.path.name, warning, more)


def size_problems(system: System, interfaces: Mapping[str, Interface]) -> Iterator[str]:
    """The limits of archive.py for the run as a whole: every component is unpacked on its own."""
    size = sum(interfaces[c.name].size for c in system.components if c.name in interfaces)
    if size > MAX_UNPACKED:
        yield (
            f"the FMUs of all components would unpack to {size} bytes, more than the limit of "
            f"{MAX_UNPACKED}"
        )


def _slot(port: Port, variable: Variable) -> Slot:
    return Slot(str(port), variable.unit or "", variable.description)


def _node(
    component: Component,
    interface: Interface,
    slot_of: dict[Port, int],
    driven: dict[Port, tuple[int, Affine]],
) -> Node:
    name = component.name
    inputs = interface.named("input").values()
    return Node(
        component,
        interface,
        inputs=tuple(
            Wire(v, *driven[Port(name, v.name)]) for v in inputs if Port(name, v.name) in driven
        ),
        outputs=tuple(Wire(v, slot_of[Port(name, v.name)]) for v in interface.outputs().values()),
        settings=tuple(_settings(component, interface)),
    )


def _settings(component: Component, interface: Interface) -> Iterator[Setting]:
    for name, parameter in component.parameters.items():
        if name in interface.variables:
            yield Setting(
                interface.variables[name], final(parameter, interface.variables[name], interface)
            )


def constants(graph: Graph) -> Iterator[tuple[Slot, float]]:
    """Every parameter of every component with the value it has in the run; strings are left out."""
    for node in graph.nodes:
        given = {setting.variable.name: setting.value for setting in node.settings}
        for variable in node.interface.named("parameter").values():
            value = given.get(variable.name, variable.start)
            if variable.type != "String" and value is not None:
                yield _slot(Port(node.component.name, variable.name), variable), float(value)


def problems(system: System, interfaces: Mapping[str, Interface]) -> Iterator[str]:
    """Everything that is wrong with a system, one line each, as far as its FMUs can be read."""
    unread = {c.name for c in system.components} - interfaces.keys()
    yield from _component_problems(system.components)
    yield from schedule_problems(system.experiment.algorithm, system.components)
    for connection in system.connections:
        yield from _connection_problems(connection, interfaces, unread, system.strict)
    yield from _double_drive(system.connections)
    yield from _declared_problems(system, interfaces)
    if system.strict:
        yield from _open_inputs(system, interfaces)
    for component in system.components:
        if component.name in interfaces:
            yield from _parameter_problems(component, interfaces[component.name])
    yield from _shared_streams(system, interfaces)


def _shared_streams(system: System, interfaces: Mapping[str, Interface]) -> Iterator[str]:
    """Components that draw the same random numbers: seed and stream are equal."""
    owners: dict[tuple[Scalar, ...], list[str]] = {}
    for component in system.components:
        known = interfaces[component.name].variables if component.name in interfaces else {}
        if "seed" in known and "stream" in known:
            drawn = tuple(_value(component, known[name]) for name in ("seed", "stream"))
            owners.setdefault(drawn, []).append(component.name)
    for (seed, stream), names in owners.items():
        if len(names) > 1:
            yield (
                f"{' and '.join(names)}: draw the same random numbers (seed {seed:g}, stream "
                f"{stream:g}): give each a stream of its own"
            )


def _value(component: Component, variable: Variable) -> Scalar:
    """The number that a parameter is given, or else its start value."""
    given = component.parameters.get(variable.name)
    value = given.value if given else variable.start
    return float(value) if isinstance(value, int | float) else 0.0


def _component_problems(components: Sequence[Component]) -> Iterator[str]:
    names = Counter(c.name for c in components)
    if not names:
        yield "the system has no components"
    yield from (
        f"{name}: there are two components of this name" for name, n in names.items() if n > 1
    )


def _connection_problems(
    connection: Connection,
    interfaces: Mapping[str, Interface],
    unread: Collection[str],
    strict: bool,
) -> Iterator[str]:
    ends: list[Variable | None] = []
    for port, causality in ((connection.source, "output"), (connection.target, "input")):
        variable, problem = (
            (None, None) if port.component in unread else _end(port, causality, interfaces)
        )
        ends.append(variable)
        if problem:
            yield problem
    if ends[0] and ends[1]:
        yield from _mismatch(connection, ends[0], ends[1])
        yield from _unit_problem(connection, interfaces, strict)


def _end(
    port: Port, causality: str, interfaces: Mapping[str, Interface]
) -> tuple[Variable | None, str | None]:
    """The variable at one end of a connection, or what is wrong with it."""
    if port.component not in interfaces:
        return (
            None,
            f"{port}: there is no component "
            f"'{port.component}'{did_you_mean(port.component, interfaces)}",
        )
    interface = interfaces[port.component]
    variable = interface.variables.get(port.variable)
    if variable is None:
        return (
            None,
            f"{port}: there is no such "
            f"{causality}{did_you_mean(port.variable, interface.named(causality))}",
        )
    if variable.causality != causality:
        return (
            None,
            f"{port}: is connected as {causality}, but its causality is {variable.causality}",
        )
    return variable, None


def _mismatch(connection: Connection, source: Variable, target: Variable) -> Iterator[str]:
    if source.type != target.type or source.type == "String":
        yield (
            f"{connection.target}: is {target.type}, cannot be driven by {connection.source}, a "
            f"{source.type}"
        )


def _unit_problem(
    connection: Connection, interfaces: Mapping[str, Interface], strict: bool
) -> Iterator[str]:
    try:
        change = way(connection, interfaces, strict=True)
    except UndefinedUnitError as error:
        if not strict:
            _log.warning("%s: taken as it is, %s", connection.target, error)
            return
        yield f"{connection.target}: {error}"
        return
    except ValueError as error:
        ends = [interfaces[port.component].variables[port.variable] for port in connection[:2]]
        yield (
            f"{connection.target}: expected unit {ends[1].unit}, {connection.source} has "
            f"{ends[0].unit} ({error})"
        )
        return
    kind = interfaces[connection.target.component].variables[connection.target.variable].type
    if change != IDENTITY and kind != "Real":
        yield f"{connection.target}: is {kind}, only a Real signal can be transformed"


def unequal_units(system: System, interfaces: Mapping[str, Interface]) -> Iterator[str]:
    """Connections that need a conversion, which no other tool would do."""
    for connection in system.connections:
        ends = [interfaces[port.component].variables.get(port.variable) for port in connection[:2]]
        if ends[0] and ends[1] and not units_agree(ends[0].unit, ends[1].unit):
            yield (
                f"{connection.target}: expected unit {ends[1].unit}, {connection.source} has "
                f"{ends[0].unit}"
            )


def _declared_problems(system: System, interfaces: Mapping[str, Interface]) -> Iterator[str]:
    """Connectors that claim another unit than the FMU has."""
    for port, claimed in system.declared.items():
        interface = interfaces.get(port.component)
        variable = None if interface is None else interface.variables.get(port.variable)
        if interface and variable and not _same(port, claimed, interface.unit(variable)):
            yield (
                f"{port}: its connector says {claimed.name}, but the unit of the FMU is "
                f"{variable.unit}"
            )


def _same(port: Port, a: Unit, b: Unit | None) -> bool:
    """Whether two units mean the same, under whatever names; the log says if that is not known."""
    try:
        return compose(a, (), b) == IDENTITY
    except UndefinedUnitError as error:
        _log.warning("%s: its connector says %s, which is not compared (%s)", port, a.name, error)
        return True
    except ValueError:
        return False


def _double_drive(connections: Sequence[Connection]) -> Iterator[str]:
    sources: dict[Port, list[str]] = {}
    for source, target, _ in connections:
        sources.setdefault(target, []).append(str(source))
    for target, drivers in sources.items():
        if len(drivers) > 1:
            yield f"{target}: is driven {len(drivers)} times, by {' and '.join(drivers)}"


def _open_inputs(system: System, interfaces: Mapping[str, Interface]) -> Iterator[str]:
    driven = {connection.target for connection in system.connections}
    for component in (c for c in system.components if c.name in interfaces):
        for name in interfaces[component.name].named("input"):
            if Port(component.name, name) not in driven and name not in component.parameters:
                yield (
                    f"{component.name}.{name}: is an open input, nothing drives it and it has no "
                    "value"
                )


def _parameter_problems(component: Component, interface: Interface) -> Iterator[str]:
    for name, parameter in component.parameters.items():
        if name not in interface.variables and parameter.optional:
            _log.warning(
                "%s.%s: %s does not have it, ignored", component.name, name, interface.path.name
            )
        elif problem := _parameter_problem(name, parameter, interface):
            yield f"{component.name}.{name}: {problem}"
        elif is_unconverted(parameter, interface.variables[name], interface):
            _log.warning(
                "%s.%s: is given in %s, which nobody defines, taken as it is",
                component.name,
                name,
                parameter.unit,
            )


def _parameter_problem(name: str, parameter: Parameter, interface: Interface) -> str | None:
    variable = interface.variables.get(name)
    if variable is None:
        return f"there is no such parameter{did_you_mean(name, interface.settable())}"
    if not variable.settable:
        return f"its causality is {variable.causality}, it cannot be set"
    if parameter.value != parameter.value:
        return "must not be NaN"
    try:
        final(parameter, variable, interface)
    except ValueError as error:
        other = parameter.unit is not None and not units_agree(parameter.unit, variable.unit)
        return (
            f"is given in {parameter.unit}, but its unit is {variable.unit} ({error})"
            if other
            else str(error)
        )
    return None
