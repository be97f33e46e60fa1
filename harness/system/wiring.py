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
from harness.system.names import base, elements_of, with_arrays


@dataclass
class Wiring:
    """Connections found, and what stood in the way of the others (one line each)."""

    connections: list[Connection] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    driven: set[Port] = field(default_factory=set)
    """Inputs that have a connection."""

    def connect(self, source: Port, target: Port) -> None:
        """Let an output drive an input."""
        self.connections.append(Connection(source, target))
        self.driven.add(target)


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
    for port in left_open:
        if port in wiring.driven:
            wiring.problems.append(f"{port.component}.{port.signal}: is driven and left open")
    settled = wiring.driven.union(left_open)
    owners = output_owners(interfaces)
    signals = sorted(set(map(base, owners)))
    for port in _inputs(interfaces):
        if port not in settled:
            _by_name(wiring, interfaces, owners, signals, port)
    return wiring


def _inputs(interfaces: Mapping[str, Interface]) -> Iterator[Port]:
    for component, interface in interfaces.items():
        yield from (Port(component, name) for name in interface.named("input"))


Owners = Mapping[str, Sequence[str]]
"""Components that have an output, by the name of the output, in execution order."""


def output_owners(interfaces: Mapping[str, Interface]) -> Owners:
    """Who has an output of which name."""
    owners: dict[str, list[str]] = {}
    for component, interface in interfaces.items():
        for name in interface.outputs():
            owners.setdefault(name, []).append(component)
    return owners


def drivers(owners: Owners, target: Port) -> list[Port]:
    """Outputs of the other components that are called like an input."""
    others = (c for c in owners.get(target.variable, ()) if c != target.component)
    return [Port(component, target.variable) for component in others]


def _by_name(
    wiring: Wiring,
    interfaces: Mapping[str, Interface],
    owners: Owners,
    signals: Sequence[str],
    target: Port,
) -> None:
    """Connect an input to the output of its name; signals: names that outputs have."""
    sources = drivers(owners, target)
    name = f"{target.component}.{target.signal}"
    if len(sources) == 1:
        wiring.connect(sources[0], target)
    elif sources:
        components = " and ".join(source.component for source in sources)
        wiring.problems.append(
            f"{name}: ambiguous, {components} have an output of this name: choose in [connections]"
        )
    elif not interfaces[target.component].variables[target.variable].optional:
        close = did_you_mean(target.signal, signals)
        wiring.problems.append(
            f"{name}: no output of this name{close}: connect it in [connections] or list it in "
            "[open]"
        )


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
    if not wiring.driven.isdisjoint(targets):
        wiring.problems.append(f"{target}: is driven twice")
    for output, port in zip(sources, targets, strict=False):
        wiring.connect(output, port)


def ports(interfaces: Mapping[str, Interface], name: str, causality: str) -> list[Port]:
    """Scalar ports that `component.variable` stands for; ValueError with close matches if there are
    none.
    """
    component, variable = split(name, interfaces)
    known = interfaces[component].named(causality)
    if not (elements := elements_of(variable, known)):
        raise ValueError(
            f"{name}: there is no such {causality}{did_you_mean(variable, with_arrays(known))}"
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
