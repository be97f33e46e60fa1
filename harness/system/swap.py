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
from harness.system import mapping
from harness.system.graph import read_interfaces
from harness.system.interface import Interface, read_interface, units_agree
from harness.system.model import Component, Connection, Parameters, ParameterSet, Port, System
from harness.system.names import base
from harness.system.values import Variable
from harness.system.wiring import drivers, output_owners

SHOWN = 5
"""Dropped parameters that a warning names."""

_log = logging.getLogger("harness")


def find_fmu(name: str | Path) -> Path:
    """Path of an FMU by name or path, or in the folder of a controller that has been built;
    UsageError with close matches if there is none.
    """
    known = paths.fmus()
    if str(name) in known:
        return known[str(name)]
    if paths.is_file(name):
        return Path(name)
    if str(name) and paths.is_folder(name):
        inside = Path(name) / f"{Path(name).resolve().name}.fmu"
        if paths.is_file(inside):
            return inside
        raise UsageError(f"{name}: a folder without {inside.name}; harness build {name} makes it")
    raise UsageError(f"{name or '(nothing)'}: there is no such FMU{did_you_mean(str(name), known)}")


def exchange(
    system: System, name: str, fmu: str | Path, given: Sequence[tuple[str, str]] = ()
) -> System:
    """Return the system with another FMU as component `name`.

    Its outputs must include all that others read, with equal units. Its inputs take over the wiring
    of the same names, further ones are wired to the one output of their name. Which of its ports go
    by another name is given in pairs (theirs, ours), of scalars or whole vectors; vectors that only
    write their indices in another style are found without. It keeps the parameters that it shares
    with its predecessor, and over them come those that the system has for an FMU of its model name;
    for an FMU unknown to the system the parameters that are dropped are named in a warning. Raises
    UsageError (unknown component, FMU or port), FmuError, or StructureError with all that is
    missing, and what it could be.
    """
    known = [c.name for c in system.components]
    if name not in known:
        raise UsageError(
            f"--swap {name}: {system.name} has no such component{did_you_mean(name, known)}"
        )
    path = find_fmu(fmu)
    before = read_interfaces(system)
    names = _names(system, name, before, read_interface(path), given)
    interfaces = {**before, name: read_interface(path)}
    connections, problems = _rewired(system, name, interfaces, names)
    problems += _missing_outputs(connections, name, interfaces)
    if problems:
        problems += _offered(system, name, before, interfaces[name], names)
        raise StructureError(f"--swap {name}={path.name}: {problem}" for problem in problems)
    model = interfaces[name].model.modelName
    prepared = [a for a in system.alternatives if a.component == name and a.fmu == model]
    renamed = _with_names(system, name, names)
    if not prepared:
        _warn_of_dropped(renamed.component(name), before[name], interfaces[name])
    changed = _with_fmu(renamed, name, path, interfaces[name])
    for alternative in prepared:
        changed = _with_parameters(changed, alternative.parameters)
    rest = tuple(a for a in system.alternatives if a.component != name)
    return replace(changed, connections=tuple(connections), alternatives=rest)


# ---- names


def _names(
    system: System,
    name: str,
    before: Mapping[str, Interface],
    interface: Interface,
    given: Sequence[tuple[str, str]],
) -> mapping.Names:
    """Our names by those of the new FMU, where they differ."""
    ours = {**_signals(name, before), **before[name].settable()}
    theirs = {**_ports(interface), **interface.settable()}
    try:
        told = mapping.told(given, _ports(interface), _signals(name, before))
    except ValueError as error:
        raise UsageError(f"--map {error}") from None
    styled = {
        a: b for a, b in mapping.by_style(theirs, ours).items() if not told.keys() & set(a.elements)
    }
    if styled:
        texts = [f"{a.elements[0]}.. for {b.elements[0]}.." for a, b in styled.items()]
        more = f" and {len(texts) - SHOWN} more" if len(texts) > SHOWN else ""
        shown = ", ".join(texts[:SHOWN]) + more
        _log.warning(
            "%s: %s writes indices in its own way, taken: %s", name, interface.path.name, shown
        )
    for a, b in styled.items():
        told |= zip(a.elements, b.elements, strict=True)
    return told


def _ports(interface: Interface) -> dict[str, Variable]:
    return {**interface.named("input"), **interface.outputs()}


def _signals(name: str, before: Mapping[str, Interface]) -> dict[str, Variable]:
    """What a component can be connected to: its ports, and the outputs of the others."""
    others = (i for component, i in before.items() if component != name)
    outputs = {n: v for interface in others for n, v in interface.outputs().items()}
    return {**outputs, **_ports(before[name])}


def _offered(
    system: System,
    name: str,
    before: Mapping[str, Interface],
    interface: Interface,
    names: mapping.Names,
) -> list[str]:
    """Ports of the new FMU that fit nothing yet, as options for what they could be."""
    ours = _signals(name, before)
    wired = {c.source.variable for c in system.connections if c.source.component == name}
    read = {c.target.variable for c in system.connections if c.target.component == name}
    done = {names.get(n, n) for n in _ports(interface)}
    pairs: list[tuple[str, str]] = []
    for theirs, wanted in (
        (interface.outputs(), wired),
        (interface.named("input"), read),
    ):
        free = {n: v for n, v in theirs.items() if names.get(n, n) not in ours}
        open_ = {n: ours[n] for n in ours if n in wanted and n not in done}
        pairs += mapping.guesses(free, open_)
    return [f"perhaps {mapping.options(pairs)}"] if pairs else []


def _with_names(system: System, name: str, names: mapping.Names) -> System:
    """Parameters and start values of a component under the names of the new FMU."""
    theirs = {our: their for their, our in names.items()}

    def renamed(parameters: Parameters) -> Parameters:
        return {theirs.get(n, n): value for n, value in parameters.items()}

    if not names:
        return system
    components = tuple(
        replace(c, parameters=renamed(c.parameters)) if c.name == name else c
        for c in system.components
    )
    sets = tuple(
        replace(s, parameters={c: renamed(p) if c == name else p for c, p in s.parameters.items()})
        for s in system.sets
    )
    return replace(system, components=components, sets=sets)


# ---- connections


def _missing_outputs(
    connections: Sequence[Connection], name: str, interfaces: Mapping[str, Interface]
) -> Iterator[str]:
    """What others read from the component and the new FMU does not offer."""
    offered = interfaces[name].outputs()
    for source, target, hops in connections:
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
    system: System, name: str, interfaces: Mapping[str, Interface], names: mapping.Names
) -> tuple[list[Connection], list[str]]:
    """Connections with the ports of the new FMU, and what keeps inputs from being driven."""
    inputs = interfaces[name].named("input")
    readers: dict[str, list[str]] = {}
    for variable in inputs:
        readers.setdefault(names.get(variable, variable), []).append(variable)
    theirs = {our: their for their, our in names.items() if their in interfaces[name].outputs()}
    connections = []
    for c in system.connections:
        source = c.source
        if source.component == name:
            source = Port(name, theirs.get(source.variable, source.variable))
        if c.target.component != name:
            connections.append(c._replace(source=source))
        for variable in readers.get(c.target.variable, ()) if c.target.component == name else ():
            connections.append(c._replace(source=source, target=Port(name, variable)))
    driven = {c.target for c in connections}
    given = system.component(name).parameters
    problems = []
    owners = output_owners(interfaces)
    for port in (Port(name, variable) for variable in inputs):
        ours = Port(name, names.get(port.variable, port.variable))
        if port in driven or ours.variable in given:
            continue
        sources = drivers(owners, ours)
        if len(sources) == 1:
            connections.append(Connection(sources[0], port))
        elif system.strict and (sources or not inputs[port.variable].optional):
            problems.append(_undriven(port, sources))
    return connections, problems


def _undriven(port: Port, sources: Sequence[Port]) -> str:
    if not sources:
        return f"its input {port.signal} is driven by no output of that name"
    return (
        f"its input {port.signal} is ambiguous: "
        f"{' and '.join(s.component for s in sources)} have that output"
    )


def _warn_of_dropped(old: Component, before: Interface, interface: Interface) -> None:
    known = {*interface.settable(), *(n for n, v in before.variables.items() if v.optional)}
    dropped = list(
        dict.fromkeys(base(p).partition(".")[0] for p in old.parameters if p not in known)
    )
    if dropped:
        more = f" and {len(dropped) - SHOWN} more" if len(dropped) > SHOWN else ""
        names = ", ".join(dropped[:SHOWN]) + more
        _log.warning(
            "%s: %s does not have these parameters of %s: %s",
            old.name,
            interface.path.name,
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
