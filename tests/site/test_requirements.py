# SPDX-License-Identifier: BSD-2-Clause
"""Requirements of flight software: every id has code and tests, none is left over."""

from __future__ import annotations

import ctypes
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TABLE = "# J\n| id | requirement |\n|---|---|\n| J.1-1 | The manager shall stop. |\n"
CODE = "/* stops */\n/* J.1-1 */\nstatic int stop(int x) /* x: 0 or 1 */\n{\n    return !x;\n}\n"
TEST = 'import pytest\n\n\n@pytest.mark.verifies("J.1-1")\ndef test_it_stops():\n    pass\n'


@pytest.fixture(scope="module")
def tool():
    """The module of .ci."""
    sys.path.insert(0, str(ROOT / ".ci"))
    yield importlib.import_module("requirements")
    sys.path.remove(str(ROOT / ".ci"))


@pytest.fixture
def tree(tmp_path):
    """A tree with one requirement."""
    files = {"ssp/a/equations.md": TABLE, "fmus/flight/manager.c": CODE, "tests/test_a.py": TEST}
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    return tmp_path


def test_every_requirement_has_code_and_a_test_and_the_page_states_them(tool):
    """`make requirements` writes the page after each of the tests has entered its function."""
    found = tool.trace()
    assert list(tool.gaps(found)) == []
    assert tool.page(found) == (ROOT / "docs/evidence_requirements.md").read_text(encoding="utf-8")


def test_every_component_has_requirements(tool):
    found = {path.name for places in tool.code().values() for path, _ in places}
    assert {path.name for path in tool.flight_rules.sources()} <= found


@pytest.mark.parametrize(
    ("file", "missing"),
    [
        ("ssp/a/equations.md", "no requirement has this id"),
        ("fmus/flight/manager.c", "no comment in fmus/ has this id"),
        ("tests/test_a.py", "no test verifies it"),
    ],
)
def test_an_id_that_is_missing_in_one_place_is_reported(tool, tree, file, missing):
    assert list(tool.gaps(tool.trace(tree))) == []
    (tree / file).write_text((tree / file).read_text().replace("J.1-1", "none"))
    assert any(missing in gap for gap in tool.gaps(tool.trace(tree)))


def test_an_id_belongs_to_one_requirement_and_to_a_function(tool, tree):
    (tree / "ssp/a/more.md").write_text(TABLE)
    with pytest.raises(ValueError, match=r"J\.1-1 exists twice"):
        tool.texts(tree)
    (tree / "fmus/flight/manager.c").write_text("/* J.1-1 */\nenum { A, B };\n")
    with pytest.raises(ValueError, match="must be above a function"):
        tool.code(tree)


def test_a_test_that_does_not_enter_the_function_is_reported(tool, tree):
    found, test = tool.trace(tree), "tests/test_a.py::test_it_stops"
    assert list(tool.misses(found, {test: {("manager", "stop")}})) == []
    for other in (("manager", "go"), ("selector", "stop")):
        (miss,) = tool.misses(found, {test: {other}})
        assert miss == f"J.1-1: {test} does not enter stop()"


@pytest.mark.skipif(sys.platform != "linux", reason="needs dladdr of Linux")
def test_calls_belong_to_the_test_that_runs(tool, tmp_path, monkeypatch):
    """A library whose functions call the recorder, used by two tests."""
    monkeypatch.setenv("REACHED_FUNCTIONS", str(tmp_path / "functions.txt"))
    (tmp_path / "recorder.c").write_text(tool.RECORDER)
    source = "static int f(int x) { return x; }\nint g(int x) { return f(x); }\nint h(void)"
    (tmp_path / "a.c").write_text(source + " { return 1; }\n")
    compiler = [*tool.flight_rules.compiler(), "-std=gnu99", "-O0", "-fPIC"]
    make = [*compiler, "-c", "recorder.c", "-o", "recorder.o"]
    subprocess.run(make, cwd=tmp_path, check=True)
    make = [*compiler, "-finstrument-functions", "-shared", "a.c", "recorder.o", "-o", "a.so"]
    subprocess.run(make, cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "a.so"))
    for test, function in (("t.py::one", library.g), ("t.py::two", library.h)):
        monkeypatch.setenv("PYTEST_CURRENT_TEST", f"{test}[case] (call)")
        function(1)
    found = tool.entered(tmp_path / "functions.txt", tmp_path)
    assert found == {"t.py::one": {("a", "f"), ("a", "g")}, "t.py::two": {("a", "h")}}


@pytest.mark.long
def test_every_test_enters_the_function_of_its_requirement(tool, tmp_path):
    found = tool.trace()
    selected = sorted({test for tests in found.tests.values() for test in tests})
    assert list(tool.misses(found, tool.record(tmp_path, selected))) == []
