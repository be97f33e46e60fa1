# SPDX-License-Identifier: BSD-2-Clause
"""XML of SSP: namespaces, reading of files that are valid by the schemas, writing of elements.

SSP 2.0 has the namespaces of SSP 1.0, so the schemas of 1.0 check a file of 2.0 after all additions
of 2.0 are removed from it: arrays, types and kinds of connectors of FMI 3.0, metadata.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from copy import deepcopy
from pathlib import Path

from lxml import etree

from harness.conformance.check import fmpy_schema
from harness.conformance.description import NUMBERS, TYPES
from harness.errors import StructureError, reason_of
from harness.files.archive import MAX_ENTRY, UnsafeXmlError, XmlElement, parsed
from harness.files.paths import contents
from harness.system.values import Scalar

NS = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "ssm": "http://ssp-standard.org/SSP1/SystemStructureParameterMapping",
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
    "run": "urn:io.github.servicing-fmus:run:1",
}
"""Namespaces by the prefixes that libcosim, ecos and OMSimulator expect literally; `run` is the
namespace of the annotation of this project.
"""

SSD_FILE = "SystemStructure.ssd"
OSP_ANNOTATION = "com.opensimulationplatform"
OMS_ANNOTATION = "org.openmodelica"
RUN_ANNOTATION = "io.github.servicing-fmus"
TOOL = "servicing-fmus"
FMU_TYPE = "application/x-fmu-sharedlibrary"


def tag(name: str) -> str:
    """Return the name that lxml gives to an element written with a prefix: `ssd:System` gives
    `{http://...}System`.
    """
    prefix, local = name.split(":")
    return f"{{{NS[prefix]}}}{local}"


# ---- reading

SSD_SCHEMA = "SystemStructureDescription.xsd"
SSV_SCHEMA = "SystemStructureParameterValues.xsd"
SSM_SCHEMA = "SystemStructureParameterMapping.xsd"

NOT_SUPPORTED = tuple(
    map(
        tag,
        (
            "ssd:SignalDictionaryReference", "ssc:Clock", "ssd:Clock", "ssv:Binary",
            "ssc:BooleanMappingTransformation", "ssc:IntegerMappingTransformation",
            "ssc:EnumerationMappingTransformation",
        ),
    )
)  # fmt: skip
"""Elements whose effect a run could not reproduce; a file with one of them is rejected."""

OPTIONAL = (
    *("startElement", "endElement", "source", "sourceBase"),
    *("type", "implementation", "unit", "prefix"),
)
"""Attributes that count as missing when they are empty, as OMSimulator writes them."""


def first(element: XmlElement, path: str) -> XmlElement | None:
    """Return the first element at a path of prefixed names; None if there is none."""
    return element.find(path, NS)


def every(element: XmlElement, path: str) -> Iterator[XmlElement]:
    """Yield all elements at a path of prefixed names."""
    return iter(element.iterfind(path, NS))


def kind_of(element: XmlElement) -> str:
    """Return the name of an element without its namespace."""
    return str(etree.QName(element).localname)


def number(element: XmlElement, attribute: str, problems: list[str]) -> float | None:
    """Return the number in an attribute, None if the element or attribute is missing; add a line to
    `problems` for a text that is not a finite number.
    """
    text = None if element is None else element.get(attribute)
    try:
        value = None if text is None else float(text)
    except ValueError:
        value = math.nan
    if value is None or math.isfinite(value):
        return value
    problems.append(f"{kind_of(element)}: {attribute}='{text}' is not a finite number")
    return None


def parse(source: Path, schema: str) -> XmlElement:
    """Return the root element of an XML file that is valid against one of the SSP schemas, without
    using entities or the network.

    In a file of SSP 2.0, types of numbers are renamed to the types of SSP 1.0, and metadata is
    removed. Raises StructureError with every violation of the schema.
    """
    name = source.name
    try:
        root = parsed(contents(source, MAX_ENTRY))
    except (OSError, UnsafeXmlError) as error:
        raise StructureError([f"{name}: {reason_of(error)}"]) from error
    return _valid(root, schema, name)


def embedded(element: XmlElement, schema: str) -> XmlElement:
    """Return a copy of an element inside another file as a root element of its own, valid against
    one of the SSP schemas; raise StructureError if it is not.
    """
    return _valid(deepcopy(element), schema, kind_of(element))


def _valid(root: XmlElement, schema: str, name: str) -> XmlElement:
    """Simplify a root of SSP 2.0 by simplify(), remove empty optional attributes, and return the
    root. Raise StructureError if it is not valid; each line of the error begins with `name`.
    """
    if is_version_2(root):
        simplify(root)
    for element in root.iter():  # OMSimulator writes optional attributes as empty texts
        needed = ("source",) if element.tag == tag("ssd:Component") else ()
        for each in OPTIONAL:
            if element.get(each) == "" and each not in needed:
                del element.attrib[each]
    validator = fmpy_schema("ssp", "schema", schema)
    found = [
        f"line {e.sourceline}: the {kind_of(e)} of {_named(e)} is not supported"
        for e in root.iter(*NOT_SUPPORTED)
    ]
    old = as_version_1(root) if is_version_2(root) else root
    if not validator.validate(old):
        found += [f"line {e.line}: {' '.join(e.message.split())}" for e in validator.error_log]
    if found:
        raise StructureError(f"{name}, {line}" for line in found)
    return root


def _named(element: XmlElement) -> str:
    """Return the attribute `name` of an element, or of the nearest enclosing element with this
    attribute.
    """
    ancestors = (element, *element.iterancestors())
    return next((each.get("name") for each in ancestors if each.get("name")), "")


# ---- SSP 2.0

_OLD_TAGS = {
    tag(f"{p}:{new}"): tag(f"{p}:{old}") for p in ("ssc", "ssv") for new, old in NUMBERS.items()
}
_OLD_KINDS = {
    "structuralParameter": "parameter",
    "constant": "calculatedParameter",
    "local": "output",
    "unspecified": "inout",
}
_METADATA = (tag("ssc:MetaData"), tag("ssc:Signature"))
_NEW_PARTS = (tag("ssc:Dimension"), tag("ssv:Value"))
_VALUES = tuple(tag(f"ssv:{t}") for t in TYPES)
_NEW_ATTRIBUTES = ("startIndices", "endIndices", "systemInnerX", "systemInnerY")


def is_version_2(root: XmlElement) -> bool:
    """Return whether the root of a file declares SSP 2.0."""
    return str(root.get("version", "")) == "2.0"


def simplify(root: XmlElement) -> None:
    """Rename the number types of SSP 2.0 (Float64, ...) to the types of SSP 1.0 (Real, ...), and
    remove metadata, which a run does not use.
    """
    for element in list(root.iter(*_OLD_TAGS)):
        element.tag = _OLD_TAGS[element.tag]
    etree.strip_elements(root, *_METADATA)


def as_version_1(root: XmlElement) -> XmlElement:
    """Return a copy of a root without the additions of SSP 2.0 that simplify() has left, so that
    the schema of SSP 1.0 can check it.
    """
    copy = deepcopy(root)
    copy.set("version", "1.0")
    etree.strip_elements(copy, *_NEW_PARTS)
    for element in copy.iter(*_VALUES):
        element.set("value", "0")  # SSP 1.0 permits no lists; parameter_set() checks the values
    for element in copy.iter(tag("ssd:Connector")):
        element.set("kind", _OLD_KINDS.get(element.get("kind"), element.get("kind", "")))
    for element in copy.iter(tag("ssd:Component")):
        element.set("source", element.get("source", ""))
    for element in copy.iter(tag("ssd:Connection"), tag("ssd:ConnectorGeometry")):
        etree.strip_attributes(element, *_NEW_ATTRIBUTES)
    return copy


# ---- writing


def document(kind: str, prefixes: tuple[str, ...], version: int, **values: str) -> XmlElement:
    """Return the root element of a new SSP file; prefixes: namespaces to declare; version: 1 or 2;
    values: attributes.
    """
    root = etree.Element(tag(kind), nsmap={prefix: NS[prefix] for prefix in prefixes})
    attributes(root, version=f"{version}.0", **values, generationTool=TOOL)
    return root


def child(parent: XmlElement, kind: str, /, **values: Scalar | None) -> XmlElement:
    """Add an element with these attributes at the end of its parent, and return it."""
    element = etree.SubElement(parent, tag(kind))
    attributes(element, **values)
    return element


def attributes(element: XmlElement, /, **values: Scalar | None) -> None:
    """Set attributes in the given order, leaving out None and ""."""
    for name, value in values.items():
        if value is not None and value != "":
            try:
                element.set(name, literal(value))
            except ValueError:  # lxml rejects control characters
                fault = "contains a character that is not permitted in XML"
                raise StructureError([f"{name} {value!r}: {fault}"]) from None


def literal(value: Scalar) -> str:
    """Return a value in the notation of XML schema."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "INF" if value > 0 else "-INF"
    return repr(value) if isinstance(value, float) else str(value)
