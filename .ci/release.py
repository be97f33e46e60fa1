# SPDX-License-Identifier: BSD-2-Clause
"""Release artefacts: FMUs and systems with their checksums, a page that lists them for users
without Python, and the check that a release is complete.

python .ci/release.py dist          # write SHA256SUMS and index.html
python .ci/release.py dist --check  # report what is missing, print the commands that publish
"""

from __future__ import annotations

import hashlib
import html
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parents[1]
STYLE = "body{font-family:sans-serif;margin:2em}td,th{padding:.2em .6em;text-align:left}"
KINDS = {
    ".fmu": "FMUs",
    ".ssp": "Systems",
    ".zip": "Reference systems, traceability",
    ".whl": "Python",
    ".gz": "Python",
}
ARCHIVES = {
    "traceability.zip": (
        "equations, sources, validation and verdicts of FMUs and parameter sets", "SRMD 1.1",
    ),
    "reference-ssps.zip": (
        "systems with expected traces, a script that compares the rows of a tool with them, and "
        "test FMUs of FMI 3.0 with Event Mode, clocks, a table and a binary port",
        "SSP 1.0 and 2.0, FMI 2.0 and 3.0",
    ),
}  # fmt: skip
"""Purpose and standard of the archives of a release."""
COLUMNS = ("File", "Purpose", "Platforms, standards", "kB", "SHA-256")
DESCRIPTIONS = {".fmu": "modelDescription.xml", ".ssp": "SystemStructure.ssd"}


def version() -> str:
    """Return the version in harness/__init__.py."""
    text = (ROOT / "harness/__init__.py").read_text(encoding="utf-8")
    return re.findall(r'^__version__ = "(.*)"$', text, re.MULTILINE)[0]


def artefacts(folder: Path) -> list[Path]:
    """Return the files to publish, sorted by kind and name."""
    found = (p for p in folder.rglob("*") if p.suffix in KINDS)
    return sorted(found, key=lambda p: (list(KINDS).index(p.suffix), p.name))


def digest(path: Path) -> str:
    """Return the SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def checksums(folder: Path) -> str:
    """Return the lines that `sha256sum --check` reads in the folder."""
    return "".join(f"{digest(p)}  {p.relative_to(folder).as_posix()}\n" for p in artefacts(folder))


def about(path: Path) -> tuple[str, str]:
    """Return two cells of the page: the purpose of an artefact, and its standard with the platforms
    of its binaries (FMU) or the number of its FMUs (system). Both are "" for Python packages.
    """
    if path.name in ARCHIVES:
        return ARCHIVES[path.name]
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
    """Yield the lines of index.html: a table of the artefacts of each kind."""
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
    """Write SHA256SUMS and index.html of a folder of artefacts."""
    (folder / "SHA256SUMS").write_text(checksums(folder), encoding="utf-8")
    (folder / "index.html").write_text("\n".join(index(folder)) + "\n", encoding="utf-8")


# ---- check of a release

PLATFORMS = 4
"""Number of platforms that every released FMU has binaries for."""


def problems(folder: Path) -> Iterator[str]:
    """Yield a message for every fault of a release: a missing file; changes that are not committed;
    a version or tag that does not match this tree; an FMU without binaries for all platforms; a
    wheel without the documentation; checksums that do not match the files.
    """
    yield from _versions()
    yield from _repository()
    for name, pattern in expected().items():
        if not (found := [p for p in folder.glob(pattern) if p.is_file()]):
            yield f"{folder / name}: missing"
        elif len(found) > 1:
            yield f"{folder / name}: {len(found)} files match, expected one"
    for path in sorted(folder.glob("fmus*/*.fmu")):
        yield from _fmu(path)
    for path in sorted(folder.glob("*.whl")):
        yield from _wheel(path)
    sums = folder / "SHA256SUMS"
    if sums.is_file() and sums.read_text(encoding="utf-8") != checksums(folder):
        yield f"{sums}: differs from the files; write it with .ci/release.py"


def expected() -> dict[str, str]:
    """Return the files that a release must have, as glob patterns relative to the folder of the
    release, by the names that messages show.
    """
    kernel = f"servicing_fmus-{version()}"
    fmus = sorted(
        p.stem for kind in ("plant", "flight") for p in (ROOT / "fmus" / kind).glob("*.c")
    )
    systems = sorted(p.stem for p in (ROOT / "build/ssp").glob("*.ssp"))
    names = [f"{folder}/{fmu}.fmu" for folder in ("fmus", "fmus3") for fmu in fmus]
    names += [f"ssp/{system}{end}" for system in systems for end in (".ssp", ".fmi3.ssp")]
    names += [
        f"{kernel}.tar.gz",
        "traceability.zip",
        "reference-ssps.zip",
        "SHA256SUMS",
        "index.html",
    ]
    return {f"{kernel}-*.whl": f"{kernel}-*.whl"} | {name: name for name in names}


def _versions() -> Iterator[str]:
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    given = dict(re.findall(r"^(version|date-released): (\S+)$", citation, re.MULTILINE))
    if given.get("version") != version():
        yield f"CITATION.cff: version {given.get('version')}, harness/__init__.py has {version()}"
    changelog = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    heading = f"[{version()}] - {given.get('date-released')}"
    if f"## {heading}" != next(iter(re.findall(r"^## .*$", changelog, re.MULTILINE)), ""):
        yield f"CHANGELOG.md: the first heading must be {heading!r}"


def _repository() -> Iterator[str]:
    if _git("status", "--porcelain"):
        yield "the working tree has changes that are not committed"
    tag = f"v{version()}"
    if _git("tag", "--list", tag) and tag not in _git("tag", "--points-at", "HEAD").split():
        yield f"the tag {tag} exists and belongs to another commit"


def _git(*words: str) -> str:
    command = ["git", "-C", str(ROOT), *words]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout.strip()


def _fmu(path: Path) -> Iterator[str]:
    with zipfile.ZipFile(path) as archive:
        given = ElementTree.fromstring(archive.read(DESCRIPTIONS[".fmu"])).get("version")
        places = {n.split("/")[1] for n in archive.namelist() if n.startswith("binaries/")}
    if given != version():
        yield f"{path}: version {given}, expected {version()}"
    if len(places) != PLATFORMS:
        yield f"{path}: binaries for {len(places)} platforms, expected {PLATFORMS}"


def _wheel(path: Path) -> Iterator[str]:
    with zipfile.ZipFile(path) as archive:
        if not any(name.endswith("site/index.html") for name in archive.namelist()):
            yield f"{path}: contains no documentation site"


def check(folder: Path) -> int:
    """Print the problems of a release, or, if there are none, the two commands that publish it;
    return the exit status.
    """
    if found := list(problems(folder)):
        print(*(f"release: {line}" for line in found), sep="\n", file=sys.stderr)
        return 1
    tag = f"v{version()}"
    print(f"{folder} is complete. To release it:\n")
    print(f"    git tag -a {tag} -m 'servicing-fmus {version()}'\n    git push origin {tag}")
    return 0


if __name__ == "__main__":
    place = Path(sys.argv[1])
    if sys.argv[2:] == ["--check"]:
        sys.exit(check(place))
    write(place)
