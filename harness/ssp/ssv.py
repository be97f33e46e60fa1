# SPDX-License-Identifier: BSD-2-Clause
"""Parameter sets as .ssv files, one per component, and tables of units as .ssd and .ssv have
them.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from lxml import etree

from harness.ssp.xml import NS, TOOL, XmlElement, attributes, child, serialized, tag
from harness.system.conversion import final
from harness.system.interface import Interface
from harness.system.model import Parameter, Parameters
from harness.system.values import Variable

BaseUnits = Mapping[str, Mapping[str, float]]
"""Base units (exponents, factor, offset) by name."""


def ssv(set_name: str, parameters: Parameters, interface: Interface, units: BaseUnits) -> bytes:
    """A parameter set of one component; names are relative to the component."""
    root = etree.Element(tag("ssv:ParameterSet"), nsmap={"ssv": NS["ssv"], "ssc": NS["ssc"]})
    attributes(root, version="1.0", name=set_name, generationTool=TOOL)
    table = child(root, "ssv:Parameters")
    for name, given in parameters.items():
        if name in interface.variables:  # in files of other tools others are ignored
            _parameter(table, interface, interface.variables[name], given)
    variables = (interface.variables[name] for name in parameters if name in interface.variables)
    unit_table(root, "ssv:Units", units, (v.unit for v in variables if v.type == "Real"))
    return serialized(root)


def bare_ssv(set_name: str, parameters: Parameters) -> bytes:
    """Parameters for an FMU that is not in the archive: numbers in the units of its own
    variables.
    """
    root = etree.Element(tag("ssv:ParameterSet"), nsmap={"ssv": NS["ssv"], "ssc": NS["ssc"]})
    attributes(root, version="1.0", name=set_name, generationTool=TOOL)
    table = child(root, "ssv:Parameters")
    for name, given in parameters.items():
        kind = "String" if isinstance(given.value, str) else "Real"
        child(child(table, "ssv:Parameter", name=name), f"ssv:{kind}", value=given.value)
    return serialized(root)


def _parameter(
    table: XmlElement, interface: Interface, variable: Variable, given: Parameter
) -> None:
    """One parameter as it reaches the FMU: in its unit, an enumeration by the name of the item."""
    number = final(given, variable, interface)
    written = next((item for item, value in variable.items.items() if value == number), number)
    value = child(
        child(table, "ssv:Parameter", name=variable.name), f"ssv:{variable.type}", value=written
    )
    if variable.type == "Real" and variable.unit in interface.units:
        attributes(value, unit=variable.unit)


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
