# SPDX-License-Identifier: BSD-2-Clause
"""Build one FMU from one C file outside the build of the tree: your own controller, for example.

Usage: build_fmu.py FILE.c [-o FILE.fmu] [--fmi 2|3] [--cc COMMAND]

Does for this platform what add_fmu() of fmus/CMakeLists.txt does: the library from the file and the
adapter, the model description that the model itself writes, and the archive.
"""

import argparse
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

import fmpy

CORE = Path(__file__).resolve().parents[1]
LICENSE = CORE.parents[1] / "LICENSE"
PARTS = ("fmi{}", "fmi{}_state", "fmi{}_unused", "instance", "state")
ADAPTER = {
    fmi: [CORE / "adapter" / f"{part.format(fmi)}.c" for part in PARTS] for fmi in ("2", "3")
}
"""The files of the adapter by version of FMI."""
HEADERS = [CORE / room for room in ("adapter", "maths", "models", "ports", "physics")]
SAME_BITS = ("-std=c99", "-ffp-contract=off", "-fno-tree-slp-vectorize", "-fno-math-errno")
"""The same bits everywhere: gcc 12 forms vfmaddsub in vectors of straight code in spite of the
second flag where -march has it, unless the third is there.
"""
FLAGS = (*SAME_BITS, "-O2", "-fPIC", "-fvisibility=hidden")
RUN_ONCE = ("-O0",)
"""Of a program that says what a model is: it takes longer to optimize than to run."""
DATE = "1980-01-01T00:00:00Z"


def build(source: Path, output: Path, compiler: list[str], fmi: str) -> None:
    """Write the FMU of a version of FMI; subprocess.CalledProcessError if the compiler or the
    description fails, which then has said why.
    """
    include = [f"-I{folder}" for folder in (*HEADERS, Path(fmpy.__file__).parent / "c-code")]
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / f"{output.stem}{fmpy.sharedLibraryExtension}"
        describe, xml = Path(folder) / "describe", Path(folder) / "modelDescription.xml"
        compile_c = [*compiler, *FLAGS, *include, source]
        adapter = ADAPTER[fmi]
        tool = [CORE / "build/describe.c", *RUN_ONCE, "-o", describe, "-lm"]
        subprocess.run([*compile_c, *tool], check=True)
        with xml.open("wb") as file:
            names = [path.name for path in (source, *adapter)]
            subprocess.run([describe, fmi, "0", DATE, *names], check=True, stdout=file)
        subprocess.run([*compile_c, "-shared", *adapter, "-o", library, "-lm"], check=True)
        package = [sys.executable, CORE / "build/package_fmu.py", f"--fmi{fmi}", output, xml]
        files = ["--license", LICENSE, "--binary", f"{fmpy.platform}={library}"]
        sources = ["--source", source, *adapter, "--include", *HEADERS]
        subprocess.run([*package, *files, *sources], check=True)


def main() -> None:
    """Command line, see the docstring of the module."""
    parser = argparse.ArgumentParser()
    parser.add_argument("source", type=Path)
    parser.add_argument("-o", "--output", type=Path, help="default: beside the C file")
    parser.add_argument("--fmi", choices=tuple(ADAPTER), default="2", help="version of FMI")
    parser.add_argument("--cc", type=shlex.split, default=["cc"], help="with its arguments")
    a = parser.parse_args()
    output = a.output or a.source.with_suffix(".fmu")
    try:
        build(a.source, output, a.cc, a.fmi)
    except (subprocess.CalledProcessError, OSError) as error:
        sys.exit(f"build_fmu.py: {error}" if isinstance(error, OSError) else 1)
    print(output)


if __name__ == "__main__":
    main()
