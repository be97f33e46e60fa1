"""From a System to an .ssp file, in the dialect that FMPy, libcosim, ecos and OMSimulator all accept.

Literal prefixes, OSP's namespace on the root, every connector with its type, one .ssv per component with the same
name of the set everywhere, nothing nested. The same system always gives the same bytes.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from urllib.parse import quote

from lxml import etree

from harness.errors import ResultsError, StructureError
from harness.graph import read_interfaces
from harness.interface import Interface, Variable
from harness.ssp_xml import FMU_TYPE, NS, OSP_ANNOTATION, RUN_ANNOTATION, SSD_FILE, Element, tag
from harness.system import Component, Parameters, System
from harness.values import Scalar

Units = Mapping[str, Mapping[str, float]]
"""Base units (exponents, factor, offset) by name."""

DEFAULT_SET = "default"
TOOL = "servicing-fmus"
DATE = (1980, 1, 1, 0, 0, 0)

WIDTH, GAP, PITCH = 80, 60, 5
"""Block diagram: width of a component, distance between components, distance between connectors."""


def write_ssp(system: System, path: Path) -> None:
    """Write a system with its FMUs. Raises FmuError, StructureError, or ResultsError if the file cannot be written."""
    content = ssp_content(system)
    try:
        with zipfile.ZipFile(path, "w", zipfile.ZIP_STORED) as archive:
            for name, data in sorted(content.items()):
                archive.writestr(_entry(name), data)
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written ({error.strerror})") from error


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, DATE)
    entry.create_system = 3  # Unix, so that the bytes do not depend on the platform
    entry.external_attr = 0o100644 << 16
    return entry


def ssp_content(system: System) -> dict[str, bytes]:
    """Files of the archive by name."""
    interfaces = read_interfaces(system)
    units = _units(interfaces)
    sources = _sources(system.components)
    content = {sources[c.name]: c.fmu.read_bytes() for c in system.components}
    content[SSD_FILE] = _Description(system, interfaces, sources, units).text()
    for component in system.components:
        if component.parameters:
            content[_ssv_name(component)] = _ssv(DEFAULT_SET, component.parameters, interfaces[component.name], units)
    for each in system.sets:
        for name, parameters in each.parameters.items():
            if parameters:
                content[f"resources/sets/{each.name}/{name}.ssv"] = _ssv(each.name, parameters, interfaces[name], units)
    return content


def _units(interfaces: Mapping[str, Interface]) -> Units:
    """All units of all FMUs; StructureError if two FMUs mean different things by one name."""
    units: dict[str, Mapping[str, float]] = {}
    for component, interface in interfaces.items():
        for name, base in interface.units.items():
            if units.setdefault(name, base) != base:
                raise StructureError([f"{component}: its unit {name} is not the {name} of the components before it"])
    return units


def _sources(components: Sequence[Component]) -> dict[str, str]:
    """Place of every FMU in the archive; different FMUs with one file name are told apart by the component."""
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


class _Description:
    """SystemStructure.ssd, element by element in the order of the schema."""

    def __init__(
        self, system: System, interfaces: Mapping[str, Interface], sources: Mapping[str, str], units: Units
    ) -> None:
        self.system, self.interfaces, self.sources, self.units = system, interfaces, sources, units
        self.connected = {c.name: self._connected(c.name) for c in system.components}

    def _connected(self, component: str) -> list[Variable]:
        """Variables of a component at either end of a connection, in the order of its model description."""
        names = {port.variable for ends in self.system.connections for port in ends if port.component == component}
        return [v for name, v in self.interfaces[component].variables.items() if name in names]

    def text(self) -> bytes:
        namespaces = {prefix: NS[prefix] for prefix in ("ssd", "ssc", "ssv", "osp")}
        root = etree.Element(tag("ssd:SystemStructureDescription"), nsmap=namespaces)
        _attributes(
            root, version="1.0", name=self.system.name, description=self.system.description, generationTool=TOOL
        )
        top = _child(root, "ssd:System", name=self.system.name)
        elements = _child(top, "ssd:Elements")
        for column, component in enumerate(self.system.components):
            self._component(elements, component, column)
        self._connections(top)
        self._canvas(top)
        _unit_table(root, "ssd:Units", self.units, (v.unit for each in self.connected.values() for v in each))
        self._experiment(root)
        self._run(_child(root, "ssd:Annotations"))
        return _text(root)

    def _component(self, elements: Element, component: Component, column: int) -> None:
        element = _child(
            elements, "ssd:Component", name=component.name, type=FMU_TYPE, source=quote(self.sources[component.name])
        )
        _attributes(
            element, implementation="CoSimulation", description=self.interfaces[component.name].model.description
        )
        self._connectors(element, component)
        _child(element, "ssd:ElementGeometry", **self._block(component, column))
        if component.parameters:
            bindings = _child(element, "ssd:ParameterBindings")
            _child(bindings, "ssd:ParameterBinding", source=_ssv_name(component))
        if component.every > 1 and self.system.experiment.step:
            hint = _child(_child(element, "ssd:Annotations"), "ssc:Annotation", type=OSP_ANNOTATION)
            _child(hint, "osp:StepSizeHint", value=component.every * self.system.experiment.step)

    def _connectors(self, element: Element, component: Component) -> None:
        """Inputs down the left edge, outputs down the right one; (0, 0) is the lower left corner."""
        connected = self.connected[component.name]
        connectors = _child(element, "ssd:Connectors") if connected else None
        for x, kind in ((0, "input"), (1, "output")):
            side = [v for v in connected if v.causality == kind]
            for i, variable in enumerate(side):
                connector = _child(
                    connectors, "ssd:Connector", name=variable.name, kind=kind, description=variable.description
                )
                unit = variable.unit if variable.unit in self.units else None
                _child(connector, f"ssc:{variable.type}", **({"unit": unit} if variable.type == "Real" else {}))
                _child(connector, "ssd:ConnectorGeometry", x=x, y=round(1 - (i + 0.5) / len(side), 6))

    def _height(self, component: Component) -> int:
        sides = [v.causality for v in self.connected[component.name]]
        return PITCH * max(sides.count("input"), sides.count("output"), 4)

    def _block(self, component: Component, column: int) -> dict[str, float]:
        """Corners of a component: a row from left to right in execution order, tops aligned at y = 0."""
        left = column * (WIDTH + GAP)
        return {"x1": left, "y1": -self._height(component), "x2": left + WIDTH, "y2": 0}

    def _canvas(self, top: Element) -> None:
        right = len(self.system.components) * (WIDTH + GAP)
        bottom = -max(self._height(c) for c in self.system.components) - GAP
        _child(top, "ssd:SystemGeometry", x1=-GAP, y1=bottom, x2=right, y2=GAP)

    def _connections(self, top: Element) -> None:
        connections = _child(top, "ssd:Connections") if self.system.connections else None
        for source, target in self.system.connections:
            connection = _child(connections, "ssd:Connection")
            _attributes(connection, startElement=source.component, startConnector=source.variable)
            _attributes(connection, endElement=target.component, endConnector=target.variable)

    def _experiment(self, root: Element) -> None:
        experiment = self.system.experiment
        default = _child(root, "ssd:DefaultExperiment", startTime=experiment.start, stopTime=experiment.stop)
        if experiment.step:
            annotation = _child(_child(default, "ssd:Annotations"), "ssc:Annotation", type=OSP_ANNOTATION)
            algorithm = _child(annotation, "osp:Algorithm")
            _child(algorithm, "osp:FixedStepAlgorithm", baseStepSize=experiment.step, numWorkerThreads=0)

    def _run(self, annotations: Element) -> None:
        """Our annotation: what a run needs and SSP has no place for."""
        annotation = _child(annotations, "ssc:Annotation", type=RUN_ANNOTATION)
        run = etree.SubElement(annotation, tag("run:Run"), nsmap={"run": NS["run"]})
        _attributes(run, algorithm=self.system.experiment.algorithm, strict="true" if self.system.strict else "false")
        for c in self.system.components:
            _child(run, "run:Component", name=c.name, every=c.every, latency=c.latency)
        for s in self.system.sets:
            _child(run, "run:ParameterSet", name=s.name, description=s.description, stop=s.stop, step=s.step)


# ---- .ssv


def _ssv(name: str, parameters: Parameters, interface: Interface, units: Units) -> bytes:
    """A parameter set of one component; names are relative to the component."""
    root = etree.Element(tag("ssv:ParameterSet"), nsmap={"ssv": NS["ssv"], "ssc": NS["ssc"]})
    _attributes(root, version="1.0", name=name, generationTool=TOOL)
    table = _child(root, "ssv:Parameters")
    for parameter, given in parameters.items():
        kind = interface.variables[parameter].type
        value = _child(_child(table, "ssv:Parameter", name=parameter), f"ssv:{kind}", value=given.value)
        if kind == "Real" and given.unit in units:
            _attributes(value, unit=given.unit)
    _unit_table(root, "ssv:Units", units, (p.unit for p in parameters.values()))
    return _text(root)


# ---- XML


def _unit_table(root: Element, name: str, units: Units, used: Iterable[str | None]) -> None:
    names = sorted({unit for unit in used if unit in units and unit is not None})
    table = _child(root, name) if names else None
    for unit in names:
        parts = {part: value for part, value in units[unit].items() if value != (1 if part == "factor" else 0)}
        _child(_child(table, "ssc:Unit", name=unit), "ssc:BaseUnit", **parts)


def _child(parent: Element, kind: str, /, **attributes: Scalar | None) -> Element:
    element = etree.SubElement(parent, tag(kind))
    _attributes(element, **attributes)
    return element


def _attributes(element: Element, /, **attributes: Scalar | None) -> None:
    """Set attributes in the given order; None and "" are left out."""
    for name, value in attributes.items():
        if value is not None and value != "":
            element.set(name, _literal(value))


def _literal(value: Scalar) -> str:
    """A value as XML schema writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "INF" if value > 0 else "-INF"
    return repr(value) if isinstance(value, float) else str(value)


def _text(root: Element) -> bytes:
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True))
