# SPDX-License-Identifier: BSD-2-Clause
"""The board's end of the protocol, spoken to by an implementation of its own (frames.py)."""

from __future__ import annotations

import ctypes
import random
import socket
import struct
import threading
from contextlib import ExitStack

import pytest

from harness.files.paths import fmus
from harness.master.serve import _READ, _WRITE, Board, _Board, _Slot, _Software
from harness.system.interface import read_interface
from tests.fmu.driver import Kind, Unit
from tests.link.conftest import PATIENCE, answering
from tests.link.frames import (
    ANSWER,
    CODE,
    DAMAGED,
    MALFORMED,
    NO_COMPONENT,
    NO_SESSION,
    OTHER_VERSION,
    Frame,
    Peer,
    checksummed,
    getting,
    setting,
    stepping,
)

STEP = 0.1


@pytest.fixture(scope="module")
def kind(tmp_path_factory):
    return Kind("adaptive_controller", tmp_path_factory.mktemp("kind"))


@pytest.fixture
def twin(kind):
    """The same FMU called by FMI."""
    unit = Unit(kind, {}, {}, 0.0)
    yield unit
    unit.close()


def outputs_of(kind):
    return [r for name in kind.outputs for r in kind.references[name]]


def begin(peer):
    """A session up to the first step."""
    for code, payload in (
        ("describe", b""),
        ("reset", b""),
        ("enter", struct.pack("<dBd", 0, 1, 100)),
        ("initialize", b""),
    ):
        answer = peer.request(code, payload)
        assert answer.status == 0, answer.reported
    return answer


def exchange(kind, position, k):
    """Inputs as a set of neighbours, a step, all outputs."""
    values = dict(zip(kind.references["r_SN_N"], position, strict=True))
    return setting(values) + stepping(k * STEP, STEP) + getting(outputs_of(kind))


def doubles(data):
    return struct.unpack(f"<{len(data) // 8}d", data)


def test_it_describes_itself(peer):
    data = peer.request("describe").data
    components, variables, limit, saves, probe = struct.unpack_from("<HIIBd", data)
    interface = read_interface(fmus()["adaptive_controller"])
    assert (components, variables, limit, saves) == (1, len(interface.variables), 65536, 1)
    assert probe == -1.25e-3
    assert interface.model.guid.encode() in data
    assert b"adaptive_controller" in data


def test_an_exchange_gives_the_bits_of_the_fmu(peer, kind, twin):
    begin(peer)
    for k in range(5):
        position = (7158140.0, 20.0 + k, 0.3 * k)
        answer = peer.request("exchange", exchange(kind, position, k))
        twin.step(STEP, {"r_SN_N": position})
        assert doubles(answer.data) == tuple(
            value for name in kind.outputs for value in _flat(twin.get(name))
        )


def _flat(value):
    return value.tolist() if value.shape else [float(value)]


def test_set_step_get_is_an_exchange(peer, kind):
    begin(peer)
    required = peer.request("exchange", exchange(kind, (7158140.0, 21.0, 0.0), 0)).data
    begin(peer)
    values = dict(zip(kind.references["r_SN_N"], (7158140.0, 21.0, 0.0), strict=True))
    assert peer.request("set", setting(values)).status == 0
    assert peer.request("step", stepping(0, STEP)).status == 0
    assert peer.request("get", getting(outputs_of(kind))).data == required


def test_the_longest_request_reaches_the_fmu_with_every_value(monkeypatch):
    """As many neighbours as a payload holds."""
    most = (65536 - 2 - 7) // 8
    required = {1000 + k: 0.5 * k - 7.0 for k in range(most)}

    @ctypes.CFUNCTYPE(
        ctypes.c_int,
        ctypes.c_void_p,
        ctypes.POINTER(ctypes.c_uint32),
        ctypes.c_size_t,
        ctypes.POINTER(ctypes.c_double),
    )
    def set_real(_, references, count, values):
        given.append(dict(zip(references[:count], values[:count], strict=True)))
        return 0

    class Recording(Board):
        def __init__(self, fmu):
            super().__init__(fmu)
            self._software.set_real = ctypes.cast(set_real, ctypes.c_void_p).value

    given = []
    monkeypatch.setattr("tests.link.conftest.Board", Recording)
    with answering(fmus()["adaptive_controller"]) as connection:
        peer = Peer(connection)
        begin(peer)
        assert peer.request("set", setting(required)).status == 0
    assert given == [required]


def test_a_repeated_request_is_executed_once(peer, kind):
    begin(peer)
    request = Frame(CODE["exchange"], next(peer.sequence), exchange(kind, (7158140.0, 21.0, 0), 0))
    peer.send(checksummed(request) * 3)
    first, second, third = (peer.receive() for _ in range(3))
    assert first == second == third
    assert peer.request("step", stepping(STEP, STEP)).status == 0  # the time has advanced once


def test_an_old_request_is_dropped(peer, kind):
    begin(peer)
    old = Frame(CODE["exchange"], next(peer.sequence), exchange(kind, (7158140.0, 21.0, 0), 0))
    peer.send(checksummed(old))
    peer.receive()
    peer.request("step", stepping(STEP, STEP))
    peer.send(checksummed(old))
    assert peer.request("step", stepping(2 * STEP, STEP)).status == 0


@pytest.mark.parametrize("ahead", [-1, 2, 1 << 31])
def test_a_request_out_of_its_order_is_not_answered(peer, kind, ahead):
    """Neither the one before the last nor one after the next, with any request."""
    begin(peer)
    payload = exchange(kind, (7158140.0, 21.0, 0), 0)
    last = peer.request("exchange", payload)
    peer.send(checksummed(Frame(CODE["exchange"], (last.sequence + ahead) % 2**32, payload)))
    answer = peer.request("step", stepping(STEP, STEP))
    assert (answer.status, answer.sequence) == (0, last.sequence + 1)


def test_a_repeated_request_is_answered_by_its_own_component_or_not_at_all():
    """The board stores one answer: the answer of another component is never sent in its place."""
    names = ("adaptive_controller", "pid_controller")
    with ExitStack() as use:
        boards = [use.enter_context(Board(fmus()[name])) for name in names]
        ours, theirs = map(use.enter_context, socket.socketpair())
        use.callback(answering_together(boards, theirs).join, PATIENCE)
        use.callback(ours.shutdown, socket.SHUT_RDWR)
        ours.settimeout(PATIENCE)
        peer = Peer(ours)
        first = Frame(CODE["describe"], 100)
        second = first._replace(component=1)
        new = first._replace(sequence=101, code=CODE["reset"])
        for frame in (first, second, second, first, new):  # the answer to the fourth is lost
            peer.send(checksummed(frame))
        answers = [peer.receive() for _ in range(4)]
    assert [(answer.component, answer.sequence) for answer in answers] == [
        (0, 100),
        (1, 100),
        (1, 100),
        (0, 101),
    ]
    assert answers[1] == answers[2]
    assert b"pid_controller" in answers[1].data


def answering_together(boards, connection):
    """The thread in which one board with the FMUs of several answers."""

    def answer():
        serve = boards[0]._serve
        software = (_Software * len(boards))(*(board._software for board in boards))
        board = _Board(
            target=b"test",
            software=ctypes.cast(software, ctypes.POINTER(_Software)),
            slot=ctypes.cast((_Slot * len(boards))(), ctypes.POINTER(_Slot)),
            count=len(boards),
            read=_READ(lambda _port, to, most: connection.recv_into(view(to, most))),
            write=_WRITE(lambda _port, data, count: not connection.sendall(view(data, count))),
        )
        serve(ctypes.byref(board))

    def view(address, count):
        return (ctypes.c_char * count).from_address(address)

    worker = threading.Thread(target=answer, daemon=True)
    worker.start()
    return worker


def test_a_late_description_does_not_open_the_session_anew(peer):
    first = Frame(CODE["describe"], next(peer.sequence))
    peer.send(checksummed(first))
    peer.receive()
    peer.request("reset")
    old = Frame(CODE["enter"], next(peer.sequence), struct.pack("<dBd", 0, 1, 100))
    peer.send(checksummed(old))
    peer.receive()
    peer.request("initialize")
    peer.send(checksummed(first) + checksummed(old))  # both are older than the last
    assert peer.request("step", stepping(0, STEP)).status == 0


@pytest.mark.parametrize("place", [0, 4, 9, 13, 17, 20, 30, -1])
def test_a_damaged_request_is_rejected_and_can_be_sent_again(peer, kind, place):
    begin(peer)
    request = checksummed(
        Frame(CODE["exchange"], next(peer.sequence), exchange(kind, (7158140.0, 21.0, 0.0), 0))
    )
    damaged = bytearray(request)
    damaged[place] ^= 0x10
    peer.send(bytes(damaged))
    assert peer.receive().status == DAMAGED
    peer.send(request)
    answer = peer.receive()
    assert (answer.status, answer.code) == (0, CODE["exchange"] | ANSWER)


@pytest.mark.parametrize("retained", [1, 7, 19, 20, 21, 60])
def test_a_truncated_request_is_survived(peer, kind, retained):
    begin(peer)
    request = checksummed(
        Frame(CODE["exchange"], next(peer.sequence), exchange(kind, (7158140.0, 21.0, 0.0), 0))
    )
    peer.send(request[:retained] + request)
    answer = peer.receive()
    while answer.status == DAMAGED:
        answer = peer.receive()
    assert (answer.status, answer.code) == (0, CODE["exchange"] | ANSWER)


def test_the_fmu_states_why_it_rejects(peer, kind):
    begin(peer)
    rejected = peer.request("set", setting({kind.references["r_SN_N"][0]: float("nan")}))
    assert rejected.status == 3
    assert rejected.reported == "fmi2SetReal: r_SN_N[1]: must be finite"
    failed = peer.request("step", stepping(50, STEP))
    assert "the communication point is not the end of the last step" in failed.reported


def test_a_state_comes_back_bit_for_bit(peer, kind):
    begin(peer)
    peer.request("exchange", exchange(kind, (7158140.0, 21.0, 0.0), 0))
    state = peer.request("save").data
    required = peer.request("exchange", exchange(kind, (7158140.0, 22.0, 1.0), 1)).data
    peer.request("exchange", exchange(kind, (7158140.0, 5.0, 3.0), 2))
    assert peer.request("restore", state).status == 0
    assert peer.request("exchange", exchange(kind, (7158140.0, 22.0, 1.0), 1)).data == required


def test_a_damaged_state_is_rejected(peer):
    begin(peer)
    state = bytearray(peer.request("save").data)
    state[40] ^= 1
    answer = peer.request("restore", bytes(state))
    assert answer.status == 3
    assert "damaged" in answer.reported


def test_steps_are_counted_from_the_reset(peer):
    begin(peer)
    for k in range(3):
        peer.request("step", stepping(k * STEP, STEP))
    assert struct.unpack_from("<Q", peer.request("statistics").data) == (3,)
    peer.request("reset")
    assert struct.unpack_from("<Q", peer.request("statistics").data) == (0,)


def test_memory_matches_the_instance_alone(kind):
    """Regardless of what other instances of the same program have taken before."""
    found = []
    for _ in range(2):
        with answering(fmus()["adaptive_controller"]) as connection:
            peer = Peer(connection)
            begin(peer)
            found.append(int.from_bytes(peer.request("statistics").data[-4:], "little"))
    assert found[0] == found[1] > 1000


def test_wrong_session_version_and_component_are_reported(peer):
    assert peer.request("step", stepping(0, STEP)).status == NO_SESSION
    assert peer.request("describe", version=2).status == OTHER_VERSION
    assert peer.request("describe", component=1).status == NO_COMPONENT


def test_invalid_payloads_are_malformed(peer, kind):
    begin(peer)
    inputs = kind.references["r_SN_N"]
    cut = setting(dict.fromkeys(inputs, 1.0))[:-1]
    for code, payload in (
        ("step", b""),
        ("set", cut),
        ("set", b"\xff\xff"),
        ("get", struct.pack("<HBHI", 1, 7, 1, 0)),
        ("get", struct.pack("<HBHI", 1, 0, 65535, 0)),
        ("exchange", setting({})),
        ("enter", b"\0"),
    ):
        assert peer.request(code, payload).status == MALFORMED, (code, payload)
    assert peer.request("step", stepping(0, STEP)).status == 0


def test_no_bytes_bring_the_board_down():
    """Noise, damaged frames and sound frames of nonsense, 400 of them; then a sound session."""
    chance = random.Random(5)
    for _ in range(4):
        with answering(fmus()["adaptive_controller"]) as connection:
            peer = Peer(connection)
            for _ in range(100):
                peer.send(_nonsense(chance))
            peer.send(bytes(1 << 17))  # the length of a truncated frame is filled
            connection.settimeout(0.3)
            peer = Peer(_Patient(connection))
            begin(peer)


class _Patient:
    """A connection of which everything that was in it is read away before the first frame."""

    def __init__(self, connection):
        self.connection, self.sendall = connection, connection.sendall
        try:
            while connection.recv(1 << 16):
                pass
        except TimeoutError:
            connection.settimeout(20)

    def recv(self, most):
        return self.connection.recv(most)


def _nonsense(chance):
    noise = chance.randbytes(chance.randrange(200))
    sound = checksummed(Frame(chance.randrange(128), chance.randrange(1 << 32), noise))
    damaged = bytearray(sound)
    damaged[chance.randrange(len(damaged))] ^= 1 << chance.randrange(8)
    return chance.choice([noise, sound, bytes(damaged), sound[: chance.randrange(len(sound))]])
