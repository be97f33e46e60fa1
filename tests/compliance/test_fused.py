# SPDX-License-Identifier: BSD-2-Clause
"""No object holds a fused multiply-add, even if the processor has one: it rounds once where the
models round twice. Looked for in the assembly of the compiler, with the flags of the build.
"""

import importlib.util
import platform
import re
import shutil
import subprocess
import sys
from pathlib import Path

import fmpy
import pytest

from tests.compliance.fmus import ROOT

FMUS = ROOT / "fmus"
sys.path.insert(0, str(FMUS / "core/build"))  # scripts, not a package
import build_fmu  # noqa: E402

SOURCES = sorted(
    [*FMUS.glob("plant/*.c"), *FMUS.glob("flight/*.c"), *FMUS.glob("core/adapter/*.c")]
)
FUSED = re.compile(
    r"^\s+(vfn?m(?:add|sub|addsub|subadd)\w*|f(?:n?m(?:add|sub)|ml[as]|cmla))\s", re.M
)
FOLDERS = [*build_fmu.HEADERS, FMUS / "flight"]
INCLUDE = [f"-I{folder}" for folder in FOLDERS] + [
    "-isystem",
    str(Path(fmpy.__file__).parent / "c-code"),
]
SLP = [FMUS / f"flight/{name}.c" for name in ("transposition_guidance", "relative_filter")]
"""Files in which gcc 12 forms most of them without -fno-tree-slp-vectorize."""

GCC, AARCH64 = shutil.which("gcc"), shutil.which("aarch64-linux-gnu-gcc")
X86 = platform.machine() in ("x86_64", "AMD64")
with_fma = pytest.mark.skipif(not (GCC and X86), reason="no gcc for x86-64")
with_aarch64 = pytest.mark.skipif(not AARCH64, reason="no aarch64-linux-gnu-gcc")
ZIG = [sys.executable, "-m", "ziglang", "cc", "-target"]
with_zig = pytest.mark.skipif(not importlib.util.find_spec("ziglang"), reason="no ziglang")


def fused(tmp_path, compiler, sources, *flags):
    """The fused instructions by source, where there are any."""
    found = {}
    for source in sources:
        assembly = tmp_path / "assembly.s"
        command = [*compiler, *build_fmu.FLAGS, *flags, *INCLUDE, "-S", source, "-o", assembly]
        subprocess.run(command, check=True, capture_output=True)
        if instructions := FUSED.findall(assembly.read_text(encoding="latin-1")):
            found[source.stem] = instructions
    return found


@pytest.mark.parametrize(
    ("compiler", "processor"),
    [
        pytest.param([GCC], ["-mfma"], marks=with_fma, id="gcc"),
        pytest.param([AARCH64], [], marks=with_aarch64, id="gcc-aarch64"),
        pytest.param([*ZIG, "x86_64-linux-gnu"], ["-mcpu=x86_64_v3"], marks=with_zig, id="zig"),
        pytest.param([*ZIG, "aarch64-linux-gnu"], [], marks=with_zig, id="zig-aarch64"),
    ],
)
def test_a_fused_instruction_would_be_seen(tmp_path, compiler, processor):
    source = tmp_path / "product.c"
    source.write_text("double f(double a, double b, double c) { return a * b + c; }\n")
    assert fused(tmp_path, compiler, [source], *processor, "-ffp-contract=fast")
    assert not fused(tmp_path, compiler, [source], *processor)


@with_fma
def test_gcc_forms_none_with_the_flags_of_the_build(tmp_path):
    assert fused(tmp_path, [GCC], SLP, "-march=x86-64-v3") == {}


@pytest.mark.long
@with_fma
@pytest.mark.parametrize("flags", [("-march=x86-64-v3",), ("-O3", "-march=x86-64-v4")])
def test_no_object_of_gcc_holds_one(tmp_path, flags):
    assert fused(tmp_path, [GCC], SOURCES, *flags) == {}


@pytest.mark.long
@with_aarch64
def test_no_object_of_gcc_for_aarch64_holds_one(tmp_path):
    assert fused(tmp_path, [AARCH64], SOURCES) == {}


@pytest.mark.long
@with_zig
@pytest.mark.parametrize(
    ("target", "processor"), [("x86_64-linux-gnu", "x86_64_v3"), ("aarch64-linux-gnu", "generic")]
)
def test_no_object_of_clang_holds_one(tmp_path, target, processor):
    assert fused(tmp_path, [*ZIG, target], SOURCES, f"-mcpu={processor}") == {}


@pytest.mark.parametrize(
    "build",
    [
        "CMakeLists.txt",
        *(f"fmus/core/build/{name}.py" for name in ("build_fmu", "cross_compile", "package_fmi3")),
    ],
)
def test_every_build_has_the_flags(build):
    text = (ROOT / build).read_text(encoding="utf-8")
    assert "-ffp-contract=off" in text
    assert "-fno-tree-slp-vectorize" in re.sub(r'""".*?"""', "", text, flags=re.S)
