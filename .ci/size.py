# SPDX-License-Identifier: BSD-2-Clause
"""Print the size of the code: modules and lines of code of `harness/` and `ssp/` (docstrings,
comments and blank lines not counted), lengths of functions, packages and their import levels.

    python .ci/size.py
"""

import ast
import io
import statistics
import tokenize
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
SILENT = (
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENDMARKER,
)  # fmt: skip
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def docstrings(tree: ast.AST) -> set[int]:
    """Return the numbers of the lines of docstrings and of other strings that are statements."""
    texts = (
        node
        for node in ast.walk(tree)
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
    return {
        line for node in texts for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }


def code(text: str) -> set[int]:
    """Return the numbers of the lines that hold code."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    spans = (range(t.start[0], t.end[0] + 1) for t in tokens if t.type not in SILENT)
    return {line for span in spans for line in span} - docstrings(ast.parse(text))


def lengths(text: str) -> Iterator[int]:
    """Yield the number of lines of code of every function."""
    lines = code(text)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, FUNCTIONS):
            yield len(lines & set(range(node.lineno, (node.end_lineno or node.lineno) + 1)))


def place(name: str) -> str:
    """Return the package of a module: `harness.results` for `harness.results.result`. A module
    directly in `harness/` belongs to no package: return its own name.
    """
    parts = name.split(".")
    return ".".join(parts[:2]) if parts[0] == "harness" else parts[0]


def is_package(name: str) -> bool:
    """Return whether a dotted name that place() returned is a package, not a single module."""
    return (ROOT / name.replace(".", "/")).is_dir()


def imports(text: str) -> Iterator[str]:
    """Yield the modules that a file imports."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def import_levels(texts: Mapping[str, str]) -> tuple[int, int]:
    """Return the number of packages, and the number of packages on the longest chain of imports;
    texts: source code by dotted name of the module.
    """
    below: dict[str, set[str]] = {}
    for name, text in texts.items():
        known = (i for i in imports(text) if i.partition(".")[0] in ("harness", "ssp"))
        found = {place(i) for i in known} - {place(name), "harness"}
        below.setdefault(place(name), set()).update(found)

    @cache
    def height(each: str) -> int:
        return is_package(each) + max(map(height, below.get(each, ())), default=0)

    return sum(map(is_package, below)), max(map(height, below))


def report(folder: str) -> str:
    """Return a line with the sizes of a folder."""
    texts = [path.read_text(encoding="utf-8") for path in sorted((ROOT / folder).rglob("*.py"))]
    sizes = sorted(n for text in texts for n in lengths(text))
    p90 = sizes[round(0.9 * (len(sizes) - 1))]
    return (
        f"{folder}: {len(texts)} modules, {sum(len(code(text)) for text in texts)} lines of code; "
        f"{len(sizes)} functions, median {statistics.median(sizes):g}, p90 {p90}, "
        f"longest {sizes[-1]}"
    )


def main() -> None:
    """Print the sizes of harness/ and ssp/, and the number of packages and import levels."""
    for folder in ("harness", "ssp"):
        print(report(folder))
    texts = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts): path.read_text(encoding="utf-8")
        for folder in ("harness", "ssp")
        for path in (ROOT / folder).rglob("*.py")
        if path.name not in ("__init__.py", "__main__.py")
    }
    print("{} packages on {} import levels".format(*import_levels(texts)))


if __name__ == "__main__":
    main()
