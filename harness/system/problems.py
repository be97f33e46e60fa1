# SPDX-License-Identifier: BSD-2-Clause
"""Checks of a whole system, with one line per problem: components, connections, units, open inputs,
parameters, schedule.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Collection, Iterator, Sequence

from harness.files.archive import MAX_UNPACKED
from harness.spelling import did_you_mean
from harness.system.conversion import final, is_unconverted, way
from harness.system.interface import NO_NUMBERS, Interface, Interfaces, units_agree
from harness.system.model import Component, Connection, Parameter, Port, System
from harness.system.schedule import problems as schedule_problems
from harness.system.units import IDENTITY, UndefinedUnitError, Unit, compose
from harness.system.values import STRUCTURAL, Variable, base, unsettable

_log = logging.getLogger("harness")


def problems(system: System, interfaces: Interfaces) -> Iterator[str]:
    """Yield all problems of a system, one line each. Components whose FMU cannot be read are left
    out.
    """
    unread = {c.name for c in system.components} - interfaces.keys()
    if not system.components:
        yield "the system has no components"
    for name, count in Counter(c.name for c in system.components).items():
        if count > 1:
            yield f"{name}: there are two components of this name"
    for connection in system.connections:
        yield from _connection_problems(connection, interfaces, unread, system.strict)
    yield from _double_drive(system.connections)
    yield from _declared_problems(system, interfaces)
    yield from value_problems(system, interfaces, system.components)


def value_problems(
    system: System, interfaces: Interfaces, changed: Sequence[Component]
) -> Iterator[str]:
    """Yield the problems that new parameters, schedules or experiments can cause, one line each;
    changed: the components with new parameters.
    """
    yield from schedule_problems(system.experiment.algorithm, system.components)
    if system.strict:
        yield from _open_inputs(system, interfaces)
    for component in changed:
        if component.name in interfaces:
            yield from _parameter_problems(component, interfaces[component.name])
    if changed:
        yield from _shared_streams(system, interfaces)


def _shared_streams(system: System, interfaces: Interfaces) -> Iterator[str]:
    """Yield a line per group of components with equal seed and stream, which would draw the same
    random numbers.
    """
    owners: dict[tuple[float, ...], list[str]] = {}
    for component in system.components:
        known = interfaces[component.name].variables if component.name in interfaces else {}
        if "seed" in known and "stream" in known:
            given = [component.parameters.get(name) for name in ("seed", "stream")]
            starts = known["seed"].start, known["stream"].start
            values = [p.value if p else start for p, start in zip(given, starts, strict=True)]
            numbers = tuple(v if isinstance(v, int | float) else 0.0 for v in values)
            owners.setdefault(numbers, []).append(component.name)
    for (seed, stream), names in owners.items():
        if len(names) > 1:
            drawn = f"the same random numbers (seed {seed:g}, stream {stream:g})"
            yield f"{' and '.join(names)}: draw {drawn}: set a different stream for each"


def _connection_problems(
    connection: Connection, interfaces: Interfaces, unread: Collection[str], strict: bool
) -> Iterator[str]:
    ends: list[Variable] = []
    for port, causality in zip(connection[:2], ("output", "input"), strict=True):
        try:
            if port.component not in unread:
                ends.append(_end(port, causality, interfaces))
        except ValueError as error:
            yield f"{port}: {error}"
    if len(ends) == 2 and (problem := _misfit(connection, ends[0], ends[1], interfaces, strict)):
        yield f"{connection.target}: {problem}"


def _end(port: Port, causality: str, interfaces: Interfaces) -> Variable:
    """Return the variable at one end of a connection; raise ValueError if it does not exist or has
    another causality.
    """
    if port.component not in interfaces:
        close = did_you_mean(port.component, interfaces)
        raise ValueError(f"there is no component '{port.component}'{close}")
    interface = interfaces[port.component]
    variable = interface.variables.get(port.variable)
    if variable is None:
        close = did_you_mean(port.variable, interface.named(causality))
        raise ValueError(f"there is no such {causality}{close}")
    if variable.causality != causality:
        found = variable.causality
        raise ValueError(f"is connected as {causality}, but its causality is {found}")
    return variable


def _misfit(
    connection: Connection, source: Variable, target: Variable, interfaces: Interfaces, strict: bool
) -> str | None:
    """Return why the types or units of an output and an input do not permit a connection, None if
    they do. Units must be equal in a `strict` system, because other tools do not convert units.
    """
    if source.type != target.type or source.type in NO_NUMBERS:
        return (
            f"has type {target.type}, cannot be driven by {connection.source} of type "
            f"{source.type}; use numbers of one type"
        )
    unequal = f"expected unit {target.unit}, {connection.source} has {source.unit}"
    try:
        change = way(connection, interfaces, strict=True)
    except UndefinedUnitError as error:
        if strict:
            return str(error)
        _log.warning("%s: not converted: %s", connection.target, error)
        return None
    except ValueError as error:
        return f"{unequal} ({error})"
    if change != IDENTITY and target.type != "Real":
        return f"has type {target.type}, but only the type Real can be scaled or converted"
    is_equal = connection.hops or units_agree(source.unit, target.unit)
    return unequal if strict and not is_equal else None


def _declared_problems(system: System, interfaces: Interfaces) -> Iterator[str]:
    """Yield a line per connector for which the file states another unit than the FMU. Units are
    compared by their definitions, not by name; a unit without a definition is only logged.
    """
    for port, claimed in system.declared.items():
        interface = interfaces.get(port.component)
        variable = None if interface is None else interface.variables.get(port.variable)
        if interface is None or variable is None:
            continue
        if not _is_claimed(port, claimed, interface.unit(variable)):
            yield f"{port}: the unit is {claimed.name} in the file, but {variable.unit} in the FMU"


def _is_claimed(port: Port, claimed: Unit, own: Unit | None) -> bool:
    try:
        return compose(claimed, (), own) == IDENTITY
    except UndefinedUnitError as error:
        note = "%s: the unit %s of its connector is not compared (%s)"
        _log.warning(note, port, claimed.name, error)
        return True
    except ValueError:
        return False


def _double_drive(connections: Sequence[Connection]) -> Iterator[str]:
    sources: dict[Port, list[str]] = {}
    for source, target, _ in connections:
        sources.setdefault(target, []).append(str(source))
    for target, drivers in sources.items():
        if len(drivers) > 1:
            yield (
                f"{target}: is driven {len(drivers)} times, by {' and '.join(drivers)}; "
                "connect only one of them"
            )


def _open_inputs(system: System, interfaces: Interfaces) -> Iterator[str]:
    driven = {connection.target for connection in system.connections}
    missing = {
        Port(c.name, base(name)): None
        for c in system.components
        if c.name in interfaces
        for name, variable in interfaces[c.name].named("input").items()
        if not (Port(c.name, name) in driven or name in c.parameters or variable.optional)
    }
    outputs = sorted({base(n) for i in interfaces.values() for n in i.outputs() if missing})
    for port in missing:
        fault = f"no output of this name{did_you_mean(port.variable, outputs)}"
        yield f"{port}: {fault}: connect it in [connections] or list it in [open]"


def _parameter_problems(component: Component, interface: Interface) -> Iterator[str]:
    for name, parameter in component.parameters.items():
        place = f"{component.name}.{name}"
        if name not in interface.variables and parameter.optional:
            _log.warning("%s: ignored, %s has no such parameter", place, interface.path.name)
        elif problem := _parameter_problem(name, parameter, interface):
            yield f"{place}: {problem}"
        elif is_unconverted(parameter, interface.variables[name], interface):
            note = "%s: its unit %s has no definition, so the value is not converted"
            _log.warning(note, place, parameter.unit)


def _parameter_problem(name: str, parameter: Parameter, interface: Interface) -> str | None:
    variable = interface.variables.get(name)
    if variable is None:
        return f"there is no such parameter{did_you_mean(name, interface.settable())}"
    if variable.causality == STRUCTURAL and parameter.value == variable.begin:
        return None
    if not variable.settable:
        return unsettable(variable, interface.settable())
    if parameter.value != parameter.value:
        return "must not be NaN"
    try:
        final(parameter, variable, interface)
    except ValueError as error:
        same = units_agree(parameter.unit, variable.unit)
        other = f"is given in {parameter.unit}, but its unit is {variable.unit} ({error})"
        return str(error) if same else other
    return None


def size_problems(system: System, interfaces: Interfaces) -> Iterator[str]:
    """Yield one line if the sizes of all unpacked FMUs of a system together exceed the limit; an
    FMU counts once per component, because it is unpacked for each.
    """
    size = sum(interfaces[c.name].size for c in system.components if c.name in interfaces)
    if size > MAX_UNPACKED:
        limit = f"more than the limit of {MAX_UNPACKED}"
        yield f"the FMUs of all components would unpack to {size} bytes, {limit}"
