# SPDX-License-Identifier: BSD-2-Clause
"""The sources inside an .fmu make the binary inside it: other tools can compile them. Two builds
give the same bytes.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import fmpy
import pytest

from tests.compliance import description
from tests.compliance.fmus import ARCHIVES, BUILD
from tests.compliance.probe import ENDING, FOLDER, Fmu, Instance

HEADERS = Path(fmpy.__file__).parent / "c-code"
COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")

PATH = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
CMAKE = shutil.which("cmake", path=PATH)

needs_compiler = pytest.mark.skipif(COMPILER is None, reason="there is no C compiler")
needs_cmake = pytest.mark.skipif(
    COMPILER is None or CMAKE is None, reason="there is no cmake or no C compiler"
)
needs_cpp = pytest.mark.skipif(
    shutil.which("c++") is None, reason="there is no C++ compiler, which FMPy requires"
)


def run(*command):
    """With the tools beside Python, without a sanitizer that is preloaded into these tests, in
    another time zone.
    """
    surroundings = {name: value for name, value in os.environ.items() if name != "LD_PRELOAD"}
    surroundings |= {"PATH": PATH, "TZ": "Pacific/Auckland"}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=surroundings)
    assert done.returncode == 0, done.stdout + done.stderr


def fmu_without_binary(archive, folder):
    """An .fmu with the sources and the description only."""
    path = folder / archive.name
    with zipfile.ZipFile(archive) as old, zipfile.ZipFile(path, "w") as new:
        for entry in old.infolist():
            if not entry.filename.startswith("binaries/"):
                new.writestr(entry, old.read(entry))
    return path


def compiled_with(build, archive, folder):
    """The FMU with a library that `build(unpacked folder)` has made."""
    bare = fmu_without_binary(archive, folder)
    unpacked = folder / archive.stem
    with zipfile.ZipFile(bare) as files:
        files.extractall(unpacked)
    build(unpacked)
    with zipfile.ZipFile(bare, "a") as files:
        library = f"binaries/{FOLDER}/{archive.stem}{ENDING}"
        files.write(unpacked / library, library)
    return Fmu(bare, folder / "compiled" / archive.stem)


def by_fmpy(unpacked):
    """Run `fmpy compile` in a process of its own, because it prints."""
    command = "import sys; from fmpy import build; build.build_platform_binary(sys.argv[1])"
    run(sys.executable, "-c", command, unpacked)


def by_compiler(unpacked):
    """The listed sources, the headers of FMI, nothing else; no optimisation, every warning an
    error.
    """
    listed = description.Description(
        description.ElementTree.parse(unpacked / "modelDescription.xml").getroot()
    )
    names = [e.attrib["name"] for e in listed.root.findall("CoSimulation/SourceFiles/File")]
    library = unpacked / "binaries" / FOLDER / (listed.identifier + ENDING)
    library.parent.mkdir(parents=True)
    flags = [
        "-std=c99",
        "-O0",
        "-ffp-contract=off",
        "-Wall",
        "-Wextra",
        "-Werror",
        "-shared",
        "-fPIC",
    ]
    command = [
        COMPILER,
        *flags,
        "-isystem",
        HEADERS,
        *(unpacked / "sources" / name for name in names),
        "-o",
        library,
        "-lm",
    ]
    run(*command)


FEW = [path for path in ARCHIVES if path.stem in ("ideal_propulsion", "pid_controller")]
"""A plant and software: what `make test` compiles."""


def compile_all(build, folder):
    """All FMUs by name, two at a time."""
    with ThreadPoolExecutor(2) as pool:
        return {
            fmu.name: fmu
            for fmu in pool.map(lambda path: compiled_with(build, path, folder), ARCHIVES)
        }


@pytest.fixture(scope="session")
def compiled_by_fmpy(tmp_path_factory):
    return compile_all(by_fmpy, tmp_path_factory.mktemp("fmpy"))


@pytest.fixture(scope="session")
def compiled_alone(tmp_path_factory):
    return compile_all(by_compiler, tmp_path_factory.mktemp("alone"))


def recording(fmu):
    """The bits of fifty steps with inputs that are not zero, and of a long one."""
    with Instance(fmu) as instance:
        record = instance.start().simulate(50)
        instance.call("fmi2DoStep", 5.0, 30.0, 0)
        return record + instance.outputs()


@pytest.mark.interop
@pytest.mark.tool("FMPy", "fmpy")
@needs_cmake
@needs_cpp
def test_sources_compiled_by_fmpy_give_the_bits_of_the_binary(fmu, compiled_by_fmpy):
    assert recording(compiled_by_fmpy[fmu.name]) == recording(fmu)


@needs_compiler
def test_sources_of_a_plant_and_of_software_compiled_alone_give_the_bits_of_the_binary(tmp_path):
    for archive in FEW:
        alone = compiled_with(by_compiler, archive, tmp_path)
        assert recording(alone) == recording(Fmu(archive, tmp_path / "built" / archive.stem))


@pytest.mark.long
@needs_compiler
def test_sources_compiled_alone_without_optimisation_give_the_bits_of_the_binary(
    fmu, compiled_alone
):
    assert recording(compiled_alone[fmu.name]) == recording(fmu)


# ---- two builds


def setting(name):
    """Return the configuration of the build under test."""
    cache = (BUILD / "CMakeCache.txt").read_text(encoding="utf-8")
    found = re.search(rf"^{name}:\w+=(.*)$", cache, re.MULTILINE)
    return found[1] if found else ""


def build_again(archives, folder):
    """Configure and build FMUs once more, elsewhere, from the same sources; archives by name."""
    same = [
        f"-D{name}={setting(name)}"
        for name in ("CMAKE_BUILD_TYPE", "CMAKE_C_COMPILER", "CMAKE_C_FLAGS", "Python_EXECUTABLE")
    ]
    run(
        "cmake",
        "-S",
        setting("CMAKE_HOME_DIRECTORY"),
        "-B",
        folder,
        *filter(lambda text: text[-1] != "=", same),
    )
    targets = [f"package_{path.stem}" for path in archives]
    run("cmake", "--build", folder, "--parallel", "2", "--target", *targets)
    return {path.name: path.read_bytes() for path in (folder / "fmus").glob("*.fmu")}


@needs_cmake
@pytest.mark.parametrize(
    "archives", [FEW[:1], pytest.param(ARCHIVES, marks=pytest.mark.long)], ids=["one", "all"]
)
def test_another_build_in_another_place_gives_the_same_bytes(archives, tmp_path):
    if not (BUILD / "CMakeCache.txt").is_file() or setting("SANITIZE") == "ON":
        pytest.skip(
            "the build under test has no cache, or holds paths of its own for the sanitizers"
        )
    again = build_again(archives, tmp_path / "a folder of another name")
    assert {path.name for path in archives} == set(again)
    assert [path.name for path in archives if path.read_bytes() != again[path.name]] == []
