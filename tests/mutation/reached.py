# SPDX-License-Identifier: BSD-2-Clause
"""Which tests reach which line of the Python code: recorded once, asked for every deliberate fault.

    .venv/bin/python -m tests.mutation.reached -n 2 --cases 3 tests/harness

Everything is measured by coverage.py, each line under the test that runs or the fixture that is
being made; processes that a test starts inherit its name as PYTEST_CURRENT_TEST. The files stand
in build/faults. As a plugin of pytest this module names the tests and takes their times.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import coverage
import pytest

ROOT = Path(__file__).resolve().parents[2]
PLACE = ROOT / "build/faults"
DATA, SECONDS = PLACE / "reached", PLACE / "seconds.json"
SETTINGS = """[run]
source = {root}/harness
data_file = {data}
parallel = true
patch = _exit
context = ${{PYTEST_CURRENT_TEST-}}
disable_warnings = no-data-collected, module-not-measured, module-not-imported, couldnt-parse
"""
FIXTURE = "fixture "


def main() -> None:
    """Run tests, measured; see the docstring of the module."""
    PLACE.mkdir(parents=True, exist_ok=True)
    settings = PLACE / "settings.ini"
    settings.write_text(SETTINGS.format(root=ROOT, data=DATA), encoding="utf-8")
    os.environ["COVERAGE_PROCESS_START"] = str(settings)
    command = [sys.executable, "-m", "pytest", "-p", "tests.mutation.reached"]
    os.execv(sys.executable, [*command, "-p", "no:cacheprovider", *sys.argv[1:]])


# ---- plugin


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--cases", type=int, help="of every test, so many; none measured before")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if most := config.getoption("--cases"):
        known = json.loads(SECONDS.read_text()) if SECONDS.is_file() else {}
        cases = Counter(name.partition("[")[0] for name in known)
        for item in list(items):
            name = item.nodeid.partition("[")[0]
            cases[name] += item.nodeid not in known
            if item.nodeid in known or cases[name] > most:
                items.remove(item)


def _measured_as(name: str) -> None:
    if measured := coverage.Coverage.current():
        measured.switch_context(name)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    _measured_as(item.nodeid)
    try:
        return (yield)
    finally:
        _measured_as("")


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: Any, request: Any) -> Iterator[None]:
    """What a fixture of a whole file reaches, each test reaches that asks for it."""
    if fixturedef.scope == "function":
        return (yield)
    _measured_as(FIXTURE + fixturedef.argname)
    try:
        return (yield)
    finally:
        _measured_as(request._pyfuncitem.nodeid)


_TIMES: dict[str, float] = defaultdict(float)


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    _TIMES[report.nodeid] += report.duration


def pytest_sessionfinish(session: pytest.Session) -> None:
    if not hasattr(session.config, "workerinput"):
        known = json.loads(SECONDS.read_text()) if SECONDS.is_file() else {}
        SECONDS.write_text(json.dumps(known | _TIMES))


# ---- answers


class Reached:
    """Tests and fixtures by file and line."""

    def __init__(self) -> None:
        gathered = coverage.Coverage(data_file=str(DATA))
        if list(PLACE.glob("reached.*")):
            gathered.combine([str(PLACE)])
        gathered.load()
        self.data = gathered.get_data()
        self.seconds: dict[str, float] = json.loads(SECONDS.read_text())

    def by(self, file: str, lines: range) -> set[str]:
        """Names of tests, and of fixtures behind `fixture `, that reach one of the lines; for lines
        that are run while the module is read, those that reach any line of the file.
        """
        contexts = self.data.contexts_by_lineno(str(ROOT / "harness" / file))
        found = _tests(c for line in lines for c in contexts.get(line, ()))
        return found or _tests(c for some in contexts.values() for c in some)


def _tests(contexts: Iterable[str]) -> set[str]:
    """What contexts name: `test (call)` of a process that it has started, `test`, or both with a
    bar between them.
    """
    names = (re.sub(r" \((setup|call|teardown)\)$", "", c.rpartition("|")[2]) for c in contexts)
    return set(names) - {""}


if __name__ == "__main__":
    main()
