# SPDX-License-Identifier: BSD-2-Clause
"""Wiring by name: a signal is called the same wherever it goes, so an input is driven by the one
output of its name.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from harness.spelling import did_you_mean
from harness.system.interface import Interface
from harness.system.model import Connection, Port
from harness.system.values import base, elements_of, with_arrays

Owners = Mapping[str, Sequence[str]]
"""Components that have an output, by the name of the output, in execution order."""


@dataclass
class Wiring:
    """Connections found between components, and what stood in the way of the others (one line
    each); driven: inputs that have a connection.
    """

    interfaces: Mapping[str, Interface]
    connections: list[Connection] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    driven: set[Port] = field(default_factory=set)

    def connect(self, source: Port, target: Port) -> None:
        """Let an output drive an input."""
        self.connections.append(Connection(source, target))
        self.driven.add(target)

    def connect_named(self, target: str, source: str) -> None:
        """Let an output drive an input, each a whole vector or a single element."""
        try:
            targets = ports(self.interfaces, target, "input")
            sources = ports(self.interfaces, source, "output")
        except ValueError as error:
            self.problems.append(str(error))
            return
        if len(targets) != len(sources):
            sizes = f"has {len(targets)} elements, {source} has {len(sources)}"
            self.problems.append(f"{target}: {sizes}")
        if not self.driven.isdisjoint(targets):
            self.problems.append(f"{target}: is driven twice")
        for output, port in zip(sources, targets, strict=False):
            self.connect(output, port)

    def connect_by_name(self, target: Port, owners: Owners, signals: Sequence[str]) -> None:
        """Connect an input to the output of its name; signals: names that outputs have."""
        sources = drivers(owners, target)
        optional = self.interfaces[target.component].variables[target.variable].optional
        if len(sources) == 1:
            self.connect(sources[0], target)
        elif sources:
            components = " and ".join(source.component for source in sources)
            self.problems.append(
                f"{target.component}.{target.signal}: ambiguous, {components} have an output of "
                "this name: choose in [connections]"
            )
        elif not optional:
            self.problems.append(
                f"{target.component}.{target.signal}: no output of this name"
                f"{did_you_mean(target.signal, signals)}: connect it in [connections] or list it "
                "in [open]"
            )


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
    wiring = Wiring(interfaces)
    for target, source in explicit:
        wiring.connect_named(target, source)
    for port in (port for port in left_open if port in wiring.driven):
        wiring.problems.append(f"{port.component}.{port.signal}: is driven and left open")
    settled = wiring.driven.union(left_open)
    owners = output_owners(interfaces)
    signals = sorted(set(map(base, owners)))
    for component, interface in interfaces.items():
        for name in interface.named("input"):
            if (port := Port(component, name)) not in settled:
                wiring.connect_by_name(port, owners, signals)
    return wiring


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


def ports(interfaces: Mapping[str, Interface], name: str, causality: str) -> list[Port]:
    """Scalar ports that `component.variable` stands for; ValueError with close matches if there are
    none.
    """
    component, variable = split(name, interfaces)
    known = interfaces[component].named(causality)
    if not (elements := elements_of(variable, known)):
        close = did_you_mean(variable, with_arrays(known))
        raise ValueError(f"{name}: there is no such {causality}{close}")
    return [Port(component, element) for element in elements]


def split(name: str, components: Collection[str]) -> tuple[str, str]:
    """Component and variable of `component.variable`; ValueError if there is no such component."""
    component, dot, variable = name.partition(".")
    if not dot:
        example = f"{next(iter(components), 'component')}.{name}"
        raise ValueError(f"{name}: expected component.variable, as in {example}")
    if component not in components:
        close = did_you_mean(component, components)
        raise ValueError(f"{name}: there is no component '{component}'{close}")
    return component, variable
