# SPDX-License-Identifier: BSD-2-Clause
"""Wiring by name: a signal is called the same wherever it goes, so an input is driven by the one
output of its name.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from harness.spelling import did_you_mean
from harness.system.interface import Interface
from harness.system.model import Connection, Port
from harness.system.names import base, elements_of


@dataclass
class Wiring:
    """Connections found, and what stood in the way of the others (one line each)."""

    connections: list[Connection] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)

    @property
    def driven(self) -> set[Port]:
        """Inputs that have a connection."""
        return {connection.target for connection in self.connections}


def wire(
    interfaces: Mapping[str, Interface],
    explicit: Sequence[tuple[str, str]] = (),
    left_open: Collection[Port] = (),
) -> Wiring:
    """Connections of a system.

    interfaces: by component, in execution order; explicit: exceptions (input, output) as
    `component.variable`, for whole vectors or single elements; left_open: inputs that nobody
    drives. An optional input that no output is called like needs neither.
    """
    wiring = Wiring()
    for target, source in explicit:
        _explicit(wiring, interfaces, target, source)
    taken = wiring.driven
    for port in left_open:
        if port in taken:
            wiring.problems.append(f"{port.component}.{port.signal}: is driven and left open")
    for port in _inputs(interfaces):
        if port not in taken and port not in left_open:
            _by_name(wiring, interfaces, port)
    return wiring


def _inputs(interfaces: Mapping[str, Interface]) -> Iterator[Port]:
    for component, interface in interfaces.items():
        yield from (Port(component, name) for name in interface.named("input"))


def _by_name(wiring: Wiring, interfaces: Mapping[str, Interface], target: Port) -> None:
    sources = drivers(interfaces, target)
    name = f"{target.component}.{target.signal}"
    if len(sources) == 1:
        wiring.connections.append(Connection(sources[0], target))
    elif sources:
        components = " and ".join(source.component for source in sources)
        wiring.problems.append(
            f"{name}: ambiguous, {components} have an output of this name: choose in [connections]"
        )
    elif not interfaces[target.component].variables[target.variable].optional:
        known = {base(name) for interface in interfaces.values() for name in interface.outputs()}
        close = did_you_mean(target.signal, known)
        wiring.problems.append(
            f"{name}: no output of this name{close}: connect it in [connections] or list it in "
            "[open]"
        )


def drivers(interfaces: Mapping[str, Interface], target: Port) -> list[Port]:
    """Outputs of the other components that are called like an input."""
    others = (component for component in interfaces if component != target.component)
    return [
        Port(component, target.variable)
        for component in others
        if target.variable in interfaces[component].outputs()
    ]


def _explicit(
    wiring: Wiring, interfaces: Mapping[str, Interface], target: str, source: str
) -> None:
    try:
        targets = ports(interfaces, target, "input")
        sources = ports(interfaces, source, "output")
    except ValueError as error:
        wiring.problems.append(str(error))
        return
    if len(targets) != len(sources):
        wiring.problems.append(
            f"{target}: has {len(targets)} elements, {source} has {len(sources)}"
        )
    already = wiring.driven
    wiring.problems += [f"{target}: is driven twice" for port in targets if port in already][:1]
    wiring.connections += [Connection(s, t) for s, t in zip(sources, targets, strict=False)]


def ports(interfaces: Mapping[str, Interface], name: str, causality: str) -> list[Port]:
    """Scalar ports that `component.variable` stands for; ValueError with close matches if there are
    none.
    """
    component, variable = split(name, interfaces)
    known = interfaces[component].named(causality)
    if not (elements := elements_of(variable, known)):
        raise ValueError(
            f"{name}: there is no such "
            f"{causality}{did_you_mean(variable, {*known, *map(base, known)})}"
        )
    return [Port(component, element) for element in elements]


def split(name: str, components: Collection[str]) -> tuple[str, str]:
    """Component and variable of `component.variable`; ValueError if there is no such component."""
    component, dot, variable = name.partition(".")
    if not dot:
        raise ValueError(
            f"{name}: expected component.variable, as in "
            f"{next(iter(components), 'component')}.{name}"
        )
    if component not in components:
        raise ValueError(
            f"{name}: there is no component '{component}'{did_you_mean(component, components)}"
        )
    return component, variable
