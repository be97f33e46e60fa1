# SPDX-License-Identifier: BSD-2-Clause
"""Boards on a serial line and behind a Unix socket, and `harness serve` as a user starts it."""

from __future__ import annotations

import os
import pty
import socket
import subprocess
import sys
import threading
from contextlib import suppress

import pytest

from harness.errors import FmuError
from harness.files.paths import fmus
from harness.master.serve import StandIn
from tests.link.test_link import flown

STOP = 1.0


def test_a_board_on_a_serial_line_gives_the_same_bits():
    ours, theirs = pty.openpty()  # theirs has a path, as a device has

    def receive(most):
        try:
            return os.read(ours, most)
        except OSError:  # the link has closed the line
            return b""

    def send(data):
        while data:
            data = data[os.write(ours, data) :]

    with StandIn(fmus()["adaptive_controller"]) as board:
        worker = threading.Thread(target=board.answer, args=(receive, send), daemon=True)
        worker.start()
        try:
            found = flown(f"serial://{os.ttyname(theirs)}?baud=921600", STOP)
        finally:
            os.close(theirs)
            worker.join(20)
            os.close(ours)
    assert found.values.tobytes() == flown("", STOP).values.tobytes()


def test_a_serial_line_that_is_none_is_one_error(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(FmuError, match="is no serial line"):
        flown(f"serial://{tmp_path}/file")
    with pytest.raises(FmuError, match=r"cannot be opened \(No such file or directory\)"):
        flown(f"serial://{tmp_path}/nothing")


def test_a_board_behind_a_unix_socket_gives_the_same_bits(tmp_path):
    path = tmp_path / "board"
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(path))
    listener.listen()

    def serve():
        with suppress(OSError), listener.accept()[0] as connection:
            board.answer(connection.recv, connection.sendall)

    with listener, StandIn(fmus()["adaptive_controller"]) as board:
        worker = threading.Thread(target=serve, daemon=True)
        worker.start()
        found = flown(f"unix://{path}", STOP)
        worker.join(20)
    assert found.values.tobytes() == flown("", STOP).values.tobytes()


def test_harness_serve_is_a_board_for_one_link():
    command = [sys.executable, "-m", "harness", "serve", "adaptive_controller", "--once"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        name, _, place = process.stdout.readline().strip().partition(": ")
        found = flown(place, STOP)
        assert process.wait(20) == 0
    assert name == "adaptive_controller"
    assert found.values.tobytes() == flown("", STOP).values.tobytes()
