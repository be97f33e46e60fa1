# SPDX-License-Identifier: BSD-2-Clause
"""Reading and writing of parameter sets (.ssv) of SSP, with their units, and reading of parameter
mappings (.ssm), which rename and transform parameters.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

from harness.errors import StructureError
from harness.files.archive import XmlElement, serialized
from harness.ssp import arrays, xml
from harness.ssp.arrays import connector_name, shape, type_name
from harness.ssp.xml import attributes, child, document, literal
from harness.system.conversion import final
from harness.system.interface import BASE_UNITS, Interface
from harness.system.model import Parameter, Parameters
from harness.system.units import Affine, Hop, Unit
from harness.system.values import Scalar, Variable, elements_of, resting

UnitsByName = Mapping[str, Unit]


def read_ssv(path: Path) -> dict[str, Parameter]:
    """Return the parameters of an .ssv file by name; raise StructureError if it is invalid or
    contains NaN.
    """
    return parameter_set(xml.parse(path, xml.SSV_SCHEMA))


def parameter_set(root: XmlElement, further: UnitsByName | None = None) -> dict[str, Parameter]:
    """Return the parameters of an ssv:ParameterSet element by name, arrays element by element.

    further: units by name, besides the units that the element defines. Raises StructureError if a
    value is NaN or does not fit its type, or if a parameter is given twice.
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
    """Return the units that a file defines, by name; table: XML path from the root to the element
    that contains them, such as `ssv:Units`.
    """
    units = {}
    for e in xml.every(root, f"{table}/ssc:Unit"):
        base = {n: float(e[0].get(n, "1" if n == "factor" else "0")) for n in BASE_UNITS}
        units[e.get("name")] = Unit(e.get("name"), base)
    return units


def _scalar(element: XmlElement, text: str) -> Scalar:
    """Return the text of an ssv:Real, ssv:Integer, ... as a Python value of that type; raise
    ValueError if the text does not fit, or for NaN.
    """
    kind = xml.kind_of(element)
    if kind not in ("Real", "Integer", "Boolean"):
        return text
    try:
        value = BOOLEANS[text] if kind == "Boolean" else (int if kind == "Integer" else float)(text)
    except (KeyError, ValueError):
        raise ValueError(f"'{text}' is not a value of type {kind}") from None
    if math.isnan(value):
        raise ValueError("must not be NaN")
    return value


BOOLEANS = {"true": True, "1": True, "false": False, "0": False}


# ---- mappings


def hop_of(element: XmlElement, unit: Unit | None = None) -> Hop:
    """Return the conversion that a connection or mapping entry states: first into `unit` (None:
    unit of the variable that receives the value), unless the file suppresses this, then the linear
    transformation. Raise ValueError if factor or offset is not finite.
    """
    linear = xml.first(element, "ssc:LinearTransformation")
    change = Affine()
    if linear is not None:
        change = Affine(float(linear.get("factor", "1")), float(linear.get("offset", "0")))
    if not all(map(math.isfinite, change)):
        raise ValueError("factor and offset of its transformation must be finite")
    convert = element.get("suppressUnitConversion", "false").strip() not in ("true", "1")
    return Hop(change, convert, unit)


def mapped(
    parameters: Mapping[str, Parameter], root: XmlElement, notes: list[str]
) -> dict[str, Parameter]:
    """Return the parameters of a set after an ssm:ParameterMapping element has renamed and
    transformed them, arrays element by element; raise StructureError for a missing parameter or an
    invalid transformation.

    A parameter that the mapping does not mention is left out, and a line in `notes` reports it.
    """
    problems, result, mentioned = [], {}, set[str]()
    for entry in xml.every(root, "ssm:MappingEntry"):
        source, target = entry.get("source"), entry.get("target")
        try:
            hop, names = hop_of(entry), elements_of(source, parameters)
            if not names:
                raise ValueError("the parameter set has no such parameter")
        except ValueError as error:
            problems.append(f"mapping of {source} to {target}: {error}")
            continue
        mentioned.update(names)
        for name in names:
            hops = (*parameters[name].hops, *(() if hop == Hop() else (hop,)))
            result[target + name.removeprefix(source)] = replace(parameters[name], hops=hops)
    if problems:
        raise StructureError(problems)
    if unused := ", ".join(name for name in parameters if name not in mentioned):
        notes.append(f"parameters that their mapping does not mention are not set: {unused}")
    return result


# ---- writing: one parameter set per component

BaseUnits = Mapping[str, Mapping[str, float]]
"""Definitions of units by name: exponents of the SI base units, factor and offset."""


def ssv(
    set_name: str, parameters: Parameters, interface: Interface, units: BaseUnits, version: int
) -> bytes:
    """Return the .ssv file with the parameters of one component, for version 1 or 2 of SSP.

    Values are in the units of the FMU, after all conversions; an enumeration is written as the name
    of its item. An array of FMI 3.0 (SSP 2 only) is written with all its elements; an element
    without a parameter gets its start value from the FMU.
    """
    root = document("ssv:ParameterSet", ("ssv", "ssc"), version, name=set_name)
    table = child(root, "ssv:Parameters")
    # a file of another tool may have parameters for variables that the FMU lacks; omit these
    variables = [interface.variables[name] for name in parameters if name in interface.variables]
    rows = {connector_name(interface, v): v for v in variables}
    for name, variable in rows.items():
        sizes = shape(interface, variable)
        row = interface.row(variable) if sizes else (variable,)
        values = [_written(v, parameters.get(v.name), interface) for v in row]
        element = child(table, "ssv:Parameter", name=name)
        value = child(element, f"ssv:{type_name(variable, version)}")
        listed = bool(sizes) and variable.type in ("String", "Enumeration")
        for text in values if listed else [" ".join(values)]:
            place = child(value, "ssv:Value") if listed else value
            place.set("value", "")  # attributes() would not write an empty value
            attributes(place, value=text)
        if variable.type == "Real" and variable.unit in interface.units:
            attributes(value, unit=variable.unit)
        for size in sizes:
            child(element, "ssc:Dimension", size=size)
    unit_table(root, "ssv:Units", units, (v.unit for v in variables if v.type == "Real"))
    return serialized(root, pretty=True)


def bare_ssv(set_name: str, parameters: Parameters, version: int) -> bytes:
    """Return the .ssv file with parameters for an FMU that is not in the archive. Since its units
    are unknown, every number is written without a unit and means the unit of the FMU's variable.
    """
    root = document("ssv:ParameterSet", ("ssv", "ssc"), version, name=set_name)
    table = child(root, "ssv:Parameters")
    for name, given in parameters.items():
        kind = {str: "String", bool: "Boolean"}.get(type(given.value), "Real")
        child(child(table, "ssv:Parameter", name=name), f"ssv:{kind}", value=given.value)
    return serialized(root, pretty=True)


def _written(variable: Variable, given: Parameter | None, interface: Interface) -> str:
    """Return the value of a variable as text for an .ssv: the given parameter, converted to the
    FMU's unit; if `given` is None, the FMU's start value.
    """
    number = resting(variable) if given is None else final(given, variable, interface)
    return literal(next((item for item, i in variable.items.items() if i == number), number))


def unit_table(root: XmlElement, name: str, units: BaseUnits, used: Iterable[str | None]) -> None:
    """Write the definitions of the used units as a child element `name` (ssd:Units or ssv:Units) of
    the root, or nothing if no unit is used.
    """
    names = sorted({unit for unit in used if unit in units and unit is not None})
    table = child(root, name) if names else None
    for unit in names:
        parts = {
            part: value
            for part, value in units[unit].items()
            if value != (1 if part == "factor" else 0)
        }
        child(child(table, "ssc:Unit", name=unit), "ssc:BaseUnit", **parts)
