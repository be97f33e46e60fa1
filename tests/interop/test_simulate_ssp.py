# SPDX-License-Identifier: BSD-2-Clause
"""FMPy's own simulation of an .ssp: what docs/other_tools.md states about it."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from harness import load
from harness.files import paths

STEPS = 3

pytestmark = pytest.mark.interop


SIMULATE = """import sys
from fmpy.ssp.simulation import simulate_ssp
path, stop, step = sys.argv[1:]
print(len(simulate_ssp(path, stop_time=float(stop), step_size=float(step))), "rows")
"""


@pytest.mark.parametrize("name", sorted(paths.systems()))
@pytest.mark.tool("FMPy simulate_ssp on the .ssp itself", "fmpy")
def test_simulate_ssp_initializes_every_system_and_a_zero_input_is_named(name):
    """It makes the first step with inputs of zero, which an FMU that needs a direction rejects. In
    a process of its own, because FMPy has one logger, which our runs replace.
    """
    with load(name) as system:
        step = system.experiment.step
        inputs = {c.target[1].partition("[")[0] for c in system.connections}
    stop = (STEPS - 0.5) * step
    done = subprocess.run(
        [sys.executable, "-c", SIMULATE, str(paths.systems()[name]), str(stop), str(step)],
        capture_output=True,
        text=True,
        check=False,
    )
    if name == "space_robot":
        assert (done.returncode, done.stdout) == (0, f"{STEPS} rows\n")
        return
    assert "fmi2DoStep failed" in done.stderr
    named = re.findall(r"rejected: .*; the input (\w+) is zero", done.stdout)
    assert len(named) == 1
    assert named[0] in inputs
