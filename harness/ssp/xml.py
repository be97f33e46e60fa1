# SPDX-License-Identifier: BSD-2-Clause
"""Names and schemas of SSP 1.0, shared by the reader and the writer of .ssp files."""

from __future__ import annotations

import math
from copy import deepcopy
from functools import lru_cache
from pathlib import Path
from typing import Any

import fmpy
from lxml import etree

from harness.errors import StructureError
from harness.files import cache
from harness.files.archive import MAX_ENTRY
from harness.files.paths import contents
from harness.files.safe_xml import UnsafeXmlError, parsed
from harness.system.values import Scalar

XmlElement = Any
Schema = Any
"""lxml has no types."""

NS = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "ssm": "http://ssp-standard.org/SSP1/SystemStructureParameterMapping",
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
    "run": "urn:io.github.servicing-fmus:run:1",
}
"""Namespaces by the prefixes that libcosim and ecos expect literally; `run` is our own
annotation.
"""

SSD_FILE = "SystemStructure.ssd"
OSP_ANNOTATION = "com.opensimulationplatform"
RUN_ANNOTATION = "io.github.servicing-fmus"
TOOL = "servicing-fmus"
FMU_TYPE = "application/x-fmu-sharedlibrary"

SSD_SCHEMA = "SystemStructureDescription.xsd"
SSV_SCHEMA = "SystemStructureParameterValues.xsd"
SSM_SCHEMA = "SystemStructureParameterMapping.xsd"

OPTIONAL = (
    "startElement",
    "endElement",
    "source",
    "type",
    "sourceBase",
    "implementation",
    "unit",
    "prefix",
)
"""Attributes that say nothing when they are empty."""

_NUMBERS = {
    "Real": ("Float64", "Float32"),
    "Integer": tuple(f"{u}Int{n}" for u in ("", "U") for n in (8, 16, 32, 64)),
}
_OLD_NAMES = {
    f"{{{NS[p]}}}{new}": f"{{{NS[p]}}}{old}"
    for p in ("ssc", "ssv")
    for old in _NUMBERS
    for new in _NUMBERS[old]
}
"""Types that SSP 2.0 has added for FMI 3.0, and what they are for an FMU of FMI 2.0."""


def tag(name: str) -> str:
    """Name that lxml gives to an element written with a prefix: `ssd:System` gives
    `{http://...}System`.
    """
    prefix, local = name.split(":")
    return f"{{{NS[prefix]}}}{local}"


def parse(source: Path | bytes, schema: str, name: str = "") -> XmlElement:
    """Root element of an XML file, valid against one of the SSP schemas; neither entities nor the
    network are used.

    A file of SSP 2.0 is read as far as SSP 1.0 knows its elements. Raises StructureError with every
    violation of the schema.
    """
    name = source.name if isinstance(source, Path) else name
    try:
        data = contents(source, MAX_ENTRY) if isinstance(source, Path) else source
    except OSError as error:
        raise StructureError([f"{name}: cannot be read ({error.strerror})"]) from error
    try:
        root = parsed(data)
    except UnsafeXmlError as error:
        raise StructureError([f"{name}: {error}"]) from error
    _made_readable(root)
    cache.passed(
        f"{schema} of fmpy {fmpy.__version__}", data, lambda: _validate(root, schema, name)
    )
    return root


def embedded(element: XmlElement, schema: str) -> XmlElement:
    """An element inside another file as the root of its own, valid against one of the SSP
    schemas.
    """
    root = deepcopy(element)
    return valid(root, schema, etree.QName(root).localname)


def valid(root: XmlElement, schema: str, name: str) -> XmlElement:
    """The root element itself; StructureError with every violation of the schema, by the name of
    the file.
    """
    _made_readable(root)
    _validate(root, schema, name)
    return root


def _made_readable(root: XmlElement) -> None:
    """Rewrite the spellings of SSP 2.0 and of other tools that mean the same."""
    _as_version_1(root)
    _without_empty(root)


def _validate(root: XmlElement, schema: str, name: str) -> None:
    validator = _schema(schema)
    if not validator.validate(root):
        raise StructureError(
            f"{name}, line {e.line}: {' '.join(e.message.split())}" for e in validator.error_log
        )


def _as_version_1(root: XmlElement) -> None:
    """Rewrite what SSP 2.0 says otherwise without meaning more for FMI 2.0, and drop the metadata
    it has added.
    """
    if not root.get("version", "").startswith("2."):
        return
    root.set("version", "1.0")
    for element in list(root.iter(*_OLD_NAMES)):
        element.tag = _OLD_NAMES[element.tag]
    for element in list(root.iter(tag("ssc:MetaData"), tag("ssc:Signature"))):
        element.getparent().remove(element)


def _without_empty(root: XmlElement) -> None:
    """Leave out optional attributes that are empty, as OMSimulator writes them."""
    for element in root.iter():
        needed = ("source",) if element.tag == tag("ssd:Component") else ()
        for name in OPTIONAL:
            if element.get(name) == "" and name not in needed:
                del element.attrib[name]


@lru_cache
def _schema(name: str) -> Schema:
    return etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "ssp" / "schema" / name))


def number(element: XmlElement, attribute: str, problems: list[str]) -> float | None:
    """A finite number in an attribute, None without it; a problem is noted if it is something
    else.
    """
    text = None if element is None else element.get(attribute)
    try:
        value = None if text is None else float(text)
    except ValueError:
        value = math.nan
    if value is None or math.isfinite(value):
        return value
    problems.append(
        f"{etree.QName(element).localname}: {attribute}='{text}' is not a finite number"
    )
    return None


# ---- writing


def child(parent: XmlElement, kind: str, /, **values: Scalar | None) -> XmlElement:
    """A new element at the end of its parent."""
    element = etree.SubElement(parent, tag(kind))
    attributes(element, **values)
    return element


def attributes(element: XmlElement, /, **values: Scalar | None) -> None:
    """Set attributes in the given order; None and "" are left out."""
    for name, value in values.items():
        if value is not None and value != "":
            try:
                element.set(name, literal(value))
            except ValueError:  # lxml: a control character
                raise StructureError(
                    [f"{name} {value!r}: holds a character that XML cannot hold"]
                ) from None


def literal(value: Scalar) -> str:
    """A value as XML schema writes it."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float) and not math.isfinite(value):
        return "NaN" if math.isnan(value) else "INF" if value > 0 else "-INF"
    return repr(value) if isinstance(value, float) else str(value)


def serialized(root: XmlElement) -> bytes:
    """The file that an element is the root of."""
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True))
