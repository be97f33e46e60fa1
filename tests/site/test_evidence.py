# SPDX-License-Identifier: BSD-2-Clause
"""make evidence: counters of several libraries joined, reasons that hold both ways, rows that are
not older than their sources.
"""

from __future__ import annotations

import importlib
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.each import each

ROOT = Path(__file__).resolve().parents[2]
LINES = ["int f(int a, int b)", "{", "    if (a && b) return 1;", "    return 0;", "}"]
SOURCE = "\n".join(LINES) + "\n"


@pytest.fixture(scope="module")
def tools():
    """The modules of .ci."""
    sys.path.insert(0, str(ROOT / ".ci"))
    yield importlib.import_module("structure"), importlib.import_module("evidence")
    sys.path.remove(str(ROOT / ".ci"))


def export(path, whole, one, a, b, shown):
    """Counters of SOURCE as llvm-cov writes them."""
    regions = [[2, 1, 5, 2, whole, 0, 0, 0], [3, 17, 3, 25, one, 0, 0, 0], [3, 9, 3, 9, 0, 0, 0, 0]]
    branches = [[3, 9, 3, 10, *a, 0, 0, 4], [3, 14, 3, 15, *b, 0, 0, 4]]
    decision = [3, 9, 3, 15, 0, 5, list(shown)]
    return {
        "functions": [{"filenames": [str(path)], "regions": regions}],
        "files": [{"filename": str(path), "branches": branches, "mcdc_records": [decision]}],
    }


def test_what_one_library_reaches_is_reached(tools, tmp_path):
    structure, _ = tools
    first = export(tmp_path / "f.c", 2, 0, (1, 1), (0, 1), (False, False))
    second = export(tmp_path / "f.c", 1, 1, (1, 0), (1, 0), (False, True))
    other = export(Path("/elsewhere/f.c"), 0, 0, (0, 0), (0, 0), (False, False))
    found = structure.counters([first, second, other], tmp_path)
    assert found["f.c"].reached() == ((2, 2), (4, 4), (1, 2))
    (missing,) = structure.missing("f.c", found["f.c"], LINES)
    assert missing == ("f.c", "if (a && b) return 1;", ("not shown: condition 1 of a && b",))


def test_a_reason_is_an_error_where_the_tests_reach_its_line(tools, tmp_path):
    structure, _ = tools
    found = structure.counters([export(tmp_path / "f.c", 1, 0, (1, 0), (0, 1), (0, 0))], tmp_path)
    absent = list(structure.missing("f.c", found["f.c"], LINES))
    assert absent[0].what[:3] == ("not run: return 1", "never false: a", "never true: b")
    known = {absent[0]: "why"}
    assert list(structure.differences(absent, known)) == []
    assert "never true: b" in next(structure.differences(absent, {}))
    assert "does not match what the tests reach" in next(structure.differences([], known))


@pytest.mark.skipif(not shutil.which("clang-19"), reason="needs clang-19")
@pytest.mark.parametrize(("calls", "shown"), [("f(1, 1) + f(1, 0)", [0, 1]), ("f(0, 1)", [0, 0])])
def test_counters_of_clang_are_read(tools, tmp_path, calls, shown):
    structure, _ = tools
    (tmp_path / "f.c").write_text(SOURCE + f"int main(void) {{ return ({calls}) > 9; }}\n")
    counting = ["-fprofile-instr-generate", "-fcoverage-mapping", "-fcoverage-mcdc"]
    program, profile = tmp_path / "f", tmp_path / "f.profdata"
    subprocess.run(["clang-19", *counting, tmp_path / "f.c", "-o", program], check=True)
    raw = tmp_path / "f.profraw"
    subprocess.run([program], env={"LLVM_PROFILE_FILE": str(raw)}, check=True)
    subprocess.run(["llvm-profdata-19", "merge", raw, "-o", profile], check=True)
    found = structure.counters([structure.exported(program, profile)], tmp_path)["f.c"]
    assert list(found.decisions.values()) == [tuple(map(bool, shown))]


@pytest.mark.long
def test_every_reason_names_a_line_of_a_file(tools):
    structure, _ = tools
    for missing, reason in structure.reasons().items():
        assert reason and missing.what
        lines = (ROOT / "fmus" / missing.file).read_text().splitlines()
        assert missing.line in [line.strip() for line in lines], missing


@pytest.mark.long
def test_no_row_is_older_than_its_sources(tools):
    """Repeat `make evidence` after an edit of flight software."""
    _, evidence = tools
    page = (ROOT / "docs/evidence_figures.md").read_text()
    rows = dict(re.findall(r"^\| `(\w+)` \|.*\| ([0-9a-f]{12}) \|$", page, re.MULTILINE))
    sources = evidence.flight_rules.sources()
    assert rows == {source.stem: evidence.hash_of(source) for source in sources}


MODEL = """#include "fmu.h"
#define ROW(x) {x, "text"}
static double f(double a) { return a - 2 * 1e-3; } /* remark */
static const char *text = "one" "two";
"""


@each(
    ("old", "new", "same"),
    [
        ("/* remark */", "// another\n", True),
        ('"one" "two"', '"other"', True),
        ('{x, "text"}', '\\\n    {            \\\n  x, "line"   }', True),
        ("f(double a) {", "f(\n    double a)\n{", True),
        ("a - 2", "a + 2", False),
        ("a - 2", "a -- 2", False),
        ("1e-3", "1e-4", False),
        ("ROW(x)", "ROW (x)", False),
        ('"fmu.h"\n', '"fmu.h"\n#define a 3\n', False),
        ('"one" "two"', "0", False),
    ],
)
def test_a_hash_changes_with_the_code_and_not_with_texts_or_layout(tools, tmp_path, old, new, same):
    _, evidence = tools
    assert old in MODEL
    tokens = []
    for text in (MODEL, MODEL.replace(old, new)):
        (tmp_path / "model.c").write_text(text)
        tokens.append(evidence.flight_rules.bare(tmp_path / "model.c"))
    assert (tokens[0] == tokens[1]) == same


def test_tests_of_equal_bits_exist():
    """Those that docs/evidence.md names."""
    section = (ROOT / "docs/evidence.md").read_text().partition("## Equal bits")[2]
    named = re.findall(r"`(tests/[\w/]+\.py)(?:::(\w+))?`", section)
    assert len(named) >= 6
    for file, test in named:
        assert f"def {test}(" in (ROOT / file).read_text() if test else (ROOT / file).is_file()


def test_faults_and_random_inputs_of_other_code_are_reported(tools):
    _, evidence = tools
    good = evidence.Row("a", (), (), (), None, "1", (), 1, ({"sources": "1"},), {"sources": "1"})
    assert list(evidence.older(good)) == []
    (fault,) = evidence.older(good._replace(faults=({"sources": "2"},)))
    assert "make faults" in fault
    (absent,) = evidence.older(good._replace(fuzz=None))
    assert "make fuzz" in absent
