# SPDX-License-Identifier: BSD-2-Clause
"""Export of a whole system as one FMU by fmucontainer of fmu-manipulation-toolbox (an optional
dependency).

fmucontainer reads the connections of an .ssp but none of its values, so this module gives it the
assembly with all start values. It steps its FMUs like Jacobi, or one after the other
("sequential"), which is Gauss-Seidel.
"""

from __future__ import annotations

import json
import logging
import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid5

from lxml import etree

from harness.errors import ResultsError, StructureError, UsageError
from harness.files.archive import XmlElement, pack, read_all
from harness.files.output import PrivateFolder
from harness.master.isolated import guarded
from harness.master.simulation import MAX_ROUNDS, Simulation
from harness.results.provenance import WholeProvenance, whole_provenance
from harness.ssp.xml import literal
from harness.system.conversion import final, way
from harness.system.graph import read_interfaces
from harness.system.interface import Interface
from harness.system.model import System
from harness.system.units import IDENTITY

MODEL = "modelDescription.xml"
RUNTIME = "resources/container.txt"
ORDER = b"# Initialization order of the embedded FMU's\n"
"""Line of the container's own description before the order in which it initialises its FMUs."""

PROVENANCE = "extra/io.github.servicing-fmus/provenance.json"


def write_container(system: System, path: Path) -> None:
    """Write a checked system as one FMU. Its outputs are called `component.variable` as in our
    results.

    Raises UsageError without fmucontainer, StructureError if a container cannot express the system.
    """
    if found := list(_problems(system)):
        raise StructureError(found)
    with PrivateFolder() as folder:
        for component in system.components:
            shutil.copyfile(component.fmu, folder / f"{component.name}.fmu")
        description = folder / f"{path.stem}.json"
        description.write_text(json.dumps(assembly(system, path.name)), encoding="utf-8")
        _make(folder, description.name)
        _finish(folder / path.name, path, system)


def _problems(system: System) -> Iterator[str]:
    """Yield the properties of a system that a container cannot express, one line each."""
    interfaces = read_interfaces(system)
    for name in (n for n, interface in interfaces.items() if interface.fmi != 2):
        yield f"{name}: {interfaces[name].path.name} is of FMI 3.0, a container holds FMI 2.0 only"
    if system.experiment.start != 0:
        yield f"a container starts at 0 s, the system at {system.experiment.start:g} s"
    for c in system.components:
        if c.every != 1 or c.latency != 0:
            pace = f"steps every {c.every} macro steps with a latency of {c.latency}"
            yield f"{c.name}: {pace}, which a container cannot express"
    for each in system.connections:
        if way(each, interfaces) != IDENTITY:
            yield f"{each.target}: a container cannot transform the signal from {each.source}"


def assembly(system: System, name: str) -> dict[str, Any]:
    """Return the system in the format of fmucontainer. Every FMU has the name of its component."""
    interfaces = read_interfaces(system)
    autos = ("auto_link", "auto_input", "auto_output", "auto_parameter", "auto_local")
    starts = [
        [f"{c.name}.fmu", v, final(parameter, interfaces[c.name].variables[v], interfaces[c.name])]
        for c in system.components
        for v, parameter in c.parameters.items()
        if v in interfaces[c.name].variables
    ]
    return {
        "name": name,
        "fmu": [f"{c.name}.fmu" for c in system.components],
        "step_size": system.experiment.step,
        "sequential": system.experiment.algorithm == "gauss-seidel",
        **dict.fromkeys(autos, False),
        "output": [
            [f"{c}.fmu", v, f"{c}.{v}"]
            for c, interface in interfaces.items()
            for v in interface.outputs()
        ],
        "link": [
            [f"{source.component}.fmu", source.variable, f"{target.component}.fmu", target.variable]
            for source, target, _ in system.connections
        ],
        "start": starts,
    }


def _make(folder: Path, description: str) -> None:
    try:
        from fmu_manipulation_toolbox.assembly import Assembly, AssemblyError
        from fmu_manipulation_toolbox.container.errors import FMUContainerError
    except ImportError as error:
        raise UsageError(
            "an FMU of a system needs fmucontainer: pip install fmu-manipulation-toolbox"
        ) from error
    # fmucontainer warns of every open input
    logging.getLogger("fmu_manipulation_toolbox").setLevel(logging.CRITICAL)
    try:
        Assembly(description, fmu_directory=folder).make_fmu()
    except (AssemblyError, FMUContainerError) as error:
        raise ResultsError(f"fmucontainer: {' '.join(str(error.reason).split())}") from error


# ---- what fmucontainer leaves undone


def _finish(made: Path, path: Path, system: System) -> None:
    """Repack a container with a description that other tools accept; equal systems give equal
    bytes.
    """
    content = read_all(made)
    content[RUNTIME] = _in_order(content[RUNTIME], initial_order(system))
    about = whole_provenance(system, read_interfaces(system))
    content[MODEL] = _description(content, system, about)
    content[PROVENANCE] = (json.dumps(about.provenance, indent=1) + "\n").encode()
    pack(path, content, zipfile.ZIP_DEFLATED)


def initial_order(system: System) -> list[int]:
    """Return the indices of the components in an order in which each is initialised after all
    components on which it depends.

    A container initialises one FMU after the other. It cuts a loop before the first FMU of the
    list, whose inputs are then zero. A loop is therefore entered at a component whose first outputs
    settle before all outputs that it still waits for. Among several such components the one that
    settles first is taken, then the last in order of execution, which is a plant. Raises
    StructureError if there is none.
    """
    settled, waits = guarded([c.fmu for c in system.components], _settled, system)
    order: list[int] = []
    while len(order) < len(settled):
        rest = [i for i in reversed(range(len(settled))) if i not in order]
        free = [i for i in rest if waits[i].keys() <= {*order, i}] or [
            i
            for i in sorted(rest, key=lambda i: settled[i])
            if all(first >= settled[i] for source, first in waits[i].items() if source in rest)
        ]
        if not free:
            raise StructureError(
                ["the initial outputs form an algebraic loop, which a container FMU cannot resolve"]
            )
        order.append(free[0])
    return order


def _settled(system: System) -> tuple[list[int], list[dict[int, int]]]:
    """Return rounds of our initialization, in two lists by component: the round after which all
    outputs of the component have settled (1 without inputs), and, by the index of each component
    that it reads, the round after which the first signal that does not stay zero has settled.
    """
    with Simulation(system, executor="python") as simulation:
        simulation.initialize()
        nodes, rounds = simulation.graph.nodes, simulation.settled
        givers = {wire.slot: k for k, node in enumerate(nodes) for wire in node.outputs}
        waits: list[dict[int, int]] = [{} for _ in nodes]
        for node, of in zip(nodes, waits, strict=True):
            for wire in node.inputs:
                giver, last = givers[wire.slot], int(rounds[wire.slot]) or MAX_ROUNDS
                of[giver] = min(last, of.get(giver, last))
        lasts = [max((int(rounds[w.slot]) for w in node.outputs), default=1) for node in nodes]
        return [last or 1 for last in lasts], waits


def _in_order(runtime: bytes, order: list[int]) -> bytes:
    """Return the run-time description of a container with another order of initialization."""
    before, found, after = runtime.partition(ORDER)
    old, _, rest = after.partition(b"\n")
    if not found or sorted(map(int, old.split())) != sorted(order):
        raise UsageError(
            "the containers of this version of fmu-manipulation-toolbox are unknown; use 2.0"
        )
    return before + found + " ".join(map(str, order)).encode() + b"\n" + rest


def _description(content: dict[str, bytes], system: System, about: WholeProvenance) -> bytes:
    """Return the description with each output once (fmucontainer lists connected outputs a second
    time, as local), with units and the time span.

    The variable `time` is left out because libcosim logs an error for it.
    """
    root = etree.fromstring(content[MODEL])
    variables = root.find("ModelVariables")
    for variable in variables.findall("ScalarVariable"):
        if variable.get("causality") in ("local", "independent"):
            variables.remove(variable)
    _units(root, variables, read_interfaces(system))
    _structure(root, variables)
    default = root.find("DefaultExperiment")
    default.set("startTime", "0.0")
    default.set("stopTime", literal(system.experiment.stop or 0.0))
    root.set("version", about.version)
    root.set("generationDateAndTime", about.date)
    _sign(root, system, str(uuid5(NAMESPACE_URL, content[RUNTIME].decode() + system.name)))
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True))


def _sign(root: XmlElement, system: System, guid: str) -> None:
    """Write a name, a description and a guid that depend on the system alone."""
    root.set("modelName", system.name)
    root.set("description", system.description or system.name)
    root.set("guid", guid)
    for wrong in ("author", "license"):  # the name of the present account, and "Proprietary"
        root.attrib.pop(wrong, None)


def _units(root: XmlElement, variables: XmlElement, interfaces: dict[str, Interface]) -> None:
    """Write the units of the outputs, with their definitions before the log categories."""
    used: dict[str, Any] = {}
    for variable in variables.iterfind("ScalarVariable[@causality='output']"):
        component, _, name = variable.get("name").partition(".")
        unit = interfaces[component].unit(interfaces[component].variables[name])
        if unit is not None and unit.base is not None:
            variable[0].set("unit", unit.name)
            used.setdefault(unit.name, unit.base)
    table = etree.Element("UnitDefinitions")
    for name, base in sorted(used.items()):
        parts = {p: literal(value) for p, value in base.items() if value != int(p == "factor")}
        etree.SubElement(etree.SubElement(table, "Unit", name=name), "BaseUnit", parts)
    if used:
        root.find("LogCategories").addprevious(table)


def _structure(root: XmlElement, variables: XmlElement) -> None:
    """Write the outputs by their index in the list of variables. They depend on nothing because the
    container has no inputs.
    """
    outputs = [str(i) for i, v in enumerate(variables, start=1) if v.get("causality") == "output"]
    structure = root.find("ModelStructure")
    structure[:] = []
    for name in ("Outputs", "InitialUnknowns") if outputs else ():
        unknowns = etree.SubElement(structure, name)
        for i in outputs:
            etree.SubElement(unknowns, "Unknown", index=i, dependencies="")
