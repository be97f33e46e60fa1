# SPDX-License-Identifier: BSD-2-Clause
"""Verdict of the tests on a deliberate fault: a copy of the tree with the fault, the FMUs whose
machine code it changes built anew, and the tests that name them run until one fails.

A fault in the adapter is looked for in four FMUs: the shortest one, two with bounds on inputs, one
of them a switch, and one with angles and alarms. One in the link is looked for by the tests of the
link, over TCP. Tests run in forks of this process, which has read the large libraries already.
"""

from __future__ import annotations

import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import traceback
import zipfile
from collections import Counter
from collections.abc import Iterable, Mapping
from contextlib import suppress
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
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fPIC")
IGNORED = shutil.ignore_patterns("__pycache__")
UNITS = {
    "core_headers": ("tests/unit", "--ignore=tests/unit/test_elementary.py"),
    "elementary": ("tests/unit/test_elementary.py",),
}
"""C files of the unit tests and the tests of each."""
ADAPTER_IN = ("ideal_propulsion", "servicer", "space_robot", "los_guidance")
LINK = {"link": ("link*.c", "client.c", "stream.c", "processor.c"), "board": ("board.c",)}
"""Libraries of the link and their files."""
SECONDS, PATIENCE = 120, 900
"""Processor time, time of the tests of one FMU; a fault that needs more is caught: it never
ends."""
BYTES = 8 << 30

LEFT_OUT = ("test_archive", "test_rebuild", "test_tools", "test_flight_code", "test_fused")
"""Tests of the archive and of its other contents, which do not belong to the faulty source, and of
all sources at once, for any FMU. Tests that use `some_fmu` are left out for the same reason.
"""

CAUGHT, SURVIVED, SAME = "caught", "survived", "same machine code"
ILL, UNREAD = "does not compile", "part of no program here"


class Tree:
    """A copy of what the tests need, with a build folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.root, self.sources, self.build = folder, folder / "fmus", folder / "build"
        for part in ("fmus", "tests"):
            shutil.copytree(ROOT / part, folder / part, ignore=IGNORED)
        (folder / "few/fmus").mkdir(parents=True)
        for part in ("pyproject.toml", "ssp", "docs", "harness", "examples", "LICENSE"):
            (folder / part).symlink_to(ROOT / part)
        shutil.copytree(ROOT / "build/fmus", folder / "good")
        shutil.copytree(ROOT / "build/fmus", self.build / "fmus")
        sources = [p for side in ("plant", "flight") for p in (self.sources / side).glob("*.c")]
        self.models = {path.stem: path for path in sorted(sources)}
        self.adapter = sorted((self.sources / "core/adapter").glob("*.c"))
        self.libraries = {
            name: [p for part in parts for p in sorted((self.sources / "core/link").glob(part))]
            for name, parts in LINK.items()
        }
        link = [path for parts in self.libraries.values() for path in parts]
        units = [folder / f"tests/unit/{unit}.c" for unit in UNITS]
        self.readers = {p: self._reads(p) for p in (*units, *self.adapter, *sources, *link)}
        self.objects = {p: self.compiled(p) for p in self.readers}

    def _compiler(self) -> list[str]:
        headers = [self.sources / "core" / name for name in HEADERS]
        headers += [self.sources / "flight", Path(fmpy.__file__).parent / "c-code"]
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
        seen = "-fvisibility=default" if source.stem == "board" else "-fvisibility=hidden"
        command = [*self._compiler(), seen, "-w", "-c", source, "-o", target]
        made = subprocess.run(command, check=False, capture_output=True)
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
        reported = [source, self.sources / "core/build/describe.c", "-o", describe, "-lm"]
        subprocess.run([*self._compiler(), "-O0", "-w", *reported], check=True)
        new = {f"binaries/{fmpy.platform}/{name}.so": library.read_bytes()}
        file = f"{name}.fmu"
        with zipfile.ZipFile(self.root / "good" / file) as good:
            new["modelDescription.xml"] = _described(describe, good)
            with zipfile.ZipFile(self.build / "fmus" / file, "w") as faulty:
                for entry in good.infolist():
                    faulty.writestr(entry, new.get(entry.filename) or good.read(entry))

    def link(self, name: str) -> None:
        """A library of the link from what was compiled last."""
        parts = map(self.object, self.libraries[name])
        command = ["cc", "-shared", *parts, "-o", self.build / f"{name}.so", "-lm"]
        subprocess.run(command, check=True)

    def restore(self, name: str) -> None:
        """The FMU as it was."""
        shutil.copy(self.root / "good" / f"{name}.fmu", self.build / "fmus")


def _described(describe: Path, archive: zipfile.ZipFile) -> bytes:
    """The description that the model writes; the same version, date and files as before."""
    old = archive.read("modelDescription.xml").decode()
    version = re.search(r'\sversion="([^"]*)"', old)
    date = re.search(r'generationDateAndTime="([^"]*)"', old)
    files = re.findall(r'<File name="([^"]*)"', old)
    words = [found[1] if found else "0" for found in (version, date)]
    return subprocess.run([describe, "2", *words, *files], check=True, capture_output=True).stdout


# ---- tests


def evaluate(tree: Tree, fault: Fault) -> tuple[str, str]:
    """Outcome of a fault, and the test that has caught it, or the FMUs that carry it."""
    file = tree.sources / fault.file
    readers = [path for path, read in tree.readers.items() if file in read]
    if not readers:
        return UNREAD, ""
    source = file.read_text(encoding="utf-8")
    file.write_text(fault.applied(source), encoding="utf-8")
    try:
        return _evaluate(tree, sorted(readers, key=lambda path: _effort(tree, path)))
    finally:
        file.write_text(source, encoding="utf-8")
        for path in readers:
            tree.object(path).write_bytes(tree.objects[path])


def _effort(tree: Tree, source: Path) -> int:
    """The unit tests first, then the link, the adapter, then the FMUs with the fewest tests."""
    if source in tree.adapter:
        return 1
    return len(tests_of(tree, source.stem)) + 2 if source.stem in tree.models else 0


def _evaluate(tree: Tree, readers: list[Path]) -> tuple[str, str]:
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
    if source.stem in UNITS:
        return failure(tree, UNITS[source.stem])
    for library, parts in tree.libraries.items():
        if source in parts:
            return _failure_of_link(tree, library)
    names = ADAPTER_IN if source in tree.adapter else (source.stem,)
    return next(filter(None, (_failure_of(tree, name) for name in names)), "")


def _failure_of_link(tree: Tree, library: str) -> str:
    try:
        tree.link(library)
        return failure(tree, ["tests/link"])
    except subprocess.CalledProcessError as error:
        return f"{library}: build ends with {error.returncode}"
    finally:
        (tree.build / f"{library}.so").unlink(missing_ok=True)


def _failure_of(tree: Tree, name: str) -> str:
    try:
        tree.package(name)
        tests = tests_of(tree, name)
        if tests and (found := failure(tree, tests)):
            return found
        return _failure_of_compliance(tree, name)
    except subprocess.CalledProcessError as error:
        return f"{name}: build ends with {error.returncode}"
    finally:
        tree.restore(name)


def _failure_of_compliance(tree: Tree, name: str) -> str:
    """With few other FMUs, since collecting all tests takes longer than running the tests of
    one.
    """
    few = tree.root / "few"
    for other in {name, *ADAPTER_IN}:
        shutil.copy(tree.build / f"fmus/{other}.fmu", few / "fmus")
    ignored = (f"--ignore=tests/compliance/{part}.py" for part in LEFT_OUT)
    os.environ["SERVICING_FMUS"] = name
    found = failure(tree, ["tests/compliance", *ignored, "-k", "not some_fmu"], few)
    del os.environ["SERVICING_FMUS"]
    (few / f"fmus/{name}.fmu").unlink()
    return found


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


def failure(tree: Tree, tests: Iterable[str], build: Path | None = None) -> str:
    """The first of these tests that fails, or how they ended; "" if all pass."""
    environment = {"SERVICING_FMUS_BUILD": str(build or tree.build)}
    order = _QuickestFirst(tree.root.parent / "seconds.json")
    return failure_in_fork(tree.root, tests, order, PATIENCE, environment)


def failure_in_fork(
    root: Path, tests: Iterable[str], order: object, patience: int, environment: Mapping[str, str]
) -> str:
    """The same with a plugin that orders them, and the time that they have [s]."""
    output = root / "output.txt"
    pid = os.fork()
    if pid == 0:
        os.setsid()
        signal.alarm(patience)
        os.environ.update(environment)
        _run(root, list(tests), output, order)
    _, status = os.waitpid(pid, 0)
    with suppress(ProcessLookupError):  # what a test has started and not ended
        os.killpg(pid, signal.SIGKILL)
    if status == 0 or os.waitstatus_to_exitcode(status) == pytest.ExitCode.NO_TESTS_COLLECTED:
        return ""
    if os.WIFSIGNALED(status):
        return f"{next(iter(tests))}: signal {os.WTERMSIG(status)}"
    text = output.read_text(errors="replace")
    if found := re.search(r"^(?:FAILED|ERROR) (\S+)", text, re.MULTILINE):
        return found[1]
    raise RuntimeError(f"{' '.join(tests)}: pytest ends with {os.WEXITSTATUS(status)}\n{text}")


def _run(root: Path, tests: list[str], output: Path, order: object) -> None:
    """Be the process that runs the tests."""
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.chdir(root)
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
        status = int(pytest.main([*options, *tests], [order]))
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(status)


class _QuickestFirst:
    """One case of every test first, and the quickest first as far as earlier faults have shown, in
    this process or in one beside it.
    """

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
        mine = self.file.with_suffix(f".{os.getpid()}")
        mine.write_text(json.dumps(self.seconds))
        mine.replace(self.file)
