# SPDX-License-Identifier: BSD-2-Clause
"""From ssp/*.toml to .ssp: components wired by name, parameters in one table per component,
everything checked.

    python -m harness.ssp.build SYSTEM.toml --fmus FOLDER -o SYSTEM.ssp

All problems are reported at once: unknown names, inputs without a driver or with several, unequal
units, ill-shaped values.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from harness.errors import HarnessError, StructureError, UsageError
from harness.files.paths import is_file
from harness.mission.exchange import of_system
from harness.results import requirements
from harness.spelling import did_you_mean
from harness.ssp.extends import MODELS, extended
from harness.ssp.writer import write_ssp
from harness.system import graph, problems, sliders
from harness.system.instants import moment, written
from harness.system.interface import Interface
from harness.system.model import (
    Alternative,
    Component,
    Experiment,
    Parameters,
    ParameterSet,
    Port,
    Range,
    System,
)
from harness.system.schedule import macro_steps
from harness.system.swap import exchange
from harness.system.tables import Assignments
from harness.system.wiring import Wiring, split, wire

SHAPES = {
    "name": "text",
    "mission": "",
    "extends": "",
    "description": "text",
    "experiment": "table",
    "components": "texts",
    "schedule": "tables",
    "connections": "texts",
    "open": "table",
    "parameters": "tables",
    "start": "texts",
    "sets": "tables",
    "alternatives": "tables",
    "requirements": "texts",
    "consistency": "texts",
    "compare": "texts",
    "fly": "tables",
    "scene": "tables",
}
"""What a system may have: a text, a table of anything, of texts, or of tables; "": not judged."""

KEYS = {
    "": tuple(SHAPES),
    "experiment": ("start", "stop", "step", "algorithm", "every", "epoch"),
    "schedule": ("every", "latency"),
    "set": ("description", "experiment"),
    "compare": ("set",),
    "fly": ("sliders",),
    "scene": (MODELS,),
    "set experiment": ("stop", "step"),
}
"""Keys that the tables of a system may have."""


def system_of(source: Mapping[str, Any], fmus: Mapping[str, Path]) -> System:
    """The system that a TOML describes; fmus: paths by name. Raises FmuError or StructureError with
    all problems.
    """
    if found := list(_misshapen(source)) or list(_ill_formed(source, fmus)):
        raise StructureError(found)
    system = _Builder(source, fmus).system()
    return _Builder(_begun(source, system), fmus).system() if system.starts else system


def _begun(table: Mapping[str, Any], system: System) -> dict[str, Any]:
    """The tables of a system with the values of its `starts` among the parameters, and with its
    epoch; HarnessError.
    """
    values, _, epoch = of_system(system)
    parameters = {c: dict(own) for c, own in table.get("parameters", {}).items()}
    for name, value in values.items():
        component, _, parameter = name.partition(".")
        parameters.setdefault(component, {})[parameter] = value
    experiment = {**table["experiment"], "epoch": epoch}
    return {**table, "parameters": parameters, "experiment": experiment}


def _misshapen(source: Mapping[str, Any]) -> Iterator[str]:
    """What is a table and should be a value, or the other way round."""
    for key, shape in SHAPES.items():
        value = source.get(key, "" if shape == "text" else {})
        if shape == "text" and not isinstance(value, str):
            yield f"{key}: must be a text"
        elif shape not in ("", "text") and not isinstance(value, Mapping):
            yield f"[{key}]: must be a table"
        elif shape in ("texts", "tables"):
            for entry, inner in value.items():
                yield from _misshapen_entry(key, entry, inner)


def _misshapen_entry(key: str, entry: str, value: Any) -> Iterator[str]:
    """The same for what stands in a table of texts or tables."""
    kind: Any = str if SHAPES[key] == "texts" else Mapping
    if not isinstance(value, kind):
        yield f"[{key}] {entry}: must be a {SHAPES[key].removesuffix('s')}"
    elif key in ("sets", "alternatives"):
        if not isinstance(value.get("experiment", {}), Mapping):
            yield f"[{key}.{entry}] experiment: must be a table"
        for text in ("description", "replaces"):
            if not isinstance(value.get(text, ""), str):
                yield f"[{key}.{entry}] {text}: must be a text"


def _ill_formed(source: Mapping[str, Any], fmus: Mapping[str, Path]) -> Iterator[str]:
    """Problems that make it pointless to look further."""
    for key in ("name", "experiment", "components"):
        if not source.get(key):
            yield f"there is no [{key}] table or value"
    yield from _unknown_keys("", source, KEYS[""])
    for name, fmu in source.get("components", {}).items():
        if not (name.isidentifier() and name.isascii()):
            yield f"{name}: the name of a component must be a C identifier"
        if fmu not in fmus:
            yield f"{name}: there is no FMU {fmu}{did_you_mean(fmu, fmus)}"


def _unknown_keys(place: str, table: Mapping[str, Any], known: Collection[str]) -> Iterator[str]:
    for key in (key for key in table if key not in known):
        yield f"{place}unknown key {key}{did_you_mean(key, known)}"


def _is_number(value: Any) -> bool:
    """Whether a value is a number that a double can hold."""
    try:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        return is_number and math.isfinite(value)
    except OverflowError:  # an integer beyond all doubles
        return False


class _Builder:
    """One pass over the tables of a system that collects problems instead of stopping at the
    first.
    """

    def __init__(self, source: Mapping[str, Any], fmus: Mapping[str, Path]) -> None:
        self.source = source
        self.fmus = fmus
        self.problems: list[str] = []
        self.bare = tuple(
            self._component(name, fmus[fmu]) for name, fmu in source["components"].items()
        )
        self.interfaces: Mapping[str, Interface] = graph.read_interfaces(
            System(source["name"], self.bare, (), Experiment())
        )

    # ---- tables and numbers

    def _table(self, *place: str, known: Collection[str] = ()) -> Mapping[str, Any]:
        """The table at a place; known: its keys, by default those of KEYS, others are problems."""
        table = self.source
        for key in place:
            table = table.get(key, {})
        known = known or KEYS[place[0]]
        self.problems += _unknown_keys(f"[{'.'.join(place)}]: ", table, known)
        return table

    def _numbers(self, place: str, table: Mapping[str, Any], *keys: str) -> list[float | None]:
        """Numbers by their keys, None where there is none."""
        for key in keys:
            if table.get(key) is not None and not _is_number(table[key]):
                self.problems.append(f"[{place}] {key}: {table[key]!r} is not a number")
        return [float(table[key]) if _is_number(table.get(key)) else None for key in keys]

    def _assignments(self, tables: Mapping[str, Any], place: str) -> Assignments:
        values = Assignments(self.interfaces)
        values.tables(tables)
        self.problems += [f"[{place}] {problem}" for problem in values.problems]
        return values

    # ---- the system

    def system(self) -> System:
        left_open = self._open()
        ports = [Port(c, name) for c, given in left_open.parameters.items() for name in given]
        explicit = list(self.source.get("connections", {}).items())
        wiring = wire(self.interfaces, explicit, ports)
        components = self._components(left_open)
        system = System(
            name=self.source["name"],
            description=self.source.get("description", ""),
            components=components,
            connections=tuple(wiring.connections),
            experiment=self._experiment(),
            sets=tuple(self._set(name, components) for name in self.source.get("sets", {})),
            strict=True,
            requirements=self.source.get("requirements", {}),
            consistency=self.source.get("consistency", {}),
            compared=self._compared(),
            sliders=self._sliders(),
            starts=self.source.get("start", {}),
            mission=self.source.get("mission", ""),
        )
        self._judge(system, wiring)
        return replace(system, alternatives=tuple(self._alternatives(system)))

    def _component(self, name: str, fmu: Path) -> Component:
        table = self._table("schedule", name)
        every, latency = self._numbers(f"schedule.{name}", table, "every", "latency")
        every = 1 if every is None else every
        return Component(name, fmu, every=round(every), latency=round(latency or 0))

    def _components(self, left_open: Assignments) -> tuple[Component, ...]:
        """The components with their parameters."""
        given = self._assignments(self.source.get("parameters", {}), "parameters")
        return tuple(
            replace(c, parameters=given.over(c.name, left_open.parameters[c.name]))
            for c in self.bare
        )

    def _open(self) -> Assignments:
        """Values of the inputs that nobody drives."""
        values = Assignments(self.interfaces)
        for name, value in self.source.get("open", {}).items():
            try:
                component, variable = split(name, self.interfaces)
            except ValueError as error:
                self.problems.append(f"[open] {error}")
                continue
            values.set(component, variable, value, known=self.interfaces[component].named("input"))
        self.problems += [f"[open] {problem}" for problem in values.problems]
        return values

    def _experiment(self) -> Experiment:
        table = self._table("experiment")
        self._table("schedule", known=self.interfaces)
        start, stop, step, every = self._numbers(
            "experiment", table, "start", "stop", "step", "every"
        )
        if every is not None and (every < 1 or every != round(every)):
            self.problems.append(f"[experiment] every: {every:g} is not a whole number from 1 on")
        algorithm, epoch = str(table.get("algorithm", "gauss-seidel")), self._epoch(table)
        return Experiment(start or 0.0, stop, step, algorithm, round(every or 1), epoch)

    def _epoch(self, table: Mapping[str, Any]) -> str:
        """UTC of t = 0, a text or a date of TOML, which may have an offset."""
        given = table.get("epoch", "")
        if isinstance(given, datetime):
            given = (given.astimezone(UTC) if given.tzinfo else given).isoformat().partition("+")[0]
        try:
            return written(moment(str(given))) if given else ""
        except ValueError as error:
            self.problems.append(f"[experiment] epoch: {given!r}: {error}")
            return ""

    def _set(self, name: str, components: Sequence[Component]) -> ParameterSet:
        """A named set: the default parameters with the tables of the set put over them."""
        table, place = self.source["sets"][name], f"sets.{name}"
        values = {key: value for key, value in table.items() if key not in KEYS["set"]}
        overrides = self._assignments(values, place)
        experiment = self._table("sets", name, "experiment", known=KEYS["set experiment"])
        stop, step = self._numbers(f"{place}.experiment", experiment, "stop", "step")
        parameters: dict[str, Parameters] = {
            c.name: given for c in components if (given := overrides.over(c.name, c.parameters))
        }
        return ParameterSet(name, table.get("description", ""), parameters, stop, step)

    def _compared(self) -> str:
        """The set that a comparison takes."""
        name, sets = str(self._table("compare").get("set", "")), self.source.get("sets", {})
        if name and name not in sets:
            self.problems.append(f"[compare] set: there is no set {name}{did_you_mean(name, sets)}")
        return name

    def _sliders(self) -> dict[str, Range]:
        """What `[fly] sliders` names, with a range each; [] takes that of the FMU."""
        found: dict[str, Range] = {}
        refused = []
        for name, given in self._table("fly").get("sliders", {}).items():
            if given == []:
                found[name] = (None, None)
            elif isinstance(given, list) and len(given) == 2 and all(map(_is_number, given)):
                found[name] = (float(given[0]), float(given[1]))
            else:
                refused.append(f"{name}: expected [least, largest], got {given}")
        refused += sliders.problems(found, self.interfaces)
        self.problems += [f"[fly] sliders {problem}" for problem in refused]
        return found

    # ---- what is wrong with it

    def _judge(self, system: System, wiring: Wiring) -> None:
        """Raise everything that was found; open inputs that the wiring has already spoken of are
        not repeated.
        """
        for place, texts in (
            ("requirements", system.requirements),
            ("consistency", system.consistency),
        ):
            refused = requirements.refused(system, texts, fixed=place == "consistency")
            self.problems += [f"[{place}] {problem}" for problem in refused]
        self.problems += [f"[scene.{MODELS}] {problem}" for problem in self._odd_models()]
        further = problems.problems(replace(system, strict=not wiring.problems), self.interfaces)
        unequal = problems.unequal_units(system, self.interfaces)
        if found := [*wiring.problems, *self.problems, *further, *unequal]:
            raise StructureError(found)
        macro_steps(system.experiment, [c.every for c in system.components])

    def _odd_models(self) -> Iterator[str]:
        """Models of bodies: files beside the TOML, which only a report reads."""
        for name, given in self._table("scene").get(MODELS, {}).items():
            if name not in self.interfaces:
                yield f"{name}: there is no such component{did_you_mean(name, self.interfaces)}"
            elif not (isinstance(given, str) and given.endswith((".glb", ".gltf"))):
                yield f"{name}: expected a file .glb or .gltf"
            elif not is_file(given):
                yield f"{name}: {given}: no such file"

    def _alternatives(self, system: System) -> Iterator[Alternative]:
        """Parameters for other FMUs, each tried in its place; StructureError with what does not
        fit.
        """
        problems = []
        for fmu, table in self.source.get("alternatives", {}).items():
            try:
                yield alternative(system, fmu, table, self.fmus)
            except (StructureError, UsageError) as error:
                problems += [f"[alternatives.{fmu}] {line}" for line in str(error).splitlines()]
        if problems:
            raise StructureError(problems)


def alternative(
    system: System, fmu: str, table: Mapping[str, Any], fmus: Mapping[str, Path]
) -> Alternative:
    """Parameters for another FMU in the place of the component that the table `replaces`, tried
    there.
    """
    if fmu not in fmus:
        raise StructureError([f"there is no such FMU{did_you_mean(fmu, fmus)}"])
    if not (place := table.get("replaces")):
        raise StructureError(["replaces: it does not say which component"])
    changed = exchange(replace(system, alternatives=(Alternative(place, fmu),)), place, fmus[fmu])
    values = Assignments(graph.read_interfaces(changed))
    values.tables({key: value for key, value in table.items() if key != "replaces"})
    if values.problems:
        raise StructureError(values.problems)
    found = Alternative(
        place, fmu, {name: given for name, given in values.parameters.items() if given}
    )
    graph.build_graph(exchange(replace(system, alternatives=(found,)), place, fmus[fmu]))
    return found


def read(source: Path, fmus: Mapping[str, Path]) -> System:
    """The system of a TOML; fmus: paths by name, others by their path from it. HarnessError."""
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
    """Write the .ssp of a TOML with the FMUs of a folder. Raises HarnessError."""
    known = {path.stem: path for path in sorted(fmus.glob("*.fmu"))}
    write_ssp(read(source, known), output)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line of the build; exit status 0/1/2."""
    parser = argparse.ArgumentParser(
        prog="python -m harness.ssp.build", description="Build an .ssp from each TOML system."
    )
    parser.add_argument("toml", type=Path, nargs="+", help="descriptions of systems")
    parser.add_argument("--fmus", type=Path, required=True, help="folder with the FMUs")
    parser.add_argument(
        "-o", "--output", type=Path, nargs="+", required=True, help="the .ssp of each"
    )
    options = parser.parse_args(arguments)
    if len(options.toml) != len(options.output):
        parser.error("expected an -o for each system")
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
