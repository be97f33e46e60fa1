# SPDX-License-Identifier: BSD-2-Clause
"""Export of components as C functions without FMI: sources, tables of parameters, and reference
vectors (inputs and outputs of a run, with which the user compares the functions). The program
fmus/core/build/c_api.py writes the files.
"""

from __future__ import annotations

import json
import shlex
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np

from harness.authoring.build import compiler_command
from harness.errors import FmuError
from harness.files.output import PrivateFolder
from harness.master.changes import Changes, apply, set_names
from harness.master.fmu import Instance
from harness.master.simulation import Simulation
from harness.master.transfer import Transfer
from harness.ssp.library import load
from harness.studies.processor import groups
from harness.system.graph import Wire, build_graph
from harness.system.interface import unpacked_sources
from harness.system.model import DEFAULT_SET, System

STEPS = 100
"""Largest number of steps of a component in its reference vectors. One row, with the outputs of the
initialization, precedes the steps.
"""


def write_components(
    fmus: Sequence[str], folder: Path, place: str | None = None, compiler: str = "cc"
) -> list[str]:
    """Write the C interface of FMUs, given by name or path, into a folder, and return their names.

    place: `SYSTEM.COMPONENT` in which the FMU runs for the reference vectors and whose parameter
    sets are written (default: a system that has the FMU); compiler: command of a C compiler.
    Raises UsageError, FmuError, RunError.
    """
    parts: list[_Part] = []
    for group in groups(fmus, place):
        with load(group[0].system) as loaded:
            swap = {p.component: p.fmu for p in group if p.swapped}
            sets = [apply(loaded, params=name, swap=swap) for name in set_names(loaded)]
            parts += _parts(apply(loaded, swap=swap), [p.component for p in group], sets)
    return _write(parts, folder, compiler)


def write_system(
    system: str | Path | System, folder: Path, compiler: str = "cc", **changes: Unpack[Changes]
) -> list[str]:
    """Write the C interface of the flight software in a system to which the changes are applied,
    and return the names of its FMUs. compiler: command of a C compiler; changes: as for run().
    Raises the exceptions of run().
    """
    with load(system) as loaded:
        changed = apply(loaded, **changes)
        names = [component.name for component in changed.components]
        return _write(_parts(changed, names, [changed]), folder, compiler, "--flight")


class _Part(NamedTuple):
    """Component with its description `text`, one table of parameters per parameter set, and its
    reference vectors `run`.
    """

    fmu: Path
    text: str
    tables: list[dict[str, Any]]
    run: dict[str, Any]


def _parts(system: System, names: Sequence[str], sets: Sequence[System]) -> list[_Part]:
    """Return the named components of a system with tables and reference vectors; sets: the system
    with each of its parameter sets.
    """
    nodes = {node.component.name: node for node in build_graph(system).nodes}
    several = [nodes[name].interface.path for name in names]
    values = {label: dict(_values(each)) for each in sets for label in [_label(each)]}
    parts = []
    with Simulation(system) as simulation:
        runs = _runs(simulation, names)
        for name in names:
            node = nodes[name]
            alone = several.count(node.interface.path) == 1
            labels = {label: label if alone else f"{name}_{label}" for label in values}
            tables = [
                {"label": labels[label], "text": f"{system.name}.{name}, {label}",
                 "values": known[name]}
                for label, known in values.items()
            ]  # fmt: skip
            run = {"table": labels[_label(system)], "text": f"{system.name}.{name}", **runs[name]}
            about = str(node.interface.model.description)
            parts.append(_Part(node.interface.path, about, tables, run))
    return parts


def _label(system: System) -> str:
    return system.origin.params or DEFAULT_SET


def _values(system: System) -> Iterator[tuple[str, Mapping[str, float]]]:
    """Yield pairs of the name of a component and the values of all its parameters by name."""
    for node in build_graph(system).nodes:
        own: dict[str, Any] = {n: v.start for n, v in node.interface.named("parameter").items()}
        given = {s.variable.name: s.value for s in node.settings if s.variable.name in own}
        yield node.component.name, {n: float(value) for n, value in (own | given).items()}


def _runs(simulation: Simulation, names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Run a system for up to STEPS steps of each named component, and return by name of component a
    dict: step [s]; names of inputs and outputs; rows: start time of a step [s], values after it.
    """
    simulation.initialize()
    clock, found = simulation.clock, dict[str, dict[str, Any]]()
    chosen = (each for each in simulation.instances if each.name in names)
    readers = {each.name: _Reader(each, clock.start) for each in chosen}
    for name, reader in readers.items():
        h = reader.every * clock.step
        rows = [[clock.start, *reader.values()]]
        found[name] = {"step": h, "names": reader.names, "rows": rows}
    most = min(simulation.steps, STEPS * max(reader.every for reader in readers.values()))
    for k in range(most):
        simulation.advance(k + 1)
        for name, reader in readers.items():
            rows = found[name]["rows"]
            if k % reader.every == 0 and len(rows) <= STEPS:
                rows.append([reader.time, *reader.values()])
                reader.time = clock.time(k) + found[name]["step"]
    return found


class _Reader:
    """Reader of all inputs and outputs of an instance; time: end of the last recorded step of the
    instance, at first the start of the run [s].
    """

    def __init__(self, instance: Instance, time: float) -> None:
        interface = instance.node.interface
        variables = [*interface.named("input").values(), *interface.named("output").values()]
        self.names = [variable.name for variable in variables]
        self.every, self.time = instance.every, time
        wires = tuple(Wire(variable, i) for i, variable in enumerate(variables))
        self._get = Transfer(instance.calls, "GetReal", wires)

    def values(self) -> list[float]:
        bus = np.zeros(len(self.names))
        self._get.read(bus)
        return bus.tolist()


def _write(parts: Sequence[_Part], folder: Path, compiler: str, *options: str) -> list[str]:
    """Write the C interface of all parts into a folder by the program c_api.py, and return the
    names of its components; raise FmuError. Parts with the same FMU are written as one component,
    which has the tables and reference vectors of all of them.
    """
    found: dict[Path, dict[str, Any]] = {}
    core, command = compiler_command(compiler)
    with PrivateFolder() as place:
        for part in parts:
            if part.fmu not in found:
                sources = unpacked_sources(part.fmu, place / str(len(found)))
                found[part.fmu] = {
                    "name": sources[0].stem if sources else part.fmu.stem, "text": part.text,
                    "sources": list(map(str, sources)), "tables": [], "runs": [],
                }  # fmt: skip
            found[part.fmu]["tables"] += part.tables
            found[part.fmu]["runs"].append(part.run)
        spec = place / "spec.json"
        spec.write_text(json.dumps(list(found.values())), encoding="utf-8")
        tool = [sys.executable, str(core / "build" / "c_api.py"), str(spec), *options]
        tool += ["-o", str(folder), f"--cc={shlex.join(command)}"]
        done = subprocess.run(tool, capture_output=True, text=True, check=False)
    if done.returncode:
        raise FmuError(done.stderr.strip())
    return done.stdout.split()
