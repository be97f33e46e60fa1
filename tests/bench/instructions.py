# SPDX-License-Identifier: BSD-2-Clause
"""Instructions of a macro step, counted by callgrind of valgrind: free of the noise of the machine.

    python -m tests.bench.instructions SYSTEM CONTENDER STEPS [COMPONENT.PARAMETER=VALUE |
        COMPONENT=FMU ...]

is the program that is counted. The difference of a long and a short run holds nothing but macro
steps: loading, initialisation and Python cost the same in both.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

SHORT, LONG = 500, 4500
"""Macro steps of the two runs: start-up varies by some 100 000 instructions from run to run, less
than 1 % of what lies between them.
"""
SAME = {"PYTHONHASHSEED": "0", "OPENBLAS_NUM_THREADS": "1", "PYTHONDONTWRITEBYTECODE": "1"}
"""Environment in which two runs start alike: none compiles what the other finds compiled."""


@dataclass(frozen=True)
class Count:
    """Instructions per macro step, or why they were not counted."""

    instructions: float | None
    note: str = ""


def per_step(system: str, contenders: Iterable[str]) -> dict[str, Count]:
    """Counts for contenders of tests.bench by name, two at a time."""
    names = list(contenders)
    with ThreadPoolExecutor(max_workers=2) as pool:
        return dict(
            zip(names, pool.map(lambda name: _difference(system, name), names), strict=True)
        )


def _difference(system: str, contender: str) -> Count:
    valgrind = shutil.which("valgrind")
    if valgrind is None:
        return Count(None, "valgrind not found")
    try:
        short, long = (_counted(valgrind, system, contender, n) for n in (SHORT, LONG))
    except (subprocess.CalledProcessError, ValueError):
        return Count(None, "it did not run under valgrind")
    return Count((long - short) / (LONG - SHORT))


def _counted(valgrind: str, system: str, contender: str, steps: int) -> int:
    """Instructions of a whole process; ValueError if valgrind does not name them."""
    program = [sys.executable, "-m", "tests.bench.instructions", system, contender, str(steps)]
    done = subprocess.run(
        [valgrind, "--tool=callgrind", "--callgrind-out-file=/dev/null", *program],
        check=True,
        capture_output=True,
        text=True,
        env=os.environ | SAME,
    )
    found = re.search(r"Collected : (\d+)", done.stderr)
    if found is None:
        raise ValueError("no count")
    return int(found[1])


def simulate(name: str, contender: str, steps: int, changes: Sequence[str] = ()) -> None:
    """Run a system of the project, with parameters set and FMUs swapped, with one contender of
    tests.bench.
    """
    from harness.master.changes import apply
    from harness.ssp.library import load
    from tests.bench.contenders import CONTENDERS

    swaps = [change for change in changes if "." not in change.partition("=")[0]]
    values = [change for change in changes if change not in swaps]
    with load(name) as system:
        chosen = dict(CONTENDERS)[contender](apply(system, set=values, swap=swaps))
        chosen.steps = steps
        with chosen:
            chosen.run()


if __name__ == "__main__":
    simulate(sys.argv[1], sys.argv[2], int(sys.argv[3]), sys.argv[4:])
