# SPDX-License-Identifier: BSD-2-Clause
"""Boards on a serial line and behind a Unix socket, and `harness serve` as a user starts it."""

from __future__ import annotations

import os
import pty
import socket
import stat
import subprocess
import sys
import threading
from contextlib import suppress
from pathlib import Path

import pytest

from harness.errors import FmuError, UsageError
from harness.files.paths import fmus
from harness.master.serve import Board, listening
from tests.link.test_link import simulated

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

    with Board(fmus()["adaptive_controller"]) as board:
        worker = threading.Thread(target=board.answer, args=(receive, send), daemon=True)
        worker.start()
        try:
            found = simulated(f"serial://{os.ttyname(theirs)}?baud=921600", STOP)
        finally:
            os.close(theirs)
            worker.join(20)
            os.close(ours)
    assert found.values.tobytes() == simulated("", STOP).values.tobytes()


def test_an_invalid_serial_line_is_reported_as_one_error(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(FmuError, match="is not a serial line"):
        simulated(f"serial://{tmp_path}/file")
    with pytest.raises(FmuError, match=r"cannot be opened \(No such file or directory\)"):
        simulated(f"serial://{tmp_path}/nothing")


def test_a_board_behind_a_unix_socket_gives_the_same_bits(tmp_path):
    path = tmp_path / "board"
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(path))
    listener.listen()

    def serve():
        with suppress(OSError), listener.accept()[0] as connection:
            board.answer(connection.recv, connection.sendall)

    with listener, Board(fmus()["adaptive_controller"]) as board:
        worker = threading.Thread(target=serve, daemon=True)
        worker.start()
        found = simulated(f"unix://{path}", STOP)
        worker.join(20)
    assert found.values.tobytes() == simulated("", STOP).values.tobytes()


def test_harness_serve_is_a_board_for_one_link():
    command = [sys.executable, "-m", "harness", "serve", "adaptive_controller", "--once"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        name, _, place = process.stdout.readline().strip().partition(": ")
        found = simulated(place, STOP)
        assert process.wait(20) == 0
    assert name == "adaptive_controller"
    assert place.startswith("unix:///")
    assert not Path(place.removeprefix("unix://")).parent.exists()
    assert found.values.tobytes() == simulated("", STOP).values.tobytes()


CONNECT = """import os, socket, sys
os.setuid(int(sys.argv[2]))
socket.socket(socket.AF_UNIX).connect(sys.argv[1])
"""


@pytest.mark.parametrize("named", [True, False])
def test_no_other_user_can_open_the_socket_of_a_served_fmu(tmp_path, named):
    """For any mask of new files; where the path was named its folder is open to all."""
    tmp_path.chmod(0o777)
    before = os.umask(0)
    try:
        with listening(tmp_path / "board" if named else None) as listener:
            place = Path(listener.getsockname())
            assert stat.S_ISSOCK(place.stat().st_mode)
            assert stat.S_IMODE(place.stat().st_mode) == 0o600
            assert named or stat.S_IMODE(place.parent.stat().st_mode) == 0o700
            if os.geteuid() == 0:
                user = [sys.executable, "-c", CONNECT, str(place)]
                done = subprocess.run([*user, "65534"], capture_output=True, text=True, check=False)
                assert "PermissionError" in done.stderr
                assert subprocess.run([*user, "0"], check=False).returncode == 0
    finally:
        os.umask(before)
    assert not place.exists()


def test_a_socket_that_cannot_be_made_is_reported_and_existing_files_stay(tmp_path):
    taken = tmp_path / "taken"
    taken.write_text("mine", encoding="utf-8")
    for path in (taken, tmp_path / "no folder" / "board", tmp_path / ("x" * 200)):
        with pytest.raises(UsageError, match="cannot listen on this socket"), listening(path):
            pass
    assert taken.read_text(encoding="utf-8") == "mine"
