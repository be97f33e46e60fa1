# SPDX-License-Identifier: BSD-2-Clause
"""The comparison that the numerical tests use: what it accepts, rejects and reports."""

from __future__ import annotations

import numpy as np
import pytest

from tests.close import close
from tests.each import each

INERTIA = np.array([[4.5e6, 0, 0], [0, 4.4e6, 1000], [0, 1000, 1.5e5]])


def test_an_element_left_by_cancellation_may_have_the_error_of_the_largest():
    """The error of the issue: 1.2e-10 of 1000, 1.2e-13 of itself, 3e-17 of the largest."""
    found = INERTIA.copy()
    found[1, 2] = 1000.0000000001221
    assert found != pytest.approx(INERTIA, rel=1e-13)
    close(found, INERTIA, rel=1e-13)


@each("index", [(0, 0), (1, 2), (2, 2)])
def test_the_tolerance_is_a_share_of_the_largest_element_for_each_of_them(index):
    for share, accepted in ((0.9, True), (-0.9, True), (1.1, False), (-1.1, False)):
        found = INERTIA.copy()
        found[index] += share * 1e-9 * 4.5e6
        if accepted:
            close(found, INERTIA, rel=1e-9)
        else:
            with pytest.raises(AssertionError, match=r"1 of 9 .* by more than 0\.0045"):
                close(found, INERTIA, rel=1e-9)


def test_the_magnitude_may_be_the_size_of_the_terms():
    close([1e-9], [0.0], rel=1e-15, of=7e6)
    with pytest.raises(AssertionError, match=r"7e-09 \(1e-15 of 7e\+06\)"):
        close([1e-8], [0.0], rel=1e-15, of=7e6)


def test_zeros_are_compared_exactly():
    close(np.zeros(3), np.zeros(3), rel=1e-3)
    with pytest.raises(AssertionError, match=r"error 4\.94e-324 = inf of the largest"):
        close([0, 5e-324, 0], np.zeros(3), rel=1e-3)


@each("found", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_are_not_close(found):
    with pytest.raises(AssertionError, match="1 of 2 elements differ"):
        close([1.0, found], [1.0, 2.0], rel=1e300)
    with pytest.raises(AssertionError, match="expected values are not finite"):
        close([1.0, found], [1.0, found], rel=1e-3)


@each("found", [1.0, [1.0], [1.0, 1.0, 1.0], [[1.0, 1.0]]])
def test_another_shape_is_not_close(found):
    with pytest.raises(AssertionError, match=r"shape .* expected \(2,\)"):
        close(found, [1.0, 1.0], rel=1e-3)


def test_numbers_are_arrays_without_an_index():
    close(1.0, 1.0, rel=0)
    with pytest.raises(AssertionError, match=r"\[\]: 1.0, expected 1.5, error 0.5 = 0.333"):
        close(1.0, 1.5, rel=0.1)


def test_one_number_may_be_expected_everywhere():
    close(np.full((2, 3), 2.0), 2.0, rel=0)
    with pytest.raises(AssertionError, match="6 of 6 elements"):
        close(np.full((2, 3), 2.0), 2.1, rel=1e-3)


def test_the_message_names_index_values_and_error_the_worst_first():
    found = np.array([[1.0, 2.0], [3.5, 4.25]])
    with pytest.raises(AssertionError) as failure:
        close(found, [[1, 2], [3, 4]], rel=0.01)
    assert str(failure.value).splitlines()[:3] == [
        "2 of 4 elements differ by more than 0.04 (0.01 of 4):",
        "  [1, 0]: 3.5, expected 3.0, error 0.5 = 0.125 of the largest",
        "  [1, 1]: 4.25, expected 4.0, error 0.25 = 0.0625 of the largest",
    ]


def test_the_message_of_a_history_is_short():
    with pytest.raises(AssertionError) as failure:
        close(np.ones((1000, 3)), 0.0, rel=1, of=0.5)
    assert len(str(failure.value).splitlines()) == 6
