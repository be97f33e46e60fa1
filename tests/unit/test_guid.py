# SPDX-License-Identifier: BSD-2-Clause
"""interface.h: what the guid of an FMU is made of."""

import ctypes

import pytest

BASIS, PRIME = 14695981039346656037, 1099511628211


def fnv_1a(data, value=BASIS):
    """Fowler, Noll & Vo's hash of 64 bits."""
    for byte in data:
        value = (value ^ byte) * PRIME % 2**64
    return value


def test_the_hash_is_fnv_1a():
    """Published values."""
    assert fnv_1a(b"") == 0xCBF29CE484222325
    assert fnv_1a(b"a") == 0xAF63DC4C8601EC8C
    assert fnv_1a(b"foobar") == 0x85944171F73967E8


@pytest.mark.parametrize("text", ["", "1", "kg", "rho_ref_N"])
def test_texts_count_to_the_last_letter_and_end_with_a_zero(core, text):
    """So that `ab`, `c` and `a`, `bc` differ."""
    fold = core.library.call_fold_text
    fold.restype, fold.argtypes = ctypes.c_uint64, [ctypes.c_uint64, ctypes.c_char_p]
    assert fold(BASIS, text.encode()) == fnv_1a(text.encode() + b"\0")
