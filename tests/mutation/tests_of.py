# SPDX-License-Identifier: BSD-2-Clause
"""The tests that reach a line of Python or C, from a map that is recorded once.

    .venv/bin/python -m tests.mutation.tests_of harness/files/archive.py:70
    .venv/bin/python -m tests.mutation.tests_of --record [tests/fmu/test_servicer.py ...]

Every file of tests runs in a process of its own: coverage.py measures Python line by line and test
by test, gcov measures C for the whole file of tests (FMUs, executor and link of build/coverage, and
the core headers that tests/unit compiles). `--record` repeats files of tests that are not in the
map, or that have changed, or that reach a changed file. A line is compared with its content when
the map was made.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import hashlib
import json
import os
import re
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
import warnings
from collections import defaultdict
from collections.abc import Container, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from functools import cache, cached_property
from pathlib import Path
from typing import Any, NamedTuple

from coverage.exceptions import CoverageException, CoverageWarning

from tests.mutation.reached import COMMAND, ROOT, Reached, settings

PLACE = "build/tests-of"
MEASURED = ("fmus", "harness", "ssp")
TESTS = "tests/**/test_*.py"
C, PYTHON = (".c", ".h"), (".py",)
LONGEST = 3600
"""Longest time that a file of tests may take [s]."""
RUN_TIME = {
    "fmus/core/lanes/lanes.h": ("tests/harness/master/test_lanes.py",),
    "fmus/core/lanes/runs.h": ("tests/harness/master/test_lanes.py",),
    "fmus/core/adapter/fused.h": ("tests/harness/master/test_fused_system.py",),
    "fmus/core/web/simulation.c": ("tests/systems/test_web_module.py",),
}
"""Files of tests by C file that is compiled, without counters, only while these tests run."""
MISSING = (
    "there is no map of tests yet: make tests-map records it (all tests once, measured: 40 minutes"
    " on two processors)"
)


def main() -> int:
    """Command line, see the docstring of the module; status 1 if no test reaches the line."""
    parser = argparse.ArgumentParser(prog="tests-of")
    parser.add_argument(
        "what", nargs="*", metavar="FILE:LINE", help="with --record: files of tests"
    )
    parser.add_argument("--record", action="store_true", help="record the map")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="processes (--record)")
    a = parser.parse_args()
    if a.record:
        return record(ROOT, a.what, a.jobs)
    places = [re.fullmatch(r"(.+):(\d+)", what) for what in a.what]
    if not places or None in places:
        parser.error("expected FILE:LINE, for example harness/files/archive.py:70")
    if not (ROOT / PLACE / "index.sqlite").is_file():
        parser.error(MISSING)
    known = Map(ROOT)
    return max(_answer(known, *found.groups()) for found in places if found)


def _answer(known: Map, name: str, line: str) -> int:
    path = Path(name).resolve()
    file = path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else name
    try:
        tests, notes = known.tests_of(file, int(line))
    except ValueError as error:
        print(f"{file}:{line}: {error}", file=sys.stderr)
        return 1
    if not tests and file in RUN_TIME:
        notes = [*notes, "compiled while tests run, without counters: all tests that compile it"]
        tests = dict.fromkeys(RUN_TIME[file], 0.0)
    for note in notes:
        print(f"note: {note}", file=sys.stderr)
    print("\n".join(_by_function(tests)) or f"{file}:{line}: no test reaches this line")
    return 0 if tests else 1


def _by_function(tests: dict[str, float]) -> Iterator[str]:
    """Yield the names that pytest takes, the quickest first, the cases of a function as one."""
    cases = defaultdict(list)
    for name in sorted(tests, key=lambda name: (tests[name], name)):
        cases[name.partition("[")[0]].append(name)
    for function, names in cases.items():
        yield names[0] if len(names) == 1 else f"{function}  # {len(names)} cases"


# ---- record


def record(root: Path, wanted: Iterable[str], jobs: int | None) -> int:
    """Record files of tests (none: all that the map does not know as they are now), and make the
    index; status 1 if one could not be recorded.
    """
    place = root / PLACE
    for folder in ("records", "sources", "raw"):
        (place / folder).mkdir(parents=True, exist_ok=True)
    known = {r["test"]: r for r in _records(place)}
    files = sorted(p.relative_to(root).as_posix() for p in root.glob(TESTS))
    for gone in known.keys() - set(files):
        _file_of(place, gone).unlink()
    left = list(wanted) or [f for f in files if not _is_current(root, known.get(f))]
    left.sort(key=lambda f: -sum(known[f]["costs"].values()) if f in known else 0)
    failed = 0
    with ThreadPoolExecutor(jobs) as pool:
        started = {pool.submit(_record, root, test): test for test in left}
        for count, done in enumerate(as_completed(started), 1):
            failed += done.exception() is not None
            text = done.exception() or done.result()
            print(f"{count}/{len(left)} {started[done]}: {text}", flush=True)
    _index(root)
    return bool(failed)


def _records(place: Path) -> Iterator[dict[str, Any]]:
    for path in sorted((place / "records").glob("*.json")):
        yield json.loads(path.read_text(encoding="utf-8"))


def _file_of(place: Path, test: str) -> Path:
    return place / "records" / f"{test.replace('/', '-')}.json"


def _is_current(root: Path, known: dict[str, Any] | None) -> bool:
    """Return whether a record is there, of the file of tests and of sources as they are now;
    sources of Python that it only imports before the first test do not count.
    """
    if known is None:
        return False
    files = {known["test"]: known["digest"]}
    for file, data in known["files"].items():
        if {test for tests in data["lines"].values() for test in tests} - {known["test"]} or (
            data["lines"] and file.endswith(C)
        ):
            files[file] = data["digest"]
    return all(_digest(root / file) == digest for file, digest in files.items())


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""


def _record(root: Path, test: str) -> str:
    """Run a file of tests, measured, and store which test reaches which line."""
    place = root / PLACE
    raw = place / "raw" / test.replace("/", "-")
    shutil.rmtree(raw, ignore_errors=True)
    environment = os.environ | settings(root, raw) | {"GCOV_PREFIX": str(raw / "c")}
    options = ["-q", "-n", "0", "--tb=no", test]
    if (root / "build/coverage/fmus").is_dir():
        environment["SERVICING_FMUS_BUILD"] = str(root / "build/coverage")
    if test.startswith("tests/unit/"):  # they compile the core headers, into files that must stay
        environment["CC"] = f"{environment.get('CC', 'cc')} --coverage"
        options += [f"--basetemp={raw}/tmp", "-o", "tmp_path_retention_policy=all"]
    began = time.monotonic()
    status = _run([*COMMAND, *options], root, environment, raw / "output")
    if status not in (0, 1, 5) or not (raw / "costs.json").is_file():
        text = (raw / "output").read_text(encoding="utf-8", errors="replace")
        raise RuntimeError(f"pytest ended with {status}: {text[-2000:]}")
    reached = _joined(raw)
    files = {**_python(root, reached, test), **_c(root, raw / "c", test)}
    for file, data in files.items():
        data["digest"] = _digest(root / file)
        shutil.copyfile(root / file, place / "sources" / data["digest"])
    known = {"test": test, "digest": _digest(root / test), "costs": reached.tests.tests}
    _file_of(place, test).write_text(json.dumps({**known, "files": files}), encoding="utf-8")
    shutil.rmtree(raw, ignore_errors=True)
    return f"{len(reached.tests.tests)} tests, {time.monotonic() - began:.0f} s"


def _run(command: list[str], root: Path, environment: dict[str, str], output: Path) -> int:
    """Return the status of a command in a session of its own, of which nothing is left."""
    with output.open("wb") as file:
        process = subprocess.Popen(
            command, cwd=root, env=environment, stdout=file, stderr=file, start_new_session=True
        )
        try:
            return process.wait(LONGEST)
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _joined(raw: Path, attempts: int = 5) -> Reached:
    """Return what was measured; a process that tests have left may still be writing, or was ended
    while it wrote.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CoverageWarning)
        try:
            return Reached(raw, retain=True)
        except CoverageException:
            if attempts == 1:
                raise
    time.sleep(1)
    return _joined(raw, attempts - 1)


def _python(root: Path, reached: Reached, test: str) -> dict[str, Any]:
    """Return the tests by line of every Python file that one of them reaches; the file of tests for
    lines that run before the first test.
    """
    found = {}
    for name in sorted(reached.data.measured_files()):
        path = Path(name)
        if path.is_relative_to(root) and path.suffix in PYTHON and path.is_file():
            lines = {n: sorted(tests) or [test] for n, tests in reached.lines(name).items()}
            if lines:
                found[path.relative_to(root).as_posix()] = {"lines": lines}
    return found


def _c(root: Path, prefix: Path, test: str) -> dict[str, Any]:
    """Return the lines of C that a file of tests reaches, with the places of all functions and of
    all lines that a program executes.
    """
    found: dict[str, Any] = {}
    for counters in sorted(prefix.rglob("*.gcda")):
        notes = Path("/") / counters.relative_to(prefix).with_suffix(".gcno")
        if not notes.is_file():
            continue
        counters.with_suffix(".gcno").symlink_to(notes)
        command = ["gcov", "--json-format", "--stdout", counters]
        done = subprocess.run(command, cwd=counters.parent, capture_output=True, check=True)
        for text in done.stdout.splitlines():
            unit = json.loads(text)
            for about in unit["files"]:
                path = Path(unit["current_working_directory"], about["file"]).resolve()
                _take(found, root, path, about, test)
    for data in found.values():
        data["functions"], data["executable"] = map(sorted, (data["functions"], data["executable"]))
    return found


def _take(found: dict[str, Any], root: Path, path: Path, about: dict[str, Any], test: str) -> None:
    """Take what gcov reports for a source in one program."""
    if not path.is_relative_to(root) or path.relative_to(root).parts[0] not in MEASURED:
        return
    data = found.setdefault(
        path.relative_to(root).as_posix(), {"lines": {}, "functions": set(), "executable": set()}
    )
    data["functions"] |= {(f["start_line"], f["end_line"]) for f in about["functions"]}
    data["executable"] |= {line["line_number"] for line in about["lines"]}
    data["lines"] |= {line["line_number"]: [test] for line in about["lines"] if line["count"]}


# ---- index

TABLES = """
CREATE TABLE source (file TEXT PRIMARY KEY, digest TEXT, functions TEXT, executable TEXT);
CREATE TABLE test (id INTEGER PRIMARY KEY, name TEXT UNIQUE, cost REAL);
CREATE TABLE line (file TEXT, line INTEGER, tests TEXT, PRIMARY KEY (file, line)) WITHOUT ROWID;
CREATE TABLE recorded (test TEXT PRIMARY KEY, digest TEXT);
"""


def _index(root: Path) -> None:
    """Join all records, in the lines that the sources have now."""
    place = root / PLACE
    new = place / "index.new"
    new.unlink(missing_ok=True)
    numbers: dict[str, int] = {}
    costs: dict[str, float] = {}
    lines: dict[tuple[str, int], set[int]] = defaultdict(set)
    places: dict[str, dict[str, set[Any]]] = {}
    recorded = {}
    for known in _records(place):
        recorded[known["test"]] = known["digest"]
        costs |= {**known["costs"], known["test"]: sum(known["costs"].values())}
        for file, data in known["files"].items():
            if not (root / file).is_file():
                continue
            now = _now(place / "sources" / data["digest"], root / file)
            for line, tests in data["lines"].items():
                if at := now.get(int(line)):
                    lines[file, at] |= {numbers.setdefault(t, len(numbers)) for t in tests}
            about = places.setdefault(file, {"functions": set(), "executable": set()})
            ends = [(now.get(a), now.get(b)) for a, b in data.get("functions", ())]
            about["functions"] |= {(a, b) for a, b in ends if a and b}
            about["executable"] |= {now[n] for n in data.get("executable", ()) if n in now}
    with sqlite3.connect(new) as base:
        base.executescript(TABLES)
        base.executemany("INSERT INTO test VALUES (?, ?, ?)", (
            (number, name, costs.get(name, 0.0)) for name, number in numbers.items()
        ))  # fmt: skip
        base.executemany("INSERT INTO line VALUES (?, ?, ?)", (
            (*at, json.dumps(sorted(tests))) for at, tests in lines.items()
        ))  # fmt: skip
        base.executemany("INSERT INTO recorded VALUES (?, ?)", recorded.items())
        for file, about in places.items():
            digest = _digest(root / file)
            shutil.copyfile(root / file, place / "sources" / digest)
            row = (json.dumps(sorted(about[kind])) for kind in ("functions", "executable"))
            base.execute("INSERT INTO source VALUES (?, ?, ?, ?)", (file, digest, *row))
    base.close()
    new.replace(place / "index.sqlite")
    used = {d["digest"] for known in _records(place) for d in known["files"].values()}
    used |= {_digest(root / file) for file in places}
    for path in (place / "sources").iterdir():
        if path.name not in used:
            path.unlink()


def _now(then: Path, present: Path) -> dict[int, int]:
    """Return the lines of a file as they are now by the lines as they were; changed ones have
    none.
    """
    old, new = (path.read_text(encoding="utf-8").splitlines() for path in (then, present))
    if old == new:
        return {n: n for n in range(1, len(old) + 1)}
    blocks = difflib.SequenceMatcher(None, old, new, autojunk=False).get_matching_blocks()
    return {b.a + k + 1: b.b + k + 1 for b in blocks for k in range(b.size)}


# ---- answers


class Map:
    """Recorded data of all lines."""

    def __init__(self, root: Path) -> None:
        self.root, self.place = root, root / PLACE
        self.base = sqlite3.connect(self.place / "index.sqlite")
        self.sources = {
            file: (digest, json.loads(functions), json.loads(executable))
            for file, digest, functions, executable in self.base.execute("SELECT * FROM source")
        }
        self.tests = {n: (name, cost) for n, name, cost in self.base.execute("SELECT * FROM test")}
        self.text = cache(self._text)
        self.blocks = cache(self._blocks)

    def tests_of(self, file: str, line: int) -> tuple[dict[str, float], list[str]]:
        """Return the tests that reach a line, with their costs [s], and what the user must know of
        the age of the map; ValueError for a line of which it knows nothing.
        """
        if Path(file).suffix not in C + PYTHON or Path(file).parts[0] not in MEASURED:
            known = ", ".join(f"{folder}/" for folder in MEASURED)
            raise ValueError(f"the map has lines of Python and C below {known} only")
        if not (self.root / file).is_file():
            raise ValueError("there is no such file")
        if file not in self.sources and file.endswith(PYTHON):
            raise ValueError("no test in the map reads this file")
        lines, notes = self._then(file, line)
        if not any(self._look(file, each) for each in lines):
            raise ValueError("there is no code in this line")
        seen: set[tuple[str, int]] = set()
        found = set().union(*(self._reaching(file, each, seen) for each in lines))
        tests = dict(self.tests[number] for number in found)
        if file.endswith(PYTHON):  # tests, or whole files of tests that run it when they begin
            tests = {name: cost for name, cost in tests.items() if "::" in name} or tests
        return tests, [*notes, *self._old_tests(tests)]

    def _then(self, file: str, line: int) -> tuple[list[int], list[str]]:
        """Return the lines of the map that a line of the present file was, or is between."""
        new = (self.root / file).read_text(encoding="utf-8").splitlines()
        old = self.text(file).splitlines()
        if not 1 <= line <= len(new):
            raise ValueError(f"the file has {len(new)} lines")
        if old == new:
            return [line], []
        refresh = "make tests-map records the difference"
        blocks = difflib.SequenceMatcher(None, old, new, autojunk=False).get_opcodes()
        kind, a, b, c = next((k, a, b, c) for k, a, b, c, d in blocks if c < line <= d)
        then = a + line - c
        if kind == "equal":
            moved = f", in which this was line {then}" if then != line else ""
            return [then], [f"{file} has changed since the map was made{moved}; {refresh}"]
        about = f"line {line} has changed since the map was made"
        if then <= b:
            return [then], [f"{about}: these are the tests of line {then} then; {refresh}"]
        near = [n for n in (b, b + 1) if 1 <= n <= len(old)]
        return near, [f"{about}: these are the tests of its neighbours then; {refresh}"]

    def _text(self, file: str) -> str:
        """Return a source as it was when the map was made, or as it is if that is not known."""
        known = file in self.sources
        path = self.place / "sources" / self.sources[file][0] if known else self.root / file
        return path.read_text(encoding="utf-8")

    def _old_tests(self, tests: Iterable[str]) -> Iterator[str]:
        files = dict(self.base.execute("SELECT * FROM recorded"))
        named = {name.partition("::")[0] for name in tests}
        if changed := sorted(f for f in named if _digest(self.root / f) != files.get(f)):
            yield f"changed since the map was made: {', '.join(changed)}"
        present = {p.relative_to(self.root).as_posix() for p in self.root.glob(TESTS)}
        if new := sorted(present - files.keys()):
            yield f"not in the map: {', '.join(new[:5])}{' ...' * (len(new) > 5)}"

    def _at(self, file: str, lines: Container[int]) -> set[int]:
        rows = self.base.execute("SELECT line, tests FROM line WHERE file = ?", (file,))
        return {test for n, tests in rows if n in lines for test in json.loads(tests)}

    def _look(self, file: str, line: int) -> Look | None:
        return (_look_at_c if file.endswith(C) else _look_at_python)(self, file, line)

    def _reaching(self, file: str, line: int, seen: set[tuple[str, int]]) -> set[int]:
        """Return the tests that reach a line. Of a line that runs when a file is read, or never by
        itself: the tests of what uses its names, else of the file, else of what includes it.
        """
        look = self._look(file, line)
        if look is None or (file, line) in seen:
            return set()
        seen.add((file, line))
        found = self._at(file, look.lines)
        for name in look.names:
            for other, use in self._uses(name, file, look.private):
                found |= self._reaching(other, use, seen)
        if not found and look.outside:
            found = self._at(file, EVERY) or self._of_including(Path(file).name, seen)
        return found

    def _of_including(self, header: str, seen: set[tuple[str, int]]) -> set[int]:
        found = set()
        for other in self.c_files:
            if f'#include "{header}"' in self.text(other) and (other, 0) not in seen:
                seen.add((other, 0))
                found |= self._at(other, EVERY) or self._of_including(Path(other).name, seen)
        return found

    @cached_property
    def c_files(self) -> list[str]:
        """All C files in the tree, known to the map or not."""
        paths = (p for f in MEASURED for p in (self.root / f).rglob("*.[ch]"))
        return sorted(path.relative_to(self.root).as_posix() for path in paths)

    def _uses(self, name: str, file: str, private: bool) -> Iterator[tuple[str, int]]:
        """Yield where a name occurs in the file that defines it, and in those that name this
        file.
        """
        others = (
            self.c_files if file.endswith(C) else [f for f in self.sources if f.endswith(".py")]
        )
        word, path = re.compile(rf"\b{re.escape(name)}\b"), Path(file)
        own = path.parent.name if path.stem == "__init__" else path.stem
        module = re.compile(rf"\b{own}\b")
        for other in [file] if private else others:
            text = self.text(other)
            if word.search(text) and (other == file or module.search(text)):
                for number, here in enumerate(text.splitlines(), 1):
                    if word.search(here):
                        yield other, number

    def _blocks(self, file: str) -> list[Any]:
        """Return all statements of a Python file."""
        tree = ast.parse(self.text(file))
        return [n for n in ast.walk(tree) if isinstance(n, ast.stmt | ast.excepthandler)]


class Look(NamedTuple):
    """Return the representatives of a line: recorded lines, and names that it defines.

    private: no other file uses the names; outside: the line is outside of functions.
    """

    lines: Container[int] = ()
    names: Sequence[str] = ()
    private: bool = False
    outside: bool = True


EVERY = range(10**9)
FUNCTIONS = (ast.FunctionDef, ast.AsyncFunctionDef)


def _look_at_python(known: Map, file: str, line: int) -> Look | None:
    around = [node for node in known.blocks(file) if _begin(node) <= line <= node.end_lineno]
    if not around or known.text(file).splitlines()[line - 1].strip()[:1] in ("", "#"):
        return None
    node = max(around, key=lambda n: (_begin(n), -n.end_lineno))
    if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
        return None
    if isinstance(node, FUNCTIONS):
        return Look(_body(node), outside=False)
    if any(isinstance(n, FUNCTIONS) for n in around):
        body = getattr(node, "body", None)
        end = body[0].lineno - 1 if body else node.end_lineno
        return Look(range(node.lineno, max(end, line) + 1), outside=False)
    return _look_outside(node, line, any(isinstance(n, ast.ClassDef) for n in around))


def _look_outside(node: Any, line: int, of_class: bool) -> Look:
    """Look at a statement that runs when the file is read."""
    for each in ast.walk(node):
        if isinstance(each, ast.Lambda) and each.lineno <= line <= (each.end_lineno or 0):
            return Look(range(each.lineno, (each.end_lineno or 0) + 1))
    if isinstance(node, ast.ClassDef):
        inner = (n for n in ast.walk(node) if isinstance(n, FUNCTIONS))
        return Look({n for function in inner for n in _body(function)})
    if isinstance(node, ast.Import | ast.ImportFrom):
        return Look((), [(a.asname or a.name).partition(".")[0] for a in node.names], True)
    names = [n for n in ast.walk(node) if isinstance(n, ast.Name) and isinstance(n.ctx, ast.Store)]
    return Look((), [name.id for name in names], of_class)


def _body(function: Any) -> range:
    return range(function.body[0].lineno, function.end_lineno + 1)


def _begin(node: Any) -> int:
    return min([node.lineno, *(d.lineno for d in getattr(node, "decorator_list", ()))])


def _look_at_c(known: Map, file: str, line: int) -> Look | None:
    here = known.text(file).splitlines()[line - 1].strip()
    if not here or here.startswith(("/*", "* ", "*/", "//")):
        return None
    _, functions, executable = known.sources.get(file, ("", (), ()))
    if inside := [(first, last) for first, last in functions if first <= line <= last]:
        first, last = max(inside)
        own = [n for n in executable if first <= n <= last]
        before = [n for n in own if n <= line]
        return Look(before[-1:] or own[:1], outside=False)
    defined = re.match(r"#\s*define\s+(\w+)", here)
    return Look((), [defined[1]] if defined else ())


if __name__ == "__main__":
    sys.exit(main())
