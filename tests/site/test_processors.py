# SPDX-License-Identifier: BSD-2-Clause
"""The numerical tests on other processors: how .ci/processors.py chooses and counts."""

from __future__ import annotations

import platform
import sys
from fnmatch import fnmatch
from pathlib import Path

import pytest

from tests.each import each
from tests.site.scripts import script

ROOT = Path(__file__).resolve().parents[2]
REPORT = """<testsuites><testsuite>
<testcase classname="tests.unit" name="test_a"/>
<testcase classname="tests.unit" name="test_b"><failure message="off">text</failure></testcase>
<testcase classname="tests.unit" name="test_c"><skipped message="no gcc"/></testcase>
<testcase classname="tests.unit" name="test_d"><error message="teardown"/></testcase>
<testcase classname="tests.unit" name="test_e"><properties/></testcase>
</testsuite></testsuites>"""


@pytest.fixture(scope="module")
def driver():
    return script("processors")


@pytest.fixture
def haswell(driver):
    return driver.Outcome(driver.Processor("Haswell"), "Haswell", "X86_V3")


def test_a_report_is_counted(driver, haswell, tmp_path):
    (tmp_path / "a.xml").write_text(REPORT, encoding="utf-8")
    found = driver.counted(haswell, 1, tmp_path / "a.xml")
    assert list(found.failed) == ["tests.unit.test_b", "tests.unit.test_d"]
    assert driver.page([haswell, found]).endswith(
        "\n|---|---|---|---|\n"
        "| Haswell | Haswell | X86_V3 | 0 passed, 0 skipped, 0 failed |\n"
        "| Haswell | Haswell | X86_V3 | 2 passed, 1 skipped, 2 failed |\n"
        "\n* Haswell: `tests.unit.test_b`\n* Haswell: `tests.unit.test_d`\n"
    )
    assert driver.page([haswell]).endswith(" 0 failed |\n")


@each("status, text", [(3, None), (5, "<testsuites/>"), (0, "<testsuites/>")])
def test_a_run_without_tests_has_failed(driver, haswell, tmp_path, status, text):
    junit = tmp_path / f"{status}.xml"
    if text:
        junit.write_text(text, encoding="utf-8")
    found = driver.counted(haswell, status, junit)
    assert list(found.failed) == [f"pytest ended with status {status}"]


def test_an_error_outside_of_the_tests_is_a_failure(driver, haswell, tmp_path):
    passed = "<testsuite><testcase classname='a' name='b'/></testsuite>"
    (tmp_path / "a.xml").write_text(passed, encoding="utf-8")
    assert driver.counted(haswell, 0, tmp_path / "a.xml").failed == []
    found = driver.counted(haswell, 3, tmp_path / "a.xml")
    assert found.failed == ["pytest ended with status 3"]


def test_the_same_code_is_not_run_twice(driver, haswell, monkeypatch):
    monkeypatch.setattr(driver.Processor, "code", lambda self: ("Haswell", "X86_V3"))
    monkeypatch.setattr(driver.subprocess, "run", lambda *command, **options: pytest.fail("ran"))
    found = driver.run(driver.Processor("Zen"), [haswell])
    assert str(found) == "| Zen | Haswell | X86_V3 | same code as Haswell |"
    different = [{"variables": {"GLIBC_TUNABLES": "x"}}, {"emulated": "Nehalem"}]
    for change in different:
        with pytest.raises(pytest.fail.Exception):
            driver.run(driver.Processor("other", **change), [haswell])


def test_fmus_are_not_compiled_for_instructions_that_are_missing(driver, monkeypatch):
    monkeypatch.setattr(driver, "flags", lambda: {"avx2", "sse2"})
    found = driver.run(driver.Processor("FMUs", level="x86-64-v3"), [])
    assert found.reason == "this machine lacks the instructions"


def test_all_tests_that_are_named_exist(driver):
    for name in (*driver.NUMERICAL, *driver.SLICE):
        path, _, function = name.partition("::")
        assert (driver.ROOT / path).exists(), path
        assert not function or f"def {function}(" in (driver.ROOT / path).read_text("utf-8")
    systems = {path.stem.removeprefix("test_") for path in (ROOT / "tests/systems").glob("test_*")}
    left = {n for n in systems if not any(fnmatch(n, p) for p in driver.PRESENTATION)}
    assert {"transposition", "sync_approach", "space_robot"} < left < systems
    assert all(any(fnmatch(n, p) for n in systems) for p in driver.PRESENTATION)


def test_the_code_of_the_environment_is_in_use(driver):
    if sys.platform != "linux" or platform.machine() != "x86_64":
        pytest.skip("needs Linux on x86-64")
    every = driver.processors()
    assert len({one.name for one in every}) == len(every) == len(driver.KERNELS) + 5
    plain = {**every[1].variables, **every[len(driver.KERNELS)].variables}
    assert driver.Processor("plain", plain).code() == ("Nehalem", "none")
