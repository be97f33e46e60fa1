# SPDX-License-Identifier: BSD-2-Clause
"""Reads just enough of a PNG file to know that it is one (PNG specification, chapters 5, 9 and
11).
"""

from __future__ import annotations

import struct
import zlib

SIGNATURE = b"\x89PNG\r\n\x1a\n"
SAMPLES = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}  # per pixel, by colour type


def chunks(data: bytes):
    """(type, contents) of every chunk; ValueError where a length or checksum is wrong."""
    if not data.startswith(SIGNATURE):
        raise ValueError("no PNG signature")
    place = len(SIGNATURE)
    while place < len(data):
        (length,) = struct.unpack_from(">I", data, place)
        named = data[place + 4 : place + 8 + length]
        if data[place + 8 + length : place + 12 + length] != struct.pack(">I", zlib.crc32(named)):
            raise ValueError(f"damaged chunk {named[:4]!r}")
        yield named[:4], named[4:]
        place += 12 + length


def size(data: bytes) -> tuple[int, int]:
    """Width and height, after all pixels have been unpacked; ValueError if this is not a whole
    picture.
    """
    found = list(chunks(data))
    if found[0][0] != b"IHDR" or found[-1] != (b"IEND", b""):
        raise ValueError("begin or end is missing")
    width, height, depth, colour, _, _, interlace = struct.unpack(">IIBBBBB", found[0][1])
    pixels = zlib.decompress(b"".join(contents for kind, contents in found if kind == b"IDAT"))
    line = 1 + (width * depth * SAMPLES[colour] + 7) // 8  # a filter byte, then the samples
    if interlace or len(pixels) != height * line:
        raise ValueError("wrong number of pixels")
    return width, height
