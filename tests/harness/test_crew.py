# SPDX-License-Identifier: BSD-2-Clause
"""Processes that run one thing after the other: what one raises, what ends it, and how all end."""

from __future__ import annotations

import os
import time
from contextlib import contextmanager

import pytest

from harness.errors import UsageError
from harness.studies.crew import Crew, LostError, prepare
from tests.harness.interrupts import LONGEST


@contextmanager
def at_work():
    os.environ["AT_WORK"] = "yes"
    yield


def square(x):
    return x * x


def refuse(text):
    raise UsageError(text)


def end():
    os._exit(3)


def sleep(mark):
    mark.touch()
    time.sleep(LONGEST)


def pid_and_word():
    return os.getpid(), os.environ.get("AT_WORK")


def alive(pid):
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_every_future_has_its_own_value():
    with Crew(2, at_work) as crew:
        assert [f.result() for f in [crew.submit(square, x) for x in range(20)]] == [
            x * x for x in range(20)
        ]
        assert crew.submit(square, x=3).result() == 9
        pid, word = crew.submit(pid_and_word).result()
    assert pid != os.getpid()
    assert word == "yes"
    assert not alive(pid)


def test_what_one_raises_is_raised_here_and_tells_where():
    with Crew(1, at_work) as crew:
        wrong, right = crew.submit(refuse, "no such thing"), crew.submit(square, 2)
        with pytest.raises(UsageError, match="no such thing") as caught:
            wrong.result()
        assert right.result() == 4
    assert any("in refuse" in note for note in caught.value.__notes__)


def test_a_process_that_is_ended_costs_what_it_was_doing_and_is_exchanged():
    with Crew(1, at_work) as crew:
        first, _ = crew.submit(pid_and_word).result()
        lost, after = crew.submit(end), crew.submit(pid_and_word)
        with pytest.raises(LostError):
            lost.result()
        second, word = after.result()
    assert (second != first, word) == (True, "yes")
    assert not alive(first)


def test_an_error_here_ends_all_at_once_whatever_they_do(tmp_path):
    with pytest.raises(ZeroDivisionError), Crew(1, at_work) as crew:
        pid, _ = crew.submit(pid_and_word).result()
        running, waiting = crew.submit(sleep, tmp_path / "mark"), crew.submit(square, 2)
        while not (tmp_path / "mark").exists():
            time.sleep(0.01)
        raise ZeroDivisionError
    assert isinstance(running.exception(), LostError)
    assert waiting.cancelled()
    assert not alive(pid)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks of POSIX")
def test_a_fork_has_a_crew_of_its_own():
    with Crew(1, at_work) as crew:
        assert crew.submit(square, 3).result() == 9
    process = os.fork()
    if process == 0:
        status = 1
        try:
            prepare(__name__)
            with Crew(1, at_work) as crew:
                status = crew.submit(square, 3).result()
        finally:
            os._exit(status)
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 9
    with Crew(1, at_work) as crew:
        assert crew.submit(square, 4).result() == 16
