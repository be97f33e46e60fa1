# SPDX-License-Identifier: BSD-2-Clause
"""Cost of a macro step of a run alone and in the lanes of vectors, steps that are split, and runs
of the shipped campaign per second beside Basilisk and V-BAR.

    python -m tests.bench.lanes [SYSTEM]
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import harness
from harness.master import fused, lanes
from harness.master.changes import apply
from harness.master.lanes import Lanes
from harness.master.simulation import Simulation
from harness.mission.library import campaigns
from harness.ssp.library import load
from harness.studies.campaign.draft import read_plan, table_of
from harness.system.graph import checked
from harness.system.interface import unpacked_sources
from harness.system.model import System

ROUNDS, STEPS, MOST = 5, 6000, 8
RUNS = 20, 100
"""Runs of a short and a long campaign; their difference has no start and no end."""


def bench(name: str) -> Iterator[str]:
    """Yield the lines of the table for a system and its campaign `NAME_dispersions`."""
    file = campaigns()[f"{name}_dispersions"]
    yield f"{name}: a macro step of a fused run, dispersed as in {file.name}"
    with ExitStack() as life:
        yield from steps(life.enter_context(load(name)), file, life)
    if lanes.width() == 1:
        yield "lanes: not run: there is no compiler of C++"
    for label, on in (("alone", False), ("in lanes", True)):
        yield f"runs of {file.name} {label:9} {per_second(file, on):8.1f} per second and core"
    yield f"Basilisk, two rigid bodies, RK4    {others('basilisk')}"
    yield f"V-BAR, one body, 3 degrees         {others('vbar')}"


# ---- macro steps


def steps(system: System, file: Path, life: ExitStack) -> Iterator[str]:
    """Yield a line for runs alone and for each number of lanes, with the steps that were split."""
    found = checked(system)
    fmu = fused.Whole(system, found.graph).interface.path
    lanes.library(fmu, wait=True)  # for the campaign
    plan = read_plan(random_only(file), file)[0]
    runs = [apply(system, **plan.changes(plan.values(k))) for k in range(MOST)]
    simulations = [life.enter_context(Simulation(run, executor="fused")) for run in runs]
    alone = least(lambda: [each.advance(to=STEPS) for each in simulations], simulations) / MOST
    yield f"{'alone':12}{1e6 * alone:8.2f} us"
    folder = Path(life.enter_context(TemporaryDirectory()))
    for width in (n for n in (2, 4, MOST) if n <= lanes.width() > 1):
        made = library(fmu, width, folder)
        together, part = Lanes(made), simulations[:width]
        seconds = least(lambda: together.advance(part, STEPS), part) / width  # noqa: B023
        yield f"{f'{width} lanes':12}{1e6 * seconds:8.2f} us, {alone / seconds:.2f} times as fast"
        models = sorted({node.interface.model.modelName for node in found.graph.nodes})
        rates = [(model, splits(made, model) / (ROUNDS * STEPS)) for model in models]
        split = [f"{model} {100 * share:.2g} %" for model, share in rates if share]
        yield f"{'':12}split steps: {', '.join(split) or 'none'}"


def library(fmu: Path, width: int, folder: Path) -> Path:
    """Return the library of a number of lanes, compiled into a folder."""
    place = folder / str(width)
    place.mkdir()
    sources = unpacked_sources(fmu, place / "whole")[0].parent
    core = lanes._core()
    command = [*map(str, (sources, "-o", place / "lanes.so")), f"--width={width}"]
    fused.run_tool(core / "build" / "lanes.py", *command, f"--cxx={' '.join(lanes.compiler())}")
    return place / "lanes.so"


def least(work: Callable[[], Any], simulations: Sequence[Simulation]) -> float:
    """Return the least processor time of a macro step of several rounds of new runs [s]."""
    best = float("inf")
    for _ in range(ROUNDS):
        for each in simulations:
            each.begin(each.system)
            each.advance(to=1)
        began = process_time()
        work()
        best = min(best, process_time() - began)
    return best / (STEPS - 1)


def splits(made: Path, model: str) -> int:
    """Return the steps of a model that were split since the library was loaded."""
    return ctypes.c_int64.in_dll(ctypes.CDLL(str(made)), f"{model}_splits").value


# ---- campaigns


def per_second(file: Path, on: bool) -> float:
    """Return runs per second of processor time of a campaign, without its start and end."""
    short, long = (spent(file, runs, on) for runs in RUNS)
    return (RUNS[1] - RUNS[0]) / (long - short)


def random_only(file: Path) -> dict[str, Any]:
    """Return the table of a campaign without its listed factors."""
    table = table_of(file)
    random = {name: factor for name, factor in table["factors"].items() if "list" not in factor}
    return {**table, "factors": random}


def spent(file: Path, runs: int, on: bool) -> float:
    """Return the processor time of a fused campaign of so many runs in this process [s]."""
    table = random_only(file) | {"runs": runs, "executor": "fused"}
    with TemporaryDirectory() as folder:
        began = process_time()
        harness.campaign(table, Path(folder) / "runs.zarr", workers=0, lanes=on)
        return process_time() - began


# ---- other simulators


def others(name: str) -> str:
    """Return the line of a script of another simulator, or why it could not run. Its interpreter is
    the value of the environment variable of its name in capitals, by default the present one.
    """
    python = os.environ.get(name.upper(), sys.executable)
    script = Path(__file__).with_name(f"{name}_runs.py")
    done = subprocess.run([python, str(script)], check=False, capture_output=True, text=True)
    if done.returncode:
        reason = done.stderr.strip().rpartition("\n")[2]
        return f"not run: {reason}; {name.upper()}=PYTHON names an interpreter that has it"
    return f"{float(done.stdout.split()[-1]):8.1f} per second and core"


if __name__ == "__main__":
    print("\n".join(bench((sys.argv[1:2] or ["sync_approach"])[0])))
