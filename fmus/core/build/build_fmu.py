# SPDX-License-Identifier: BSD-2-Clause
"""Build one FMU from one C file without CMake, for example from a controller of the user.

Usage: build_fmu.py FILE.c [-o FILE.fmu] [--fmi 2|3] [--cc COMMAND] [--adapter FOLDER]
       build_fmu.py --adapter FOLDER [--fmi 2|3] [--cc COMMAND]

The adapter consists of the C files that give every model its FMI functions. The second form
compiles them into a folder; with --adapter the first form links the compiled files.

The steps are the same as in add_fmu() of fmus/CMakeLists.txt, for this platform: compile the
library from the file and the adapter, print the description of the compiled model, and pack both.
"""

import argparse
import shlex
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path

import shared_variables

CORE = Path(__file__).resolve().parents[1]
LICENSE = CORE.parents[1] / "LICENSE"
PARTS = ("fmi{}", "fmi{}_state", "fmi{}_unused", "instance", "state")
ADAPTER = {
    fmi: [CORE / "adapter" / f"{part.format(fmi)}.c" for part in PARTS] for fmi in ("2", "3")
}
"""C files of the adapter, which implement the FMI functions of a model, by version of FMI ("2",
"3").
"""
HEADERS = [CORE / name for name in ("adapter", "maths", "models", "ports", "physics")]
SAME_BITS = ("-std=c99", "-ffp-contract=off", "-fno-tree-slp-vectorize", "-fno-math-errno")
"""Flags with which results have the same bits on every processor. Despite -ffp-contract=off, gcc 12
fuses operations (vfmaddsub) when it vectorizes code without loops for a processor that has this
instruction; -fno-tree-slp-vectorize prevents it.
"""
FLAGS = (*SAME_BITS, "-O2", "-fPIC", "-fvisibility=hidden")
RUN_ONCE = ("-O0",)
"""Flags of the programs that print descriptions: optimizing them would take longer than running."""
DATE = "1980-01-01T00:00:00Z"
FMI_HEADERS = Path(find_spec("fmpy").origin).parent / "c-code"
"""Folder of the FMI headers in FMPy, found without importing FMPy, which would take longer than to
compile a small model.
"""
PLATFORM, LIBRARY = {"win32": ("win64", ".dll"), "darwin": ("darwin64", ".dylib")}.get(
    sys.platform, ("linux64", ".so")
)
"""Name of this platform's folder of libraries in an FMU, and ending of a library, as in FMPy."""


class SharedVariableError(Exception):
    """Error: the C file of a model has variables that all instances of the FMU would share; str()
    has one line per variable.
    """


def compile_with(compiler: list[str]) -> list[str]:
    """Return the command, with flags and include folders, that compiles models and the adapter."""
    include = [f"-I{folder}" for folder in (*HEADERS, FMI_HEADERS)]
    return [*compiler, *FLAGS, *include]


def compiled_adapter(folder: Path, fmi: str) -> list[Path]:
    """Return the paths of the object files that compile_adapter() writes into a folder; fmi: "2" or
    "3".
    """
    return [folder / f"{source.stem}.o" for source in ADAPTER[fmi]]


def compile_adapter(folder: Path, compiler: list[str], fmi: str) -> None:
    """Compile the files of the adapter into a folder; raise CalledProcessError if that fails."""
    for source, target in zip(ADAPTER[fmi], compiled_adapter(folder, fmi), strict=True):
        subprocess.run([*compile_with(compiler), "-c", source, "-o", target], check=True)


def build(
    source: Path, output: Path, compiler: list[str], fmi: str, compiled: Path | None = None
) -> None:
    """Write the FMU of the C file `source` for FMI `fmi` ("2" or "3") to the path `output`. Raises
    CalledProcessError if the compiler, the program that prints the description or package_fmu.py
    fails (they print the reason), and SharedVariableError if the file has variables that all
    instances share.

    compiled: folder with the compiled files of the adapter (None: compile them).
    """
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / f"{output.stem}{LIBRARY}"
        describe, xml = Path(folder) / "describe", Path(folder) / "modelDescription.xml"
        compile_c = [*compile_with(compiler), source]
        adapter = ADAPTER[fmi]
        linked = compiled_adapter(compiled, fmi) if compiled else adapter
        tool = [CORE / "build/describe.c", *RUN_ONCE, "-o", describe, "-lm"]
        subprocess.run([*compile_c, *tool], check=True)
        if shared := shared_variables.problems(compile_with(compiler), source):
            raise SharedVariableError("\n".join(f"{source.name}: {text}" for text in shared))
        with xml.open("wb") as file:
            names = [path.name for path in (source, *adapter)]
            subprocess.run([describe, fmi, "0", DATE, *names], check=True, stdout=file)
        subprocess.run([*compile_c, "-shared", *linked, "-o", library, "-lm"], check=True)
        package = [sys.executable, CORE / "build/package_fmu.py", f"--fmi{fmi}", output, xml]
        files = ["--license", LICENSE, "--binary", f"{PLATFORM}={library}"]
        sources = ["--source", source, *adapter, "--include", *HEADERS]
        subprocess.run([*package, *files, *sources], check=True)


def main() -> None:
    """Run the command line that the docstring of this module describes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("source", type=Path, nargs="?")
    parser.add_argument("-o", "--output", type=Path, help="default: beside the C file")
    parser.add_argument("--fmi", choices=tuple(ADAPTER), default="2", help="version of FMI")
    parser.add_argument(
        "--cc", type=shlex.split, default=["cc"], help="compiler with its arguments"
    )
    parser.add_argument("--adapter", type=Path, help="folder of the compiled adapter")
    a = parser.parse_args()
    if not (a.source or a.adapter):
        parser.error("expected a C file, or --adapter FOLDER to compile the adapter only")
    output = a.adapter if a.source is None else a.output or a.source.with_suffix(".fmu")
    try:
        if a.source is None:
            compile_adapter(a.adapter, a.cc, a.fmi)
        else:
            build(a.source, output, a.cc, a.fmi, a.adapter)
    except subprocess.CalledProcessError:
        sys.exit(1)
    except SharedVariableError as error:
        sys.exit(str(error))
    except OSError as error:
        sys.exit(f"build_fmu.py: {error}")
    print(output)


if __name__ == "__main__":
    main()
