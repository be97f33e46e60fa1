# SPDX-License-Identifier: BSD-2-Clause
"""A System element of SSP as a tree of plain data, before it is flattened: components, nested
systems, connections.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from harness.system.model import Parameters
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
