# SPDX-License-Identifier: BSD-2-Clause
"""Pool of worker processes on this machine. When a worker process is killed or crashes inside an
FMU, the task that it performs fails and a new process replaces it. Other users of the machine
cannot connect to a worker.
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
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from functools import cache
from multiprocessing import connection, forkserver, resource_tracker
from queue import SimpleQueue
from types import ModuleType
from typing import Any, Self

from harness.files.output import PrivateFolder, process_state
from harness.files.signals import held
from harness.master.child import end_with_parent

_log = logging.getLogger("harness")

RETAINED = 32 << 20
"""Largest memory block that malloc of a worker takes from its heap [bytes]. glibc permits no larger
value.
"""
ENVIRONMENT = {
    "MALLOC_ARENA_MAX": 1,
    "MALLOC_TRIM_THRESHOLD_": 8 * RETAINED,
    "MALLOC_MMAP_THRESHOLD_": RETAINED,
    **dict.fromkeys(("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"), 1),
}
"""Environment variables of a worker.

A worker performs one run after the other. The MALLOC variables make malloc reuse the memory of a
run for the next run instead of returning pages to the operating system and requesting them again;
all threads share one heap. The other variables limit linear algebra to one thread, because there is
one worker per processor.
"""
FILES, FILES_OF_A_PROCESS = 16, 4
"""File descriptors that must be free to start the fork server, and to start one worker process."""
METHOD = "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
"""Method of the package multiprocessing by which workers are started."""
CRASH = "the process of this run was killed from outside, or crashed inside an FMU"
"""Message of a run whose process has ended before the run was complete."""
LOOK_SECONDS = 1.0
"""Time between two checks for processes that are stopped (SIGSTOP) [s]."""
GRACE_SECONDS = 5.0
"""Time that a terminated process (SIGTERM) has to end, before it is killed [s]."""

Ready = Callable[[], AbstractContextManager[object]]
"""Function that returns a context manager; a worker performs its tasks inside this context."""


class LostWorkerError(Exception):
    """Error of a task whose worker process has ended before the task was complete."""


class WorkerPool:
    """Pool of `count` worker processes, started on entry. The future of a task raises the exception
    of the task, or LostWorkerError if the worker process has ended.

    ready: function that returns the context manager inside which each worker performs its tasks. It
    must be defined at the top level of a module, so that it can be pickled.
    """

    def __init__(self, count: int, ready: Ready) -> None:
        self.count = count
        self._workers = [_Worker(ready) for _ in range(count)]
        self._free: SimpleQueue[_Worker] = SimpleQueue()
        self._threads = ThreadPoolExecutor(count)
        self._over = threading.Event()

    def __enter__(self) -> Self:
        try:
            # fail here if too few file descriptors are free, before the fork server fails
            with ExitStack() as files:
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

    def submit(self, work: Callable[..., Any], *given: Any) -> Future[Any]:
        """Schedule the task work(*given) for the next free worker, in the order of the calls;
        return its future.
        """
        return self._threads.submit(self._done, work, given)

    def _done(self, *work: Any) -> Any:
        worker = self._free.get()
        try:
            return worker.done(*work)
        finally:
            self._free.put(worker)

    def _watch(self) -> None:
        """Log a warning for every worker that is stopped (SIGSTOP), until the pool ends."""
        known: set[int] = set()
        while not self._over.wait(LOOK_SECONDS):
            stopped = {worker.stopped for worker in self._workers} - {0}
            for pid in stopped - known:
                note = "worker process %d is stopped and its runs wait; continue it: kill -CONT %d"
                _log.warning(note, pid, pid)
            known = stopped

    def shutdown(self, cancel_futures: bool) -> None:
        """End all worker processes after the submitted tasks. With `cancel_futures` terminate the
        processes at once, and kill each process that has not ended within GRACE_SECONDS.
        """
        if cancel_futures:
            with held():  # a second Ctrl-C takes effect after the grace period
                self._threads.shutdown(wait=False, cancel_futures=True)
                end = time.monotonic() + GRACE_SECONDS
                for worker in self._workers:
                    worker.terminate()
                for worker in self._workers:
                    worker.kill(end)
        self._threads.shutdown()
        for worker in self._workers:
            worker.end()
        self._over.set()


class _Worker:
    """Worker of a pool: a process, which is replaced when it ends, and the pipe to the process."""

    def __init__(self, ready: Ready) -> None:
        self._ready = ready
        self._process: Any = None
        self._line: Any = None
        self._over = False
        self._starts = threading.Lock()

    def begin(self) -> None:
        """Start the process; raise LostWorkerError if terminate() has been called."""
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
        """Perform a task in the worker process and return its result; work = (function, arguments).

        Raises the exception of the task, or LostWorkerError if the process ends.
        """
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
        """Terminate the process, and prevent the start of another one."""
        with self._starts:
            self._over = True
            if self._process is not None:
                self._process.terminate()

    def kill(self, end: float) -> None:
        """Wait until the process has ended, at most until the time `end` of the monotonic clock
        [s]; then kill it.
        """
        process, left = self._process, max(0.0, end - time.monotonic())
        if process is not None and not connection.wait([process.sentinel], left):
            process.kill()

    @property
    def stopped(self) -> int:
        """Return the process id if Linux reports the process as stopped (SIGSTOP), otherwise 0."""
        pid = getattr(self._process, "pid", None) or 0
        return pid if process_state(pid) == "T" else 0

    def end(self) -> None:
        """Close the pipe and wait until the process has ended; kill a process that is stopped
        (SIGSTOP). If the fork server is stopped, continue it, because it reports the end of the
        process.
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
    """Perform the tasks that arrive in the pipe `line` until the parent process closes it or is
    killed. Ctrl-C is ignored, because the parent process handles it.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    os.environ.update(environment)  # the fork server was started with an older environment
    with ready(), suppress(EOFError, ConnectionError):  # the parent process has ended
        while True:
            order = line.recv()
            line.send(_outcome(*order))


def _outcome(work: Callable[..., Any], given: Any) -> tuple[Any, BaseException | None]:
    """Return the result of a task and None, or None and the exception that it raised."""
    try:
        return work(*given), None
    except BaseException as error:
        error.add_note(traceback.format_exc())
        return None, error


# ---- start


def prepare(*modules: str) -> None:
    """Start the fork server, which imports these modules for all workers; return at once, before
    the imports are complete. Do nothing on a system without fork server.
    """
    if METHOD != "forkserver":
        return
    # the default folder of the server's socket would remain if this process were killed
    process: Any = multiprocessing.current_process()
    process._config["tempdir"] = str(_private(os.getpid()).path)
    multiprocessing.get_context(METHOD).set_forkserver_preload(list(modules))
    with _own_start():
        forkserver.ensure_running()


@cache
def _private(_: int) -> PrivateFolder:
    """Create and return the folder for the socket of the fork server; it is removed when this
    process ends. The argument is the id of this process, so that the cached folder is not used in a
    forked child.
    """
    # the path of a socket may have 103 bytes on macOS, 107 on Linux
    folder = PrivateFolder(103 - len("/listener-01234567"))
    atexit.register(folder.close)
    return folder


_ONE = threading.Lock()
_served = os.getpid()
"""Id of the process whose fork server this module uses."""


def _forget_inherited() -> None:
    """Forget a fork server that was inherited from the parent process, because a process can use
    only a fork server that it has started itself.
    """
    global _served  # noqa: PLW0603 - there is one server
    if _served != os.getpid():
        server: Any = forkserver._forkserver
        server._forkserver_pid = server._forkserver_address = server._forkserver_alive_fd = None
        _served = os.getpid()


@contextmanager
def _own_start() -> Iterator[None]:
    """Prepare this process for starting worker processes inside the `with` block.

    Workers that are started there do not run the user's script again: their tasks are functions of
    this package, which import the user's files where needed. The workers never receive SIGINT; a
    SIGINT that arrives during the block reaches this process after it. The workers get those
    variables of ENVIRONMENT that the user has not set.
    """
    with _ONE, ExitStack() as life:
        life.callback(sys.modules.__setitem__, "__main__", sys.modules["__main__"])
        sys.modules["__main__"] = ModuleType("__main__")
        if os.name == "posix":
            resource_tracker.ensure_running()  # unblocks SIGINT, so it precedes the next line
            before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            life.callback(signal.pthread_sigmask, signal.SIG_SETMASK, before)
        for name in ENVIRONMENT.keys() - os.environ.keys():
            life.callback(os.environ.pop, name)
            os.environ[name] = str(ENVIRONMENT[name])
        _forget_inherited()
        yield
