# SPDX-License-Identifier: BSD-2-Clause
"""Reading of ssd:System and ssd:Component elements, with everything bound to them, into a tree of
plain data.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote, urlsplit

from harness.errors import ArchiveError, StructureError
from harness.files.archive import XmlElement, inspect, read_entry
from harness.files.paths import is_file
from harness.spelling import did_you_mean
from harness.ssp import xml
from harness.ssp.arrays import array, array_of, dimensions, indices, names_of, one_of, size_text
from harness.ssp.parameters import (
    UnitsByName,
    hop_of,
    mapped,
    mapping,
    parameter_set,
    units_of,
)
from harness.system.model import Parameter, Parameters
from harness.system.units import Hop, Unit
from harness.system.values import Grid, Index

Place = tuple[str, ...]
"""Names of the elements from the top system down to one; the top system itself is ()."""

INWARD = ("input", "parameter", "structuralParameter")
"""Kinds of connectors that a value goes into, seen from outside of their element."""

EITHER = ("inout", "unspecified")
"""Kinds of connectors whose other end says which way a value goes."""

FIXED = ("calculatedParameter", "constant")
"""Kinds of connectors that give a value once."""


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
    """What components and systems have in common; parameters: bound to it, names relative to it;
    arrays: connectors that stand in `connectors` element by element, `r` as `r[1]`, `r[2]`.
    """

    place: Place
    connectors: Mapping[str, Connector] = field(default_factory=dict)
    parameters: Parameters = field(default_factory=dict)
    arrays: Mapping[str, Grid] = field(default_factory=dict)


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

CONNECTORS = "ssd:Connectors/ssd:Connector"
CONNECTIONS = "ssd:Connections/ssd:Connection"


class End(NamedTuple):
    """One end of a connection: its scalars, which a whole array has several of, and whether they
    give a value to the connection (None: not said).
    """

    name: Point
    points: tuple[Point, ...]
    array: Grid | None
    gives: bool | None


class Part(NamedTuple):
    """A kind of file that an element may hold instead: its type, its schema, and where it stands
    then.
    """

    mime: str
    schema: str
    inline: str


VALUES = Part("application/x-ssp-parameter-set", xml.SSV_SCHEMA, "ssd:ParameterValues/*")
MAPPING = Part("application/x-ssp-parameter-mapping", xml.SSM_SCHEMA, "*")


class ElementReader:
    """One pass over the elements of a file that collects problems instead of stopping at the first.

    own: whether the file is ours; then a parameter that its component does not have is an error;
    arrays: whether connectors may be arrays, from SSP 2.0 on.
    """

    def __init__(self, folder: Path, root: XmlElement, own: bool, arrays: bool) -> None:
        self.folder = folder
        self.units: UnitsByName = units_of(root, "ssd:Units")
        self.own = own
        self.arrays = arrays
        self.problems: list[str] = []

    # ---- elements

    def group(self, element: XmlElement, place: Place = ()) -> Group:
        """A system with all that is in it."""
        children = self._children(element, place)
        parameters = self._bindings(element, _label(place))
        inside = Group(place, parameters=parameters, children=children)
        arrays = dict(self._arrays_of_group(element, inside))
        connectors = self._connectors(element, place, arrays)
        group = replace(inside, connectors=connectors, arrays=arrays)
        return replace(group, edges=tuple(self._edges(element, group)))

    def _children(self, element: XmlElement, place: Place) -> dict[str, Element]:
        children: dict[str, Element] = {}
        for child in xml.every(element, "ssd:Elements/*"):
            name, kind = child.get("name"), xml.kind_of(child)
            here = (*place, name)
            if name in children:
                self.problems.append(f"{_label(here)}: there are two elements of this name")
            elif kind == "SignalDictionaryReference":
                self.problems.append(f"{_label(here)}: signal dictionaries are not supported")
                children[name] = Leaf(here)
            else:
                read = self.group if kind == "System" else self._leaf
                children[name] = read(child, here)
        return children

    def _leaf(self, element: XmlElement, place: Place) -> Leaf:
        label, source = _label(place), element.get("source")
        fmu = self.folder if source is None else self.file(source, label)
        if source is None:
            self.problems.append(f"{label}: names no FMU, there is nothing to run")
        self._judge_kind(element, label, fmu)
        hint = xml.first(element, "ssd:Annotations/ssc:Annotation/osp:StepSizeHint")
        arrays = dict(self._arrays_of_fmu(element, place, fmu))
        connectors = self._connectors(element, place, arrays)
        parameters = self._bindings(element, label, fmu)
        step = xml.number(hint, "value", self.problems)
        return Leaf(place, connectors, parameters, arrays, fmu, step)

    def _judge_kind(self, element: XmlElement, label: str, fmu: Path) -> None:
        """What a component is its file says; the log tells where the description differs."""
        kind = element.get("type", xml.FMU_TYPE)
        if kind != xml.FMU_TYPE:
            if is_fmu(fmu):
                _log.warning("%s: %s is an FMU, not %s", label, fmu.name, kind)
            else:
                self.problems.append(f"{label}: only FMUs can be run, not {kind}")
        if element.get("implementation") == "ScheduledExecution":
            self.problems.append(f"{label}: scheduled execution is not supported")
        if element.get("implementation") == "ModelExchange":
            _log.warning("%s: model exchange is not supported, run by co-simulation", label)

    def _connectors(
        self, element: XmlElement, place: Place, arrays: Mapping[str, Grid]
    ) -> dict[str, Connector]:
        connectors = {}
        for e in xml.every(element, CONNECTORS):
            point, real = Point(place, e.get("name")), xml.first(e, "ssc:Real")
            unit: Any = None if real is None else real.get("unit")
            if unit is not None and unit not in self.units:
                _log.warning("%s: the file does not define its unit %s, ignored", point, unit)
            if any(xml.first(e, clock) is not None for clock in ("ssc:Clock", "ssd:Clock")):
                self.problems.append(f"connector {point}: clocks are not supported")
            for name in names_of(point.connector, arrays.get(point.connector)):
                connectors[name] = Connector(e.get("kind"), self.units.get(unit))
        return connectors

    # ---- arrays

    def _arrays_of_fmu(
        self, element: XmlElement, place: Place, fmu: Path
    ) -> Iterator[tuple[str, Grid]]:
        """Connectors that are arrays; their sizes are those of the FMU, which may differ, with a
        note.
        """
        for e in xml.every(element, CONNECTORS) if self.arrays and is_file(fmu) else ():
            name = e.get("name")
            found = array_of(fmu, name)
            sizes = () if found is None else found.shape
            told = [d.get("size") for d in dimensions(e)]
            likely = [b if a is None else int(a) for a, b in zip_longest(told, sizes)]
            if likely != list(sizes):
                _log.warning("%s: is %s in the FMU, taken so", Point(place, name), size_text(found))
            if found is not None:
                yield name, found

    def _arrays_of_group(self, element: XmlElement, group: Group) -> Iterator[tuple[str, Grid]]:
        """Connectors of a system that are arrays: of the size in the file, else of what they are
        connected to inside.
        """
        for e in xml.every(element, CONNECTORS):
            sizes = [_size(d, group.parameters) for d in dimensions(e)]
            known = tuple(size for size in sizes if size)
            whole = len(known) == len(sizes)
            found = array(known) if whole else _joined(element, e, group.children)
            if found:
                yield e.get("name"), found
            elif sizes:
                self.problems.append(f"{Point(group.place, e.get('name'))}: its size is not known")

    # ---- connections

    def _edges(self, element: XmlElement, group: Group) -> Iterator[Edge]:
        for e in xml.every(element, CONNECTIONS):
            start, end = (self._end(e, side, group) for side in ("start", "end"))
            if start and end:
                yield from self._between(e, start, end, group)

    def _between(
        self, connection: XmlElement, start: End, end: End, group: Group
    ) -> Iterator[Edge]:
        """What a connection joins, scalar by scalar."""
        gives = (end.gives is None or not end.gives) if start.gives is None else start.gives
        takes = gives if end.gives is None else not end.gives
        if gives != takes:
            both = "give" if gives else "take"
            problem = f"is a connection between two that {both} a value"
        elif (start.array and start.array.shape) != (end.array and end.array.shape):
            problem = (
                f"joins {size_text(start.array)} with {size_text(end.array)}; one element has its "
                "startIndices or endIndices"
            )
        else:
            source, target = (start, end) if gives else (end, start)
            hop = self._hop(connection, target.points[0], group)
            for one, other in zip(source.points, target.points, strict=True):
                yield Edge(one, other, hop)
            return
        self.problems.append(f"{start.name} to {end.name}: {problem}")

    def _end(self, element: XmlElement, side: str, group: Group) -> End | None:
        """A connector, or the element of it that a connection is restricted to; None if it is not
        there.
        """
        name, connector = element.get(f"{side}Element"), element.get(f"{side}Connector")
        if name is not None and name not in group.children:
            fault = f"there is no component '{name}'{did_you_mean(name, group.children)}"
            self.problems.append(f"{_label((*group.place, name))}.{connector}: {fault}")
            return None
        owner = group if name is None else group.children[name]
        try:
            return self._found(owner, connector, indices(element, side), owner is group)
        except ValueError as error:
            self.problems.append(f"{Point(owner.place, connector)}: {error}")
            return None

    def _found(self, owner: Element, connector: str, place: Index, inside: bool) -> End:
        """A connector of an element, seen from inside of it or from outside; ValueError."""
        whole = _array(owner, connector) if self.arrays else None
        names = [one_of(connector, whole, place)] if place else names_of(connector, whole)
        known = owner.connectors.get(names[0])
        if known is None and isinstance(owner, Group):
            close = did_you_mean(connector, owner.connectors)
            raise ValueError(f"the system has no such connector{close}")
        gives = None
        if known is not None and known.kind not in EITHER:
            gives = (known.kind in INWARD) == inside
        points = tuple(Point(owner.place, name) for name in names)
        return End(Point(owner.place, connector), points, None if place else whole, gives)

    def _hop(self, element: XmlElement, target: Point, group: Group) -> Hop:
        for kind in ("a Boolean", "an Integer", "an Enumeration"):
            if xml.first(element, f"ssc:{kind.split()[1]}MappingTransformation") is not None:
                fault = f"{kind}MappingTransformation of a signal is not supported"
                self.problems.append(f"{target}: {fault}")
        owner = group if target.place == group.place else group.children[target.place[-1]]
        unit = owner.connectors[target.connector].unit if isinstance(owner, Group) else None
        try:
            return hop_of(element, unit)
        except ValueError as error:
            self.problems.append(f"{target}: {error}")
            return Hop()

    # ---- parameters

    def _bindings(
        self, element: XmlElement, label: str, fmu: Path | None = None
    ) -> dict[str, Parameter]:
        """All parameter sets bound to an element, later ones winning."""
        parameters: dict[str, Parameter] = {}
        for binding in xml.every(element, "ssd:ParameterBindings/ssd:ParameterBinding"):
            try:
                parameters |= self._bound(binding, label, fmu)
            except StructureError as error:
                self.problems += [f"{label}: {problem}" for problem in error.problems]
        return {name: replace(p, optional=not self.own) for name, p in parameters.items()}

    def _bound(self, binding: XmlElement, label: str, fmu: Path | None) -> Mapping[str, Parameter]:
        if (root := self._part(binding, VALUES, label, fmu)) is None:
            return {}
        prefix = binding.get("prefix", "")  # which comes before any mapping
        parameters = {prefix + n: p for n, p in parameter_set(root, self.units).items()}
        found = xml.first(binding, "ssd:ParameterMapping")
        root = None if found is None else self._part(found, MAPPING, label, fmu)
        return parameters if root is None else mapped(parameters, mapping(root))

    def _part(
        self, element: XmlElement, part: Part, label: str, fmu: Path | None
    ) -> XmlElement | None:
        """Root of a parameter set or mapping: inside the element, a file of the archive, or a file
        inside the FMU. None where a file of another tool binds nothing; the log tells.
        """
        inline, source = xml.first(element, part.inline), element.get("source")
        if source is None and inline is None:
            problem = f"a {xml.kind_of(element)} is empty and names no file"
            if self.own:
                raise StructureError([problem])
            _log.warning("%s: %s, ignored", label, problem)
            return None
        if element.get("type", part.mime) != part.mime:
            raise StructureError([f"{element.get('type')} cannot be read, only {part.mime}"])
        if source is None:
            return xml.embedded(inline, part.schema)
        if element.get("sourceBase") == "component":
            return xml.parse(self._inside(fmu, source), part.schema, name=source)
        path = self.file(source, label)
        if not is_file(path):
            raise StructureError([])
        return xml.parse(path, part.schema)

    def _inside(self, fmu: Path | None, source: str) -> bytes:
        """A file inside an FMU."""
        if fmu is None:
            raise StructureError([f"{source}: a system has no FMU that could hold this file"])
        try:
            return read_entry(fmu, unquote(source))
        except ArchiveError as error:
            raise StructureError([f"{fmu.name}: {source} cannot be read ({error})"]) from error

    def file(self, source: str | None, label: str) -> Path:
        """A file inside the archive; a problem is noted if it is not there."""
        name = source or ""
        if urlsplit(name).scheme:
            self.problems.append(f"{label}: {name} is not read, only files in the archive are")
            return self.folder
        path = (self.folder / unquote(name)).resolve()
        if not path.is_relative_to(self.folder.resolve()) or not is_file(path):
            missing = name or "a file without a name"
            self.problems.append(f"{label}: {missing} is not in the archive")
        return path


def is_fmu(path: Path) -> bool:
    """Whether a file is an FMU, whatever it is called."""
    try:
        return "modelDescription.xml" in inspect(path)
    except ArchiveError:
        return False


def _size(dimension: XmlElement, parameters: Parameters) -> int | None:
    """The size that the file gives, itself or by a parameter of the system; None if it does not."""
    if (size := dimension.get("size")) is not None:
        return int(size)
    given = parameters.get(dimension.get("sizeConnector", ""))
    return given.value if given is not None and isinstance(given.value, int) else None


def _joined(
    element: XmlElement, connector: XmlElement, children: Mapping[str, Element]
) -> Grid | None:
    """The array inside a system that a connector of it is joined to as a whole."""
    for e in xml.every(element, CONNECTIONS):
        for mine, other in (("start", "end"), ("end", "start")):
            child = children.get(e.get(f"{other}Element", ""))
            is_here = e.get(f"{mine}Connector") == connector.get("name")
            if e.get(f"{mine}Element") is None and is_here and child is not None:
                found = _array(child, e.get(f"{other}Connector"))
                if found and not indices(e, mine) and not indices(e, other):
                    return found
    return None


def _array(owner: Element, connector: str) -> Grid | None:
    """The array that a connector is, of a component also one that the file does not list."""
    if isinstance(owner, Leaf) and connector not in owner.connectors:
        return owner.arrays.get(connector) or array_of(owner.fmu, connector)
    return owner.arrays.get(connector)


def _label(place: Place) -> str:
    return f"component {'.'.join(place)}" if place else "system"
