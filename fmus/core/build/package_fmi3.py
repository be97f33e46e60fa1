# SPDX-License-Identifier: BSD-2-Clause
"""Files that only an FMU of FMI 3.0 contains: build description, terminals and their icons."""

import html
import io
import re
from collections import defaultdict
from collections.abc import Iterable

from PIL import Image, ImageDraw, ImageFont

COMPILER_OPTIONS = "-std=c99 -O2 -ffp-contract=off -fno-tree-slp-vectorize -fno-math-errno"
"""Compiler options with which a library from the sources gives the same bits as the binary in the
archive, see SAME_BITS in build_fmu.py.
"""

PLATFORMS = {
    "linux64": "x86_64-linux",
    "win64": "x86_64-windows",
    "darwin64": "x86_64-darwin",
    "aarch64-darwin": "aarch64-darwin",
}
"""Platform tuples of FMI 3.0, by the names of the platforms in FMI 2.0."""

HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n'

BODY = re.compile(r"(r|v|omega|q)_([A-Z])([A-Z])(?:_([A-Z]))?(_hat)?")
"""Regular expression for the name of a variable of the motion of one body relative to another, such
as `r_SN_N`. Groups: 1 quantity, 2 letter of the moving body, 3 letter of the other body, 4 letter
of the axes, 5 `_hat` for an estimate.
"""

WRENCH = re.compile(r"([FM])_((?:[a-z]+_)?[A-Z])")
"""Regular expression for the name of a force or torque. Groups: 1 quantity, 2 purpose and axes,
such as `cmd_S`."""

AXES = {"r": 3, "v": 3, "omega": 2, "q": 0}
"""Number of the group of BODY whose letter the axes (group 4) must have, by quantity; 0: the name
has no axes. Position and velocity are in axes of the other body (group 3), the angular velocity is
in axes of the moving body (group 2).
"""

BODY_STATE, WRENCHES, SIGNAL = (f"servicing-fmus.{n}" for n in ("body-state", "wrench", "signal"))
"""Kinds of terminals: state of a body (members r, v, q, omega), force and torque (members F, M),
and a single signal (member signal).
"""

ICONS = {"icon": (), "output": ((4, 4), (28, 16), (4, 28)), "input": ((4, 4), (28, 16), (4, 28))}
"""Corners [px] of the triangle in each image of terminalsAndIcons/; (): the image shows the whole
block and has no triangle.
"""


def build_description(identifier: str, sources: Iterable[str]) -> str:
    """Return the text of sources/buildDescription.xml, which states how to compile the library from
    the C files.
    """
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
    """Return the text of terminalsAndIcons.xml for the variables of an FMU; "" without inputs and
    outputs.

    Inputs and outputs form terminals: the state of a body, force and torque, or a single signal.
    Terminals of two FMUs are connected by the names of their members; the terminal of an FMU that
    needs fewer signals has fewer members. rows: attributes of the variables, such as `name` and
    `causality`.
    """
    plugs: dict[tuple[str, str], dict[str, str]] = defaultdict(dict)
    for row in rows:
        if row["causality"] in ("input", "output"):
            kind, name, member = _place(row["name"])
            plugs[kind, f"{name}_{row['causality'].removesuffix('put')}"][member] = row["name"]
    if not plugs:
        return ""
    sides = {side: [p for p in plugs if p[1].endswith(f"_{side}")] for side in ("in", "out")}
    text = "".join(
        _terminal(*plug, members, sides[side].index(plug), len(sides[side]))
        for plug, members in plugs.items()
        for side in [plug[1].rpartition("_")[2]]
    )
    return (
        f'{HEAD}<fmiTerminalsAndIcons fmiVersion="3.0">\n  <GraphicalRepresentation>\n'
        '    <CoordinateSystem x1="-100" y1="-100" x2="100" y2="100"'
        ' suggestedScalingFactorTo_mm="0.1"/>\n'
        '    <Icon x1="-100" y1="-100" x2="100" y2="100"/>\n  </GraphicalRepresentation>\n'
        f"  <Terminals>\n{text}  </Terminals>\n</fmiTerminalsAndIcons>\n"
    )


def _place(variable: str) -> tuple[str, str, str]:
    """Return kind and name of the terminal to which a variable belongs, and the name of the
    terminal's member for this variable.
    """
    prefix, point, name = variable.rpartition(".")
    if (found := BODY.fullmatch(name)) and _is_motion(found):
        return BODY_STATE, f"{prefix}{point}{found[2]}{found[3]}{found[5] or ''}", found[1]
    if found := WRENCH.fullmatch(name):
        return WRENCHES, f"{prefix}{point}wrench_{found[2]}", found[1]
    return SIGNAL, variable, "signal"


def _is_motion(found: re.Match[str]) -> bool:
    axes = AXES[found[1]]
    return found[4] == (found[axes] if axes else None)


def _terminal(kind: str, name: str, members: dict[str, str], place: int, count: int) -> str:
    """Return the XML of a terminal, drawn as number `place` (from 0) of `count` terminals at the
    left (inputs) or right edge of the block.
    """
    lines = "".join(
        f'      <TerminalMemberVariable variableName="{html.escape(variable)}" '
        f'memberName="{member}" variableKind="signal"/>\n'
        for member, variable in members.items()
    )
    is_input = name.endswith("_in")
    left, middle = (-110 if is_input else 90), 100 - 200 * (place + 0.5) / count
    half = min(10.0, 80 / count)
    return (
        f'    <Terminal name="{html.escape(name)}" matchingRule="bus" terminalKind="{kind}">\n'
        f'{lines}      <TerminalGraphicalRepresentation x1="{left}" y1="{middle - half:.4g}"'
        f' x2="{left + 20}" y2="{middle + half:.4g}"'
        f' iconBaseName="{"input" if is_input else "output"}"/>\n    </Terminal>\n'
    )


def icons(name: str) -> dict[str, bytes]:
    """Return the PNG images of terminalsAndIcons/ by file name: the block with its name, and an
    input and an output terminal.
    """
    found = {}
    for kind, corners in ICONS.items():
        image = Image.new("RGBA", (32, 32) if corners else (200, 200), "#0000")
        draw = ImageDraw.Draw(image)
        if corners:
            draw.polygon(corners, fill="#204a87" if kind == "output" else "#729fcf")
        else:
            draw.rectangle((2, 2, 197, 197), fill="white", outline="#204a87", width=3)
            draw.text((100, 100), name.replace("_", "\n"), fill="#204a87", anchor="mm",
                      align="center", font=ImageFont.load_default(24))  # fmt: skip
        stream = io.BytesIO()
        image.save(stream, "PNG")
        found[f"terminalsAndIcons/{kind}.png"] = stream.getvalue()
    return found
