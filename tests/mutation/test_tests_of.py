# SPDX-License-Identifier: BSD-2-Clause
"""tests_of.py: the map of a small tree, its answers, and what it reports after edits."""

from __future__ import annotations

import os
import shutil

import pytest

from tests.mutation.reached import ROOT
from tests.mutation.tests_of import PLACE, RUN_TIME, Map, _answer, _is_current, _records, record

RATIO = '''"""Ratios."""
import math

LIMIT = 3
# the largest ratio


def ratio(a, b):
    """Return a ratio."""
    if b == 0:
        raise ZeroDivisionError(
            "zero"
        )
    return min(a / b, LIMIT)


def whole(a):
    return math.floor(a)


def unused():
    return 1


class Pair:
    first = whole(1.5)


HALVES = {
    "half": lambda x: x / 2,
    "third": lambda x: x / 3,
}
'''
HEADER = """/* half.h - a factor. */
#define FACTOR 0.5

typedef struct { double x; } Half;
"""
SOURCE = """/* half.c - halves. */
#include "half.h"

double half(double x);
double half(double x)
{
    if (x < 0)
        return 0;
    return FACTOR *
           x;
}
"""
TESTS = {
    "ratio": """import subprocess, sys

import pytest

from fmus.ratio import HALVES, ratio, whole

@pytest.fixture(scope="module")
def three():
    return whole(3.5)

def test_ratio():
    assert ratio(1, 2) == 0.5

def test_zero():
    with pytest.raises(ZeroDivisionError):
        ratio(1, 0)

def test_three(three):
    assert three == 3

def test_half():
    assert HALVES["half"](1) == 0.5

def test_child():
    subprocess.run([sys.executable, "-c", "from fmus.ratio import whole; whole(2.5)"], check=True)

@pytest.mark.parametrize("b", [1, 2])
def test_cases(b):
    assert ratio(b, b) == 1

def test_failing():
    assert whole(1) == 2
""",
    "half": """import ctypes, subprocess

def test_half():
    folder = "build/half"
    command = ["cc", "--coverage", "-fPIC", "-shared", "fmus/half.c", "-o", f"{folder}/half.so"]
    subprocess.run(command, check=True)
    function = ctypes.CDLL(f"{folder}/half.so").half
    function.restype, function.argtypes = ctypes.c_double, [ctypes.c_double]
    assert function(3.0) == 1.5
""",
}


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    """A tree with its map."""
    root = tmp_path_factory.mktemp("tree")
    for folder in ("fmus", "tests", "build/half"):
        (root / folder).mkdir(parents=True)
    (root / "pytest.ini").write_text("[pytest]\n")
    (root / "fmus/__init__.py").touch()
    (root / "fmus/ratio.py").write_text(RATIO)
    (root / "fmus/half.h").write_text(HEADER)
    (root / "fmus/half.c").write_text(SOURCE)
    with_c = shutil.which("cc") and shutil.which("gcov") and os.name == "posix"
    for name in TESTS if with_c else ("ratio",):
        (root / f"tests/test_{name}.py").write_text(TESTS[name])
    with pytest.MonkeyPatch.context() as patch:
        assert recorded(root, patch) == 0
    return root


def recorded(root, patch):
    """Record a tree, whose tests need none of the plugins that take time to import."""
    patch.setenv("PYTHONPATH", str(ROOT))
    patch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    patch.setenv("PYTEST_ADDOPTS", "-p xdist")
    return record(root, (), 2)


@pytest.fixture
def edited(tree, tmp_path):
    """A copy of the tree, which a test may edit."""
    return shutil.copytree(tree, tmp_path / "tree", symlinks=True)


def line_of(text, part):
    return next(n for n, line in enumerate(text.splitlines(), 1) if part in line)


def names(root, file, text, part):
    tests, notes = Map(root).tests_of(file, line_of(text, part))
    assert notes == []
    assert all(cost >= 0 for cost in tests.values())
    return {name.partition("::")[2] or name for name in tests}


REACHED = {
    "if b == 0": {"test_ratio", "test_zero", "test_cases[1]", "test_cases[2]"},
    "return min": {"test_ratio", "test_cases[1]", "test_cases[2]"},
    '"zero"': {"test_zero"},
    "def ratio": {"test_ratio", "test_zero", "test_cases[1]", "test_cases[2]"},
    "LIMIT = 3": {"test_ratio", "test_cases[1]", "test_cases[2]"},
    "import math": {"test_three", "test_child"},
    "return math.floor": {"test_three", "test_child"},
    "return 1": set(),
    "x / 2": {"test_half", "test_child"},
}
"""Tests by a part of a line: in the middle of a statement, in a definition, of a constant, of an
import, through a fixture and another process; a test that fails is not named.
"""


@pytest.mark.parametrize("part", REACHED)
def test_the_tests_that_reach_a_line_of_python_are_named(tree, part):
    assert names(tree, "fmus/ratio.py", RATIO, part) == REACHED[part]


@pytest.mark.parametrize("part", ["if (x < 0)", "FACTOR *", "  x;", "{", "double half(double x);"])
def test_the_files_of_tests_that_reach_a_line_of_c_are_named(tree, part):
    if not (tree / "tests/test_half.py").exists():
        pytest.skip("no gcc with gcov, or not built")
    assert names(tree, "fmus/half.c", SOURCE, part) == {"tests/test_half.py"}
    assert names(tree, "fmus/half.c", SOURCE, "return 0") == set()
    for defined in ("#define", "typedef"):
        assert names(tree, "fmus/half.h", HEADER, defined) == {"tests/test_half.py"}


@pytest.mark.parametrize(
    ("file", "line", "reason"),
    [
        ("fmus/ratio.py", 5, "no code"),
        ("fmus/ratio.py", 9, "no code"),
        ("fmus/ratio.py", 6, "no code"),
        ("fmus/half.c", 1, "no code"),
        ("fmus/ratio.py", 500, "the file has 32 lines"),
        ("fmus/none.py", 1, "no such file"),
        ("tests/test_ratio.py", 1, "Python and C below fmus/, harness/, ssp/ only"),
        ("fmus/x.toml", 1, "Python and C below"),
    ],
)
def test_an_unknown_line_is_reported_in_one_line(tree, file, line, reason):
    with pytest.raises(ValueError, match=reason):
        Map(tree).tests_of(file, line)


def test_lines_are_found_by_their_content_after_an_edit(edited):
    file = edited / "fmus/ratio.py"
    new = RATIO.replace("import math\n", "import math\nimport os\n").replace("a / b", "b / a")
    file.write_text(new)
    known = Map(edited)

    def at(part):
        tests, (note,) = known.tests_of("fmus/ratio.py", line_of(new, part))
        return {name.partition("::")[2] for name in tests}, note

    tests, note = at("if b == 0")
    assert tests == REACHED["if b == 0"]
    assert note.startswith("fmus/ratio.py has changed since the map was made, in which this was")
    tests, note = at("b / a")
    assert tests == REACHED["return min"]
    assert "these are the tests of line 14 then" in note
    tests, note = at("import os")
    assert tests == REACHED["import math"]
    assert "these are the tests of its neighbours then" in note


def test_changed_and_new_files_of_tests_are_named(edited):
    changed = edited / "tests/test_ratio.py"
    changed.write_text(changed.read_text() + "\n")
    (edited / "tests/test_new.py").touch()
    _, notes = Map(edited).tests_of("fmus/ratio.py", line_of(RATIO, "return min"))
    assert notes == [
        "changed since the map was made: tests/test_ratio.py", "not in the map: tests/test_new.py"
    ]  # fmt: skip


@pytest.mark.parametrize("file", ["tests/test_ratio.py", "fmus/ratio.py", "fmus/half.h"])
def test_a_record_is_current_until_a_file_changes_that_it_depends_on(edited, file):
    records = list(_records(edited / PLACE))
    assert all(_is_current(edited, known) for known in records)
    (edited / file).write_text((edited / file).read_text() + "\n")
    left = {known["test"] for known in records if not _is_current(edited, known)}
    assert left <= {"tests/test_ratio.py"}
    assert bool(left) == (file != "fmus/half.h")


@pytest.mark.long
def test_a_second_record_repeats_what_edits_concern(edited, capsys, monkeypatch):
    (edited / "tests/test_half.py").unlink(missing_ok=True)
    assert recorded(edited, monkeypatch) == 0
    assert capsys.readouterr().out == ""
    new = RATIO.replace("return 1", "return whole(1)")
    (edited / "fmus/ratio.py").write_text(new)
    text = TESTS["ratio"].replace("import HALVES", "import unused, HALVES")
    (edited / "tests/test_ratio.py").write_text(text + "\ndef test_new():\n    assert unused()\n")
    assert recorded(edited, monkeypatch) == 0
    assert capsys.readouterr().out.startswith("1/1 tests/test_ratio.py: 8 tests, ")
    assert names(edited, "fmus/ratio.py", new, "return whole(1)") == {"test_new"}


class Unreached:
    """Map in which no test reaches a line."""

    def tests_of(self, file, line):
        return {}, []


def test_code_that_is_compiled_while_tests_run_has_the_tests_that_compile_it(capsys):
    for file, tests in RUN_TIME.items():
        assert (ROOT / file).is_file()
        assert _answer(Unreached(), file, "20") == 0
        assert tuple(capsys.readouterr().out.split()) == tests
        assert all((ROOT / test).is_file() for test in tests)
    assert _answer(Unreached(), "fmus/core/adapter/state.c", "20") == 1
