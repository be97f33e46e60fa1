# SPDX-License-Identifier: BSD-2-Clause
"""Which tests reach which line of the Python code: recorded once, looked up for every deliberate
fault.

    .venv/bin/python -m tests.mutation.reached -n 2 --cases 3 tests/harness

Everything is measured by coverage.py, each line under the test that runs or the fixture that is
being made; processes that a test starts inherit its name as PYTEST_CURRENT_TEST. The files are in
build/faults, or in the folder that the environment variable REACHED names. As a plugin of pytest
this module names the tests and takes what they cost.
"""

from __future__ import annotations

import fcntl
import json
import os
import re
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import coverage
import pytest

ROOT = Path(__file__).resolve().parents[2]
PLACE = Path(os.environ.get("REACHED", ROOT / "build/faults"))
DATA, COSTS = PLACE / "reached", PLACE / "costs.json"
SETTINGS = """[run]
source =
    {root}/fmus
    {root}/harness
    {root}/ssp
data_file = {data}
parallel = true
patch = _exit
context = ${{PYTEST_CURRENT_TEST-}}
disable_warnings = no-data-collected, module-not-measured, module-not-imported, couldnt-parse
"""
FIXTURE = "fixture "


def main() -> None:
    """Run tests, measured; see the docstring of the module."""
    os.environ |= settings(ROOT, PLACE)
    os.execv(sys.executable, [*COMMAND, *sys.argv[1:]])


COMMAND = (
    sys.executable, "-m", "pytest", "-p", "tests.mutation.reached", "-p", "no:cacheprovider",
)  # fmt: skip


def settings(root: Path, place: Path) -> dict[str, str]:
    """Return the environment in which COMMAND measures the sources below a folder, and prepare the
    folder of its files.
    """
    place.mkdir(parents=True, exist_ok=True)
    file = place / "settings.ini"
    file.write_text(SETTINGS.format(root=root, data=place / DATA.name), encoding="utf-8")
    return {"COVERAGE_PROCESS_START": str(file), "REACHED": str(place)}


# ---- plugin


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--cases", type=int, help="of every test, so many; none measured before")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if most := config.getoption("--cases"):
        known = _known()["tests"]
        cases = Counter(name.partition("[")[0] for name in known)
        for item in list(items):
            name = item.nodeid.partition("[")[0]
            cases[name] += item.nodeid not in known
            if item.nodeid in known or cases[name] > most:
                items.remove(item)


def _measured_as(name: str) -> None:
    if measured := coverage.Coverage.current():
        measured.switch_context(name)


def _spent() -> float:
    """Processor time of this process and of those that it has waited for, and a tenth of the time
    on the clock, in which others may work for it [s].
    """
    return sum(os.times()[:4]) + 0.1 * time.perf_counter()


_MADE: dict[str, float] = {}
"""Fixtures of more than one test that the running test has made, and their costs."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    _MADE.clear()
    item.began = _spent()  # type: ignore[attr-defined]
    _measured_as(item.nodeid)
    try:
        return (yield)
    finally:
        _measured_as("")


@pytest.hookimpl(wrapper=True)
def pytest_fixture_setup(fixturedef: Any, request: Any) -> Iterator[None]:
    """What a fixture of a whole file reaches, each test that uses the fixture reaches."""
    if fixturedef.scope == "function":
        return (yield)
    began, others = _spent(), sum(_MADE.values())
    _measured_as(FIXTURE + _name(fixturedef))
    try:
        return (yield)
    finally:
        _measured_as(request._pyfuncitem.nodeid)
        _MADE[_name(fixturedef)] = _spent() - began - (sum(_MADE.values()) - others)


def _name(fixturedef: Any) -> str:
    return f"{fixturedef.baseid}::{fixturedef.argname}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: Any) -> Iterator[None]:
    """The report of the end states what the test and its fixtures have cost."""
    report = yield
    if call.when == "teardown":
        found = [d for defs in item._fixtureinfo.name2fixturedefs.values() for d in defs[-1:]]
        report.uses = [_name(d) for d in found if d.scope != "function"]
        report.made = dict(_MADE)
        report.cost = _spent() - item.began - sum(_MADE.values())
    return report


_SEEN: dict[str, dict[str, Any]] = {"tests": {}, "fixtures": {}, "uses": {}}
_FAILED: set[str] = set()


def pytest_runtest_logreport(report: Any) -> None:
    if report.failed:
        _FAILED.add(report.nodeid)
    if report.when == "teardown":
        _SEEN["tests"][report.nodeid] = report.cost
        _SEEN["fixtures"].update(report.made)
        _SEEN["uses"][report.nodeid] = report.uses


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Tests that fail without a fault are not used."""
    if hasattr(session.config, "workerinput"):
        return
    for name in _FAILED:
        _SEEN["tests"].pop(name, None)
    known = _known()
    COSTS.write_text(json.dumps({kind: known[kind] | new for kind, new in _SEEN.items()}))


def _known() -> dict[str, dict[str, Any]]:
    return json.loads(COSTS.read_text()) if COSTS.is_file() else {kind: {} for kind in _SEEN}


# ---- answers


class Tests(NamedTuple):
    """Data of the tests: cost of each without fixtures of more than one test, those fixtures, and
    which of them a test uses [s].
    """

    tests: dict[str, float]
    fixtures: dict[str, float]
    uses: dict[str, list[str]]

    def alone(self, name: str) -> float:
        """Cost of a test that runs by itself."""
        return self.tests[name] + sum(self.fixtures.get(f, 0.0) for f in self.uses[name])


class Reached:
    """Tests by file and line, from the files of a folder, which stay if `retain` is set."""

    def __init__(self, place: Path = PLACE, retain: bool = False) -> None:
        gathered = coverage.Coverage(data_file=str(place / DATA.name), config_file=False)
        costs = place / COSTS.name
        with costs.open() as lock:  # what one process puts together, another must not at once
            fcntl.flock(lock, fcntl.LOCK_EX)
            if list(place.glob("reached.*")):
                gathered.combine([str(place)], keep=retain)
        gathered.load()
        self.data = gathered.get_data()
        self.tests = Tests(**json.loads(costs.read_text()))

    def lines(self, file: str) -> dict[int, set[str]]:
        """Return the tests that reach each line of a file, also through a fixture."""
        found = self.data.contexts_by_lineno(file)
        return {line: self._tests(_names(contexts)) for line, contexts in found.items()}

    def by(self, file: str, lines: Iterable[int]) -> set[str]:
        """Names of tests that reach one of the lines, also through a fixture; without lines, or for
        lines that no test has run, those that reach any line of the file.
        """
        contexts = self.data.contexts_by_lineno(str(ROOT / "harness" / file))
        found = _names(c for line in lines for c in contexts.get(line, ()))
        found = found or _names(c for some in contexts.values() for c in some)
        return self._tests(found)

    def _tests(self, names: set[str]) -> set[str]:
        """Return the tests among some names, and those that use a fixture among them."""
        fixtures = {name.removeprefix(FIXTURE) for name in names if name.startswith(FIXTURE)}
        using = {name for name, uses in self.tests.uses.items() if fixtures.intersection(uses)}
        return (names | using) & self.tests.tests.keys()


def _names(contexts: Iterable[str]) -> set[str]:
    """What contexts name: `test (call)` of a process that it has started, `test`, or both with a
    bar between them.
    """
    names = (re.sub(r" \((setup|call|teardown)\)$", "", c.rpartition("|")[2]) for c in contexts)
    return set(names) - {""}


if __name__ == "__main__":
    main()
