# SPDX-License-Identifier: BSD-2-Clause
"""interface.h: the rules of values in the order of Rule in fmu.h, checked together."""

import math

import pytest

TINY, HUGE = 5e-324, 1.7976931348623157e308
VALUES = (-HUGE, -1.0, -TINY, -0.0, 0.0, TINY, 0.5, 1 - 2**-53, 1.0, 1 + 2**-52, 2.0)
ANGLES = (math.pi, math.nextafter(math.pi, 4), HUGE)
ALLOWED = (
    lambda x: True,
    lambda x: x > 0,
    lambda x: x >= 0,
    lambda x: x in (0, 1),
    lambda x: 0 <= x <= math.pi,
    lambda x: x in (0, 1),
)
"""Any, positive, non-negative, switch, angle, alarm."""


@pytest.mark.parametrize("rule", range(len(ALLOWED)))
def test_a_value_that_breaks_its_rule_is_found_in_any_position(core, rule):
    assert core.satisfy_rule(rule, [])
    for value in (*VALUES, *ANGLES):
        for at in range(3):
            x = [1.0, 1.0, 1.0]
            x[at] = value
            assert core.satisfy_rule(rule, x) == ALLOWED[rule](value), (value, at)
