# SPDX-License-Identifier: BSD-2-Clause
"""What an FMU flies with if nobody says otherwise: the constants of its paper as the references of
the tests, which were written apart from it, have them.
"""

from __future__ import annotations

from dataclasses import asdict

import pytest

from ..reference import paper_case, ppc, relay, theta_d
from .driver import flat

CASES = {
    "ppc_controller": ppc.settings(ppc.Ppc()),
    "pid_controller": ppc.settings(ppc.Pid()),
    "theta_d_controller": ppc.settings(theta_d.ThetaD()),
    "adaptive_controller": asdict(paper_case.CONTROLLER) | {"t_att": 0},
    "pursuit_guidance": asdict(relay.Parameters()) | {"mu": 0},
}


@pytest.mark.parametrize("name", CASES)
def test_start_values_are_the_constants_of_the_paper(fmu, name):
    unit = fmu(name)
    wanted = {k: v for k, v in flat(CASES[name]).items() if k in unit.kind.references}
    other = {k: v for k, v in wanted.items() if unit.get(k) != pytest.approx(v.squeeze())}
    assert other == {}
    assert len(wanted) > 5
