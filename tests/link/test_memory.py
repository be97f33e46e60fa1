# SPDX-License-Identifier: BSD-2-Clause
"""memory.c: copies against slices, from every alignment, and nothing outside is written."""

from __future__ import annotations

import ctypes
import subprocess

import numpy as np

from harness.files.paths import link_sources

LARGEST = 150
"""More than a round of the longest words, and a rest of bytes."""


def test_copies_of_every_size_and_alignment(tmp_path):
    library = tmp_path / "memory.so"
    command = ["cc", "-O2", "-shared", "-fPIC", "-Dmemcpy=copied", link_sources() / "memory.c"]
    subprocess.run([*command, "-o", library], check=True)
    copied = ctypes.CDLL(str(library)).copied
    copied.argtypes, copied.restype = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t], None
    source = np.random.default_rng(1).integers(0, 256, LARGEST + 32, dtype=np.uint8)
    for to, begin in ((0, 0), (8, 0), (0, 4), (1, 1), (3, 0), (0, 7)):
        for size in range(LARGEST + 1):
            target = np.full(LARGEST + 32, 0xA5, np.uint8)
            required = target.copy()
            required[to : to + size] = source[begin : begin + size]
            copied(target.ctypes.data + to, source.ctypes.data + begin, size)
            assert np.array_equal(target, required), (to, begin, size)
