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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from harness.errors import HarnessError, StructureError, UsageError
from harness.files.paths import is_file
from harness.mission.library import FILE, SYSTEM, systems, systems_in
from harness.results import requirements
from harness.spelling import did_you_mean
from harness.ssp import starts
from harness.ssp.writer import write_ssp
from harness.system import graph, problems, sliders
from harness.system.instants import moment, written
from harness.system.interface import Interface
from harness.system.model import (
    Alternative,
    Component,
    Experiment,
    ParameterSet,
    Port,
    Range,
    System,
)
from harness.system.schedule import macro_steps
from harness.system.swap import exchange
from harness.system.tables import Assignments, read_toml
from harness.system.wiring import Wiring, split, wire

MODELS = "models"
"""Key of the table of glTF files by body."""
KEYS = {
    "": (
        "name",
        "mission",
        "extends",
        "description",
        "experiment",
        "components",
        "schedule",
        "connections",
        "open",
        "parameters",
        "start",
        "sets",
        "alternatives",
        "requirements",
        "consistency",
        "compare",
        "fly",
        "scene",
    ),
    "experiment": ("start", "stop", "step", "algorithm", "every", "epoch"),
    "schedule": ("every", "latency"),
    "set": ("description", "experiment"),
    "compare": ("set",),
    "fly": ("sliders",),
    "scene": (MODELS,),
    "set experiment": ("stop", "step"),
}
"""Keys that the tables of a system may have."""

TABLES = (
    "experiment",
    "components",
    "schedule",
    "connections",
    "open",
    "parameters",
    "start",
    "sets",
    "requirements",
    "consistency",
    "compare",
    "fly",
    "scene",
)
TABLES_OF_TABLES = ("schedule", "parameters", "sets", "alternatives", "fly", "scene")
TABLES_OF_TEXTS = ("components", "connections", "start", "requirements", "consistency", "compare")


def system_of(source: Mapping[str, Any], fmus: Mapping[str, Path]) -> System:
    """The system that a TOML describes; fmus: paths by name. Raises FmuError or StructureError with
    all problems.
    """
    if found := _ill_formed(source, fmus):
        raise StructureError(found)
    system = _Builder(source, fmus).system()
    return _Builder(starts.begun(source, system), fmus).system() if system.starts else system


def _ill_formed(source: Mapping[str, Any], fmus: Mapping[str, Path]) -> list[str]:
    """Problems that make it pointless to look further."""
    if misshapen := list(_misshapen(source)):
        return misshapen
    found = [
        f"there is no [{key}] table or value"
        for key in ("name", "experiment", "components")
        if not source.get(key)
    ]
    found += _unknown_keys("", source, KEYS[""])
    for name, fmu in source.get("components", {}).items():
        if not (name.isidentifier() and name.isascii()):
            found.append(f"{name}: the name of a component must be a C identifier")
        if fmu not in fmus:
            found.append(f"{name}: there is no FMU {fmu}{did_you_mean(fmu, fmus)}")
    return found


def _misshapen(source: Mapping[str, Any]) -> Iterator[str]:
    """What is a table and should be a value, or the other way round."""
    yield from (
        f"{key}: must be a text" for key in ("name", "description") if _no_text(source, key)
    )
    tables = [k for k in (*TABLES, "alternatives") if k in source]
    for key in (key for key in tables if not isinstance(source[key], Mapping)):
        yield f"[{key}]: must be a table"
    for key, entry, value in (
        (k, e, v) for k in tables if isinstance(source[k], Mapping) for e, v in source[k].items()
    ):
        if key in TABLES_OF_TABLES and not isinstance(value, Mapping):
            yield f"[{key}] {entry}: must be a table"
        elif key in TABLES_OF_TEXTS and not isinstance(value, str):
            yield f"[{key}] {entry}: must be a text"
        elif key in ("sets", "alternatives"):
            if not isinstance(value.get("experiment", {}), Mapping):
                yield f"[{key}.{entry}] experiment: must be a table"
            texts = (k for k in ("description", "replaces") if _no_text(value, k))
            yield from (f"[{key}.{entry}] {text}: must be a text" for text in texts)


def _no_text(table: Mapping[str, Any], key: str) -> bool:
    return key in table and not isinstance(table[key], str)


def _unknown_keys(place: str, table: Mapping[str, Any], known: Sequence[str]) -> list[str]:
    where = f"[{place}]: " if place else ""
    return [
        f"{where}unknown key {key}{did_you_mean(key, known)}" for key in table if key not in known
    ]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and _is_finite(value)


def _is_finite(number: float) -> bool:
    try:
        return math.isfinite(number)
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

    def system(self) -> System:
        left_open = self._open()
        wiring = self._wiring(left_open)
        defaults = self._assignments(self.source.get("parameters", {}))
        components = tuple(
            replace(c, parameters=defaults.over(c.name, left_open.parameters[c.name]))
            for c in self.bare
        )
        system = System(
            name=self.source["name"],
            description=self.source.get("description", ""),
            components=components,
            connections=tuple(wiring.connections),
            experiment=self._experiment(),
            sets=tuple(
                self._set(name, table, components)
                for name, table in self.source.get("sets", {}).items()
            ),
            strict=True,
            requirements=self.source.get("requirements", {}),
            consistency=self.source.get("consistency", {}),
            compared=self._compared(),
            sliders=self._sliders(),
            starts=self.source.get("start", {}),
            mission=self.source.get("mission", ""),
        )
        for place, texts in (
            ("requirements", system.requirements),
            ("consistency", system.consistency),
        ):
            refused = requirements.refused(system, texts, fixed=place == "consistency")
            self.problems += [f"[{place}] {problem}" for problem in refused]
        self._models()
        self._finish(system, wiring)
        return replace(system, alternatives=tuple(self._alternatives(system)))

    def _compared(self) -> str:
        """The set that a comparison takes."""
        table, sets = self.source.get("compare", {}), self.source.get("sets", {})
        self.problems += _unknown_keys("compare", table, KEYS["compare"])
        name = str(table.get("set", ""))
        if name and name not in sets:
            self.problems.append(f"[compare] set: there is no set {name}{did_you_mean(name, sets)}")
        return name

    def _sliders(self) -> dict[str, Range]:
        """What `[fly] sliders` names, with a range each; [] takes that of the FMU."""
        table = self.source.get("fly", {})
        self.problems += _unknown_keys("fly", table, KEYS["fly"])
        ranges, found = table.get("sliders", {}), dict[str, Range]()
        for name, given in ranges.items():
            numbers = given if isinstance(given, list) and given else [None, None]
            if given != [] and not (len(numbers) == 2 and all(map(_is_number, numbers))):
                self.problems.append(
                    f"[fly] sliders {name}: expected [least, largest], got {given}"
                )
                continue
            low, high = (None if x is None else float(x) for x in numbers)
            found[name] = (low, high)
        self.problems += [
            f"[fly] sliders {problem}" for problem in sliders.problems(found, self.interfaces)
        ]
        return found

    def _models(self) -> None:
        """Models of bodies: files beside the TOML, which only a report reads."""
        table = self.source.get("scene", {})
        self.problems += _unknown_keys("scene", table, KEYS["scene"])
        for name, given in table.get(MODELS, {}).items():
            if name not in self.interfaces:
                hint = did_you_mean(name, self.interfaces)
                self.problems.append(f"[scene.{MODELS}] {name}: there is no such component{hint}")
            elif not (isinstance(given, str) and given.endswith((".glb", ".gltf"))):
                self.problems.append(f"[scene.{MODELS}] {name}: expected a file .glb or .gltf")
            elif not is_file(given):
                self.problems.append(f"[scene.{MODELS}] {name}: {given}: no such file")

    def _finish(self, system: System, wiring: Wiring) -> None:
        """Raise everything that was found; open inputs that the wiring has already spoken of are
        not repeated.
        """
        further = problems.problems(replace(system, strict=not wiring.problems), self.interfaces)
        unequal = problems.unequal_units(system, self.interfaces)
        if found := [*wiring.problems, *self.problems, *further, *unequal]:
            raise StructureError(found)
        macro_steps(system.experiment, [c.every for c in system.components])

    def _component(self, name: str, fmu: Path) -> Component:
        timing = self.source.get("schedule", {}).get(name, {})
        self.problems += _unknown_keys(f"schedule.{name}", timing, KEYS["schedule"])
        every, latency = (
            self._number(f"schedule.{name}", timing, key) for key in ("every", "latency")
        )
        return Component(
            name, fmu, every=round(1 if every is None else every), latency=round(latency or 0)
        )

    def _experiment(self) -> Experiment:
        table = self.source["experiment"]
        self.problems += _unknown_keys("experiment", table, KEYS["experiment"])
        self.problems += _unknown_keys(
            "schedule", self.source.get("schedule", {}), list(self.interfaces)
        )
        start, stop, step, every = (
            self._number("experiment", table, key) for key in ("start", "stop", "step", "every")
        )
        if every is not None and (every < 1 or every != round(every)):
            self.problems.append(f"[experiment] every: {every:g} is not a whole number from 1 on")
        algorithm = str(table.get("algorithm", "gauss-seidel"))
        return Experiment(
            start or 0.0, stop, step, algorithm, round(every or 1), self._epoch(table)
        )

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

    def _number(self, place: str, table: Mapping[str, Any], key: str) -> float | None:
        value = table.get(key)
        if value is None:
            return None
        if isinstance(value, int | float) and not isinstance(value, bool) and _is_finite(value):
            return float(value)
        self.problems.append(f"[{place}] {key}: {value!r} is not a number")
        return None

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

    def _wiring(self, left_open: Assignments) -> Wiring:
        ports = [
            Port(component, name)
            for component, values in left_open.parameters.items()
            for name in values
        ]
        return wire(self.interfaces, list(self.source.get("connections", {}).items()), ports)

    def _assignments(self, tables: Mapping[str, Any], place: str = "parameters") -> Assignments:
        values = Assignments(self.interfaces)
        values.tables(tables)
        self.problems += [f"[{place}] {problem}" for problem in values.problems]
        return values

    def _set(
        self, name: str, table: Mapping[str, Any], components: Sequence[Component]
    ) -> ParameterSet:
        """A named set: the default parameters with the tables of the set put over them."""
        values = {key: value for key, value in table.items() if key not in KEYS["set"]}
        overrides = self._assignments(values, f"sets.{name}")
        experiment = table.get("experiment", {})
        self.problems += _unknown_keys(
            f"sets.{name}.experiment", experiment, KEYS["set experiment"]
        )
        stop, step = (
            self._number(f"sets.{name}.experiment", experiment, key) for key in ("stop", "step")
        )
        parameters = {
            c.name: given for c in components if (given := overrides.over(c.name, c.parameters))
        }
        return ParameterSet(name, table.get("description", ""), parameters, stop, step)

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


def extended(source: Path, above: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Content of a TOML; one that `extends` another system is put over it. The mission of a system
    is its folder's, or that of the system it extends where its own folder has no Python.

    above: the files that extend this one.
    """
    table, mission = _read(source), source.resolve().parent.name
    if (base := table.get("extends")) is not None:
        path = _base(source, str(base))
        if path.resolve() in (chain := (*above, source.resolve())):
            raise StructureError([f"extends: {base} extends this system itself"])
        under = extended(path, chain)
        if not source.with_name(FILE).is_file():
            mission = under["mission"]
        table = _over({k: v for k, v in under.items() if k != "name"}, table)
    table.setdefault("name", _name(source))
    return table | {"mission": mission}


def _read(source: Path) -> dict[str, Any]:
    table, scene = read_toml(source), "scene"
    if "start" in table:
        table["start"] = starts.placed(table["start"], source)
    if isinstance(table.get(scene), Mapping):
        table[scene] = {k: starts.placed(v, source) for k, v in table[scene].items()}
    return table


def _name(source: Path) -> str:
    """The name of a system by its file: that of the mission's folder, and of the variant."""
    mission = source.resolve().parent.name
    return mission if source.name == SYSTEM else f"{mission}_{source.stem}"


def _base(source: Path, name: str) -> Path:
    """The TOML of the system that another one extends: of the same folder, of a mission beside it,
    or of any mission at hand.
    """
    folder = source.resolve().parent
    beside = [p for p in folder.parent.glob(f"*/{SYSTEM}") if p.parent != folder]
    known = {path.stem: path for path in sorted(folder.glob("*.toml"))}
    for mission in (folder, *(path.parent for path in beside)):
        known |= systems_in(mission)
    known = systems() | known
    if name not in known:
        raise StructureError([f"extends: there is no system {name}{did_you_mean(name, known)}"])
    return known[name]


def _over(base: Mapping[str, Any], own: Mapping[str, Any]) -> dict[str, Any]:
    """One table over another; in the order of the upper one where that names all there is, so that
    a component can be put between others (components run in their order).
    """
    merged = dict.fromkeys(own) | dict(base) if set(base) <= set(own) else dict(base)
    for key, value in own.items():
        under = base.get(key)
        both = isinstance(under, Mapping) and isinstance(value, Mapping)
        merged[key] = _over(under, value) if both else value  # type: ignore[arg-type]
    return merged


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
