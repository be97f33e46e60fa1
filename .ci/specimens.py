# SPDX-License-Identifier: BSD-2-Clause
"""Specimens for makers of tools: small FMUs of FMI 3.0 from examples/specimens, each with the trace
that a tool must give, computed here from the equations in its C file.

python .ci/specimens.py build/specimens
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from fractions import Fraction
from math import floor
from pathlib import Path

import fmpy

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ROOT / "examples" / "specimens"
sys.path.insert(0, str(ROOT / "fmus" / "core" / "build"))  # for the imports below

import cross_compile  # noqa: E402
from package_fmi3 import PLATFORMS, build_description  # noqa: E402
from package_fmu import write_zip  # noqa: E402

HEADERS = ("types.h", "specimen.h", "unused.h")
STEP = Fraction(1, 4)
EXACT = "all values of the trace are exact in binary"
Rows = list[tuple[Fraction | int, ...]]


def event() -> Rows:
    """Return the trace of `event`: rows of time, level and count. An instant at which the level
    drops to 0 has two rows, with the values before and after the drop.
    """
    top, stop = Fraction(5, 8), 2
    edges = [k * top for k in range(1, floor(stop / top) + 1)]
    rows: Rows = []
    for t in sorted({*edges, *(k * STEP for k in range(int(stop / STEP) + 1))}):
        if t in edges:
            rows.append((t, top, floor(t / top) - 1))
        rows.append((t, t % top, floor(t / top)))
    return rows


def clock() -> Rows:
    """Return the trace of `clock`: rows of time, ramp, held (ramp at the last tick of the clock
    `sample`), ticks (number of ticks of `sample`) and sum (of the last three values of held, formed
    at each tick of the clock `third`, every third tick of `sample`). Values are those after the
    events at this time.
    """
    every, rows = Fraction(1, 2), []
    for k in range(17):
        t, ticks = k * STEP, k // 2 + 1
        third = ticks // 3 * 3 - 1  # index, from 0, of the tick of `sample` at the last of `third`
        total = sum(every * n for n in (third - 2, third - 1, third)) if third > 0 else 0
        rows.append((t, t, every * (ticks - 1), ticks, Fraction(total)))
    return rows


def table() -> Rows:
    """Return the trace of `table`: rows of time, vector `r`, and matrix `pair` row by row."""
    vectors = [[0, "0.5", -1], [1, 2, 4], [-2, 8, "0.25"], [3, -1, 6]]
    values = [[Fraction(x) for x in vector] for vector in vectors]
    rows: Rows = []
    for k in range(17):
        t = k * STEP
        low = min(floor(t), 3)
        before, after = values[low], values[min(low + 1, 3)]
        r = [a + (t - low) * (b - a) for a, b in zip(before, after, strict=True)]
        rows.append((t, *r, *before, *after))
    return rows


def binary() -> Rows:
    """Return the trace of `binary`: rows of time, received and checksum. The output `message`
    is connected to the input `reply`; the order is Jacobi.
    """
    return [(k * STEP, k, sum(k - 1 + i for i in range(k))) for k in range(9)]


NAMES = {
    "event": ("level", "count"),
    "clock": ("ramp", "held", "ticks", "sum"),
    "table": (
        *(f"r[{k}]" for k in (1, 2, 3)),
        *(f"pair[{i},{k}]" for i in (1, 2) for k in (1, 2, 3)),
    ),
    "binary": ("received", "checksum"),
}
"""Columns of each trace after the time."""
TRACES = {"event": event, "clock": clock, "table": table, "binary": binary}


def trace(name: str) -> list[tuple[object, ...]]:
    """Return the titles and the rows of the trace of a specimen."""
    return [("time", *NAMES[name]), *(tuple(map(float, row)) for row in TRACES[name]())]


def limits(name: str) -> list[tuple[object, ...]]:
    """Return a row per variable of a specimen: trace, variable, tolerance and reason."""
    return [(name, column, 0.0, EXACT) for column in NAMES[name]]


def contents(name: str, libraries: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the files of a specimen, by path in the FMU; libraries: by path below binaries/."""
    files = {f"sources/{file}": (SOURCES / file).read_bytes() for file in (f"{name}.c", *HEADERS)}
    files["sources/buildDescription.xml"] = build_description(name, [f"{name}.c"]).encode()
    files["modelDescription.xml"] = (SOURCES / f"{name}.xml").read_bytes()
    return files | {f"binaries/{place}": library for place, library in libraries.items()}


def compiled(name: str) -> dict[str, bytes]:
    """Return the libraries of a specimen by path below binaries/: for all platforms if Zig is
    installed, otherwise for this platform, by cc.
    """
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        _copied(folder / "sources")
        if importlib.util.find_spec("ziglang"):
            zig = [sys.executable, "-m", "ziglang", "cc"]
            return {
                f"{PLATFORMS[platform]}/{name}{ending}": cross_compile.compile_for(
                    platform, folder, [f"{name}.c"], name, zig
                )
                for platform, (_, ending, _) in cross_compile.TARGETS.items()
            }
        library = f"{name}{fmpy.sharedLibraryExtension}"
        command = ["cc", *cross_compile.FLAGS, "-fPIC", "-isystem", str(cross_compile.HEADERS)]
        subprocess.run([*command, f"{name}.c", "-o", library], check=True, cwd=folder / "sources")
        return {f"{fmpy.platform_tuple}/{library}": (folder / "sources" / library).read_bytes()}


def _copied(folder: Path) -> None:
    folder.mkdir()
    for path in SOURCES.glob("*.[ch]"):
        (folder / path.name).write_bytes(path.read_bytes())


def write(folder: Path) -> list[Path]:
    """Write NAME.fmu for every specimen and return the paths. The same sources and compiler give
    the same bytes.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{name}.fmu" for name in TRACES]
    for path in paths:
        write_zip(path, contents(path.stem, compiled(path.stem)))
    return paths


if __name__ == "__main__":
    print(*write(Path(sys.argv[1])), sep="\n")
