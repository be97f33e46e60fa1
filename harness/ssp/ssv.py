# SPDX-License-Identifier: BSD-2-Clause
"""Parameter sets as .ssv files, one per component, and tables of units as .ssd and .ssv have
them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from lxml import etree

from harness.ssp.arrays import connector_name, shape, type_name
from harness.ssp.xml import NS, TOOL, XmlElement, attributes, child, literal, serialized, tag
from harness.system.conversion import final
from harness.system.interface import Interface
from harness.system.model import Parameter, Parameters
from harness.system.values import Variable, resting

BaseUnits = Mapping[str, Mapping[str, float]]
"""Base units (exponents, factor, offset) by name."""


def ssv(
    set_name: str, parameters: Parameters, interface: Interface, units: BaseUnits, version: int
) -> bytes:
    """A parameter set of one component; names are relative to the component. Of an array of FMI 3.0
    it has all elements, from SSP 2.0 on.
    """
    root = etree.Element(tag("ssv:ParameterSet"), nsmap={"ssv": NS["ssv"], "ssc": NS["ssc"]})
    attributes(root, version=f"{version}.0", name=set_name, generationTool=TOOL)
    table = child(root, "ssv:Parameters")
    # in files of other tools others are ignored
    variables = [interface.variables[name] for name in parameters if name in interface.variables]
    rows = {connector_name(interface, v): v for v in variables}
    for name, variable in rows.items():
        _parameter(
            child(table, "ssv:Parameter", name=name), interface, variable, parameters, version
        )
    unit_table(root, "ssv:Units", units, (v.unit for v in variables if v.type == "Real"))
    return serialized(root)


def bare_ssv(set_name: str, parameters: Parameters, version: int) -> bytes:
    """Parameters for an FMU that is not in the archive: numbers in the units of its own
    variables.
    """
    root = etree.Element(tag("ssv:ParameterSet"), nsmap={"ssv": NS["ssv"], "ssc": NS["ssc"]})
    attributes(root, version=f"{version}.0", name=set_name, generationTool=TOOL)
    table = child(root, "ssv:Parameters")
    for name, given in parameters.items():
        kind = "String" if isinstance(given.value, str) else "Real"
        child(child(table, "ssv:Parameter", name=name), f"ssv:{kind}", value=given.value)
    return serialized(root)


def _parameter(
    element: XmlElement,
    interface: Interface,
    variable: Variable,
    parameters: Parameters,
    version: int,
) -> None:
    """One parameter, or all elements of an array, as they reach the FMU: in its unit, an
    enumeration by the name of the item.
    """
    sizes = shape(interface, variable)
    row = interface.row(variable) if sizes else (variable,)
    values = [_written(v, parameters.get(v.name), interface) for v in row]
    value = child(element, f"ssv:{type_name(variable, version)}")
    if sizes and variable.type in ("String", "Enumeration"):
        for each in values:
            _set(child(value, "ssv:Value"), each)
    else:
        _set(value, " ".join(values))
    if variable.type == "Real" and variable.unit in interface.units:
        attributes(value, unit=variable.unit)
    for size in sizes:
        child(element, "ssc:Dimension", size=size)


def _set(element: XmlElement, text: str) -> None:
    element.set("value", "")  # which attributes() leaves out
    attributes(element, value=text)


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
