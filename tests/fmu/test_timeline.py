# SPDX-License-Identifier: BSD-2-Clause
"""timeline.fmu: the row of the last time that has been reached."""

from __future__ import annotations

import numpy as np
import pytest

from .rejections import rejection

FLAGS = ("go_1", "go_2", "go_3", "retreat", "resume", "relative_valid")
LATER = 1e30
GO = (1, 1, 1, 0, 0, 1)


def table(*rows):
    """Parameters of (time, flags)."""
    unused = [(LATER, GO)] * (16 - len(rows))
    times, flags = zip(*rows, *unused, strict=True)
    return {"times": times, "rows": flags}


def words(unit):
    return tuple(int(unit.get(name)) for name in FLAGS)


@pytest.mark.verifies("J.6-2")
def test_by_default_it_is_go_and_nothing_else(fmu):
    unit = fmu("timeline")
    assert words(unit) == GO
    unit.step(1e5)
    unit.step(1.0)
    assert words(unit) == GO


def test_each_column_is_its_own_flag(fmu):
    for k, row in enumerate(np.eye(6)):
        unit = fmu("timeline", table((0.0, row)))
        assert words(unit) == tuple(int(i == k) for i in range(6))


@pytest.mark.verifies("J.6-1")
def test_the_row_of_the_last_time_reached_is_in_force_from_its_instant_on(fmu):
    """Communication points of 0.1 s, sums of rounded steps: 0.3 is reached at the call at 0.3."""
    rows = [(0.3, (0, 1, 1, 0, 0, 1)), (0.5, (1, 0, 1, 0, 1, 0)), (0.6, GO)]
    unit, seen = fmu("timeline", table(*rows)), []
    for _ in range(9):
        unit.step(0.1)
        seen.append(words(unit))
    assert seen == [GO] * 3 + [rows[0][1]] * 2 + [rows[1][1]] + [GO] * 3


def test_sixteen_rows(fmu):
    rows = [(float(k), (k % 2, k // 2 % 2, k // 4 % 2, k // 8 % 2, 0, 1)) for k in range(16)]
    unit = fmu("timeline", table(*rows))
    for _, flags in rows:
        unit.step(1.0)
        assert words(unit) == flags


@pytest.mark.verifies("J.6-1")
@pytest.mark.parametrize("start", [5.0, 5.05])
def test_a_start_after_a_time_has_its_row(fmu, start):
    assert words(fmu("timeline", table((5.0, (0, 0, 0, 1, 0, 1))), start=start))[3] == 1


@pytest.mark.verifies("J.6-3")
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (table((1.0, GO), (0.5, GO)), "times[2] = 0.5: must be above"),
        (table((1.0, (1, 2, 1, 0, 0, 1))), "rows[1,2] = 2: must be 0 or 1"),
    ],
)
def test_rejected(change, words, tmp_path):
    assert words in rejection("timeline", change, tmp_path)
