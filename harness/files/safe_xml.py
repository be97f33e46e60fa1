# SPDX-License-Identifier: BSD-2-Clause
"""Reading of XML that may come from anywhere: no document type, hence no entity, no network, and no
encoding in which a document type could hide.
"""

from __future__ import annotations

import re
from typing import Any

from lxml import etree

XmlElement = Any
"""lxml has no types."""

_BOMS = (b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff")
_DECLARED = re.compile(rb"""<\?xml[^>]*?\sencoding\s*=\s*["']([^"'>]*)["']""")
_PLAIN = re.compile(rb"(utf-?8|utf-?16([bl]e)?|us-ascii|ascii|iso-?8859-?\d+|(windows|cp)-?125\d)")
"""Encodings that write ASCII as itself, but for zeros."""


class UnsafeXmlError(ValueError):
    """The text is not parsed; str() is the reason."""


def parsed(data: bytes) -> XmlElement:
    """Root element of an XML text, comments and processing instructions left out.

    Raises UnsafeXmlError: a document type, an encoding that could hide one, or no XML at all.
    """
    _refuse_unsafe(data)
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        remove_comments=True,
        remove_pis=True,
    )
    try:
        tree = etree.ElementTree(etree.fromstring(data, parser))
    except etree.XMLSyntaxError as error:
        raise UnsafeXmlError(f"not a readable XML file ({error})") from error
    if tree.docinfo.doctype:
        raise UnsafeXmlError("a document type declaration is not allowed")
    return tree.getroot()


def serialized(root: XmlElement) -> bytes:
    """An element as a file in UTF-8."""
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8"))


def _refuse_unsafe(data: bytes) -> None:
    """Judge the bytes before anything parses them."""
    text = data.replace(b"\0", b"")
    for mark in _BOMS:
        text = text.removeprefix(mark)
    if not text.lstrip().startswith(b"<"):
        raise UnsafeXmlError("not a readable XML file (it does not begin with <)")
    declared = _DECLARED.match(text.lstrip())
    if declared and not _PLAIN.fullmatch(declared[1].lower()):
        encoding = declared[1].decode("ascii", "replace")
        raise UnsafeXmlError(f"its encoding {encoding} is not read, only UTF-8 and its like")
    if b"<!DOCTYPE" in text:
        raise UnsafeXmlError("a document type declaration is not allowed")
