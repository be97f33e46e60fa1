# SPDX-License-Identifier: BSD-2-Clause
"""Answers of a board that come too late."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from harness import Simulation, load
from harness.errors import RunError
from tests.link.frames import CODE
from tests.link.test_link import SYSTEM, simulated


def late_in(step, release):
    """A line that holds the answer of one exchange until it is released."""
    exchanges = []

    def bend(data, towards):
        if towards == "board" and data[5:6] == bytes([CODE["exchange"]]):
            exchanges.append(data)
        if towards == "link" and len(exchanges) == step:
            assert release.wait(20)
        return data

    return bend


def commands(result):
    return result["controller.F_cmd_S"]


def late_run(board, late, steps_held, settle=True, limits="deadline=0.02&timeout=20"):
    """A run in which the answer of step 5 comes after `steps_held` further steps."""
    release = threading.Event()
    with board(late_in(5, release)) as found, load(SYSTEM) as system:
        place = f"{found.place}?{limits}&late={late}"
        with Simulation(system, on={"controller": place}, stop=2.0) as simulation:
            simulation.advance(to=4)
            if late == "wait":
                threading.Timer(0.1, release.set).start()
            try:
                simulation.advance(to=5 + steps_held)
            finally:
                release.set()
            if settle:
                _settled(simulation)
            simulation.advance()
            return simulation.result()


def _settled(simulation):
    """Wait until the link has received the late answer."""
    from harness.master.calls import cost

    controller = next(i for i in simulation.instances if i.name == "controller")
    simulation.late = cost(controller.calls).late


def test_wait_loses_nothing(board):
    assert late_run(board, "wait", 0).values.tobytes() == simulated("", 2.0).values.tobytes()


def test_hold_retains_the_last_command_and_catches_up(board):
    found, required = commands(late_run(board, "hold", 3)), commands(simulated("", 2.0))
    assert (found[:5] == required[:5]).all()
    assert (found[5:9] == required[4]).all()
    assert (found[9:] != found[8]).any(axis=1).all()
    assert np.allclose(found[9:], required[9:], rtol=0.02)


def test_a_board_that_was_held_catches_up_with_the_steps_that_it_was_not_sent(board):
    found = commands(late_run(board, "hold", 3, settle=False))
    assert np.allclose(found[-1], commands(simulated("", 2.0))[-1], rtol=0.05)


def test_hold_ends_the_run_when_the_answer_is_later_than_the_timeout(board):
    with pytest.raises(RunError, match=r"no answer within the timeout of 1 s"):
        late_run(board, "hold", 15, limits="deadline=0.2&timeout=1")


def test_stop_ends_the_run_and_retains_its_rows(board):
    with pytest.raises(RunError, match=r"no answer within the deadline of 0\.02 s") as caught:
        late_run(board, "stop", 0)
    assert len(caught.value.partial.time) == 5


@pytest.mark.parametrize("late", ["stop", "hold", "wait"])
def test_a_damaged_request_is_sent_again_before_the_deadline(board, late):
    exchanges = []

    def bend(data, towards):
        if towards == "board" and data[5:6] == bytes([CODE["exchange"]]):
            exchanges.append(data)
            if len(exchanges) == 5:
                return data[:-6] + bytes([data[-6] ^ 1]) + data[-5:]
        return data

    with board(bend) as found:
        result = simulated(f"{found.place}?deadline=10&timeout=20&late={late}", 2.0)
    assert result.values.tobytes() == simulated("", 2.0).values.tobytes()
    assert len(exchanges) == 21
