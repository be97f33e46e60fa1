# SPDX-License-Identifier: BSD-2-Clause
"""Faults that FMPy's reader cannot bear, mended in a copy, so that warnings stay warnings."""

from __future__ import annotations

from copy import deepcopy

from lxml import etree

from harness.files.safe_xml import XmlElement
from harness.rules.description import DEFAULT_INITIAL


def readable(root: XmlElement) -> bytes:
    """A description in UTF-8 in which every variable says its `initial` where it has no default."""
    copy = deepcopy(root)
    for e in copy.iterfind("ModelVariables/ScalarVariable"):
        pair = (e.get("causality", "local"), e.get("variability", "continuous"))
        if pair not in DEFAULT_INITIAL and e.get("initial") is None:
            e.set("initial", "calculated" if pair[0] == "output" else "exact")
    return bytes(etree.tostring(copy, xml_declaration=True, encoding="UTF-8"))
