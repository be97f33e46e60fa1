# SPDX-License-Identifier: BSD-2-Clause
"""Hand-made .ssp files as other tools write them, put together from a few words; no code of the
project is used.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path

ROOT = """<?xml version="1.0" encoding="UTF-8"?>
<d:SystemStructureDescription version="{version}" name="third_party"
    xmlns:d="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:c="http://ssp-standard.org/SSP1/SystemStructureCommon"
    xmlns:v="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    xmlns:p="http://ssp-standard.org/SSP1/SystemStructureParameterMapping">
  {system}{units}{experiment}
</d:SystemStructureDescription>
"""
UNITS = {
    "1": "", "m": 'm="1"', "s": 's="1"', "km": 'm="1" factor="1000"', "cm": 'm="1" factor="0.01"',
    "K": 'K="1"', "degC": 'K="1" offset="273.15"',
}  # fmt: skip


def units(prefix: str) -> str:
    return (
        f"<{prefix}:Units>"
        + "".join(unit(n, base) for n, base in UNITS.items())
        + f"</{prefix}:Units>"
    )


def unit(name: str, base: str) -> str:
    return f'<c:Unit name="{name}"><c:BaseUnit {base}/></c:Unit>'


def connectors(names: Iterable[str]) -> str:
    """`u<` is an input, `y>` an output, `k=` a parameter, `z~` a calculated one; `u< km` has a
    unit.
    """
    parts = []
    for text in names:
        name, _, unit_ = text.partition(" ")
        kind = {"<": "input", ">": "output", "=": "parameter", "~": "calculatedParameter"}[name[-1]]
        real = f'<c:Real unit="{unit_}"/>' if unit_ else ""
        parts.append(f'<d:Connector name="{name[:-1]}" kind="{kind}">{real}</d:Connector>')
    return f"<d:Connectors>{''.join(parts)}</d:Connectors>" if parts else ""


def component(name: str, fmu: str, *ports: str, bindings: str = "", **attributes: str) -> str:
    further = "".join(f' {key}="{value}"' for key, value in attributes.items())
    return (
        f'<d:Component name="{name}" source="resources/{fmu}.fmu"{further}>'
        f"{connectors(ports)}{bound(bindings)}</d:Component>"
    )


def system(
    name: str, elements: Iterable[str], wires: Iterable[str], *ports: str, bindings: str = ""
) -> str:
    """Wires are `a.y b.u` or `y b.u` for an own connector, with further XML after a second
    space.
    """
    connections = "".join(map(connection, wires))
    connections = f"<d:Connections>{connections}</d:Connections>" if connections else ""
    inside = f"<d:Elements>{''.join(elements)}</d:Elements>"
    head = f'<d:System name="{name}">{connectors(ports)}{bound(bindings)}'
    return f"{head}{inside}{connections}</d:System>"


def connection(text: str) -> str:
    start, end, *further = text.split(" ", 2)
    inside = "".join(part for part in further if part.startswith("<"))
    attributes = "".join(part for part in further if not part.startswith("<"))
    if attributes and "<" in attributes:
        attributes, inside = attributes.split("<", 1)[0], "<" + attributes.split("<", 1)[1]
    ends = _end("start", start) + _end("end", end)
    return f"<d:Connection{ends} {attributes}>{inside}</d:Connection>"


def _end(side: str, port: str) -> str:
    element, dot, connector = port.partition(".")
    return (
        f' {side}Element="{element}" {side}Connector="{connector}"'
        if dot
        else f' {side}Connector="{port}"'
    )


def bound(bindings: str) -> str:
    return f"<d:ParameterBindings>{bindings}</d:ParameterBindings>" if bindings else ""


def inline(parameters: str, mapping: str = "", prefix: str = "") -> str:
    mapped = f"<d:ParameterMapping>{mapping}</d:ParameterMapping>" if mapping else ""
    begin = f'<d:ParameterBinding prefix="{prefix}">' if prefix else "<d:ParameterBinding>"
    return (
        f"{begin}<d:ParameterValues>{parameters}</d:ParameterValues>{mapped}</d:ParameterBinding>"
    )


def ssv(*parameters: str, namespaces: bool = False, version: str = "1.0") -> str:
    """Parameters as `name=value`, `name=value unit`; `name=Item!` is an enumeration, `name=true`,
    `name=3i`.
    """
    space = NAMESPACES if namespaces else ""
    inside = "".join(map(_parameter, parameters))
    return (
        f'<v:ParameterSet {space} version="{version}" name="x">'
        f"<v:Parameters>{inside}</v:Parameters>{units('v')}</v:ParameterSet>"
    )


NAMESPACES = """xmlns:v="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    xmlns:p="http://ssp-standard.org/SSP1/SystemStructureParameterMapping"
    xmlns:c="http://ssp-standard.org/SSP1/SystemStructureCommon" """


def _parameter(text: str) -> str:
    name, _, rest = text.partition("=")
    value, _, unit_ = rest.partition(" ")
    if value.endswith("!"):
        kind, value = "Enumeration", value[:-1]
    elif value in ("true", "false"):
        kind = "Boolean"
    elif value.endswith("i"):
        kind, value = "Integer", value[:-1]
    else:
        kind = "Real"
    unit_ = f' unit="{unit_}"' if unit_ else ""
    return f'<v:Parameter name="{name}"><v:{kind} value="{value}"{unit_}/></v:Parameter>'


def ssm(*entries: str, namespaces: bool = False) -> str:
    """Entries `source target` with further XML after a second space."""
    space = NAMESPACES if namespaces else ""
    inside = "".join(map(_entry, entries))
    return f'<p:ParameterMapping {space} version="1.0">{inside}</p:ParameterMapping>'


def _entry(text: str) -> str:
    source, target, *further = text.split(" ", 2)
    return (
        f'<p:MappingEntry source="{source}" target="{target}">{"".join(further)}</p:MappingEntry>'
    )


def linear(factor: float = 1.0, offset: float = 0.0) -> str:
    return f'<c:LinearTransformation factor="{factor}" offset="{offset}"/>'


EXPERIMENT = """<d:DefaultExperiment startTime="0" stopTime="3"><d:Annotations>
    <c:Annotation type="com.opensimulationplatform"><o:Algorithm
      xmlns:o="http://opensimulationplatform.com/SSP/OSPAnnotations">
      <o:FixedStepAlgorithm baseStepSize="1"/></o:Algorithm>
    </c:Annotation></d:Annotations></d:DefaultExperiment>"""


def write(
    path: Path,
    top: str,
    fmus: Mapping[str, Path],
    files: Mapping[str, str] | None = None,
    experiment: str = EXPERIMENT,
    version: str = "1.0",
) -> Path:
    """Pack a description with all FMUs whose names occur in it, and further files."""
    text = ROOT.format(version=version, system=top, units=units("d"), experiment=experiment)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("SystemStructure.ssd", text)
        for name, fmu in fmus.items():
            if f"resources/{name}.fmu" in text:
                archive.write(fmu, f"resources/{name}.fmu")
        for name, content in (files or {}).items():
            archive.writestr(name, content)
    return path
