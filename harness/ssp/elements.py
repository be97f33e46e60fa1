# SPDX-License-Identifier: BSD-2-Clause
"""Reading of the ssd:System and ssd:Component elements of an .ssp, with their connectors,
connections and parameters, into tables of plain data.

The place of an element in nested systems is the tuple of names on the way to this element.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urlsplit

from harness.errors import ArchiveError, StructureError
from harness.files.archive import XmlElement, inspect
from harness.files.paths import is_file
from harness.spelling import did_you_mean
from harness.ssp import xml
from harness.ssp.arrays import indices
from harness.ssp.parameters import hop_of, mapped, parameter_set, units_of
from harness.system.model import Parameter
from harness.system.units import Hop, Unit
from harness.system.values import Index, base

Place = tuple[str, ...]
"""Names of the elements on the way from the top system to an element, this element's own name last;
() for the top system.
"""

INWARD = ("input", "parameter", "structuralParameter")
"""Kinds of connectors that receive a value from outside of their element."""

EITHER = ("inout", "unspecified")
"""Kinds of connectors for which the other end determines the direction of a value."""


class Connector(NamedTuple):
    """Kind and unit of a connector as the file declares them; unit: None if none is defined."""

    kind: str
    unit: Unit | None


class Point(NamedTuple):
    """Connector of an element, given by the place of the element and the connector's name.

    Connections outside of a system and connections inside it that end at the same connector of the
    system refer to the same Point.
    """

    place: Place
    connector: str

    def __str__(self) -> str:
        return ".".join((*self.place, self.connector))


class End(NamedTuple):
    """End of a connection; element: indices of the selected array element, () for the whole."""

    point: Point
    element: Index = ()


class Edge(NamedTuple):
    """Connection in the direction of the signal; hop: conversion of the value on the way."""

    source: End
    target: End
    hop: Hop


class Leaf(NamedTuple):
    """Component: the path of its FMU, and the step size [s] that the file suggests (None: none)."""

    fmu: Path
    hint: float | None


class Given(NamedTuple):
    """Parameter for a connector, and its number `order` in the sequence of all parameters: of
    several parameters for one connector the last applies.
    """

    order: int
    parameter: Parameter


class Part(NamedTuple):
    """Kind of content that an element either names as a file or contains: MIME type, schema, and
    XML path of the content inside the element.
    """

    mime: str
    schema: str
    inline: str


VALUES = Part("application/x-ssp-parameter-set", xml.SSV_SCHEMA, "ssd:ParameterValues/*")
MAPPING = Part("application/x-ssp-parameter-mapping", xml.SSM_SCHEMA, "*")


class Tree:
    """All elements of an .ssp: components, connectors, connections (`edges`) and parameters
    (`given`); inside: by place of a system, the names of the elements directly in it.

    own: whether the file was written by this project; then a parameter that the FMU does not have
    is an error, otherwise it is ignored; problems: lines about content that cannot be read; notes:
    lines about content that is ignored or changed.
    """

    def __init__(self, folder: Path, root: XmlElement, own: bool) -> None:
        self.folder = folder
        self.own = own
        self.has_arrays = xml.is_version_2(root)
        self.units: Mapping[str, Unit] = units_of(root, "ssd:Units")
        self.problems: list[str] = []
        self.notes: list[str] = []
        self.components: dict[Place, Leaf] = {}
        self.inside: dict[Place, set[str]] = {}
        self.connectors: dict[Point, Connector] = {}
        self.edges: list[Edge] = []
        self.given: dict[Point, Given] = {}
        self._orders = count()
        self._system(xml.first(root, "ssd:System"), ())

    def _system(self, element: XmlElement, place: Place) -> None:
        names = self.inside[place] = set[str]()
        for child in xml.every(element, "ssd:Elements/*"):
            name = child.get("name")
            here = (*place, name)
            if name in names:
                self.problems.append(f"{_label(here)}: there are two elements of this name")
                continue
            names.add(name)
            (self._system if xml.kind_of(child) == "System" else self._component)(child, here)
        self._connectors(element, place)
        self._edges(element, place)
        self._bindings(element, place)

    def _edges(self, element: XmlElement, place: Place) -> None:
        for e in xml.every(element, "ssd:Connections/ssd:Connection"):
            try:
                self.edges.append(self._edge(e, place))
            except ValueError as error:
                ends = [(*place, e.get(f"{s}Element"), e.get(f"{s}Connector")) for s in SIDES]
                named = " to ".join(".".join(filter(None, end)) for end in ends)
                self.problems.append(f"{named}: {error}")

    def _component(self, element: XmlElement, place: Place) -> None:
        label, kind = _label(place), element.get("type", xml.FMU_TYPE)
        fmu = self._file(element.get("source"), label)
        if kind != xml.FMU_TYPE and not is_fmu(fmu):
            self.problems.append(f"{label}: only FMUs can be run, not {kind}")
        hint = xml.first(element, "ssd:Annotations/ssc:Annotation/osp:StepSizeHint")
        self.components[place] = Leaf(fmu, xml.number(hint, "value", self.problems))
        self._connectors(element, place)
        self._bindings(element, place)

    def _connectors(self, element: XmlElement, place: Place) -> None:
        for e in xml.every(element, "ssd:Connectors/ssd:Connector"):
            point, real = Point(place, e.get("name")), xml.first(e, "ssc:Real")
            unit = "" if real is None else real.get("unit", "")
            if unit and unit not in self.units:
                self.notes.append(
                    f"{point}: its unit {unit} is ignored, because the file does not define it"
                )
            self.connectors[point] = Connector(e.get("kind"), self.units.get(unit))

    # ---- connections

    def _edge(self, element: XmlElement, place: Place) -> Edge:
        """Return the connection that an element inside the system at `place` describes; raise
        ValueError if both ends give the signal, both take it, or a connector is missing.
        """
        (start, gives), (end, takes) = (self._end(element, side, place) for side in SIDES)
        if gives is not None and gives == takes:
            both = "ends that give a signal" if gives else "ends that take a signal"
            raise ValueError(f"connects two {both}")
        forward = takes is not True if gives is None else gives
        source, target = (start, end) if forward else (end, start)
        is_last = target.point.place in self.components  # its FMU states the unit instead
        unit = None if is_last else self.connectors[target.point].unit
        return Edge(source, target, hop_of(element, unit))

    def _end(self, element: XmlElement, side: str, place: Place) -> tuple[End, bool | None]:
        """Return the `start` or `end` of a connection, and whether it is the source of the signal
        (None if the kind of the connector leaves this open, or a component does not declare it);
        raise ValueError if there is no such element, or the system has no such connector.
        """
        name, connector = element.get(f"{side}Element"), element.get(f"{side}Connector")
        if name is not None and name not in self.inside[place]:
            close = did_you_mean(name, self.inside[place])
            raise ValueError(f"there is no component '{name}'{close}")
        point = Point(place if name is None else (*place, name), connector)
        found = self.connectors.get(point)
        if found is None and point.place not in self.components:
            raise ValueError(f"the system has no connector {connector}")
        stated = found is not None and found.kind not in EITHER
        gives = (found.kind in INWARD) == (name is None) if found and stated else None
        return End(point, indices(element, side)), gives

    # ---- parameters

    def _bindings(self, element: XmlElement, place: Place) -> None:
        """Record the parameters of all parameter sets of an element. They override the parameters
        of the elements inside it, and a later set overrides an earlier one.
        """
        label = _label(place)
        for binding in xml.every(element, "ssd:ParameterBindings/ssd:ParameterBinding"):
            try:
                for name, parameter in self._bound(binding, label).items():
                    given = Given(next(self._orders), replace(parameter, optional=not self.own))
                    self._give(place, name, given)
            except StructureError as error:
                self.problems += [f"{label}: {problem}" for problem in error.problems]

    def _give(self, place: Place, name: str, given: Given) -> None:
        """Record a parameter under the connector to which its dotted name leads from `place`: in a
        system, the first part of the name is a connector or an element inside it.
        """
        while place in self.inside and self.declared(Point(place, name)) is None:
            children = [child for child in self.inside[place] if name.startswith(f"{child}.")]
            if not children:
                note = f"{name}: no element or connector of the system has this name, ignored"
                self.notes.append(note)
                return
            child = max(children, key=len)
            place, name = (*place, child), name.removeprefix(f"{child}.")
        point = Point(place, name)
        connector = self.declared(point)
        if place in self.inside and connector and connector.kind not in INWARD:
            self.problems.append(f"{point}: start values of outputs of a system are not supported")
        self.given[point] = given

    def declared(self, point: Point) -> Connector | None:
        """Return the declaration of a connector, or of the array to which it belongs; None if there
        is neither.
        """
        whole = point._replace(connector=base(point.connector))
        return self.connectors.get(point) or self.connectors.get(whole)

    def _bound(self, binding: XmlElement, label: str) -> Mapping[str, Parameter]:
        if (root := self._part(binding, VALUES, label)) is None:
            return {}
        prefix = binding.get("prefix", "")  # applied before the mapping, which has prefixed names
        parameters = {prefix + n: p for n, p in parameter_set(root, self.units).items()}
        found = xml.first(binding, "ssd:ParameterMapping")
        root = None if found is None else self._part(found, MAPPING, label)
        return parameters if root is None else mapped(parameters, root, self.notes)

    def _part(self, element: XmlElement, part: Part, label: str) -> XmlElement | None:
        """Return the root of a parameter set or mapping, which is inside the element or in a file
        of the archive; None if there is no such content.
        """
        inline, source = xml.first(element, part.inline), element.get("source")
        if source is None and inline is None:
            kind = xml.kind_of(element)
            self.notes.append(f"{label}: a {kind} is empty and names no file, ignored")
            return None
        if element.get("type", part.mime) != part.mime:
            raise StructureError([f"{element.get('type')} cannot be read, only {part.mime}"])
        if source is None:
            return xml.embedded(inline, part.schema)
        if element.get("sourceBase") == "component":
            raise StructureError([f"{source}: a file inside an FMU is not supported"])
        path = self._file(source, label)
        return xml.parse(path, part.schema) if is_file(path) else None

    def _file(self, source: str | None, label: str) -> Path:
        """Return the path of a file inside the archive; if there is no such file, record a problem
        and return a path that is no file.
        """
        name = source or ""
        if urlsplit(name).scheme:
            self.problems.append(f"{label}: {name} is outside of the archive and is not read")
            return self.folder
        path = (self.folder / unquote(name)).resolve()
        if not path.is_relative_to(self.folder.resolve()) or not is_file(path):
            missing = name or "a file without a name"
            self.problems.append(f"{label}: {missing} is not in the archive")
            return self.folder
        return path


SIDES = ("start", "end")


def is_fmu(path: Path) -> bool:
    """Return whether a file is an FMU by its content: an archive with a modelDescription.xml."""
    try:
        return "modelDescription.xml" in inspect(path)
    except ArchiveError:
        return False


def _label(place: Place) -> str:
    return f"component {'.'.join(place)}" if place else "system"
