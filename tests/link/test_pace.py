# SPDX-License-Identifier: BSD-2-Clause
"""The pace of a clock, measured with a clock of the test's own; and answers that come too late."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from harness import Simulation, load, run
from harness.errors import RunError, UsageError
from harness.master.pacer import Pacer
from tests.link.frames import CODE
from tests.link.test_link import SYSTEM, simulated

STEP = 0.1


class Clock:
    """Time that passes in sleep, which lasts `slow` too long, and when the test sets it."""

    def __init__(self, slow=0.0):
        self.now, self.slow = 7.0, slow

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds + self.slow


def paced(clock, work, factor=1.0):
    """Begin times, from the first, of steps that take the times in `work` [s]."""
    pacer, begins = Pacer(factor, clock, clock.sleep), []
    for k, seconds in enumerate(work):
        pacer.wait(k * STEP, lambda: None)
        begins.append(clock.now - 7.0)
        clock.now += seconds
    return np.array(begins), pacer.timing()


def test_steps_begin_at_absolute_deadlines_for_any_delay_of_each():
    begins, timing = paced(Clock(slow=0.001), [0.03] * 6001)
    assert np.allclose(begins[1:] - STEP * np.arange(1, 6001), 0.001, atol=1e-9)
    assert timing.drift == pytest.approx(0.001)
    assert timing.largest == pytest.approx(0.001)
    assert timing.overruns == 0


def test_a_factor_divides_the_time():
    begins, _ = paced(Clock(), [0.001] * 101, factor=10.0)
    assert np.allclose(begins, 0.01 * np.arange(101))


def test_an_overrun_is_counted_and_caught_up():
    begins, timing = paced(Clock(), [0.01, 0.35, 0.01, 0.01, 0.01, 0.01, 0.01])
    assert np.allclose(begins, [0, 0.1, 0.45, 0.46, 0.47, 0.5, 0.6])
    assert timing.overruns == 3
    assert timing.longest == pytest.approx(0.25)
    assert timing.drift == pytest.approx(0.0, abs=1e-12)


def test_the_keyboard_is_looked_at_during_long_waits():
    looks, clock = [], Clock()
    pacer = Pacer(1.0, clock, clock.sleep)
    for seconds in (0.0, 1.0):
        pacer.wait(seconds, lambda: looks.append(clock.now))
    assert len(looks) >= 10


@pytest.mark.parametrize("factor", [0.0, -1.0, float("nan"), float("inf")])
def test_a_factor_that_is_none_is_rejected(factor):
    with pytest.raises(UsageError, match="expected a factor above 0"):
        Pacer(factor)


def test_a_paced_run_has_the_same_bits_and_states_how_it_was_paced():
    clock = Clock()
    with load(SYSTEM) as system:
        pacer = Pacer(1.0, clock, clock.sleep)
        with Simulation(system, stop=2.0, pacer=pacer) as simulation:
            simulation.advance()
            result = simulation.result()
    assert result.values.tobytes() == simulated("", 2.0).values.tobytes()
    assert clock.now == pytest.approx(7.0 + 1.9)
    assert result.provenance.timing.startswith("1 times real time, 20 steps, jitter ")


def test_run_paces_in_a_process_of_its_own_too(board):
    with board() as found:
        place = found.place
        result = run(SYSTEM, on={"controller": place}, stop=0.5, realtime=1e6)
    assert result.provenance.timing.startswith("1e+06 times real time, 5 steps")
    assert result.provenance.on == (("controller", place),)


# ---- an answer that comes too late


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


def late_run(board, late, steps_held, settle=True):
    """A run in which the answer of step 5 comes after `steps_held` further steps."""
    release = threading.Event()
    with board(late_in(5, release)) as found, load(SYSTEM) as system:
        place = f"{found.place}?deadline=0.02&timeout=20&late={late}"
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


def test_stop_ends_the_run_and_retains_its_rows(board):
    with pytest.raises(RunError, match=r"no answer within the deadline of 0\.02 s") as caught:
        late_run(board, "stop", 0)
    assert len(caught.value.partial.time) == 5


def test_late_needs_a_pace_and_a_place():
    for how in ({"realtime": 1.0}, {"on": {"controller": "cortex-m7"}}):
        with pytest.raises(UsageError, match="--late hold: is valid only with --realtime and --on"):
            run(SYSTEM, late="hold", **how)
    with pytest.raises(UsageError, match="late expects wait, hold or stop, got never"):
        run(SYSTEM, late="never", realtime=1.0, on={"controller": "tcp://localhost:1"})


def test_the_deadline_is_the_period_of_the_component_at_this_pace():
    from harness.master.changes import timely

    with load(SYSTEM) as system:
        on = {"controller": "tcp://localhost:1?timeout=3", "monitor": "tcp://localhost:2"}
        moved = timely(system, {"on": on}, 2.0, "hold")
    periods = {c.name: c.every * STEP / 2 for c in system.components}
    assert moved.origin.on == {
        "controller": f"tcp://localhost:1?late=hold&deadline={periods['controller']}&timeout=3",
        "monitor": f"tcp://localhost:2?late=hold&deadline={periods['monitor']}",
    }
