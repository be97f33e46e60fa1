# SPDX-License-Identifier: BSD-2-Clause
"""Run the numerical tests with the code paths that libraries choose on other processors, and write
the page lab/processors.md from the results; the exit status is 1 if any test fails.

python .ci/processors.py lab/processors.md                  # make test-processors
python .ci/processors.py lab/processors.md "kernel Haswell" # one row, printed only
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "build/processors"
KERNELS = ("Prescott", "Nehalem", "Sandybridge", "Haswell", "Zen", "SkylakeX")
"""Values of OPENBLAS_CORETYPE. In the wheels of numpy several of them select the same kernel, for
which run() runs the tests only once.
"""
UNFUSED = "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4"
"""Value of GLIBC_TUNABLES that disables fused multiply-add in the C library: sin, cos, exp, atan2
and pow then differ in their last digits.
"""
LEVELS = {"x86-64": set(), "x86-64-v3": {"avx2", "bmi2", "fma", "movbe"}}
"""Instruction sets that FMUs are compiled for, with the flags of /proc/cpuinfo that they need."""
CALCULATIONS = "exchange fused_system linearize metrics own_start pitch plan requirements studies"
NUMERICAL = (
    *("tests/unit", "tests/fmu", "tests/derivations", "tests/external", "tests/systems"),
    *(
        path.relative_to(ROOT).as_posix()
        for name in (*CALCULATIONS.split(), "study_methods")
        for path in sorted(ROOT.glob(f"tests/harness/**/test_{name}.py"))
    ),
)
PRESENTATION = ("*figure*", "*report*", "*live*", "*browser", "notebooks", "examples", "gallery")
"""Patterns of the names of tests in tests/systems that check pages and pictures, not numbers."""
SLICE = (
    *(f"tests/unit/test_{name}.py" for name in ("attitude", "cholesky", "close", "mat3", "motion")),
    *(f"tests/unit/test_{name}.py" for name in ("riccati", "rigid_body", "vec3")),
    *(f"tests/fmu/test_{name}.py" for name in ("gyro", "orbit_filter", "relay_controller")),
    "tests/systems/test_transposition.py::test_torques_and_inertia_match_the_point_masses",
)
"""Tests for the emulated processor: they start no processes, which would not be emulated."""
PROBE = """
import json, numpy, scipy.linalg, threadpoolctl
from numpy._core._multiarray_umath import __cpu_dispatch__ as known, __cpu_features__ as has
blas = {x["architecture"] for x in threadpoolctl.threadpool_info() if x["user_api"] == "blas"}
print(json.dumps([sorted(blas), [x for x in known if has[x]]]))
"""
HEAD = """# Numerical tests on other processors

OpenBLAS, numpy and the C library each contain several implementations and choose one by the
processor; an implementation that sums in another order has other rounding errors.
`make test-processors` runs the numerical tests with each of these implementations on one machine,
and writes this page from the results.

* kernel: `OPENBLAS_CORETYPE`; several names have the same code in the wheels of numpy.
* numpy without dispatch: `NPY_DISABLE_CPU_FEATURES` disables all code of numpy for features of the
  processor that numpy detects when it is loaded.
* C library without FMA: `GLIBC_TUNABLES` disables the fused sin, cos, exp, atan2, pow.
* FMUs for LEVEL: FMUs and C executor compiled with `-march=LEVEL`, and as always with
  `-ffp-contract=off`.
* emulated: `qemu-x86_64 -cpu Nehalem`, which has no AVX. It takes about thirty times as long, so
  only these tests run: {slice}.

All other rows run {numerical}, without the tests of pages and pictures in `tests/systems`.

| processor | kernels of OpenBLAS | features of numpy | tests |
|---|---|---|---|
"""


class Processor(NamedTuple):
    """Settings with which the tests run as on another processor.

    variables: environment variables of the tests; level: instruction set for which FMUs are
    compiled ("": tests use the FMUs in build/); emulated: processor that qemu-x86_64 emulates
    ("": none).
    """

    name: str
    variables: Mapping[str, str] = {}
    level: str = ""
    emulated: str = ""

    @property
    def interpreter(self) -> list[str]:
        """Command of Python on this processor."""
        emulator = ["qemu-x86_64", "-cpu", self.emulated] if self.emulated else []
        return [*emulator, sys.executable]

    @property
    def environment(self) -> dict[str, str]:
        """Environment of the tests; the linear algebra of each worker uses one thread."""
        build = {"SERVICING_FMUS_BUILD": str(FOLDER / self.level)} if self.level else {}
        return {**os.environ, "OPENBLAS_NUM_THREADS": "1", **self.variables, **build}

    @property
    def tests(self) -> list[str]:
        """Arguments of pytest: the tests to run and the number of worker processes."""
        if self.emulated:
            return [*SLICE, "-n", "0"]
        ignored = [f"--ignore-glob=*/systems/test_{name}.py" for name in PRESENTATION]
        return [*NUMERICAL, *ignored, "-n", "auto", "--dist", "worksteal"]

    def code(self) -> tuple[str, str]:
        """Return the kernels of OpenBLAS and the features of numpy that are in use."""
        command = [*self.interpreter, "-c", PROBE]
        done = subprocess.run(command, env=self.environment, capture_output=True, check=True)
        blas, features = json.loads(done.stdout)
        return ", ".join(blas), " ".join(features) or "none"


class Outcome(NamedTuple):
    """Outcome of the tests on one processor, a row of the page: kernels of OpenBLAS and features of
    numpy in use; numbers of passed and skipped tests and names of failed tests, or the reason why
    no test was run.
    """

    processor: Processor
    blas: str = ""
    features: str = ""
    passed: int = 0
    skipped: int = 0
    failed: Sequence[str] = ()
    reason: str = ""

    def __str__(self) -> str:
        counts = f"{self.passed} passed, {self.skipped} skipped, {len(self.failed)} failed"
        cells = (self.processor.name, self.blas, self.features, self.reason or counts)
        return f"| {' | '.join(cells)} |"

    @property
    def code(self) -> tuple[object, ...]:
        """Everything that determines which instructions compute the results. Processors with
        equal code would give the same results.
        """
        library = self.processor.variables.get("GLIBC_TUNABLES")
        return (self.blas, self.features, library, *self.processor[2:])


def processors() -> list[Processor]:
    """Return the settings of all processors that `make test-processors` runs the tests with."""
    dispatched = Processor("this one").code()[1]
    return [
        *(Processor(f"kernel {name}", {"OPENBLAS_CORETYPE": name}) for name in KERNELS),
        Processor("numpy without dispatch", {"NPY_DISABLE_CPU_FEATURES": dispatched}),
        Processor("C library without FMA", {"GLIBC_TUNABLES": UNFUSED}),
        *(Processor(f"FMUs for {level}", level=level) for level in LEVELS),
        Processor("emulated Nehalem", emulated="Nehalem"),
    ]


def flags() -> set[str]:
    """Return the flags in /proc/cpuinfo, which name the instruction sets of this processor."""
    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    return set(next(line for line in lines if line.startswith("flags")).split())


def build(level: str) -> None:
    """Compile FMUs, systems and the C executor for an instruction set into FOLDER/level."""
    folder = str(FOLDER / level)
    settings = [f"-DCMAKE_C_FLAGS=-march={level}", f"-DPython_EXECUTABLE={sys.executable}"]
    subprocess.run(["cmake", "-G", "Ninja", "-S", str(ROOT), "-B", folder, *settings], check=True)
    subprocess.run(["cmake", "--build", folder], check=True)


def counted(outcome: Outcome, status: int, junit: Path) -> Outcome:
    """Return an outcome with the counts of tests in the report `junit` of pytest. status: exit
    status of pytest; listed as a failure if no test passed, or if not 0 though no test failed.
    """
    cases = ET.parse(junit).getroot().findall(".//testcase") if junit.exists() else []
    failed, skipped, passed = [], 0, 0
    for case in cases:
        if {child.tag for child in case} & {"failure", "error"}:
            failed.append(f"{case.get('classname')}.{case.get('name')}")
        elif case.find("skipped") is not None:
            skipped += 1
        else:
            passed += 1
    if not passed or (status and not failed):
        failed.append(f"pytest ended with status {status}")
    return outcome._replace(passed=passed, skipped=skipped, failed=failed)


def run(processor: Processor, earlier: Sequence[Outcome]) -> Outcome:
    """Run the tests with the settings of a processor and return the outcome. If this machine lacks
    the instructions, or an earlier outcome used the same code, run none and return the reason.
    """
    if not LEVELS.get(processor.level, set()) <= flags():
        return Outcome(processor, reason="this machine lacks the instructions")
    outcome = Outcome(processor, *processor.code())
    for one in earlier:
        if outcome.code == one.code:
            return outcome._replace(reason=f"same code as {one.processor.name}")
    if processor.level:
        build(processor.level)
    junit = FOLDER / f"{processor.name}.xml"
    junit.unlink(missing_ok=True)
    command = [*processor.interpreter, "-m", "pytest", "-q", f"--junitxml={junit}"]
    command += processor.tests
    done = subprocess.run(command, cwd=ROOT, env=processor.environment, check=False)
    return counted(outcome, done.returncode, junit)


def page(outcomes: Sequence[Outcome]) -> str:
    """Return the page: a row per processor, then the names of tests that failed."""
    listed = [", ".join(f"`{name}`" for name in names) for names in (SLICE, NUMERICAL)]
    lines = [HEAD.format(slice=listed[0], numerical=listed[1]) + "\n".join(map(str, outcomes))]
    failed = [f"* {one.processor.name}: `{name}`" for one in outcomes for name in one.failed]
    return "\n".join([*lines, *([""] if failed else []), *failed, ""])


def main(file: str, *names: str) -> int:
    """Run the tests with the settings of the named processors and print the outcomes; without
    names, run them with the settings of all processors and write also the page to `file`. Return 1
    if a test fails, otherwise 0.
    """
    FOLDER.mkdir(parents=True, exist_ok=True)
    outcomes: list[Outcome] = []
    for processor in processors():
        if not names or processor.name in names:
            outcomes.append(run(processor, outcomes))
            print(outcomes[-1], flush=True)
    if not names:
        Path(file).write_text(page(outcomes), encoding="utf-8")
    return 1 if any(one.failed for one in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
