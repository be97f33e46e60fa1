# SPDX-License-Identifier: BSD-2-Clause
"""Pages of the FMUs, one each: contents of the .fmu, and the checks that the FMU has passed."""

from __future__ import annotations

import ast
import html
import importlib
import json
import re
import sys
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from text import ROOT, between, table

from harness.files import paths

MODELS = re.compile(r"docs/models\.md ([A-N])\b(\.\d+)?")


def writer(name: str) -> Any:
    """Import a module of fmus/core/build, the package that also writes the documentation page
    inside each .fmu, and return the module.
    """
    folder = str(ROOT / "fmus/core/build")
    sys.path.insert(0, folder)
    try:
        return importlib.import_module(name)
    finally:
        sys.path.remove(folder)


def sides() -> dict[str, list[str]]:
    """Return the names of the FMUs by side: `plant`, `flight`."""
    return {
        side: sorted(p.stem for p in (ROOT / "fmus" / side).glob("*.c") if p.stem in paths.fmus())
        for side in ("plant", "flight")
    }


def pages(facts: Mapping[str, Any], parts: Mapping[str, str]) -> Iterator[tuple[str, str | bytes]]:
    """Yield path and content of the pages and pictures of all FMUs; parts: path of the page
    with each part of the equations, by the letter of the part.
    """
    chapters, found = writer("package_fmu").chapters, []
    for side, names in sides().items():
        for name in names:
            with zipfile.ZipFile(paths.fmus()[name]) as archive:
                description = ElementTree.fromstring(archive.read("modelDescription.xml"))
                source = archive.read(f"sources/{name}.c").decode()
                yield f"reference/fmus/{name}.png", archive.read("model.png")
            found.append((side, name, description.attrib["description"]))
            here = f"reference/fmus/{name}.md"
            lines = [
                *_head(name, side, description.attrib["description"]),
                *_chapters(chapters(description, source), here, parts),
                *("## Where it runs\n", *_uses(name), "## Checks\n", *_checks(name, facts)),
            ]
            yield here, "\n".join(lines)
    yield "reference/fmus/index.md", index(found)


def index(found: Sequence[tuple[str, str, str]]) -> str:
    """Return the page that lists all FMUs; found: triples (side, name, description)."""
    lines = [INDEX]
    for side, title in (("plant", "Plants, actuators, sensors"), ("flight", "Flight software")):
        rows = [(f"[`{name}`]({name}.md)", text) for s, name, text in found if s == side]
        lines.append(f"## {title}\n\n" + table(("FMU", "Purpose"), rows))
    return "\n".join(lines)


INDEX = """# FMUs

Every FMU is a co-simulation FMU, built for FMI 2.0 and for FMI 3.0, and needs no other file. The
chapters of its page before "Where it runs" are also in the .fmu, in `documentation/index.html`.
Units are SI units and radians; frames: [Notation](../../notation.md).
"""


def _head(name: str, side: str, text: str) -> Iterator[str]:
    yield f"# {name}\n\n{text}.\n"
    yield f"![Ports of {name}]({name}.png)\n"
    yield f"`{side}` · source `fmus/{side}/{name}.c` · `harness show {name}`\n"


def _chapters(
    chapters: Sequence[tuple[str, str]], page: str, parts: Mapping[str, str]
) -> Iterator[str]:
    for title, body in chapters:
        linked = MODELS.sub(lambda m: _linked(m, page, parts), body)
        yield f'## {title}\n\n<div class="wide" markdown="0">{linked}</div>\n'


def _linked(found: re.Match[str], page: str, parts: Mapping[str, str]) -> str:
    target = between(page, parts[found[1]]).replace(".md", ".html")
    return f'<a href="{target}">{found[1]}{found[2] or ""}</a>'


@lru_cache(maxsize=1)
def components() -> list[tuple[str, str, str]]:
    """Return system, component and FMU of all components of all systems."""
    from harness.ssp.library import load

    rows = []
    for system, path in paths.systems().items():
        with load(path) as found:
            rows += [(system, c.name, Path(c.fmu).stem) for c in found.components]
    return rows


def _uses(name: str) -> Iterator[str]:
    """Yield a line with the components that use an FMU."""
    uses = [f"`{system}.{place}`" for system, place, fmu in components() if fmu == name]
    yield (", ".join(uses) if uses else f"No system; use `--swap COMPONENT={name}`.") + "\n"


def _checks(name: str, facts: Mapping[str, Any]) -> Iterator[str]:
    """Yield the checks of an FMU: published values, flight processors, tests."""
    cases = [c for c in facts.get("validation", ()) if name in c["fmus"]]
    if cases:
        yield "Published reference values ([all cases](../../validation.md)):\n"
        yield table(
            ("Case", "Quantity", "Difference", "Tolerance"),
            (
                (f"[`{c['name']}`](../../validation/{c['family']}.md#{c['name']})",
                 f"`{q}`", f"{max(d['difference']):.1e} {d['unit']}", f"{d['tolerance']:.1e}")
                for c in cases
                for q, d in c["quantities"].items()
            ),
        )  # fmt: skip
    if rows := _processors(name):
        yield "On emulated flight processors ([all](../../processor_figures.md)):\n"
        yield table(("Processor", "Mean step [instructions]", "Stack [bytes]", "Equal bits"), rows)
    statements = [s for file in _tests(name) for s in _statements(file)]
    yield f"Tests of this FMU alone (`tests/fmu/`), in addition to {COMPLIANCE}:\n"
    yield "".join(f"* {html.escape(s)}\n" for s in statements) or "* none\n"


COMPLIANCE = "the life cycle and interface tests of every FMU (`tests/compliance/`)"


def _processors(name: str) -> list[tuple[str, str, str, str]]:
    """Return the rows of an FMU in the table of docs/processor_figures.md, which `make processors`
    writes: processor, instructions per step, stack [bytes], whether the bits are equal.
    """
    lines = (ROOT / "docs/processor_figures.md").read_text(encoding="utf-8").splitlines()
    rows = [[c.strip() for c in line.strip("|").split("|")] for line in lines if line[:1] == "|"]
    titles = next((row for row in rows if "processor" in row), [])
    found = [dict(zip(titles, row, strict=False)) for row in rows if row[0] == name]
    return [(r["processor"], r["instructions"], r["stack"], r["equal bits"]) for r in found]


def _tests(name: str) -> list[Path]:
    others = [n for n in paths.fmus() if n != name and n.startswith(name)]
    found = sorted((ROOT / "tests/fmu").glob(f"test_{name}*.py"))
    return [f for f in found if not f.stem.startswith(tuple(f"test_{n}" for n in others))]


def _statements(file: Path) -> Iterator[str]:
    """Yield the names of the tests of a file as sentences."""
    for node in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            yield node.name.removeprefix("test_").replace("_", " ")


def case_fmus(case: Any) -> list[str]:
    """Return the names of the FMUs that a case of published reference values runs."""
    text = json.dumps(dict(case.setup)) + case.tests
    return [n for n in paths.fmus() if n == case.fmu or re.search(rf"\b{n}\b", text)]
