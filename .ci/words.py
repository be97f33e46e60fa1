# SPDX-License-Identifier: BSD-2-Clause
"""Words that user pages, help texts, messages and docstrings of the public API do without, each
with what to write instead.

python .ci/words.py                 # make lint
"""

from __future__ import annotations

import ast
import importlib.util
import inspect
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parents[1]
INSTEAD = {
    r"(?<![-\[])(?:fl(?:ies|own|ew)|fly(?!-around|wheel))": "run, simulate",
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
DEVELOPERS = {
    *("architecture.md", "faults.md", "notebook.md", "notebook_missions.md", "performance.md"),
    *("release.md", "tests.md"),
}
"""Pages that users need not read."""
CODE = re.compile(r"^```.*?^```|^ {4}[^\n]*$|`[^`\n]*`|\]\([^)\n]*\)", re.MULTILINE | re.DOTALL)
HELP = "harness/cli/*.py"
CALLED = ("harness", "ssp")
"""Folders whose texts users read."""


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


def messages(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of every string of a module that has more than one word; no docstrings."""
    tree = ast.parse(source)
    silent = {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
    for node in ast.walk(tree):
        text = node.value if isinstance(node, ast.Constant) and id(node) not in silent else ""
        if isinstance(text, str) and " " in text.strip():
            yield node.lineno, text


def public() -> Iterator[tuple[str, str]]:
    """Name and docstring of everything on the pages of the Python API, members included."""
    api = _module(ROOT / ".ci/pages/python.py")
    homes = [api.home(package, name) for package in api.PACKAGES for name in api.names(package)]
    for place in [*homes, api.CHANGES]:
        module, _, name = place.rpartition(".")
        found = getattr(importlib.import_module(module), name)
        yield place, inspect.getdoc(found) or ""
        if inspect.isclass(found) and found.__module__ == module:
            for member, value in vars(found).items():
                if member[0] != "_" and (inspect.isroutine(value) or isinstance(value, property)):
                    yield f"{place}.{member}", inspect.getdoc(value) or ""


def _module(file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(file.stem, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def problems() -> Iterator[str]:
    """A line for everything found."""
    yield from in_pages()
    yield from in_help()
    for module in sorted(p for folder in CALLED for p in (ROOT / folder).rglob("*.py")):
        for line, text in messages(module.read_text(encoding="utf-8")):
            place = f"{module.relative_to(ROOT)}:{line}"
            yield from (f"{place}: {word}: {instead}" for _, word, instead in findings(text))
    for name, text in public():
        for _, word, instead in findings(prose(text)):
            yield f"{name}: docstring: {word}: {instead}"


def in_pages() -> Iterator[str]:
    """What stands in user pages."""
    for page in sorted({p for pattern in PAGES for p in ROOT.glob(pattern)}):
        if page.name not in GENERATED | DEVELOPERS:
            for line, word, instead in findings(prose(page.read_text(encoding="utf-8"))):
                yield f"{page.relative_to(ROOT)}:{line}: {word}: {instead}"


def in_help() -> Iterator[str]:
    """What stands in help texts, which begin with a capital."""
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
