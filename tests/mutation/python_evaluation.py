# SPDX-License-Identifier: BSD-2-Clause
"""Verdict of the tests on a deliberate fault in the Python code: a copy of the tree with the fault,
and the tests that have reached its lines until one fails: first those that have found something in
the same file, then the cheapest.

The copy has a virtual environment of its own, so that processes which a test starts read the fault
too; it uses the packages of this one. A test that finds something is run without the fault as well,
once: one that fails then, too, is no witness.
"""

from __future__ import annotations

import ast
import compileall
import os
import shutil
import socket
import subprocess
import sys
import sysconfig
import venv
from collections import Counter, defaultdict
from pathlib import Path

from tests.mutation.evaluation import CAUGHT, SURVIVED, UNREAD
from tests.mutation.faults import Fault
from tests.mutation.python_runner import lines, say
from tests.mutation.reached import ROOT, Reached, Tests

COPIED = ("harness", "ssp", "tests")
LEFT_OUT = (".git", ".venv", "dist", "results")
CHEAP = 0.5
"""Tests below go first, one by one; the others file by file, for the sake of their fixtures [s]."""
MOST = 60.0
"""Tests that cost more together when they are recorded are left out, the dearest first [s]."""
SECONDS, PATIENCE = 300, 900
"""Processor time and time of the tests of one fault [s]; one that needs more is caught: it never
ends."""


class PythonTree:
    """A copy of what the tests need, and a process that runs them there.

    fresh: no fault is put into what has been read already.
    """

    def __init__(self, folder: Path, fresh: bool = False) -> None:
        self.root, self.fresh = folder / "tree", fresh
        self.root.mkdir()
        for part in COPIED:
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / part, self.root / part, ignore=ignored)
        for path in ROOT.iterdir():
            if path.name not in (*COPIED, *LEFT_OUT):
                (self.root / path.name).symlink_to(path)
        self.sources = self.root / "harness"
        compileall.compile_dir(self.root, quiet=2)
        self.reached = Reached()
        self.found: dict[str, Counter[str]] = defaultdict(Counter)
        self.sound: dict[str, bool] = {}
        python = _environment(folder / "venv", self.root)
        self.channel, theirs = socket.socketpair()
        number = theirs.fileno()
        given = [python, "-m", "tests.mutation.python_runner", str(number), folder]
        with (folder / "output.txt").open("wb") as output:
            self.runner = subprocess.Popen(
                given, cwd=self.root, pass_fds=[number], stdout=output, stderr=output,
                env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},
            )  # fmt: skip
        theirs.close()
        self.answers = lines(self.channel)
        self.answers.readline()  # sources stay as they are until all have been read

    def failure(self, file: Path, old: str, new: str, tests: list[str]) -> tuple[str, str]:
        """The first of the tests that fails with another text of a file; how, if it ends them."""
        order = {"file": str(file), "old": old, "new": new, "tests": tests}
        before = file.stat()
        file.write_text(new, encoding="utf-8")
        try:
            say(
                self.channel,
                {**order, "fresh": self.fresh, "seconds": SECONDS, "patience": PATIENCE},
            )
            return eval(self.answers.readline())
        finally:
            file.write_text(old, encoding="utf-8")
            os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))


def _environment(place: Path, root: Path) -> Path:
    """A Python with the `harness` of the copy."""
    venv.create(place, symlinks=True)
    packages = next(place.glob("lib/python*/site-packages"))
    (packages / "copy.pth").write_text(f"{root}\n{sysconfig.get_path('purelib')}\n")
    script = Path(sys.executable).with_name("harness")
    python = place / "bin" / "python"
    (place / "bin" / "harness").write_text(script.read_text().replace(sys.executable, str(python)))
    (place / "bin" / "harness").chmod(0o755)
    return python


def evaluate(tree: PythonTree, fault: Fault) -> tuple[str, str]:
    """Outcome of a fault, and the test that has caught it, or how many it has passed. One that no
    test reaches has survived none.
    """
    file = tree.sources / fault.file
    source = file.read_text(encoding="utf-8")
    try:
        compile(faulty := fault.applied(source), fault.file, "exec")
    except SyntaxError:
        return UNREAD, ""
    names = tree.reached.by(
        fault.file, _lines(source, fault) if _in_function(source, fault) else ()
    )
    before = tree.found[fault.file]
    while True:
        sound = {name for name in names if tree.sound.get(name, True)}
        chosen = _chosen(sound, tree.reached.tests, before)
        name, how = tree.failure(file, source, faulty, chosen)
        if not name + how:
            return SURVIVED, f"{len(chosen)} of {len(names)} tests"
        if name not in tree.sound:
            tree.sound[name] = not tree.failure(file, source, source, [name])[0]
        if tree.sound[name]:
            before[name] += 1
            return CAUGHT, name + how


def _in_function(source: str, fault: Fault) -> bool:
    """Whether its lines run in a call; others run while the module is read, in the test that reads
    it first.
    """
    line = source.count("\n", 0, fault.first) + 1
    return any(
        node.body[0].lineno <= line <= (node.end_lineno or line)
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.FunctionDef)
    )


def _lines(source: str, fault: Fault) -> range:
    """Lines of the statement, or of the head of one with others inside."""
    first, last = (source.count("\n", 0, place) + 1 for place in (fault.first, fault.last))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.stmt) and node.lineno <= first:
            bodies = [node, *getattr(node, "cases", [])]
            inside = [part.lineno for one in bodies for part in getattr(one, "body", [])]
            end = min(inside) - 1 if inside else node.end_lineno
            if last <= end:
                return range(node.lineno, end + 1)
    return range(first, last + 1)


def _chosen(names: set[str], tests: Tests, before: Counter[str]) -> list[str]:
    """Tests in the order in which they run, as many as may cost so much."""

    def order(name: str) -> tuple[object, ...]:
        alone = tests.alone(name)
        if name in before and alone < 10 * CHEAP:
            return 0, -before[name] / (0.1 + alone), "", alone
        if alone < CHEAP:
            return 1, alone, "", alone
        file = name.partition("::")[0]
        return 2, cheapest[file], file, alone

    cheapest: dict[str, float] = {}
    for name in names:
        file = name.partition("::")[0]
        cheapest[file] = min(cheapest.get(file, 1e9), tests.alone(name))
    total, found, made = 0.0, [], set[str]()
    for name in sorted(names, key=lambda name: (tests.alone(name), name)):
        total += tests.tests[name]
        total += sum(tests.fixtures.get(f, 0.0) for f in {*tests.uses[name]} - made)
        made.update(tests.uses[name])
        if total <= MOST or not found:
            found.append(name)
    return sorted(found, key=lambda name: (*order(name), name))
