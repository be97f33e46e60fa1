# SPDX-License-Identifier: BSD-2-Clause
"""Changes to a system before a run: parameter sets and files, single values, swapped FMUs,
processors, latencies, step, stop, order of execution, epoch, requirements, open components.

Every change returns a new System, which can be exported exactly as it was run.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypedDict, Unpack

from harness.errors import HarnessError, StructureError, UsageError
from harness.files.checksums import sha256
from harness.files.paths import is_file
from harness.mission.exchange import of_system
from harness.remote.places import move, read_place
from harness.results.requirements import rejected
from harness.spelling import did_you_mean
from harness.ssp.parameters import read_ssv
from harness.system.graph import read_interfaces
from harness.system.instants import epoch_of, written
from harness.system.interface import read_interface
from harness.system.mapping import has_port
from harness.system.model import DEFAULT_SET, Origin, Parameters, Port, Swap, System
from harness.system.swap import exchange, existing, find_fmu
from harness.system.tables import SHARED, Assignments, read_toml
from harness.system.values import base, plain
from harness.system.wiring import split

Pairs = Sequence[str] | Mapping[str, Any]
"""Assignments of one option, such as --set: texts `name=value`, or a mapping from name to value."""

Given = Mapping[str, Any]
"""Values of the assignments of one option, by name."""


class Changes(TypedDict, total=False):
    """Changes to a system: the keyword arguments of run() and of `Simulation.run()`."""

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
    open: Sequence[str]


NAMED = ("set", "swap", "map", "on", "latency")
"""Keys of Changes whose values are assignments `name=value`."""


def apply(system: System, **changes: Unpack[Changes]) -> System:
    """Return the system with all changes of the user.

    The changes are made in this order: named parameter set, epoch (to which the bodies in a table
    `[start]` are propagated), swapped FMUs, file of parameters, single values, latencies,
    processors of components. Raises UsageError for names that do not exist, StructureError for a
    parameter file with mistakes or a swapped FMU that does not fit, FmuError for an FMU that does
    not build for its processor.
    """
    if unknown := [name for name in changes if name not in Changes.__annotations__]:
        close = did_you_mean(unknown[0], Changes.__annotations__)
        raise UsageError(f"{unknown[0]}: there is no such change of a system{close}")
    before, params = system.origin, changes.get("params")
    options: Mapping[str, Any] = changes
    given = {name: _once(f"--{name}", options.get(name, ())) for name in NAMED}
    is_set = str(params) in set_names(system)
    if is_set:
        system = choose_set(system, str(params))
    epoch = changes.get("epoch")
    date = None if epoch is None else written(epoch_of(epoch))
    if date is not None and system.starts and date != system.experiment.epoch:
        system = _elsewhere(system, date)
    system = _swapped(system, given["swap"], given["map"])
    if params is not None and not is_set:
        system = _parameter_file(system, Path(params))
    system = _delayed(_single_values(system, given["set"]), given["latency"])
    if on := given["on"]:
        found = {existing(system, "--on", name): read_place(name, str(on[name])) for name in on}
        system = move(system, found)
    timing = {name: options.get(name) for name in ("step", "stop", "algorithm")} | {"epoch": date}
    given_timing: Any = {name: value for name, value in timing.items() if value is not None}
    return replace(
        _required(system, changes.get("require", ())),
        without=_opened(system, changes.get("open", ())),
        experiment=replace(system.experiment, **given_timing),
        origin=_origin(before, params, is_set, given),
    )


def _origin(before: Origin, params: Any, is_set: bool, given: Mapping[str, Given]) -> Origin:
    """Return the origin of a system (its source and earlier changes, `before`), extended by new
    changes.

    params: name of a parameter set if `is_set`, else path of a parameter file (None: neither);
    given: assignments of each option in NAMED, by option.
    """
    swaps = {c: Swap(c, str(fmu), sha256(find_fmu(fmu))) for c, fmu in given["swap"].items()}
    if params is not None:
        digest = "" if is_set else sha256(str(params))
        before = replace(before, params=str(params), params_sha256=digest)
    return replace(
        before,
        set={**before.set, **given["set"]},
        swaps={**before.swaps, **swaps},
        maps={**before.maps, **given["map"]},
        on={**before.on, **{c: str(place) for c, place in given["on"].items()}},
        latency={**before.latency, **{c: int(steps) for c, steps in given["latency"].items()}},
    )


# ---- assignments


def pairs(option: str, given: Pairs) -> Iterator[tuple[str, Any]]:
    """Yield names and values of assignments; raise UsageError for a text that is not name=value."""
    if isinstance(given, Mapping):
        yield from ((name, plain(value)) for name, value in given.items())
        return
    for text in given:
        name, equals, value = text.partition("=")
        empty = not value.strip() and option in ("--swap", "--map", "--latency")
        if not equals or not name.strip() or empty:
            raise UsageError(f"{option} {text}: expected name=value")
        yield name.strip(), value.strip()


def _once(option: str, given: Pairs) -> dict[str, Any]:
    """Return names and values of assignments; raise UsageError if a name is given twice."""
    found: dict[str, Any] = {}
    for name, value in pairs(option, given):
        if name in found:
            raise UsageError(f"{option} {name}: is given twice")
        found[name] = value
    return found


def joined(own: Changes, further: Changes) -> Changes:
    """Return the changes `own` extended by `further`. Where both contain an option or a name of an
    assignment, the value in `further` applies.
    """
    one: Mapping[str, Any] = own
    both: dict[str, Any] = {**own, **further}
    for name in (n for n in NAMED if n in own and n in further):
        both[name] = {k: v for each in (one[name], both[name]) for k, v in pairs(f"--{name}", each)}
    return both  # type: ignore[return-value]


def as_in_a_file(error: HarnessError) -> str:
    """Return the message of an error without the word `--set`, for a value that is from a file and
    not from the command line.
    """
    return str(error).replace("--set ", "")


# ---- other FMUs


def _swapped(system: System, swaps: Given, names: Given) -> System:
    """Return the system with swapped FMUs. swaps: new FMU by component; names: from --map, the
    name of a port in the system by its name in the new FMU.
    """
    if unknown := unmapped(swaps, names):
        ports = {base(port) for fmu in swaps.values() for port in _ports_of(fmu)}
        raise UsageError(no_port(unknown[0], ports))
    for component, fmu in swaps.items():
        known = _ports_of(fmu) if names else []
        local = [(_local(theirs, component, known), str(ours)) for theirs, ours in names.items()]
        system = exchange(system, component, fmu, [(a, b) for a, b in local if a])
    return system


def unmapped(swaps: Given, names: Iterable[str]) -> list[str]:
    """Return the port names in `names`, given by --map, that no new FMU has. swaps: new FMU by
    component.
    """
    ports = {component: _ports_of(fmu) for component, fmu in swaps.items()} if names else {}
    return [name for name in names if not any(_local(name, *each) for each in ports.items())]


def _ports_of(fmu: str | Path) -> list[str]:
    interface = read_interface(find_fmu(fmu))
    return [*interface.named("input"), *interface.outputs()]


def _local(name: str, component: str, known: Collection[str]) -> str:
    """Return the port of the new FMU of `component` for a name `port` or `component.port`; "" if
    the port is not in `known`, the ports of this FMU.
    """
    inner = name.removeprefix(f"{component}.")
    return next((each for each in (name, inner) if has_port(each, known)), "")


def no_port(name: str, known: Collection[str] = ()) -> str:
    """Return the error message for a name in --map that is not a port of any swapped FMU."""
    return f"--map {name}: no FMU that --swap puts in has such a port{did_you_mean(name, known)}"


# ---- parameters


def set_names(system: System) -> list[str]:
    """Return the names of all parameter sets of a system, the default set first."""
    return [DEFAULT_SET, *(s.name for s in system.sets)]


def choose_set(system: System, name: str) -> System:
    """Return the system with the parameters, stop time and step of a named parameter set."""
    if name == DEFAULT_SET:
        return system
    chosen = next(s for s in system.sets if s.name == name)
    given = {"stop": chosen.stop, "step": chosen.step}
    changes: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    experiment = replace(system.experiment, **changes)
    return _with(replace(system, experiment=experiment), chosen.parameters)


def _with(system: System, parameters: Mapping[str, Parameters]) -> System:
    """Return the system with new parameters of components, given by component. Components that are
    not in `parameters` are unchanged.
    """
    found = ((c, parameters.get(c.name, c.parameters)) for c in system.components)
    new = (c if p is c.parameters else replace(c, parameters=p) for c, p in found)
    return replace(system, components=tuple(new))


def _over(system: System, values: Assignments) -> System:
    return _with(system, {c.name: values.over(c.name, c.parameters) for c in system.components})


def _elsewhere(system: System, epoch: str) -> System:
    """Return the system with another epoch (UTC of t = 0), and with start values of its bodies at
    this epoch from the files in its table `[start]`.
    """
    moved = replace(system, experiment=replace(system.experiment, epoch=epoch))
    values = Assignments(read_interfaces(moved))
    for name, value in of_system(moved).values.items():
        values.set(*split(name, values.interfaces), value)
    return _over(moved, values)


def _parameter_file(system: System, path: Path) -> System:
    """Return the system with parameters from a file: a .toml with a table per component and a table
    `shared`, or an .ssv with names `component.parameter`.
    """
    if path.suffix not in (".toml", ".ssv"):
        names = set_names(system)
        hint = did_you_mean(str(path), names) or f", only {', '.join(names)}"
        raise UsageError(f"--params {path}: {system.name} has no such parameter set{hint}")
    if not is_file(path):
        raise UsageError(f"--params {path}: no such file")
    values = Assignments(read_interfaces(system))
    _read_into(values, path)
    if values.problems:
        raise StructureError(f"{path.name}: {problem}" for problem in values.problems)
    return _over(system, values)


def _read_into(values: Assignments, path: Path) -> None:
    if path.suffix == ".toml":
        tables = read_toml(path)
        values.tables(tables.get("parameters", tables))
        return
    for name, parameter in read_ssv(path).items():
        for component, variable in _place(values, name):
            values.parameters[component][variable] = parameter


def _place(values: Assignments, name: str) -> list[tuple[str, str]]:
    """Return [(component, variable)] for a name `component.variable`. If one of them does not
    exist, return [] and add a problem to `values`.
    """
    try:
        return [split(name, values.interfaces)]
    except ValueError as error:
        values.problems.append(str(error))
        return []


def _single_values(system: System, given: Given) -> System:
    """Return the system with the values of --set; values of `shared` are set first, so that values
    of single components override them.
    """
    if not given:
        return system
    values = Assignments(read_interfaces(system))
    for name in sorted(given, key=lambda name: not name.startswith(f"{SHARED}.")):
        _single_value(values, name, given[name])
    if problems := [*values.problems, *_driven(system, values)]:
        raise UsageError("\n".join(f"--set {problem}" for problem in problems))
    return _over(system, values)


def _single_value(values: Assignments, name: str, value: Any) -> None:
    is_text = isinstance(value, str)
    if name.startswith(f"{SHARED}.") and SHARED not in values.interfaces:
        values.shared(name.removeprefix(f"{SHARED}."), value, is_text)
        return
    for component, variable in _place(values, name):
        (values.write if is_text else values.set)(component, variable, value)


def _driven(system: System, values: Assignments) -> Iterator[str]:
    """Yield an error message for every connected input in `values`: the connection would overwrite
    the value before its first use.
    """
    drivers = {c.target: c.source for c in system.connections}
    ports = (Port(c, v) for c, parameters in values.parameters.items() for v in parameters)
    for port in (p for p in ports if p in drivers):
        yield f"{port}: is driven by {drivers[port]}, so a start value has no effect"


# ---- open components, latency, requirements


def _opened(system: System, names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the open components of a system, whose outputs the user sets during a
    run, extended by `names`.
    """
    return tuple(dict.fromkeys([*system.without, *(existing(system, "--open", n) for n in names)]))


def _delayed(system: System, given: Given) -> System:
    """Return the system with new latencies. given: latency in macro steps by component. The limits
    are checked later, when the schedule is made.
    """
    for name, steps in given.items():
        existing(system, "--latency", name)
        try:
            count = int(steps)
        except (TypeError, ValueError) as error:
            text = f"--latency {name}: expected a number of macro steps, got {steps}"
            raise UsageError(text) from error
        later = (replace(c, latency=count) if c.name == name else c for c in system.components)
        system = replace(system, components=tuple(later))
    return system


def _required(system: System, given: Sequence[str] | Mapping[str, str]) -> System:
    """Return the system with further requirements. given: mapping from the name of a requirement to
    its text, or texts alone, each of which is then also the name. Raises UsageError if one of these
    requirements is not valid; earlier requirements of the system are not checked here, because they
    may need variables that a swap has removed.
    """
    if not given:
        return system
    further = dict(given) if isinstance(given, Mapping) else {text: text for text in given}
    if found := rejected(system, further):
        option = "" if isinstance(given, Mapping) else "--require "
        raise UsageError("\n".join(option + problem for problem in found))
    return replace(system, requirements={**system.requirements, **further})
