# SPDX-License-Identifier: BSD-2-Clause
"""Boards that are this process: the board's end of the protocol in a thread of its own."""

from __future__ import annotations

import socket
import threading
from contextlib import contextmanager, suppress

import pytest

from harness.files.paths import fmus
from harness.master.serve import Board
from tests.link.frames import Peer
from tests.shared import shared

PATIENCE = 20.0
"""After which a test that waits for a frame fails [s]."""


@pytest.fixture(scope="session", autouse=True)
def cache(tmp_path_factory):
    """A cache for the tests alone, one for all workers."""
    folder = shared(tmp_path_factory, "cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HARNESS_CACHE", str(folder))
        yield folder


@contextmanager
def answering(fmu):
    """A socket whose other end is a board with this FMU."""
    ours, theirs = socket.socketpair()
    ours.settimeout(PATIENCE)
    with Board(fmu) as board, ours:
        worker = threading.Thread(target=_answer, args=(board, theirs), daemon=True)
        worker.start()
        yield ours
        ours.close()
        worker.join(PATIENCE)
        assert not worker.is_alive(), "the board does not notice that its peer has gone"


def _answer(board, connection):
    with connection, suppress(OSError):
        board.answer(connection.recv, connection.sendall)


@pytest.fixture
def peer():
    """Peer of a board with the adaptive controller."""
    with answering(fmus()["adaptive_controller"]) as connection:
        yield Peer(connection)


class Listener:
    """A board behind a TCP port of this machine, for one link after the other.

    bend(data, towards) returns the bytes that are to arrive in place of those that were sent;
    towards: "board" or "link".
    """

    def __init__(self, fmu, bend=None):
        self.board, self.bend = Board(fmu), bend or (lambda data, towards: data)
        self.socket = socket.create_server(("127.0.0.1", 0))
        self.worker = threading.Thread(target=self._serve, daemon=True)
        self.failures = []

    @property
    def place(self):
        return f"tcp://127.0.0.1:{self.socket.getsockname()[1]}"

    def __enter__(self):
        self.worker.start()
        return self

    def __exit__(self, *_):
        self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()
        self.worker.join(PATIENCE)
        assert not self.worker.is_alive()
        self.board.__exit__()

    def _serve(self):
        while True:
            try:
                connection, _ = self.socket.accept()
            except OSError:
                return
            with connection, suppress(OSError):
                self.board.answer(
                    lambda most, c=connection: self._received(c, most),
                    lambda data, c=connection: c.sendall(self.bend(data, "link")),
                )

    def _received(self, connection, most):
        """Damage may leave nothing of what has come: then there is more to come."""
        while data := connection.recv(most):
            if bent := self.bend(data, "board"):
                return bent
        return b""


@pytest.fixture
def board():
    """Boards with the adaptive controller on TCP ports."""
    return lambda bend=None: Listener(fmus()["adaptive_controller"], bend)


def simulated_twice_from(simulation, step, further):
    """The result of a simulation that has gone on to `further` and back to `step`."""
    simulation.advance(to=step)
    snapshot = simulation.save()
    simulation.advance(to=further)
    simulation.restore(snapshot)
    simulation.free(snapshot)
    simulation.advance()
    return simulation.result()
