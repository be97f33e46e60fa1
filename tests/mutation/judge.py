# SPDX-License-Identifier: BSD-2-Clause
"""What the tests say of a deliberate fault: a copy of the tree with the fault, the FMUs whose
machine code it changes built anew, and the tests that name them run until one fails.

Tests run in forks of this process, which has read the large libraries already.
"""

from __future__ import annotations

import json
import os
import re
import resource
import shutil
import subprocess
import sys
import traceback
import zipfile
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

import fmpy
import fmpy.fmi2
import numpy
import pytest
import scipy.integrate
import scipy.linalg
import scipy.spatial.transform
import scipy.stats

from tests.mutation.faults import Fault

ROOT = Path(__file__).resolve().parents[2]
READ_BEFOREHAND = (fmpy.fmi2, numpy, scipy)

HEADERS = ("adapter", "maths", "models", "ports", "physics")
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fPIC", "-fvisibility=hidden")
IGNORED = shutil.ignore_patterns("__pycache__")
UNIT = "tests/unit/core_headers.c"
SECONDS = 120
"""Processor time of the tests of one FMU; a fault that needs more is caught: it never ends."""
BYTES = 8 << 30

PACKAGING = ("test_archive", "test_rebuild", "test_static", "test_tools")
"""Tests of the archive and of its other contents, which are not those of the faulty source."""

CAUGHT, SURVIVED, SAME, ILL = "caught", "survived", "same machine code", "does not compile"


class Tree:
    """A copy of what the tests need, with a build folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.root, self.fmus, self.build = folder, folder / "fmus", folder / "build"
        for part in ("fmus", "tests"):
            shutil.copytree(ROOT / part, folder / part, ignore=IGNORED)
        for part in ("pyproject.toml", "ssp", "docs", "harness", "examples", "LICENSE"):
            (folder / part).symlink_to(ROOT / part)
        shutil.copytree(ROOT / "build/fmus", folder / "good")
        shutil.copytree(ROOT / "build/fmus", self.build / "fmus")
        sources = [p for side in ("plant", "flight") for p in (self.fmus / side).glob("*.c")]
        self.models = {path.stem: path for path in sorted(sources)}
        self.adapter = sorted((self.fmus / "core/adapter").glob("*.c"))
        self.readers = {p: self._reads(p) for p in (*sources, *self.adapter, folder / UNIT)}
        self.objects = {p: self.compiled(p) for p in self.readers}

    def _compiler(self) -> list[str]:
        headers = [self.fmus / "core" / name for name in HEADERS]
        headers += [self.fmus / "flight", Path(fmpy.__file__).parent / "c-code"]
        return ["cc", *FLAGS, *(f"-I{folder}" for folder in headers)]

    def _reads(self, source: Path) -> set[Path]:
        """The C files that a C file is made of."""
        made = subprocess.run(
            [*self._compiler(), "-MM", source], check=True, capture_output=True, text=True
        )
        names = made.stdout.partition(":")[2].replace("\\\n", " ").split()
        return {Path(name).resolve() for name in names}

    def compiled(self, source: Path) -> bytes | None:
        """Its machine code; None if it does not compile."""
        target = self.object(source)
        made = subprocess.run(
            [*self._compiler(), "-w", "-c", source, "-o", target], check=False, capture_output=True
        )
        return target.read_bytes() if made.returncode == 0 else None

    def object(self, source: Path) -> Path:
        return self.build / f"{source.stem}.o"

    def package(self, name: str) -> None:
        """The FMU of this name from what was compiled last, with its description."""
        source, work = self.models[name], self.build / name
        work.mkdir(exist_ok=True)
        library, describe = work / f"{name}.so", work / "describe"
        parts = map(self.object, (source, *self.adapter))
        subprocess.run(["cc", "-shared", *parts, "-o", library, "-lm"], check=True)
        said = [source, self.fmus / "core/build/describe.c", "-o", describe, "-lm"]
        subprocess.run([*self._compiler(), "-O0", "-w", *said], check=True)
        new = {f"binaries/{fmpy.platform}/{name}.so": library.read_bytes()}
        file = f"{name}.fmu"
        with zipfile.ZipFile(self.root / "good" / file) as good:
            new["modelDescription.xml"] = _described(describe, good)
            with zipfile.ZipFile(self.build / "fmus" / file, "w") as faulty:
                for entry in good.infolist():
                    faulty.writestr(entry, new.get(entry.filename) or good.read(entry))

    def restore(self, name: str) -> None:
        """The FMU as it was."""
        shutil.copy(self.root / "good" / f"{name}.fmu", self.build / "fmus")


def _described(describe: Path, archive: zipfile.ZipFile) -> bytes:
    """What the model says of itself; the same version, date and files as before."""
    old = archive.read("modelDescription.xml").decode()
    version = re.search(r'\sversion="([^"]*)"', old)
    date = re.search(r'generationDateAndTime="([^"]*)"', old)
    files = re.findall(r'<File name="([^"]*)"', old)
    words = [found[1] if found else "0" for found in (version, date)]
    return subprocess.run([describe, *words, *files], check=True, capture_output=True).stdout


# ---- tests


def judged(tree: Tree, fault: Fault) -> tuple[str, str]:
    """Outcome of a fault, and the test that has caught it, or the FMUs that carry it."""
    file = tree.fmus / fault.file
    source = file.read_text(encoding="utf-8")
    file.write_text(fault.applied(source), encoding="utf-8")
    readers = [path for path, read in tree.readers.items() if file in read]
    try:
        return _judged(tree, sorted(readers, key=lambda path: _effort(tree, path)))
    finally:
        file.write_text(source, encoding="utf-8")
        for path in readers:
            tree.object(path).write_bytes(tree.objects[path])


def _effort(tree: Tree, source: Path) -> int:
    """The unit tests first, then the adapter, then the FMUs with the fewest tests."""
    return len(tests_of(tree, source.stem)) if source.stem in tree.models else -1


def _judged(tree: Tree, readers: list[Path]) -> tuple[str, str]:
    carriers = []
    for source in readers:
        code = tree.compiled(source)
        if code is None:
            return ILL, ""
        if code == tree.objects[source]:
            continue
        carriers.append(source.stem)
        if test := _first_failure(tree, source):
            return CAUGHT, test
    return (SURVIVED, " ".join(carriers)) if carriers else (SAME, "")


def _first_failure(tree: Tree, source: Path) -> str:
    if source == tree.root / UNIT:
        return failure(tree, ["tests/unit"])
    name = source.stem if source.stem in tree.models else "ideal_propulsion"
    try:
        tree.package(name)
        return next(filter(None, (failure(tree, tests) for tests in _stages(tree, name))), "")
    except subprocess.CalledProcessError as error:
        return f"{name}: build ends with {error.returncode}"
    finally:
        tree.restore(name)


def _stages(tree: Tree, name: str) -> Iterator[list[str]]:
    """Tests of one FMU, what is most likely to fail first."""
    if tests := tests_of(tree, name):
        yield tests
    ignored = (f"--ignore=tests/compliance/{part}.py" for part in PACKAGING)
    yield ["tests/compliance", *ignored, "-k", name]


def tests_of(tree: Tree, name: str) -> list[str]:
    """Files of tests that name an FMU, those about fewest FMUs first."""
    texts = {path: _with_imports(path) for path in (tree.root / "tests/fmu").glob("test_*.py")}
    naming = [path for path, text in texts.items() if f'"{name}"' in text]
    others = [f'"{other}"' for other in tree.models]

    def order(path: Path) -> tuple[bool, int, str]:
        return path.stem != f"test_{name}", sum(o in texts[path] for o in others), path.name

    return [path.relative_to(tree.root).as_posix() for path in sorted(naming, key=order)]


def _with_imports(path: Path) -> str:
    """A file of tests with the cases that it imports."""
    text = path.read_text(encoding="utf-8")
    cases = {path.with_name(f"{name}.py") for name in re.findall(r"\b(\w+_cases)\b", text)}
    return text + "".join(p.read_text(encoding="utf-8") for p in sorted(cases) if p.is_file())


def failure(tree: Tree, tests: Iterable[str]) -> str:
    """The first of these tests that fails, or how they ended; "" if all pass."""
    output = tree.build / "output.txt"
    pid = os.fork()
    if pid == 0:
        _run(tree, list(tests), output)
    _, status = os.waitpid(pid, 0)
    if status == 0:
        return ""
    if os.WIFSIGNALED(status):
        return f"{next(iter(tests))}: signal {os.WTERMSIG(status)}"
    text = output.read_text(errors="replace")
    if found := re.search(r"^(?:FAILED|ERROR) (\S+)", text, re.MULTILINE):
        return found[1]
    raise RuntimeError(f"{' '.join(tests)}: pytest ends with {os.WEXITSTATUS(status)}\n{text}")


def _run(tree: Tree, tests: list[str], output: Path) -> None:
    """Be the process that runs the tests."""
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.environ["SERVICING_FMUS_BUILD"] = str(tree.build)
    os.chdir(tree.root)
    sys.path[:] = [p for p in sys.path if Path(p or ".").resolve() != ROOT]
    for name in [name for name in sys.modules if name.split(".")[0] == "tests"]:
        del sys.modules[name]
    with output.open("wb") as file:
        for number in (1, 2):
            os.dup2(file.fileno(), number)
    options = ["-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--tb=no", "-rfE"]
    options += ["--assert=plain"]
    status = 99
    try:
        status = int(pytest.main([*options, *tests], [_QuickestFirst(tree.root / "seconds.json")]))
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(status)


class _QuickestFirst:
    """One case of every test first, and the quickest first as far as earlier faults have shown."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.seconds = json.loads(file.read_text()) if file.is_file() else {}

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        cases: Counter[str] = Counter()
        order = {}
        for item in items:
            name = item.nodeid.partition("[")[0]
            order[item] = (cases[name] > 0, self.seconds.get(item.nodeid, 0.02))
            cases[name] += 1
        items.sort(key=order.__getitem__)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.when == "call":
            self.seconds[report.nodeid] = report.duration

    def pytest_sessionfinish(self) -> None:
        self.file.write_text(json.dumps(self.seconds))
