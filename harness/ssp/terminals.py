# SPDX-License-Identifier: BSD-2-Clause
"""Writing of terminals of FMI 3.0 (named groups of variables) into a system description, as
proposed for SSP 2.1 (pull request 120 of modelica/ssp-standard).

A terminal of an FMU is written as a connector of kind `terminal` with its name in the FMU. If at
least two members of equal name of two terminals are connected, and no member in another way, one
connection of the terminals replaces the connections of their members.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from harness.errors import UsageError
from harness.files.archive import XmlElement, inspect, parsed, read_entry
from harness.ssp.xml import child, every, first

Key = tuple[str, str]
"""Name of a component and of one of its terminals."""
DRAFT = 2.1
"""Version of SSP whose draft has terminals."""
FILE = "terminalsAndIcons/terminalsAndIcons.xml"
MEMBER = "TerminalMemberVariable"
ENDS = ("startElement", "startConnector", "endElement", "endConnector")


def add_terminals(root: XmlElement, fmus: Mapping[str, Path]) -> None:
    """Add the connected terminals of the FMUs to a system description, which must be complete up to
    and including its units; raise UsageError if no terminal has two connected members.
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
        reason = "no terminal of an FMU has two connected members (only FMI 3.0 has terminals)"
        raise UsageError(f"SSP {DRAFT}: {reason}; write SSP 1 or 2")
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
    """Replace the connections of members by connections of their terminals where that is possible;
    return the keys of the connected terminals.
    """
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
