# SPDX-License-Identifier: BSD-2-Clause
"""From a System to an .ssp file, in the dialect that FMPy, libcosim, ecos and OMSimulator all
accept.

Literal prefixes, OSP's namespace on the root, every connector with its type, one .ssv per component
with the same name of the set everywhere, nothing nested. The same system always gives the same
bytes. It is SSP 1.0 where all FMUs are of FMI 2.0, else SSP 2.0, which knows the types and arrays
of FMI 3.0.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path
from urllib.parse import quote

from lxml import etree

from harness.errors import StructureError
from harness.files.archive import XmlElement, pack
from harness.ssp.arrays import connector_name, joined, shape, type_name
from harness.ssp.parameters import BaseUnits, bare_ssv, ssv, unit_table
from harness.ssp.xml import (
    FMU_TYPE,
    NS,
    OMS_ANNOTATION,
    OSP_ANNOTATION,
    RUN_ANNOTATION,
    SSD_FILE,
    attributes,
    child,
    document,
    serialized,
    tag,
)
from harness.system.conversion import way
from harness.system.graph import read_interfaces
from harness.system.interface import Interface
from harness.system.model import DEFAULT_SET, Component, Parameters, Port, System
from harness.system.units import IDENTITY, Affine
from harness.system.values import Variable

WIDTH, GAP, PITCH = 80, 60, 5
"""Block diagram: width of a component, distance between components, distance between connectors."""


def write_ssp(system: System, path: Path, version: int | None = None) -> None:
    """Write a system with its FMUs; version: of SSP, 1 or 2 (default: the first that can hold it).

    Raises FmuError, StructureError, or ResultsError if the file cannot be written.
    """
    pack(path, ssp_content(system, version))


def ssp_content(system: System, version: int | None = None) -> dict[str, bytes]:
    """Files of the archive by name."""
    interfaces = read_interfaces(system)
    version = _version(interfaces, version)
    units = _units(interfaces)
    sources = _sources(system.components)
    content = {sources[c.name]: c.fmu.read_bytes() for c in system.components}
    content[SSD_FILE] = _Description(system, interfaces, sources, units, version).text()
    for place, set_name, component, parameters in _parameter_files(system):
        content[place] = ssv(set_name, parameters, interfaces[component], units, version)
    for each in system.alternatives:
        for name, parameters in each.parameters.items():
            place = f"resources/alternatives/{each.fmu}/{name}.ssv"
            content[place] = bare_ssv(each.fmu, parameters, version)
    return content


def _parameter_files(system: System) -> Iterator[tuple[str, str, str, Parameters]]:
    """Place in the archive, name of the set, component and parameters of every .ssv."""
    for c in system.components:
        if c.parameters:
            yield _ssv_name(c), DEFAULT_SET, c.name, c.parameters
    for each in system.sets:
        told = {c.name for c in system.components if c.parameters or each.parameters.get(c.name)}
        for name, parameters in each.parameters.items():
            if name in told or not told:
                yield f"resources/sets/{each.name}/{name}.ssv", each.name, name, parameters


def _version(interfaces: Mapping[str, Interface], wanted: int | None) -> int:
    """The version of SSP; StructureError if it is 1 and cannot hold the FMUs."""
    new = [name for name, interface in interfaces.items() if interface.fmi == 3]
    if new and wanted == 1:
        raise StructureError(f"{name}: is of FMI 3.0, which needs SSP 2.0" for name in new)
    return wanted or (2 if new else 1)


def _units(interfaces: Mapping[str, Interface]) -> BaseUnits:
    """All units of all FMUs; StructureError if two FMUs mean different things by one name."""
    units: dict[str, Mapping[str, float]] = {}
    for component, interface in interfaces.items():
        for name, base in interface.units.items():
            if units.setdefault(name, base) != base:
                problem = f"its unit {name} is not the {name} of the components before it"
                raise StructureError([f"{component}: {problem}"])
    return units


def _sources(components: Sequence[Component]) -> dict[str, str]:
    """Place of every FMU in the archive; different FMUs with one file name are told apart by the
    component.
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


def _annotation(element: XmlElement, kind: str) -> XmlElement:
    """The annotation of a kind that an element gets."""
    return child(child(element, "ssd:Annotations"), "ssc:Annotation", type=kind)


@dataclass(frozen=True)
class _Description:
    """SystemStructure.ssd, element by element in the order of the schema."""

    system: System
    interfaces: Mapping[str, Interface]
    sources: Mapping[str, str]
    units: BaseUnits
    version: int

    @cached_property
    def connected(self) -> dict[str, list[Variable]]:
        """Variables of components at either end of a connection, in the order of their model
        descriptions.
        """
        ends = {port for c in self.system.connections for port in c[:2]}
        found = {}
        for c in self.system.components:
            variables = self.interfaces[c.name].variables
            found[c.name] = [v for name, v in variables.items() if Port(c.name, name) in ends]
        return found

    def _all_connected(self) -> Iterator[Variable]:
        return chain.from_iterable(self.connected.values())

    def text(self) -> bytes:
        about = {"name": self.system.name, "description": self.system.description}
        prefixes = ("ssd", "ssc", "ssv", "osp")
        root = document("ssd:SystemStructureDescription", prefixes, self.version, **about)
        top = child(root, "ssd:System", name=self.system.name)
        elements = child(top, "ssd:Elements")
        for column, component in enumerate(self.system.components):
            self._component(elements, component, column)
        self._connections(top)
        self._canvas(top)
        if self.version == 2 and self.system.experiment.step:  # SSP 1.0 keeps its bytes
            self._fixed_step(top)
        self._enumerations(root)
        unit_table(root, "ssd:Units", self.units, (v.unit for v in self._all_connected()))
        self._experiment(root)
        self._run(_annotation(root, RUN_ANNOTATION))
        return serialized(root)

    def _component(self, elements: XmlElement, component: Component, column: int) -> None:
        name, source = component.name, quote(self.sources[component.name])
        element = child(elements, "ssd:Component", name=name, type=FMU_TYPE, source=source)
        about = self.interfaces[name].model.description
        attributes(element, implementation="CoSimulation", description=about)
        self._connectors(element, component)
        left, height = column * (WIDTH + GAP), self._height(component)
        child(element, "ssd:ElementGeometry", x1=left, y1=-height, x2=left + WIDTH, y2=0)
        if component.parameters:
            bindings = child(element, "ssd:ParameterBindings")
            child(bindings, "ssd:ParameterBinding", source=_ssv_name(component))
        if component.every > 1 and self.system.experiment.step:
            hint = _annotation(element, OSP_ANNOTATION)
            child(hint, "osp:StepSizeHint", value=component.every * self.system.experiment.step)

    def _connectors(self, element: XmlElement, component: Component) -> None:
        """Inputs down the left edge, outputs down the right one; (0, 0) is the lower left
        corner.
        """
        rows = self._rows(component.name)
        table = child(element, "ssd:Connectors") if rows else None
        for x, kind in ((0, "input"), (1, "output")):
            side = {name: v for name, v in rows.items() if v.causality == kind}
            for i, (name, variable) in enumerate(side.items()):
                about = variable.description
                connector = child(table, "ssd:Connector", name=name, kind=kind, description=about)
                self._type(connector, variable)
                for size in shape(self.interfaces[component.name], variable):
                    child(connector, "ssc:Dimension", size=size)
                y = round(1 - (i + 0.5) / len(side), 6)
                child(connector, "ssd:ConnectorGeometry", x=x, y=y)

    def _rows(self, component: str) -> dict[str, Variable]:
        """Connectors of a component: its connected variables by name, of an array of FMI 3.0 the
        first.
        """
        rows: dict[str, Variable] = {}
        for variable in self.connected[component]:
            rows.setdefault(connector_name(self.interfaces[component], variable), variable)
        return rows

    def _type(self, connector: XmlElement, variable: Variable) -> None:
        type_ = child(connector, f"ssc:{type_name(variable, self.version)}")
        unit = variable.unit if variable.unit in self.units else None
        attributes(type_, unit=unit if variable.type == "Real" else None)
        attributes(type_, name=variable.type_name if variable.type == "Enumeration" else None)

    def _enumerations(self, root: XmlElement) -> None:
        """Types of the connected enumerations; the first component that has a type of that name
        defines it.
        """
        found = (v for v in self._all_connected() if v.type == "Enumeration")
        types = {v.type_name: v.items for v in found}
        table = child(root, "ssd:Enumerations") if types else None
        for name, items in sorted(types.items()):
            enumeration = child(table, "ssc:Enumeration", name=name)
            for item, value in items.items():
                child(enumeration, "ssc:Item", name=item, value=value)

    def _height(self, component: Component) -> int:
        sides = [v.causality for v in self._rows(component.name).values()]
        return PITCH * max(sides.count("input"), sides.count("output"), 4)

    def _canvas(self, top: XmlElement) -> None:
        right = len(self.system.components) * (WIDTH + GAP)
        bottom = -max(self._height(c) for c in self.system.components) - GAP
        child(top, "ssd:SystemGeometry", x1=-GAP, y1=bottom, x2=right, y2=GAP)

    def _fixed_step(self, top: XmlElement) -> None:
        """For OMSimulator, which would take a step of a millisecond or, in old versions, not know
        what kind of system this is; the tolerances are those that it writes itself.
        """
        annotation = _annotation(top, OMS_ANNOTATION)
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
            if each.hops:
                self._transformation(connection, way(each, self.interfaces))

    def _transformation(self, connection: XmlElement, change: Affine) -> None:
        """Everything that happens on the way as one step, the conversion of units included."""
        attributes(connection, suppressUnitConversion=True)
        if change != IDENTITY:
            child(connection, "ssc:LinearTransformation", **change._asdict())

    def _experiment(self, root: XmlElement) -> None:
        experiment = self.system.experiment
        times = {"startTime": experiment.start, "stopTime": experiment.stop}
        default = child(root, "ssd:DefaultExperiment", **times)
        if experiment.step:
            algorithm = child(_annotation(default, OSP_ANNOTATION), "osp:Algorithm")
            fixed = {"baseStepSize": experiment.step, "numWorkerThreads": 0}
            child(algorithm, "osp:FixedStepAlgorithm", **fixed)

    def _run(self, annotation: XmlElement) -> None:
        """Our annotation: what a run needs and SSP has no place for."""
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
        for name, text in system.requirements.items():
            child(run, "run:Requirement", name=name, text=text)
        for name, text in system.consistency.items():
            child(run, "run:Consistency", name=name, text=text)
        for name, (low, high) in system.sliders.items():
            child(run, "run:Slider", name=name, low=low, high=high)
