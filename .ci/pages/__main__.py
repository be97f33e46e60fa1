# SPDX-License-Identifier: BSD-2-Clause
"""Write the pages of the documentation site: from docs/, from the code and from runs.

python .ci/pages build/site-facts --facts   # runs cases and missions, writes facts.json and figures
python .ci/pages build/site-facts --quoted  # makes the runs that pages quote, writes quoted.json
python .ci/pages build/site-facts --fill    # writes the values of quoted.json into the pages
python .ci/pages build/site-facts build/site-pages      # the Markdown that mkdocs reads
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import commands
import keys
import missions
import models
import papers
import python
import quoted
import validation
from text import ROOT, relinked

EXAMPLES = ROOT / "examples"
WEIGHT = 4
"""Weight of pages for users in the search of the site; other pages have 1."""
FILES = {
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "SECURITY.md": "security.md",
    "CITATION.cff": "reference/papers.md",
    "README.md": "index.md",
    "examples/README.md": "examples/index.md",
}
"""Path of the page in the site, by path of the file in the repository; only files outside docs/."""


def homes() -> dict[str, str]:
    """Return the paths of pages in the site, by path of the file that each page shows."""
    docs = (p for p in (ROOT / "docs").rglob("*") if p.is_file())
    found = {f"docs/{p}": str(p) for p in (d.relative_to(ROOT / "docs") for d in docs)}
    found |= dict(missions.equations().values())
    found |= {f"examples/{p.name}": f"examples/{p.stem}.md" for p in scripts()}
    return {k.replace("\\", "/"): v.replace("\\", "/") for k, v in (found | FILES).items()}


def scripts() -> list[Path]:
    """Return the files in examples/ that get a page of their own."""
    return [p for p in sorted(EXAMPLES.iterdir()) if p.suffix in {".py", ".c", ".ipynb", ".toml"}]


def pages(facts: Mapping[str, Any]) -> Iterator[tuple[str, str | bytes]]:
    """Yield path and content of every page of the site, copied or generated, and of its pictures,
    except the figures of missions and the live pages, which main() copies.
    """
    known = homes()
    for source, page in known.items():
        path = ROOT / source
        if page.startswith("examples/") and path.suffix != ".md":
            yield page, example(path)
        elif path.suffix == ".md" and source != "README.md":
            text = quoted.plain(path.read_text(encoding="utf-8"), facts["quoted"], source)
            text = relinked(text, source, page, known)
            yield page, missions.typeset(text) if source.startswith("ssp/") else sought(page, text)
        elif source.startswith("docs/"):
            yield page, path.read_bytes()
    parts = {letter: page for letter, (_, page) in missions.equations().items()}
    yield from commands.pages()
    yield from keys.pages()
    yield from python.pages()
    yield from papers.pages()
    yield from models.pages(facts, parts)
    yield from missions.pages(facts, parts)
    yield from validation.pages(facts)


def sought(page: str, text: str) -> str:
    """Return the text of a page, with a larger weight in the search if the page answers questions
    of users: with equal weights, pages of the reference and of design decisions would come
    first, because they contain the words of the search more often.
    """
    answers = page.startswith("how_to/") or "/" not in page
    return f"---\nsearch:\n  boost: {WEIGHT}\n---\n{text}" if answers else text


def example(path: Path) -> str:
    """Return the page of a script, or of the code cells of a notebook."""
    kind = {".c": "c", ".py": "python", ".ipynb": "python", ".toml": "toml"}[path.suffix]
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        cells = json.loads(text)["cells"]
        text = "\n\n".join("".join(c["source"]) for c in cells if c["cell_type"] == "code")
    return f"# {path.name}\n\n```{kind}\n{text.strip()}\n```\n"


def write(folder: Path, facts: Mapping[str, Any]) -> None:
    """Write all pages into a folder."""
    for name, content in pages(facts):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content.encode() if isinstance(content, str) else content)


def collect(folder: Path, target: str) -> None:
    """Run the validation cases and missions that pages show (target `--facts`) or the runs whose
    values pages quote (`--quoted`), and store the results in a JSON file in the folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    if target == "--facts":
        found = {"validation": validation.facts(), "missions": missions.facts(folder)}
    else:
        found = quoted.facts()
    path = folder / f"{target.removeprefix('--')}.json"
    path.write_text(json.dumps(found, indent=1), encoding="utf-8")


def main(facts: Path, target: str) -> None:
    """Collect facts, fill quoted values into pages, or write the pages of the site into the folder
    `target`; facts: folder of the collected facts.
    """
    if target in {"--facts", "--quoted"}:
        collect(facts, target)
        return
    found = _read(facts / "facts.json")
    values = _read(facts / "quoted.json") | missions.claims(found["missions"])
    if target == "--fill":
        quoted.fill(values)
        return
    folder = Path(target)
    shutil.rmtree(folder, ignore_errors=True)
    write(folder, found | {"quoted": values})
    shutil.copytree(facts / "figures", folder / "reference/missions/figures")
    if (facts / missions.LIVE).is_dir():
        shutil.copytree(facts / missions.LIVE, folder / missions.LIVE)
    import mathjax  # from django-static-mathjax, which the extra `site` installs

    engine = Path(mathjax.__path__[0]) / "static/mathjax/es5/tex-mml-svg.js"
    shutil.copy(engine, folder / "javascripts/tex-mml-svg.js")


def _read(path: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
