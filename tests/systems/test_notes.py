# SPDX-License-Identifier: BSD-2-Clause
"""Notes that a result prints beside the numbers."""

from __future__ import annotations

import pytest

from harness import run
from ssp.shared.approach import notes


def stated(**changes):
    return list(notes(run("sync_approach", stop=30.0, **changes)))


@pytest.mark.parametrize("wheels", [0, 1])
def test_torque_on_a_frozen_attitude_is_reported_with_the_remedy(wheels):
    changes = {"controller.use_wheels": wheels, "controller.t_att": 0}
    (line,) = stated(swap={"controller": "pid_controller"}, set={"servicer.t_att": 20.0, **changes})
    assert "frozen before 20 s" in line
    assert "--set servicer.t_att=0" in line


def test_nothing_is_reported_where_no_torque_is_lost():
    assert stated() == []
    free = {"servicer.t_att": 0, "controller.t_att": 0}
    assert stated(swap={"controller": "pid_controller"}, set=free) == []
