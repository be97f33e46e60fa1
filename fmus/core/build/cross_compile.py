# SPDX-License-Identifier: BSD-2-Clause
"""Add the binaries of all platforms to FMUs, compiled from the sources inside each archive by one
cross compiler, as many FMUs at a time as there are processors.

Usage: cross_compile.py --fmus DIR -o DIR [--jobs N] [--cc COMMAND]
"""

import argparse
import os
import struct
import subprocess
import sys
import tempfile
import zipfile
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from xml.etree import ElementTree

import fmpy
from package_fmi3 import PLATFORMS, listed_sources
from package_fmu import write_zip

TARGETS = {
    "linux64": ("x86_64-linux-gnu.2.17", ".so", ("-fPIC", "-lm")),
    "win64": ("x86_64-windows-gnu", ".dll", ()),
    "darwin64": ("x86_64-macos.10.15", ".dylib", ()),
    "aarch64-darwin": ("aarch64-macos.11.0", ".dylib", ()),
}
"""FMI platform: target of the compiler, ending of a shared library, flags of its own."""

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
    """The shared library of one platform; subprocess.CalledProcessError if the compiler fails."""
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
    # in the folder and with relative names, so that no path gets into the binary
    subprocess.run(command, check=True, cwd=folder / "sources")
    binary = (folder / "sources" / library).read_bytes()
    return without_link_time(binary) if platform == "win64" else binary


def without_link_time(dll: bytes) -> bytes:
    """A Windows library with the time of linking in its PE header set to zero: same sources, same
    bytes.
    """
    (header,) = struct.unpack_from("<I", dll, 0x3C)
    return dll[: header + 8] + bytes(4) + dll[header + 12 :]


def all_platforms(fmu: Path, compiler: list[str]) -> dict[str, bytes]:
    """Files of an FMU with the binaries of every platform in TARGETS in place of its own."""
    with zipfile.ZipFile(fmu) as archive, tempfile.TemporaryDirectory() as folder:
        archive.extractall(folder)
        files = {
            name: archive.read(name)
            for name in archive.namelist()
            if not name.startswith("binaries/")
        }
        description = ElementTree.fromstring(files["modelDescription.xml"])
        build = files.get("sources/buildDescription.xml")
        sources = listed_sources(description, build)
        for platform, (_, ending, _) in TARGETS.items():
            binary = compile_for(platform, Path(folder), sources, fmu.stem, compiler)
            place = platform if build is None else PLATFORMS[platform]
            files[f"binaries/{place}/{fmu.stem}{ending}"] = binary
    return files


def main() -> None:
    """Command line, see the docstring of the module."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--fmus", type=Path, required=True)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--cc", nargs="+", default=[sys.executable, "-m", "ziglang", "cc"])
    a = parser.parse_args()
    a.output.mkdir(parents=True, exist_ok=True)
    fmus = sorted(a.fmus.glob("*.fmu"))
    with ThreadPoolExecutor(a.jobs) as pool:  # the work is done by processes of the compiler
        found = pool.map(partial(all_platforms, compiler=a.cc), fmus)
        for fmu, files in zip(fmus, found, strict=True):
            write_zip(a.output / fmu.name, files)
            print(a.output / fmu.name, flush=True)


if __name__ == "__main__":
    main()
