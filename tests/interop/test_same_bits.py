# SPDX-License-Identifier: BSD-2-Clause
"""Whole systems give the same bits with other optimisation, compilers, C libraries and processors:
the models call nothing whose last bits are not specified.
"""

import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from harness import load
from tests.bench.monolith import Monolith

pytestmark = pytest.mark.interop

HERE = Path(__file__).parent
FMUS = HERE.parents[1] / "fmus"
FOLDERS = [FMUS / "core" / name for name in ("adapter", "maths", "models", "ports", "physics")]
FLAGS = ["-std=c99", "-ffp-contract=off", "-fno-tree-slp-vectorize", "-fno-math-errno"]
ZIG = [sys.executable, "-m", "ziglang", "cc", "-O2", "-target"]
WINE = shutil.which("wine64") or "wine"
PLATFORMS = {
    "gcc -O0": (["gcc", "-O0"], []),
    "gcc -O3 with all instructions": (["gcc", "-O3", "-march=native"], []),
    "clang": (["clang", "-O2"], []),
    "musl": (["musl-gcc", "-O2", "-static"], []),
    "aarch64": (["aarch64-linux-gnu-gcc", "-O2", "-static"], ["qemu-aarch64"]),
    "aarch64, optimised": (["aarch64-linux-gnu-gcc", "-O3", "-static"], ["qemu-aarch64"]),
    "musl by Zig": ([*ZIG, "x86_64-linux-musl"], []),
    "Windows": ([*ZIG, "x86_64-windows-gnu"], [WINE]),
    "RISC-V": (["riscv64-linux-gnu-gcc", "-O2", "-static"], ["qemu-riscv64"]),
}  # fmt: skip
SYSTEMS = {"sync_approach": 3000, "ppc_tracking": 1500, "transposition": 600, "space_robot": 500}
"""Macro steps: aarch64 is emulated."""


def rows(kind, name, items):
    return f"static const {kind} {name}[] = {{\n" + "".join(f"    {i},\n" for i in items) + "};\n"


def place(part, variable):
    return f"{{{part}, {variable.reference}}}"


def program_inc(monolith, steps):
    """The system as tables of program.c."""
    nodes = list(enumerate(monolith.graph.nodes))
    slots = [place(i, w.variable) for i, n in nodes for w in n.outputs]
    names = [n.interface.model.modelName for _, n in nodes]
    return "".join(
        [
            *(f"extern const ModelInterface {name}_model;\n" for name in sorted(set(names))),
            rows("ModelInterface *const", "parts", (f"&{name}_model" for name in names)),
            rows("Setting", "settings",
                 (f"{{{place(i, v)}, {float(x).hex()}}}" for i, n in nodes for v, x in n.settings)),
            rows("Wire", "wires",
                 (f"{{{slots[w.slot]}, {place(i, w.variable)}}}"
                  for i, n in nodes for w in n.inputs)),
            rows("Place", "outputs", slots),
            f"#define START {monolith.start.hex()}\n#define STEP {monolith.step.hex()}\n",
            f"#define STEPS {steps}L\n",
        ]
    )  # fmt: skip


@pytest.fixture(scope="module", params=SYSTEMS)
def simulated(request, tmp_path_factory):
    """Folder with program.inc, the models, and the last outputs as the harness computes them."""
    folder, steps = tmp_path_factory.mktemp("recording"), SYSTEMS[request.param]
    with load(request.param) as system:
        monolith = Monolith(system)
        (folder / "program.inc").write_text(program_inc(monolith, steps))
        monolith.run(steps)
        models = {node.interface.model.modelName for node in monolith.graph.nodes}
        return folder, sorted(models), monolith.outputs()


def simulate(folder, models, compiler, runner):
    """Return the output of the program."""
    include = [f"-I{path}" for path in (*FOLDERS, FMUS / "flight", folder)]
    objects = []
    for name in models:
        (source,) = FMUS.glob(f"*/{name}.c")
        objects.append(folder / f"{name}.o")
        symbol = f"-DFMU_MODEL_SYMBOL={name}_model"
        subprocess.run(
            [*compiler, *FLAGS, *include, symbol, "-c", source, "-o", objects[-1]], check=True
        )
    program = folder / "program.exe"
    subprocess.run(
        [*compiler, *FLAGS, *include, HERE / "program.c", *objects, "-o", program, "-lm"],
        check=True,
    )
    done = subprocess.run([*runner, program], check=True, capture_output=True, text=True)
    return done.stdout.split()


def missing(compiler, runner):
    """Why a platform cannot be tried, or nothing."""
    if "ziglang" in compiler and importlib.util.find_spec("ziglang") is None:
        return "ziglang is not installed"
    tools = [compiler[0], *runner]
    return ", ".join(f"{t} is not installed" for t in tools if shutil.which(t) is None)


@pytest.fixture(scope="module")
def expected(simulated):
    folder, models, last = simulated
    found = simulate(folder, models, ["cc", "-O2"], [])
    assert [int(text, 16) for text in found[1:]] == np.asarray(last).view(np.uint64).tolist()
    return found


@pytest.mark.parametrize("platform", PLATFORMS)
def test_every_output_of_every_step_has_the_same_bits(platform, simulated, expected):
    compiler, runner = PLATFORMS[platform]
    if reason := missing(compiler, runner):
        pytest.skip(reason)
    folder, models, _ = simulated
    assert simulate(folder, models, compiler, runner) == expected
