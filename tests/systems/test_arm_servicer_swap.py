# SPDX-License-Identifier: BSD-2-Clause
"""arm_servicer in place of servicer in every system: with no joints it is servicer, with a locked
arm a body with the mass of the arm. The cheap form is in tests/fmu/test_arm_servicer.py.
"""

from __future__ import annotations

import numpy as np
import pytest

from harness import load, run
from harness.mission.library import systems
from tests.each import Each

pytestmark = pytest.mark.long
STEPS = 40


def simulated_by_servicer():
    """Systems with the FMU servicer, and the time of some macro steps [s]."""
    for name in sorted(systems()):
        with load(name) as system:
            fmus = {c.name: c.fmu.stem for c in system.components}
            if fmus.get("servicer") == "servicer":
                yield name, STEPS * system.experiment.step


@pytest.fixture
def simulated():
    return Each(simulated_by_servicer())


def test_without_joints_it_is_the_servicer_in_every_system(simulated):
    """Compare its outputs, to 1e-14 of their size."""
    name, stop = simulated
    swapped = {"swap": {"servicer": "arm_servicer"}, "set": {"servicer.joints": 0}}
    one, other = run(name, stop=stop), run(name, stop=stop, **swapped)
    for variable in (v for v in one.vectors if v.startswith("servicer.")):
        size = max(1.0, np.abs(one[variable]).max())
        assert np.abs(one[variable] - other[variable]).max() <= 1e-14 * size, variable


def test_an_unconnected_arm_runs_in_every_system(simulated):
    name, stop = simulated
    plain, armed = run(name, stop=stop), run(name, stop=stop, swap={"servicer": "arm_servicer"})
    assert armed["servicer.mass"][0] == pytest.approx(plain["servicer.mass"][0] + 25)
    assert not armed["servicer.joint_rate"].any()
