# SPDX-License-Identifier: BSD-2-Clause
"""Processes of this machine that run one thing after the other. One that something ends, a crash
inside an FMU or a kill, costs what it was doing and is exchanged; nobody else can reach any.
"""

from __future__ import annotations

import atexit
import multiprocessing
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import cache
from multiprocessing import connection, forkserver, resource_tracker
from queue import SimpleQueue
from types import ModuleType
from typing import Any, Self

from harness.files.signals import held
from harness.files.temporary import PrivateFolder
from harness.master.child import end_with_parent

KEPT = 32 << 20
ENVIRONMENT = {
    "MALLOC_ARENA_MAX": 1,
    "MALLOC_TRIM_THRESHOLD_": 8 * KEPT,
    "MALLOC_MMAP_THRESHOLD_": KEPT,
    **dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), 1),
}
"""A process flies one run after the other in the same memory: it need not give it back and ask the
system for the same pages again (glibc takes at most 32 MiB, and gives threads heaps of 64 MiB that
come and go). There is one per processor: linear algebra takes no further ones.
"""
METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
CRASH = "its process was ended from outside, or by a crash inside an FMU"
"""Of what a process was doing that has been ended."""

Ready = Callable[[], AbstractContextManager[object]]
"""What a process of a crew is in while it works."""


class LostError(Exception):
    """The process that was doing it has been ended."""


class Crew(Executor):
    """So many processes, on their way from `with` on. What one raises is raised by the future;
    LostError if it has been ended.

    ready: what every process is in while it works, a function of a module.
    """

    def __init__(self, count: int, ready: Ready) -> None:
        self._lanes = [_Lane(ready) for _ in range(count)]
        self._free: SimpleQueue[_Lane] = SimpleQueue()
        self._threads = ThreadPoolExecutor(count)

    def __enter__(self) -> Self:
        try:
            with held():
                for lane in self._lanes:
                    lane.begin()
                    self._free.put(lane)
        except BaseException:
            self.shutdown(cancel_futures=True)
            raise
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.shutdown(cancel_futures=kind is not None)

    def submit(self, work: Callable[..., Any], /, *given: Any, **named: Any) -> Future[Any]:
        """Do it as soon as a process is free, in the order of the calls."""
        return self._threads.submit(self._done, work, given, named)

    def _done(self, *work: Any) -> Any:
        lane = self._free.get()
        try:
            return lane.done(*work)
        finally:
            self._free.put(lane)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes: when what they do is over, or at once if `cancel_futures`."""
        if cancel_futures:
            for lane in self._lanes:
                lane.kill()
        self._threads.shutdown(wait, cancel_futures=cancel_futures)
        for lane in self._lanes:
            lane.end()


class _Lane:
    """One process after the other, and the line to it."""

    def __init__(self, ready: Ready) -> None:
        self._ready = ready
        self._process: Any = None
        self._line: Any = None
        self._over = False
        self._starts = threading.Lock()

    def begin(self) -> None:
        """Start a process; LostError if there are to be no more."""
        with self._starts, _own_start():
            if self._over:
                raise LostError
            context: Any = multiprocessing.get_context(METHOD)
            self._line, theirs = context.Pipe()
            given = theirs, self._ready, dict(os.environ)
            self._process = context.Process(target=_serve, args=given)
            self._process.start()
            theirs.close()

    def done(self, *work: Any) -> Any:
        """What came of it."""
        if self._process is None:
            self.begin()
        try:
            self._line.send(work)
            if self._line not in connection.wait([self._line, self._process.sentinel]):
                raise EOFError
            value, error = self._line.recv()
        except (EOFError, OSError) as ended:
            self.end()
            raise LostError from ended
        if error is not None:
            raise error
        return value

    def kill(self) -> None:
        """End its process at once, for good."""
        with self._starts:
            self._over = True
            if self._process is not None:
                self._process.terminate()

    def end(self) -> None:
        """End its process when it has nothing to do."""
        if self._process is not None:
            self._line.close()
            self._process.join()
            self._process = None


# ---- in the process


def _serve(line: Any, ready: Ready, environment: Mapping[str, str]) -> None:
    """Do what comes through the line until it is closed; Ctrl-C is for the one at its other end."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    os.environ.update(environment)  # the process that this one is forked from has that of its start
    with ready():
        while True:
            try:
                order = line.recv()
            except EOFError:
                return
            line.send(_outcome(*order))


def _outcome(work: Callable[..., Any], given: Any, named: Any) -> tuple[Any, BaseException | None]:
    """What came of it, and what it raised."""
    try:
        return work(*given, **named), None
    except BaseException as error:
        error.add_note(traceback.format_exc())
        return None, error


# ---- how it starts


def prepare(*modules: str) -> None:
    """Start the process that all others are forked from, without waiting until it has imported
    these modules.
    """
    if METHOD != "forkserver":
        return
    # its socket lies in a folder that a killed process would leave behind
    process: Any = multiprocessing.current_process()
    process._config["tempdir"] = str(_private(os.getpid()).path)
    multiprocessing.get_context(METHOD).set_forkserver_preload(list(modules))
    with _own_start():
        forkserver.ensure_running()


@cache
def _private(_: int) -> PrivateFolder:
    """Of the process with this number, for the socket of its server, which stays."""
    folder = PrivateFolder()
    atexit.register(folder.close)
    return folder


_ONE = threading.Lock()
_served = os.getpid()
"""The process whose server is known."""


def _forget_inherited() -> None:
    """In a fork of that process its server is nobody's child."""
    global _served  # noqa: PLW0603 - there is one server
    if _served != os.getpid():
        server: Any = forkserver._forkserver
        server._forkserver_pid = server._forkserver_address = server._forkserver_alive_fd = None
        _served = os.getpid()


@contextmanager
def _own_start() -> Iterator[None]:
    """Processes that are started here do not run the script again that has called us (what they do
    is in modules of ours and in files that they read), never see SIGINT, which reaches us
    afterwards, and have ENVIRONMENT where it is not set otherwise.
    """
    with _ONE, ExitStack() as life:
        life.callback(sys.modules.__setitem__, "__main__", sys.modules["__main__"])
        sys.modules["__main__"] = ModuleType("__main__")
        if os.name == "posix":
            resource_tracker.ensure_running()  # it would lift the mask again
            before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            life.callback(signal.pthread_sigmask, signal.SIG_SETMASK, before)
        for name in ENVIRONMENT.keys() - os.environ.keys():
            life.callback(os.environ.pop, name)
            os.environ[name] = str(ENVIRONMENT[name])
        _forget_inherited()
        yield
