# SPDX-License-Identifier: BSD-2-Clause
"""index.h: the whole part of a number as an index into an array."""

import numpy as np
import pytest


@pytest.mark.parametrize(
    ("x", "index"),
    [(0.0, 0), (-0.0, 0), (0.999, 0), (1.0, 1), (58.5, 58), (59.0, 59), (59.999, 59), (60.0, 59)],
)
def test_index_is_the_whole_part(core, x, index):
    assert core.index_within(x, 59) == index


@pytest.mark.parametrize(
    ("x", "index"), [(-1e-300, 0), (-7.5, 0), (-np.inf, 0), (1e300, 59), (np.inf, 59), (np.nan, 0)]
)
def test_index_stays_in_the_array(core, x, index):
    assert core.index_within(x, 59) == index
