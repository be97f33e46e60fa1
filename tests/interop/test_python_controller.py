# SPDX-License-Identifier: BSD-2-Clause
"""A controller in Python, built by PythonFMU, in place of one in C."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from harness import run

pytestmark = pytest.mark.interop
ROOT = Path(__file__).resolve().parents[2]
MINE = ROOT / "examples/my_controller"


@pytest.mark.tool("PythonFMU", "pythonfmu")
def test_a_controller_in_python_runs_as_its_twin_in_c(tmp_path):
    """The same law written twice: roundings apart, the same commands."""
    if importlib.util.find_spec("pythonfmu") is None:
        pytest.skip("pythonfmu is not installed")
    in_c = tmp_path / "my_controller.fmu"
    build_fmu = [sys.executable, ROOT / "fmus/core/build/build_fmu.py", f"{MINE}.c", "-o", in_c]
    subprocess.run(build_fmu, check=True)
    build = [sys.executable, "-m", "pythonfmu", "build", "-f", f"{MINE}.py", "-d", tmp_path]
    subprocess.run(build, check=True)
    c, python = (
        run("sync_approach", swap={"controller": fmu}, stop=300.0)["controller.F_cmd_S"]
        for fmu in (in_c, tmp_path / "MyController.fmu")
    )
    assert np.abs(c).max() > 1
    assert python == pytest.approx(c, abs=1e-6)
