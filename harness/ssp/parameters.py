# SPDX-License-Identifier: BSD-2-Clause
"""Parameter sets (.ssv) and parameter mappings (.ssm) of SSP, read and written: names, values,
units, and what a mapping does to them.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from harness.errors import StructureError
from harness.files.archive import XmlElement
from harness.ssp import arrays, xml
from harness.ssp.arrays import connector_name, shape, type_name
from harness.ssp.xml import attributes, child, document, literal, serialized
from harness.system.conversion import final
from harness.system.interface import BASE_UNITS, Interface
from harness.system.model import Parameter, Parameters
from harness.system.units import Affine, Hop, Unit
from harness.system.values import Scalar, Variable, elements_of, resting

_log = logging.getLogger("harness")

UnitsByName = Mapping[str, Unit]


class Entry(NamedTuple):
    """Parameter `source` of a set goes to `target`, changed by a hop or, where it is no number, by
    a table.
    """

    source: str
    target: str
    hop: Hop
    table: Mapping[str, str] | None


def read_ssv(path: Path) -> dict[str, Parameter]:
    """Parameters of an .ssv file by name; StructureError if it is not one or holds NaN."""
    return parameter_set(xml.parse(path, xml.SSV_SCHEMA))


def parameter_set(root: XmlElement, further: UnitsByName | None = None) -> dict[str, Parameter]:
    """Parameters of an ssv:ParameterSet element by name, arrays element by element; further: units
    known beside its own.

    Raises StructureError if a value is NaN or binary, or a parameter is given twice.
    """
    units = {**(further or {}), **units_of(root, "ssv:Units")}
    parameters, problems = dict[str, Parameter](), list[str]()
    for element in xml.every(root, "ssv:Parameters/ssv:Parameter"):
        name, value = element.get("name"), element[0]
        unit = value.get("unit")
        try:
            scalars = [_scalar(value, text) for text in arrays.values(value)]
            names = arrays.parameter_names(element, len(scalars))
        except ValueError as error:
            problems.append(f"parameter {name}: {error}")
            continue
        if not parameters.keys().isdisjoint(names):
            problems.append(f"parameter {name}: is given twice")
        for each, scalar in zip(names, scalars, strict=True):
            parameters[each] = Parameter(scalar, unit, units.get(unit))
    if problems:
        raise StructureError(problems)
    return parameters


def units_of(root: XmlElement, table: str) -> dict[str, Unit]:
    """Units that a file defines, by name."""
    units = {}
    for e in xml.every(root, f"{table}/ssc:Unit"):
        base = {n: float(e[0].get(n, "1" if n == "factor" else "0")) for n in BASE_UNITS}
        units[e.get("name")] = Unit(e.get("name"), base)
    return units


def _scalar(element: XmlElement, text: str) -> Scalar:
    """A value of ssv:Real, ssv:Integer, ... as Python has it."""
    match xml.kind_of(element):
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


# ---- mappings


def mapping(root: XmlElement) -> list[Entry]:
    """Entries of an ssm:ParameterMapping element; StructureError with every transformation that
    makes no sense.
    """
    entries, problems = [], []
    for element in xml.every(root, "ssm:MappingEntry"):
        try:
            table, hop = _table(element), hop_of(element)
            entries.append(Entry(element.get("source"), element.get("target"), hop, table))
        except ValueError as error:
            problems.append(f"mapping of {element.get('source')}: {error}")
    if problems:
        raise StructureError(problems)
    return entries


def hop_of(element: XmlElement, unit: Unit | None = None) -> Hop:
    """What a connection or mapping entry does to a number that ends in `unit`; ValueError if it is
    not finite.
    """
    linear = xml.first(element, "ssc:LinearTransformation")
    change = Affine()
    if linear is not None:
        change = Affine(float(linear.get("factor", "1")), float(linear.get("offset", "0")))
    if not all(map(math.isfinite, change)):
        raise ValueError("factor and offset of its transformation must be finite")
    convert = element.get("suppressUnitConversion", "false").strip() not in ("true", "1")
    return Hop(change, convert, unit)


def _table(element: XmlElement) -> dict[str, str] | None:
    """Table of a Boolean-, Integer- or EnumerationMappingTransformation as texts, None without
    one.
    """
    for kind in ("Boolean", "Integer", "Enumeration"):
        found = xml.first(element, f"ssc:{kind}MappingTransformation")
        if found is not None:
            return {_key(kind, e.get("source")): _key(kind, e.get("target")) for e in found}
    return None


def _key(kind: str, text: str) -> str:
    """One spelling for one value: true for 1, 7 for +7."""
    if kind == "Boolean":
        return "true" if text.strip() in ("true", "1") else "false"
    return str(int(text)) if kind == "Integer" else text


def mapped(parameters: Mapping[str, Parameter], entries: list[Entry]) -> dict[str, Parameter]:
    """Parameters under the names of their targets; StructureError if one is not there or not in its
    table.

    What a mapping does not mention is not set; the log says so.
    """
    problems, result = [], {}
    entries = list(chain.from_iterable(_elementwise(entry, parameters) for entry in entries))
    for entry in entries:
        try:
            result[entry.target] = _transformed(parameters, entry)
        except ValueError as error:
            problems.append(f"mapping of {entry.source} to {entry.target}: {error}")
    if problems:
        raise StructureError(problems)
    mentioned = {entry.source for entry in entries}
    if unused := ", ".join(name for name in parameters if name not in mentioned):
        _log.warning("parameters that their mapping does not mention are not set: %s", unused)
    return result


def _elementwise(entry: Entry, parameters: Mapping[str, Parameter]) -> Iterator[Entry]:
    """An entry for every element of an array; of a scalar the entry as it is."""
    for name in elements_of(entry.source, parameters) or [entry.source]:
        place = name.removeprefix(entry.source)
        yield entry._replace(source=name, target=entry.target + place)


def _transformed(parameters: Mapping[str, Parameter], entry: Entry) -> Parameter:
    if entry.source not in parameters:
        raise ValueError("the parameter set has no such parameter")
    parameter = parameters[entry.source]
    if entry.table is None:
        further = () if entry.hop == Hop() else (entry.hop,)
        return replace(parameter, hops=(*parameter.hops, *further))
    value = parameter.value
    key = str(value).lower() if isinstance(value, bool) else str(value)
    if key not in entry.table:
        raise ValueError(f"its table has no entry for {key}")
    text = entry.table[key]
    if isinstance(value, bool):
        return replace(parameter, value=text == "true")
    return replace(parameter, value=text if isinstance(value, str) else int(text))


# ---- to be written, one set per component

BaseUnits = Mapping[str, Mapping[str, float]]
"""Base units (exponents, factor, offset) by name."""


def ssv(
    set_name: str, parameters: Parameters, interface: Interface, units: BaseUnits, version: int
) -> bytes:
    """A parameter set of one component; names are relative to the component. Of an array of FMI 3.0
    it has all elements, from SSP 2.0 on. Values are those that reach the FMU: in its unit, an
    enumeration by the name of the item.
    """
    root = document("ssv:ParameterSet", ("ssv", "ssc"), version, name=set_name)
    table = child(root, "ssv:Parameters")
    # in files of other tools others are ignored
    variables = [interface.variables[name] for name in parameters if name in interface.variables]
    rows = {connector_name(interface, v): v for v in variables}
    for name, variable in rows.items():
        sizes = shape(interface, variable)
        row = interface.row(variable) if sizes else (variable,)
        values = [_written(v, parameters.get(v.name), interface) for v in row]
        element = child(table, "ssv:Parameter", name=name)
        value = child(element, f"ssv:{type_name(variable, version)}")
        _fill(value, values, listed=bool(sizes) and variable.type in ("String", "Enumeration"))
        if variable.type == "Real" and variable.unit in interface.units:
            attributes(value, unit=variable.unit)
        for size in sizes:
            child(element, "ssc:Dimension", size=size)
    unit_table(root, "ssv:Units", units, (v.unit for v in variables if v.type == "Real"))
    return serialized(root)


def bare_ssv(set_name: str, parameters: Parameters, version: int) -> bytes:
    """Parameters for an FMU that is not in the archive: numbers in the units of its own
    variables.
    """
    root = document("ssv:ParameterSet", ("ssv", "ssc"), version, name=set_name)
    table = child(root, "ssv:Parameters")
    for name, given in parameters.items():
        kind = "String" if isinstance(given.value, str) else "Real"
        child(child(table, "ssv:Parameter", name=name), f"ssv:{kind}", value=given.value)
    return serialized(root)


def _fill(element: XmlElement, values: Sequence[str], listed: bool) -> None:
    """Write values into an element, each into one of its own or all into one attribute."""
    for text in values if listed else [" ".join(values)]:
        place = child(element, "ssv:Value") if listed else element
        place.set("value", "")  # which attributes() leaves out
        attributes(place, value=text)


def _written(variable: Variable, given: Parameter | None, interface: Interface) -> str:
    """The value of a variable in an .ssv, that of its FMU where nothing is given."""
    number = resting(variable) if given is None else final(given, variable, interface)
    return literal(next((item for item, i in variable.items.items() if i == number), number))


def unit_table(root: XmlElement, name: str, units: BaseUnits, used: Iterable[str | None]) -> None:
    """The definitions of the units that are used, if any, as element ssd:Units or ssv:Units."""
    names = sorted({unit for unit in used if unit in units and unit is not None})
    table = child(root, name) if names else None
    for unit in names:
        parts = {
            part: value
            for part, value in units[unit].items()
            if value != (1 if part == "factor" else 0)
        }
        child(child(table, "ssc:Unit", name=unit), "ssc:BaseUnit", **parts)
