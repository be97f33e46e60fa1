# SPDX-License-Identifier: BSD-2-Clause
"""Words that user pages and help texts do without, each with what to write instead.

python .ci/words.py                 # make lint
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
INSTEAD = {
    r"fl(?:ies|own|ew)|fly(?!-around|wheel)": "run, simulate",
    r"told|tells": "reported, shows, distinguishes",
    r"said|says": "states, reports, prints",
    r"(?<!not )judged|judges": "checked, evaluated; a verdict is `not judged`",
    r"kept": "recorded, stored, remains",
    r"wants?(?! to)": "needs, expects",
    r"foreign": "third-party",
    r"of it": "its, or the noun",
    r"that of": "the noun",
    r"refuses to": "rejects",
    r"whatever": "for any, regardless of",
}
"""Regular expressions of whole words."""
PAGES = ("README.md", "docs/*.md", "docs/how_to/*.md")
GENERATED = {"flight_code.md", "gallery.md", "targets.md", "tools.md", "validation.md"}
"""Pages that a make target writes, from runs and texts of the code."""
DEVELOPERS = {"architecture.md", "faults.md", "performance.md", "release.md"}
"""Pages that users need not read."""
CODE = re.compile(r"^```.*?^```|^ {4}[^\n]*$|`[^`\n]*`|\]\([^)\n]*\)", re.MULTILINE | re.DOTALL)
HELP = "harness/cli/*.py"


def findings(text: str) -> Iterator[tuple[int, str, str]]:
    """Line, word and what to write instead, of all that a text should do without."""
    for words, instead in INSTEAD.items():
        for found in re.finditer(rf"\b(?:{words})\b", text, re.IGNORECASE):
            yield text.count("\n", 0, found.start()) + 1, found[0], instead


def prose(text: str) -> str:
    """A page of Markdown with blanks for code and addresses."""
    return CODE.sub(lambda m: re.sub(r"[^\n]", " ", m[0]), text)


def helps(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of every help text of a module of the command line: of options, arguments and
    commands.
    """
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.keyword) and node.arg == "help":
            if isinstance(node.value, ast.Constant):
                yield node.value.lineno, str(node.value.value)
        elif isinstance(node, ast.FunctionDef) and node.name.endswith("_command"):
            yield node.lineno, ast.get_docstring(node) or ""


def problems() -> Iterator[str]:
    """A line for everything found."""
    for page in sorted({p for pattern in PAGES for p in ROOT.glob(pattern)}):
        if page.name not in GENERATED | DEVELOPERS:
            for line, word, instead in findings(prose(page.read_text(encoding="utf-8"))):
                yield f"{page.relative_to(ROOT)}:{line}: {word}: {instead}"
    for module in sorted(ROOT.glob(HELP)):
        for line, text in helps(module.read_text(encoding="utf-8")):
            place = f"{module.relative_to(ROOT)}:{line}"
            yield from (f"{place}: {word}: {instead}" for _, word, instead in findings(text))
            if not text[:1].isupper() and not text.startswith((".", "`", "[")):
                yield f"{place}: {text[:30]!r}: a help text begins with a capital"


if __name__ == "__main__":
    found = list(problems())
    print("\n".join(found) or "words: nothing found")
    sys.exit(bool(found))
