# SPDX-License-Identifier: BSD-2-Clause
"""Compile the FMU of a whole system, which fuse.py builds, into a library that computes several
runs at once, each in one lane of vector registers (core/lanes/lanes.h).

Usage: lanes.py SOURCES -o WHOLE.so [--width N] [--cxx COMMAND]

SOURCES is the folder with the C files of the unpacked FMU. They are rewritten by lanes_source.py
and compiled as C++ with a vector (one number per run) in place of every double.
"""

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import build_fmu
from lanes_source import in_lanes, parsed

LANES = build_fmu.CORE / "lanes"
FLAGS = (
    "-std=gnu++20", "-O3", "-fPIC", "-fvisibility=hidden", "-fpermissive", "-w",
    "-fno-exceptions", "-Wno-address-of-temporary",
    *(flag for flag in build_fmu.SAME_BITS if not flag.startswith("-std")),
)  # fmt: skip
TARGET = {
    8: ("-mavx512f", "-mavx512dq", "-mavx512vl", "-mno-fma"),
    4: ("-mavx2", "-mno-fma"),
    2: (),
}
"""Compiler flags of the vector instructions, by number of lanes."""

SYSTEM = """#include "lanes.h"
#undef double
namespace scalar {{
namespace {{
#include "scalar/time_grid.h"
{types}
{tables}}}
}}
using scalar::CLOCK;
#define double lanes::Vector
{steps}
{step}
#undef double
#include "runs.h"
"""
MODEL = """#include "lanes.h"
namespace {{ /* unnamed, because all models have types of the same names */
#include "{model}.c"
}}
extern "C" __attribute__((visibility("default"))) int64_t {model}_splits;
int64_t {model}_splits;
namespace {{
struct Given {{
    const Parameters *p;
    const Input *u;
    State *x;
    Output *y;
    double t, h;
}};
}}
static void step_of(void *given)
{{
    const Given *g = (const Given *)given;
    step(g->p, g->u, g->x, g->y, g->t, g->h);
}}
void {model}_model_step(const void *p, const void *u, void *x, void *y, double t, double h)
{{
    Given all = {{(const Parameters *)p, (const Input *)u, (State *)x, (Output *)y, t, h}};
    lanes::step_in_lanes(step_of, &all, all.x, all.y, &{model}_splits);
    lanes::check_finite(all.x, all.y);
}}
"""
TYPES = re.compile(
    r"^(?:typedef (?:struct|enum)|enum) \{[^{}]*\}(?: (?:Phase|Progress|Snapshot))?;", re.M
)
"""Regular expression for the definitions of the C types that describe the memory of a run. The
library contains only these definitions from the files TYPES_IN, because not every compiler accepts
the functions in these files as C++.
"""
TYPES_IN = ("interface.h", "instance.h", "state.c")
STEP = "void {}_model_step(const void *, const void *, void *, void *, double, double);"


def units(sources: Path) -> dict[str, str]:
    """Return the C++ files of the library as texts, by name of the model ("": code of the whole
    system); sources: the folder of system.c.
    """
    system = (sources / "system.c").read_text(encoding="utf-8")
    part = re.DOTALL | re.MULTILINE
    step = re.search(r"^static void step_system.*?^\}", system, part)
    tables = re.search(r"^enum \{ PARTS.*?(?=^static const (?:Copy|Part) )", system, part)
    assert step and tables  # fused_source.py writes both into every system.c
    models = re.findall(r"^extern Step (\w+)_model_step;", system, part)
    rows = "#define CHECKED_ROWS\n" if " checked[]" in tables[0] else ""
    steps = "\n".join(map(STEP.format, models))
    texts = [(sources / name).read_text(encoding="utf-8") for name in TYPES_IN]
    types = "\n".join(each for text in texts for each in TYPES.findall(text))
    pointer = step[0].replace("= model;", "= (double *)model;")
    found = {model: MODEL.format(model=model) for model in models}
    return found | {
        "": SYSTEM.format(types=types, tables=rows + tables[0], steps=steps, step=pointer)
    }


def build(sources: Path, output: Path, compiler: list[str], width: int, folder: Path) -> None:
    """Write the library with `width` lanes; raise CalledProcessError if the compiler fails.

    sources: folder with the C files of the FMU; folder: an empty folder for intermediate files;
    compiler: words of the command that calls a C++ compiler.
    """
    shutil.copytree(sources, folder / "scalar")
    headers = [parsed(file.read_text(encoding="utf-8")) for file in sources.glob("*.h")]
    for file in sources.glob("*.[ch]"):
        text = in_lanes(file.read_text(encoding="utf-8"), headers)
        (folder / file.name).write_text(text, encoding="utf-8")
    for file in LANES.iterdir():
        shutil.copyfile(file, folder / file.name)
    command = [*compiler, *FLAGS, *TARGET[width], f"-DWIDTH={width}", f"-I{folder}"]

    def compiled(unit: tuple[str, str]) -> Path:
        path = folder / f"lanes_{unit[0]}.cpp"
        path.write_text(unit[1], encoding="utf-8")
        made = path.with_suffix(".o")
        subprocess.run([*command, "-c", path, "-o", made], check=True)
        return made

    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        objects = list(pool.map(compiled, units(sources).items()))
    without = ("-nostdlib++",) if is_clang(compiler) else ()
    subprocess.run([*command, "-shared", *without, *objects, "-o", output, "-lm"], check=True)


def is_clang(compiler: list[str]) -> bool:
    """Return whether a compiler is clang. With clang, the lanes are linked without the C++ standard
    library (-nostdlib++), which they do not use: zig, which contains clang, would otherwise compile
    that library first.
    """
    command = [*compiler, "--version"]
    return b"clang" in subprocess.run(command, check=True, capture_output=True).stdout


def main() -> None:
    """Run the command line that the docstring of this module describes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("sources", type=Path, help="folder with the C files of the unpacked FMU")
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--width", type=int, choices=tuple(TARGET), default=4, help="runs at once")
    parser.add_argument(
        "--cxx", type=shlex.split, default=["g++"], help="compiler with its arguments"
    )
    a = parser.parse_args()
    try:
        with tempfile.TemporaryDirectory() as folder:
            build(a.sources, a.output, a.cxx, a.width, Path(folder))
    except (subprocess.CalledProcessError, OSError) as error:
        sys.exit(f"lanes.py: {error}" if isinstance(error, OSError) else 1)


if __name__ == "__main__":
    main()
