# SPDX-License-Identifier: BSD-2-Clause
"""portable_math.h and exact.h against mpmath and Annex F of C99."""

import ctypes
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from mpmath import libmp

from tests.each import each

HERE = Path(__file__).parent
FMUS = HERE.parents[1] / "fmus"
FLAGS = ["-std=c99", "-O2", "-ffp-contract=off", "-fPIC", "-shared"]
BITS = 100
"""Of the expected values: 2^-47 units in the last place of a double."""


class Functions:
    """functions.sine(x) calls sine() for every element of an array."""

    def __init__(self, library):
        self.library = library

    def __getattr__(self, name):
        def call(*arguments):
            arguments = [np.ascontiguousarray(a, float) for a in np.broadcast_arrays(*arguments)]
            result = np.empty(arguments[0].shape)
            pointers = [a.ctypes.data_as(ctypes.c_void_p) for a in (*arguments, result)]
            self.library[f"over_{name}"](*pointers, ctypes.c_size_t(result.size))
            return result

        return call


@pytest.fixture(scope="module")
def functions(tmp_path_factory):
    library = tmp_path_factory.mktemp("elementary") / "elementary.so"
    compiler = os.environ.get("CC", "cc").split()
    folder = f"-I{FMUS / 'core/maths'}"
    subprocess.run([*compiler, *FLAGS, folder, HERE / "elementary.c", "-o", library], check=True)
    return Functions(ctypes.CDLL(str(library)))


# ---- within one unit in the last place ----
def less_1(x, bits, rounding):
    """exp(x) - 1 with as many bits more as cancel."""
    lost = 2 * max(0, -(x[2] + x[3]))
    return libmp.mpf_sub(libmp.mpf_exp(x, bits + lost, rounding), libmp.fone, bits, rounding)


EXPECTED = {
    "sine": libmp.mpf_sin,
    "cosine": libmp.mpf_cos,
    "arc_tangent": libmp.mpf_atan2,
    "exponential": libmp.mpf_exp,
    "exponential_less_1": less_1,
    "logarithm": libmp.mpf_log,
}


def signs(rng, n):
    return rng.choice([-1.0, 1.0], n)


def spread(low, high):
    """Evenly spread over an interval."""
    return lambda rng, n: [rng.uniform(low, high, n)]


def sizes(low, high):
    """Both signs, sizes from 2^low to 2^high."""
    return lambda rng, n: [signs(rng, n) * 2.0 ** rng.uniform(low, high, n)]


def positive(low, high):
    return lambda rng, n: [2.0 ** rng.uniform(low, high, n)]


def beside_multiples(rng, n):
    """The doubles about multiples of pi/2: everything cancels."""
    multiples = np.round(2.0 ** rng.uniform(0, 40, n)) * (np.pi / 2)
    return [multiples * (1 + rng.integers(-2, 3, n) * 2.0**-52)]


def directions(low, high):
    """Two coordinates of any sign, sizes from 2^low to 2^high."""
    return lambda rng, n: [sizes(low, high)(rng, n)[0], sizes(low, high)(rng, n)[0]]


def square(rng, n):
    return [rng.uniform(-1, 1, n), rng.uniform(-1, 1, n)]


ANGLES = {
    "first octant": spread(-0.79, 0.79),
    "some turns": spread(-100, 100),
    "reduced in three parts": spread(-1.1e6, 1.1e6),
    "huge": sizes(19, 1024),
    "tiny": sizes(-1074, 0),
    "beside multiples of pi/2": beside_multiples,
}
ARGUMENTS = {
    "sine": ANGLES,
    "cosine": ANGLES,
    "arc_tangent": {
        "square": square,
        "wide": directions(-30, 30),
        "all doubles": directions(-1074, 1024),
        "huge": directions(1015, 1024),
        "subnormal": directions(-1074, -1010),
        "beside 1/8": lambda rng, n: [rng.uniform(0.1, 0.15, n), np.ones(n)],
    },
    "exponential": {
        "all doubles": spread(-745.13, 709.78),
        "about 0": spread(-1, 1),
        "subnormal results": spread(-745.13, -707),
        "near overflow": spread(707, 709.78),
        "tiny": sizes(-1074, -3),
    },
    "exponential_less_1": {
        "all doubles": spread(-40, 709.78),
        "about 0": spread(-1, 1),
        "beside 1/8": lambda rng, n: [signs(rng, n) * rng.uniform(0.1, 0.15, n)],
        "near overflow": spread(707, 709.78),
        "tiny": sizes(-1074, -3),
    },
    "logarithm": {
        "all doubles": positive(-1074, 1024),
        "an octave": spread(0.5, 2),
        "about 1": spread(0.98, 1.02),
        "beside 1": lambda rng, n: [1 + signs(rng, n) * 2.0 ** rng.uniform(-53, -7, n)],
        "subnormal": positive(-1074, -1020),
    },
}  # fmt: skip
WORST = {
    "sine": 0.85,
    "cosine": 0.85,
    "arc_tangent": 0.6,
    "exponential": 0.76,
    "exponential_less_1": 0.6,
    "logarithm": 0.55,
}
"""Units in the last place: half of one is the rounding of the result; cosines lose a quarter by
their z/2, subnormal results of exp are rounded twice.
"""
CASES = [(name, kind) for name, kinds in ARGUMENTS.items() for kind in kinds]


def units_off(value, exact):
    """Distance in units in the last place of the exact value, a tuple of libmp."""
    if exact == libmp.fzero:
        return 0.0 if value == 0 else np.inf
    if not np.isfinite(value):
        return np.inf
    unit = max(exact[2] + exact[3] - 53, -1074)
    difference = libmp.mpf_sub(libmp.from_float(value), exact, 53, "n")
    return abs(libmp.to_float(libmp.mpf_shift(difference, -unit)))


def worst(functions, name, arguments):
    """(units in the last place, arguments) of the largest error."""
    values = getattr(functions, name)(*arguments)
    rows = zip(values.tolist(), *(a.tolist() for a in arguments), strict=True)
    return max(
        (units_off(v, EXPECTED[name](*map(libmp.from_float, x), BITS, "n")), x) for v, *x in rows
    )


def arguments_of(name, kind, count):
    found = ARGUMENTS[name][kind](np.random.default_rng(len(name) + 31 * len(kind)), count)
    return [a[np.isfinite(a)] for a in found]


@each(("name", "kind"), CASES)
def test_values_are_within_one_unit_in_the_last_place(functions, name, kind):
    units, at = worst(functions, name, arguments_of(name, kind, 20_000 // len(ARGUMENTS[name])))
    assert units < WORST[name], at


@pytest.mark.long
@pytest.mark.parametrize(("name", "kind"), CASES)
def test_a_million_values_are_within_one_unit_in_the_last_place(functions, name, kind):
    units, at = worst(functions, name, arguments_of(name, kind, 1_000_000 // len(ARGUMENTS[name])))
    assert units < WORST[name], at


def test_the_angle_that_comes_nearest_to_a_multiple_of_half_a_turn(functions):
    """6381956970095103 2^797 is 2^-61 from a multiple of pi/2 (Muller, Elementary Functions)."""
    x = np.ldexp(6381956970095103.0, 797)
    assert abs(functions.cosine([x])[0]) < 1e-18
    for name in ("sine", "cosine"):
        assert worst(functions, name, [np.array([x, -x])])[0] < 1


def test_sine_and_cosine_together_have_the_bits_of_each(functions, rng):
    x = np.concatenate([make(rng, 500)[0] for make in ANGLES.values()] + [[0.0, -0.0, 1e-30]])
    assert functions.joint_sine(x).tobytes() == functions.sine(x).tobytes()
    assert functions.joint_cosine(x).tobytes() == functions.cosine(x).tobytes()


# ---- monotonic where one formula takes over from another ----
def about(points, reach=60):
    """A row of neighbouring doubles about each point."""
    bits = np.asarray(points, float).view(np.int64)[:, None] + np.arange(-reach, reach + 1)
    return np.sort(bits.view(float), axis=1)


STEP = np.log(2) / 128
SEAMS = {
    "sine": [np.pi / 4, -np.pi / 4, 2.0**-27],
    "exponential": np.r_[(np.arange(-300, 300) + 0.5) * STEP, 708, -708],
    "exponential_less_1": np.r_[(np.arange(-300, 300) + 0.5) * STEP, 0.125, -0.125, -40, 708],
    "logarithm": [float.fromhex("0x1.5fp-1") + k / 256 for k in range(80)]
    + [float.fromhex("0x1.01p0") + k / 128 for k in range(48)],
}


@pytest.mark.parametrize("name", SEAMS)
def test_functions_are_monotonic_where_formulas_meet(functions, name):
    x = about(SEAMS[name])
    assert np.all(np.diff(getattr(functions, name)(x)) >= 0)


def test_arc_tangent_is_monotonic_where_formulas_meet(functions):
    y = about([0.125, 1.0, *((np.arange(8, 64) + 0.5) / 64)])
    assert np.all(np.diff(functions.arc_tangent(y, 1.0)) >= 0)
    assert np.all(np.diff(functions.arc_tangent(y, -1.0)) <= 0)
    assert np.all(np.diff(functions.arc_tangent(1.0, y)) <= 0)


# ---- special values and exact ones ----
INF, NAN = np.inf, np.nan
PI = np.pi
SPECIAL = {
    "sine": [(0.0, 0.0), (-0.0, -0.0), (INF, NAN), (-INF, NAN), (NAN, NAN), (5e-324, 5e-324)],
    "cosine": [(0.0, 1.0), (-0.0, 1.0), (INF, NAN), (-INF, NAN), (NAN, NAN), (5e-324, 1.0)],
    "exponential": [
        (0.0, 1.0), (-0.0, 1.0), (INF, INF), (-INF, 0.0), (NAN, NAN), (709.8, INF), (1e308, INF),
        (-745.2, 0.0), (-1e308, 0.0), (5e-324, 1.0), (-745.1, 5e-324),
    ],
    "exponential_less_1": [
        (0.0, 0.0), (-0.0, -0.0), (INF, INF), (-INF, -1.0), (NAN, NAN), (709.8, INF),
        (-1e308, -1.0), (5e-324, 5e-324), (-5e-324, -5e-324),
    ],
    "logarithm": [
        (1.0, 0.0), (0.0, -INF), (-0.0, -INF), (-1.0, NAN), (-5e-324, NAN), (-INF, NAN),
        (INF, INF), (NAN, NAN),
    ],
}  # fmt: skip
ARCS = [
    (0.0, 1.0, 0.0), (-0.0, 1.0, -0.0), (0.0, -1.0, PI), (-0.0, -1.0, -PI), (0.0, 0.0, 0.0),
    (-0.0, 0.0, -0.0), (0.0, -0.0, PI), (-0.0, -0.0, -PI), (1.0, 0.0, PI / 2),
    (-1.0, 0.0, -PI / 2), (1.0, -0.0, PI / 2), (1.0, 1.0, PI / 4), (1.0, -1.0, 3 * PI / 4),
    (-3.0, -3.0, -3 * PI / 4), (INF, 1.0, PI / 2), (-INF, -1.0, -PI / 2), (1.0, INF, 0.0),
    (-1.0, INF, -0.0), (1.0, -INF, PI), (-1.0, -INF, -PI), (INF, INF, PI / 4),
    (INF, -INF, 3 * PI / 4), (-INF, INF, -PI / 4), (-INF, -INF, -3 * PI / 4), (NAN, 1.0, NAN),
    (1.0, NAN, NAN), (NAN, INF, NAN), (INF, NAN, NAN), (0.0, NAN, NAN), (5e-324, 5e-324, PI / 4),
    (1.7e308, 1.7e308, PI / 4), (5e-324, 1.7e308, 0.0), (1.7e308, 5e-324, PI / 2),
    (5e-324, -1.7e308, PI), (5e-324, 1.0, 5e-324), (0.0, -5e-324, PI), (0.0, INF, 0.0),
]  # fmt: skip


def same(found, expected):
    """Equal with the sign of zero; any NaN is a NaN."""
    return np.array_equal(found, expected, equal_nan=True) and np.all(
        np.isnan(found) | (np.signbit(found) == np.signbit(expected))
    )


@pytest.mark.parametrize("name", SPECIAL)
def test_special_values(functions, name):
    x, expected = np.array(SPECIAL[name]).T
    assert same(getattr(functions, name)(x), expected)


def test_special_directions(functions):
    y, x, _ = np.array(ARCS).T
    found = functions.arc_tangent(y, x)
    wrong = [row for row, f in zip(ARCS, found, strict=True) if not same(f, row[2])]
    assert not wrong


def test_powers_of_two_have_the_nearest_logarithm(functions):
    n = np.arange(-1074, 1024)
    assert worst(functions, "logarithm", [np.ldexp(1.0, n)])[0] <= 0.5


def test_sine_is_odd_and_cosine_even(functions, rng):
    x = np.concatenate([make(rng, 300)[0] for make in ANGLES.values()])
    assert same(functions.sine(-x), -functions.sine(x))
    assert same(functions.cosine(-x), functions.cosine(x))


# ---- exact.h ----
def test_roundings_equal_the_roundings_of_the_library(functions, rng):
    x = np.concatenate(
        [
            rng.uniform(-10, 10, 1000), np.arange(-9, 10) / 2, 2.0**52 + np.arange(-5, 5),
            sizes(-1074, 1024)(rng, 1000)[0], 2.0**51 + np.arange(-5, 5) / 2,
            [0.0, -0.0, 0.49999999999999994, -0.49999999999999994, INF, -INF, NAN],
        ]
    )  # fmt: skip
    assert same(functions.nearest_whole(x), np.rint(x))
    assert same(functions.floor_of(x), np.floor(x))
    assert same(functions.ceiling_of(x), np.ceil(x))


def test_the_larger_and_the_smaller_ignore_a_nan(functions):
    a = np.array([1.0, 2.0, NAN, 3.0, -INF, NAN, 5e-324])
    b = np.array([2.0, 1.0, 3.0, NAN, INF, NAN, -5e-324])
    assert same(functions.larger(a, b), np.fmax(a, b))
    assert same(functions.smaller(a, b), np.fmin(a, b))


# ---- the numbers ----
def test_tables_and_coefficients_are_those_that_mpmath_computes():
    done = subprocess.run(
        [sys.executable, FMUS / "core/build/elementary_numbers.py"],
        check=True, capture_output=True, text=True,
    )  # fmt: skip
    assert done.stdout == (FMUS / "core/maths/elementary_numbers.h").read_text()
