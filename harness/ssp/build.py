# SPDX-License-Identifier: BSD-2-Clause
"""Build of an .ssp from the TOML file of a system: components connected by name, one table of
parameters per component, all checks.

    python -m harness.ssp.build SYSTEM.toml --fmus FOLDER -o SYSTEM.ssp

All problems are reported at once: unknown names, inputs without a source or with several, unequal
units of connected variables, values in a shape that their variable does not have.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta, Struct, convert, structs

from harness.errors import HarnessError, StructureError, UsageError
from harness.mission.exchange import of_system
from harness.results import requirements
from harness.spelling import did_you_mean
from harness.ssp.extends import extended
from harness.ssp.writer import write_ssp
from harness.system import graph, problems, sliders
from harness.system.instants import date
from harness.system.interface import Interfaces, read_interface
from harness.system.model import (
    Alternative,
    Component,
    Experiment,
    Parameters,
    ParameterSet,
    Port,
    System,
)
from harness.system.schedule import macro_steps
from harness.system.swap import exchange
from harness.system.tables import Assignments, Count, Number, Text, Whole
from harness.system.tables import problems as table_problems
from harness.system.wiring import split, wire

# ---- tables and entries of a TOML file


class Time(Struct, frozen=True):
    """Time span and macro step of a run [s], `[experiment]`. every: default number of macro steps
    per recorded row; epoch: UTC at t = 0, a TOML date or its text.
    """

    start: Number = 0.0
    stop: Number | None = None
    step: Number | None = None
    algorithm: Text = "gauss-seidel"
    every: Count = 1
    epoch: Any = ""


class Timing(Struct, frozen=True):
    """Step period and latency of a component in macro steps, `[schedule.COMPONENT]`."""

    every: Count = 1
    latency: Whole = 0


class SetTime(Struct, frozen=True):
    """Stop time and macro step [s] of a parameter set, `[sets.NAME.experiment]`."""

    stop: Number | None = None
    step: Number | None = None


class Set(Struct, frozen=True):
    """Entries of a parameter set `[sets.NAME]` that are not parameters of components."""

    description: Text = ""
    experiment: SetTime = SetTime()


class Replacement(Struct, frozen=True):
    """Entries of `[alternatives.FMU]` that are not parameters; replaces: the component whose place
    the FMU may take.
    """

    replaces: Text


class Compared(Struct, frozen=True):
    """Settings of `harness compare`, `[compare]`."""

    set: Text = ""


SLIDER = "[least, largest], or [] for the range in the FMU"
"""Form of the range of a slider."""


class Live(Struct, frozen=True):
    """Parameters that the reader of a live page may change, `[live]`."""

    sliders: dict[str, Annotated[list[Number], Meta(max_length=2, description=SLIDER)]] = {}


class Source(Struct, frozen=True):
    """All tables and entries of the TOML file of a system."""

    name: Annotated[str, Meta(min_length=1, description="a name")]
    experiment: Time
    components: dict[str, Text]
    description: Text = ""
    mission: Text = ""
    extends: Text = ""
    without: list[Text] = []
    schedule: dict[str, Timing] = {}
    connections: dict[str, Text] = {}
    open: dict[str, Any] = {}
    parameters: dict[str, Any] = {}
    start: dict[str, Text] = {}
    sets: dict[str, dict[str, Any]] = {}
    alternatives: dict[str, dict[str, Any]] = {}
    requirements: dict[str, Text] = {}
    consistency: dict[str, Text] = {}
    compare: Compared = Compared()
    live: Live = Live()


def _parted(table: Mapping[str, Any], kind: type[Struct]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Split a table into the entries that `kind` defines, and all other entries, which are
    parameters.
    """
    head = {key: value for key, value in table.items() if key in kind.__struct_fields__}
    return head, {key: value for key, value in table.items() if key not in head}


def system_of(source: Mapping[str, Any], fmus: Mapping[str, Path]) -> System:
    """Return the system that the content of a TOML file describes; fmus: paths of FMUs by name.

    Raises FmuError, or StructureError with all problems.
    """
    if found := list(table_problems(source, Source)) or list(_ill_formed(source, fmus)):
        raise StructureError(found)
    tables = convert(source, Source)
    system = _Builder(tables, fmus).system()
    dated = system.starts or system.experiment.epoch
    return _Builder(_begun(tables, system), fmus).system() if dated else system


def _ill_formed(source: Mapping[str, Any], fmus: Mapping[str, Path]) -> Iterator[str]:
    """Yield the problems of names, FMUs and parameter sets that prevent a system from being
    built.
    """
    for name in source["components"]:
        if not (name.isidentifier() and name.isascii()):
            yield f"{name}: the name of a component must be a C identifier"
    others = {f"alternatives.{fmu}": fmu for fmu in source.get("alternatives", {})}
    for name, fmu in {**source["components"], **others}.items():
        if fmu not in fmus:
            yield f"{name}: there is no FMU {fmu}{did_you_mean(fmu, fmus)}"
    for tables, kind in (("sets", Set), ("alternatives", Replacement)):
        for name, table in source.get(tables, {}).items():
            yield from table_problems(_parted(table, kind)[0], kind, f"{tables}.{name}")


def _begun(tables: Source, system: System) -> Source:
    """Return the tables of a system with the parameters and the epoch that the files in its table
    `[start]` and its epoch give; raise HarnessError if a file cannot be used.
    """
    values, _, epoch = of_system(system)
    parameters = {c: dict(own) for c, own in tables.parameters.items()}
    for name, value in values.items():
        component, _, parameter = name.partition(".")
        parameters.setdefault(component, {})[parameter] = value
    experiment = structs.replace(tables.experiment, epoch=epoch)
    return structs.replace(tables, parameters=parameters, experiment=experiment)


class _Builder:
    """Builder of a system from its tables, which collects all problems and raises them together."""

    def __init__(self, source: Source, fmus: Mapping[str, Path]) -> None:
        self.source = source
        self.fmus = fmus
        self.problems: list[str] = []
        timing = {name: source.schedule.get(name, Timing()) for name in source.components}
        self.bare = tuple(
            Component(name, fmus[fmu], every=timing[name].every, latency=timing[name].latency)
            for name, fmu in source.components.items()
        )
        self.interfaces: Interfaces = graph.read_interfaces(
            System(source.name, self.bare, (), Experiment())
        )

    def system(self) -> System:
        source, left_open = self.source, self._open()
        ports = [Port(c, name) for c, given in left_open.parameters.items() for name in given]
        wiring = wire(self.interfaces, source.connections, ports)
        given = self._assignments(source.parameters, "parameters")
        components = tuple(
            replace(c, parameters=given.over(c.name, left_open.parameters[c.name]))
            for c in self.bare
        )
        system = System(
            name=source.name,
            description=source.description,
            components=components,
            connections=tuple(wiring.connections),
            experiment=Experiment(**{**structs.asdict(source.experiment), "epoch": self._epoch()}),
            sets=tuple(self._set(name, components) for name in source.sets),
            strict=True,
            requirements=source.requirements,
            consistency=source.consistency,
            compared=source.compare.set,
            sliders={
                name: (r[0], r[-1]) if r else (None, None)
                for name, r in source.live.sliders.items()
            },
            starts=source.start,
            mission=source.mission,
            without=tuple(source.without),
        )
        self._check(system, wiring.problems)
        return replace(system, alternatives=tuple(self._alternatives(system)))

    def _open(self) -> Assignments:
        """Return the values of the unconnected inputs, from the table `[open]`."""
        values = Assignments(self.interfaces)
        for name, value in self.source.open.items():
            try:
                component, variable = split(name, self.interfaces)
            except ValueError as error:
                values.problems.append(str(error))
                continue
            values.set(component, variable, value, known=self.interfaces[component].named("input"))
        self._note("open", values.problems)
        return values

    def _assignments(self, tables: Mapping[str, Any], place: str) -> Assignments:
        values = Assignments(self.interfaces)
        values.tables(tables)
        self._note(place, values.problems)
        return values

    def _note(self, place: str, problems: Iterable[str]) -> None:
        self.problems += [f"{place}.{problem}" for problem in problems]

    def _epoch(self) -> str:
        """Return UTC at t = 0 as text, from a text or a TOML date, which may have an offset from
        UTC.
        """
        given = self.source.experiment.epoch
        if isinstance(given, datetime):
            given = (given.astimezone(UTC) if given.tzinfo else given).isoformat().partition("+")[0]
        try:
            return date(str(given))
        except ValueError as error:
            self.problems.append(f"experiment.epoch: {error}, not {given!r}")
            return ""

    def _set(self, name: str, components: Sequence[Component]) -> ParameterSet:
        """Return a named parameter set: the default parameters, overridden by the tables of the
        set.
        """
        head, tables = _parted(self.source.sets[name], Set)
        about, overrides = convert(head, Set), self._assignments(tables, f"sets.{name}")
        parameters: dict[str, Parameters] = {
            c.name: given for c in components if (given := overrides.over(c.name, c.parameters))
        }
        stop, step = about.experiment.stop, about.experiment.step
        return ParameterSet(name, about.description, parameters, stop, step)

    # ---- checks

    def _check(self, system: System, wiring: Sequence[str]) -> None:
        """Check the finished system, and raise StructureError with all problems found so far."""
        self._note("schedule", _unknown(self.source.schedule, self.interfaces))
        self._note("without", _unknown(system.without, self.interfaces))
        self._note("compare", _unknown(filter(None, [system.compared]), self.source.sets))
        self._note("live.sliders", sliders.problems(system.sliders, self.interfaces))
        self._note("requirements", requirements.rejected(system, system.requirements))
        self._note("consistency", requirements.rejected(system, system.consistency, fixed=True))
        further = problems.problems(system, self.interfaces)
        if found := [*wiring, *self.problems, *further]:
            raise StructureError(found)
        macro_steps(system.experiment, [c.every for c in system.components])

    def _alternatives(self, system: System) -> Iterator[Alternative]:
        """Yield the entries of `[alternatives]`, after a check that each FMU fits into the place of
        the component it replaces; raise StructureError with all mismatches.
        """
        problems = []
        for fmu, table in self.source.alternatives.items():
            try:
                yield self._alternative(system, fmu, table)
            except (StructureError, UsageError) as error:
                problems += [f"alternatives.{fmu}: {line}" for line in str(error).splitlines()]
        if problems:
            raise StructureError(problems)

    def _alternative(self, system: System, fmu: str, table: Mapping[str, Any]) -> Alternative:
        """Return the parameters that apply when the FMU named `fmu` takes the place of a component.

        table: the entry of `[alternatives]`, which names the component under `replaces`.
        """
        head, tables = _parted(table, Replacement)
        place, path = head["replaces"], self.fmus[fmu]
        values = Assignments({**self.interfaces, place: read_interface(path)})
        values.tables(tables)
        given = {name: own for name, own in values.parameters.items() if own}
        found = Alternative(place, fmu, given)
        changed = exchange(replace(system, alternatives=(found,)), place, path)
        if values.problems:
            raise StructureError(values.problems)
        graph.build_graph(changed)
        return found


def _unknown(names: Iterable[str], known: Collection[str]) -> Iterator[str]:
    """Yield an error line for every name that is not among the known names."""
    for name in names:
        if name not in known:
            yield f"{name}: the system defines no such name{did_you_mean(name, known)}"


def read(source: Path, fmus: Mapping[str, Path]) -> System:
    """Return the system of a TOML file. fmus: paths of FMUs by name; any other FMU is given in the
    file by its path relative to the file. Raises HarnessError.
    """
    try:
        table = extended(source)
        named = (str(fmu) for fmu in dict(table.get("components") or {}).values())
        own = {n: source.parent / n for n in named if n.endswith(".fmu")}
        return system_of(table, {**fmus, **{n: p for n, p in own.items() if p.is_file()}})
    except StructureError as error:
        raise StructureError(
            f"{source.name}: {problem.removeprefix(f'{source}: ')}" for problem in error.problems
        ) from error


def build(source: Path, fmus: Path, output: Path) -> None:
    """Write the system of a TOML file as an .ssp, with the FMUs of the folder `fmus`; raise
    HarnessError.
    """
    known = {path.stem: path for path in sorted(fmus.glob("*.fmu"))}
    system = read(source, known)
    if system.without:
        left_out = ", ".join(system.without)
        line = f"{source.name}: leaves out {left_out}; only `harness export` leaves out components"
        raise StructureError([line])
    write_ssp(system, output)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line of the build and return the exit status 0, 1 or 2."""
    parser = argparse.ArgumentParser(
        prog="python -m harness.ssp.build", description="Build an .ssp from each TOML system."
    )
    parser.add_argument("toml", type=Path, nargs="+", help="descriptions of systems")
    parser.add_argument("--fmus", type=Path, required=True, help="folder with the FMUs")
    parser.add_argument(
        "-o", "--output", type=Path, nargs="+", required=True, help="one .ssp path for each TOML"
    )
    options = parser.parse_args(arguments)
    if len(options.toml) != len(options.output):
        parser.error("-o: expected as many .ssp paths as TOML files")
    status = 0
    for source, output in zip(options.toml, options.output, strict=True):
        try:
            build(source, options.fmus, output)
        except HarnessError as error:
            print(error, file=sys.stderr)
            status = max(status, error.exit_status)
    return status


if __name__ == "__main__":
    sys.exit(main())
