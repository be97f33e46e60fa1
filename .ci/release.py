# SPDX-License-Identifier: BSD-2-Clause
"""Release artefacts: FMUs and systems with their checksums, and a page that lists them, so that who
wants one FMU needs no Python.

python .ci/release.py dist          # make release
"""

from __future__ import annotations

import hashlib
import html
import sys
import tomllib
import zipfile
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
STYLE = "body{font-family:sans-serif;margin:2em}td,th{padding:.2em .6em;text-align:left}"
KINDS = {
    ".fmu": "FMUs",
    ".ssp": "Systems",
    ".zip": "Traceability",
    ".whl": "Python",
    ".gz": "Python",
}
COLUMNS = ("File", "Purpose", "Platforms, standards", "kB", "SHA-256")
DESCRIPTIONS = {".fmu": "modelDescription.xml", ".ssp": "SystemStructure.ssd"}


def version() -> str:
    """The version, from pyproject.toml."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return str(project["version"])


def artefacts(folder: Path) -> list[Path]:
    """Files to publish, by kind and name."""
    found = (p for p in folder.rglob("*") if p.suffix in KINDS)
    return sorted(found, key=lambda p: (list(KINDS).index(p.suffix), p.name))


def digest(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def checksums(folder: Path) -> str:
    """Lines that `sha256sum --check` reads in the folder."""
    return "".join(f"{digest(p)}  {p.relative_to(folder).as_posix()}\n" for p in artefacts(folder))


def about(path: Path) -> tuple[str, str]:
    """What an archive says of itself; its standard with the platforms of its binaries or the number
    of its components.
    """
    if path.suffix == ".zip":
        return "equations, sources, validation and verdicts of FMUs and parameter sets", "SRMD 1.1"
    if path.suffix not in DESCRIPTIONS:
        return "", ""
    with zipfile.ZipFile(path) as archive:
        root = ElementTree.fromstring(archive.read(DESCRIPTIONS[path.suffix]))
        places = {n.split("/")[1] for n in archive.namelist() if n.startswith("binaries/")}
    components = sum(1 for e in root.iter() if e.tag.endswith("}Component") and e.get("source"))
    what = f"{components} FMUs" if path.suffix == ".ssp" else ", ".join(sorted(places))
    standard = (
        f"FMI {root.get('fmiVersion')}" if path.suffix == ".fmu" else f"SSP {root.get('version')}"
    )
    return root.get("description", ""), f"{standard}: {what}"


def index(folder: Path) -> Iterator[str]:
    """The page."""
    title = f"servicing-fmus {version()}"
    yield f"<!DOCTYPE html><html lang='en'><head><meta charset='utf-8'><title>{title}</title>"
    yield f"<style>{STYLE}</style></head><body><h1>{title}</h1>"
    yield "<p>Check what you downloaded: <code>sha256sum --check SHA256SUMS</code></p>"
    kind = ""
    for path in artefacts(folder):
        if KINDS[path.suffix] != kind:
            yield ("</table>" if kind else "") + f"<h2>{(kind := KINDS[path.suffix])}</h2><table>"
            yield "<tr>" + "".join(f"<th>{title}</th>" for title in COLUMNS) + "</tr>"
        text, platforms = about(path)
        name = path.relative_to(folder).as_posix()
        cells = [
            f"<a href='{html.escape(name)}'>{html.escape(path.name)}</a>",
            html.escape(text),
            platforms,
            f"{path.stat().st_size / 1e3:.0f}",
            f"<code>{digest(path)}</code>",
        ]
        yield "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"
    yield "</table></body></html>"


def write(folder: Path) -> None:
    """SHA256SUMS and index.html of a folder of artefacts."""
    (folder / "SHA256SUMS").write_text(checksums(folder), encoding="utf-8")
    (folder / "index.html").write_text("\n".join(index(folder)) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
