# SPDX-License-Identifier: BSD-2-Clause
"""Compile the FMU of a whole system (fuse.py) into a WebAssembly module that flies it in a page.

Usage: web_module.py WHOLE.fmu -o WHOLE.wasm [--cc COMMAND]

The sources are those inside the archive, with core/web/fly.c in the place of the FMI functions; the
bits are those of the FMU.
"""

import argparse
import shlex
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import build_fmu

PAGE = build_fmu.CORE / "web/fly.c"
TARGET = ("-target", "wasm32-wasi", "-mexec-model=reactor")
FLAGS = (*build_fmu.SAME_BITS, "-O2", "-s", "-g0")
FMI = "fmi2"
"""Sources of the adapter that no page calls begin so."""


def compile_module(fmu: Path, output: Path, compiler: list[str]) -> None:
    """Write the module; subprocess.CalledProcessError if the compiler fails."""
    with tempfile.TemporaryDirectory() as folder:
        with zipfile.ZipFile(fmu) as archive:
            archive.extractall(folder)
            model = ElementTree.fromstring(archive.read("modelDescription.xml"))
        listed = [file.attrib["name"] for file in model.iter("File")]
        sources = [name for name in listed if not name.startswith(FMI)]
        made = [*sources, str(PAGE), "-I.", "-o", str(output.resolve()), "-lm"]
        subprocess.run([*compiler, *TARGET, *FLAGS, *made], check=True, cwd=f"{folder}/sources")


def main() -> None:
    """Command line, see the docstring of the module."""
    parser = argparse.ArgumentParser()
    parser.add_argument("fmu", type=Path)
    parser.add_argument("-o", "--output", type=Path, required=True)
    default = [sys.executable, "-m", "ziglang", "cc"]
    parser.add_argument("--cc", type=shlex.split, default=default, help="with its arguments")
    a = parser.parse_args()
    try:
        compile_module(a.fmu, a.output, a.cc)
    except (subprocess.CalledProcessError, OSError) as error:
        sys.exit(f"web_module.py: {error}" if isinstance(error, OSError) else 1)


if __name__ == "__main__":
    main()
