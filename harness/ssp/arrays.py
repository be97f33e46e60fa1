# SPDX-License-Identifier: BSD-2-Clause
"""Arrays of SSP 2.0, split into scalar elements: an array `r` of three elements becomes `r[1]`,
`r[2]`, `r[3]`, the names in the graph of a system.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

from harness.errors import FmuError
from harness.files.archive import XmlElement
from harness.ssp.xml import NS, tag
from harness.system.interface import Interface, Interfaces, read_interface
from harness.system.model import Connection
from harness.system.values import Index, Name, Variable, base, elements_of, grid, index, parts_of


def elements(fmu: Path | None, variable: str) -> dict[Index, str]:
    """Return the scalar variables of an FMU that belong to a name in an SSP file, by their indices,
    counted from 1, in row-major order: {(1,): "r[1]", (2,): "r[2]"} for an array `r`.

    A scalar gives {(): its name}. If the FMU is missing or unreadable, every name is treated as a
    scalar.
    """
    try:
        variables = read_interface(fmu).variables if fmu else {}
    except FmuError:  # not reported here: harness.system.graph reports an unreadable FMU
        variables = {}
    names = [] if variable in variables else elements_of(variable, variables)
    found = grid(map(index, names)) if names else None
    if found is None:
        return {(): variable}
    return {tuple(i + 1 for i in found.place(index(name))): name for name in names}


def size_text(shape: Index | None) -> str:
    """Return a shape as text: `a scalar`, `an array of 2 x 3`, `an array` if it is unknown."""
    of = f" of {' x '.join(map(str, shape))}" if shape else ""
    return "a scalar" if shape == () else f"an array{of}"


# ---- names and values in a file


def indices(connection: XmlElement, side: str) -> Index:
    """Return the indices of the array element that a connection selects at one end, () if it
    selects none; raise ValueError for indices that are not numbers from 1 on.

    side: "start" or "end".
    """
    texts = connection.get(f"{side}Indices", "").split()
    if not all(map(_count, texts)):
        raise ValueError(f"{side}Indices='{' '.join(texts)}' are not numbers from 1 on")
    return tuple(map(int, texts))


def _count(text: str) -> int:
    """Return the positive whole number in a text of at most 9 digits, 0 for any other text."""
    return int(text) if text.isdecimal() and len(text) < 10 else 0


def parameter_names(parameter: XmlElement, count: int) -> list[str]:
    """Return the names of the elements of an ssv:Parameter with `count` values; raise ValueError if
    its Dimensions require another number.
    """
    name, sizes = parameter.get("name"), parameter.findall("ssc:Dimension", NS)
    shape = tuple(_count(d.get("size", "")) for d in sizes) or (() if count == 1 else (count,))
    if math.prod(shape) != count or not count:
        raise ValueError(f"has {count} values, expected {math.prod(shape) or 1}")
    return [str(Name(name, each)) for each in product(*(range(1, n + 1) for n in shape))]


def values(element: XmlElement) -> list[str]:
    """Return the values of an element ssv:Real, ssv:String, ... as texts: one text for a scalar,
    one per element for an array.
    """
    if several := element.findall("ssv:Value", NS):
        return [value.get("value", "") for value in several]
    text: str = element.get("value", "")
    return [text] if element.tag in (tag("ssv:String"), tag("ssv:Enumeration")) else text.split()


# ---- names and connections that are written to a file


class JoinedEnd(NamedTuple):
    """End of a connection as SSP states it: the connector, the indices of the selected array
    element (() for all elements), and the shape of the array (() for a scalar).
    """

    connector: str
    indices: Index
    shape: Index


Joined = tuple[Connection, JoinedEnd, JoinedEnd]


def connector_name(interface: Interface, variable: Variable) -> str:
    """Return the name of the SSP connector of a variable: the variable's own name, or the name of
    the whole array for an element of an array of FMI 3.0.
    """
    return base(variable.name) if shape(interface, variable) else variable.name


def shape(interface: Interface, variable: Variable) -> Index:
    """Return the shape of the array of FMI 3.0 to which a variable belongs, () for a scalar. In FMI
    2.0 every element is a scalar.
    """
    name = parts_of(variable.name)
    if interface.fmi == 2 or not name.element:
        return ()
    row = [v.name for v in interface.row(variable)]
    found = grid(map(index, elements_of(name.variable, row)))
    return found.shape if found and len(row) == variable.size else ()


def type_name(variable: Variable, version: int) -> str:
    """Return the name of a variable's type in SSP 1 or 2. In SSP 2, numbers of an FMU of FMI 3.0
    have the type names of FMI 3.0, such as Float64.
    """
    is_number = variable.type in ("Real", "Integer")
    return variable.access if version > 1 and is_number else variable.type


def joined(connections: Sequence[Connection], interfaces: Interfaces) -> Iterator[Joined]:
    """Yield every connection with its two ends as SSP states them. Two arrays of equal shape whose
    elements of equal indices are all connected, by equal conversions, yield a single connection
    without indices.
    """
    bundles: dict[tuple[str, ...], list[Joined]] = {}
    rows = []
    for c in connections:
        source, target = (_end(interfaces[port.component], port.variable) for port in c[:2])
        key = c.source.component, source.connector, c.target.component, target.connector
        rows.append((key, (c, source, target)))
        bundles.setdefault(key, []).append(rows[-1][1])
    whole = {key for key, bundle in bundles.items() if _is_whole(bundle)}
    for key, (c, source, target) in rows:
        if key not in whole:
            yield c, source, target
        elif c is bundles[key][0][0]:
            yield c, source._replace(indices=()), target._replace(indices=())


def _is_whole(bundle: Sequence[Joined]) -> bool:
    """Return whether the connections between two arrays connect every element with the element of
    the same indices, all with the same conversions.
    """
    (first, source, _), *_ = bundle
    alike = all(c.hops == first.hops and a[1:] == b[1:] for c, a, b in bundle)
    return bool(source.shape) and alike and len(bundle) == math.prod(source.shape)


def _end(interface: Interface, name: str) -> JoinedEnd:
    variable = interface.variables[name]
    sizes = shape(interface, variable)
    return JoinedEnd(connector_name(interface, variable), index(name) if sizes else (), sizes)
