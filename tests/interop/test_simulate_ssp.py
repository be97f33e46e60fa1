# SPDX-License-Identifier: BSD-2-Clause
"""FMPy's own simulation of an .ssp: what docs/other_tools.md states about it."""

from __future__ import annotations

import re

import pytest
from fmpy.fmi1 import FMICallException
from fmpy.ssp.simulation import simulate_ssp

from harness import load
from harness.files import paths

STEPS = 3

pytestmark = pytest.mark.interop


@pytest.mark.parametrize("name", sorted(paths.systems()))
@pytest.mark.tool("FMPy simulate_ssp on the .ssp itself", "fmpy")
def test_simulate_ssp_initializes_every_system_and_a_zero_input_is_named(name, capfd):
    """It makes the first step with inputs of zero, which an FMU that needs a direction rejects."""
    path = paths.systems()[name]
    with load(name) as system:
        step = system.experiment.step
        inputs = {c.target[1].partition("[")[0] for c in system.connections}
    if name == "space_robot":
        assert len(simulate_ssp(str(path), stop_time=(STEPS - 0.5) * step, step_size=step)) == STEPS
        return
    with pytest.raises(FMICallException, match="fmi2DoStep failed"):
        simulate_ssp(str(path), stop_time=STEPS * step, step_size=step)
    named = re.findall(r"rejected: .*; the input (\w+) is zero", capfd.readouterr().out)
    assert len(named) == 1
    assert named[0] in inputs
