# SPDX-License-Identifier: BSD-2-Clause
"""Tables and coefficients of fmus/core/maths/portable_math.h, computed with mpmath.

    python fmus/core/build/elementary_numbers.py > fmus/core/maths/elementary_numbers.h

Polynomials minimize the largest relative error of a function (exchange algorithm of Remez). A
constant is split into parts of few bits, so that the products of the parts with small whole numbers
are exact. A test checks that this program still prints the stored file.
"""

import math
import sys
from collections.abc import Callable

import mpmath as mp

mp.mp.prec = 200
STEPS = 128
"""Number of intervals per octave in the tables of exp and log."""
TANGENTS = 64
"""Number of entries in the table of atan, which contains atan(k/64) for k = 1 to 64."""
HEAD = """\
/* elementary_numbers.h - tables and coefficients of portable_math.h.
 *
 * Computed with 200 bits or more by fmus/core/build/elementary_numbers.py; do not edit. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef ELEMENTARY_NUMBERS_H
#define ELEMENTARY_NUMBERS_H

#include <stdint.h>

// clang-format off
"""
TAIL = """\
// clang-format on

#endif"""

NEAR_0 = mp.mpf(10) ** -20
Function = Callable[[mp.mpf], mp.mpf]


# ---- minimax polynomials ----
def remez(f: Function, weight: Function, low: float, high: float, degree: int) -> list[mp.mpf]:
    """Return the coefficients, lowest power first, of the polynomial p that minimizes the maximum
    of |weight(x) (f(x) - p(x))| on [low, high].
    """
    count = degree + 2
    middle, half = mp.mpf(low + high) / 2, mp.mpf(high - low) / 2
    points = [middle - half * mp.cos(mp.pi * (2 * i + 1) / (2 * count)) for i in range(count)]
    grid = [middle - half * mp.cos(mp.pi * i / 400) for i in range(401)]
    for _ in range(6):
        c = _levelled(f, weight, points, degree)
        errors = [weight(x) * (f(x) - mp.polyval(c[::-1], x)) for x in grid]
        points = _extremes(grid, errors, count)
    return c


def _levelled(f: Function, weight: Function, points: list[mp.mpf], degree: int) -> list[mp.mpf]:
    """Return the coefficients of the polynomial p whose weighted errors weight(x_i) (f(x_i) -
    p(x_i)) at the given points have the same size and alternating signs.
    """
    rows = [
        [*(x**k for k in range(degree + 1)), (-1) ** i / weight(x)] for i, x in enumerate(points)
    ]
    solution = mp.lu_solve(mp.matrix(rows), mp.matrix([f(x) for x in points]))
    return list(solution)[: degree + 1]


def _extremes(grid: list[mp.mpf], errors: list[mp.mpf], count: int) -> list[mp.mpf]:
    """Return the grid point of the largest error in every group of successive errors with equal
    sign. While there are more than `count` groups, the first or the last one is dropped, whichever
    has the smaller error.
    """
    runs: list[tuple[mp.mpf, mp.mpf]] = []
    for x, e in zip(grid, errors, strict=True):
        if runs and runs[-1][1] * e > 0:
            runs[-1] = max(runs[-1], (x, e), key=lambda p: abs(p[1]))
        else:
            runs.append((x, e))
    while len(runs) > count:
        runs.pop(0 if abs(runs[0][1]) < abs(runs[-1][1]) else -1)
    return [x for x, _ in runs]


# ---- parts of a number ----
def cut(x: mp.mpf, lowest: int) -> mp.mpf:
    """Return x rounded to the nearest multiple of 2^lowest."""
    return mp.nint(mp.ldexp(x, -lowest)) * mp.mpf(2) ** lowest


def parts(x: mp.mpf, *lowest: int) -> list[float]:
    """Return doubles whose sum is x except for the rounding of the last one: a multiple of 2^n for
    each n in `lowest`, and the double nearest to the rest.
    """
    found = []
    for bits in lowest:
        found.append(float(cut(x, bits)))
        x -= found[-1]
    return [*found, float(x)]


# ---- C ----
def constant(name: str, x: float, text: str) -> str:
    """Return the C line that defines a constant; text: its meaning, written as a comment."""
    return f"#define {name} {x.hex()} /* {text} */"


def array(name: str, rows: list[list[float]], text: str) -> str:
    """Return the C definition of a constant array of doubles, written in hexadecimal and therefore
    exact. rows: lists of one number for a vector, of one number per column for a two-dimensional
    array; text: comment above the definition.
    """
    columns = len(rows[0])
    size = f"[{len(rows)}]" + (f"[{columns}]" if columns > 1 else "")
    lines = (", ".join(x.hex() for x in row) for row in rows)
    body = ",\n".join(f"    {{{line}}}" if columns > 1 else f"    {line}" for line in lines)
    return f"/* {text} */\nstatic const double {name}{size} = {{\n{body}}};"


def polynomial(name: str, coefficients: list[mp.mpf], text: str) -> str:
    """Return the C definition of an array with the coefficients of a polynomial, lowest power
    first; text: comment above the definition.
    """
    return array(name, [[float(c)] for c in coefficients], text)


# ---- tables and coefficients of the functions ----
def root(z: mp.mpf) -> mp.mpf:
    """Return r = sqrt(z), for functions of r that are approximated by a polynomial in z = r^2. A z
    below NEAR_0 is replaced by NEAR_0, because quotients such as sin(r)/r are undefined at r = 0.
    """
    return mp.sqrt(max(z, NEAR_0))


def angles() -> list[str]:
    """Return the C definitions for sin and cos, and for the argument reduction by multiples of pi/2
    (Cody & Waite 1980; Payne & Hanek 1983).
    """
    first, second, third = parts(mp.pi / 2, -32, -65)
    with mp.workprec(1400):
        digits = int(mp.floor(2 / mp.pi * mp.mpf(2) ** (32 * 40)))
    words = [0, 0, 0] + [digits >> 32 * (39 - i) & 0xFFFFFFFF for i in range(40)]
    lines = ",\n".join(
        "    " + ", ".join(f"0x{w:08x}" for w in words[i : i + 7]) for i in range(0, len(words), 7)
    )
    most = float(mp.pi / 4) ** 2
    return [
        constant("TWO_OVER_PI", float(2 / mp.pi), "2/pi"),
        constant("HALF_PI_1", first, "pi/2, first 33 bits"),
        constant("HALF_PI_2", second, "pi/2, next 33 bits"),
        constant("HALF_PI_3", third, "pi/2, the rest"),
        f"#define HALF_PI_BITS UINT64_C(0x{int(mp.nint(mp.pi / 2 * 2**63)):016x}) /* 2^63 pi/2 */",
        "/* 2/pi in words of 32 bits: three words 0 before the binary point, then the fraction */\n"
        f"static const uint32_t two_over_pi[{len(words)}] = {{\n{lines}}};",
        polynomial(
            "sine_terms",
            remez(
                lambda z: (mp.sin(root(z)) / root(z) - 1) / root(z) ** 2,
                lambda z: root(z) ** 3 / mp.sin(root(z)),
                0, most, 5,
            ),
            "(sin(r) - r)/r^3 in powers of r^2, |r| <= pi/4",
        ),
        polynomial(
            "cosine_terms",
            remez(
                lambda z: (mp.cos(root(z)) - 1 + root(z) ** 2 / 2) / root(z) ** 4,
                lambda z: root(z) ** 4 / mp.cos(root(z)),
                0, most, 5,
            ),
            "(cos(r) - 1 + r^2/2)/r^4 in powers of r^2, |r| <= pi/4",
        ),
    ]  # fmt: skip


def arcs() -> list[str]:
    """Return the C definitions for atan: a table with steps of 1/64, a polynomial for the rest of
    an argument between two steps, and a polynomial for arguments below 1/8.
    """
    rest: Function = lambda z: (mp.atan(root(z)) / root(z) - 1) / root(z) ** 2  # noqa: E731
    weight: Function = lambda z: root(z) ** 3 / mp.atan(root(z))  # noqa: E731
    low, high = parts(mp.pi, -51)
    return [
        constant("PI_1", low, "pi, the nearest multiple of 2^-51"),
        constant("PI_2", high, "pi, the rest: PI_1 + PI_2 = pi"),
        array(
            "arc_table",
            [parts(mp.atan(mp.mpf(k) / TANGENTS), -53) for k in (TANGENTS, *range(1, TANGENTS))],
            "columns: two numbers whose sum is atan(k/64) in row k = 1 to 63, atan(1) in row 0",
        ),
        polynomial(
            "arc_terms",
            remez(rest, weight, 0, (1 / 8 + 1 / 1000) ** 2, 7),
            "(atan(q) - q)/q^3 in powers of q^2, |q| <= 1/8",
        ),
        polynomial(
            "arc_step_terms",
            remez(rest, weight, 0, (1 / 127) ** 2, 2),
            "(atan(q) - q)/q^3 in powers of q^2, |q| <= 1/127",
        ),
    ]


def rest_of_exp(r: mp.mpf, n: int) -> mp.mpf:
    """Return (exp(r) - the first n terms of its series)/r^n, computed without cancellation."""
    return mp.fsum(r**k / mp.factorial(k + n) for k in range(25))


def powers() -> list[str]:
    """Return the C definitions for exp (Tang 1989) and expm1."""
    step = mp.log(2) / STEPS
    high, low = parts(step, -43)
    bound = float(step / 2) * 1.001
    rows = []
    for j in range(STEPS):
        exact = mp.mpf(2) ** (mp.mpf(j) / STEPS)
        rows.append([float(exact), float((exact - float(exact)) / float(exact))])
    return [
        constant("STEPS_PER_E", float(1 / step), "128/ln 2"),
        constant("STEP_1", high, "ln 2/128, first 36 bits"),
        constant("STEP_2", low, "ln 2/128, the rest: STEP_1 + STEP_2 = ln 2/128"),
        array("power_table", rows, "columns: a, b with 2^(j/128) = a (1 + b) in row j"),
        polynomial(
            "exponential_terms",
            remez(lambda r: rest_of_exp(r, 2), lambda r: r**2 + NEAR_0, -bound, bound, 3),
            "(exp(r) - 1 - r)/r^2, |r| <= ln 2/256",
        ),
        polynomial(
            "expm1_terms",
            remez(lambda r: rest_of_exp(r, 3), lambda r: r**2 + NEAR_0, -0.1251, 0.1251, 8),
            "(exp(x) - 1 - x - x^2/2)/x^3, |x| <= 1/8",
        ),
    ]


def logarithms() -> list[str]:
    """Return the C definitions for log (Tang 1990): x = 2^k z, ln z = ln c + ln(z/c); a table
    contains 1/c and ln c for a number c near z.
    """
    high, low = parts(mp.log(2), -42)
    rows = []
    for i in range(STEPS):
        start, end = (_double(LEAST_Z + ((i + n) << 45)) for n in (0, 1))
        inverse = cut(2 / (mp.mpf(start) + end), -19)
        if start < 1 < end:
            inverse = mp.mpf(1)
        rows.append([float(inverse), *parts(-mp.log(inverse), -42)])
    bound = 2.0**-8 + 2.0**-19
    return [
        f"#define LEAST_Z UINT64_C(0x{LEAST_Z:016x}) "
        "/* bits of the least z, x = 2^n z in logarithm() */",
        constant("LN_2_1", high, "ln 2, first 42 bits"),
        constant("LN_2_2", low, "ln 2, the rest: LN_2_1 + LN_2_2 = ln 2"),
        array("log_table", rows, "columns: 1/c in 20 bits, ln c in two parts; c: see logarithm()"),
        polynomial(
            "log_terms",
            remez(
                lambda r: (mp.log1p(r) - r) / r**2 if abs(r) > NEAR_0 else -mp.mpf(1) / 2,
                lambda r: abs(r) + NEAR_0,
                -bound, bound, 5,
            ),
            "(ln(1 + r) - r)/r^2, |r| <= 2^-8",
        ),
    ]  # fmt: skip


LEAST_Z = 0x3FE6000000000000 - (1 << 44)
"""Bits of the smallest z that occurs when log(x) splits x into 2^k z. It lies half an interval of
the table below 11/16, so that z = 1 is in the middle of an interval.
"""


def _double(bits: int) -> float:
    """Return the positive, normal double that has these bits."""
    return math.ldexp((bits & ((1 << 52) - 1)) + (1 << 52), (bits >> 52) - 1075)


def text() -> str:
    """Return the text of elementary_numbers.h."""
    return "\n".join([HEAD, *angles(), *arcs(), *powers(), *logarithms(), TAIL, ""])


if __name__ == "__main__":
    sys.stdout.write(text())
