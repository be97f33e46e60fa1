# SPDX-License-Identifier: BSD-2-Clause
"""Run after run in one process: nothing is left of them, neither open files, processes and folders
nor memory. A few in `make test`, hundreds in `make test-long`.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import psutil
import pytest

from harness import run
from harness.errors import RunError

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="counts in /proc")


def left(folder):
    """Resources of this process: kinds of open files, processes below it, temporary files."""
    descriptors = Path("/proc/self/fd")
    opened = Counter()
    for descriptor in descriptors.iterdir():
        try:
            opened[str(descriptor.readlink()).partition(":")[0]] += 1
        except FileNotFoundError:  # of the listing itself
            continue
    processes = psutil.Process().children(recursive=True)
    return opened, len(processes), sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("count", [12, pytest.param(300, marks=pytest.mark.long)])
def test_isolated_runs_leave_nothing(make, tmp_path, monkeypatch, count):
    """Two components of an FMU that is not ours; every third run ends early."""
    folder = tmp_path / "tmp"
    folder.mkdir()
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr(tempfile, "tempdir", None)
    good, bad = make({"a": "counter", "b": "gain"}), make({"a": "crashing", "b": "gain"})

    def simulate_case(k):
        if k % 3:
            assert len(run(good).time) == 7
            return
        with pytest.raises(RunError, match="SIGSEGV"):
            run(bad)

    _, processes, _ = left(folder)  # processes of tests before, as of a campaign that stays ready
    for k in range(6):
        simulate_case(k)
    before = left(folder)
    for k in range(count):
        simulate_case(k)
    assert left(folder) == before
    assert before[1:] == (processes, [])


REUSED = """
import ctypes, gc, sys
import psutil
from harness import Simulation, load

def memory():
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    return psutil.Process().memory_full_info().uss

with load("sync_approach") as system, Simulation(system, stop=1.0) as simulation:
    def simulate(count):
        for k in range(count):
            simulation.run(set={"servicer.mass_0": 90.0 + k % 40}, stop=1.0)
    simulate(100)
    before = memory()
    simulate(int(sys.argv[1]))
    print(memory() - before)
"""


@pytest.mark.parametrize("count", [100, pytest.param(2000, marks=pytest.mark.long)])
def test_reused_runs_take_no_memory(count):
    """Less than 1 MB, however many; in a process that has nothing else to do."""
    done = subprocess.run(
        [sys.executable, "-c", REUSED, str(count)], capture_output=True, text=True, check=True
    )
    assert int(done.stdout) < 1024**2
