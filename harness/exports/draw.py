# SPDX-License-Identifier: BSD-2-Clause
"""A system as a block diagram in SVG, without any other program."""

from __future__ import annotations

from pathlib import Path

from lxml import etree

from harness.exports.diagram import LINE, Diagram, Points, Text, lay_out
from harness.files.output import written
from harness.ssp.xml import XmlElement
from harness.system.model import System

SVG = "http://www.w3.org/2000/svg"
STYLE = """
  text { font: 12px 'DejaVu Sans Mono', Menlo, Consolas, monospace; fill: #1b2a3a; }
  .name { font-size: 14px; font-weight: bold; text-anchor: middle; }
  .fmu, .title { fill: #5a6b7c; } .fmu { text-anchor: middle; }
  rect.block { fill: #eef3f8; stroke: #34506b; stroke-width: 1.5; }
  polyline { fill: none; stroke: #34506b; stroke-width: 1.3; }
  circle, marker path { fill: #34506b; }
"""


def draw(system: System, path: Path) -> None:
    """Write the block diagram of a system as .svg; ResultsError if it cannot be written."""
    with written(path) as target:
        target.write_bytes(svg(system))


def svg(system: System) -> bytes:
    """The block diagram of a system; the same system gives the same bytes."""
    diagram = lay_out(system)
    size = {"width": f"{diagram.width:.0f}", "height": f"{diagram.height:.0f}"}
    box = f"0 0 {size['width']} {size['height']}"
    root = etree.Element(f"{{{SVG}}}svg", {**size, "viewBox": box}, nsmap={None: SVG})
    etree.SubElement(root, "style").text = STYLE
    _arrow_head(root)
    etree.SubElement(root, "rect", size, fill="white")
    _words(root, 12, 20, f"{system.name}: {system.description}".rstrip(": "), "title")
    _blocks(root, diagram)
    for points in diagram.lines:
        _line(root, points)
    for points in diagram.arrows:
        _line(root, points, {"marker-end": "url(#head)"})
    for x, y in diagram.dots:
        etree.SubElement(root, "circle", cx=f"{x:.1f}", cy=f"{y:.1f}", r="2.5")
    for label in diagram.labels:
        _label(root, label)
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True))


def _arrow_head(root: XmlElement) -> None:
    marker = etree.SubElement(
        etree.SubElement(root, "defs"), "marker", id="head", viewBox="0 0 10 10", refX="9",
        refY="5", orient="auto", markerWidth="7", markerHeight="7",
    )  # fmt: skip
    etree.SubElement(marker, "path", d="M0 1 L10 5 L0 9 z")


def _blocks(root: XmlElement, diagram: Diagram) -> None:
    for (x, y, width, height), (name, fmu) in zip(diagram.blocks, diagram.titles, strict=True):
        box = {"x": f"{x:.1f}", "y": f"{y:.1f}", "width": f"{width:.1f}", "height": f"{height:.1f}"}
        etree.SubElement(root, "rect", {**box, "rx": "5", "class": "block"})
        middle = y + height / 2
        _words(root, x + width / 2, middle - 2, name, "name")
        if fmu != name:
            _words(root, x + width / 2, middle + LINE, fmu, "fmu")


def _line(root: XmlElement, points: Points, further: dict[str, str] | None = None) -> None:
    text = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    etree.SubElement(root, "polyline", {"points": text, **(further or {})})


def _label(root: XmlElement, label: Text) -> None:
    for i, line in enumerate(label.lines):
        _words(root, label.x, label.y + i * LINE, line).set("text-anchor", label.anchor)


def _words(root: XmlElement, x: float, y: float, words: str, kind: str = "") -> XmlElement:
    element = etree.SubElement(root, "text", x=f"{x:.1f}", y=f"{y:.1f}")
    element.text = words
    if kind:
        element.set("class", kind)
    return element
