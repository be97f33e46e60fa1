# SPDX-License-Identifier: BSD-2-Clause
"""What a reader of a result is told beside the numbers."""

from __future__ import annotations

import pytest

from harness import run
from ssp.shared.notes import notes


def told(**changes):
    return list(notes(run("sync_approach", stop=30.0, **changes)))


@pytest.mark.parametrize("wheels", [0, 1])
def test_torque_on_a_frozen_attitude_is_said_with_the_remedy(wheels):
    changes = {"controller.use_wheels": wheels, "controller.t_att": 0}
    (line,) = told(swap={"controller": "pid_controller"}, set={"servicer.t_att": 20.0, **changes})
    assert "frozen before 20 s" in line
    assert "--set servicer.t_att=0" in line


def test_nothing_is_said_where_no_torque_is_lost():
    assert told() == []
    free = {"servicer.t_att": 0, "controller.t_att": 0}
    assert told(swap={"controller": "pid_controller"}, set=free) == []
