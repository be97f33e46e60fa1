# SPDX-License-Identifier: BSD-2-Clause
"""The FMU that represents a component: whole systems with the controller behind a TCP port, over a
line that damages, loses, doubles and delays.
"""

from __future__ import annotations

import ctypes
import os
import random
import socket
import subprocess
import sys
import threading
import time
import tomllib
from contextlib import contextmanager, suppress
from dataclasses import replace

import numpy as np
import pytest
from fmpy.fmi2 import fmi2CallbackFunctions, fmi2CallbackLoggerTYPE

from harness import Simulation, load, run
from harness.errors import FmuError, RunError, StructureError, UsageError
from harness.files.paths import built, fmus
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from harness.studies.check import check
from harness.system.schedule import Verb
from tests.each import each
from tests.harness.third_party_fmu import Model, build, u, y
from tests.link.conftest import PATIENCE, Listener, simulated_twice_from
from tests.link.frames import ANSWER, CODE, Frame, checksummed, opened

MIXED = Model(
    "mixed",
    [
        u("i", None, "Integer"),
        u("b", None, "Boolean"),
        y("n", None, "Integer"),
        y("off", None, "Boolean"),
        y("y"),
    ],
    outputs="n = i; off = !b; y = i + 0.5 * b;",
)
SYSTEM, STOP = "sync_approach", 3.0


@contextmanager
def moved(place, stop=STOP, **changes):
    """A simulation with the controller at a place ("" for: where it is)."""
    on = {"controller": place} if place else {}
    with load(SYSTEM) as system, Simulation(system, on=on, stop=stop, **changes) as simulation:
        yield simulation


def simulated(place, stop=STOP, **changes):
    with moved(place, stop, **changes) as simulation:
        simulation.advance()
        return simulation.result()


@pytest.fixture(scope="module")
def required():
    return simulated("")


def assert_same(result, required):
    assert result.values.tobytes() == required.values.tobytes()


def test_a_run_through_the_link_has_the_bits_of_a_run_without(board, required):
    with board() as found:
        assert_same(simulated(found.place), required)


def test_both_algorithms_and_executors_go_through_the_link(board):
    with board() as found:
        for how in (
            {"algorithm": "jacobi"},
            {"executor": "python"},
            {"set": ["servicer.mass_0=99"]},
        ):
            assert_same(simulated(found.place, 1.0, **how), simulated("", 1.0, **how))


def test_a_further_run_resets_the_board(board, required):
    with board() as found, moved(found.place) as simulation:
        for _ in range(3):
            result = simulation.run(on={"controller": found.place}, stop=STOP)
            assert_same(result, required)


def test_a_snapshot_of_the_system_continues_bit_for_bit(board, required):
    with board() as found, moved(found.place) as simulation:
        assert_same(simulated_twice_from(simulation, 11, 23), required)


def test_parameters_rejected_by_the_component_are_named(board):
    wrong = {"set": ["controller.Gamma_m=-1"]}
    with board() as found, pytest.raises(UsageError) as there:
        simulated(found.place, **wrong)
    with pytest.raises(UsageError, match=r"^--set controller\.Gamma_m=-1: must be >= 0$") as here:
        simulated("", **wrong)
    assert str(there.value) == str(here.value)


# ---- a line that does what it should not


def bend_with(chance, what, rate):
    """Damage of one kind to one in `rate` pieces of the stream, never the same for two seeds."""
    held = {"board": b"", "link": b""}

    def bend(data, towards):
        data, held[towards] = held[towards] + data, b""
        if chance.randrange(rate):
            return data
        if what == "corrupted":
            place = chance.randrange(len(data))
            return (
                data[:place] + bytes([data[place] ^ 1 << chance.randrange(8)]) + data[place + 1 :]
            )
        if what == "truncated":
            return data[: chance.randrange(len(data))]
        if what == "doubled":
            return data + data
        if what == "noisy":
            return chance.randbytes(30) + data
        held[towards] = data  # delayed: it comes with the next
        return b""

    return bend


@pytest.mark.parametrize("what", ["corrupted", "truncated", "doubled", "noisy", "delayed"])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_bad_line_costs_time_but_no_bit(board, required, what, seed):
    bend = bend_with(random.Random(seed), what, 12)
    with board(bend) as found:
        assert_same(simulated(f"{found.place}?timeout=0.05&retries=50"), required)


def test_a_line_that_only_damages_is_reported_as_one_error(board):
    bad = bend_with(random.Random(3), "corrupted", 1)
    with board(bad) as found, pytest.raises(FmuError) as caught:
        simulated(f"{found.place}?timeout=0.05&retries=2")
    assert "no answer to 'describe' in 3 attempts of at most 0.05 s each" in str(caught.value)


def after_steps(count, then):
    """Replace everything that is sent after so many exchanges by then(data)."""
    exchanges = []

    def bend(data, towards):
        if towards == "board" and data[5:6] == bytes([CODE["exchange"]]):
            exchanges.append(data)
        return data if len(exchanges) <= count else then(data)

    return bend


def gone(_):
    raise OSError


def test_a_lost_board_is_reported_as_one_error_and_the_rows_are_retained(board):
    with board(after_steps(7, gone)) as found, pytest.raises(RunError) as caught:
        simulated(found.place)
    assert "tcp://127.0.0.1:" in str(caught.value)
    assert ": the connection has ended (at t = " in str(caught.value)
    assert len(caught.value.partial.time) == 8


PROGRAM = """
import os, signal, socket, threading
from harness import run
from harness.errors import RunError
from harness.files.paths import fmus
from harness.master.serve import Board

signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # as in a program that is not Python
server = socket.socket(socket.AF_UNIX)
server.bind("board")
server.listen()
answers = []

def serve():
    connection, _ = server.accept()

    def send(data):
        connection.sendall(data)
        answers.append(data)
        if len(answers) == 12:
            connection.shutdown(socket.SHUT_RDWR)
            connection.close()

    with Board(fmus()["adaptive_controller"]) as board:
        try:
            board.answer(connection.recv, send)
        except OSError:
            pass

threading.Thread(target=serve, daemon=True).start()
place = "unix://" + os.path.abspath("board")
try:
    run("sync_approach", on={"controller": place}, stop=3.0, in_process=True)
except RunError as error:
    print(error)
"""


def test_a_board_that_has_gone_does_not_end_the_program_with_a_signal(tmp_path):
    """SIGPIPE of a write to a line without a reader is for the link alone."""
    paths = os.pathsep.join(p for p in sys.path if p)
    ended = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env=os.environ | {"PYTHONPATH": paths},
    )
    assert ended.returncode == 0, ended.stderr
    assert "/board: the connection has ended" in ended.stdout


def test_a_board_that_falls_silent_is_reported_as_one_error(board):
    with board(after_steps(7, lambda data: b"")) as found, pytest.raises(RunError) as caught:
        simulated(f"{found.place}?timeout=0.3&retries=1")
    assert "no answer to 'exchange' in 2 attempts of at most 0.3 s each" in str(caught.value)


def test_a_missing_peer_is_reported_as_one_error():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(FmuError) as caught:
        simulated(f"tcp://127.0.0.1:{port}")
    reported = (
        f"fmi2Instantiate: tcp://127.0.0.1:{port}: the connection failed (Connection refused)"
    )
    assert str(caught.value).endswith(f"cannot be loaded: {reported}")


def sound(_):
    return checksummed(Frame(CODE["exchange"] | ANSWER, 0, payload=b"abcd"))


@pytest.mark.parametrize(
    "words",
    [lambda _: b"SLNK", lambda _: b"x", sound, lambda chance: chance.randbytes(64)],
    ids=["beginnings of frames", "letters", "answers without a request", "noise"],
)
def test_a_board_that_sends_noise_is_as_silent_as_one_that_sends_nothing(words):
    """Endless, as far as the link can detect: until the link has gone, or the test is lost."""
    noise = words(random.Random(5)) * 4096

    def serve():
        with suppress(OSError), listener.accept()[0] as connection:
            connection.settimeout(PATIENCE)
            until = time.monotonic() + PATIENCE
            while time.monotonic() < until:
                connection.sendall(noise)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        worker = threading.Thread(target=serve, daemon=True)
        worker.start()
        port = listener.getsockname()[1]
        with pytest.raises(FmuError) as caught:
            simulated(f"tcp://127.0.0.1:{port}?timeout=0.05&retries=2")
        worker.join(PATIENCE)
    assert "no answer to 'describe' in 3 attempts of at most 0.05 s each" in str(caught.value)


def checked(place, **changes):
    """Return the report of `check` for the system with its controller there."""
    with pytest.raises(StructureError) as caught:
        check(SYSTEM, on={"controller": place}, **changes)
    return caught.value.problems


def test_check_requests_the_board(board):
    with board() as found:
        place = found.place
        assert str(check(SYSTEM, on={"controller": place})).startswith(f"{SYSTEM}: fine (")
        (reported,) = checked(place, set=["controller.Gamma_m=-1"])
    assert reported == "--set controller.Gamma_m=-1: must be >= 0"
    (reported,) = checked(place)
    assert reported.startswith("controller: adaptive_controller.fmu cannot be loaded: ")
    assert reported.endswith("the connection failed (Connection refused)")


def test_check_finds_the_wrong_board():
    with Listener(fmus()["pid_controller"]) as found:
        (reported,) = checked(found.place)
    assert "wrong interface: the board has pid_controller {" in reported


# ---- the wrong peer


class Impostor:
    """A peer that answers every frame with what answer(frame) gives, within a time [s]."""

    def __init__(self, answer, within):
        self.answer, self.socket = answer, socket.create_server(("127.0.0.1", 0))
        port = self.socket.getsockname()[1]
        self.place = f"tcp://127.0.0.1:{port}?timeout={within}&retries=1"

    def __enter__(self):
        self.worker = threading.Thread(target=self._serve, daemon=True)
        self.worker.start()
        return self

    def __exit__(self, *_):
        self.socket.shutdown(socket.SHUT_RDWR)
        self.socket.close()
        self.worker.join(10)

    def _serve(self):
        with suppress(OSError):
            connection, _ = self.socket.accept()
            with connection:
                held = b""
                while data := connection.recv(1 << 16):
                    held += data
                    while (found := opened(held))[0] is not None:
                        frame, held = found
                        connection.sendall(self.answer(frame))


def rejected(answer, within=20):
    with Impostor(answer, within) as peer, pytest.raises(FmuError) as caught:
        simulated(peer.place)
    return str(caught.value).partition("cannot be loaded: ")[2]


def reply(frame, **about):
    return Frame(frame.code | ANSWER, frame.sequence, **about)


def test_a_peer_of_another_version():
    text = rejected(lambda frame: checksummed(reply(frame, version=2)))
    assert text.endswith("the board uses version 2 of the protocol, this link version 1")


def test_a_peer_of_the_other_byte_order():
    for disguise in (lambda data: data, lambda data: b"KNLS" + data[4:]):
        text = rejected(
            lambda frame, d=disguise: d(checksummed(reply(frame), order=">")), within=0.3
        )
        assert text.endswith("the board sends numbers in big-endian order, not little-endian")


def test_a_peer_with_doubles_of_another_kind(board):
    description = bytes.fromhex("0100 01000000 00000100 01") + b"\xbf\x54\x7a\xe1" * 2 + bytes(12)
    payload = len(description).to_bytes(4, "little") + description
    text = rejected(lambda frame: checksummed(reply(frame, payload=payload)))
    assert text.endswith("the board does not use doubles of IEEE 754")


def test_a_peer_with_another_component():
    with Listener(fmus()["pid_controller"]) as found, pytest.raises(FmuError) as caught:
        simulated(found.place)
    assert "wrong interface: the board has pid_controller {" in str(caught.value)


def test_a_peer_that_answers_too_little():
    text = rejected(lambda frame: checksummed(reply(frame, payload=b"\x09\0\0\x00123456789")))
    assert text.endswith("the answer to 'describe' is malformed")
    text = rejected(lambda frame: checksummed(reply(frame, payload=b"\xff\xff\xff\xff")))
    assert text.endswith("the answer is malformed")


def test_a_peer_that_answers_nonsense_is_never_believed():
    """Sound frames of random content to every request, and noise: one error each, no wrong run."""
    chance = random.Random(8)
    for _ in range(8):
        text = rejected(
            lambda frame: chance.choice(
                [
                    chance.randbytes(50),
                    checksummed(reply(frame, payload=chance.randbytes(chance.randrange(60)))),
                    checksummed(reply(frame, status=chance.randrange(256))),
                ]
            ),
            within=0.1,
        )
        assert text.startswith("fmi2Instantiate: tcp://127.0.0.1:")


def test_fewer_values_than_requested_are_no_values(board):
    """A board of ours, whose answers to exchanges lose their last double on the way."""

    def bend(data, towards):
        frame, _ = opened(data) if towards == "link" else (None, b"")
        if frame is None or frame.code != CODE["exchange"] | ANSWER:
            return data
        short = frame.data[:-8]
        return checksummed(frame._replace(payload=len(short).to_bytes(4, "little") + short))

    with (
        board(bend) as found,
        pytest.raises(RunError, match="does not contain the requested values"),
    ):
        simulated(found.place)


def linked(simulation):
    return next(i for i in simulation.instances if i.name == "controller")


def test_a_warning_about_inputs_does_not_retain_the_state_from_being_saved(board):
    """Values that are set reach the board before its state is requested; a warning is no
    failure.
    """

    def bend(data, towards):
        frame, _ = opened(data) if towards == "link" else (None, b"")
        if frame is None or frame.code != CODE["set"] | ANSWER:
            return data
        warned.append(frame)
        return checksummed(frame._replace(status=1))

    warned = []
    with board(bend) as found, moved(found.place) as simulation:
        simulation.advance(10)
        warned.clear()
        linked(simulation).transfers[Verb.SET][0].write(simulation.bus)
        snapshot = simulation.save()
        assert len(warned) == 1
        simulation.advance()
        once = simulation.result().values.copy()
        simulation.restore(snapshot)
        simulation.advance()
        assert simulation.result().values.tobytes() == once.tobytes()


def test_a_state_that_was_written_down_continues_bit_for_bit(board):
    with board() as found, moved(found.place) as simulation:
        simulation.advance(10)
        snapshot, calls = simulation.save(), linked(simulation).calls
        place = simulation.instances.index(linked(simulation))
        state, size, read = snapshot.states[place], ctypes.c_size_t(), ctypes.c_void_p()
        calls.library.fmi2SerializedFMUstateSize(calls.handle, state, ctypes.byref(size))
        data = (ctypes.c_char * size.value)()
        assert calls.library.fmi2SerializeFMUstate(calls.handle, state, data, size) == 0
        simulation.advance()
        once = simulation.result().values.copy()
        put = ctypes.byref(read)
        assert calls.library.fmi2DeSerializeFMUstate(calls.handle, data, size, put) == 0
        states = (*snapshot.states[:place], read, *snapshot.states[place + 1 :])
        simulation.restore(replace(snapshot, states=states))
        simulation.advance()
        assert simulation.result().values.tobytes() == once.tobytes()
        calls.library.fmi2FreeFMUstate(calls.handle, ctypes.byref(read))


def test_a_state_that_is_not_there_or_does_not_fit_is_not_written_down(board):
    with board() as found, moved(found.place) as simulation:
        simulation.advance(1)
        library, handle = linked(simulation).calls.library, linked(simulation).calls.handle
        state, size = linked(simulation).save(simulation.time), ctypes.c_size_t()
        assert library.fmi2SerializedFMUstateSize(handle, state, ctypes.byref(size)) == 0
        space = (ctypes.c_char * size.value)()

        def written(state, space, size):
            return library.fmi2SerializeFMUstate(handle, state, space, ctypes.c_size_t(size))

        assert written(state, space, size.value - 1) == 3
        assert written(None, space, size.value) == 3
        assert written(state, None, size.value) == 3
        assert written(state, space, size.value) == 0
        again = ctypes.c_void_p()
        for damaged in (size.value - 1, 8, 0):
            given = ctypes.c_size_t(damaged)
            assert library.fmi2DeSerializeFMUstate(handle, space, given, ctypes.byref(again)) == 3
        assert library.fmi2DeSerializeFMUstate(handle, space, size, ctypes.byref(again)) == 0
        assert library.fmi2FreeFMUstate(handle, ctypes.byref(again)) == 0
        assert not again


@pytest.mark.parametrize("i", [-(2**31), -3, 0, 7, 2**31 - 1])
@pytest.mark.parametrize("b", [0, 1])
def test_whole_numbers_and_truth_values_go_through_the_link(tmp_path_factory, i, b):
    folder = tmp_path_factory.mktemp("typed")
    fmu = build(MIXED, folder)
    text = f"""
    name = "typed"
    [experiment]
    stop = 2.0
    step = 1.0
    [components]
    a = "mixed"
    [open]
    "a.i" = {i}
    "a.b" = {"true" if b else "false"}
    """
    write_ssp(system_of(tomllib.loads(text), {"mixed": fmu}), folder / "typed.ssp")
    with Listener(fmu) as found:
        result = run(folder / "typed.ssp", on={"a": found.place})
    assert result["a.n"].tolist() == [i] * 3
    assert result["a.off"].tolist() == [1 - b] * 3
    assert result["a.y"].tolist() == [i + 0.5 * b] * 3


# ---- what a user types


@each(
    ("place", "text"),
    [
        (
            "cortex-m9",
            "there is no such processor (close: cortex-m7, cortex-m4); expected cortex-m7",
        ),
        ("tcp://localhost", "expected tcp://HOST:PORT"),
        ("tcp://localhost:port", "expected tcp://HOST:PORT"),
        ("tcp://localhost:65536", "expected tcp://HOST:PORT"),
        ("tcp://[::1", "expected tcp://HOST:PORT"),
        ("serial://ttyACM0", "expected tcp://HOST:PORT"),
        ("tcp://a\nb:9", "expected tcp://HOST:PORT"),
        ("tcp://a\tb:9", "expected tcp://HOST:PORT"),
        ("unix:///a\r/b", "expected tcp://HOST:PORT"),
        ("tcp://localhost:1?late=never", "late expects wait, hold or stop, got never"),
        ("tcp://localhost:1?timeout=-1", "timeout expects seconds above 0, got -1"),
        ("tcp://localhost:1?timeouts=1", "there is no option timeouts (close: timeout)"),
    ],
)
def test_a_place_that_cannot_be_is_rejected_by_its_words(place, text):
    with pytest.raises(UsageError) as caught:
        simulated(place)
    assert f"--on controller={place}: " in str(caught.value)
    assert text in str(caught.value)


def test_a_component_that_is_not_there_is_rejected():
    with load(SYSTEM) as system, pytest.raises(UsageError, match=r"--on controlled: .*controller"):
        Simulation(system, on=["controlled=cortex-m7"])


def test_the_link_fmu_has_the_interface_of_its_component(board):
    from harness.master.changes import apply
    from harness.system.interface import read_interface

    with load(SYSTEM) as system:
        moved = apply(system, on={"controller": "tcp://localhost:1"})
        here, there = (read_interface(s.component("controller").fmu) for s in (system, moved))
    assert here.variables == there.variables
    assert here.model.guid == there.model.guid
    assert not there.model.coSimulation.providesDirectionalDerivative
    assert np.array_equal(list(here.units), list(there.units))


@pytest.mark.parametrize("resources", [None, b"", b"/", b"file:///"])
def test_resources_that_name_no_folder_are_reported_as_one_error(resources):
    """Under the sanitizers also: nothing is read before the path."""
    assert message_of(resources) == [b"fmi2Instantiate: /link.txt cannot be read"]


@pytest.mark.parametrize("name", ["09 az AZ", "é, 日本, ~", "100%", "%zz"])
def test_an_address_is_read_with_its_coded_characters(tmp_path, name):
    """Every digit of them, small and large."""
    folder = tmp_path / name
    folder.mkdir()
    (folder / "link.txt").write_text("no line of ours\n")
    coded = "".join(f"%{byte:02x}" if byte % 2 else f"%{byte:02X}" for byte in name.encode())
    uris = {folder.as_uri().encode(), f"{tmp_path.as_uri()}/{coded}/".encode()}
    for uri in uris | {uri.replace(b"file://", b"file://localhost") for uri in uris}:
        (line,) = message_of(uri)
        assert b"cannot be read" not in line
        assert line.startswith(b"fmi2Instantiate: ")


def message_of(resources):
    """Return the messages of the link for an address that leads to no component."""
    reported = []
    logger = fmi2CallbackLoggerTYPE(lambda _a, _b, _c, _d, text: reported.append(text))
    calls = fmi2CallbackFunctions(logger=logger)
    instantiate = ctypes.CDLL(str(built("link"))).fmi2Instantiate
    instantiate.restype = ctypes.c_void_p
    assert instantiate(b"x", 1, b"{guid}", resources, ctypes.byref(calls), 0, 0) is None
    return reported
