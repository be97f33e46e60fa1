# SPDX-License-Identifier: BSD-2-Clause
"""Runs in the lanes of vectors have the bits of runs alone."""

from __future__ import annotations

import ctypes
import importlib
import platform
import re
import shutil
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import harness
from harness.errors import RunError
from harness.files import output, paths
from harness.files.machine import has_avx2, has_avx512
from harness.master import fused, isolated, lanes
from harness.master.changes import apply
from harness.master.fused import LIBRARY, ZIG
from harness.master.lanes import Lanes
from harness.master.simulation import Simulation
from harness.mission.library import systems
from harness.results.files import read
from harness.ssp.library import find_system, load
from harness.studies import reuse
from harness.studies.compare import ComparisonRuns
from harness.studies.reuse import LONG, ReusedSimulation, compiling
from harness.studies.variants import combinations
from harness.system.graph import checked
from harness.system.interface import unpacked_sources
from harness.system.model import System

CORE = paths.core() or Path()

needs_lanes = pytest.mark.skipif(
    lanes.width() == 1, reason="there is no g++, which compiles libraries of lanes"
)


def converter() -> Any:
    """core/build/lanes.py, which is not part of a package."""
    folder = str(CORE / "build")
    sys.path.insert(0, folder)
    try:
        return importlib.import_module("lanes")
    finally:
        sys.path.remove(folder)


# ---- branches ----
MODEL = r"""
#include "fmu.h"
#include <stdbool.h>
#include "vec3.h"

typedef struct { double k; } Parameters;
typedef struct { double x; } Input;
typedef struct { double sum; } State;
typedef struct { double y[16]; } Output;
typedef struct { double a, b[2]; } Three;
typedef struct { double a; int n; } Mixed;

static double early(double x)
{
    if (x < 1) return 10 * x;
    if (x < 2) return 20 + x;
    return sqrt(x);
}
static double searched(double x) /* a loop that ends at different times */
{
    double n = 0;
    while (x < 100) {
        if (x < 3) x = x + 1;
        else x = x * x;
        n++;
    }
    return n + x;
}
static Three three(double x) { return x > 1.5 ? (Three){x, {1, 2}} : (Three){.b = {x}, .a = 7}; }
static Mixed mixed(double x) { return x > 1.5 ? (Mixed){x, 2} : (Mixed){-x, 5}; }
static int number(double x) { return x < 1 ? 3 : x < 2 ? 4 : 5; }
static double chosen(double x)
{
    switch (number(x)) {
    case 3: return 1 / x;
    case 4: return x / 3;
    default: return x - 1;
    }
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    static const double table[] = {0.1, 0.2, 0.3, 0.4};
    const int counts[3] = {[2] = 5, [0] = u->x > 2};
    Three s = three(u->x);
    Mixed m = mixed(u->x);
    if (u->x > p->k) x->sum += u->x;
    else if (u->x < 0.5) x->sum -= 3;
    y->y[0] = early(u->x);
    y->y[1] = searched(u->x);
    y->y[2] = s.a + s.b[0] / 3 + s.b[1];
    y->y[3] = m.a * m.n;
    y->y[4] = chosen(u->x);
    y->y[5] = table[(int)u->x];
    y->y[6] = (u->x > 1 && u->x < 2) || !(u->x < 2.5);
    y->y[7] = sine(u->x) + cosine(1e7 * u->x) * arc_tangent(u->x, 2) + logarithm(u->x);
    y->y[8] = exponential(u->x) - exponential_less_1(-u->x) + larger(u->x, p->k);
    y->y[9] = floor_of(3 * u->x) + nearest_whole(u->x) + copysign(u->x, 1 - u->x);
    y->y[10] = counts[0] + 10 * counts[1] + 100 * counts[2];
    for (double left = u->x; left > 0; left -= h) y->y[11] += left * t;
    const double *pointed = u->x > 1.5 ? &s.a : &m.a;
    y->y[12] = *pointed / 3;
    const bool flag = u->x > 2;
    y->y[13] = flag ? 1 / u->x : u->x * u->x;
    double left = u->x;
    do {
        if (left > 2) left -= 1;
        else left = left / 3;
    } while (left > 0.5);
    y->y[14] = left;
    y->y[15] = 1 / (u->x - 3.1);            /* infinite for one input */
    if (u->x == 2.7) x->sum = NAN;
}
"""
PARTLY = r"""
#include "fmu.h"
#include "vec3.h"

typedef struct { double k; } Parameters;
typedef struct { double x; } Input;
typedef struct { double sum; } State;
typedef struct { double y[16]; } Output;
MODEL_STRUCT;

static int is_outside(const Input *u) { return u->x < 1.5 || u->x > 3; }
static void partly(const Parameters *p, const Input *u, State *x, Output *y) /* its lanes differ */
{
    for (double left = u->x; left > 0.2; left /= 2) x->sum += left / 3;
    if (x->sum > p->k) y->y[0] = x->sum;
    else y->y[2] = u->x;
}
static void count(const Input *u, State *x) { x->sum += u->x; }

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    x->sum = h;
    y->y[0] = -t;
    if (is_outside(u)) partly(p, u, x, y);
    y->y[1] = is_outside(u);
    if (u->x - 1.2) count(u, x);
}
"""
"""Statements for the lanes in which a condition holds."""
INPUTS = (0.25, 1.75, 2.2, 3.1), (1.2, 1.2, 1.2, 1.2), (0.3, 0.3, 2.7, 0.3), (1.2, 1.2, 1.2, 1.2)
ALONE = r"""
#include "model.c"
int main(int count, char **given)
{
    for (int k = 1; k < count; k++) {
        Parameters p = {1.5};
        Input u = {atof(given[k])};
        State x = {0};
        Output y = {{0}};
        step(&p, &u, &x, &y, 3, 0.25);
        printf("%a", x.sum);
        for (int i = 0; i < 16; i++) printf(" %a", y.y[i]);
        puts("");
    }
}
"""
TOGETHER = r"""
#undef double
int main(int count, char **given)
{
    volatile int not_finite = 0;
    for (volatile int first = 1; first < count; first += WIDTH) {
        setjmp(lanes::again); /* a step that was not saved is repeated from here */
        Parameters p = {1.5};
        Input u;
        State x = {0};
        Output y = {};
        for (int i = 0; i < WIDTH; i++) u.x.v[i] = atof(given[first + i]);
        model_model_step(&p, &u, &x, &y, 3.0, 0.25);
        for (int i = 0; i < WIDTH; i++) {
            not_finite += lanes::not_finite >> i & 1;
            printf("%a", x.sum.v[i]);
            for (int k = 0; k < 16; k++) printf(" %a", y.y[k].v[i]);
            puts("");
        }
        lanes::not_finite = 0;
    }
    fprintf(stderr, "%d %d", (int)model_splits, not_finite);
}
"""


ZIG_CXX = (*ZIG, "c++")
EMULATOR = "qemu-aarch64"


def with_compiler(width: int, *command: str, emulator: str = "", long: bool = True) -> Any:
    """Number of lanes, compiler and emulator of a test, which is skipped where one is not there."""
    there = all(map(shutil.which, filter(None, (command[0], emulator))))
    if command[: len(ZIG_CXX)] == ZIG_CXX:
        there = there and find_spec(LIBRARY) is not None
    if not emulator:
        there = there and {2: True, 4: has_avx2(), 8: has_avx512()}[width]
    label = "-".join(Path(word).name for word in command if word not in ("-m", "-target"))
    reason = f"no {label} for {width} lanes"
    when = [pytest.mark.skipif(not there, reason=reason), *[pytest.mark.long] * long]
    return pytest.param(width, command, emulator, marks=when, id=f"{width}-{label}")


COMPILERS = [
    with_compiler(8, "g++", long=False),
    with_compiler(4, "g++", long=False),
    with_compiler(2, "g++", long=False),
    with_compiler(8, "clang++-19"),
    with_compiler(4, "clang++-19"),
    with_compiler(2, "clang++-19"),
    with_compiler(8, *ZIG_CXX),
    with_compiler(4, *ZIG_CXX),
    with_compiler(2, *ZIG_CXX),
]
OTHERS = [
    with_compiler(2, *ZIG_CXX, "-target", "aarch64-linux-musl", emulator=EMULATOR),
    with_compiler(2, "aarch64-linux-gnu-g++", emulator=EMULATOR),
]


@pytest.mark.parametrize(("width", "compiler", "emulator"), COMPILERS + OTHERS)
def test_every_branch_in_which_lanes_differ_has_the_bits_of_c(
    tmp_path: Path, width: int, compiler: tuple[str, ...], emulator: str
) -> None:
    rows, splits, not_finite = in_c_and_in_lanes(tmp_path, MODEL, width, compiler, emulator)
    assert splits >= 3
    assert not_finite == 2  # a state of one run, an output of another
    assert len(set(rows)) == 7  # one result per distinct input


@pytest.mark.parametrize(("width", "compiler", "emulator"), COMPILERS + OTHERS)
def test_a_statement_is_made_for_the_lanes_in_which_its_condition_holds(
    tmp_path: Path, width: int, compiler: tuple[str, ...], emulator: str
) -> None:
    rows, splits, _ = in_c_and_in_lanes(tmp_path, PARTLY, width, compiler, emulator)
    assert splits == 0
    assert len(set(rows)) == 7


@pytest.mark.skipif(not shutil.which("g++"), reason="no g++")
def test_a_function_may_write_through_a_pointer_in_a_struct(tmp_path: Path) -> None:
    """Its statement is not made for some lanes only, because what it writes is not known."""
    model = PARTLY.replace(
        "static int is_outside",
        "typedef struct { State *x; } Holder;\n"
        "static void through(Holder h) { h.x->sum *= 3; }\n"
        "static void behind(const Holder *h) { h->x->sum += 5; }\n"
        "static int is_outside",
    ).replace(
        "    if (is_outside(u)) partly(p, u, x, y);",
        "    const Holder own = {x}, *pointer = &own;\n"
        "    if (is_outside(u)) through(own);\n    if (is_outside(u)) behind(pointer);",
    )
    rows, splits, _ = in_c_and_in_lanes(tmp_path, model, 2, ("g++",), "")
    assert splits > 0
    assert len(set(rows)) == 7


WRITES = r"""
#include "fmu.h"

typedef struct { double k; } Parameters;
typedef struct { double x; } Input;
typedef struct { double sum; } State;
typedef struct { double y[16]; } Output;
typedef double Action(double *);
typedef struct { State *x; } Inner;
typedef struct { Inner inner; } Holder;
typedef struct { Action *act; } Table;
typedef double Pair[2];
#define RAISED(v) ((v) += 2)
#define TWICE(v) (2 * RAISED(v))
#define NEXT x->sum++

static double take(double *n)
{
    *n += 1;
    return 10 * *n;
}
static double behind(const Holder *h)
{
    if (h->inner.x->sum > 2) return 0;
    h->inner.x->sum += 1;
    return h->inner.x->sum;
}
static double local(double a)
{
    double n = a;
    if (a < 2) return take(&n) + n;
    if (a < 2.5) return ++n;
    return n;
}
static double apply(double (*act)(double *), const double *n) { return act((double *)n); }
static double led_to(const double **of, const double *other)
{
    *of = other;
    return **of;
}
static double first(Pair of)
{
    of[0] += 3;
    return of[0];
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    const Holder own = {{x}};
    const Table table = {take};
    Pair both = {u->x, 0};
    const double *pointed = &u->x;
    x->sum = u->x;
    CASE
    y->y[15] = x->sum + both[0] + *pointed;
}
"""
WRITING = {
    "argument": "y->y[0] = u->x > 1.5 ? take(&x->sum) : 5;",
    "other argument": "y->y[0] = u->x > 1.5 ? 5 : 1 + (2 * take(&x->sum));",
    "struct": "y->y[0] = behind(&own);",
    "conditional": "y->y[0] = u->x < 2 ? behind(&own) : 1;",
    "and": "y->y[0] = u->x > 1.5 && take(&x->sum) > 20;",
    "or": "if (u->x < 2 || u->x > 3 || take(&x->sum) > 30) y->y[0] = 1;",
    "macro": "y->y[0] = u->x > 1.5 ? TWICE(x->sum) : 0;",
    "macro without arguments": "y->y[0] = u->x > 1.5 ? NEXT : 0;",
    "assignment": "y->y[0] = u->x > 1.5 ? (x->sum *= 2) : x->sum--;",
    "local": "y->y[0] = local(u->x);",
    "pointer": "Action *act = take; y->y[0] = u->x > 1.5 ? (*act)(&x->sum) : 2;",
    "local pointer": "Action *act = take; y->y[0] = u->x > 1.5 ? act(&x->sum) : 2;",
    "member": "y->y[0] = u->x > 1.5 ? table.act(&x->sum) : 2;",
    "function as argument": "y->y[0] = u->x > 1.5 ? apply(take, &x->sum) : 2;",
    "pointer to pointer": "y->y[0] = u->x > 1.5 ? led_to(&pointed, &p->k) : 2;",
    "array": "y->y[0] = u->x > 1.5 ? first(both) : 2;",
    "copy": "y->y[0] = u->x > 1.5 ? (memcpy(&x->sum, &p->k, sizeof x->sum), 1) : 2;",
}
"""Expressions that write, by what they write through."""


@pytest.mark.skipif(not shutil.which("g++"), reason="no g++")
@pytest.mark.parametrize("case", WRITING)
def test_an_expression_that_writes_is_computed_only_where_c_computes_it(
    tmp_path: Path, case: str
) -> None:
    model = WRITES.replace("CASE", WRITING[case])
    rows, splits, _ = in_c_and_in_lanes(tmp_path, model, 2, ("g++",), "")
    assert splits > 0
    assert len(set(rows)) == 7


def in_c_and_in_lanes(
    tmp_path: Path, model: str, width: int, compiler: tuple[str, ...], emulator: str
) -> tuple[list[str], int, int]:
    """The results of runs of a model, which are equal in C and in lanes, its split steps, and the
    runs whose numbers are not finite.
    """
    tool = converter()
    (tmp_path / "scalar").mkdir()
    headers = [f for folder in tool.build_fmu.HEADERS for f in folder.glob("*.h")]
    for header in headers:
        shutil.copyfile(header, tmp_path / "scalar" / header.name)
        (tmp_path / header.name).write_text(tool.in_lanes(header.read_text()))
    for header in tool.LANES.iterdir():
        shutil.copyfile(header, tmp_path / header.name)
    (tmp_path / "scalar/model.c").write_text(model)
    (tmp_path / "scalar/alone.c").write_text(f"#include <stdlib.h>\n{ALONE}")
    parsed = [tool.parsed(header.read_text()) for header in headers]
    (tmp_path / "model.c").write_text(tool.in_lanes(model, parsed))
    (tmp_path / "together.cpp").write_text(tool.MODEL.format(model="model") + TOGETHER)
    c = [*tool.build_fmu.SAME_BITS, "-O1", "scalar/alone.c"]
    cpp = [*tool.FLAGS, *tool.TARGET[width], f"-DWIDTH={width}", "-O1", "-I."]
    whole = ["-nostdlib++"] * tool.is_clang(list(compiler)) + ["-static"] * bool(emulator)
    for command in (
        ["gcc", *c, "-o", "alone", "-lm"],
        [*compiler, *cpp, "-c", "together.cpp", "-o", "together.o"],
        [*compiler, *whole, "together.o", "-o", "together", "-lm"],
    ):
        subprocess.run(command, check=True, cwd=tmp_path)
    given = [repr(x) for four in INPUTS for x in four]
    alone, together = (
        subprocess.run([*start, *given], check=True, capture_output=True, text=True)
        for start in ([f"{tmp_path}/alone"], [*emulator.split(), f"{tmp_path}/together"])
    )
    assert together.stdout == alone.stdout
    splits, not_finite = map(int, together.stderr.split())
    return alone.stdout.splitlines(), splits, not_finite


# ---- systems ----
def dispersed(system: System, count: int) -> Iterator[System]:
    """The system with other start values of its bodies, and other seeds of its sensors."""
    for k in range(count):
        random = np.random.default_rng(k)
        values: dict[str, float] = {}
        for node in checked(system).graph.nodes:
            for variable, value in node.settings:
                if variable.causality != "parameter" or not isinstance(value, float):
                    continue
                name = f"{node.component.name}.{variable.name}"
                if variable.name == "seed":
                    values[name] = float(random.integers(1, 1000))
                elif value and variable.unit in ("m", "m/s", "kg", "N"):
                    values[name] = value * (1 + 1e-6 * random.uniform(-1, 1))
        yield apply(system, set=values)


def memory(simulation: Simulation) -> bytes:
    """All parameters, inputs, states and outputs of a fused system."""
    (instance,) = simulation.instances
    state, size = instance.save(simulation.time), ctypes.c_size_t()
    instance.calls.call("SerializedFMUstateSize", state, ctypes.byref(size))
    buffer = (ctypes.c_char * size.value)()
    instance.calls.call("SerializeFMUstate", state, buffer, size)
    instance.free(state)
    return bytes(buffer)


TORQUES = {f"robot.M_S[{i}]": {"normal": {"mean": 10.0, "sigma": 5.0}} for i in (2, 3)}

Make = Callable[[Path], Path | None]


def prepared(name: str, life: ExitStack, make: Make | None = None) -> tuple[Lanes, list[System]]:
    """The library of a system, and as many systems as it has lanes."""
    system = life.enter_context(load(find_system(name)))
    fmu = fused.Whole(system, checked(system).graph).interface.path
    path = make(fmu) if make else lanes.library(fmu, wait=True)
    assert path is not None
    found = Lanes(path)
    return found, list(dispersed(system, found.width))


def fused_operations(library: Path) -> list[str]:
    """Multiplications fused with additions in the machine code of a library."""
    code = subprocess.run(["objdump", "-d", library], check=True, capture_output=True, text=True)
    assert "mulpd" in code.stdout or "mulsd" in code.stdout  # the code is there
    return re.findall(r"\t(vfn?m(?:add|sub)\w*)", code.stdout)


needs_objdump = pytest.mark.skipif(
    not (shutil.which("objdump") and platform.machine() in ("x86_64", "AMD64")),
    reason="no objdump for x86-64",
)


@needs_objdump
@pytest.mark.parametrize(("flag", "seen"), [("-ffp-contract=fast", True), ("-mno-fma", False)])
def test_a_fused_multiplication_would_be_seen(tmp_path: Path, flag: str, seen: bool) -> None:
    source = tmp_path / "product.c"
    source.write_text("double f(double a, double b, double c) { return a * b + c * c; }\n")
    flags = ["-O2", "-mavx2", "-mfma", flag, "-shared", "-fPIC"]
    subprocess.run(["gcc", *flags, source, "-o", tmp_path / "product.so"], check=True)
    assert bool(fused_operations(tmp_path / "product.so")) == seen


def libraries(name: str, life: ExitStack, folder: Path) -> list[Path]:
    """The compiled libraries of a system: of single runs, and of lanes."""
    system = life.enter_context(load(find_system(name)))
    fmu = fused.Whole(system, checked(system).graph).interface.path
    with zipfile.ZipFile(fmu) as archive:
        archive.extractall(folder)
    made = lanes.library(fmu, wait=True)
    assert made is not None
    return [*folder.glob("binaries/*/*.so"), made]


@needs_lanes
@needs_objdump
@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=[pytest.mark.long] * (n != "space_robot")) for n in sorted(systems())],
)
def test_no_library_of_a_system_has_a_fused_multiplication(tmp_path: Path, name: str) -> None:
    with ExitStack() as life:
        found = libraries(name, life, tmp_path)
        assert len(found) == 2
        assert list(map(fused_operations, found)) == [[], []]


def compare(name: str, single: int, steps: int, make: Make | None = None) -> None:
    """Compare dispersed runs in lanes with runs alone: every double after each of the first steps,
    and at the end; all rows."""
    with ExitStack() as life:
        found, systems = prepared(name, life, make)
        alone, together = (
            [life.enter_context(Simulation(each, executor="fused")) for each in systems]
            for _ in range(2)
        )
        for each in alone + together:
            each.advance(to=1)
        steps = min(steps, alone[0].steps)
        for to in (*range(2, single), steps):
            assert found.advance(together, to) == [True] * len(systems), f"{name}, step {to}"
            for k, (one, other) in enumerate(zip(alone, together, strict=True)):
                one.advance(to=to)
                assert memory(one) == memory(other), f"{name}: run {k}, step {to}"
        for one, other in zip(alone, together, strict=True):
            assert one.recorder.rows.tobytes() == other.recorder.rows.tobytes()
            assert one.last().tobytes() == other.last().tobytes()
        assert len({memory(each) for each in alone}) == len(systems)


@needs_lanes
def test_runs_in_lanes_have_the_bits_of_runs_alone() -> None:
    compare("space_robot", 20, 500)


@pytest.mark.long
@needs_lanes
@pytest.mark.parametrize("name", sorted(systems()))
def test_every_system_in_lanes_has_the_bits_of_runs_alone(name: str) -> None:
    compare(name, 200, 20_000)


@pytest.mark.long
@pytest.mark.parametrize("name", ["space_robot", "servicing_mission"])
@pytest.mark.parametrize(("width", "compiler", "emulator"), COMPILERS)
def test_every_compiler_and_width_has_the_bits_of_runs_alone(
    tmp_path: Path, width: int, compiler: tuple[str, ...], emulator: str, name: str
) -> None:
    def make(fmu: Path) -> Path:
        sources = unpacked_sources(fmu, tmp_path / "whole")[0].parent
        (tmp_path / "lanes").mkdir()
        converter().build(sources, tmp_path / "l.so", list(compiler), width, tmp_path / "lanes")
        assert not emulator
        return tmp_path / "l.so"

    compare(name, 100, 5000, make)


@needs_lanes
def test_a_run_that_is_rejected_changes_no_other_run() -> None:
    with ExitStack() as life:
        found, systems = prepared("space_robot", life)
        systems[1] = apply(systems[1], set={"robot.M_S[3]": 1e4})  # spins up until t = 13 s
        together, alone = (
            [life.enter_context(Simulation(each, executor="fused")) for each in systems]
            for _ in range(2)
        )
        for each in together + alone:
            each.advance(to=1)
        valid = found.advance(together, 400)
        assert valid == [k != 1 for k in range(found.width)]
        for k, (one, other) in enumerate(zip(alone, together, strict=True)):
            if k == 1:
                with pytest.raises(RunError):
                    one.advance(to=400)
            else:
                one.advance(to=400)
                assert memory(one) == memory(other)


def reused_robot(life: ExitStack, stop: float) -> tuple[ReusedSimulation, list[Any]]:
    """A simulation of the space robot after its first run, with a library, and two runs."""
    prepared("space_robot", life)
    reused = ReusedSimulation(find_system("space_robot"), "fused")
    life.callback(reused.close)
    runs: list[Any] = [{"stop": stop, "set": {"robot.M_S[3]": k}} for k in (1.0, 2.0)]
    reused.run(runs[0])
    return reused, runs


@needs_lanes
def test_an_fmu_of_third_parties_is_never_loaded_into_the_process_of_a_worker(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As after a swap: the runs before it, of our FMUs, have made a simulation and a library."""
    with ExitStack() as life:
        reused, runs = reused_robot(life, 20.0)
        assert None not in reused.together(runs, 1, ["robot.omega_SN_S"])
        monkeypatch.setattr(isolated, "all_ours", lambda system: False)
        monkeypatch.setattr(Simulation, "begin", lambda *_: pytest.fail("loaded here"))
        assert reused.together(runs, 1, ["robot.omega_SN_S"]) == [None, None]
        monkeypatch.setattr(fused, "compiled", lambda *_: pytest.fail("compiled here"))
        with compiling("space_robot", {}, LONG):
            pass


@needs_lanes
def test_lanes_that_wait_for_a_processor_remain_in_use() -> None:
    with ExitStack() as life:
        reused, runs = reused_robot(life, 60.0)
        compiled = reused._lanes()
        assert compiled is not None
        real = compiled._library

        def waiting(*given: Any) -> None:
            time.sleep(0.2)  # many times what the steps take
            real.advance(*given)

        steps = len(reused.run(runs[0]).time) - 1
        reused._alone = 0.1 / steps

        compiled._library = SimpleNamespace(begin=real.begin, advance=waiting, end=real.end)
        reused.together(runs, 1, ["robot.omega_SN_S"])
        assert reused.width == compiled.width > 1


@needs_lanes
def test_the_tables_of_runs_together_are_used_again_while_a_metric_caches_a_result() -> None:
    with ExitStack() as life:
        reused, runs = reused_robot(life, 20.0)
        reused._alone = np.inf  # so short a run may be slower in lanes
        needed = ["robot.omega_SN_S"]
        places: list[set[int]] = []
        cached = []
        for _ in range(2):
            cached += reused.together(runs, 1, needed)
            simulations = reused._simulation, *reused._others
            places.append({s.recorder.table.ctypes.data for s in simulations if s is not None})
        assert None not in cached
        assert places[0] == places[1]


@needs_lanes
def test_long_runs_do_not_fill_the_memory_with_their_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    with ExitStack() as life:
        reused, _ = reused_robot(life, 20.0)
        compiled, simulation = reused._lanes(), reused._simulation
        assert compiled is not None and simulation is not None
        monkeypatch.setattr(reused, "_alone", np.inf)
        assert reused.width == compiled.width
        monkeypatch.setattr(reuse, "ROWS_TOGETHER", 5 * simulation.recorder.table.nbytes)
        assert reused.width == min(compiled.width, 5)
        monkeypatch.setattr(reuse, "ROWS_TOGETHER", 1)
        assert reused.width == min(compiled.width, 4)


@pytest.fixture
def groups(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Numbers of the runs that were made together, whose measured times decide nothing."""
    found: list[int] = []
    monkeypatch.setattr(lanes, "thread_time", lambda: 0.0)
    advance = Lanes.advance

    def counted(self: Lanes, simulations: Any, to: int | None = None) -> list[bool]:
        found.append(len(simulations))
        return advance(self, simulations, to)

    monkeypatch.setattr(Lanes, "advance", counted)
    return found


@needs_lanes
def test_a_campaign_in_lanes_has_the_dataset_of_single_runs(
    tmp_path: Path, groups: list[int]
) -> None:
    with ExitStack() as life:
        prepared("space_robot", life)
    table = {
        "system": "space_robot",
        "executor": "fused",
        "runs": 64,  # in blocks of four
        "fixed": {"stop": 60.0},
        "factors": {"robot.M_S[3]": {"uniform": {"low": 0.0, "high": 20_000.0}}},
        "metrics": {"turned": "max(norm(robot.omega_SN_S))"},
    }
    made = []
    for name in (True, False):
        found = harness.campaign(table, tmp_path / f"{name}.zarr", workers=0, lanes=name)
        made.append({str(key): np.asarray(value) for key, value in found.data.items()})
    together, alone = made
    assert max(groups) > 1
    assert together.keys() == alone.keys()
    assert len(set(alone["status"])) == 2  # some runs fail
    for key, value in alone.items():
        assert together[key].tolist() == value.tolist() or np.array_equal(
            together[key], value, equal_nan=True
        ), key


@needs_lanes
def test_a_comparison_in_lanes_has_the_results_of_single_runs(
    tmp_path: Path, groups: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    with ExitStack() as life:
        prepared("space_robot", life)
        life.callback(reuse.close)
        life.callback(output.work_for, None)
        fixed: Any = {"stop": 10.0}
        varied = "robot.M_S[3]=" + ",".join(map(str, (1.0, 2.0, 3.0, 1e6, 4.0, 5.0)))  # one fails
        variants = combinations(fixed, [("set", varied)])
        variants += combinations({"stop": 5.0}, [("set", "robot.M_S[3]=1,2")])
        outcomes = []
        for folder in (tmp_path / "together", tmp_path / "alone"):
            folder.mkdir()
            work = ComparisonRuns("space_robot", "fused", 60.0, str(folder))
            orders = [(v, folder / f"{k}.nc", 2) for k, v in enumerate(variants)]
            outcomes.append(work.run(orders[:1]) + work.run(orders[1:]))
            monkeypatch.setattr(reuse.ReusedSimulation, "width", 1)
    together, alone = outcomes
    assert groups == {2: [2, 2, 2], 4: [4, 2], 8: [5, 2]}[lanes.width()]
    assert [each.failure for each in together] == [each.failure for each in alone]
    assert sum(bool(each.failure) for each in together) == 1
    for one, other in zip(together, alone, strict=True):
        assert one.file is not None and other.file is not None
        a, b = read(one.file), read(other.file)
        assert a.columns == b.columns and a.values.tobytes() == b.values.tobytes()
        assert a.time.tobytes() == b.time.tobytes()


@needs_lanes
@pytest.mark.parametrize(
    ("kind", "entry"),
    [
        ("worst", {"of": "slow", "runs": 24}),
        ("sensitivity", {"method": "morris", "runs": 12}),
    ],
)
def test_a_study_in_lanes_has_the_dataset_of_single_runs(
    tmp_path: Path, groups: list[int], kind: str, entry: dict[str, Any]
) -> None:
    with ExitStack() as life:
        prepared("space_robot", life)
    table = {
        "system": "space_robot",
        "executor": "fused",
        "fixed": {"stop": 10.0},
        "factors": TORQUES,
        "requirements": {"slow": "norm(robot.omega_SN_S) <= 0.002 rad/s"},
        kind: entry,
    }
    made = []
    for lanes_too in (True, False):
        before = len(groups)
        study = getattr(harness, kind)(
            table, tmp_path / f"{lanes_too}.zarr", workers=0, lanes=lanes_too, notify=len
        )
        assert (len(groups) > before) == lanes_too
        names = ("numbers", "margin", "status")
        made.append([study.store.array(name).tobytes() for name in names])
    assert made[0] == made[1]
    assert max(groups) == lanes.width()
