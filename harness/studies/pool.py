# SPDX-License-Identifier: BSD-2-Clause
"""Pool of worker processes on this machine. A worker that is killed, or crashes inside an FMU,
loses its present task and is replaced. No other user can reach a worker.
"""

from __future__ import annotations

import atexit
import logging
import multiprocessing
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from functools import cache
from multiprocessing import connection, forkserver, resource_tracker
from pathlib import Path
from queue import SimpleQueue
from types import ModuleType
from typing import Any, Self

from harness.files.output import PrivateFolder
from harness.files.signals import held
from harness.master.child import end_with_parent

_log = logging.getLogger("harness")

RETAINED = 32 << 20
ENVIRONMENT = {
    "MALLOC_ARENA_MAX": 1,
    "MALLOC_TRIM_THRESHOLD_": 8 * RETAINED,
    "MALLOC_MMAP_THRESHOLD_": RETAINED,
    **dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), 1),
}
"""Environment of a worker. It performs one run after the other and retains their memory, so that it
need not return pages and request them again (glibc retains at most 32 MiB, and separate heaps of
threads of 64 MiB appear and vanish). There is one worker per processor, so linear algebra has one
thread.
"""
FILES, FILES_OF_A_PROCESS = 16, 4
"""Free file descriptors that a start needs: of the server, of a process."""
METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
CRASH = "its process was ended from outside, or by a crash inside an FMU"
"""Message of a run whose process was ended."""
LOOK_SECONDS = 1.0
"""Time between two checks for processes that are stopped (SIGSTOP)."""
GRACE_SECONDS = 5.0
"""Time that a process has to end by itself after Ctrl-C."""

Ready = Callable[[], AbstractContextManager[object]]
"""Function that returns the context in which a worker performs its tasks."""


class LostWorkerError(Exception):
    """End of the process of a task."""


class WorkerPool(Executor):
    """Pool of `count` worker processes, started on entry. A future raises the exception of its
    task, or LostWorkerError if its process was ended.

    ready: returns the context in which every worker performs its tasks; a function of a module.
    """

    def __init__(self, count: int, ready: Ready) -> None:
        self._workers = [_Worker(ready) for _ in range(count)]
        self._free: SimpleQueue[_Worker] = SimpleQueue()
        self._threads = ThreadPoolExecutor(count)
        self._over = threading.Event()

    def __enter__(self) -> Self:
        try:
            with (
                ExitStack() as files
            ):  # a fork server without free descriptors ends with a traceback
                for _ in range(FILES + FILES_OF_A_PROCESS * len(self._workers)):
                    files.callback(os.close, os.dup(2))
            with held():
                for worker in self._workers:
                    worker.begin()
                    self._free.put(worker)
        except BaseException:
            self.shutdown(cancel_futures=True)
            raise
        threading.Thread(target=self._watch, daemon=True).start()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        self.shutdown(cancel_futures=kind is not None)

    def submit(self, work: Callable[..., Any], /, *given: Any, **named: Any) -> Future[Any]:
        """Schedule a task for the next free worker, in the order of the calls."""
        return self._threads.submit(self._done, work, given, named)

    def _done(self, *work: Any) -> Any:
        worker = self._free.get()
        try:
            return worker.done(*work)
        finally:
            self._free.put(worker)

    def _watch(self) -> None:
        """Report every worker that is stopped (SIGSTOP), because its runs wait."""
        known: set[int] = set()
        while not self._over.wait(LOOK_SECONDS):
            stopped = {worker.stopped for worker in self._workers} - {0}
            for pid in stopped - known:
                note = "worker %d is stopped, its runs wait: `kill -CONT %d` continues it"
                _log.warning(note, pid, pid)
            known = stopped

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End all processes after their tasks, or at once if `cancel_futures`; kill those that do
        not react within GRACE_SECONDS.
        """
        if cancel_futures:
            with held():  # a second Ctrl-C waits until the end of the grace period
                self._threads.shutdown(wait=False, cancel_futures=True)
                end = time.monotonic() + GRACE_SECONDS
                for worker in self._workers:
                    worker.terminate()
                for worker in self._workers:
                    worker.kill(end)
        self._threads.shutdown(wait)
        for worker in self._workers:
            worker.end()
        self._over.set()


class _Worker:
    """Worker: a process that is replaced when it ends, and the pipe to it."""

    def __init__(self, ready: Ready) -> None:
        self._ready = ready
        self._process: Any = None
        self._line: Any = None
        self._over = False
        self._starts = threading.Lock()

    def begin(self) -> None:
        """Start a process; raise LostWorkerError after terminate()."""
        with self._starts, _own_start():
            if self._over:
                raise LostWorkerError
            context: Any = multiprocessing.get_context(METHOD)
            self._line, theirs = context.Pipe()
            given = theirs, self._ready, dict(os.environ)
            process = context.Process(target=_serve, args=given)
            process.start()
            self._process = process
            theirs.close()

    def done(self, *work: Any) -> Any:
        """Return the task's result."""
        if self._process is None:
            self.begin()
        try:
            self._line.send(work)
            if self._line not in connection.wait([self._line, self._process.sentinel]):
                raise EOFError
            value, error = self._line.recv()
        except (EOFError, OSError) as ended:
            self.end()
            raise LostWorkerError from ended
        if error is not None:
            raise error
        return value

    def terminate(self) -> None:
        """End the process, and start no other one."""
        with self._starts:
            self._over = True
            if self._process is not None:
                self._process.terminate()

    def kill(self, end: float) -> None:
        """Kill the process if it has not ended at this time of the monotonic clock."""
        process, left = self._process, max(0.0, end - time.monotonic())
        if process is not None and not connection.wait([process.sentinel], left):
            process.kill()

    @property
    def stopped(self) -> int:
        """Return the number of the process while it is stopped, as Linux reports it, else 0."""
        pid = getattr(self._process, "pid", None) or 0
        try:
            state = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(") ")[2][0]
        except OSError:
            return 0
        return pid if state == "T" else 0

    def end(self) -> None:
        """End the process after its task; kill it if it is stopped and cannot end by itself. A
        fork server that is stopped is continued, because it reports the end.
        """
        if self._process is not None:
            self._line.close()
            while not connection.wait([self._process.sentinel], LOOK_SECONDS):
                if self.stopped:
                    self._process.kill()
                if server := getattr(forkserver._forkserver, "_forkserver_pid", None):
                    with suppress(ProcessLookupError):
                        os.kill(server, signal.SIGCONT)
            self._process.join()
            self._process = None


# ---- inside the worker process


def _serve(line: Any, ready: Ready, environment: Mapping[str, str]) -> None:
    """Perform the tasks from the pipe until it is closed; the parent process handles Ctrl-C."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    os.environ.update(environment)  # the fork server has an older environment
    with ready():
        while True:
            try:
                order = line.recv()
            except EOFError:
                return
            line.send(_outcome(*order))


def _outcome(work: Callable[..., Any], given: Any, named: Any) -> tuple[Any, BaseException | None]:
    """Return the result of a task and None, or None and the exception that it raised."""
    try:
        return work(*given, **named), None
    except BaseException as error:
        error.add_note(traceback.format_exc())
        return None, error


# ---- start


def prepare(*modules: str) -> None:
    """Start the fork server without waiting until it has imported these modules."""
    if METHOD != "forkserver":
        return
    # the folder of its socket would remain if the process were killed
    process: Any = multiprocessing.current_process()
    process._config["tempdir"] = str(_private(os.getpid()).path)
    multiprocessing.get_context(METHOD).set_forkserver_preload(list(modules))
    with _own_start():
        forkserver.ensure_running()


@cache
def _private(_: int) -> PrivateFolder:
    """Return a permanent folder for the socket of the fork server of the process with
    this number.
    """
    folder = PrivateFolder()
    atexit.register(folder.close)
    return folder


_ONE = threading.Lock()
_served = os.getpid()
"""Number of the process that started the known fork server."""


def _forget_inherited() -> None:
    """Forget the fork server of the parent process, which is not a child of this process."""
    global _served  # noqa: PLW0603 - there is one server
    if _served != os.getpid():
        server: Any = forkserver._forkserver
        server._forkserver_pid = server._forkserver_address = server._forkserver_alive_fd = None
        _served = os.getpid()


@contextmanager
def _own_start() -> Iterator[None]:
    """Start processes inside the block that do not run the user's script again (their tasks are in
    our modules and in files that they read), never receive SIGINT, which reaches this process
    afterwards, and have ENVIRONMENT unless it is set otherwise.
    """
    with _ONE, ExitStack() as life:
        life.callback(sys.modules.__setitem__, "__main__", sys.modules["__main__"])
        sys.modules["__main__"] = ModuleType("__main__")
        if os.name == "posix":
            resource_tracker.ensure_running()  # its start would unblock SIGINT
            before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            life.callback(signal.pthread_sigmask, signal.SIG_SETMASK, before)
        for name in ENVIRONMENT.keys() - os.environ.keys():
            life.callback(os.environ.pop, name)
            os.environ[name] = str(ENVIRONMENT[name])
        _forget_inherited()
        yield
