# SPDX-License-Identifier: BSD-2-Clause
"""Cost of a macro step, side by side in one run: monolithic C, bare C loop, our executors, FMPy,
other masters.

Every contender runs the same system from the same .ssp in Gauss-Seidel order (other masters: their
own). Contenders are run in turn, several rounds, and the fastest round of each counts, so that a
noisy machine hurts all alike.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import perf_counter

from harness.errors import HarnessError
from harness.master.isolated import guarded
from harness.master.simulation import Simulation
from harness.ssp.library import load
from harness.system.model import System
from tests.bench.contenders import CONTENDERS, Contender
from tests.bench.instructions import Count, per_step

ROUNDS, PAIRS = 5, 7


@dataclass(frozen=True)
class Row:
    """One contender: time of a macro step [s], or why it could not run."""

    name: str
    seconds: float | None
    note: str = ""


COUNTED = (
    "monolithic C program",
    "bare C loop over the FMUs",
    "C executor, recording",
    "fused executor, recording",
)
"""Contenders whose instructions are counted too: those in C that cost no minutes under valgrind."""


def measure(system: System) -> Iterator[Row]:
    """One row per contender: the fastest of several interleaved rounds."""
    best: dict[str, float] = {}
    failed: dict[str, str] = {}
    for _ in range(ROUNDS):
        for name, contender in CONTENDERS:
            if name not in failed:
                try:
                    best[name] = min(best.get(name, float("inf")), _time(contender(system)))
                except (HarnessError, ImportError, OSError) as error:
                    failed[name] = str(error).splitlines()[0]
    for name, _ in CONTENDERS:
        yield Row(name, None, failed[name]) if name in failed else Row(name, best[name])


def _time(contender: Contender) -> float:
    with contender:
        began = perf_counter()
        contender.run()
        return (perf_counter() - began) / contender.steps


def start_up() -> float:
    """Wall-clock time of `harness list` in a fresh process, the fastest of three [s]."""
    return min(_list_once() for _ in range(3))


def _list_once() -> float:
    began = perf_counter()
    subprocess.run([sys.executable, "-m", "harness", "list"], check=True, capture_output=True)
    return perf_counter() - began


def set_up(system: System) -> float:
    """Wall-clock time of a further run of one macro step in a reused simulation, the fastest of 40
    [s].
    """
    step = system.experiment.step
    with Simulation(system) as simulation:
        simulation.run(stop=step)
        return min(_further_run(simulation, step) for _ in range(40))


def _further_run(simulation: Simulation, stop: float | None) -> float:
    began = perf_counter()
    simulation.run(stop=stop)
    return perf_counter() - began


def isolation(name: str, system: System) -> float | None:
    """Processor time of a whole `harness run` with FMUs in a process of their own over one without:
    the median of interleaved pairs. None where the time of other processes is not known.
    """
    if sys.platform == "win32":
        return None
    component = system.components[0]
    with TemporaryDirectory() as folder:
        third_party = Path(folder) / component.fmu.name
        shutil.copy(component.fmu, third_party)
        with zipfile.ZipFile(third_party, "a") as archive:
            archive.comment = b"other bytes: not ours"
        run = [
            "run",
            name,
            "--swap",
            f"{component.name}={third_party}",
            "-q",
            "-o",
            f"{folder}/x.nc",
        ]
        pairs = [(_spent(run), _spent([*run, "--in-process"])) for _ in range(PAIRS)]
    return median(apart / together for apart, together in pairs)


def _spent(arguments: Sequence[str]) -> float:
    """Processor time of a command with all its processes [s]."""
    from resource import RUSAGE_CHILDREN, getrusage

    before = getrusage(RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "harness", *arguments], check=True, capture_output=True)
    after = getrusage(RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def run_memory(system: str) -> float:
    """Largest resident memory of a whole run without a results file, in a fresh process [MB]."""
    code = (
        "import resource, sys; from harness import run; run(sys.argv[1]); "
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, system], check=True, capture_output=True, text=True
    )
    return float(done.stdout) / 1024


def bench(name: str) -> str:
    """Table of the cost of a macro step of a system of the project, start-up time and memory;
    UsageError if unknown.
    """
    with load(name) as system:
        rows = guarded([c.fmu for c in system.components], _rows, system)
        reused = guarded([c.fmu for c in system.components], set_up, system)
        apart = isolation(name, system)
    base = next((row.seconds for row in rows if row.name == CONTENDERS[1][0] and row.seconds), None)
    counts = per_step(name, COUNTED)
    lines = [
        f"{name}: cost of one macro step, fastest of {ROUNDS} rounds",
        f"{'':30}{'us':>9}{'ratio':>9}{'instructions':>14}",
    ]
    lines += [_line(row, base, counts.get(row.name)) for row in rows]
    lines += sorted({f"instructions not counted: {c.note}" for c in counts.values() if c.note})
    lines += [
        f"command-line start-up {start_up():.2f} s, set-up of a further run {1e3 * reused:.1f} ms, "
        f"memory of a whole run {run_memory(name):.0f} MB"
    ]
    if apart is not None:
        lines += [f"a run with FMUs in a process of their own costs {apart:.2f} times one without"]
    return "\n".join(lines)


def _rows(system: System) -> list[Row]:
    return list(measure(system))


def _line(row: Row, base: float | None, count: Count | None) -> str:
    if row.seconds is None:
        return f"{row.name:30}  not run: {row.note}"
    ratio = f"{row.seconds / base:9.2f}" if base else ""
    instructions = f"{count.instructions:14.0f}" if count and count.instructions else ""
    return f"{row.name:30}{1e6 * row.seconds:9.2f}{ratio}{instructions}"
