# SPDX-License-Identifier: BSD-2-Clause
"""Exchange of one component's FMU for another that has the ports the system needs, wherever it was
built.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from harness.errors import StructureError, UsageError
from harness.files import paths
from harness.spelling import did_you_mean
from harness.system.graph import read_interfaces
from harness.system.interface import Interface, read_interface, units_agree
from harness.system.model import Component, Connection, Parameters, ParameterSet, Port, System
from harness.system.names import base
from harness.system.wiring import drivers

SHOWN = 5
"""Dropped parameters that a warning names."""

_log = logging.getLogger("harness")


def find_fmu(name: str | Path) -> Path:
    """Path of an FMU by name or path; UsageError with close matches if there is none."""
    known = paths.fmus()
    if str(name) in known:
        return known[str(name)]
    if paths.is_file(name):
        return Path(name)
    raise UsageError(f"{name}: there is no such FMU{did_you_mean(str(name), known)}")


def exchange(system: System, name: str, fmu: str | Path) -> System:
    """Return the system with another FMU as component `name`.

    Its outputs must include all that others read, with equal units. Its inputs take over the wiring
    of the same names, further ones are wired to the one output of their name. It keeps the
    parameters that it shares with its predecessor, and over them come those that the system has for
    an FMU of its model name; for an FMU unknown to the system the parameters that are dropped are
    named in a warning. Raises UsageError (unknown component or FMU), FmuError, or StructureError
    with all that is missing.
    """
    known = [c.name for c in system.components]
    if name not in known:
        raise UsageError(
            f"--swap {name}: {system.name} has no such component{did_you_mean(name, known)}"
        )
    path = find_fmu(fmu)
    interfaces = {**read_interfaces(system), name: read_interface(path)}
    connections, problems = _rewired(system, name, interfaces)
    problems += _missing_outputs(system, name, interfaces)
    if problems:
        raise StructureError(f"--swap {name}={path.name}: {problem}" for problem in problems)
    model = interfaces[name].model.modelName
    prepared = [a for a in system.alternatives if a.component == name and a.fmu == model]
    if not prepared:
        _warn_of_dropped(system.component(name), path, interfaces[name])
    changed = _with_fmu(system, name, path, interfaces[name])
    for alternative in prepared:
        changed = _with_parameters(changed, alternative.parameters)
    rest = tuple(a for a in system.alternatives if a.component != name)
    return replace(changed, connections=tuple(connections), alternatives=rest)


def _missing_outputs(
    system: System, name: str, interfaces: Mapping[str, Interface]
) -> Iterator[str]:
    """What others read from the component and the new FMU does not offer."""
    offered = interfaces[name].outputs()
    for source, target, hops in system.connections:
        if source.component != name:
            continue
        reader = f"{target.component}.{target.signal}"
        if source.variable not in offered:
            yield f"it has no output {source.signal}, which {reader} needs"
            continue
        unit, wanted = (
            offered[source.variable].unit,
            interfaces[target.component].variables[target.variable].unit,
        )
        if not hops and not units_agree(unit, wanted):
            yield f"its output {source.signal} is in {unit}, {reader} expects {wanted}"


def _rewired(
    system: System, name: str, interfaces: Mapping[str, Interface]
) -> tuple[list[Connection], list[str]]:
    """Connections with the inputs of the new FMU, and what keeps them from being driven."""
    inputs = interfaces[name].named("input")
    connections = [
        c for c in system.connections if c.target.component != name or c.target.variable in inputs
    ]
    driven = {c.target for c in connections}
    given = system.component(name).parameters
    problems = []
    for port in (Port(name, variable) for variable in inputs):
        if port in driven or port.variable in given:
            continue
        sources = drivers(interfaces, port)
        if len(sources) == 1:
            connections.append(Connection(sources[0], port))
        elif system.strict:
            problems.append(_undriven(port, sources))
    return connections, problems


def _undriven(port: Port, sources: Sequence[Port]) -> str:
    if not sources:
        return f"its input {port.signal} is driven by no output of that name"
    return (
        f"its input {port.signal} is ambiguous: "
        f"{' and '.join(s.component for s in sources)} have that output"
    )


def _warn_of_dropped(old: Component, path: Path, interface: Interface) -> None:
    known = interface.settable()
    dropped = list(
        dict.fromkeys(base(p).partition(".")[0] for p in old.parameters if p not in known)
    )
    if dropped:
        more = f" and {len(dropped) - SHOWN} more" if len(dropped) > SHOWN else ""
        names = ", ".join(dropped[:SHOWN]) + more
        _log.warning(
            "%s: %s does not have these parameters of %s: %s",
            old.name,
            path.name,
            old.fmu.stem,
            names,
        )


def _with_fmu(system: System, name: str, path: Path, interface: Interface) -> System:
    """Put in the new FMU and drop the parameters it does not have, from the named sets too."""
    old = system.component(name)
    known = interface.settable()
    new = replace(old, fmu=path, parameters=_kept(old.parameters, known))
    components = tuple(new if c.name == name else c for c in system.components)
    return replace(
        system, components=components, sets=tuple(_without(s, name, known) for s in system.sets)
    )


def _with_parameters(system: System, parameters: Mapping[str, Parameters]) -> System:
    """Put parameters over those of the components and of the named sets."""

    def over(name: str, given: Parameters) -> Parameters:
        return {**given, **parameters.get(name, {})}

    components = tuple(replace(c, parameters=over(c.name, c.parameters)) for c in system.components)
    sets = tuple(
        replace(s, parameters={n: over(n, p) for n, p in s.parameters.items()}) for s in system.sets
    )
    return replace(system, components=components, sets=sets)


def _without(each: ParameterSet, name: str, known: Mapping[str, object]) -> ParameterSet:
    if name not in each.parameters:
        return each
    return replace(each, parameters={**each.parameters, name: _kept(each.parameters[name], known)})


def _kept(parameters: Parameters, known: Mapping[str, object]) -> Parameters:
    return {name: value for name, value in parameters.items() if name in known}
