"""From an .ssp file to a System: safe unpacking, schema validation, and no FMI call.

Names are read by namespace, whatever the prefixes. What cannot be run is refused, not ignored: nested systems,
connectors of the system itself, parameter mappings, transformations of signals.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import unquote

from lxml import etree

from harness import ssp_xml as xml
from harness.archive import unpack
from harness.errors import StructureError
from harness.system import Component, Connection, Experiment, Parameter, Parameters, ParameterSet, Port, System
from harness.values import Scalar


@contextmanager
def opened(path: Path) -> Iterator[System]:
    """The system in an .ssp, unpacked to a private temporary folder that is removed at the end of the `with` block.

    Raises ArchiveError (damaged or unsafe archive) or StructureError (all problems of the description).
    """
    with TemporaryDirectory(prefix="harness-") as folder:
        unpack(path, Path(folder))
        try:
            system = read(Path(folder))
        except StructureError as error:
            raise StructureError(f"{path.name}: {problem}" for problem in error.problems) from error
        yield system


def read(folder: Path) -> System:
    """The system in an unpacked .ssp; StructureError with all problems."""
    if not (folder / xml.SSD_FILE).is_file():
        raise StructureError([f"it holds no {xml.SSD_FILE}"])
    reader = _Reader(folder, xml.parse(folder / xml.SSD_FILE, xml.SSD_SCHEMA))
    system = reader.system()
    if reader.problems:
        raise StructureError(reader.problems)
    return system


def read_ssv(path: Path) -> dict[str, Parameter]:
    """Parameters of an .ssv file by name; StructureError if it is not one or holds NaN."""
    return parameter_set(xml.parse(path, xml.SSV_SCHEMA))


def parameter_set(root: xml.Element) -> dict[str, Parameter]:
    """Parameters of an ssv:ParameterSet element by name; StructureError if one is NaN or binary."""
    parameters = {}
    for element in root.iterfind("ssv:Parameters/ssv:Parameter", xml.NS):
        name, value = element.get("name"), element[0]
        try:
            parameters[name] = Parameter(_scalar(value), value.get("unit"))
        except ValueError as error:
            raise StructureError([f"parameter {name}: {error}"]) from error
    return parameters


def _scalar(element: xml.Element) -> Scalar:
    """Value of ssv:Real, ssv:Integer, ... as Python has it."""
    text: str = element.get("value")
    match element.tag.rpartition("}")[2]:
        case "Real":
            number = float(text)
            if math.isnan(number):
                raise ValueError("must not be NaN")
            return number
        case "Integer":
            return int(text)
        case "Boolean":
            return text.strip() in ("true", "1")
        case "Binary":
            raise ValueError("binary values are not supported")
    return text


class _Reader:
    """One pass over SystemStructure.ssd that collects problems instead of stopping at the first."""

    def __init__(self, folder: Path, root: xml.Element) -> None:
        self.folder = folder
        self.root = root
        self.top = root.find("ssd:System", xml.NS)
        self.run = root.find(f"ssd:Annotations/ssc:Annotation[@type='{xml.RUN_ANNOTATION}']/run:Run", xml.NS)
        self.schedule = {e.get("name"): e for e in self._own("run:Component")}
        self.problems: list[str] = []

    def system(self) -> System:
        self._refuse_unsupported()
        experiment = self._experiment()
        components = tuple(self._component(e, experiment) for e in self._all("ssd:Elements/ssd:Component"))
        return System(
            name=self.root.get("name"),
            description=self.root.get("description", ""),
            components=components,
            connections=tuple(self._connections()),
            experiment=experiment,
            sets=tuple(self._set(e, components) for e in self._own("run:ParameterSet")),
            strict=self.run is not None and self.run.get("strict") == "true",
        )

    def _all(self, path: str) -> list[xml.Element]:
        return list(self.top.iterfind(path, xml.NS))

    def _own(self, path: str) -> list[xml.Element]:
        """Elements of our own annotation, none in a file of another tool."""
        return [] if self.run is None else list(self.run.iterfind(path, xml.NS))

    def _refuse_unsupported(self) -> None:
        binding = "ssd:Elements/ssd:Component/ssd:ParameterBindings/ssd:ParameterBinding"
        unsupported = {
            "ssd:Elements/ssd:System": "nested systems",
            "ssd:Elements/ssd:SignalDictionaryReference": "signal dictionaries",
            "ssd:Connectors": "connectors of the system itself",
            "ssd:ParameterBindings": "parameter bindings of the system itself",
            f"{binding}/ssd:ParameterMapping": "parameter mappings",
            "ssd:Connections/ssd:Connection/ssc:*": "transformations of signals",
        }
        self.problems += [f"{what} are not supported" for path, what in unsupported.items() if self._all(path)]

    def _experiment(self) -> Experiment:
        """Time span of the file; the step is OSP's, the algorithm ours, without ours Jacobi, which needs no order."""
        default = self.root.find("ssd:DefaultExperiment", xml.NS)
        step = self.root.find("ssd:DefaultExperiment//osp:FixedStepAlgorithm", xml.NS)
        return Experiment(
            start=self._number(default, "startTime") or 0.0,
            stop=self._number(default, "stopTime"),
            step=self._number(step, "baseStepSize"),
            algorithm="jacobi" if self.run is None else self.run.get("algorithm"),
        )

    def _component(self, element: xml.Element, experiment: Experiment) -> Component:
        name = element.get("name")
        if element.get("type", xml.FMU_TYPE) != xml.FMU_TYPE:
            self.problems.append(f"component {name}: only FMUs can be run, not {element.get('type')}")
        if element.get("implementation") == "ModelExchange":
            self.problems.append(f"component {name}: model exchange is not supported, only co-simulation")
        every, latency = self._schedule(element, experiment)
        return Component(name, self._file(element.get("source"), name), self._bindings(element), every, latency)

    def _schedule(self, element: xml.Element, experiment: Experiment) -> tuple[int, int]:
        """Period and latency from our annotation, else every from OSP's hint of a longer step."""
        own = self.schedule.get(element.get("name"))
        if own is not None:
            return round(self._number(own, "every") or 1), round(self._number(own, "latency") or 0)
        hint = self._number(element.find("ssd:Annotations/ssc:Annotation/osp:StepSizeHint", xml.NS), "value")
        return max(1, round(hint / experiment.step)) if hint and experiment.step else 1, 0

    def _bindings(self, element: xml.Element) -> Parameters:
        """All parameter sets bound to a component, later ones winning."""
        parameters: dict[str, Parameter] = {}
        for binding in element.iterfind("ssd:ParameterBindings/ssd:ParameterBinding", xml.NS):
            prefix = binding.get("prefix", "")
            parameters |= {prefix + name: value for name, value in self._bound(binding, element.get("name")).items()}
        return parameters

    def _bound(self, binding: xml.Element, component: str) -> Parameters:
        inline = binding.find("ssd:ParameterValues/ssv:ParameterSet", xml.NS)
        try:
            if inline is not None:
                return parameter_set(inline)
            return self._ssv(binding.get("source", ""), component)
        except StructureError as error:
            self.problems += [f"component {component}: {problem}" for problem in error.problems]
            return {}

    def _ssv(self, source: str, component: str) -> Parameters:
        path = self._file(source, component)
        return read_ssv(path) if path.is_file() else {}

    def _file(self, source: str, component: str) -> Path:
        """A file inside the archive; a problem is noted if it is not there."""
        path = (self.folder / unquote(source)).resolve()
        if not path.is_relative_to(self.folder.resolve()) or not path.is_file():
            self.problems.append(f"component {component}: {source or 'a file without a name'} is not in the archive")
        return path

    def _connections(self) -> Iterator[Connection]:
        for element in self._all("ssd:Connections/ssd:Connection"):
            start = Port(element.get("startElement", ""), element.get("startConnector"))
            end = Port(element.get("endElement", ""), element.get("endConnector"))
            yield Connection(start, end)

    def _set(self, element: xml.Element, components: tuple[Component, ...]) -> ParameterSet:
        """A set that our annotation lists but nothing binds: one .ssv per component that has parameters."""
        name = element.get("name", "")
        files = {c.name: f"resources/sets/{name}/{c.name}.ssv" for c in components}
        parameters = {c: self._ssv(file, c) for c, file in files.items() if (self.folder / file).is_file()}
        if not parameters:
            self.problems.append(f"parameter set {name}: is listed, but none of its files is in the archive")
        stop, step = self._number(element, "stop"), self._number(element, "step")
        return ParameterSet(name, element.get("description", ""), parameters, stop, step)

    def _number(self, element: xml.Element, attribute: str) -> float | None:
        """A finite number in an attribute, None without it; a problem is noted if it is something else."""
        text = None if element is None else element.get(attribute)
        try:
            number = None if text is None else float(text)
        except ValueError:
            number = math.nan
        if number is None or math.isfinite(number):
            return number
        self.problems.append(f"{etree.QName(element).localname}: {attribute}='{text}' is not a finite number")
        return None
