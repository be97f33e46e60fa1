# SPDX-License-Identifier: BSD-2-Clause
"""Writer of .ssp files in the form that FMPy, libcosim, ecos and OMSimulator all accept.

XML prefixes are those that these tools expect, the root declares the OSP namespace, every connector
has its type, and no system is nested. Each component with parameters has its own .ssv, and the
default parameter sets in all these files have the same name. OMSimulator rejects a file that has
annotations elsewhere than in the root system and the default experiment, or a geometry of the
system; so neither is written, except for step size hints on request. The same system always gives
the same bytes. The version is SSP 1.0 if all FMUs are of FMI 2.0, else SSP 2.0, which supports the
types and arrays of FMI 3.0.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from urllib.parse import quote

from lxml import etree

from harness.errors import StructureError
from harness.files.archive import XmlElement, pack, serialized
from harness.ssp import xml
from harness.ssp.arrays import connector_name, joined, shape, type_name
from harness.ssp.parameters import BaseUnits, bare_ssv, ssv, unit_table
from harness.ssp.xml import NS, attributes, child, document, tag
from harness.system.conversion import way
from harness.system.graph import read_interfaces
from harness.system.interface import Interfaces
from harness.system.model import DEFAULT_SET, Component, Parameters, Port, System
from harness.system.units import IDENTITY
from harness.system.values import Variable

WIDTH, GAP, PITCH = 80, 60, 5
"""Lengths in the block diagram, in the units of SSP geometry: width of a component, distance
between components, distance between connectors.
"""


def write_ssp(
    system: System, path: Path, version: int | None = None, *, hints: bool = False
) -> None:
    """Write a system with its FMUs into an .ssp.

    version: 1 or 2; default: 1 if all FMUs are of FMI 2.0, else 2. hints: add an OSP annotation
    with the step size of each component that is slower than the macro step, for libcosim and ecos;
    OMSimulator rejects such a file.

    Raises FmuError, StructureError, or ResultsError if the file cannot be written.
    """
    pack(path, _Writer(system, version, hints).content())


class _Writer:
    """Writer of the files of an .ssp. The elements of SystemStructure.ssd are written in the order
    that the schema requires.
    """

    def __init__(self, system: System, version: int | None, hints: bool) -> None:
        self.system = system
        self.hints = hints
        self.interfaces = read_interfaces(system)
        new = [name for name, interface in self.interfaces.items() if interface.fmi == 3]
        if new and version == 1:
            raise StructureError(f"{name}: is of FMI 3.0, which needs SSP 2.0" for name in new)
        self.version = version or (2 if new else 1)
        self.units = _units(self.interfaces)
        self.sources = _sources(system.components)
        ends = {port for c in system.connections for port in c[:2]}
        self.connected = {
            component: [v for name, v in i.variables.items() if Port(component, name) in ends]
            for component, i in self.interfaces.items()
        }
        """Variables of components at either end of a connection, in the order of their model
        descriptions.
        """

    # ---- files

    def content(self) -> dict[str, bytes]:
        """Return the files of the archive by name."""
        system = self.system
        content = {self.sources[c.name]: c.fmu.read_bytes() for c in system.components}
        content[xml.SSD_FILE] = self._description()
        for c in system.components:
            if c.parameters:
                content[_ssv_name(c)] = self._ssv(DEFAULT_SET, c.name, c.parameters)
        for s in system.sets:
            listed = {c.name for c in system.components if c.parameters or s.parameters.get(c.name)}
            for name, parameters in s.parameters.items():
                if name in listed or not listed:
                    place = f"resources/sets/{s.name}/{name}.ssv"
                    content[place] = self._ssv(s.name, name, parameters)
        for a in system.alternatives:
            for name, parameters in a.parameters.items():
                place = f"resources/alternatives/{a.fmu}/{name}.ssv"
                content[place] = bare_ssv(a.fmu, parameters, self.version)
        return content

    def _ssv(self, set_name: str, component: str, parameters: Parameters) -> bytes:
        return ssv(set_name, parameters, self.interfaces[component], self.units, self.version)

    def _description(self) -> bytes:
        about = {"name": self.system.name, "description": self.system.description}
        prefixes = ("ssd", "ssc", "ssv", "osp")
        root = document("ssd:SystemStructureDescription", prefixes, self.version, **about)
        top = child(root, "ssd:System", name=self.system.name)
        elements = child(top, "ssd:Elements")
        for column, component in enumerate(self.system.components):
            self._component(elements, component, column * (WIDTH + GAP))
        self._connections(top)
        annotations = child(top, "ssd:Annotations")
        if self.system.experiment.step:
            self._fixed_step(annotations)  # OMSimulator reads only the first annotation
        self._run(annotations)
        used = list(chain.from_iterable(self.connected.values()))
        self._enumerations(root, used)
        unit_table(root, "ssd:Units", self.units, (v.unit for v in used))
        self._experiment(root)
        return serialized(root, pretty=True)

    # ---- elements

    def _component(self, elements: XmlElement, component: Component, left: int) -> None:
        """Write a component whose left edge in the block diagram is at x = `left`. The
        annotation that suggests the step size of the component is written only with `hints`, since
        OMSimulator rejects it.
        """
        name, source = component.name, quote(self.sources[component.name])
        element = child(elements, "ssd:Component", name=name, type=xml.FMU_TYPE, source=source)
        about = self.interfaces[name].model.description
        attributes(element, implementation="CoSimulation", description=about)
        height = PITCH * max(self._connectors(element, name), 4)
        child(element, "ssd:ElementGeometry", x1=left, y1=-height, x2=left + WIDTH, y2=0)
        if component.parameters:
            bindings = child(element, "ssd:ParameterBindings")
            child(bindings, "ssd:ParameterBinding", source=_ssv_name(component))
        if self.hints and component.every > 1 and (step := self.system.experiment.step):
            hint = child(
                child(element, "ssd:Annotations"), "ssc:Annotation", type=xml.OSP_ANNOTATION
            )
            child(hint, "osp:StepSizeHint", value=component.every * step)

    def _connectors(self, element: XmlElement, component: str) -> int:
        """Write the connected inputs along the left edge of a component and the outputs along its
        right edge, from top to bottom; return the number of connectors on the longer edge.

        Positions are relative to the component: (0, 0) is its lower left corner, (1, 1) its upper
        right one. An array of FMI 3.0 has one connector for all elements.
        """
        interface = self.interfaces[component]
        sides: dict[str, dict[str, Variable]] = {"input": {}, "output": {}}
        for v in self.connected[component]:
            sides[v.causality].setdefault(connector_name(interface, v), v)
        table = child(element, "ssd:Connectors") if self.connected[component] else None
        for x, (kind, rows) in enumerate(sides.items()):
            for i, (name, v) in enumerate(rows.items()):
                about = {"name": name, "kind": kind, "description": v.description}
                connector = child(table, "ssd:Connector", **about)
                self._type(connector, v, shape(interface, v))
                y = round(1 - (i + 0.5) / len(rows), 6)
                child(connector, "ssd:ConnectorGeometry", x=x, y=y)
        return max(map(len, sides.values()))

    def _type(self, connector: XmlElement, v: Variable, sizes: Sequence[int]) -> None:
        element = child(connector, f"ssc:{type_name(v, self.version)}")
        unit = v.unit if v.type == "Real" and v.unit in self.units else None
        attributes(element, unit=unit, name=v.type_name if v.type == "Enumeration" else None)
        for size in sizes:
            child(connector, "ssc:Dimension", size=size)

    def _enumerations(self, root: XmlElement, used: Sequence[Variable]) -> None:
        """Write the enumeration types of the used variables. If several types have one name, the
        type of the last variable is written.
        """
        types = {v.type_name: v.items for v in used if v.type == "Enumeration"}
        table = child(root, "ssd:Enumerations") if types else None
        for name, items in sorted(types.items()):
            enumeration = child(table, "ssc:Enumeration", name=name)
            for item, value in items.items():
                child(enumeration, "ssc:Item", name=item, value=value)

    def _fixed_step(self, annotations: XmlElement) -> None:
        """Write the macro step for OMSimulator, which would otherwise take a step of a millisecond
        or reject the system. The tolerances equal the values in OMSimulator's own files.
        """
        annotation = child(annotations, "ssc:Annotation", type=xml.OMS_ANNOTATION)
        settings = etree.SubElement(annotation, tag("oms:Annotations"), nsmap={"oms": NS["oms"]})
        master = {"description": "oms-ma", "stepSize": self.system.experiment.step}
        tolerances = {"absoluteTolerance": 1e-4, "relativeTolerance": 1e-4}
        information = child(settings, "oms:SimulationInformation")
        child(information, "oms:FixedStepMaster", **master, **tolerances)

    def _connections(self, top: XmlElement) -> None:
        connections = child(top, "ssd:Connections") if self.system.connections else None
        for each, source, target in joined(self.system.connections, self.interfaces):
            connection = child(connections, "ssd:Connection")
            for side, port, end in (("start", each.source, source), ("end", each.target, target)):
                attributes(connection, **{f"{side}Element": port.component})
                attributes(connection, **{f"{side}Connector": end.connector})
                attributes(connection, **{f"{side}Indices": " ".join(map(str, end.indices))})
            if each.hops:  # one transformation for all conversions (hops) and units
                change = way(each, self.interfaces)
                attributes(connection, suppressUnitConversion=True)
                if change != IDENTITY:
                    child(connection, "ssc:LinearTransformation", **change._asdict())

    def _experiment(self, root: XmlElement) -> None:
        experiment = self.system.experiment
        times = {"startTime": experiment.start, "stopTime": experiment.stop}
        default = child(root, "ssd:DefaultExperiment", **times)
        if experiment.step:
            annotations = child(default, "ssd:Annotations")
            annotation = child(annotations, "ssc:Annotation", type=xml.OSP_ANNOTATION)
            algorithm = child(annotation, "osp:Algorithm")
            fixed = {"baseStepSize": experiment.step, "numWorkerThreads": 0}
            child(algorithm, "osp:FixedStepAlgorithm", **fixed)

    def _run(self, annotations: XmlElement) -> None:
        """Write the annotation of this package: run settings for which SSP has no element."""
        annotation = child(annotations, "ssc:Annotation", type=xml.RUN_ANNOTATION)
        run = etree.SubElement(annotation, tag("run:Run"), nsmap={"run": NS["run"]})
        system, experiment = self.system, self.system.experiment
        attributes(
            run,
            algorithm=experiment.algorithm,
            every=experiment.every if experiment.every > 1 else None,
            strict=system.strict,
            mission=system.mission,
            compare=system.compared,
            epoch=experiment.epoch,
        )
        for c in system.components:
            child(run, "run:Component", name=c.name, every=c.every, latency=c.latency)
        for s in system.sets:
            times = {"stop": s.stop, "step": s.step}
            child(run, "run:ParameterSet", name=s.name, description=s.description, **times)
        for a in system.alternatives:
            child(run, "run:Alternative", component=a.component, fmu=a.fmu)
        for kind, texts in (
            ("Requirement", system.requirements),
            ("Consistency", system.consistency),
        ):
            for name, text in texts.items():
                child(run, f"run:{kind}", name=name, text=text)
        for name, (low, high) in system.sliders.items():
            child(run, "run:Slider", name=name, low=low, high=high)


def _units(interfaces: Interfaces) -> BaseUnits:
    """Return the units of all FMUs by name; raise StructureError if two FMUs define a unit of one
    name differently.
    """
    units: dict[str, Mapping[str, float]] = {}
    for component, interface in interfaces.items():
        for name, base in interface.units.items():
            if units.setdefault(name, base) != base:
                problem = f"defines the unit {name} differently from another component"
                raise StructureError([f"{component}: {problem}"])
    return units


def _sources(components: Sequence[Component]) -> dict[str, str]:
    """Return the path in the archive of every component's FMU: `resources/FILE`, or
    `resources/COMPONENT-FILE` if a different FMU has this file name.
    """
    owner: dict[str, Path] = {}
    sources = {}
    for component in components:
        name = f"resources/{component.fmu.name}"
        if owner.setdefault(name, component.fmu) != component.fmu:
            name = f"resources/{component.name}-{component.fmu.name}"
        sources[component.name] = name
    return sources


def _ssv_name(component: Component) -> str:
    return f"resources/{component.name}.ssv"
