"""Names and schemas of SSP 1.0, shared by the reader and the writer of .ssp files."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import fmpy
from lxml import etree

from harness.errors import StructureError

Element = Any
Schema = Any
"""lxml has no types."""

NS = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
    "ssv": "http://ssp-standard.org/SSP1/SystemStructureParameterValues",
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
    "run": "urn:io.github.servicing-fmus:run:1",
}
"""Namespaces by the prefixes that libcosim and ecos expect literally; `run` is our own annotation."""

SSD_FILE = "SystemStructure.ssd"
OSP_ANNOTATION = "com.opensimulationplatform"
RUN_ANNOTATION = "io.github.servicing-fmus"
FMU_TYPE = "application/x-fmu-sharedlibrary"

SSD_SCHEMA = "SystemStructureDescription.xsd"
SSV_SCHEMA = "SystemStructureParameterValues.xsd"


def tag(name: str) -> str:
    """Name that lxml gives to an element written with a prefix: `ssd:System` gives `{http://...}System`."""
    prefix, local = name.split(":")
    return f"{{{NS[prefix]}}}{local}"


def parse(path: Path, schema: str) -> Element:
    """Root element of an XML file, valid against one of the SSP schemas; neither entities nor the network are used.

    Raises StructureError with every violation of the schema.
    """
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True, remove_pis=True
    )
    try:
        tree = etree.parse(str(path), parser)
    except (etree.XMLSyntaxError, OSError) as error:
        raise StructureError([f"{path.name}: not a readable XML file ({error})"]) from error
    if tree.docinfo.doctype:
        raise StructureError([f"{path.name}: a document type declaration is not allowed"])
    validator = _schema(schema)
    if not validator.validate(tree):
        raise StructureError(f"{path.name}, line {e.line}: {' '.join(e.message.split())}" for e in validator.error_log)
    return tree.getroot()


@lru_cache
def _schema(name: str) -> Schema:
    return etree.XMLSchema(file=str(Path(fmpy.__file__).parent / "ssp" / "schema" / name))
