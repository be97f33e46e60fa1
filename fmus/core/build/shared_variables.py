# SPDX-License-Identifier: BSD-2-Clause
"""Search of a model's C source for variables that all instances of its FMU would share.

The state of an instance is its Model: the FMU resets, copies and stores nothing else. A variable
outside functions, or a static one inside a function, is shared by all instances. An FMU with such a
variable would have other results after a reset, in a second instance, and in a fused system.
Constants (const) are allowed.
"""

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lanes_source import Items, is_block, parsed

MARKER = re.compile(r'# \d+ "(?P<file>[^\n]*)"(?P<flags>[ \d]*)')
"""Regular expression for a line marker of the preprocessor: file of the next lines, and flags."""
SYSTEM_HEADER = "3"
"""Flag of a line marker: the file is a header of the compiler or of the C library."""
CORE = Path(__file__).resolve().parents[1]
"""Folder of the headers that all models include; these headers define no shared variable."""
WITHOUT_VARIABLE = {"typedef", "extern", "_Static_assert"}
"""First words of declarations that define no variable."""
TYPES = {"struct", "union", "enum"}
RULE = (
    "all instances of the FMU would share the variable `{name}`, and a reset would not restore it: "
    "move it to State, or declare it const"
)
"""Message about the variable `name`."""


def problems(compiler: list[Any], source: Path) -> list[str]:
    """Return a message for every variable that instances would share, in the C file of a model.
    compiler: command that compiles the file; raises CalledProcessError if it fails.
    """
    command = [*compiler, "-E", source]
    done = subprocess.run(
        command, check=True, capture_output=True, encoding="utf-8", errors="replace"
    )
    return [RULE.format(name=name) for name in _shared(parsed(_own(done.stdout)))]


def _own(preprocessed: str) -> str:
    """Return the lines of a preprocessed source that are neither from headers of the compiler or
    the C library nor from the folder CORE.
    """
    lines, own = [], True
    for line in preprocessed.splitlines():
        if marker := MARKER.match(line):
            own = SYSTEM_HEADER not in marker["flags"].split()
            own = own and CORE not in Path(marker["file"]).parents
        elif own:
            lines.append(line)
    return "\n".join(lines)


def _shared(items: Items) -> Iterator[str]:
    """Yield the names of the variables that instances would share: all variables outside functions
    and all static variables inside functions, except constants; items: C text as tokens, and
    brackets with their content, from parsed().
    """
    declaration: Items = []
    for item in items:
        if item == ";":
            yield from _declared(declaration)
            declaration = []
        elif is_block(item) and _is_function(declaration):
            yield from _static(item)
            declaration = []
        else:
            declaration.append(item)


def _is_function(items: Items) -> bool:
    """Return whether the items before a block are the head of a function."""
    return "=" not in items and any(is_bracket(item, "(") for item in items)


def is_bracket(item: Any, opening: str) -> bool:
    """Return whether an item is a pair of brackets with its content, opened by `opening`."""
    return isinstance(item, list) and item[0] == opening


def _static(block: Items) -> Iterator[str]:
    """Yield the names of static variables in a block, or in blocks inside it, that are not
    constant.
    """
    for at, item in enumerate(block):
        if is_block(item):
            yield from _static(item)
        elif item == "static":
            yield from _declared(block[at : block.index(";", at)])


def _declared(items: Items) -> Iterator[str]:
    """Yield the names of the variables in one declaration (without its semicolon), unless they are
    constant. A pointer to constant values counts as constant if it has an initial value.
    """
    words = _words(items)
    constant = "const" in words and ("=" in words or "*" not in words)
    if not words or words[0] in WITHOUT_VARIABLE or constant:
        return
    if words[0] in TYPES and (is_block(items[-1]) or len(items) == 2):
        return  # only a type is declared, no variable
    declarators: list[Items] = [[]]
    for item in items:
        if item == ",":
            declarators.append([])
        else:
            declarators[-1].append(item)
    for declarator in declarators:
        end = declarator.index("=") if "=" in declarator else len(declarator)
        yield from _name(declarator[:end])


def _name(declarator: Items) -> Iterator[str]:
    """Yield the name of the variable that a declarator declares, nothing if it declares a function;
    declarator: without the initial value.
    """
    first = next((i for i, item in enumerate(declarator) if is_bracket(item, "(")), None)
    if first is None:
        yield _words(declarator)[-1]
    elif declarator[first][1:2] == ["*"]:  # a pointer to a function is a variable
        yield _words(declarator[first])[-1]


def _words(items: Items) -> list[str]:
    """Return the items that are single tokens, not brackets with their content."""
    return [item for item in items if isinstance(item, str)]
