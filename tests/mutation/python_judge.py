# SPDX-License-Identifier: BSD-2-Clause
"""What the tests say of a deliberate fault in the Python code: a copy of the tree with the fault,
and the tests that have reached its lines, the quickest first, until one fails.

The copy has a virtual environment of its own, so that processes which a test starts read the fault
too; its packages are those of this one.
"""

from __future__ import annotations

import multiprocessing
import re
import shutil
import sys
import sysconfig
import venv
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from pathlib import Path

import pytest

from tests.mutation.faults import Fault
from tests.mutation.judge import CAUGHT, SURVIVED, UNREAD, failure_in_fork
from tests.mutation.reached import FIXTURE, ROOT, Reached

COPIED = ("harness", "ssp", "tests")
LEFT_OUT = (".git", ".venv", "dist", "results")
READ_BEFOREHAND = (
    "distributed", "fmpy.fmi2", "hypothesis", "jinja2", "k3d", "matplotlib.pyplot", "netCDF4",
    "numpy", "pandas", "plotly.graph_objects", "psutil", "rich", "scipy.stats", "typer", "xarray",
    "zarr",
)  # fmt: skip
"""Large packages that tests import: in forks of the process that runs them they are there."""
FIRST = 40
"""So many tests go first, one by one; the others file by file, for the sake of their fixtures."""
MOST = 150.0
"""Tests that take longer together when they are recorded are left out, the slowest first [s]."""
PATIENCE = 600
"""Time of the tests of one fault [s]; a fault that needs more is caught: it never ends."""


class PythonTree:
    """A copy of what the tests need, and a process that runs them there."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "tree"
        self.root.mkdir()
        for part in COPIED:
            ignored = shutil.ignore_patterns("__pycache__")
            shutil.copytree(ROOT / part, self.root / part, ignore=ignored)
        for path in ROOT.iterdir():
            if path.name not in (*COPIED, *LEFT_OUT):
                (self.root / path.name).symlink_to(path)
        self.sources = self.root / "harness"
        self.reached = Reached()
        multiprocessing.set_executable(str(_environment(folder / "venv", self.root)))
        ways = multiprocessing.get_context("spawn")
        self.runner = ProcessPoolExecutor(1, ways, initializer=_read_beforehand)


def _environment(place: Path, root: Path) -> Path:
    """A Python whose `harness` is that of the copy."""
    venv.create(place, symlinks=True)
    packages = next(place.glob("lib/python*/site-packages"))
    (packages / "copy.pth").write_text(f"{root}\n{sysconfig.get_path('purelib')}\n")
    script = Path(sys.executable).with_name("harness")
    python = place / "bin" / "python"
    (place / "bin" / "harness").write_text(script.read_text().replace(sys.executable, str(python)))
    (place / "bin" / "harness").chmod(0o755)
    return python


def _read_beforehand() -> None:
    for name in READ_BEFOREHAND:
        import_module(name)


def judged(tree: PythonTree, fault: Fault) -> tuple[str, str]:
    """Outcome of a fault, and the test that has caught it, or how many it has passed."""
    file = tree.sources / fault.file
    source = file.read_text(encoding="utf-8")
    first, last = (source.count("\n", 0, place) + 1 for place in (fault.first, fault.last))
    names = tree.reached.by(fault.file, range(first, last + 1))
    if not names:
        return UNREAD, ""
    file.write_text(fault.applied(source), encoding="utf-8")
    try:
        chosen = _affordable(names, tree.reached.seconds)
        fixtures = {n.removeprefix(FIXTURE) for n in names if n.startswith(FIXTURE)}
        for order in (Chosen(chosen[:FIRST]), Chosen(chosen[FIRST:], fixtures, chosen)):
            if found := tree.runner.submit(_failure, tree.root, order).result():
                return CAUGHT, found
    finally:
        file.write_text(source, encoding="utf-8")
    return SURVIVED, f"{len(chosen)} of {len(names)} tests"


def _affordable(names: set[str], seconds: dict[str, float]) -> list[str]:
    """Tests in the order of their time, as many as may take it."""
    total, found = 0.0, []
    for name in sorted(names & seconds.keys(), key=lambda name: (seconds[name], name)):
        total += seconds[name]
        if total <= MOST or not found:
            found.append(name)
    return found


def _failure(root: Path, order: Chosen) -> str:
    files = order.files(root)
    return failure_in_fork(root, files, order, PATIENCE, {}) if files else ""


class Chosen:
    """Plugin of pytest: these tests and no others, in this order; or, with what a fixture of theirs
    has reached, file by file, these and those that ask for the fixture, where they have not been
    called already.
    """

    def __init__(
        self, names: Sequence[str], fixtures: Iterable[str] = (), known: Sequence[str] = ()
    ) -> None:
        self.order = {name: k for k, name in enumerate(names)}
        self.fixtures, self.known = set(fixtures), known

    def files(self, root: Path) -> list[str]:
        """Of the tests, and those in which the fixtures are made."""
        found = [name.partition("::")[0] for name in self.order]
        made = re.compile(rf"\ndef ({'|'.join(map(re.escape, self.fixtures))})\(")
        if self.fixtures:
            files = sorted((root / "tests/harness").glob("test_*.py"))
            some = [p.relative_to(root).as_posix() for p in files if made.search(p.read_text())]
            asked = (name.partition("::")[0] for name in self.known)
            found += some or asked
        return list(dict.fromkeys(found))

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, config: pytest.Config, items: list) -> None:
        chosen = [item for item in items if self._asked(item)]
        config.hook.pytest_deselected(items=[item for item in items if item not in chosen])
        items[:] = chosen
        if not self.known:
            items.sort(key=lambda item: self.order[item.nodeid])

    def _asked(self, item: pytest.Item) -> bool:
        if item.nodeid in self.order:
            return True
        asks = self.fixtures & set(getattr(item, "fixturenames", ()))
        return bool(asks) and item.nodeid not in self.known
