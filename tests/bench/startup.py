# SPDX-License-Identifier: BSD-2-Clause
"""Processor time of short commands, in new processes."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from statistics import median
from tempfile import TemporaryDirectory

REPEATS = 5


def bench(system: str) -> Iterator[str]:
    """Yield a line per command: the median of its processor time after a first run, which fills the
    cache.
    """
    for command in (["list"], ["run", system, "--stop", "1"]):
        processor_time(command)
        found = median(processor_time(command) for _ in range(REPEATS))
        yield f"harness {' '.join(command)}: {found:.2f} s of processor time"


def processor_time(command: Sequence[str]) -> float:
    """Return the processor time of a command of the harness, user and system [s]."""
    before = os.times()
    with TemporaryDirectory() as folder:
        subprocess.run(
            [sys.executable, "-m", "harness", *command],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            check=True,
        )
    after = os.times()
    return sum(after[2:4]) - sum(before[2:4])
