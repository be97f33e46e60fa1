# SPDX-License-Identifier: BSD-2-Clause
"""Arrays of SSP 2.0, element by element: `r` of three elements is `r[1]`, `r[2]`, `r[3]`, as the
graph has them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

from harness.errors import FmuError
from harness.files.archive import XmlElement
from harness.ssp.xml import NS, NUMBERS, tag
from harness.system.interface import Interface, read_interface
from harness.system.model import Connection, Port
from harness.system.values import Index, Name, Variable, elements_of, grid, index


def elements(fmu: Path | None, variable: str) -> dict[Index, str]:
    """Variables of an FMU that a name stands for, by their indices from 1 on in row-major order; of
    a scalar, and where there is no FMU to be read, the name itself by ().
    """
    try:
        variables = read_interface(fmu).variables if fmu else {}
    except FmuError:  # which is said where the graph is built
        variables = {}
    names = [] if variable in variables else elements_of(variable, variables)
    found = grid(map(index, names)) if names else None
    if found is None:
        return {(): variable}
    return {tuple(i + 1 for i in found.place(index(name))): name for name in names}


def size_text(shape: Index | None) -> str:
    """A shape in words: `a scalar`, `an array of 2 x 3`, `an array` where it is not known."""
    of = f" of {' x '.join(map(str, shape))}" if shape else ""
    return "a scalar" if shape == () else f"an array{of}"


# ---- what stands in a file


def indices(connection: XmlElement, side: str) -> Index:
    """What a connection is restricted to at its `start` or `end`, () if it is not; ValueError."""
    texts = connection.get(f"{side}Indices", "").split()
    if not all(map(_count, texts)):
        raise ValueError(f"{side}Indices='{' '.join(texts)}' are not numbers from 1 on")
    return tuple(map(int, texts))


def _count(text: str) -> int:
    """A number from 1 on, 0 for anything else."""
    return int(text) if text.isdecimal() and len(text) < 10 else 0


def parameter_names(parameter: XmlElement, count: int) -> list[str]:
    """Names of the elements of an ssv:Parameter of so many values; ValueError if its Dimensions
    want another number.
    """
    name, sizes = parameter.get("name"), parameter.findall("ssc:Dimension", NS)
    shape = tuple(_count(d.get("size", "")) for d in sizes) or (() if count == 1 else (count,))
    if math.prod(shape) != count or not count:
        raise ValueError(f"has {count} values, expected {math.prod(shape) or 1}")
    return [str(Name(name, each)) for each in product(*(range(1, n + 1) for n in shape))]


def values(element: XmlElement) -> list[str]:
    """The values of ssv:Real, ssv:String, ... as they stand there; of an array several."""
    if several := element.findall("ssv:Value", NS):
        return [value.get("value", "") for value in several]
    text: str = element.get("value", "")
    return [text] if element.tag in (tag("ssv:String"), tag("ssv:Enumeration")) else text.split()


# ---- what is written to one


class JoinedEnd(NamedTuple):
    """A connector at an end of a connection, and the element of it that is meant; () for all."""

    connector: str
    indices: Index = ()


def connector_name(interface: Interface, variable: Variable) -> str:
    """Name of a variable in SSP: of an element of an array of FMI 3.0 that of the array."""
    return Name.read(variable.name).variable if shape(interface, variable) else variable.name


def shape(interface: Interface, variable: Variable) -> Index:
    """The shape of the array of FMI 3.0 that a variable is an element of; () for a scalar, which in
    FMI 2.0 every element is.
    """
    name = Name.read(variable.name)
    if interface.fmi == 2 or not name.element:
        return ()
    row = [v.name for v in interface.row(variable)]
    found = grid(map(index, elements_of(name.variable, row)))
    return found.shape if found and len(row) == variable.size else ()


def type_name(variable: Variable, version: int) -> str:
    """Type of a variable in a version of SSP; from 2.0 on numbers have the types of FMI 3.0."""
    return variable.access if version > 1 and variable.type in NUMBERS else variable.type


def joined(
    connections: Sequence[Connection], interfaces: Mapping[str, Interface]
) -> Iterator[tuple[Connection, JoinedEnd, JoinedEnd]]:
    """Connections with both ends as SSP has them: one for all elements of two arrays that belong
    together.
    """
    bundles: dict[tuple[Port, Port], list[Connection]] = {}
    for c in connections:
        bundles.setdefault(_bundle(c), []).append(c)
    whole = {key for key, bundle in bundles.items() if _is_whole(bundle, interfaces)}
    for c in connections:
        source, target = (_end(interfaces[p.component], p.variable) for p in c[:2])
        if _bundle(c) not in whole:
            yield c, source, target
        elif c is bundles[_bundle(c)][0]:
            yield c, JoinedEnd(source.connector), JoinedEnd(target.connector)


def _is_whole(bundle: Sequence[Connection], interfaces: Mapping[str, Interface]) -> bool:
    """Whether connections join all elements of two arrays of one shape, each with its like."""
    first = bundle[0]
    ends = ((interfaces[port.component], port.variable) for port in first[:2])
    one, other = (shape(interface, interface.variables[name]) for interface, name in ends)
    alike = all(
        c.hops == first.hops and index(c.source.variable) == index(c.target.variable)
        for c in bundle
    )
    return bool(one) and one == other and alike and len(bundle) == math.prod(one)


def _bundle(c: Connection) -> tuple[Port, Port]:
    """The arrays that a connection is between."""
    return Port(c.source.component, c.source.signal), Port(c.target.component, c.target.signal)


def _end(interface: Interface, name: str) -> JoinedEnd:
    variable = interface.variables[name]
    return JoinedEnd(
        connector_name(interface, variable), index(name) if shape(interface, variable) else ()
    )
