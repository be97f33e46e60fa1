# SPDX-License-Identifier: BSD-2-Clause
"""A process that has collected the tests once and runs some of them in a fork for every fault.

    python -m tests.mutation.python_runner SOCKET FOLDER

A fault inside of functions is put into the functions of the fork: their code is replaced. One
elsewhere is run by a fork that has read nothing of `harness` yet and collects the files that it
needs. Processes that a test starts read the fault from the sources, which contain it meanwhile.
"""

from __future__ import annotations

import gc
import inspect
import os
import resource
import shutil
import signal
import socket
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from types import CodeType, FunctionType
from typing import Any

import psutil
import pytest

READ_BEFOREHAND = (
    "fmpy.fmi2", "hypothesis", "jinja2", "k3d", "matplotlib.pyplot", "netCDF4",
    "numpy", "pandas", "plotly.graph_objects", "psutil", "rich", "scipy.stats", "typer", "xarray",
    "zarr",
)  # fmt: skip
"""Large packages that tests import: in forks of a process that has read them they are there."""
OPTIONS = [
    "-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist", "-p", "no:cov", "--tb=short",
    "--assert=plain",
]  # fmt: skip
BYTES = 12 << 30
NOT_HERE = 77
"""Status of a fork that cannot take the fault into what it has read."""
STILL = 60
"""A fork of which so many looks in a row, one a second, found hardly any process at work waits for
something that does not come."""


def main() -> None:
    """Two processes answer in turn: one with all tests collected, one with libraries alone."""
    channel, folder = socket.socket(fileno=int(sys.argv[1])), Path(sys.argv[2])
    for name in READ_BEFOREHAND:
        import_module(name)
    mine, theirs = socket.socketpair()
    if os.fork() == 0:
        theirs.close()
        channel.close()
        _serve(mine, folder, fresh)
        os._exit(0)
    pytest.main([*OPTIONS, "tests/harness"], [_Collected(channel, theirs, folder)])


def lines(channel: socket.socket) -> Any:
    """Return the lines of a channel; each is the text of a Python value."""
    return channel.makefile("r", encoding="utf-8")


def say(channel: socket.socket, value: object) -> None:
    """One line."""
    channel.sendall((repr(value) + "\n").encode())


def _serve(channel: socket.socket, folder: Path, run: Any) -> None:
    """Answers orders until the channel is closed."""
    for line in lines(channel):
        order = eval(line)
        say(channel, _in_fork(order, folder, lambda order=order: run(order, folder)))


def _in_fork(order: dict, folder: Path, run: Any) -> tuple[str, str] | None:
    """The first test that fails and how, two empty texts if none does; None if the fault cannot be
    had this way.
    """
    place = Path(tempfile.mkdtemp(prefix="f", dir=folder))
    pid = os.fork()
    if pid == 0:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CPU, (order["seconds"], order["seconds"] + 5))
        resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.environ["TMPDIR"] = str(place)
        tempfile.tempdir = None
        status = 99
        try:
            status = run({**order, "place": place})
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(status)
    code = _end_of(pid, order["patience"])
    with suppress(ProcessLookupError):  # what a test has started and not ended
        os.killpg(pid, signal.SIGKILL)
    name, running = (_text(place / kind) for kind in ("failed", "running"))
    shutil.rmtree(place, ignore_errors=True)
    if code == NOT_HERE:
        return None
    if name or code in (0, int(pytest.ExitCode.NO_TESTS_COLLECTED)):
        return name, ""
    return running, f": signal {-code}" if code < 0 else f": status {code}"


def _text(file: Path) -> str:
    return file.read_text() if file.is_file() else ""


def _end_of(pid: int, patience: float) -> int:
    """Return the end of a fork; it is ended after its time, or when nothing moves in it."""
    began, still = time.monotonic(), 0
    while True:
        done, status = os.waitpid(pid, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        waited = time.monotonic() - began
        if waited > 10:
            still = 0 if _at_work(pid) else still + 1
        if still > STILL or waited > patience:
            os.killpg(pid, signal.SIGKILL)
            still = -(10**6)
        time.sleep(0.02 if waited < 10 else 1.0)


def _at_work(pid: int) -> bool:
    with suppress(psutil.Error):
        one = psutil.Process(pid)
        states = [p.status() for p in (one, *one.children(recursive=True))]
        return any(state in (psutil.STATUS_RUNNING, psutil.STATUS_DISK_SLEEP) for state in states)
    return True


# ---- plugins of pytest


class _Reporter:
    """Writes names where the parent looks: of the test that runs, and of the first that fails."""

    def __init__(self, place: Path) -> None:
        self.file, self.running = place / "failed", place / "running"

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self.running.write_text(nodeid)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and not self.file.exists():
            self.file.write_text(report.nodeid)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed and not self.file.exists():
            self.file.write_text(report.nodeid or "collection")


class _Collected:
    """Plugin that waits for orders instead of running the tests."""

    def __init__(self, channel: socket.socket, other: socket.socket, folder: Path) -> None:
        self.channel, self.other, self.folder = channel, other, folder
        self.answers = lines(other)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> Any:
        items = {item.nodeid: item for item in session.items}
        _third_party_fmus(self.folder)
        say(self.channel, "ready")
        for line in lines(self.channel):
            order = eval(line)
            found = None
            if not order["fresh"]:
                found = _in_fork(order, self.folder, lambda o=order: self._run(session, items, o))
            if found is None:
                say(self.other, order)
                found = eval(self.answers.readline())
            say(self.channel, found)
        os._exit(0)

    def _run(self, session: pytest.Session, items: dict[str, pytest.Item], order: dict) -> int:
        if not taken(order["file"], order["old"], order["new"]):
            return NOT_HERE
        factory = session.config._tmp_path_factory  # type: ignore[attr-defined]
        factory._given_basetemp, factory._basetemp = order["place"] / "t", None
        session.config.pluginmanager.register(_Reporter(order["place"]))
        session.items = [items[name] for name in order["tests"] if name in items]
        session.config.pluginmanager.unregister(self)
        with suppress(session.Failed, session.Interrupted):
            session.config.hook.pytest_runtestloop(session=session)
        return 1 if session.testsfailed else 0


def _third_party_fmus(folder: Path) -> None:
    """The third-party FMUs of the tests are compiled once: nothing of `harness` has a part in
    it.
    """
    from tests.harness import conftest, third_party_fmu

    made = Path(tempfile.mkdtemp(prefix="fmus", dir=folder))
    ready = {model.name: third_party_fmu.build(model, made) for model in third_party_fmu.MODELS}
    conftest.build = lambda model, place: shutil.copy(ready[model.name], place)  # type: ignore


class _Chosen:
    """These tests and no others, in this order."""

    def __init__(self, names: list[str]) -> None:
        self.order = {name: k for k, name in enumerate(names)}

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        items[:] = sorted(
            (item for item in items if item.nodeid in self.order),
            key=lambda item: self.order[item.nodeid],
        )


def fresh(order: dict, _: Path) -> int:
    """Tests of a process that reads `harness` only now."""
    files = dict.fromkeys(name.partition("::")[0] for name in order["tests"])
    plugins = [_Chosen(order["tests"]), _Reporter(order["place"])]
    base = f"--basetemp={order['place'] / 't'}"
    return int(pytest.main([*OPTIONS, base, *files], plugins))


# ---- faults in what has been read


def taken(file: str, old: str, new: str) -> bool:
    """Gives the functions of a module that has been read the code of another source; returns
    whether that is all that differs. A module that has not been read takes it from the file.
    """
    if old == new or not any(getattr(m, "__file__", None) == file for m in sys.modules.values()):
        return True
    pairs = list(_differing(*(compile(s, file, "exec", dont_inherit=True) for s in (old, new))))
    if not pairs or None in pairs:
        return False
    live: dict[tuple, list[FunctionType]] = {}
    for x in gc.get_objects():
        if isinstance(x, FunctionType) and x.__code__.co_filename == file:
            live.setdefault(_place(x.__code__), []).append(x)
    for before, after in pairs:
        functions = live.get(_place(before), [])
        if not functions or any(f.__code__.co_code != before.co_code for f in functions):
            return False
        for function in functions:
            if after.co_freevars != function.__code__.co_freevars:
                return False
            function.__code__ = after
    return True


def _place(code: CodeType) -> tuple:
    return code.co_qualname, code.co_firstlineno


def _differing(old: CodeType, new: CodeType) -> Iterator[tuple[CodeType, CodeType] | None]:
    """Functions that differ, the outermost ones; None for what runs while a module is read."""
    if old == new:
        return
    if old.co_flags & inspect.CO_OPTIMIZED:  # a function
        yield old, new
        return
    before, after = _inner(old), _inner(new)
    if _bare(old) != _bare(new) or len(before) != len(after):
        yield None
        return
    for one, other in zip(before, after, strict=True):
        yield from _differing(one, other)


def _inner(code: CodeType) -> list[CodeType]:
    return [c for c in code.co_consts if isinstance(c, CodeType)]


def _bare(code: CodeType) -> tuple:
    constants = [None if isinstance(c, CodeType) else repr(c) for c in code.co_consts]
    return code.co_code, code.co_names, code.co_qualname, tuple(constants)


if __name__ == "__main__":
    main()
