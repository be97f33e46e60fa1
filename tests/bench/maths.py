# SPDX-License-Identifier: BSD-2-Clause
"""Cost of the functions of portable_math.h beside the C library's.

    python -m tests.bench.maths        (make bench-maths)

Both sides run over the same 1024 arguments in the same loop. Times are the fastest of seven, taken
in turn; instructions, where valgrind is installed, the difference of a long and a short run.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
MATHS = HERE.parents[1] / "fmus/core/maths"
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno")
SIDES = ("portable", "library")
CALLS, SHORT, LONG = 300_000, 1024, 21 * 1024


def build(folder: Path) -> Path:
    """The program of maths.c."""
    program = folder / "maths"
    compiler = os.environ.get("CC", "cc").split()
    subprocess.run(
        [*compiler, *FLAGS, f"-I{MATHS}", HERE / "maths.c", "-o", program, "-lm"], check=True
    )
    return program


def output(*command: str | Path) -> str:
    """Return the output of a program on both channels."""
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    return done.stdout + done.stderr


def nanoseconds(program: Path, function: str) -> list[float]:
    """Of a call of both sides."""
    rounds = [
        [float(output(program, function, side, str(CALLS)).split()[0]) for side in SIDES]
        for _ in range(7)
    ]
    return [min(times) for times in zip(*rounds, strict=True)]


def instructions(program: Path, function: str, side: str) -> float | None:
    """Of a call; None without valgrind."""
    if shutil.which("valgrind") is None:
        return None
    short, long = (
        re.search(
            r"Collected : (\d+)",
            output(
                *("valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"),
                *(program, function, side, str(calls)),
            ),
        )
        for calls in (SHORT, LONG)
    )
    return (int(long[1]) - int(short[1])) / (LONG - SHORT) if short and long else None


def row(program: Path, function: str) -> str:
    """One line of the table."""
    ours, library = nanoseconds(program, function)
    text = f"{function:12} {ours:8.1f} {library:8.1f} {ours / library:6.2f}"
    counts = [instructions(program, function, side) for side in SIDES]
    if counts[0] is None or counts[1] is None:
        return text
    return f"{text}   {counts[0]:8.0f} {counts[1]:8.0f} {counts[0] / counts[1]:6.2f}"


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory() as folder:
        program = build(Path(folder))
        print(f"{'':12} {'ns: ours':>8} {'library':>8}  ratio  instructions  library  ratio")
        for function in output(program).split():
            print(row(program, function), flush=True)


if __name__ == "__main__":
    main()
