# SPDX-License-Identifier: BSD-2-Clause
"""time_grid.h against rational arithmetic: a double is a fraction, so nothing is rounded there."""

import math
from fractions import Fraction

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

LAST = 2.0**53
EXACTLY_COUNTED = 2.0**48
"""Below, a time is known to better than a sixteenth of a grid step."""

grids = st.floats(1e-6, 1e3)
numbers = st.one_of(st.integers(0, 2000), st.floats(0, 48).map(lambda e: int(2.0**e)))
fractions = st.one_of(st.just(0.0), st.floats(0, 1, exclude_max=True))
lengths = st.integers(0, 40)
many = settings(max_examples=16 * settings().max_examples)


def tolerance(n):
    """In grid steps: 1e-9 of the number, at most a thousandth, at least two roundings."""
    return max(
        min(Fraction(1, 10**9) * (1 + abs(n)), Fraction(1, 1000)), abs(n) * Fraction(1, 2**51)
    )


def place(t, grid):
    """Number of the grid point that t represents, or None and the number of the one before."""
    q = Fraction(t) / Fraction(grid)
    n = round(q)
    distance, rounding = abs(q - n), abs(q) * Fraction(1, 2**50)
    assume(abs(distance - tolerance(n)) > rounding)  # on the edge either answer is right
    return (n, n) if distance <= tolerance(n) else (None, math.floor(q))


def expected_substeps(t, end, grid):
    (on, first), (on_end, last) = place(t, grid), place(end, grid)
    points = [t if on is None else on * grid]
    points += [k * grid for k in range(first + 1, last + 1)]
    whole = [on is not None or i > 0 for i in range(len(points) - 1)]
    if on_end is None:
        points, whole = [*points, end], [*whole, False]
    return [(a, grid if w else b - a) for a, b, w in zip(points, points[1:], whole, strict=False)]


@many
@given(grids, numbers, fractions, lengths, fractions)
def test_substeps_are_those_between_the_grid_points(core, grid, n, off, count, rest):
    assume(n < EXACTLY_COUNTED)
    t = (n + off) * grid
    h = (count + rest) * grid
    assume(t + h > t)
    expected = [s for s in expected_substeps(t, t + h, grid) if s[1] > 0]
    assert core.substeps(t, h, grid) == expected


@many
@given(grids, numbers, fractions, lengths, fractions)
def test_negative_times_have_the_same_grid(core, grid, n, off, count, rest):
    t, h = -(n + 100 + off) * grid, (count + rest) * grid
    assume(n < EXACTLY_COUNTED and t + h > t)
    expected = [s for s in expected_substeps(t, t + h, grid) if s[1] > 0]
    assert core.substeps(t, h, grid) == expected


@many
@given(grids, numbers, fractions, lengths, fractions)
def test_samples_are_the_grid_points_from_t_on_to_before_the_end(core, period, n, off, count, rest):
    assume(n < EXACTLY_COUNTED)
    t, h = (n + off) * period, (count + rest) * period
    (on, before), (on_end, before_end) = place(t, period), place(t + h, period)
    first = before + (on is None)
    last = before_end + (on_end is None)
    assert core.samples(t, h, period) == [(k * period, period) for k in range(first, last)]


@many
@given(grids, st.floats(0, 53), st.integers(1, 60), st.integers(1, 5))
def test_whole_steps_stay_whole_up_to_2_53_of_them(core, grid, exponent, count, cuts):
    """Communication points k grid: every internal step is a whole one; however the way is cut,
    their number is the same, and it is the count of grid steps to the rounding of the two times.
    """
    n = int(min(2.0**exponent, LAST - 400))
    points = [(n + count * k) * grid for k in range(cuts + 1)]
    cut = [core.substeps(a, b - a, grid) for a, b in zip(points, points[1:], strict=False)]
    steps = [s for piece in cut for s in piece]
    assume(all(a + (b - a) == b for a, b in zip(points, points[1:], strict=False)))
    assert all(h == grid for _, h in steps)
    assert steps == core.substeps(points[0], points[-1] - points[0], grid) or (
        points[0] + (points[-1] - points[0]) != points[-1]
    )
    assert abs(len(steps) - count * cuts) <= (0 if n < 2.0**50 else 4)


@many
@given(grids, numbers, fractions, st.lists(st.floats(0, 3), min_size=1, max_size=6))
def test_no_sample_is_lost_or_taken_twice_however_the_way_is_cut(core, period, n, off, pieces):
    points = [(n + off) * period]
    for piece in pieces:
        points.append(points[-1] + piece * period)
    cut = [core.samples(a, b - a, period) for a, b in zip(points, points[1:], strict=False)]
    assume(all(a + (b - a) == b for a, b in zip(points, points[1:], strict=False)))
    whole = core.samples(points[0], points[-1] - points[0], period)
    assert [s for piece in cut for s in piece] == whole or (
        points[0] + (points[-1] - points[0]) != points[-1]
    )


def test_max_step_holds_in_this_century(core):
    """1.7e9 s after 1970, where a relative tolerance of 1e-9 would be 1.7 s."""
    steps = core.substeps(1.7e9, 1.0, 0.1)
    assert [h for _, h in steps] == [0.1] * 10
    assert [t for t, _ in steps] == [(17_000_000_000 + k) * 0.1 for k in range(10)]


def test_a_late_time_off_the_grid_is_not_moved_onto_it(core):
    (t, h), (second, rest) = core.substeps(1.7e9 + 0.05, 0.1, 0.1)
    assert (t, second) == (1.7e9 + 0.05, 17_000_000_001 * 0.1)
    assert h == pytest.approx(0.05, abs=5e-7)
    assert rest == pytest.approx(0.05, abs=5e-7)


def test_period_zero_is_one_sample_at_every_call(core):
    assert core.samples(12.3, 0.7, 0.0) == [(12.3, 0.7)]


@pytest.mark.parametrize("period", [0.1, 0.25, 1 / 3])
def test_accumulated_times_are_recognised(core, period):
    t, instants = 0.0, []
    for _ in range(20000):
        instants += [at for at, _ in core.samples(t, period, period)]
        t += period
    assert instants == [k * period for k in range(20000)]


@pytest.mark.parametrize(
    ("start", "early", "late"),
    [(0.0, 0.9e-9, 1.1e-9), (1200.0, 0.9e-6, 1.1e-6), (1.7e9, 0.7e-6, 3e-6), (-5.0, 5e-9, 7e-9)],
)
def test_a_time_is_reached_at_most_a_microsecond_early(core, start, early, late):
    assert core.reached(start, start)
    assert core.reached(start + 1.0, start)
    assert core.reached(start - early, start)
    assert not core.reached(start - late, start)
