# SPDX-License-Identifier: BSD-2-Clause
"""Changes to a system before it flies: parameter sets and files, single values, other FMUs,
latencies, step, stop.

A change is a replacement of frozen data, so the changed system can be exported exactly as it was
run.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict

from harness.errors import HarnessError, StructureError, UsageError
from harness.files.paths import is_file
from harness.files.sealed import sha256
from harness.mission.exchange import of_system
from harness.remote.places import Place, move, read_place
from harness.results.requirements import refused
from harness.spelling import did_you_mean
from harness.ssp.parameters import read_ssv
from harness.system.graph import read_interfaces
from harness.system.instants import epoch_of, written
from harness.system.interface import read_interface
from harness.system.mapping import has_port
from harness.system.model import DEFAULT_SET, Origin, Port, Swap, System
from harness.system.swap import exchange, find_fmu
from harness.system.tables import SHARED, Assignments, read_toml
from harness.system.values import base, plain
from harness.system.wiring import split

Pairs = Sequence[str] | Mapping[str, Any]
"""Assignments, as texts `name=value` or as a mapping."""


class Changes(TypedDict, total=False):
    """Changes to a system: the keyword arguments of run() and of `Simulation.fly()`."""

    params: str | Path | None
    set: Pairs
    swap: Pairs
    map: Pairs
    on: Pairs
    latency: Pairs
    step: float | None
    stop: float | None
    algorithm: str | None
    epoch: str | None
    require: Sequence[str] | Mapping[str, str]


def apply(  # noqa: PLR0913 - every one is an option of the command line
    system: System,
    *,
    params: str | Path | None = None,
    set: Pairs = (),
    swap: Pairs = (),
    map: Pairs = (),
    on: Pairs = (),
    latency: Pairs = (),
    step: float | None = None,
    stop: float | None = None,
    algorithm: str | None = None,
    epoch: str | None = None,
    require: Sequence[str] | Mapping[str, str] = (),
) -> System:
    """Return the system with everything the user wants otherwise; the arguments are those of run().

    Order: named set, epoch (at which the bodies of `[start]` are elsewhere), swapped FMUs, file of
    parameters, single values, other processors. Raises
    UsageError for names that do not exist, StructureError for a parameter file with mistakes or a
    swapped FMU that does not fit, FmuError for an FMU that does not build for its processor.
    """
    base, named = system, str(params) in set_names(system)
    if named:
        system = choose_set(system, str(params))
    date = None if epoch is None else written(epoch_of(epoch))
    if date is not None and system.starts and date != system.experiment.epoch:
        system = _elsewhere(system, date)
    system = _swapped(system, list(_once("--swap", swap)), list(_once("--map", map)))
    if params is not None and not named:
        system = _parameter_file(system, Path(params))
    if set:
        system = _single_values(system, _once("--set", set))
    for component, steps in _once("--latency", latency):
        system = _delayed(system, component, steps)
    if on:
        system = move(system, _places(system, on))
    given = {"step": step, "stop": stop, "algorithm": algorithm, "epoch": date}
    changes: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    return replace(
        _required(system, require),
        experiment=replace(system.experiment, **changes),
        origin=_origin(base.origin, params, named, set, swap, map, on, latency),
    )


def _elsewhere(system: System, epoch: str) -> System:
    """A system whose bodies start from files, at another UTC of t = 0."""
    moved = replace(system, experiment=replace(system.experiment, epoch=epoch))
    values = Assignments(read_interfaces(moved))
    for name, value in of_system(moved).values.items():
        values.set(*split(name, values.interfaces), value)
    return _with(moved, values)


def _required(system: System, given: Sequence[str] | Mapping[str, str]) -> System:
    """The system with further requirements, a text alone is its own name; those that it has itself
    may have lost what they need by a swap.
    """
    if not given:
        return system
    further = dict(given) if isinstance(given, Mapping) else {text: text for text in given}
    if found := refused(system, further):
        option = "" if isinstance(given, Mapping) else "--require "
        raise UsageError("\n".join(option + problem for problem in found))
    return replace(system, requirements={**system.requirements, **further})


def _origin(  # noqa: PLR0913, PLR0917 - the changes
    before: Origin,
    params: str | Path | None,
    named: bool,
    set: Pairs,
    swap: Pairs,
    map: Pairs,
    on: Pairs,
    latency: Pairs,
) -> Origin:
    """Where a system comes from that was changed in this way."""
    swaps = {c: Swap(c, str(fmu), sha256(find_fmu(fmu))) for c, fmu in pairs("--swap", swap)}
    late = {c: int(steps) for c, steps in pairs("--latency", latency)}
    if params is not None:
        digest = "" if named else sha256(str(params))
        before = replace(before, params=str(params), params_sha256=digest)
    return replace(
        before,
        set={**before.set, **dict(pairs("--set", set))},
        swaps={**before.swaps, **swaps},
        maps={**before.maps, **dict(pairs("--map", map))},
        on={**before.on, **{c: str(place) for c, place in pairs("--on", on)}},
        latency={**before.latency, **late},
    )


def _swapped(
    system: System, swaps: Sequence[tuple[str, Any]], names: Sequence[tuple[str, Any]]
) -> System:
    """Other FMUs, each with the names of ports that are given for it."""
    if unknown := unmapped(swaps, names) if names else []:
        raise UsageError(_without_port(unknown[0], swaps))
    for component, fmu in swaps:
        known = _ports_of(fmu) if names else []
        local = [(_local(theirs, component, known), str(ours)) for theirs, ours in names]
        system = exchange(system, component, fmu, [(a, b) for a, b in local if a])
    return system


def unmapped(swaps: Sequence[tuple[str, Any]], names: Iterable[tuple[str, Any]]) -> list[str]:
    """Of the ports that are given our names those that no swapped FMU has."""
    ports = {component: _ports_of(fmu) for component, fmu in swaps}
    return [
        theirs
        for theirs, _ in names
        if not any(_local(theirs, component, known) for component, known in ports.items())
    ]


def _ports_of(fmu: str | Path) -> list[str]:
    interface = read_interface(find_fmu(fmu))
    return [*interface.named("input"), *interface.outputs()]


def _local(name: str, component: str, known: Collection[str]) -> str:
    """The port that is meant by `port` or `component.port`, or "" if it is none of these."""
    inner = name.removeprefix(f"{component}.")
    return next((each for each in (name, inner) if has_port(each, known)), "")


def _without_port(name: str, swaps: Sequence[tuple[str, Any]]) -> str:
    if not swaps:
        return f"--map {name}: names ports of an FMU that is put in by --swap"
    known = {base(port) for _, fmu in swaps for port in _ports_of(fmu)}
    fmus = " and ".join(dict.fromkeys(find_fmu(fmu).name for _, fmu in swaps))
    return f"--map {name}: {fmus} has no such port{did_you_mean(name, known)}"


def as_in_a_file(error: HarnessError) -> str:
    """What an error says of values that were written into a file instead of behind --set."""
    return str(error).replace("--set ", "")


def pairs(option: str, given: Pairs) -> Iterator[tuple[str, Any]]:
    """Names and values of assignments; UsageError if a text is none."""
    if isinstance(given, Mapping):
        yield from ((name, plain(value)) for name, value in given.items())
        return
    for text in given:
        name, equals, value = text.partition("=")
        empty = not value.strip() and option in ("--swap", "--map", "--latency")
        if not equals or not name.strip() or empty:
            raise UsageError(f"{option} {text}: expected name=value")
        yield name.strip(), value.strip()


def _once(option: str, given: Pairs) -> Iterator[tuple[str, Any]]:
    """pairs(), of which no name may be given twice."""
    seen = []
    for name, value in pairs(option, given):
        if name in seen:
            raise UsageError(f"{option} {name}: is given twice")
        seen.append(name)
        yield name, value


def joined(own: Changes, further: Changes) -> Changes:
    """Changes with further ones over them; those of one name each do not replace others."""
    both: dict[str, Any] = {**own, **further}
    for name in ("set", "swap", "on", "latency"):
        given: list[Any] = [c[name] for c in (own, further) if name in c]
        if len(given) == 2:
            both[name] = {k: v for each in given for k, v in pairs(f"--{name}", each)}
    return both  # type: ignore[return-value]


def set_names(system: System) -> list[str]:
    """Names of all parameter sets of a system, the default one first."""
    return [DEFAULT_SET, *(s.name for s in system.sets)]


def choose_set(system: System, name: str) -> System:
    """Return the system with a named parameter set in place of the default one."""
    if name == DEFAULT_SET:
        return system
    chosen = next(s for s in system.sets if s.name == name)
    components = tuple(
        replace(c, parameters=chosen.parameters.get(c.name, c.parameters))
        for c in system.components
    )
    given = {"stop": chosen.stop, "step": chosen.step}
    changes: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    return replace(system, components=components, experiment=replace(system.experiment, **changes))


def _parameter_file(system: System, path: Path) -> System:
    """Parameters from a .toml (tables per component and `shared`) or an .ssv (names
    component.parameter).
    """
    readers = {".toml": _read_tables, ".ssv": _read_ssv}
    if path.suffix not in readers:
        names = set_names(system)
        hint = did_you_mean(str(path), names) or f", only {', '.join(names)}"
        raise UsageError(f"--params {path}: {system.name} has no such set{hint}")
    if not is_file(path):
        raise UsageError(f"--params {path}: no such file")
    values = Assignments(read_interfaces(system))
    readers[path.suffix](values, path)
    if values.problems:
        raise StructureError(f"{path.name}: {problem}" for problem in values.problems)
    return _with(system, values)


def _read_tables(values: Assignments, path: Path) -> None:
    tables = read_toml(path)
    values.tables(tables.get("parameters", tables))


def _read_ssv(values: Assignments, path: Path) -> None:
    for name, parameter in read_ssv(path).items():
        try:
            component, variable = split(name, values.interfaces)
        except ValueError as error:
            values.problems.append(str(error))
        else:
            values.parameters[component][variable] = parameter


def _single_values(system: System, pairs: Iterator[tuple[str, Any]]) -> System:
    values = Assignments(read_interfaces(system))
    common = SHARED not in values.interfaces
    for name, value in sorted(pairs, key=lambda p: not p[0].startswith(f"{SHARED}.")):
        if common and name.startswith(f"{SHARED}."):
            values.shared(name.removeprefix(f"{SHARED}."), value, isinstance(value, str))
            continue
        try:
            component, variable = split(name, values.interfaces)
        except ValueError as error:
            values.problems.append(str(error))
        else:
            (values.write if isinstance(value, str) else values.set)(component, variable, value)
    values.problems += _without_effect(system, values)
    if values.problems:
        raise UsageError("\n".join(f"--set {problem}" for problem in values.problems))
    return _with(system, values)


def _without_effect(system: System, values: Assignments) -> Iterator[str]:
    """Values for inputs that are driven, which would be overwritten before anybody reads them."""
    drivers = {c.target: c.source for c in system.connections}
    ports = (Port(c, v) for c, parameters in values.parameters.items() for v in parameters)
    for port in ports:
        if port in drivers:
            yield f"{port}: is driven by {drivers[port]}, a value of its own has no effect"


def _delayed(system: System, name: str, steps: Any) -> System:
    """A component publishes so many macro steps later; how many are possible the schedule knows."""
    known = [c.name for c in system.components]
    if name not in known:
        raise UsageError(
            f"--latency {name}: {system.name} has no such component{did_you_mean(name, known)}"
        )
    try:
        count = int(steps)
    except (TypeError, ValueError) as error:
        raise UsageError(
            f"--latency {name}: expected a number of macro steps, got {steps}"
        ) from error
    components = tuple(
        replace(c, latency=count) if c.name == name else c for c in system.components
    )
    return replace(system, components=components)


def _places(system: System, on: Pairs) -> dict[str, Place]:
    """Where components run, by their names."""
    known = [c.name for c in system.components]
    places = {}
    for name, text in _once("--on", on):
        if name not in known:
            hint = did_you_mean(name, known)
            raise UsageError(f"--on {name}: {system.name} has no such component{hint}")
        places[name] = read_place(name, str(text))
    return places


def _with(system: System, values: Assignments) -> System:
    components = tuple(
        replace(c, parameters=values.over(c.name, c.parameters)) for c in system.components
    )
    return replace(system, components=components)
