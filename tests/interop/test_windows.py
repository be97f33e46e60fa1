# SPDX-License-Identifier: BSD-2-Clause
"""The win64 library of every FMU of a system, run under Wine, gives the bits of linux64 over a
whole run.
"""

import os
import shutil
import struct
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest

from harness import load, run
from harness.system.graph import build_graph

pytestmark = [pytest.mark.interop, pytest.mark.tool("Wine (win64 by Zig)", "ziglang")]

ROOT = Path(__file__).parents[2]
HEADERS = Path(fmpy.__file__).parent / "c-code"
# the package wine64 of Debian puts the program beside the path
PLACES = os.pathsep.join((os.environ.get("PATH", ""), "/usr/lib/wine"))
WINE = shutil.which("wine64", path=PLACES) or shutil.which("wine")
SYSTEM = "sync_approach"


def zig(*arguments):
    subprocess.run([sys.executable, "-m", "ziglang", "cc", *map(str, arguments)], check=True)


@pytest.fixture(scope="module")
def workshop(tmp_path_factory):
    """Folder with replay.exe and the FMUs of the system for all platforms."""
    if WINE is None:
        pytest.skip("Wine is not installed: the win64 libraries are not run")
    pytest.importorskip(
        "ziglang", reason="ziglang is not installed: the win64 libraries are not built"
    )
    folder = tmp_path_factory.mktemp("windows")
    source = ROOT / "tests/interop/replay.c"
    zig(
        "-target",
        "x86_64-windows-gnu",
        "-O2",
        "-isystem",
        HEADERS,
        source,
        "-o",
        folder / "replay.exe",
    )
    with load(SYSTEM) as system:
        for component in system.components:
            shutil.copy(component.fmu, folder)
    command = [
        sys.executable,
        ROOT / "fmus/core/build/cross_compile.py",
        "--fmus",
        folder,
        "-o",
        folder / "dist",
    ]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder


@pytest.fixture(scope="module")
def recording():
    """The graph of the system and its rows simulated with the linux64 libraries."""
    with load(SYSTEM) as system:
        return system, build_graph(system), run(SYSTEM).values


def inputs_of(graph, node, rows):
    """Inputs that a component read at every macro step of Gauss-Seidel: new rows from those before
    it, else old ones.
    """
    first = min(wire.slot for wire in node.outputs)
    slots = np.array([wire.slot for wire in node.inputs], dtype=int)
    return np.where(slots < first, rows[1:, slots], rows[:-1, slots])


def record(path, node, inputs, step):
    """Input file of replay.c."""
    settings = node.settings
    outputs = [wire.variable.reference for wire in node.outputs]
    sources = [wire.variable.reference for wire in node.inputs]
    counts = (len(settings), len(sources), len(outputs), len(inputs))
    with path.open("wb") as file:
        file.write(node.interface.model.guid.encode().ljust(64, b"\0"))
        file.write(struct.pack("<4Id", *counts, step))
        for references in ([s.variable.reference for s in settings], sources, outputs):
            file.write(np.array(references, dtype="<u4").tobytes())
        file.write(np.array([s.value for s in settings], dtype="<f8").tobytes())
        file.write(np.ascontiguousarray(inputs, dtype="<f8").tobytes())


def replay(folder, name, recorded, columns):
    """Outputs of the win64 library for recorded inputs, a row per communication point."""
    with zipfile.ZipFile(folder / "dist" / folder.name / f"{name}.fmu") as archive:
        (folder / f"{name}.dll").write_bytes(archive.read(f"binaries/win64/{name}.dll"))
    command = [WINE, "replay.exe", f"{name}.dll", recorded.name, "out.bin"]
    quiet = {**os.environ, "WINEDEBUG": "-all"}
    done = subprocess.run(
        command, cwd=folder, env=quiet, capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 0, done.stderr
    return np.fromfile(folder / "out.bin", dtype="<f8").reshape(-1, columns)


@pytest.mark.parametrize(
    "component", ["guidance", "controller", "propulsion", "servicer", "target"]
)
def test_win64_gives_the_bits_of_linux64_over_a_whole_run(component, workshop, recording):
    system, graph, rows = recording
    node = next(n for n in graph.nodes if n.component.name == component)
    recorded = workshop / f"{component}.bin"
    record(recorded, node, inputs_of(graph, node, rows), system.experiment.step)
    theirs = replay(workshop, node.interface.model.modelName, recorded, len(node.outputs))
    ours = rows[:, [wire.slot for wire in node.outputs]]
    np.testing.assert_array_equal(theirs[1:].view(np.uint64), ours[1:].view(np.uint64))
