# SPDX-License-Identifier: BSD-2-Clause
"""Reading of ssd:System and ssd:Component elements, with everything bound to them, into a tree of
plain data.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urlsplit

from harness.errors import ArchiveError, StructureError
from harness.files.archive import inspect, read_entry
from harness.files.paths import is_file
from harness.spelling import did_you_mean
from harness.ssp import xml
from harness.ssp.parameters import (
    UnitsByName,
    hop_of,
    mapped,
    mapping,
    parameter_set,
    prefixed,
    units_of,
)
from harness.system.model import Parameter, Parameters
from harness.system.units import Hop, Unit

Place = tuple[str, ...]
"""Names of the elements from the top system down to one; the top system itself is ()."""

INWARD = ("input", "parameter")
OUTWARD = ("output", "calculatedParameter")
"""Kinds of connectors by the way a value goes through them, seen from outside of their element."""


class Connector(NamedTuple):
    """A connector as the file declares it."""

    kind: str
    unit: Unit | None


class Point(NamedTuple):
    """A connector of an element; of a system it is the same point seen from inside and from
    outside.
    """

    place: Place
    connector: str

    def __str__(self) -> str:
        return ".".join((*self.place, self.connector))


class Edge(NamedTuple):
    """A connection in the direction of the signal."""

    source: Point
    target: Point
    hop: Hop


@dataclass(frozen=True)
class Element:
    """What components and systems have in common; parameters: bound to it, names relative to it."""

    place: Place
    connectors: Mapping[str, Connector] = field(default_factory=dict)
    parameters: Parameters = field(default_factory=dict)

    def __str__(self) -> str:
        return ".".join(self.place)


@dataclass(frozen=True)
class Leaf(Element):
    """A component: an FMU; hint: step that the file wishes for it [s]."""

    fmu: Path = Path()
    hint: float | None = None


@dataclass(frozen=True)
class Group(Element):
    """A system: elements by name in the order of the file, and the connections between them and its
    own connectors.
    """

    children: Mapping[str, Element] = field(default_factory=dict)
    edges: tuple[Edge, ...] = ()


_log = logging.getLogger("harness")

SSV_TYPE = "application/x-ssp-parameter-set"
SSM_TYPE = "application/x-ssp-parameter-mapping"


class ElementReader:
    """One pass over the elements of a file that collects problems instead of stopping at the first.

    own: whether the file is ours; then a parameter that its component does not have is an error.
    """

    def __init__(self, folder: Path, root: xml.XmlElement, own: bool) -> None:
        self.folder = folder
        self.units: UnitsByName = units_of(root, "ssd:Units")
        self.own = own
        self.problems: list[str] = []

    # ---- elements

    def group(self, element: xml.XmlElement, place: Place = ()) -> Group:
        """A system with all that is in it."""
        children = self._children(element, place)
        connectors = self._connectors(element, place)
        group = Group(place, connectors, self._bindings(element, _label(place)), children)
        return replace(group, edges=tuple(self._edges(element, group)))

    def _children(self, element: xml.XmlElement, place: Place) -> dict[str, Element]:
        children: dict[str, Element] = {}
        for child in element.iterfind("ssd:Elements/*", xml.NS):
            name, kind = child.get("name"), child.tag.rpartition("}")[2]
            here = (*place, name)
            if name in children:
                self.problems.append(f"{_label(here)}: there are two elements of this name")
            elif kind == "SignalDictionaryReference":
                self.problems.append(f"{_label(here)}: signal dictionaries are not supported")
                children[name] = Leaf(here)
            else:
                children[name] = (
                    self.group(child, here) if kind == "System" else self._leaf(child, here)
                )
        return children

    def _leaf(self, element: xml.XmlElement, place: Place) -> Leaf:
        label = _label(place)
        fmu = self.file(element.get("source"), label)
        self._judge_kind(element, label, fmu)
        hint = element.find("ssd:Annotations/ssc:Annotation/osp:StepSizeHint", xml.NS)
        bindings = self._bindings(element, label, fmu)
        return Leaf(
            place,
            self._connectors(element, place),
            bindings,
            fmu,
            xml.number(hint, "value", self.problems),
        )

    def _judge_kind(self, element: xml.XmlElement, label: str, fmu: Path) -> None:
        """What a component is its file says; the log tells where the description differs."""
        kind = element.get("type", xml.FMU_TYPE)
        if kind != xml.FMU_TYPE:
            if is_fmu(fmu):
                _log.warning("%s: %s is an FMU, not %s", label, fmu.name, kind)
            else:
                self.problems.append(f"{label}: only FMUs can be run, not {kind}")
        if element.get("implementation") == "ModelExchange":
            _log.warning("%s: model exchange is not supported, run by co-simulation", label)

    def _connectors(self, element: xml.XmlElement, place: Place) -> dict[str, Connector]:
        connectors = {}
        for e in element.iterfind("ssd:Connectors/ssd:Connector", xml.NS):
            unit = e.find("ssc:Real", xml.NS)
            unit = None if unit is None else unit.get("unit")
            if unit is not None and unit not in self.units:
                point = Point(place, e.get("name"))
                _log.warning("%s: the file does not define its unit %s, ignored", point, unit)
            connectors[e.get("name")] = Connector(e.get("kind"), self.units.get(unit))
        return connectors

    # ---- connections

    def _edges(self, element: xml.XmlElement, group: Group) -> Iterator[Edge]:
        for e in element.iterfind("ssd:Connections/ssd:Connection", xml.NS):
            ends = [self._end(e, side, group) for side in ("start", "end")]
            if None in ends:
                continue
            (start, start_gives), (end, end_gives) = ends  # type: ignore[misc]
            if start_gives is None:
                start_gives = end_gives is None or not end_gives
            if end_gives is None:
                end_gives = not start_gives
            if start_gives == end_gives:
                both = "give" if start_gives else "take"
                self.problems.append(
                    f"{start} to {end}: is a connection between two that {both} a value"
                )
            elif start_gives:
                yield Edge(start, end, self._hop(e, end, group))
            else:
                yield Edge(end, start, self._hop(e, start, group))

    def _end(
        self, element: xml.XmlElement, side: str, group: Group
    ) -> tuple[Point, bool | None] | None:
        """A connector and whether it gives a value to the connection (None: not said); None if it
        is not there.
        """
        name, connector = element.get(f"{side}Element"), element.get(f"{side}Connector")
        if name is not None and name not in group.children:
            close = did_you_mean(name, group.children)
            self.problems.append(
                f"{_label((*group.place, name))}.{connector}: there is no component '{name}'{close}"
            )
            return None
        owner = group if name is None else group.children[name]
        point = Point(owner.place, connector)
        known = owner.connectors.get(connector)
        if known is None and isinstance(owner, Group):
            close = did_you_mean(connector, owner.connectors)
            self.problems.append(f"{point}: the system has no such connector{close}")
            return None
        if known is None or known.kind == "inout":
            return point, None
        return point, (known.kind in INWARD) == (owner is group)

    def _hop(self, element: xml.XmlElement, target: Point, group: Group) -> Hop:
        for kind in ("a Boolean", "an Integer", "an Enumeration"):
            if element.find(f"ssc:{kind.split()[1]}MappingTransformation", xml.NS) is not None:
                self.problems.append(
                    f"{target}: {kind}MappingTransformation of a signal is not supported"
                )
        owner = group if target.place == group.place else group.children[target.place[-1]]
        unit = owner.connectors[target.connector].unit if isinstance(owner, Group) else None
        try:
            return hop_of(element, unit)
        except ValueError as error:
            self.problems.append(f"{target}: {error}")
            return Hop()

    # ---- parameters

    def _bindings(
        self, element: xml.XmlElement, label: str, fmu: Path | None = None
    ) -> dict[str, Parameter]:
        """All parameter sets bound to an element, later ones winning."""
        parameters: dict[str, Parameter] = {}
        for binding in element.iterfind("ssd:ParameterBindings/ssd:ParameterBinding", xml.NS):
            try:
                parameters |= self._bound(binding, label, fmu)
            except StructureError as error:
                self.problems += [f"{label}: {problem}" for problem in error.problems]
        return {
            name: replace(parameter, optional=not self.own)
            for name, parameter in parameters.items()
        }

    def _bound(
        self, binding: xml.XmlElement, label: str, fmu: Path | None
    ) -> Mapping[str, Parameter]:
        if self._ignored(binding, "ssd:ParameterValues/*", label):
            return {}
        root = self._part(binding, "ssd:ParameterValues/*", (SSV_TYPE, xml.SSV_SCHEMA), label, fmu)
        parameters = dict(prefixed(parameter_set(root, self.units), binding.get("prefix", "")))
        found = binding.find("ssd:ParameterMapping", xml.NS)
        if found is None or self._ignored(found, "*", label):
            return parameters
        return mapped(
            parameters, mapping(self._part(found, "*", (SSM_TYPE, xml.SSM_SCHEMA), label, fmu))
        )

    def _ignored(self, element: xml.XmlElement, inline: str, label: str) -> bool:
        """Whether a file of another tool binds nothing here; the log tells."""
        empty = element.get("source") is None and element.find(inline, xml.NS) is None
        if empty and not self.own:
            kind = element.tag.rpartition("}")[2]
            _log.warning("%s: a %s is empty and names no file, ignored", label, kind)
        return empty and not self.own

    def _part(
        self,
        element: xml.XmlElement,
        inline: str,
        kind: tuple[str, str],
        label: str,
        fmu: Path | None,
    ) -> xml.XmlElement:
        """Root of a parameter set or mapping: inside the element, a file of the archive, or a file
        inside the FMU.
        """
        mime, schema = kind
        if element.get("type", mime) != mime:
            raise StructureError([f"{element.get('type')} cannot be read, only {mime}"])
        source = element.get("source")
        if source is None:
            if (found := element.find(inline, xml.NS)) is None:
                raise StructureError(
                    [f"a {element.tag.rpartition('}')[2]} is empty and names no file"]
                )
            return xml.embedded(found, schema)
        if element.get("sourceBase") == "component":
            return self._inside(fmu, source, schema)
        path = self.file(source, label)
        if not is_file(path):
            raise StructureError([])
        return xml.parse(path, schema)

    def _inside(self, fmu: Path | None, source: str, schema: str) -> xml.XmlElement:
        if fmu is None:
            raise StructureError([f"{source}: a system has no FMU that could hold this file"])
        try:
            data = read_entry(fmu, unquote(source))
        except ArchiveError as error:
            raise StructureError([f"{fmu.name}: {source} cannot be read ({error})"]) from error
        return xml.parse(data, schema, name=source)

    def file(self, source: str | None, label: str) -> Path:
        """A file inside the archive; a problem is noted if it is not there."""
        name = source or ""
        if urlsplit(name).scheme:
            self.problems.append(f"{label}: {name} is not read, only files in the archive are")
            return self.folder
        path = (self.folder / unquote(name)).resolve()
        if not path.is_relative_to(self.folder.resolve()) or not is_file(path):
            self.problems.append(
                f"{label}: {name or 'a file without a name'} is not in the archive"
            )
        return path


def is_fmu(path: Path) -> bool:
    """Whether a file is an FMU, whatever it is called."""
    try:
        return "modelDescription.xml" in inspect(path)
    except ArchiveError:
        return False


def _label(place: Place) -> str:
    return f"component {'.'.join(place)}" if place else "system"
