# SPDX-License-Identifier: BSD-2-Clause
"""Models whose C source has a variable outside the state of an instance."""

from __future__ import annotations

import importlib
import re
import shutil
import sys

import numpy as np
import pytest

from harness import HarnessError, build, run
from harness.authoring.new import new_component
from harness.files import paths
from harness.files.archive import pack, read_all
from tests.each import each

CORE = paths.core()
LAST = "static vec3 last;\n\nstatic void control("
SUM = "\n    last = add(last, u->S.v);\n    y->F_cmd_S = add(last, "


@pytest.fixture(scope="module")
def search():
    """core/build/shared_variables.py, which is not part of a package."""
    folder = str(CORE / "build")
    sys.path.insert(0, folder)
    try:
        return importlib.import_module("shared_variables")
    finally:
        sys.path.remove(folder)


def names(search, folder, text):
    """Names of the variables that the search finds in a C file."""
    source = folder / "model.c"
    source.write_text(text, encoding="utf-8")
    found = search.problems(["cc", "-std=c99", f"-I{CORE / 'maths'}"], source)
    return [re.search("`(.*)`", line)[1] for line in found]


@each(
    ("text", "expected"),
    [
        ("static double a;", "a"),
        ("double a = 1, *b, c[3] = {1}, d[2][2];", "a b c d"),
        ('#include "vec3.h"\nstatic vec3 last;', "last"),
        ("static struct { double x; } record = {.x = 1};", "record"),
        ("struct S { double x; } s;", "s"),
        ("enum { A, B } mode;", "mode"),
        ("static const double *at;", "at"),
        ("static void (*law)(double);", "law"),
        ("double f(void); static double (*laws[2])(void) = {f, f};", "laws"),
        ("double f(double x) { static double sum = 0; return sum += x; }", "sum"),
        ("int f(int x) { if (x) { for (;;) { static int n, m; n = m; } } return 0; }", "n m"),
        ("static _Thread_local int count;", "count"),
        ("#define SHARED static double\nSHARED sum;", "sum"),
    ],
)
def test_a_changeable_variable_outside_the_state_is_found(search, tmp_path, text, expected):
    assert names(search, tmp_path, text) == expected.split()


@each(
    "text",
    [
        "static const double K[2] = {1, 2};",
        "const double PI = 3.14, E = 2.72;",
        'static const char *const names[] = {"a", "b"};',
        'static const char *names[] = {"a", "b"};',
        "double f(double x) { static const double k = 2; double a = k, b; return b = a * x; }",
        "typedef struct { double x; } S; struct T { int a; }; union U; enum { A, B };",
        "extern double elsewhere; double f(double, int); static void g(double *x);",
        "/* static double a; */ // static double b;\nstatic const char *text = \"static int c;\";",
        "#include <math.h>\n#include <stdio.h>\n#include \"attitude.h\"",
        "struct S { double x; }; struct S f(void) { struct S s = {.x = 1}; return s; }",
        "typedef double (*Law)(double); double f(Law law) { double y = law(1); return y; }",
    ],
)  # fmt: skip
def test_constants_types_and_variables_of_a_call_are_allowed(search, tmp_path, text):
    assert names(search, tmp_path, text) == []


def test_no_model_of_the_project_has_such_a_variable(search):
    include = [f"-I{folder}" for folder in sorted(CORE.iterdir())]
    sources = sorted(CORE.parent.glob("[fp]*/*.c"))
    assert len(sources) > 40
    compiler = ["cc", "-std=c99", *include]
    assert {s.name: found for s in sources if (found := search.problems(compiler, s))} == {}


def test_no_header_of_all_models_has_such_a_variable(search, tmp_path):
    """The search leaves out the headers in core, so copies of them are searched."""
    for folder in ("maths", "models", "ports", "physics"):
        shutil.copytree(CORE / folder, tmp_path, dirs_exist_ok=True)
    headers = sorted(path.name for path in tmp_path.glob("*.h"))
    assert len(headers) > 40
    shutil.copy(CORE / "adapter/fmu.h", tmp_path)
    includes = [f'#include "{name}"\n' for name in ("fmu.h", *headers)]
    source = tmp_path / "model.c"
    source.write_text("".join(includes), encoding="utf-8")
    assert search.problems(["cc", "-std=c99", f"-I{tmp_path}"], source) == []


@pytest.fixture(scope="module")
def sources(tmp_path_factory):
    """Source of a controller without, and with a variable outside its state."""
    folder = tmp_path_factory.mktemp("shared")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        new_component("mine")
    clean = folder / "mine" / "mine.c"
    text = clean.read_text(encoding="utf-8")
    text = text.replace("static void control(", LAST, 1)
    text = text.replace("\n    y->F_cmd_S = ", SUM, 1).replace("F_N);", "F_N));", 1)
    shared = folder / "shared.c"
    shared.write_text(text, encoding="utf-8")
    return clean, shared


def test_a_build_names_the_variable_and_the_rule(sources):
    with pytest.raises(HarnessError) as caught:
        build(sources[1])
    assert str(caught.value) == (
        f"{sources[1]} does not build: shared.c: all instances of the FMU would share the variable "
        "`last`, and a reset would not restore it: move it to State, or declare it const"
    )
    assert not sources[1].with_suffix(".fmu").exists()


def test_an_fmu_with_such_sources_is_not_fused(sources, caplog):
    """Results with the executor `fused` would differ, because the variable is shared."""
    fmu = build(sources[0], sources[0].with_name("shared.fmu"))
    files = read_all(fmu)
    files["sources/mine.c"] = sources[1].read_bytes()
    pack(fmu, files)
    results = [
        run("sync_approach", swap={"controller": fmu}, stop=1, executor=executor).values
        for executor in ("c", "fused")
    ]
    assert np.array_equal(*results)
    reason = "shared.fmu: all instances of the FMU would share the variable `last`"
    assert f"runs with the executor c: {reason}" in caplog.text
