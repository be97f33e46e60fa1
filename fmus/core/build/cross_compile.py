# SPDX-License-Identifier: BSD-2-Clause
"""Add the binaries of all platforms to FMUs, compiled from the sources inside the archives by one
cross compiler, as many models at a time as there are processors.

Usage: cross_compile.py --fmus DIR... -o DIR [--jobs N] [--cc COMMAND]

Archives of one name in several folders, those of FMI 2.0 and FMI 3.0, get the same library, which
speaks all their versions. What comes from DIR goes to a folder of its name in the output.
"""

import argparse
import os
import struct
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Sequence
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


def all_platforms(fmus: Sequence[Path], compiler: list[str]) -> list[dict[str, bytes]]:
    """Files of every archive of a model, with the binaries of every platform in TARGETS in place of
    its own.
    """
    with tempfile.TemporaryDirectory() as folder:
        archives = [_without_binaries(fmu, Path(folder)) for fmu in fmus]
        builds = [files.get("sources/buildDescription.xml") for files in archives]
        sources = dict.fromkeys(
            name
            for files, build in zip(archives, builds, strict=True)
            for name in listed_sources(ElementTree.fromstring(files["modelDescription.xml"]), build)
        )
        name = fmus[0].stem
        for platform, (_, ending, _) in TARGETS.items():
            binary = compile_for(platform, Path(folder), list(sources), name, compiler)
            for files, build in zip(archives, builds, strict=True):
                place = platform if build is None else PLATFORMS[platform]
                files[f"binaries/{place}/{name}{ending}"] = binary
    return archives


def _without_binaries(fmu: Path, folder: Path) -> dict[str, bytes]:
    """The files of an archive but for its binaries; its sources are unpacked into the folder."""
    with zipfile.ZipFile(fmu) as archive:
        names = [name for name in archive.namelist() if not name.startswith("binaries/")]
        archive.extractall(folder, [name for name in names if name.startswith("sources/")])
        return {name: archive.read(name) for name in names}


def main() -> None:
    """Command line, see the docstring of the module."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--fmus", type=Path, nargs="+", required=True)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--cc", nargs="+", default=[sys.executable, "-m", "ziglang", "cc"])
    a = parser.parse_args()
    models: dict[str, list[Path]] = {}
    for fmu in sorted(fmu for folder in a.fmus for fmu in folder.glob("*.fmu")):
        models.setdefault(fmu.name, []).append(fmu)
    with ThreadPoolExecutor(a.jobs) as pool:  # the work is done by processes of the compiler
        found = pool.map(partial(all_platforms, compiler=a.cc), models.values())
        for fmus, archives in zip(models.values(), found, strict=True):
            for fmu, files in zip(fmus, archives, strict=True):
                made = a.output / fmu.parent.name / fmu.name
                made.parent.mkdir(parents=True, exist_ok=True)
                write_zip(made, files)
                print(made, flush=True)


if __name__ == "__main__":
    main()
