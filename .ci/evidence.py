# SPDX-License-Identifier: BSD-2-Clause
"""Collect the evidence for every component of flight software: structural coverage, absence of
run-time errors, requirements, complexity, deliberate faults (mutations of the code), random inputs
(fuzzing), equal bits on emulated processors, MISRA C.

    python .ci/evidence.py build/mcdc build/evidence docs/evidence_figures.md      (make evidence)

The first folder has the libraries of the FMUs, compiled with coverage counters, and the counts that
the tests have written (profiles/). The command writes a JSON file per component into the second
folder, and the page with a row per component. Deliberate faults and random inputs come from
lab/component_faults.jsonl (make faults) and lab/component_fuzz.jsonl (make fuzz). Exits with 1 if
tests do not reach a part of the code and .ci/unreached.toml has no reason for it, if an entry there
names other parts than the tests leave out, if Frama-C Eva reports an alarm or gives no outcome, if
the deviations from MISRA C differ from .ci/misra.toml, or if faults or random inputs are missing or
older than the code.
"""

import argparse
import json
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

import misra
import proofs
import requirements
import structure

from fmus.core.build import flight_rules

FMUS = flight_rules.FMUS
ROOT = FMUS.parent
PROOFS = ROOT / "build/proofs"
FAULTS, FUZZ = ROOT / "lab/component_faults.jsonl", ROOT / "lab/component_fuzz.jsonl"
PROCESSORS = ROOT / "docs/processor_figures.md"
SHARED = "shared headers"
HEAD = """# Evidence, measured

`make evidence` writes this page, and `build/evidence/COMPONENT.json` with the same numbers, from
its runs. [Evidence](evidence.md) states what they mean and what is missing.

* Statements, branches, conditions: reached by the tests of the FMUs and of the core headers
  (`tests/fmu`, `tests/unit`, without tests marked `long`), counted by {clang}. In a decision with
  several conditions, a condition is counted if it is shown to change the decision alone (MC/DC). A
  row counts the C file and the headers that only this component includes; `{shared}` counts the
  headers that several components include.
* Reasoned: what the tests do not reach, each with a reason below.
* Eva: alarms of {frama_c} for all parameters and inputs that a component's table of
  variables allows
  ([run-time errors](flight_code.md#run-time-errors)), functions and statements that it analysed.
* Sources: first digits of the SHA-256 of the C file and of the headers that it includes, except the
  headers of the FMI adapter, and without comments, descriptions and messages.

"""
COLUMNS = (
    "component", "statements", "branches", "conditions", "reasoned", "Eva", "functions, statements",
    "sources",
)  # fmt: skip
MORE = """
## Requirements, complexity, faults, random inputs, bits
* Requirements: [traced](evidence_requirements.md) to a function of the component and to tests.
* Complexity: the largest cyclomatic complexity of a function in the files of the row (lizard).
* Faults: deliberate faults that a test catches, of those that change the machine code. A small draw
  per component ({draw}, seed {seed}): it shows that the tests of a component check its
  numbers, but is too small to estimate the share of faults that tests catch. `make faults`
  repeats it, `make faults COUNT=40` draws more.
* Random inputs: libFuzzer with the address and undefined behaviour sanitizers: seconds, steps,
  edges of the code that were reached, findings. `make fuzz` repeats it, `make fuzz SECONDS=60` for
  a night.
* Processors: emulated processors on which the default run has the same bits as in the simulation
  ([measured](processor_figures.md)). `older code`: some of these runs were measured before
  their page recorded a digest of the code. An empty cell: not measured.
* Systems: number of systems that contain the component. The tests of executors, of fused systems
  and of WebAssembly run every system ([tests](evidence.md#equal-bits)).

"""
SECOND = (
    "component", "requirements", "complexity", "faults", "seconds", "steps", "edges", "findings",
    "processors", "systems",
)  # fmt: skip
MISRA = """
## MISRA C:2012
Rules that the components and their headers violate, as the addon of cppcheck {version} reports,
each with the reason of the deviation (`make misra`). It reports no violation of another rule.

| rule | places | reason |
|---|---|---|
"""
LIST = """
## Not reached
| file | line | not reached | reason |
|---|---|---|---|
"""


class Row(NamedTuple):
    """Evidence for a component, or for the headers that several components include.

    files: files that are counted in this row; reached: a pair (number reached, total number) each
    for statements, branches and conditions; missing: lines that are not reached; proof: outcome of
    Eva; sources: hash of the sources of the component; requirements: ids of its requirements;
    complexity: largest cyclomatic complexity of a function; faults: outcomes of deliberate faults;
    fuzz: outcome of random inputs; processors: number of emulated processors with equal bits, as
    the text that equal_on() returns; systems: systems that contain the component.
    """

    name: str
    files: tuple[str, ...]
    reached: tuple[tuple[int, int], ...]
    missing: tuple[structure.Missing, ...]
    proof: proofs.Proof | None
    sources: str
    requirements: tuple[str, ...] = ()
    complexity: int = 0
    faults: tuple[dict, ...] = ()
    fuzz: dict | None = None
    processors: str = ""
    systems: tuple[str, ...] = ()


# ---- files ----
@cache
def includes(source: Path) -> tuple[str, ...]:
    """Return the paths, relative to fmus/, of a C file and of the headers that it includes, except
    the headers of the adapter.
    """
    paths = [path.relative_to(FMUS) for path in proofs.files(source)]
    return tuple(str(p) for p in paths if p.parts[:2] != ("core", "adapter"))


def hash_of(source: Path) -> str:
    """Return the first digits of the hash of a C file and the headers of includes(), without
    comments, descriptions and messages. The headers of the adapter are not hashed.
    """
    about = sha256()
    for name in includes(source):
        content = flight_rules.bare(FMUS / name).encode()
        about.update(f"{name}\0{len(content)}\0".encode() + content)
    return about.hexdigest()[:12]


def owners() -> dict[str, tuple[str, ...]]:
    """Return the files that are counted in each row, by name of the row; files that several
    components include are counted in the row SHARED.
    """
    users = Counter(name for source in flight_rules.sources() for name in includes(source))
    own = {
        source.stem: tuple(name for name in includes(source) if users[name] == 1)
        for source in flight_rules.sources()
    }
    return own | {SHARED: tuple(sorted(name for name, n in users.items() if n > 1))}


def lines_of(file: Path) -> dict[str, list[dict]]:
    """Return, by component, a list of its JSON objects in a file with one object per line; {} if
    the file does not exist.
    """
    found: dict[str, list[dict]] = {}
    for line in file.read_text(encoding="utf-8").splitlines() if file.is_file() else ():
        row = json.loads(line)
        found.setdefault(row["component"], []).append(row)
    return found


# ---- rows ----
def complexity(files: Iterable[str]) -> int:
    """Return the largest cyclomatic complexity of a function of some files."""
    import lizard

    analysed = (lizard.analyze_file(str(FMUS / file)) for file in files)
    return max((f.cyclomatic_complexity for a in analysed for f in a.function_list), default=0)


def systems() -> dict[str, tuple[str, ...]]:
    """Return, by name of a component, the systems of the project that contain this component."""
    from harness.files import paths
    from harness.ssp.library import load

    found: dict[str, tuple[str, ...]] = {}
    for name in sorted(paths.systems()):
        with load(name) as system:
            for fmu in {component.fmu.stem for component in system.components}:
                found[fmu] = (*found.get(fmu, ()), name)
    return found


def equal_on() -> dict[str, str]:
    """Return, by component, on how many emulated processors its run has the same bits as in the
    simulation, as text: `4 of 4`, or `4 of 4, older code` (see MORE).
    """
    text = PROCESSORS.read_text(encoding="utf-8")
    found = re.findall(r"^\| (\w+) \|.*\| yes, .* rows.* \| (\w+) \|$", text, re.MULTILINE)
    counts, old = Counter(fmu for fmu, _ in found), {fmu for fmu, at in found if at == "older"}
    return {fmu: f"{n} of 4{', older code' * (fmu in old)}" for fmu, n in counts.items()}


def required() -> dict[str, tuple[str, ...]]:
    """Return, by path of a file relative to fmus/, the ids of the requirements that its code
    meets.
    """
    found: dict[str, tuple[str, ...]] = {}
    for name, places in requirements.code().items():
        for file in {str(path.relative_to("fmus")) for path, _ in places}:
            found[file] = (*found.get(file, ()), name)
    return found


def rows(found: Mapping[str, structure.Counters]) -> Iterator[Row]:
    """Yield the evidence for all components and for the shared headers; found: counters of coverage
    by file.
    """
    sources = {source.stem: source for source in flight_rules.sources()}
    models, ids, used, on = proofs.models(), required(), systems(), equal_on()
    faults, fuzz = lines_of(FAULTS), lines_of(FUZZ)
    for name, files in owners().items():
        counted = [found[file] for file in files if file in found]
        reached = [c.reached() for c in counted]
        sums = tuple(tuple(sum(r[k][i] for r in reached) for i in range(2)) for k in range(3))
        absent = tuple(
            m
            for file in files
            if file in found
            for m in structure.missing(
                file, found[file], (FMUS / file).read_text(encoding="utf-8").splitlines()
            )
        )
        source = sources.get(name)
        proof = source and proofs.prove(source, models[source.stem], PROOFS)
        alarms = proof.error or len(proof.alarms) if proof else "no proof"
        print(
            f"{name}: statements, branches, conditions (reached, in all): {sums}; "
            f"alarms of Frama-C Eva: {alarms}",
            flush=True,
        )
        yield Row(
            name, files, sums, absent, proof, hash_of(source) if source else "",
            tuple(i for file in files for i in ids.get(file, ())), complexity(files),
            tuple(faults.get(name, ())), next(iter(fuzz.get(name, ())), None), on.get(name, ""),
            used.get(name, ()),
        )  # fmt: skip


def total(evidence: Iterable[Row]) -> Row:
    """Return the sum of all rows."""
    evidence = list(evidence)
    sums = tuple(
        tuple(sum(row.reached[k][i] for row in evidence) for i in (0, 1)) for k in range(3)
    )
    return Row("all", (), sums, tuple(m for row in evidence for m in row.missing), None, "")


# ---- outputs ----
def outcome(proof: proofs.Proof | None) -> tuple[str, str]:
    """Return two cells: number of alarms of Eva; functions and statements that Eva analysed."""
    if not proof:
        return "", ""
    if proof.error:
        return "no end", ""
    return f"{len(proof.alarms)} alarms", f"{proof.functions}, {proof.statements}"


def cells(row: Row) -> str:
    """Return the line of a component in the first table of the page."""
    of = [f"{a} of {b}" for a, b in row.reached]
    reasoned = sum(len(m.what) for m in row.missing)
    name = f"`{row.name}`" if row.sources else row.name
    return f"| {' | '.join((name, *of, str(reasoned), *outcome(row.proof), row.sources))} |\n"


def more_cells(row: Row) -> str:
    """Return the line of a component in the second table of the page."""
    changed = [fault for fault in row.faults if fault["outcome"] != "same machine code"]
    caught = sum(fault["outcome"] == "caught" for fault in changed)
    fuzz = row.fuzz or {}
    numbers = (fuzz.get(key, "") for key in ("seconds", "steps", "edges", "findings"))
    cells = (
        f"`{row.name}`", len(row.requirements), row.complexity, f"{caught} of {len(changed)}",
        *numbers, row.processors, len(row.systems),
    )  # fmt: skip
    return f"| {' | '.join(map(str, cells))} |\n"


def older(row: Row) -> Iterator[str]:
    """Yield a message if faults or random inputs of a component are missing, or were made with
    other code.
    """
    for what, target, lines in (
        ("faults", "faults", row.faults),
        ("random inputs", "fuzz", (row.fuzz,)),
    ):
        if not lines or any(not x or x["sources"] != row.sources for x in lines):
            yield f"{row.name}: {what} are missing or older than the code: run make {target}\n"


def code(text: str) -> str:
    """Return C code in the form of Markdown for a cell of a table."""
    return "`" + text.replace("|", "\\|").replace("`", "'") + "`"


def version(command: str) -> str:
    """Return the version number that a tool prints; `?` if it prints none."""
    done = subprocess.run([command, "--version"], capture_output=True, text=True, check=False)
    number = re.search(r"\d+\.\d[\w.-]*", done.stdout)
    return number[0] if number else "?"


def page(evidence: Iterable[Row], known: Mapping[structure.Missing, str], places: Mapping) -> str:
    """Return the page docs/evidence_figures.md; known: reasons for lines that are not reached;
    places: file and line of each violation of MISRA C, by rule.
    """
    evidence = list(evidence)
    components = [row for row in evidence if row.sources]
    text = HEAD.format(
        clang=f"clang {version('clang-19')}", frama_c=f"Frama-C {version('frama-c')}", shared=SHARED
    )
    text += f"| {' | '.join(COLUMNS)} |\n{'|---' * len(COLUMNS)}|\n"
    text += "".join(map(cells, evidence))
    text += cells(total(evidence))
    draws = sorted({(len(row.faults), row.faults[0]["seed"]) for row in components if row.faults})
    text += MORE.format(
        draw=" or ".join(f"{n} faults" for n, _ in draws),
        seed=", ".join(sorted({str(s) for _, s in draws})),
    )
    text += f"| {' | '.join(SECOND)} |\n{'|---' * len(SECOND)}|\n"
    text += "".join(map(more_cells, components))
    text += MISRA.format(version=version("cppcheck"))
    for rule in sorted(places, key=misra.order):
        text += f"| {rule} | {len(places[rule])} | {misra.deviations().get(rule, '')} |\n"
    text += LIST
    for m in sorted(m for row in evidence for m in row.missing):
        what = "<br>".join(code(part) for part in m.what)
        text += f"| `{m.file}` | {code(m.line)} | {what} | {known.get(m, '')} |\n"
    return text


def as_json(row: Row, known: Mapping[structure.Missing, str]) -> str:
    """Return the evidence of a component as JSON; known: reasons for lines that are not reached."""
    names = ("statements", "branches", "conditions")
    document = {
        "component": row.name,
        "sources": row.sources,
        "files": row.files,
        **{n: {"reached": a, "of": b} for n, (a, b) in zip(names, row.reached, strict=True)},
        "not_reached": [m._asdict() | {"reason": known.get(m, "")} for m in row.missing],
        "eva": row.proof._asdict() if row.proof else None,
        "requirements": row.requirements,
        "complexity": row.complexity,
        "faults": row.faults,
        "random_inputs": row.fuzz,
        "processors_with_equal_bits": row.processors,
        "systems": row.systems,
    }
    return json.dumps(document, indent=1) + "\n"


def main() -> None:
    """Run the command line, see the docstring of the module."""
    parser = argparse.ArgumentParser()
    for name in ("counted", "folder", "page"):
        parser.add_argument(name, type=Path)
    a = parser.parse_args()
    for folder in (a.folder, PROOFS):
        folder.mkdir(parents=True, exist_ok=True)
    profile = a.counted / "all.profdata"
    profiles = sorted((a.counted / "profiles").glob("*.profraw"))
    command = ["llvm-profdata-19", "merge", "-sparse", *profiles, "-o", profile]
    subprocess.run(command, check=True)
    compiled = (path for path in a.counted.glob("tmp/**/*.so") if "binaries" not in path.parts)
    libraries = sorted((a.counted / "fmus").glob("*/*.so")) + sorted(compiled)
    found = structure.counters((structure.exported(x, profile) for x in libraries), FMUS)
    known = structure.reasons()
    evidence = list(rows(found))
    for row in evidence:
        (a.folder / f"{row.name.replace(' ', '_')}.json").write_text(as_json(row, known), "utf-8")
    places = misra.places(flight_rules.sources())
    a.page.write_text(page(evidence, known, places), "utf-8")
    wrong = list(structure.differences((m for row in evidence for m in row.missing), known))
    wrong += [f"{row.name}: Eva: {row.proof.error or outcome(row.proof)[0]}\n" for row in evidence
              if row.proof and (row.proof.error or row.proof.alarms)]  # fmt: skip
    wrong += [problem for row in evidence if row.sources for problem in older(row)]
    wrong += list(misra.differences(places, misra.deviations()))
    sys.exit("".join(wrong) or 0)


if __name__ == "__main__":
    main()
