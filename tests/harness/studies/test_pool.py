# SPDX-License-Identifier: BSD-2-Clause
"""Processes that run one thing after the other: what one raises, what ends it, and how all end."""

from __future__ import annotations

import os
import signal
import time
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from functools import partial
from multiprocessing import Pipe, forkserver
from pathlib import Path
from threading import Thread

import pytest

from harness.errors import UsageError
from harness.studies import pool as pools
from harness.studies.pool import LostWorkerError, WorkerPool, prepare
from tests.harness.interrupts import LONGEST, until


@contextmanager
def retaining():
    os.environ["AT_WORK"] = "yes"
    yield


def square(x):
    return x * x


def reject(text):
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
    with WorkerPool(2, retaining) as pool:
        assert [f.result() for f in [pool.submit(square, x) for x in range(20)]] == [
            x * x for x in range(20)
        ]
        assert pool.submit(square, 3).result() == 9
        pid, word = pool.submit(pid_and_word).result()
    assert pid != os.getpid()
    assert word == "yes"
    assert not alive(pid)


def test_an_exception_of_a_worker_is_raised_here_and_states_where():
    with WorkerPool(1, retaining) as pool:
        wrong, right = pool.submit(reject, "no such thing"), pool.submit(square, 2)
        with pytest.raises(UsageError, match="no such thing") as caught:
            wrong.result()
        assert right.result() == 4
    assert any("in reject" in note for note in caught.value.__notes__)


def test_a_lost_worker_costs_its_task_and_is_replaced():
    with WorkerPool(1, retaining) as pool:
        first, _ = pool.submit(pid_and_word).result()
        lost, after = pool.submit(end), pool.submit(pid_and_word)
        with pytest.raises(LostWorkerError):
            lost.result()
        second, word = after.result()
    assert (second != first, word) == (True, "yes")
    assert not alive(first)


def test_an_error_here_ends_all_workers_at_once(tmp_path):
    with pytest.raises(ZeroDivisionError), WorkerPool(1, retaining) as pool:
        pid, _ = pool.submit(pid_and_word).result()
        running, waiting = pool.submit(sleep, tmp_path / "mark"), pool.submit(square, 2)
        while not (tmp_path / "mark").exists():
            time.sleep(0.01)
        raise ZeroDivisionError
    assert isinstance(running.exception(), LostWorkerError)
    assert waiting.cancelled()
    assert not alive(pid)


# ---- processes that are stopped


@pytest.fixture
def stopped(tmp_path, monkeypatch):
    """A pool whose only process is stopped, idle or at work, and continued in the end."""
    monkeypatch.setattr(pools, "GRACE_SECONDS", 0.1)
    monkeypatch.setattr(pools, "LOOK_SECONDS", 0.05)
    with ExitStack() as life:

        def begun(busy):
            pool = life.enter_context(WorkerPool(1, retaining))
            pid = pool.submit(deaf).result()
            job = pool.submit(wait_for, tmp_path / "go", tmp_path / "mark") if busy else None
            if busy:
                until((tmp_path / "mark").exists, "job")
            os.kill(pid, signal.SIGSTOP)
            life.callback(send, pid, signal.SIGCONT)  # else a pool that waits would wait for ever
            life.callback((tmp_path / "go").touch)
            return pool, pid, job

        yield begun


def deaf():
    """As a kernel leaves a process that is stopped: SIGTERM waits until it is continued."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    return os.getpid()


def send(pid, number):
    with suppress(ProcessLookupError):
        os.kill(pid, number)


def wait_for(go, mark):
    mark.touch()
    until(go.exists, "sign")
    return "went on"


LINUX = pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="states of Linux")


@LINUX
@pytest.mark.parametrize(("busy", "interrupted"), [(True, True), (False, True), (False, False)])
def test_a_process_that_is_stopped_ends_with_its_pool(stopped, busy, interrupted):
    """At once after an error or Ctrl-C; one without work also if all goes well."""
    pool, pid, job = stopped(busy)
    ending = Thread(target=partial(pool.shutdown, cancel_futures=interrupted), daemon=True)
    ending.start()
    ending.join(60.0)
    assert not ending.is_alive()
    assert not alive(pid)
    assert job is None or isinstance(job.exception(), LostWorkerError)


@LINUX
def test_a_fork_server_that_is_stopped_does_not_hold_up_the_end(monkeypatch):
    """It reports that its processes have ended."""
    monkeypatch.setattr(pools, "GRACE_SECONDS", 0.1)
    monkeypatch.setattr(pools, "LOOK_SECONDS", 0.05)
    with WorkerPool(1, retaining) as pool:
        assert pool.submit(square, 3).result() == 9
        server = forkserver._forkserver._forkserver_pid
        os.kill(server, signal.SIGSTOP)
        ending = Thread(target=partial(pool.shutdown, cancel_futures=True), daemon=True)
        ending.start()
        ending.join(60.0)
        went_on = not ending.is_alive()
        os.kill(server, signal.SIGCONT)
    assert went_on


@LINUX
def test_a_process_that_is_stopped_is_reported_once_and_continues(stopped, tmp_path, caplog):
    _, pid, job = stopped(busy=True)
    until(lambda: caplog.messages, "note")
    assert caplog.messages == [
        f"worker process {pid} is stopped and its runs wait; continue it: kill -CONT {pid}"
    ]
    os.kill(pid, signal.SIGCONT)
    (tmp_path / "go").touch()
    assert job.result() == "went on"
    assert len(caplog.messages) == 1


@pytest.mark.skipif(not hasattr(os, "fork"), reason="forks of POSIX")
def test_a_fork_has_a_pool_of_its_own():
    with WorkerPool(1, retaining) as pool:
        assert pool.submit(square, 3).result() == 9
    process = os.fork()
    if process == 0:
        status = 1
        try:
            prepare(__name__)
            with WorkerPool(1, retaining) as pool:
                status = pool.submit(square, 3).result()
        finally:
            os._exit(status)
    assert os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]) == 9
    with WorkerPool(1, retaining) as pool:
        assert pool.submit(square, 4).result() == 16


@pytest.fixture
def interruptible():
    before = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("interruptible")
def test_a_worker_ends_without_a_traceback_when_its_parent_is_killed_during_a_task():
    ours, theirs = Pipe()
    ours.send((square, (3,)))
    ours.close()
    pools._serve(theirs, nullcontext, {})


@pytest.mark.usefixtures("interruptible")
@pytest.mark.skipif(os.name != "posix", reason="sockets of POSIX")
def test_a_worker_ends_without_a_traceback_when_its_parent_has_not_read_a_result():
    ours, theirs = Pipe()
    theirs.send("a result that the parent does not read")
    ours.close()
    pools._serve(theirs, nullcontext, {})
