# SPDX-License-Identifier: BSD-2-Clause
"""Add the binaries of all platforms to FMUs, compiled by one cross compiler from the sources inside
the archives, several models at the same time.

Usage: cross_compile.py --fmus DIR... -o DIR [--jobs N] [--cc COMMAND]

Archives with the same name in several folders (FMI 2.0 and FMI 3.0) get the same library, which
supports both versions. The archives of each folder are written to a folder of the same name inside
the output folder.
"""

import argparse
import os
import struct
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import fmpy
from package_fmi3 import PLATFORMS
from package_fmu import write_zip

from harness.files.archive import read_all
from harness.system.interface import unpacked_sources

TARGETS = {
    "linux64": ("x86_64-linux-gnu.2.17", ".so", ("-fPIC", "-lm")),
    "win64": ("x86_64-windows-gnu", ".dll", ()),
    "darwin64": ("x86_64-macos.10.15", ".dylib", ()),
    "aarch64-darwin": ("aarch64-macos.11.0", ".dylib", ()),
}
"""Target of the compiler, ending of a shared library and extra flags, by FMI platform."""

FLAGS = (
    "-std=c99",
    "-O2",
    "-ffp-contract=off",
    "-fno-tree-slp-vectorize",
    "-fno-math-errno",
    "-fvisibility=hidden",
    "-shared",
    "-s",
    "-g0",
)
HEADERS = Path(fmpy.__file__).parent / "c-code"


def compile_for(
    platform: str, folder: Path, sources: list[str], name: str, compiler: list[str]
) -> bytes:
    """Return the bytes of the shared library `name` for a platform of TARGETS; raise
    CalledProcessError if the compiler fails. folder: folder with the subfolder sources/; sources:
    names of the C files in this subfolder.
    """
    target, ending, flags = TARGETS[platform]
    library = f"{name}{ending}"
    command = [
        *compiler,
        "-target",
        target,
        *FLAGS,
        "-isystem",
        str(HEADERS),
        *sources,
        "-o",
        library,
        *flags,
    ]
    # run in the folder with relative file names, so that the binary contains no path
    subprocess.run(command, check=True, cwd=folder / "sources")
    binary = (folder / "sources" / library).read_bytes()
    return without_link_time(binary) if platform == "win64" else binary


def without_link_time(dll: bytes) -> bytes:
    """Return a Windows library with the link time in its PE header set to zero, so that the same
    sources give the same bytes.
    """
    (header,) = struct.unpack_from("<I", dll, 0x3C)
    return dll[: header + 8] + bytes(4) + dll[header + 12 :]


def all_platforms(fmus: Sequence[Path], compiler: list[str]) -> list[dict[str, bytes]]:
    """Return, for each of the archives `fmus` of one model, the bytes of its files by name. Newly
    compiled binaries of all platforms in TARGETS replace the binaries of the archive.
    """
    with tempfile.TemporaryDirectory() as folder:
        archives = [_without_binaries(fmu) for fmu in fmus]
        unpacked = (path for fmu in fmus for path in unpacked_sources(fmu, Path(folder)))
        sources = dict.fromkeys(path.name for path in unpacked)
        name = fmus[0].stem
        for platform, (_, ending, _) in TARGETS.items():
            binary = compile_for(platform, Path(folder), list(sources), name, compiler)
            for files in archives:
                has_build = "sources/buildDescription.xml" in files
                place = PLATFORMS[platform] if has_build else platform
                files[f"binaries/{place}/{name}{ending}"] = binary
    return archives


def _without_binaries(fmu: Path) -> dict[str, bytes]:
    files = read_all(fmu)
    return {name: data for name, data in files.items() if not name.startswith("binaries/")}


def main() -> None:
    """Run the command line that the docstring of this module describes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--fmus", type=Path, nargs="+", required=True)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--cc", nargs="+", default=[sys.executable, "-m", "ziglang", "cc"])
    a = parser.parse_args()
    models: dict[str, list[Path]] = {}
    for fmu in sorted(fmu for folder in a.fmus for fmu in folder.glob("*.fmu")):
        models.setdefault(fmu.name, []).append(fmu)
    with ThreadPoolExecutor(a.jobs) as pool:  # threads suffice: they wait for compiler processes
        found = pool.map(partial(all_platforms, compiler=a.cc), models.values())
        for fmus, archives in zip(models.values(), found, strict=True):
            for fmu, files in zip(fmus, archives, strict=True):
                made = a.output / fmu.parent.name / fmu.name
                made.parent.mkdir(parents=True, exist_ok=True)
                write_zip(made, files)
                print(made, flush=True)


if __name__ == "__main__":
    main()
