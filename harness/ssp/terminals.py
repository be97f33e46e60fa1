# SPDX-License-Identifier: BSD-2-Clause
"""Terminals of FMI 3.0 in a system that is written, as proposed for SSP 2.1 (pull request 120 of
modelica/ssp-standard).

A terminal of an FMU is a connector of kind `terminal` with the name that it has in the FMU, which
states the variables of its members. Two terminals of which two or more members are connected, and
no member differently, have one connection in place of one per member.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from harness.errors import UsageError
from harness.files.archive import XmlElement, inspect, parsed, read_entry
from harness.ssp.xml import child, every, first

Key = tuple[str, str]
"""Component and terminal."""
DRAFT = 2.1
"""Version of SSP that is to have terminals."""
FILE = "terminalsAndIcons/terminalsAndIcons.xml"
MEMBER = "TerminalMemberVariable"
ENDS = ("startElement", "startConnector", "endElement", "endConnector")


def add_terminals(root: XmlElement, fmus: Mapping[str, Path]) -> None:
    """Connect the terminals of components in a system description that has everything up to its
    units; raise UsageError if none has two connected members.
    """
    terminals = {
        (component, each.get("name")): each
        for component, fmu in fmus.items()
        if FILE in inspect(fmu)
        for each in parsed(read_entry(fmu, FILE)).iter("Terminal")
    }
    members = {
        key: {row.get("memberName"): row.get("variableName") for row in each.iter(MEMBER)}
        for key, each in terminals.items()
    }
    used = _join(root, members)
    if not used:
        reason = "no two members of a terminal are connected; FMUs of FMI 3.0 have terminals"
        raise UsageError(f"SSP {DRAFT}: {reason}")
    root.set("version", str(DRAFT))
    table = child(root, "ssd:Terminals")
    listed = {c.get("name"): first(c, "ssd:Connectors") for c in every(root, ".//ssd:Component")}
    for component, name in sorted(used):
        kind, terminal = f"{component}.{name}", terminals[component, name]
        about = {key: terminal.get(key) for key in ("matchingRule", "terminalKind")}
        inside = child(child(table, "ssd:Terminal", name=kind, **about), "ssd:Connectors")
        for member in members[component, name]:
            child(inside, "ssd:Connector", name=member, kind="local")
        plug = child(listed[component], "ssd:Connector", name=name, kind="terminal")
        child(plug, "ssc:Terminal", name=kind)


def _join(root: XmlElement, members: Mapping[Key, Mapping[str, str]]) -> set[Key]:
    """Replace connections by connections of terminals; return the keys of these."""
    plain = (c for c in every(root, ".//ssd:Connection") if len(c.attrib) == len(ENDS))
    wires = {tuple(c.get(end) for end in ENDS): c for c in plain}
    owner = {(key[0], v): key for key, variables in members.items() for v in variables.values()}
    used = set()
    for a, x, b, y in list(wires):
        plugs = owner.get((a, x), ("", "")), owner.get((b, y), ("", ""))
        offered, read = (members.get(plug, {}) for plug in plugs)
        pairs = [(a, offered[m], b, read[m]) for m in offered if m in read]
        if len(pairs) > 1 and wires.keys() >= set(pairs):
            joint, *others = (wires.pop(pair) for pair in pairs)
            joint.attrib.update(zip(ENDS, (*plugs[0], *plugs[1]), strict=True))
            for wire in others:
                wire.getparent().remove(wire)
            used |= set(plugs)
    return used
