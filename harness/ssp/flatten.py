# SPDX-License-Identifier: BSD-2-Clause
"""Nested systems made flat: components with names of their own, signals followed through the
connectors of systems.

A signal may pass several systems on its way from an output to an input; every connection on the way
is a hop. A parameter bound to a system goes down by its dotted name, or through the connector of
that name.
"""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

from harness.ssp.elements import FIXED, INWARD, Connector, Edge, Element, Group, Leaf, Place, Point
from harness.system.model import Connection, Parameter, Port
from harness.system.units import PLAIN, Hop, Unit

_log = logging.getLogger("harness")

Way = tuple[Point, tuple[Hop, ...]]
"""An end of a chain of connections through systems, and all hops of the chain."""

MAX_WAYS = 10
"""Ways to one connector that are followed."""

MAX_CHAIN = 200
"""Connectors of systems in a row that are followed."""


class Flat:
    """A tree of systems as components and connections; problems: what cannot be flattened, one line
    each.
    """

    def __init__(self, top: Group) -> None:
        self.problems: list[str] = []
        elements = list(_elements(top))
        self.leaves = {e.place: e for e in elements if isinstance(e, Leaf)}
        self.names = _names(list(self.leaves))
        self._edges = [edge for e in elements if isinstance(e, Group) for edge in e.edges]
        self._to: dict[Point, list[Edge]] = {}
        self._from: dict[Point, list[Edge]] = {}
        for edge in self._edges:
            self._to.setdefault(edge.target, []).append(edge)
            self._from.setdefault(edge.source, []).append(edge)
        self._known: dict[Point, list[Way]] = {}
        self._circle: set[Point] = set()
        self._connectors = {Point(e.place, n): c for e in elements for n, c in e.connectors.items()}
        self.parameters: dict[Place, dict[str, Parameter]] = {place: {} for place in self.leaves}
        self.connections = tuple(self._connections())
        self._bind(top)
        self._report_names()

    # ---- signals

    def _connections(self) -> Iterator[Connection]:
        for edge in self._edges:
            if edge.target.place in self.leaves:
                for source, hops in self._ways(edge):
                    way = () if hops == (PLAIN,) else hops
                    yield Connection(self._port(source), self._port(edge.target), way)

    def _ways(self, edge: Edge) -> list[Way]:
        """Outputs that reach the end of a connection, and all hops up to there; none behind an open
        connector.
        """
        source = edge.source
        if source.place not in self.leaves:
            return [(origin, (*hops, edge.hop)) for origin, hops in self._behind(source)]
        if source in self._connectors and self._connectors[source].kind in FIXED:
            self.problems.append(f"{source}: connections between parameters are not supported")
        return [(source, (edge.hop,))]

    def _behind(self, point: Point) -> list[Way]:
        """Ways to a connector of a system, found once; not more than MAX_WAYS, since one is right
        and each level of systems could double them.
        """
        if point not in self._known:
            if len(self._circle) > MAX_CHAIN:
                self.problems.append(f"{point}: lies behind more than {MAX_CHAIN} connectors")
                return []
            self._known[point] = []  # what comes back here while it is looked for goes in a circle
            self._circle.add(point)
            ways = [way for before in self._to.get(point, ()) for way in self._ways(before)]
            if len(ways) > MAX_WAYS:
                self.problems.append(f"{point}: is driven on more than {MAX_WAYS} ways")
            self._circle.discard(point)
            self._known[point] = ways[:MAX_WAYS]
        elif point in self._circle:
            self.problems.append(f"{point}: the connectors of systems drive each other in a circle")
        return self._known[point]

    def _port(self, point: Point) -> Port:
        return Port(self.names[point.place], point.connector)

    def declared(self) -> dict[Port, Unit]:
        """Units that the file claims for variables of components."""
        inside = ((p, c.unit) for p, c in self._connectors.items() if p.place in self.leaves)
        return {self._port(point): unit for point, unit in inside if unit is not None}

    # ---- parameters

    def _bind(self, element: Element) -> None:
        """Parameters of an element over those of the elements in it: the outer binding wins."""
        if isinstance(element, Group):
            for child in element.children.values():
                self._bind(child)
        for name, parameter in element.parameters.items():
            self._assign(element, name, parameter)

    def _assign(self, element: Element, name: str, parameter: Parameter) -> None:
        if isinstance(element, Leaf):
            self.parameters[element.place][name] = parameter
        elif name in element.connectors:
            self._enter(Point(element.place, name), element.connectors[name], parameter)
        elif isinstance(element, Group) and (child := _owner(element, name)):
            self._assign(element.children[child], name[len(child) + 1 :], parameter)
        else:
            _log.warning("%s: no element or connector of the system has this name, ignored", name)

    def _enter(self, point: Point, connector: Connector, parameter: Parameter) -> None:
        """A parameter for a connector of a system, in its unit, goes to all that it drives."""
        if connector.kind not in INWARD:
            self.problems.append(f"{point}: start values of outputs of a system are not supported")
            return
        if parameter.unit is None and connector.unit is not None:
            parameter = replace(parameter, unit=connector.unit.name, meaning=connector.unit)
        elif connector.unit is not None:
            *earlier, last = parameter.hops or (PLAIN,)
            parameter = replace(parameter, hops=(*earlier, last._replace(unit=connector.unit)))
        reached = list(self._ends(point))
        for end, hops in reached:
            self.parameters[end.place][end.connector] = _sent(parameter, hops)
        if not reached and connector.kind != "structuralParameter":  # which may be a mere size
            _log.warning("%s: the connector is not connected, its value is ignored", point)

    def _ends(self, start: Point) -> Iterator[Way]:
        """Variables of components behind a connector of a system, and the hops to them."""
        seen: set[Point] = {start}
        waiting: list[Way] = [(start, ())]
        while waiting:
            point, hops = waiting.pop(0)
            for edge in self._from.get(point, ()):
                if edge.target not in seen:
                    seen.add(edge.target)
                    way = (edge.target, (*hops, edge.hop))
                    if edge.target.place in self.leaves:
                        yield way
                    else:
                        waiting.append(way)

    # ---- names

    def _report_names(self) -> None:
        names = self.names.items()
        changed = [f"{'.'.join(place)} as {name}" for place, name in names if place != (name,)]
        if changed:
            _log.warning("components with other names than in the file: %s", ", ".join(changed))


def _sent(parameter: Parameter, hops: tuple[Hop, ...]) -> Parameter:
    """A parameter at the end of some hops; those that do nothing are left out."""
    if hops == (PLAIN,) and not parameter.hops:
        return parameter
    return replace(parameter, hops=(*parameter.hops, *hops))


def _owner(group: Group, name: str) -> str | None:
    """The element that a dotted name begins with; of several the longest."""
    beginnings = (child for child in group.children if name.startswith(f"{child}."))
    return max(beginnings, key=len, default=None)


def _elements(element: Element) -> Iterator[Element]:
    """An element and all in it, from the outside in."""
    yield element
    if isinstance(element, Group):
        for child in element.children.values():
            yield from _elements(child)


def _names(places: list[Place]) -> dict[Place, str]:
    """A C identifier for every component: its own name, or all names on the way to it joined;
    unique.
    """
    fitting = (place for place in places if place == (_identifier(place[0]),))
    names: dict[Place, str] = {place: place[0] for place in fitting}
    taken = set(names.values())
    last: Counter[str] = Counter()
    for place in (place for place in places if place not in names):
        wish = name = _identifier("_".join(place))
        while name in taken:
            last[wish] += 1
            name = f"{wish}_{last[wish] + 1}"
        taken.add(name)
        names[place] = name
    return {place: names[place] for place in places}


def _identifier(name: str) -> str:
    text = re.sub(r"\W+", "_", name, flags=re.ASCII)
    return f"_{text}" if text[:1].isdigit() or not text else text
