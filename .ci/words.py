# SPDX-License-Identifier: BSD-2-Clause
"""Check all tracked text for words outside the vocabulary of the project (docs/glossary.md), and
print for each what to write instead.

python .ci/words.py                 # make lint

Code, names, comments, messages, keys and pages are read alike: names are split at underscores and
capitals. Docstrings, also of constants, are checked for a first word that hides their subject; ruff
(D401) checks that docstrings of functions begin with a verb. Help texts begin with a capital.
"""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
INSTEAD = {
    r"flights?|fly|flies|flying|flew|flown": "run, simulate, simulated",
    r"crews?|hands": "worker pool, worker",
    r"warm|pilots?": "reused simulation",
    r"told|tells?|said|says": "reports, states, prints, shows",
    r"kept|keeps?": "recorded, stored, retained, remains",
    r"asked|asks?": "requested, evaluated",
    r"inquir(?:y|ies)": "analysis",
    r"died|dies|landed": "failed, completed",
    r"gauges?": "metric",
    r"story|stories|marks": "timeline, events",
    r"sealed": "checksummed",
    r"oddity|oddities": "warnings",
    r"refus(?:e|es|ed|al|als|ing)": "error, reject, does not support",
    r"by the book|forgiving": "conforming",
    r"foreign": "third-party",
    r"houses?|rooms?": "package, module",
    r"stands? (?:in|for)": "is in, represents",
    r"(?<!out )of it|that of|those of|whose that is": "its, or the noun",
    r"nobody drives": "unconnected",
    r"judged?|judges": "checked, evaluated",
    r"wants?": "needs, expects",
    r"whatever": "for any, regardless of",
    r"numbers z": "standard normal coordinates",
    r"others' numbers|numbers by others": "published reference values",
    r"harness target": "harness processor",
    r"make figures": "make quoted-values",
    r"hands? over|feel inertia": "the quantity in the words of the field",
}
"""Regular expressions of whole words, and what to write instead."""
ALLOWED = (
    r"flight (?:software|code|attitude|axes|controllers?|computers?|boards?|processors?|path)",
    r"flight (?:fmus?|files?|rules|project|requested|test|apps?|examples?)",
    r"(?:plant and|hyperbolic|straight|free|along|axes of|time of|to|q) flight",
    r"fly-?(?:around|wheels?)",
    r"flown (?:trajectory|trajectories)",
    r"keep[- =](?:out|direction|alive|blank values|global|retain)",
    r"during the attempt .*|x2 in z keeps the system stable",  # quoted from published works
    r"pytest\.mark\w*|marks(?= ?=)",
    r"not judged",
    r"engine\.(?:ask|tell)|file\.tell",  # methods of the libraries cma and io
    r"connection refused",  # text of a message of the operating system
)
"""Phrases with a word of the list in another meaning, of the field or of another library."""
PATHS = re.compile(
    r"flight/[\w<*{]+|[\"/]flight[\"`/]|flight_DIRS|plant-and-flight|flight-rules|FLIGHT\b|flight\W*$",
    re.IGNORECASE,
)
QUOTING = {".ci/words.py", "tests/site/test_words.py"}
"""Files that are not checked, because they contain the words of the list INSTEAD."""
TEXT = {".py", ".c", ".h", ".js", ".html", ".css", ".toml", ".md", ".txt", ".yml", ".yaml", ".cff"}
TEXT |= {".json", ".ipynb", ".template", ".mplstyle"}
HIDING = re.compile(r"(?:What|Who|Whose|Where|How|Of|It|That|Those|Whether)\b")
"""First words of a docstring that hide its subject."""
DOCUMENTED = ("harness/", "ssp/", "fmus/", ".ci/")
HELP = "harness/cli/"
WORDS = {re.compile(rf"(?<!\w)(?:{words})(?!\w)", re.I): text for words, text in INSTEAD.items()}
PHRASES = re.compile("|".join(rf"(?<!\w)(?:{phrase})(?!\w)" for phrase in ALLOWED), re.I)


def blank(found: re.Match[str]) -> str:
    """Return as many blanks as a match has characters."""
    return " " * len(found[0])


def split(line: str) -> str:
    """Return a line with names split into their words: `omegaRate`, `omega_rate`: omega rate."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", " ", line).replace("_", " ")


def findings(text: str) -> Iterator[tuple[int, str, str]]:
    """Yield line, word and replacement of all words of a text that are on the list."""
    for number, line in enumerate(text.splitlines(), start=1):
        words = PHRASES.sub(blank, split(PATHS.sub(blank, line)))
        for pattern, instead in WORDS.items():
            yield from ((number, found[0], instead) for found in pattern.finditer(words))


def documented(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and text of all docstrings: of modules, classes, functions and constants."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            yield node.lineno, str(node.value.value)


PLACES = {"option": 1, "argument": 1, "output": 0}
"""Position of the help text among the arguments of the functions that declare options."""


def helps(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Yield line and text of the help texts of a module of the command line that are constants, and
    of the docstrings of commands.
    """
    for node in ast.walk(tree):
        text: ast.AST | None = None
        if isinstance(node, ast.keyword) and node.arg == "help":
            text = node.value
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            place = PLACES.get(node.func.id, len(node.args))
            text = node.args[place] if place < len(node.args) else None
        elif isinstance(node, ast.FunctionDef) and node.name.endswith("_command"):
            yield node.lineno, ast.get_docstring(node) or ""
        if isinstance(text, ast.Constant):
            yield text.lineno, str(text.value)


def tracked() -> list[str]:
    """Return the tracked files to be checked, and new ones that git does not ignore."""
    command = ["git", "ls-files", "-co", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    named = (name for name in listed.splitlines() if Path(name).suffix in TEXT)
    return [n for n in [*named, "Makefile"] if n not in QUOTING]


def problems() -> Iterator[str]:
    """Yield a line for every finding."""
    for name in tracked():
        if not (ROOT / name).is_file():
            continue  # deleted, not yet committed
        text = (ROOT / name).read_text(encoding="utf-8")
        yield from (
            f"{name}:{line}: {word}: write instead: {instead}"
            for line, word, instead in findings(text)
        )
        if name.endswith(".py") and name.startswith(DOCUMENTED):
            yield from in_python(name, ast.parse(text))


def in_python(name: str, tree: ast.AST) -> Iterator[str]:
    """Yield a line for every finding in the docstrings and help texts of a module."""
    for line, text in documented(tree):
        if found := HIDING.match(text):
            yield f"{name}:{line}: a docstring begins with {found[0]}: name what it describes"
    for line, text in helps(tree) if name.startswith(HELP) else ():
        if not text[:1].isupper() and not text.startswith((".", "`", "[")):
            yield f"{name}:{line}: {text[:30]!r}: a help text begins with a capital"


if __name__ == "__main__":
    found = list(problems())
    print("\n".join(found) or "words: nothing found")
    sys.exit(bool(found))
