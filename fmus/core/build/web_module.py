# SPDX-License-Identifier: BSD-2-Clause
"""Compile the FMU of a whole system, which fuse.py builds, into a WebAssembly module, with which a
web page simulates the system.

Usage: web_module.py FILE.c... -o WHOLE.wasm [--cc COMMAND]

The C files of the unpacked FMU must be in one folder; core/web/simulation.c replaces the FMI
functions. The results have the same bits as with the FMU.
"""

import argparse
import shlex
import subprocess
import sys
from pathlib import Path

import build_fmu

PAGE = build_fmu.CORE / "web/simulation.c"
TARGET = ("-target", "wasm32-wasi", "-mexec-model=reactor")
FLAGS = (*build_fmu.SAME_BITS, "-O2", "-s", "-g0")
FMI = "fmi2"
"""Beginning of the names of the C files with FMI functions, which are not compiled into the module.
"""


def compile_module(sources: list[Path], output: Path, compiler: list[str]) -> None:
    """Write the module compiled from C files of one folder; compiler: words of the command that
    calls a C compiler. Raises CalledProcessError if the compiler fails.
    """
    names = [path.name for path in sources if not path.name.startswith(FMI)]
    made = [*names, str(PAGE), "-I.", "-o", str(output.resolve()), "-lm"]
    subprocess.run([*compiler, *TARGET, *FLAGS, *made], check=True, cwd=sources[0].parent)


def main() -> None:
    """Run the command line that the docstring of this module describes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("sources", type=Path, nargs="+")
    parser.add_argument("-o", "--output", type=Path, required=True)
    default = [sys.executable, "-m", "ziglang", "cc"]
    parser.add_argument(
        "--cc", type=shlex.split, default=default, help="compiler with its arguments"
    )
    a = parser.parse_args()
    try:
        compile_module(a.sources, a.output, a.cc)
    except (subprocess.CalledProcessError, OSError) as error:
        sys.exit(f"web_module.py: {error}" if isinstance(error, OSError) else 1)


if __name__ == "__main__":
    main()
