# SPDX-License-Identifier: BSD-2-Clause
"""What an archive of FMI 3.0 holds beyond one of FMI 2.0: the build description and terminals."""

import html
import re
from collections import defaultdict
from collections.abc import Iterable
from xml.etree import ElementTree

COMPILER_OPTIONS = "-std=c99 -O2 -ffp-contract=off -fno-tree-slp-vectorize -fno-math-errno"
"""With them the sources give the bits of the binary (build_fmu.py says why)."""

PLATFORMS = {
    "linux64": "x86_64-linux",
    "win64": "x86_64-windows",
    "darwin64": "x86_64-darwin",
    "aarch64-darwin": "aarch64-darwin",
}
"""Platform tuples of FMI 3.0 by the platforms of FMI 2.0."""

HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'

BODY = re.compile(r"(?:r|v|omega|sigma)_([A-Z])[A-Z]?(?:_[A-Z])?")
"""Names of the motion of a body against another: its letter, that of the other, the axes."""


def build_description(identifier: str, sources: Iterable[str]) -> str:
    """sources/buildDescription.xml: how the C files make the library."""
    files = "".join(f'      <SourceFile name="{html.escape(name)}"/>\n' for name in sources)
    return (
        f'{HEAD}<fmiBuildDescription fmiVersion="3.0">\n'
        f'  <BuildConfiguration modelIdentifier="{html.escape(identifier)}">\n'
        f'    <SourceFileSet language="C99" compiler="gcc" compilerOptions="{COMPILER_OPTIONS}">\n'
        f"{files}    </SourceFileSet>\n"
        '    <Library name="m" external="true"/>\n'
        "  </BuildConfiguration>\n</fmiBuildDescription>\n"
    )


def listed_sources(description: ElementTree.Element, build: bytes | None) -> list[str]:
    """The C files in sources/ that make the library, that of the model first; build: the build
    description of FMI 3.0, if there is one.
    """
    if build is not None:
        return [e.attrib["name"] for e in ElementTree.fromstring(build).iter("SourceFile")]
    return [e.attrib["name"] for e in description.iter("File")]


def terminals(rows: Iterable[dict[str, str]]) -> str:
    """terminalsAndIcons.xml: a plug per body and direction, of at least two of its position,
    velocity, angular velocity and attitude; empty if there is none.
    """
    plugs: dict[str, list[str]] = defaultdict(list)
    for row in rows:
        prefix, _, name = row["name"].rpartition(".")
        body = BODY.fullmatch(name)
        if body and row["causality"] in ("input", "output"):
            direction = "in" if row["causality"] == "input" else "out"
            motion = name.split("_")[1]
            plugs[f"{prefix and prefix + '.'}{motion}_{direction}"].append(row["name"])
    text = "".join(_terminal(name, members) for name, members in plugs.items() if len(members) > 1)
    if not text:
        return ""
    return (
        f'{HEAD}<fmiTerminalsAndIcons fmiVersion="3.0">\n  <Terminals>\n{text}'
        "  </Terminals>\n</fmiTerminalsAndIcons>\n"
    )


def _terminal(name: str, members: list[str]) -> str:
    lines = "".join(
        f'      <TerminalMemberVariable variableName="{html.escape(member)}" '
        f'memberName="{html.escape(member.rpartition(".")[2])}" variableKind="signal"/>\n'
        for member in members
    )
    return (
        f'    <Terminal name="{html.escape(name)}" matchingRule="bus" '
        f'terminalKind="servicing-fmus.body-state">\n{lines}    </Terminal>\n'
    )
