# SPDX-License-Identifier: BSD-2-Clause
"""The protocol of docs/protocol.md once more, from its text: struct and zlib instead of our C."""

from __future__ import annotations

import itertools
import struct
import zlib
from typing import NamedTuple

HEADER = struct.Struct("<4sBBBBIII")
RUN = struct.Struct("<BHI")
ANSWER = 0x80
CODES = [
    "describe",
    "reset",
    "set",
    "enter",
    "initialize",
    "step",
    "get",
    "exchange",
    "save",
    "restore",
    "terminate",
    "statistics",
]
CODE = {name: number for number, name in enumerate(CODES, 1)}
DAMAGED, OTHER_VERSION, NO_COMPONENT, NO_SESSION, MALFORMED = range(64, 69)


class Frame(NamedTuple):
    code: int
    sequence: int
    payload: bytes = b""
    component: int = 0
    status: int = 0
    version: int = 1

    @property
    def data(self):
        """The data that answer a request, without the message."""
        (size,) = struct.unpack_from("<I", self.payload)
        return self.payload[4 : 4 + size]

    @property
    def reported(self):
        return self.payload[4 + len(self.data) :].decode()


def checksummed(frame: Frame, order="<"):
    code = frame.code if isinstance(frame.code, int) else CODE[frame.code]
    head = struct.pack(
        f"{order}4sBBBBII",
        b"SLNK",
        frame.version,
        code,
        frame.component,
        frame.status,
        frame.sequence,
        len(frame.payload),
    )
    head += struct.pack(f"{order}I", zlib.crc32(head))
    return head + frame.payload + struct.pack(f"{order}I", zlib.crc32(head + frame.payload))


def opened(data: bytes):
    """The frame at the front of the bytes, and the rest; None if there is none."""
    if len(data) < HEADER.size:
        return None, data
    magic, version, code, component, status, sequence, length, crc = HEADER.unpack_from(data)
    end = HEADER.size + length + 4
    if len(data) < end:
        return None, data
    assert magic == b"SLNK"
    assert crc == zlib.crc32(data[: HEADER.size - 4])
    assert struct.unpack_from("<I", data, end - 4)[0] == zlib.crc32(data[: end - 4])
    payload = data[HEADER.size : end - 4]
    return Frame(code, sequence, payload, component, status, version), data[end:]


def runs(references):
    """Neighbours in runs of (first, count)."""
    groups = itertools.groupby(enumerate(references), lambda pair: pair[1] - pair[0])
    lists = ([reference for _, reference in group] for _, group in groups)
    return [(found[0], len(found)) for found in lists]


def setting(values):
    """List of runs with the values of Real variables by reference."""
    found = runs(list(values))
    parts = [
        RUN.pack(0, count, first)
        + struct.pack(f"<{count}d", *(values[first + i] for i in range(count)))
        for first, count in found
    ]
    return struct.pack("<H", len(found)) + b"".join(parts)


def getting(references):
    found = runs(references)
    parts = [RUN.pack(0, count, first) for first, count in found]
    return struct.pack("<H", len(found)) + b"".join(parts)


def stepping(t, h):
    return struct.pack("<ddB", t, h, 1)


class Peer:
    """One end of a connected socket that sends frames and receives them."""

    def __init__(self, connection):
        self.connection, self.held = connection, b""
        self.sequence = itertools.count(1000)

    def send(self, data):
        self.connection.sendall(data)

    def receive(self):
        """The next frame; an OSError if none comes."""
        while (found := opened(self.held))[0] is None:
            data = self.connection.recv(1 << 16)
            if not data:
                raise ConnectionError("the other end has gone")
            self.held += data
        frame, self.held = found
        return frame

    def request(self, code, payload=b"", **about):
        """The answer to a new request."""
        self.send(checksummed(Frame(CODE[code], next(self.sequence), payload, **about)))
        return self.receive()
