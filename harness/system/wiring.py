# SPDX-License-Identifier: BSD-2-Clause
"""Connections by name: an input is connected to the only output with the same name, so that a
signal has the same name in all components.
"""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

from harness.spelling import did_you_mean
from harness.system.interface import Interfaces
from harness.system.model import Connection, Port
from harness.system.values import elements_of, with_arrays

Owners = Mapping[str, Sequence[str]]
"""Mapping from the name of an output to the components that have it, in execution order."""


class Wiring(NamedTuple):
    """Connections between components, and errors of requested connections, a line of text each."""

    connections: list[Connection]
    problems: list[str]


def wire(
    interfaces: Interfaces,
    explicit: Mapping[str, str] | None = None,
    left_open: Collection[Port] = (),
) -> Wiring:
    """Return the connections of a system. An input without an output of the same name remains open.

    interfaces: by component, in execution order; explicit: connections that do not follow from
    equal names, a mapping from inputs to outputs, each `component.variable`, a vector or one
    element; left_open: inputs that remain unconnected.
    """
    connections, problems, driven = list[Connection](), list[str](), set[Port]()
    for target, source in (explicit or {}).items():
        try:
            targets = ports(interfaces, target, "input")
            sources = ports(interfaces, source, "output")
        except ValueError as error:
            problems.append(str(error))
            continue
        if len(targets) != len(sources):
            sizes = f"has {len(targets)} elements, {source} has {len(sources)}"
            problems.append(f"{target}: {sizes}")
        if not driven.isdisjoint(targets):
            problems.append(f"{target}: is driven by two connections, remove one")
        connections += map(Connection, sources, targets)
        driven.update(targets)
    both = (port for port in left_open if port in driven)
    problems += [
        f"{port.component}.{port.signal}: is left open, but a connection drives it" for port in both
    ]
    driven.update(left_open)
    owners = output_owners(interfaces)
    inputs = (Port(c, name) for c, i in interfaces.items() for name in i.named("input"))
    for port in (each for each in inputs if each not in driven):
        found = drivers(owners, port)
        connections += [Connection(source, port) for source in found[:1]]
        if len(found) > 1:
            place = f"{port.component}.{port.signal}"
            problems.append(f"{place}: {ambiguous(found)}: choose in [connections]")
    return Wiring(connections, problems)


def output_owners(interfaces: Interfaces) -> Owners:
    """Return the components that have an output, for the name of every output."""
    owners: dict[str, list[str]] = {}
    for component, interface in interfaces.items():
        for name in interface.outputs():
            owners.setdefault(name, []).append(component)
    return owners


def drivers(owners: Owners, target: Port) -> list[Port]:
    """Return the outputs of other components that have the name of the input `target`."""
    others = (c for c in owners.get(target.variable, ()) if c != target.component)
    return [Port(component, target.variable) for component in others]


def ambiguous(sources: Sequence[Port]) -> str:
    """Return the reason why an input is not connected: several outputs have its name."""
    owners = " and ".join(source.component for source in sources)
    return f"ambiguous, {owners} have an output of this name"


def ports(interfaces: Interfaces, name: str, *causalities: str) -> list[Port]:
    """Return the scalar inputs or outputs (`causalities`) that the name `component.variable`
    represents; raise ValueError with close matches if there are none.
    """
    component, variable = split(name, interfaces)
    first, *others = map(interfaces[component].named, causalities)
    # for a single causality the mapping is used directly, because a copy takes time
    known = ChainMap(dict(first), *map(dict, others)) if others else first
    if not (elements := elements_of(variable, known)):
        close = did_you_mean(variable, with_arrays(known))
        raise ValueError(f"{name}: there is no such {' or '.join(causalities)}{close}")
    return [Port(component, element) for element in elements]


def split(name: str, components: Collection[str]) -> tuple[str, str]:
    """Return component and variable of the name `component.variable`; raise ValueError if there is
    no such component.
    """
    component, dot, variable = name.partition(".")
    if not dot:
        example = f"{next(iter(components), 'component')}.{name}"
        raise ValueError(f"{name}: expected component.variable, as in {example}")
    if component not in components:
        close = did_you_mean(component, components)
        raise ValueError(f"{name}: there is no component '{component}'{close}")
    return component, variable
