# SPDX-License-Identifier: BSD-2-Clause
"""Every .ssp as shipped in OMSimulator, built from its sources: OMSIMULATOR names the program."""

import csv
import os
import subprocess

import numpy as np
import pytest

from harness import export
from harness.files import paths
from tests.close import close
from tests.interop.jacobi import jacobi

PROGRAM = os.environ.get("OMSIMULATOR", "")


def version():
    """Return the version that the program prints."""
    if not PROGRAM:
        return "3"
    done = subprocess.run([PROGRAM, "--version"], capture_output=True, text=True, check=True)
    return done.stdout.split()[-1].removeprefix("v").removesuffix("-linux-debug")


pytestmark = [
    pytest.mark.interop,
    pytest.mark.tool("OMSimulator", version()),
    pytest.mark.skipif(not PROGRAM, reason="OMSIMULATOR is not set: docs/other_tools.md"),
]

STEPS = 200
PRINTED = 1e-11
"""Its CSV files have twelve digits, and it adds up the steps to the time."""


def theirs(path, result, folder):
    """Return the rows of OMSimulator at our instants by column of the result."""
    file = folder / "rows.csv"
    span = [f"--startTime={result.time[0]}", f"--stopTime={result.time[-1]}"]
    command = [PROGRAM, *span, f"--resultFile={file}", str(path)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    assert "info:    0 errors" in done.stdout
    with file.open(encoding="utf-8", newline="") as text:
        head, *rows = csv.reader(text, skipinitialspace=True)
    values = np.array(rows, dtype=float)
    values = values[np.append(np.diff(values[:, 0]) > 0, True)]  # it writes an instant twice
    prefix = f"{result.system}.{result.system}."
    place = {name.removeprefix(prefix): k for k, name in enumerate(head)}
    return values[:, 0], {name: values[:, place[name]] for name in result.columns if name in place}


@pytest.mark.parametrize("name", sorted(paths.systems()))
@pytest.mark.parametrize("ssp", [1, 2])
def test_every_system_as_shipped_gives_our_digits_in_omsimulator(name, ssp, tmp_path):
    path = paths.systems()[name]
    if ssp == 2:
        path = export(name, tmp_path / f"{name}.ssp", ssp=2)
    result = jacobi(path, STEPS)
    time, columns = theirs(path, result, tmp_path)
    np.testing.assert_allclose(time, result.time, rtol=0, atol=1e-9)
    assert set(columns) == set(result.columns)
    for column, values in columns.items():
        close(values, result[column], rel=PRINTED)
