# SPDX-License-Identifier: BSD-2-Clause
"""Flattening of nested systems into components with unique names and direct connections.

Each connected input of a component is followed back through the connectors of systems, scalar by
scalar, to the output that drives it or to an unconnected connector. The value of a parameter for a
connector on this way is given to the input; of several parameters the last in the file applies.
Every connection on the way is a hop, which may convert the value. The sizes of arrays are read from
the FMUs.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

from harness.ssp.arrays import elements, size_text
from harness.ssp.elements import Edge, End, Given, Place, Point, Tree
from harness.system.model import Connection, Parameter, Port
from harness.system.units import PLAIN, Hop, Unit
from harness.system.values import Index, Name

Hops = tuple[Hop, ...]

MAX_CHAIN = 200
"""Largest number of connections on the way from an output to an input; a loop passes more."""


class Flat:
    """Components, connections and parameters of a tree of nested systems, after flattening. For
    every part that cannot be flattened, a line is added to `tree.problems`.
    """

    def __init__(self, tree: Tree) -> None:
        self.tree = tree
        self.names = _names(list(tree.components))
        self.parameters: dict[Place, dict[str, Parameter]] = {p: {} for p in tree.components}
        self.connections: list[Connection] = []
        self._orders: dict[Point, int] = {}
        self._known: dict[Point, dict[Index, str]] = {}
        self._into: dict[End, list[Edge]] = {}
        for edge in tree.edges:
            self._into.setdefault(edge.target, []).append(edge)
        self._unused = {p: g for p, g in tree.given.items() if p.place in tree.inside}
        for point, given in tree.given.items():
            if point not in self._unused:
                self._set(point, given)
        for edge in tree.edges:
            if edge.target.point.place in tree.components:
                self._drive(edge)
        tree.notes += self._notes()

    def _notes(self) -> Iterator[str]:
        for point in self._unused:
            connector = self.tree.declared(point)
            # no note on a structural parameter: it is an array size, which is read from the FMU
            if connector and connector.kind != "structuralParameter":
                yield f"{point}: no component reads this connector, so its parameter is ignored"
        names = self.names.items()
        if other := [f"{'.'.join(place)} as {name}" for place, name in names if place != (name,)]:
            yield f"components renamed, since names must be unique identifiers: {', '.join(other)}"

    def declared(self) -> dict[Port, Unit]:
        """Return the units that the file declares for connectors of components."""
        return {
            self._port(point.place, name): connector.unit
            for point, connector in self.tree.connectors.items()
            if connector.unit is not None and point.place in self.tree.components
            for name in self._scalars(point).values()
        }

    # ---- signals

    def _drive(self, edge: Edge) -> None:
        """Connect every scalar of a component to which the connection `edge` leads with the output
        that drives it, and record a problem if this is not possible.
        """
        target = edge.target.point
        scalars = self._scalars(target)
        shape = next(reversed(scalars))
        try:
            for index in [edge.target.element] if edge.target.element else scalars:
                self._follow(edge, shape, index, Point(target.place, _one(scalars, target, index)))
        except ValueError as error:
            self.tree.problems.append(f"{edge.source.point} to {target}: {error}")

    def _follow(self, edge: Edge, shape: Index | None, index: Index, variable: Point) -> None:
        """Follow an input of a component back from its last connection `edge`, and connect it with
        the output that drives it, if there is one. Raise ValueError if several connections lead to
        one connector, if connected arrays differ in shape, if an array lacks the selected element,
        or if the way has more than MAX_CHAIN connections.

        shape: shape of the array to which the scalar belongs, None if a connection has selected a
        single element; index: indices of the scalar in the array.
        """
        hops: Hops = ()
        for _ in range(MAX_CHAIN):
            source, hops = edge.source.point, (edge.hop, *hops)
            if edge.target.element:
                shape, index = (), ()
            if edge.source.element:
                if index:
                    raise ValueError(_unequal((), shape))
                shape, index = None, edge.source.element
            if source.place in self.tree.components:
                self._connect(source, shape, index, variable, hops)
                return
            self._take(Point(source.place, str(Name(source.connector, index))), variable, hops)
            ends = dict.fromkeys((End(source), End(source, index)))
            before = [e for end in ends for e in self._into.get(end, ())]
            if not before:
                return
            if len(before) > 1:
                raise ValueError(f"{source} is driven {len(before)} times, expected once")
            edge = before[0]
        raise ValueError(f"has more than {MAX_CHAIN} connections on its way, perhaps in a loop")

    def _connect(
        self, source: Point, shape: Index | None, index: Index, variable: Point, hops: Hops
    ) -> None:
        scalars = self._scalars(source)
        found = next(reversed(scalars))
        if shape not in (None, found):
            raise ValueError(_unequal(found, shape))
        ends = self._port(source.place, _one(scalars, source, index)), self._port(*variable)
        self.connections.append(Connection(*ends, () if hops == (PLAIN,) else hops))

    def _scalars(self, point: Point) -> dict[Index, str]:
        """Return the scalar variables of a connector of a component by their indices, counted from
        1; a scalar has the indices (). The last key, with the largest indices, is the shape.
        """
        if point not in self._known:
            fmu = self.tree.components[point.place].fmu if self.tree.has_arrays else None
            self._known[point] = elements(fmu, point.connector)
        return self._known[point]

    def _port(self, place: Place, variable: str) -> Port:
        return Port(self.names[place], variable)

    # ---- parameters

    def _set(self, variable: Point, given: Given) -> None:
        """Set a variable to `given`, unless its value is from a parameter later in the file."""
        if given.order >= self._orders.get(variable, 0):
            self._orders[variable] = given.order
            self.parameters[variable.place][variable.connector] = given.parameter

    def _take(self, point: Point, variable: Point, hops: Hops) -> None:
        """Set a variable to the value that the file gives for the system connector `point`, if any.

        A value without a unit is in the unit of the connector; any other value is converted to this
        unit. Then `hops` convert the value on the way to the variable.
        """
        if (given := self.tree.given.get(point)) is None:
            return
        self._unused.pop(point, None)
        parameter, connector = given.parameter, self.tree.declared(point)
        unit = connector.unit if connector else None
        if unit is not None and parameter.unit is None:
            parameter = replace(parameter, unit=unit.name, meaning=unit)
        elif unit is not None:
            *earlier, last = parameter.hops or (PLAIN,)
            parameter = replace(parameter, hops=(*earlier, last._replace(unit=unit)))
        if hops != (PLAIN,) or parameter.hops:
            parameter = replace(parameter, hops=(*parameter.hops, *hops))
        self._set(variable, given._replace(parameter=parameter))


def _one(scalars: dict[Index, str], array: Point, index: Index) -> str:
    """Return the variable with these indices in an array; raise ValueError if there is none."""
    if index not in scalars:
        shape = size_text(next(reversed(scalars)))
        raise ValueError(
            f"there is no element {Name(array.connector, index)}, the connector is {shape}"
        )
    return scalars[index]


def _unequal(a: Index, b: Index | None) -> str:
    ends = f"joins {size_text(a)} with {size_text(b)}"
    return f"{ends}; select one element by startIndices or endIndices"


def _names(places: list[Place]) -> dict[Place, str]:
    """Return a unique C identifier for every component: all names of its place joined by `_`, with
    a number at the end if several components would have the same one.
    """
    names: dict[Place, str] = {}
    taken: set[str] = set()
    last: Counter[str] = Counter()
    for place in sorted(places, key=lambda place: place != (_identifier(place[0]),)):
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
