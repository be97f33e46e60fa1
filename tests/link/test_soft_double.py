# SPDX-License-Identifier: BSD-2-Clause
"""soft_double.c: sums, quotients and roots against this machine's, bit for bit."""

from __future__ import annotations

import ctypes
import subprocess

import numpy as np
import pytest

from harness.files.paths import link_sources

SPECIAL = (
    0x0000000000000000,  # 0, smallest and largest subnormals, smallest normals
    0x0000000000000001,
    0x0000000000000003,
    0x000FFFFFFFFFFFFF,
    0x0010000000000000,
    0x0010000000000001,
    0x3FF0000000000000,
    0x3FF0000000000001,
    0x4008000000000000,
    0x7FEFFFFFFFFFFFFF,
    0x7FF0000000000000,  # infinite, not a number
    0x7FF8000000000001,
)
BOTH_SIGNS = np.array([bits | sign for bits in SPECIAL for sign in (0, 1 << 63)], np.uint64)
FRACTION = np.uint64((1 << 52) - 1)
RANDOM = 20_000


@pytest.fixture(scope="module")
def soft(tmp_path_factory):
    library = tmp_path_factory.mktemp("soft") / "soft_double.so"
    source = link_sources() / "soft_double.c"
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", source, "-o", library], check=True)
    return ctypes.CDLL(str(library))


def compute(function, *operands):
    """Bits that the C function gives, operand by operand."""
    function.restype, function.argtypes = ctypes.c_uint64, [ctypes.c_uint64] * len(operands)
    rows = zip(*(column.tolist() for column in operands), strict=True)
    return np.array([function(*row) for row in rows], np.uint64)


def check(function, hardware, *operands):
    """All bits equal; of what is no number only that it is none."""
    got = compute(function, *operands)
    with np.errstate(all="ignore"):
        required = hardware(*(column.view(float) for column in operands))
    unlike = got != required.view(np.uint64)
    wrong = np.where(np.isnan(required), ~np.isnan(got.view(float)), unlike)
    assert [tuple(map(hex, row)) for row in zip(*(c[wrong] for c in operands), strict=True)] == []


def with_exponents(significands, exponents):
    exponents = np.clip(exponents, 0, 2046).astype(np.uint64) << np.uint64(52)
    return (significands & ~np.uint64(0x7FF << 52)) | exponents


def random_bits(rng):
    """Of all exponents; half of the numbers end in zeros, so that ties come up."""
    zeros = (rng.integers(0, 53, RANDOM) * rng.integers(2, size=RANDOM)).astype(np.uint64)
    return rng.integers(0, 2**64, RANDOM, dtype=np.uint64) >> zeros << zeros


def exponents(bits):
    return (bits >> np.uint64(52) & np.uint64(2047)).astype(int)


def near(rng, bits, apart):
    """Other numbers, with exponents at most so far from these."""
    shift = rng.integers(-apart, apart + 1, RANDOM)
    return with_exponents(random_bits(rng), exponents(bits) + shift)


def test_the_tie_that_libgcc_rounds_the_wrong_way(soft):
    tie = np.array([0xBFAF644E80000000], np.uint64), np.array([0x41B0000000000000], np.uint64)
    assert compute(soft.sum_of_bits, *tie) == 0x41AFFFFFFFE09BB2


@pytest.mark.parametrize(
    ("name", "hardware"), [("sum_of_bits", np.add), ("quotient_of_bits", np.divide)]
)
def test_special_values_with_each_other(soft, name, hardware):
    a, b = (grid.ravel() for grid in np.meshgrid(BOTH_SIGNS, BOTH_SIGNS))
    check(getattr(soft, name), hardware, a, b)


@pytest.mark.parametrize("apart", [70, 2])
def test_sums_of_numbers_near_each_other(soft, apart):
    rng = np.random.default_rng(1)
    a = random_bits(rng)
    check(soft.sum_of_bits, np.add, a, near(rng, a, apart))


@pytest.mark.parametrize("sign", [0, 1 << 63])
def test_sums_that_the_very_last_bit_retains_from_a_tie(soft, sign):
    """Ones down to some place, and three ones so far below, the last at the end."""
    place, middle, apart = (grid.ravel() for grid in np.mgrid[0:52, 1:52, 1:55].astype(np.uint64))
    one = np.uint64(1)
    a = with_exponents(FRACTION >> place << place, np.full(place.shape, 1023))
    b = with_exponents(one | one << middle, 1023 - apart.astype(int)) | np.uint64(sign)
    check(soft.sum_of_bits, np.add, a, b)


def test_differences_of_neighbours(soft):
    rng = np.random.default_rng(2)
    a = random_bits(rng)
    b = (a ^ np.uint64(1 << 63)) + rng.integers(-8, 9, RANDOM).astype(np.uint64)
    check(soft.sum_of_bits, np.add, a, b)


def test_quotients_of_all_magnitudes(soft):
    rng = np.random.default_rng(3)
    a = random_bits(rng)
    check(soft.quotient_of_bits, np.divide, a, random_bits(rng))
    check(soft.quotient_of_bits, np.divide, a, near(rng, a, 3))


def test_quotients_that_are_exact_and_their_neighbours(soft):
    rng = np.random.default_rng(4)
    b = with_exponents(random_bits(rng), np.full(RANDOM, 1023))
    a = (b.view(float) * rng.uniform(1, 2, RANDOM)).view(np.uint64)
    a += rng.integers(-1, 2, RANDOM).astype(np.uint64)
    check(soft.quotient_of_bits, np.divide, a, b)


def test_quotients_below_the_smallest_normal_with_ties(soft):
    """By powers of two: what is shifted out is half a last place in many of them."""
    rng = np.random.default_rng(5)
    e = rng.integers(1, 60, RANDOM)
    a = with_exponents(random_bits(rng), e)
    b = with_exponents(np.zeros(RANDOM, np.uint64), 1022 + e + rng.integers(-2, 56, RANDOM))
    check(soft.quotient_of_bits, np.divide, a, b)
    check(soft.quotient_of_bits, np.divide, a, b | (random_bits(rng) & FRACTION))


def test_roots_of_all_magnitudes(soft):
    check(soft.root_of_bits, np.sqrt, BOTH_SIGNS)
    bits = random_bits(np.random.default_rng(6)) & ~np.uint64(1 << 63)
    check(soft.root_of_bits, np.sqrt, bits)
    check(soft.root_of_bits, np.sqrt, bits & FRACTION)


def test_roots_of_squares_and_their_neighbours(soft):
    """Of numbers of 27 bits, so that the squares are exact."""
    rng = np.random.default_rng(7)
    squares = (rng.integers(2**26, 2**27, RANDOM).astype(float) ** 2).view(np.uint64)
    check(soft.root_of_bits, np.sqrt, squares + rng.integers(-2, 3, RANDOM).astype(np.uint64))
