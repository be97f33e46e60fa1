# SPDX-License-Identifier: BSD-2-Clause
"""Files that only an archive of FMI 3.0 contains: build description and terminals."""

import html
import re
from collections import defaultdict
from collections.abc import Iterable

COMPILER_OPTIONS = "-std=c99 -O2 -ffp-contract=off -fno-tree-slp-vectorize -fno-math-errno"
"""Options with which the sources give the bits of the binary, see SAME_BITS of build_fmu.py."""

PLATFORMS = {
    "linux64": "x86_64-linux",
    "win64": "x86_64-windows",
    "darwin64": "x86_64-darwin",
    "aarch64-darwin": "aarch64-darwin",
}
"""Platform tuples of FMI 3.0 by the platforms of FMI 2.0."""

HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'

BODY = re.compile(r"(?:r|v|omega|sigma)_([A-Z])[A-Z]?(?:_[A-Z])?")
"""Names of the motion of a body relative to another: letter of each, letter of the axes."""


def build_description(identifier: str, sources: Iterable[str]) -> str:
    """Return sources/buildDescription.xml: how to compile the library from the C files."""
    files = "".join(f'      <SourceFile name="{html.escape(name)}"/>\n' for name in sources)
    return (
        f'{HEAD}<fmiBuildDescription fmiVersion="3.0">\n'
        f'  <BuildConfiguration modelIdentifier="{html.escape(identifier)}">\n'
        f'    <SourceFileSet language="C99" compiler="gcc" compilerOptions="{COMPILER_OPTIONS}">\n'
        f"{files}    </SourceFileSet>\n"
        '    <Library name="m" external="true"/>\n'
        "  </BuildConfiguration>\n</fmiBuildDescription>\n"
    )


def terminals(rows: Iterable[dict[str, str]]) -> str:
    """Return terminalsAndIcons.xml, with a terminal per body and direction that has at least two of
    position, velocity, angular velocity and attitude; "" without a terminal.
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
