# SPDX-License-Identifier: BSD-2-Clause
"""Requirements of flight software: their code, their tests, and whether the tests reach the code.

    python .ci/requirements.py build/requirements docs/evidence_requirements.md (make requirements)

A requirement is a row `| J.1-3 | The manager shall ... |` in a page ssp/*/*.md. Its id is in
comments above functions of fmus/ and in the marker `verifies` of tests. The command runs these
tests with flight software that records every function that it enters, and writes the page. Exits
with 1 if a requirement has no such comment or no such test, if a comment or a marker has an id that
no requirement has, or if a test fails or enters none of these functions.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import fmpy
import pytest
from _pytest.runner import runtestprotocol

from fmus.core.build import flight_rules

ROOT = flight_rules.FMUS.parent
ROW = re.compile(r"^\| ([A-Z]\.\d+-\d+) \| (.+) \|$", re.MULTILINE)
COMMENT = re.compile(
    r"^/\* ([A-Z]\.\d+-\d+(?:, [A-Z]\.\d+-\d+)*) \*/\n[^;{]*?\b(\w+)\(", re.MULTILINE
)
MENTION = re.compile(r"/\* [A-Z]\.\d+-\d+")
RECORDER = """#define _GNU_SOURCE
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SLOTS = 4096 };
static struct { void *function; const char *test; } seen[SLOTS];

#define SILENT __attribute__((no_instrument_function, visibility("hidden")))
SILENT void __cyg_profile_func_exit(void *function, void *caller) { (void)function, (void)caller; }
SILENT void __cyg_profile_func_enter(void *function, void *caller)
{
    const char *test = getenv("PYTEST_CURRENT_TEST");
    size_t i = (size_t)function / 4 % SLOTS;
    (void)caller;
    if (!test) return;
    while (seen[i].function && seen[i].function != function) i = (i + 1) % SLOTS;
    if (seen[i].function == function && seen[i].test == test) return;
    seen[i].function = function;
    seen[i].test = test;
    Dl_info from;
    FILE *file = fopen(getenv("REACHED_FUNCTIONS"), "a");
    dladdr(function, &from);
    fprintf(file, "%s\\t%s\\t%zx\\n", test, strrchr(from.dli_fname, '/') + 1,
            (size_t)function - (size_t)from.dli_fbase);
    fclose(file);
}
"""
HEAD = """# Requirements, traced

`make requirements` writes this page. A requirement is a row of the [equations](models.md). Its id
stands above the function that satisfies it and in the marker `verifies` of the tests that verify
it. Each of these tests passed and entered the function.

Requirements state behaviour. The equations themselves, units and ranges are not repeated here.
"""


class Trace(NamedTuple):
    """Requirements with their code and tests, by id. texts: text, and file that states it; code:
    pairs (file, function) with the id in a comment above; tests: tests that verify it.
    """

    texts: Mapping[str, tuple[str, Path]]
    code: Mapping[str, tuple[tuple[Path, str], ...]]
    tests: Mapping[str, tuple[str, ...]]


# ---- ids in equations, code and tests ----
def texts(root: Path = ROOT) -> dict[str, tuple[str, Path]]:
    """Return text and file of all requirements by id; raise ValueError if an id exists twice."""
    found: dict[str, tuple[str, Path]] = {}
    for path in sorted(root.glob("ssp/*/*.md")):
        for name, text in ROW.findall(path.read_text(encoding="utf-8")):
            if name in found:
                raise ValueError(f"{path}: {name} exists twice")
            found[name] = (text, path.relative_to(root))
    return found


def code(root: Path = ROOT) -> dict[str, tuple[tuple[Path, str], ...]]:
    """Return, by id, the pairs (file, function) whose comment above the function has this id; raise
    ValueError if a comment with an id is not directly above a function.
    """
    found: dict[str, tuple[tuple[Path, str], ...]] = {}
    for path in sorted((root / "fmus").rglob("*.[ch]")):
        text = path.read_text(encoding="utf-8")
        rows = COMMENT.findall(text)
        if len(rows) != len(MENTION.findall(text)):
            raise ValueError(f"{path}: a comment with a requirement's id must be above a function")
        for names, function in rows:
            for name in names.split(", "):
                found[name] = (*found.get(name, ()), (path.relative_to(root), function))
    return found


def tests(root: Path = ROOT) -> dict[str, tuple[str, ...]]:
    """Return the tests that verify each requirement, as FILE::FUNCTION, by id of requirements."""
    found: dict[str, tuple[str, ...]] = {}
    for path in sorted((root / "tests").rglob("test_*.py")):
        text = path.read_text(encoding="utf-8")
        if "mark.verifies" not in text:
            continue
        for node in ast.walk(ast.parse(text)):
            for name in _verified(node):
                test = f"{path.relative_to(root).as_posix()}::{node.name}"
                found[name] = (*found.get(name, ()), test)
    return found


def _verified(node: ast.AST) -> Iterator[str]:
    """Yield the ids in the markers of a function."""
    for mark in node.decorator_list if isinstance(node, ast.FunctionDef) else ():
        if isinstance(mark, ast.Call) and ast.unparse(mark.func) == "pytest.mark.verifies":
            yield from (ast.literal_eval(argument) for argument in mark.args)


def trace(root: Path = ROOT) -> Trace:
    """Return all requirements with their code and tests."""
    return Trace(texts(root), code(root), tests(root))


def gaps(t: Trace) -> Iterator[str]:
    """Yield a message for each id without code or tests, and for each id of no requirement."""
    for name in t.texts:
        if name not in t.code:
            yield f"{name}: no comment in fmus/ has this id; put one above the function"
        if name not in t.tests:
            yield f"{name}: no test verifies it; mark one with @pytest.mark.verifies"
    for name in t.code.keys() - t.texts.keys():
        yield f"{name}: no requirement has this id, which is in a comment of {t.code[name][0][0]}"
    for name in t.tests.keys() - t.texts.keys():
        yield f"{name}: no requirement has this id, which is in a marker of {t.tests[name][0]}"


# ---- functions that a test enters ----
def record(folder: Path, selected: Iterable[str]) -> dict[str, set[tuple[str, str]]]:
    """Run the selected tests with FMUs that record every function that they enter; return by test
    the pairs (component, function). Raise CalledProcessError if a test fails.
    """
    build_recording(folder)
    file = folder / "functions.txt"
    file.write_text("", encoding="utf-8")
    environment = os.environ | {
        "SERVICING_FMUS_BUILD": str(folder.resolve()),
        "REACHED_FUNCTIONS": str(file.resolve()),
        "PYTHONPATH": str(Path(__file__).parent),
        "OPENBLAS_NUM_THREADS": "1",
    }
    command = [sys.executable, "-m", "pytest", "-q", "-n", "auto", "-p", "requirements"]
    subprocess.run([*command, *selected], check=True, cwd=ROOT, env=environment)
    return entered(file, folder)


def build_recording(folder: Path) -> None:
    """Build in folder/fmus the FMUs of flight software with functions that call the recorder on
    entry. All other FMUs in this folder are links to the FMUs in build/fmus.
    """
    (folder / "fmus").mkdir(parents=True, exist_ok=True)
    (folder / "recorder.c").write_text(RECORDER, encoding="utf-8")
    headers = [*flight_rules.INCLUDE, f"-I{Path(fmpy.__file__).parent / 'c-code'}"]
    cc = [*flight_rules.compiler(), *flight_rules.FLAGS, "-O0", "-fPIC", "-fvisibility=hidden"]
    adapter = [folder / "recorder.c", *sorted((flight_rules.FMUS / "core/adapter").glob("*.c"))]
    for part in adapter:
        made = folder / f"{part.stem}.o"
        subprocess.run([*cc, "-std=gnu99", *headers, "-c", part, "-o", made], check=True)
    for path in (ROOT / "build/fmus").glob("*.fmu"):
        copy = folder / "fmus" / path.name
        copy.unlink(missing_ok=True)
        copy.symlink_to(path)
    for source in flight_rules.sources():
        library = folder / f"{source.stem}.so"
        objects = [folder / f"{part.stem}.o" for part in adapter]
        options = ["-finstrument-functions", "-shared", source, *objects, "-o", library, "-lm"]
        subprocess.run([*cc, *headers, *options], check=True)
        replace_library(folder / "fmus" / f"{source.stem}.fmu", library)


def replace_library(archive: Path, library: Path) -> None:
    """Replace `archive`, a link to an FMU of the build, by a copy of this FMU in which `library`
    replaces the binary of the same file name.
    """
    original = archive.resolve()
    archive.unlink()
    with zipfile.ZipFile(original) as old, zipfile.ZipFile(archive, "w") as new:
        for entry in old.infolist():
            other = entry.filename.endswith(f"/{library.name}")
            new.writestr(entry, library.read_bytes() if other else old.read(entry))


def entered(file: Path, folder: Path) -> dict[str, set[tuple[str, str]]]:
    """Return the pairs (component, function) by test. file: output of the recorder, a line `test,
    library, offset` per entered function, separated by tabs; folder: the libraries, whose symbols
    give the names of the functions.
    """
    names: dict[str, dict[int, str]] = {}
    found: dict[str, set[tuple[str, str]]] = {}
    for line in set(file.read_text(encoding="utf-8").splitlines()):
        test, library, offset = line.split("\t")
        if library not in names:
            symbols = flight_rules.run(["nm", str(folder / library)]).splitlines()
            words = [line.split() for line in symbols]
            names[library] = {int(w[0], 16): w[2] for w in words if len(w) == 3}
        place = (library.removesuffix(".so"), names[library].get(int(offset, 16), ""))
        found.setdefault(re.split(r"\[| \(", test)[0], set()).add(place)
    return found


def misses(t: Trace, reached: Mapping[str, set[tuple[str, str]]]) -> Iterator[str]:
    """Yield a message per test that enters no function of the requirement that it verifies;
    reached: pairs (component, function) by test.
    """
    for name, verifying in t.tests.items():
        functions = {function for _, function in t.code.get(name, ())}
        stems = {path.stem for path, _ in t.code.get(name, ()) if path.suffix == ".c"}
        for test in verifying:
            if not any(
                function in functions and (component in stems or not stems)
                for component, function in reached.get(test, ())
            ):
                yield f"{name}: {test} does not enter {' or '.join(sorted(functions))}()"


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> bool:
    """Run a test with new instances of all fixtures, so that the functions that a fixture calls
    count for every test that uses it. Return True: pytest must not run the test again.
    """
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    runtestprotocol(item, nextitem=None)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


# ---- the page ----
def order(name: str) -> tuple[str, int, int]:
    """Return the sort key of an id: (J, 1, 3) for J.1-3."""
    letter, section, number = re.split(r"[.-]", name)
    return letter, int(section), int(number)


def page(t: Trace) -> str:
    """Return the page: a table per file of the equations."""
    text, file = HEAD, Path()
    for name in sorted(t.texts, key=order):
        if t.texts[name][1] != file:
            file = t.texts[name][1]
            text += f"\n## {name[0]} ([equations](../{file.as_posix()}))\n\n"
            text += "| id | requirement | code | tests |\n|---|---|---|---|\n"
        places = "<br>".join(f"`{path.name}`: `{f}()`" for path, f in t.code.get(name, ()))
        verifying = "<br>".join(
            f"`{Path(test.partition('::')[0]).stem}::{test.partition('::')[2]}`"
            for test in t.tests.get(name, ())
        )
        text += f"| {name} | {t.texts[name][0]} | {places} | {verifying} |\n"
    return text


def main() -> None:
    """Run the command line, see the docstring of the module."""
    parser = argparse.ArgumentParser()
    for name in ("folder", "page"):
        parser.add_argument(name, type=Path)
    a = parser.parse_args()
    t = trace()
    if wrong := list(gaps(t)):
        sys.exit("\n".join(wrong))
    selected = sorted({test for verifying in t.tests.values() for test in verifying})
    if wrong := list(misses(t, record(a.folder, selected))):
        sys.exit("\n".join(wrong))
    a.page.write_text(page(t), encoding="utf-8")


if __name__ == "__main__":
    main()
