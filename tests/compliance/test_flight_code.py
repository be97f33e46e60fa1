# SPDX-License-Identifier: BSD-2-Clause
"""Rules of flight code, docs/flight_code.md: calls, stack, loops, floating-point exceptions."""

import ctypes
import os
import re
import shutil
import subprocess

import pytest

from fmus.core.build import flight_rules
from harness import load
from harness.files.paths import systems
from tests.bench.monolith import Monolith
from tests.compiled import CACHE
from tests.each import Each

PAGE = flight_rules.FMUS.parent / "docs/flight_code.md"
SOURCES = flight_rules.sources()
FILES = flight_rules.included()
CALLS_ALLOWED = {"sqrt", "copysign", "memcpy", "memset", "strlen", "snprintf"}
MOST_STACK = 20 * 1024
"""Bytes: of the initialization of theta_d_controller with a margin for other compilers."""
STEPS = 2_000

SOME = [path for path in SOURCES if path.stem in {"theta_d_controller", "safety_monitor"}]
"""The deepest stack and the longest loops; `make flight-rules` and the long tests compile all."""

with_call_graphs = pytest.mark.skipif(
    not flight_rules.has_call_graphs(), reason="gcc with -fcallgraph-info is not installed"
)


@pytest.fixture(params=[SOME, pytest.param(SOURCES, marks=pytest.mark.long)], ids=["some", "all"])
def source(request):
    return Each(request.param, lambda path: path.stem)


@pytest.fixture
def file():
    return Each(FILES, lambda path: path.name)


# ---- calls and stack ----
@with_call_graphs
def test_nothing_is_recursive(source):
    assert not flight_rules.calls(source, "-O0").recursive()


@with_call_graphs
def test_a_step_allocates_nothing_and_calls_no_library_but_for_copies(source):
    calls = flight_rules.calls(source, "-O0")
    below = calls.reached(flight_rules.STEP)
    assert below - set(calls.stack) <= CALLS_ALLOWED


@with_call_graphs
def test_nothing_is_allocated_before_the_run_either(source):
    below = flight_rules.calls(source, "-O0").reached(flight_rules.START)
    assert not below & flight_rules.ALLOCATION


@with_call_graphs
def test_the_stack_is_bounded(source):
    calls = flight_rules.calls(source, "-O2")
    assert not calls.unbounded
    assert max(map(calls.depth, (flight_rules.START, flight_rules.STEP))) <= MOST_STACK


@with_call_graphs
def test_nothing_writable_outlives_a_call(source):
    assert flight_rules.writable(source) == []


@with_call_graphs
def test_bad_code_is_found_out(tmp_path):
    bad = tmp_path / "bad.c"
    bad.write_text(
        "#include <stdlib.h>\nstatic int count;\n"
        "static int again(int n) { return n > 0 ? 1 + again(n - 1) : count++; }\n"
        "typedef int Rule(int);\nstatic int grab(int n) { free(malloc((size_t)n)); return n; }\n"
        "Rule *const rules[] = {grab};\n"
        "int step_model(int n)\n{\n"
        "    char part[n];\n    part[n - 1] = 1;\n    return again(part[n / 2]) + rules[0](n);\n}\n"
    )
    calls = flight_rules.calls(bad, "-O0")
    assert calls.recursive() == {"again"}
    assert {"malloc", "free"} <= calls.reached("step_model")
    assert calls.unbounded == ["step_model"]
    assert flight_rules.writable(bad) == ["count"]


# ---- text ----
def test_every_loop_has_a_bound(file):
    assert [head for _, head in flight_rules.loops(file) if not flight_rules.bound(head)] == []


@pytest.mark.parametrize(
    "head",
    ["while (error > tolerance)", "for (;;)", "while (1)", "for (; x > 0; x = f(x))"],
)
def test_a_loop_without_a_bound_is_found(head, tmp_path):
    path = tmp_path / "a.c"
    path.write_text(f"void f(void)\n{{\n    {head} g();\n}}\n")
    assert [flight_rules.bound(found) for _, found in flight_rules.loops(path)] == [None]


def test_every_bound_matches_a_loop():
    heads = [head for path in FILES for _, head in flight_rules.loops(path)]
    assert {flight_rules.bound(head) for head in heads} == {text for _, text in flight_rules.LOOPS}


def test_control_flow_is_simple(file):
    assert not re.search(r"\b(goto|setjmp|longjmp|float)\b", flight_rules.code(file))


def test_functions_fit_on_a_page(file):
    assert flight_rules.longest_function(file) <= 60


MISTAKEN = ("uninitvar:*/covariance.h", "uninitvar:*/riccati.h")
"""cppcheck assumes that loops over the order of a matrix may not run once."""


@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="cppcheck is not installed")
def test_cppcheck_finds_nothing():
    """What it finds in a file is stored until the file or one of its headers changes."""
    stored = CACHE / "cppcheck"
    stored.mkdir(parents=True, exist_ok=True)
    options = ["--quiet", "--std=c99", "--enable=warning,performance,portability"]
    options.append(f"--cppcheck-build-dir={stored}")
    silent = [f"--suppress={name}" for name in ("missingIncludeSystem", *MISTAKEN)]
    command = ["cppcheck", *options, *silent, "--error-exitcode=1", *flight_rules.INCLUDE]
    done = subprocess.run([*command, *SOURCES], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


# ---- floating-point exceptions ----
EXCEPTIONS = """
#include <fenv.h>
void forget(void) { feclearexcept(FE_ALL_EXCEPT); }
int raised(void) { return fetestexcept(FE_INVALID | FE_DIVBYZERO | FE_OVERFLOW); }
void raise_one(void) { feraiseexcept(FE_DIVBYZERO); }
"""


@pytest.fixture(scope="module")
def exceptions(tmp_path_factory):
    folder = tmp_path_factory.mktemp("exceptions")
    (folder / "exceptions.c").write_text(EXCEPTIONS)
    compiler = os.environ.get("CC", "cc").split()
    subprocess.run(
        [*compiler, "-shared", "-fPIC", "exceptions.c", "-o", "exceptions.so", "-lm"],
        check=True,
        cwd=folder,
    )
    return ctypes.CDLL(str(folder / "exceptions.so"))


def raised_by(exceptions, name, most):
    """Exceptions of a whole system as one C program: initialization, once the inputs have come, and
    macro steps.
    """
    with load(name) as system:
        monolith = Monolith(system)
        steps = round((system.experiment.stop - monolith.start) / monolith.step)
        exceptions.forget()
        monolith.initialize()
        monolith.run(min(steps, most))
        return exceptions.raised()


@pytest.mark.parametrize("name", sorted(systems()))
def test_the_default_runs_raise_no_floating_point_exception(exceptions, name):
    assert raised_by(exceptions, name, STEPS) == 0


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(systems()))
def test_whole_runs_raise_no_floating_point_exception(exceptions, name):
    assert raised_by(exceptions, name, 10**9) == 0


def test_an_exception_in_initialization_is_reported(exceptions):
    """The first round has no inputs yet: the line of sight to a target at the origin."""
    with load("sync_approach") as system:
        exceptions.forget()
        Monolith(system)
        assert exceptions.raised()


def test_an_exception_is_reported(exceptions):
    exceptions.forget()
    assert not exceptions.raised()
    exceptions.raise_one()
    assert exceptions.raised()


# ---- the page ----
@pytest.mark.long
@with_call_graphs
def test_the_page_is_what_the_tools_state():
    text = PAGE.read_text()
    if flight_rules.version() not in text:
        pytest.skip(f"docs/flight_code.md is of another compiler than {flight_rules.version()}")
    assert text == flight_rules.page()
