# SPDX-License-Identifier: BSD-2-Clause
"""The checker and simulator fmusim of the FMI project on every FMU: FMUSIM names the program."""

from __future__ import annotations

import csv
import os
import subprocess

import numpy as np
import pytest
from fmpy import simulate_fmu

from harness.files import paths

PROGRAM = os.environ.get("FMUSIM", "")
VERSION = "0.8.0"
STEPS, STEP = 20, 0.125
FORCES = {"F_S[1]": 0.1, "M_S[3]": 0.3}

pytestmark = [
    pytest.mark.interop,
    pytest.mark.tool("fmusim", VERSION),
    pytest.mark.skipif(not PROGRAM, reason="FMUSIM is not set: docs/other_tools.md"),
]


def fmu(name, fmi):
    """Return the path of an FMU of a version of FMI."""
    path = paths.fmus()[name]
    return path if fmi == 2 else path.parent.parent / "fmus3" / path.name


def run(*arguments):
    command = [PROGRAM, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.parametrize("name", sorted(paths.fmus()))
@pytest.mark.parametrize("fmi", [2, 3])
def test_fmusim_finds_no_errors(name, fmi):
    done = run("validate", fmu(name, fmi))
    assert done.returncode == 0, done.stderr
    assert "error" not in done.stderr


@pytest.mark.parametrize("fmi", [2, 3])
def test_fmusim_gives_the_bits_of_fmpy(fmi, tmp_path):
    """It writes an array of FMI 3.0 as numbers between spaces."""
    assert VERSION in run("--version").stdout
    starts = FORCES if fmi == 2 else {}
    file = tmp_path / "rows.csv"
    options = ["--output-interval", STEP, "--stop-time", STEPS * STEP, "--output-file", file]
    options += [word for n, x in starts.items() for word in ("--start-value", f"{n}={x}")]
    done = run("simulate", fmu("space_robot", fmi), *options)
    assert done.returncode == 0, done.stderr
    with file.open(encoding="utf-8", newline="") as text:
        head, *rows = csv.reader(text)
    found = np.array([[float(x) for cell in row for x in cell.split()] for row in rows])
    times = {"stop_time": STEPS * STEP, "step_size": STEP, "output_interval": STEP}
    path = str(fmu("space_robot", fmi))
    result = simulate_fmu(path, start_values=starts, output=head[1:], **times)
    expected = np.column_stack([result[name].reshape(len(result), -1) for name in head])
    assert np.array_equal(found, expected)
    assert len(found) == STEPS + 1
