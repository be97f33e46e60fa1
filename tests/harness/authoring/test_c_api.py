# SPDX-License-Identifier: BSD-2-Clause
"""The C interface without FMI: the bits of the FMU over wandering steps, its rules, its files."""

from __future__ import annotations

import ctypes
import os
import re
import shutil
import subprocess
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from fmus.core.build import flight_rules
from harness import load
from harness.authoring.c_api import write_system
from harness.cli.app import main
from tests.each import each
from tests.fmu.driver import Kind, Unit

COMPILER = os.environ.get("CC", "cc").split()
FLAGS = ["-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno"]
PEDANTIC = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Wstrict-prototypes"]
FLIGHT = [path.stem for path in flight_rules.sources()]
SOME = ["relative_filter", "adaptive_controller"]
"""A long state of a filter with late samples, and a small law."""
STEP = 0.1

pytestmark = pytest.mark.skipif(
    shutil.which(COMPILER[0]) is None or shutil.which("make") is None,
    reason="a C compiler or make is not installed",
)


@pytest.fixture(scope="module", params=[SOME, pytest.param(FLIGHT, marks=pytest.mark.long)],
                ids=["some", "all"])  # fmt: skip
def components(request, tmp_path_factory):
    """Folder with the interface of some components, or of all, and their names."""
    folder = tmp_path_factory.mktemp("c_api")
    assert main(["build", "--c-api", *request.param, str(folder)]) == 0
    return folder, request.param


def shape_of(text):
    return int(np.prod([int(n) for n in re.findall(r"\[(\d+)\]", text)] or [1]))


def structs(folder, name):
    """Members of every struct of a header: {"Input": {"r_TN_N": 3, ...}, ...}"""
    text = re.sub(r"/\*.*?\*/", "", (folder / f"{name}.h").read_text(), flags=re.DOTALL)
    found = {}
    for struct, body in re.findall(rf"typedef struct {name}_(\w+) \{{(.*?)\}}", text, re.DOTALL):
        members = re.findall(r"double (\w+)([\[\d\]]*);", body)
        found[struct] = {member: shape_of(shape) for member, shape in members}
    return found


@cache
def library_of(folder, name):
    """Library of a component, compiled without a warning."""
    library = folder / f"{name}.so"
    command = [*COMPILER, *FLAGS, *PEDANTIC, "-Wdouble-promotion", "-Werror", "-fPIC", "-shared"]
    subprocess.run([*command, folder / f"{name}_api.c", "-o", library, "-lm"], check=True)
    return library


class Compiled:
    """A component as a library: p, u, x, y are arrays with the memory of the structs."""

    def __init__(self, folder, name):
        library = library_of(folder, name)
        self.lib, self.name, self.structs = ctypes.CDLL(str(library)), name, structs(folder, name)
        self.ranges = ranges(folder, name)
        for key, struct in zip("puxy", ("Parameters", "Input", "State", "Output"), strict=True):
            setattr(self, key, np.zeros(sum(self.structs[struct].values())))
        self.scratch = np.zeros(sum(self.structs.get("Scratch", {}).values()))
        getattr(self.lib, f"{name}_time").restype = ctypes.c_double
        self.call("defaults", self.p, self.u)

    def call(self, function, *arguments):
        def passed(x):
            if isinstance(x, np.ndarray):
                return x.ctypes.data_as(ctypes.c_void_p)
            return ctypes.c_double(x) if isinstance(x, float) else x

        return getattr(self.lib, f"{self.name}_{function}")(*map(passed, arguments))

    def init(self, start):
        work = [self.scratch] if self.scratch.size else []
        self.call("init", self.p, self.u, self.x, self.y, start, *work)

    def member(self, struct, values):
        """Views of the members by name, without those that no row names."""
        ends = np.cumsum(list(self.structs[struct].values()))
        parts = np.split(values, ends[:-1])
        named = zip(self.structs[struct], parts, strict=True)
        return {name: part for name, part in named if not name.startswith("reserved")}

    def good(self, results=True):
        inputs = self.call("good", self.u, None, None)
        return bool(inputs and (not results or self.call("good", None, self.x, self.y)))


def ranges(folder, name):
    """Ranges of the inputs by name, from the comments of the header."""
    text = (folder / f"{name}.h").read_text().partition(f"{name}_Parameters;")[2]
    body = " ".join(text.partition(f"{name}_Input;")[0].replace(" * ", " ").split())
    about = r"\[[^]]*\] (>= 0|0 or 1)?(?:;)?"
    before = re.findall(rf"/\* {about}[^/]*?\*/ double (\w+)(?:\[\d+\])*; (?!/\*)", body)
    after = re.findall(rf"double (\w+)(?:\[\d+\])*; /\* {about}", body)
    return {n: limit for limit, n in before} | {n: limit for n, limit in after if limit}


def wandered(rng, start, now, time, limits):
    """Inputs near their start values that wander within their ranges; times are the present time,
    flags change, and so do whole numbers that may be selections.
    """
    found = {}
    for name, first in start.items():
        noise = 1e-2 * (min(np.linalg.norm(first), 1.0) + 0.1) * rng.normal(size=first.size)
        changes = rng.random() < 0.02
        if name.endswith("_time"):
            found[name] = np.full_like(first, time)
        elif limits.get(name) == "0 or 1":
            found[name] = 1 - now[name] if changes else now[name]
        elif first.size == 1 and first[0] in (0.0, 1.0):
            found[name] = np.array([float(rng.integers(0, 5))]) if changes else now[name]
        else:
            found[name] = now[name] + noise
            if limits.get(name) == ">= 0":
                found[name] = np.abs(found[name])
    return found


def wander(unit_of, part, steps, rng):
    """Steps the FMU and the interface side by side; after a rejection both begin anew."""
    start = {n: v.copy() for n, v in part.member("Input", part.u).items()}
    accepted = 0
    while accepted < steps:
        for name, view in part.member("Input", part.u).items():
            view[:] = start[name]
        part.init(0.0)
        with unit_of() as unit:
            rows = side_by_side(unit, part, start, steps - accepted, rng)
        assert rows > 0, "the first step is accepted"
        accepted += rows


def equal(unit, part):
    found = unit.outputs()
    ours = part.member("Output", part.y)
    names = {name.replace(".", "_"): name for name in found}
    assert names.keys() == ours.keys()
    return all(np.atleast_1d(found[n]).tobytes() == ours[key].tobytes() for key, n in names.items())


def side_by_side(unit, part, start, steps, rng):
    assert equal(unit, part)
    now = start
    references = {name.replace(".", "_"): r for name, r in unit.kind.references.items()}
    for k in range(steps):
        t = part.call("time", 0.0, float(k), STEP)
        now = wandered(rng, start, now, t, part.ranges)
        for name, view in part.member("Input", part.u).items():
            view[:] = now[name]
        accepted = part.good(results=False)
        if accepted:
            part.call("step", part.p, part.u, part.x, part.y, t, STEP)
            accepted = part.good()
        try:
            for name, value in now.items():
                unit.slave.setReal(references[name], value.tolist())
            unit.slave.doStep(k * STEP, STEP)
        except FMICallException:
            assert not accepted
            return k
        assert accepted, "the FMU accepts the step"
        assert equal(unit, part), f"step {k}"
    return steps


def test_wandering_steps_have_the_bits_of_the_fmu(components, request, tmp_path):
    folder, names = components
    steps = 150 if names is SOME else 3000
    for number, name in enumerate(names):
        part, rng = Compiled(folder, name), np.random.default_rng(number)
        kind = Kind(name, tmp_path / name)

        class Opened(Unit):
            def __enter__(self):
                return self

            def __exit__(self, *_):
                self.close()

        wander(lambda kind=kind: Opened(kind, {}, {}, 0.0), part, steps, rng)


@pytest.fixture(scope="module")
def made(components):
    """Output of `make test`."""
    command = ["make", "-s", "-C", components[0], "test"]
    return subprocess.run(command, capture_output=True, text=True, check=True)


def test_its_own_test_compares_the_reference_vectors(components, made):
    assert made.stdout.count("101 rows, all bits equal") == len(components[1])
    assert "warning" not in made.stderr


def test_a_changed_vector_fails(components, made, tmp_path):
    folder, names = components
    head, _, rest = (folder / f"{names[-1]}_vectors.h").read_text().rpartition("0x1.")
    (tmp_path / f"{names[-1]}_vectors.h").write_text(f"{head}0x1.1{rest}")
    shutil.copy(folder / f"{names[-1]}_test.c", tmp_path)
    built = [tmp_path / f"{names[-1]}_test.c", folder / "libflight.a", "-lm", "-o", tmp_path / "a"]
    subprocess.run([*COMPILER, f"-I{folder}", *built], check=True)
    done = subprocess.run([tmp_path / "a"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, f"{names[-1]}: row 100 differs\n")


def test_sources_are_unedited_and_parameters_come_from_the_sets(components):
    folder, _ = components
    source = folder / "relative_filter.c"
    assert source.read_bytes() == (flight_rules.FMUS / "flight" / source.name).read_bytes()
    tables = (folder / "relative_filter_parameters.c").read_text()
    assert "const relative_filter_Parameters relative_filter_parameters_default = {" in tables
    header = (folder / "relative_filter.h").read_text()
    assert (
        "    double mass_hat; /* [kg] > 0; mass of the servicer as known to the software */"
        in header
    )


def test_rules_come_from_the_rows(components):
    folder, _ = components
    part = Compiled(folder, "relative_filter")
    part.init(0.0)
    assert part.good()
    text = ctypes.create_string_buffer(300)
    part.member("Parameters", part.p)["mass_hat"][:] = -1.0
    assert part.call("check", part.p, text, 300) == 1
    assert text.value == b"mass_hat = -1: must be > 0"
    assert part.call("check", part.p, None, 0) == 1
    part.member("Output", part.y)["pose_nis"][:] = -1.0
    assert not part.call("good", None, None, part.y)
    assert part.call("good", part.u, part.x, None)
    part.x[0] = np.nan
    assert not part.call("good", None, part.x, None)
    part.u[0] = np.inf
    assert not part.call("good", part.u, None, None)


def test_time_is_counted_as_the_fmu_counts(components):
    folder, _ = components
    part = Compiled(folder, "adaptive_controller")
    times = [part.call("time", 0.3, float(k), 0.1) for k in range(200)]
    assert times == [0.3, *(0.3 + (k - 1) * 0.1 + 0.1 for k in range(1, 200))]
    assert times != [0.3 + k * 0.1 for k in range(200)]


@pytest.mark.skipif(shutil.which("g++") is None, reason="g++ is not installed")
def test_headers_are_cpp_and_code_rejects_fast_arithmetic(components, tmp_path):
    folder, names = components
    headers = "".join(f'#include "{n}.h"\n#include "{n}_parameters.h"\n' for n in names)
    (tmp_path / "all.cpp").write_text(headers)
    strict = ["-std=c++11", *PEDANTIC[:-1], "-Werror", "-fsyntax-only", f"-I{folder}"]
    subprocess.run(["g++", *strict, tmp_path / "all.cpp"], check=True)
    for flag in ("-ffast-math", "-ffinite-math-only"):
        command = [*COMPILER, "-std=c99", flag, "-fsyntax-only", folder / f"{names[0]}_api.c"]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode and "flight code needs exact arithmetic" in done.stderr


def test_the_loop_of_the_page_runs(components, made, tmp_path):
    """At rest 0.5 m away from the reference: K (e) M = 2e-3 0.5 95 N, and the gravity gradient."""
    folder, _ = components
    page = (flight_rules.FMUS.parent / "docs/how_to/flight_code.md").read_text()
    block = re.search(
        r"(?:^ {8}.*\n|^\n)+", page[page.index("        /* own_loop.c") :], re.MULTILINE
    )
    code, program = block[0].partition("        cc ")[0], tmp_path / "own_loop"
    (tmp_path / "own_loop.c").write_text(code)
    built = [f"-I{folder}", tmp_path / "own_loop.c", folder / "libflight.a", "-lm", "-o", program]
    subprocess.run([*COMPILER, "-std=c99", "-Wall", "-Werror", *built], check=True)
    printed = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    force, mass = map(float, re.findall(r"(-?\d+\.\d+)", printed))
    assert -0.1 < force < -0.09
    assert 95 < mass < 95.1


OF_THE_LIBRARY = {"memcpy", "memset", "snprintf", "strlen", "sqrt"}


def test_only_the_checks_need_a_library(components, made):
    folder, _ = components
    command = ["nm", "--format=posix", "libflight.a"]
    text = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout
    found = [line.split()[:2] for line in text.splitlines() if not line.endswith(":")]
    ours = {name for name, kind in found if kind != "U"}
    assert {name for name, kind in found if kind == "U"} - ours <= OF_THE_LIBRARY


def test_the_vectors_of_a_system_begin_at_its_start(tmp_path):
    with load("ppc_tracking") as system:
        times = replace(system.experiment, start=5.0, stop=6.0)
        write_system(replace(system, experiment=times), tmp_path)
    vectors = (tmp_path / "ppc_controller_vectors.h").read_text()
    found = [
        float.fromhex(text) for text in re.findall(r"^    \{(0x[^,]+),", vectors, re.MULTILINE)
    ]
    assert found[:2] == [5.0, 5.0]
    assert found[1:] == pytest.approx(5 + 0.05 * np.arange(20), abs=1e-12)
    subprocess.run(["make", "-s", "-C", tmp_path, "test"], check=True)


@pytest.mark.long
def test_a_system_writes_its_flight_software_with_one_set(tmp_path):
    assert main(["export", "ppc_tracking", "--c", str(tmp_path), "--params", "manoeuvre"]) == 0
    assert {path.name for path in tmp_path.glob("*_api.c")} == {
        "los_guidance_api.c", "ppc_controller_api.c", "safety_monitor_api.c"}  # fmt: skip
    assert "_parameters_manoeuvre;" in (tmp_path / "los_guidance_parameters.h").read_text()
    subprocess.run(["make", "-s", "-C", tmp_path, "test"], check=True)


@each(("arguments", "message"), [
    (["build", "--c-api", "relative_filter"], "expected `harness build --c-api FMU... DIR`"),
    (["build", "--c-api", "relative_filte", "out"], "close: relative_filter"),
    (["build", "a", "b"], "expected one NAME_OR_FILE"),
    (["export", "space_robot", "--c", "out", "--fmi", "2"], "--c: is mutually exclusive"),
])  # fmt: skip
def test_what_is_missing_is_named(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    assert message in capsys.readouterr().err
