# SPDX-License-Identifier: BSD-2-Clause
"""Compile the examples for cFS and F Prime (examples/cfs, examples/fprime) with checkouts of these
frameworks.

    flight_examples.py FOLDER [--cfs CFE OSAL PSP ELF2CFETBL] [--fprime CHECKOUT]

The folder receives a mission of cFS in which the example is the only app, and a project of F Prime
in which the example is the only component. The checkouts are copied or read, never changed.
"""

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

from harness.authoring.c_api import write_components

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"
PROJECT = """cmake_minimum_required(VERSION 3.13)
project(FlightExample C CXX)
include("${FPRIME_FRAMEWORK_PATH}/cmake/FPrime.cmake")
include("${FPRIME_FRAMEWORK_PATH}/cmake/FPrime-Code.cmake")
add_fprime_subdirectory("${CMAKE_CURRENT_LIST_DIR}/Flight")
"""


def run(*command: object, folder: Path) -> None:
    """Run a command in a folder; raise CalledProcessError if it fails."""
    environment = {**os.environ, "FLIGHT_CODE": str(folder.parent / "code")}
    subprocess.run(list(map(str, command)), cwd=folder, env=environment, check=True)


def build_cfs(checkouts: list[Path], mission: Path) -> Path:
    """Build a cFS mission with the example as its only app in the folder `mission`, and return the
    path of the app; checkouts: cFE, OSAL, PSP and elf2cfetbl, in this order.
    """
    for name, checkout in zip(("cfe", "osal", "psp", "tools/elf2cfetbl"), checkouts, strict=True):
        shutil.copytree(checkout, mission / name, ignore=shutil.ignore_patterns(".git"))
    tools = "project(CFETOOLS C)\nadd_subdirectory(elf2cfetbl)\n"
    (mission / "tools/CMakeLists.txt").write_text(tools, encoding="utf-8")
    shutil.copytree(mission / "cfe/cmake/sample_defs", mission / "sample_defs")
    shutil.copytree(EXAMPLES / "cfs", mission / "apps/flight_app")
    shutil.copy(mission / "cfe/cmake/Makefile.sample", mission / "Makefile")
    targets = mission / "sample_defs/targets.cmake"
    lines = targets.read_text(encoding="utf-8").splitlines()
    remaining = [line for line in lines if "APPLIST" not in line]
    listed = "list(APPEND MISSION_GLOBAL_APPLIST flight_app)"
    targets.write_text("\n".join([*remaining, listed, ""]), encoding="utf-8")
    run("make", "SIMULATION=native", "prep", folder=mission)
    run("make", "install", folder=mission)
    return mission / "build/exe/cpu1/cf/flight_app.so"


def build_fprime(checkout: Path, project: Path) -> Path:
    """Build an F Prime project with the example as its only component in the folder `project`, and
    return the path of the library; checkout: folder of F Prime.
    """
    shutil.copytree(EXAMPLES / "fprime", project / "Flight")
    (project / "CMakeLists.txt").write_text(PROJECT, encoding="utf-8")
    build = project / "build"
    places = [f"-DFPRIME_FRAMEWORK_PATH={checkout}", f"-DFPRIME_PROJECT_ROOT={project}"]
    more = ["-DFPRIME_SKIP_TOOLS_VERSION_CHECK=ON", "-DCMAKE_POLICY_VERSION_MINIMUM=3.5"]
    run("cmake", "-S", project, "-B", build, "-G", "Ninja", *places, *more, folder=project)
    run("cmake", "--build", build, "--target", "Flight", folder=project)
    return next(build.rglob("libFlight.*"))


def main() -> None:
    """Run the command line, see the docstring of the module."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--cfs", type=Path, nargs=4, metavar=("CFE", "OSAL", "PSP", "ELF2CFETBL"))
    parser.add_argument("--fprime", type=Path)
    a = parser.parse_args()
    if not a.cfs and not a.fprime:
        sys.exit("flight-examples: name a checkout, as in make flight-examples FPRIME=../fprime")
    folder = a.folder.resolve()
    shutil.rmtree(folder, ignore_errors=True)
    for name in ("code", "cfs", "fprime"):
        (folder / name).mkdir(parents=True)
    write_components(["adaptive_controller"], folder / "code")
    if a.cfs:
        print(build_cfs([path.resolve() for path in a.cfs], folder / "cfs"))
    if a.fprime:
        print(build_fprime(a.fprime.resolve(), folder / "fprime"))


if __name__ == "__main__":
    main()
