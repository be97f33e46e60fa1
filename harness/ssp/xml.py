# SPDX-License-Identifier: BSD-2-Clause
"""Names and elements of SSP, shared by the reader and the writer of .ssp files."""

from __future__ import annotations

import math
from typing import Any

from lxml import etree

from harness.errors import StructureError
from harness.system.values import Scalar

XmlElement = Any
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


def tag(name: str) -> str:
    """Name that lxml gives to an element written with a prefix: `ssd:System` gives
    `{http://...}System`.
    """
    prefix, local = name.split(":")
    return f"{{{NS[prefix]}}}{local}"


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
