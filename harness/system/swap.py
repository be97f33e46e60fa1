# SPDX-License-Identifier: BSD-2-Clause
"""Replacement of the FMU of a component by another FMU, from any tool, with the ports that the
system needs.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from harness.errors import StructureError, UsageError
from harness.files import paths
from harness.spelling import did_you_mean, some
from harness.system import mapping
from harness.system.graph import read_interfaces
from harness.system.interface import Interface, read_interface, units_agree
from harness.system.model import Connection, Parameters, Port, System
from harness.system.values import Variable, base
from harness.system.wiring import ambiguous, drivers, output_owners

_log = logging.getLogger("harness")


def find_fmu(name: str | Path) -> Path:
    """Return the path of an FMU that is given by name, by path, or by the folder of a controller
    that `harness build` has built; raise UsageError with close matches if there is none.
    """
    known = paths.fmus()
    if str(name) in known:
        return known[str(name)]
    if paths.is_file(name):
        return Path(name)
    if paths.is_folder(name):
        inside = Path(name) / f"{Path(name).resolve().name}.fmu"
        if paths.is_file(inside):
            return inside
        raise UsageError(f"{name}: contains no {inside.name}; build it: harness build {name}")
    raise UsageError(f"{name or '(nothing)'}: there is no such FMU{did_you_mean(str(name), known)}")


def exchange(
    system: System, name: str, fmu: str | Path, given: Sequence[tuple[str, str]] = ()
) -> System:
    """Return the system with another FMU as component `name`.

    The outputs of the new FMU must include all outputs that other components read, with equal
    units. Inputs of the new FMU get the connections of the former inputs with the same names. A
    further input is connected to the output with the same name if there is exactly one. given:
    pairs (name in the FMU, name in the system) of scalars or whole vectors, for ports whose names
    differ. Vectors whose indices are written in another style (`x_1` for `x[1]`) need no pair.

    Parameters of the former FMU that the new FMU also has retain their values. Values in the table
    `[alternatives]` of the system for the model name of the new FMU override these. If the table
    has no entry for the model name, a warning names the parameters that are dropped. Raises
    UsageError (unknown component, FMU or port), FmuError, or StructureError with all missing ports.
    """
    new = _Exchange(system, existing(system, "--swap", name), find_fmu(fmu), given)
    connections = tuple(new.connections())
    rest = tuple(a for a in system.alternatives if a.component != name)
    return replace(new.system_with_values(), connections=connections, alternatives=rest)


def existing(system: System, option: str, name: str) -> str:
    """Return the name of a component unchanged if it exists, else raise UsageError. option: option
    of the command line, with which the error message begins.
    """
    known = [c.name for c in system.components]
    if name not in known:
        close = did_you_mean(name, known)
        raise UsageError(f"{option} {name}: {system.name} has no such component{close}")
    return name


class _Exchange:
    """Replacement of the FMU of a component. names: name of a port in the system by its name in the
    new FMU, if the names differ.
    """

    def __init__(
        self, system: System, name: str, path: Path, given: Sequence[tuple[str, str]]
    ) -> None:
        self.system, self.name, self.path = system, name, path
        self.before = read_interfaces(system)
        self.interface = read_interface(path)
        self.interfaces = {**self.before, name: self.interface}
        self.ports = _ports(self.interface)
        others = (i for component, i in self.before.items() if component != name)
        outputs = {n: v for interface in others for n, v in interface.outputs().items()}
        self.signals = {**outputs, **_ports(self.before[name])}
        """Variables to which ports of the FMU can be mapped: ports of the former FMU, outputs of
        the other components.
        """
        self.names = self._names(given)

    # ---- names

    def _names(self, given: Sequence[tuple[str, str]]) -> mapping.Names:
        ours = {**self.signals, **self.before[self.name].settable()}
        theirs = {**self.ports, **self.interface.settable()}
        try:
            names = mapping.given_names(given, self.ports, self.signals)
        except ValueError as error:
            raise UsageError(f"--map {error}") from None
        styled = mapping.by_style(theirs, ours)
        taken = {a: b for a, b in styled.items() if not names.keys() & set(a.elements)}
        self._say_styled(taken)
        for a, b in taken.items():
            names |= zip(a.elements, b.elements, strict=True)
        return names

    def _say_styled(self, taken: Mapping[mapping.Family, mapping.Family]) -> None:
        shown = some([f"{a.elements[0]}.. for {b.elements[0]}.." for a, b in taken.items()])
        note = "%s: %s writes indices in another style than the system; connected as: %s"
        if taken:
            _log.warning(note, self.name, self.path.name, shown)

    def _offered(self) -> list[str]:
        """Return a list of one line with the ports of the new FMU that match no signal of the
        system, [] if all ports match.
        """
        free = mapping.families([n for n in self.ports if self.names.get(n, n) not in self.signals])
        line = f"its ports {', '.join(free)} match no signal; connect each by --map PORT=SIGNAL"
        return [line] if free else []

    # ---- connections

    def connections(self) -> list[Connection]:
        """Return the connections of the system with the new FMU; raise StructureError with all
        missing ports.
        """
        connections, problems = self._rewired()
        problems += self._missing_outputs(connections)
        if problems:
            problems += self._offered()
            place = f"--swap {self.name}={self.path.name}"
            raise StructureError(f"{place}: {problem}" for problem in problems)
        return connections

    def _missing_outputs(self, connections: Sequence[Connection]) -> Iterator[str]:
        """Yield a line per output that another component reads and that the new FMU lacks or has in
        another unit.
        """
        offered = self.interface.outputs()
        for source, target, hops in connections:
            if source.component != self.name:
                continue
            reader = f"{target.component}.{target.signal}"
            if source.variable not in offered:
                yield f"it has no output {source.signal}, which {reader} needs"
                continue
            unit = offered[source.variable].unit
            required = self.interfaces[target.component].variables[target.variable].unit
            if not hops and not units_agree(unit, required):
                yield f"its output {source.signal} is in {unit}, {reader} expects {required}"

    def _rewired(self) -> tuple[list[Connection], list[str]]:
        """Return the connections with the ports of the new FMU, and an error message per input of
        the new FMU that needs a connection and has none.
        """
        connections, problems = list(self._renamed()), []
        driven = {c.target for c in connections}
        given = self.system.component(self.name).parameters
        owners = output_owners(self.interfaces)
        for variable, port in self.interface.named("input").items():
            ours = Port(self.name, self.names.get(variable, variable))
            target = Port(self.name, variable)
            if target in driven or ours.variable in given:
                continue
            sources = drivers(owners, ours)
            if len(sources) == 1:
                connections.append(Connection(sources[0], target))
            elif self.system.strict and (sources or not port.optional):
                fault = ambiguous(sources) if sources else "no output of this name drives it"
                problems.append(f"its input {target.signal}: {fault}")
        return connections, problems

    def _renamed(self) -> Iterator[Connection]:
        """Yield the connections of the system with the names of ports in the new FMU. A connection
        to an input of the former FMU is repeated for every input of the new FMU that is mapped to
        this input, and dropped if the new FMU has no such input.
        """
        outputs = self.interface.outputs()
        theirs = {our: their for their, our in self.names.items() if their in outputs}
        readers: dict[str, list[str]] = {}
        for variable in self.interface.named("input"):
            readers.setdefault(self.names.get(variable, variable), []).append(variable)
        for c in self.system.connections:
            source, targets = c.source, [c.target]
            if source.component == self.name:
                source = Port(self.name, theirs.get(source.variable, source.variable))
            if c.target.component == self.name:
                targets = [Port(self.name, v) for v in readers.get(c.target.variable, ())]
            yield from (c._replace(source=source, target=target) for target in targets)

    # ---- parameters

    def system_with_values(self) -> System:
        """Return the system with the new FMU and values for its parameters.

        A value that the system has for a parameter of the former FMU is retained, under the name in
        the new FMU, if the new FMU has this parameter. Values in the [alternatives] of the system
        for the new FMU override retained values.
        """
        theirs = {our: their for their, our in self.names.items()}
        known = self.interface.settable()
        place = self.name, self.interface.model.modelName
        prepared = [a for a in self.system.alternatives if (a.component, a.fmu) == place]
        if not prepared:
            self._warn_of_dropped(theirs)

        def changed(component: str, values: Parameters) -> Parameters:
            if component == self.name:
                renamed = {theirs.get(n, n): value for n, value in values.items()}
                values = {n: value for n, value in renamed.items() if n in known}
            for alternative in prepared:
                values = {**values, **alternative.parameters.get(component, {})}
            return values

        components = tuple(
            replace(c, parameters=changed(c.name, c.parameters)) for c in self.system.components
        )
        sets = tuple(
            replace(s, parameters={c: changed(c, values) for c, values in s.parameters.items()})
            for s in self.system.sets
        )
        fmus = tuple(replace(c, fmu=self.path) if c.name == self.name else c for c in components)
        return replace(self.system, components=fmus, sets=sets)

    def _warn_of_dropped(self, theirs: Mapping[str, str]) -> None:
        old, before = self.system.component(self.name), self.before[self.name]
        optional = (n for n, v in before.variables.items() if v.optional)
        known = {*self.interface.settable(), *optional}
        names = (theirs.get(p, p) for p in old.parameters)
        dropped = list(dict.fromkeys(base(p).partition(".")[0] for p in names if p not in known))
        if dropped:
            note = "%s: %s does not have these parameters of %s: %s"
            _log.warning(note, old.name, self.path.name, old.fmu.stem, some(dropped))


def _ports(interface: Interface) -> dict[str, Variable]:
    return {**interface.named("input"), **interface.outputs()}
