# SPDX-License-Identifier: BSD-2-Clause
"""soft_double.c: sums of doubles against those of this machine, bit for bit."""

from __future__ import annotations

import ctypes
import math
import struct
import subprocess

import numpy as np
import pytest

from harness.files.paths import link_sources

SPECIAL = (
    0x0000000000000000,  # 0, smallest and largest subnormals, smallest normals
    0x0000000000000001,
    0x000FFFFFFFFFFFFF,
    0x0010000000000000,
    0x0010000000000001,
    0x3FF0000000000000,
    0x7FEFFFFFFFFFFFFF,
    0x7FF0000000000000,  # infinite, not a number
    0x7FF8000000000001,
)
SIGN = 1 << 63


@pytest.fixture(scope="module")
def add(tmp_path_factory):
    library = tmp_path_factory.mktemp("soft") / "soft_double.so"
    source = link_sources() / "soft_double.c"
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", source, "-o", library], check=True)
    function = ctypes.CDLL(str(library)).sum_of_bits
    function.restype, function.argtypes = ctypes.c_uint64, [ctypes.c_uint64] * 2
    return function


def number(bits):
    return struct.unpack("<d", struct.pack("<Q", bits))[0]


def agree(add, a, b):
    got, wanted = add(a, b), number(a) + number(b)
    if math.isnan(wanted):
        return math.isnan(number(got))
    return got == struct.unpack("<Q", struct.pack("<d", wanted))[0]


def test_the_tie_that_libgcc_rounds_the_wrong_way(add):
    assert add(0xBFAF644E80000000, 0x41B0000000000000) == 0x41AFFFFFFFE09BB2


def test_special_values(add):
    both = [bits | sign for bits in SPECIAL for sign in (0, SIGN)]
    assert [(a, b) for a in both for b in both if not agree(add, a, b)] == []


def test_random_numbers_near_each_other_with_many_ties(add):
    """Exponents at most 70 apart; half of the significands end in zeros, so that ties come up."""
    rng, wrong = np.random.default_rng(1), []
    for _ in range(20_000):
        a = int(rng.integers(0, 2**64, dtype=np.uint64))
        exponent = int(np.clip((a >> 52 & 2047) + rng.integers(-70, 71), 0, 2046))
        b = int(rng.integers(0, 2**52)) | exponent << 52 | int(rng.integers(2)) << 63
        zeros = int(rng.integers(0, 53)) * int(rng.integers(2))
        a, b = a >> zeros << zeros, b >> zeros << zeros
        if not agree(add, a, b):
            wrong.append((hex(a), hex(b)))
    assert wrong == []
