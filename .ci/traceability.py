# SPDX-License-Identifier: BSD-2-Clause
"""Write an archive with a resource meta data file (.srmd of SSP Traceability 1.1) for every FMU and
every parameter set of every system, from validation cases, requirements and claims.

python .ci/traceability.py build -o build/traceability.zip      # make traceability

The folder has FMUs in fmus/ and fmus3/ and systems in ssp/. The file of an FMU states the equations
and their source, the hash of its sources, the options of its compiler and the results of the cases
of `harness validate`. The file of a parameter set states the verdicts of requirements and claims in
its run. If the build contains a system twice, with FMUs of FMI 2.0 and of FMI 3.0, and the first
macro steps of the two have the same bits, only one of the two is run, and the .srmd files of the
other one name the system that was run. An entry whose value is not known is omitted. The same build
gives the same bytes: the files contain no date and no name of a person.
"""

from __future__ import annotations

import argparse
import hashlib
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from harness import load, run
from harness.claims.case import validate
from harness.claims.report import judgements
from harness.errors import HarnessError
from harness.files.archive import pack, read_all
from harness.master.changes import set_names
from harness.mission.claim import Row
from harness.results.requirements import findings
from harness.results.verdict import Kind
from harness.system.model import System
from ssp.validation.case import cases

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "fmus/core/build"))
from package_fmu import opening_comment  # noqa: E402

SRMD = "http://ssp-standard.org/SSPTraceability1/SimulationResourceMetaData"
STC = "http://ssp-standard.org/SSPTraceability1/SSPTraceabilityCommon"
TYPE = "io.github.servicing-fmus"

BEGIN = 100
"""Number of first macro steps in which two systems must have the same bits to share a run."""

Entry = tuple[str, str]
"""Keyword and value of an entry of a .srmd file."""


def srmd(name: str, data: str, content: bytes, kind: str, entries: Iterable[Entry]) -> bytes:
    """Return the .srmd file of a resource (an FMU or a system).

    data: path of the resource relative to the .srmd file; content: bytes of the resource; kind:
    "model" or "parameters", the subject of the entries.
    """
    for prefix, space in (("srmd", SRMD), ("stc", STC)):
        ElementTree.register_namespace(prefix, space)
    root = ElementTree.Element(f"{{{SRMD}}}SimulationResourceMetaData")
    checksum = hashlib.sha3_256(content).hexdigest().upper()
    root.attrib |= {"version": "1.1", "name": name, "data": data, "checksum": checksum}
    root.attrib |= {"checksumType": "SHA3-256"}
    table = ElementTree.SubElement(root, f"{{{STC}}}Classification", {"type": f"{TYPE}.{kind}"})
    for keyword, text in entries:
        entry = ElementTree.SubElement(table, f"{{{STC}}}ClassificationEntry")
        entry.attrib["keyword"], entry.text = keyword, text
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True) + b"\n"


def about_fmu(path: Path, rows: Sequence[Row]) -> Iterator[Entry]:
    """Yield the entries of an FMU; rows: results of all cases of `harness validate`."""
    files = dict(sorted(read_all(path).items()))
    source = files[f"sources/{path.stem}.c"].decode()
    yield "source.equations", opening_comment(source).strip()
    digest = hashlib.sha256()
    for name in (name for name in files if name.startswith("sources/")):
        digest.update(f"{name}\0{len(files[name])}\0".encode() + files[name])
    yield "source.sha256", digest.hexdigest()
    if build := files.get("sources/buildDescription.xml"):
        for file_set in ElementTree.fromstring(build).iter("SourceFileSet"):
            yield "build.compiler", f"{file_set.get('compiler')} {file_set.get('compilerOptions')}"
    fmu_of_case = {case.id: case.fmu for case in cases()}
    for name in dict.fromkeys(row.case for row in rows if fmu_of_case[row.case] == path.stem):
        yield "validation.case", _validated([row for row in rows if row.case == name])


def _validated(rows: Sequence[Row]) -> str:
    """Return a line about a case: source of the published values, differences of the FMU from them,
    verdict.
    """
    shown = "; ".join(
        f"{r.quantity} {r.difference:.1g} of {r.tolerance:.1g} {r.unit}" for r in rows
    )
    verdict = "agrees" if all(row.within for row in rows) else "DIFFERS"
    return f"{rows[0].case} ({rows[0].source['name']}): {shown}; {verdict}"


def about_set(system: Path, params: str) -> list[Entry]:
    """Run a system with a parameter set and return the entries about the run."""
    return list(_about_run(system, params))


def _about_run(system: Path, params: str) -> Iterator[Entry]:
    try:
        result = run(system, params=params)
    except HarnessError as error:
        yield "run", " ".join(str(error).split())
        return
    yield "run", "complete" if result.complete else f"ends early at {result.time[-1]:g} s"
    for found in findings(result):
        yield "requirement.verdict", str(found)
    for paper, claims, deviations in judgements(result):
        other = "; not the case of the paper" if deviations else ""
        for claim, judgement in claims:
            verdict = Kind.CLAIM.word(judgement.verdict)
            yield "claim.verdict", f"{paper.title}: {claim.name}: {verdict}{other}"


# ---- systems that are run


def representatives(files: Sequence[Path]) -> dict[Path, Path]:
    """Return for the file of each system the file that is run instead: itself, or an earlier file
    with the same components, values and connections whose first macro steps have the same bits
    (as for FMUs of FMI 2.0 and 3.0).
    """
    distinct: list[tuple[Path, object]] = []
    found = {}
    for path in files:
        with load(path) as system:
            content = _content(system)
        alike = (
            other for other, known in distinct if known == content and _same_begin(other, path)
        )
        found[path] = next(alike, path)
        if found[path] == path:
            distinct.append((path, content))
    return found


def _content(system: System) -> object:
    """Return all that a run depends on, except the contents of the FMUs."""
    parts = [replace(component, fmu=Path(component.fmu.name)) for component in system.components]
    values = system.sets, system.experiment, system.requirements
    return system.name, parts, system.connections, values


def _same_begin(one: Path, other: Path) -> bool:
    """Return whether the first steps of two systems with the same content have the same bits."""
    with load(one) as system:
        stop = system.experiment.start + BEGIN * (system.experiment.step or 0.0)
    a, b = (run(path, stop=stop, every=1) for path in (one, other))
    return a.columns == b.columns and a.values.tobytes() == b.values.tobytes()


Map = Callable[[Callable[[Path, str], list[Entry]], Sequence[Path], Sequence[str]], Iterable[Any]]
"""Type of the built-in function map(), and of the method map() of a process pool."""


def contents(folder: Path, rows: Sequence[Row], mapped: Map = map) -> dict[str, bytes]:
    """Return the files of the archive by name; rows: results of all cases of `harness validate`;
    mapped: function that applies about_set() to all runs, such as map().
    """
    found = {}
    for kind, ending in (("fmus", ""), ("fmus3", ".fmi3")):
        for path in sorted((folder / kind).glob("*.fmu")):
            name = f"{path.stem}{ending}"
            about = about_fmu(path, rows)
            found[f"{name}.srmd"] = srmd(
                name, f"{kind}/{path.name}", path.read_bytes(), "model", about
            )
    system_run = representatives(
        sorted((folder / "ssp").glob("*.ssp"), key=lambda p: (len(p.name), p.name))
    )
    runs = [(path, name) for path in dict.fromkeys(system_run.values()) for name in _sets(path)]
    entries = dict(zip(runs, mapped(about_set, *_columns(runs)), strict=True))
    for path, other in sorted(system_run.items()):
        origin = [("run.of", other.name)] if other != path else []
        for params in _sets(other):
            name, about = f"{path.stem}.{params}", origin + entries[other, params]
            found[f"{name}.srmd"] = srmd(
                name, f"ssp/{path.name}", path.read_bytes(), "parameters", about
            )
    return found


def _sets(path: Path) -> list[str]:
    with load(path) as system:
        return set_names(system)


def _columns(runs: Sequence[tuple[Path, str]]) -> tuple[list[Path], list[str]]:
    return [path for path, _ in runs], [name for _, name in runs]


def main() -> None:
    """Run the command line, see the docstring of the module."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    a = parser.parse_args()
    with ProcessPoolExecutor(mp_context=get_context("spawn")) as pool:
        pack(a.output, contents(a.folder, validate(), pool.map))
    print(a.output)


if __name__ == "__main__":
    main()
