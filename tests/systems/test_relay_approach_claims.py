"""Claims of Kozlova & Fomichev 2023, one by one, for the paper's set and for the two that were made from it."""

from __future__ import annotations

import numpy as np
import pytest

from harness.claims import Verdict

from .relay_case import (
    BRAKES,
    HOLD,
    MAIN,
    NEWTON,
    PAPER,
    SMALL,
    approaching,
    arrival,
    distance,
    flight,
    holding,
    impulse,
    last,
    speed,
    transition,
    velocities,
)

REPRODUCED, PARTLY, NOT = Verdict.REPRODUCED, Verdict.PARTLY, Verdict.NOT_REPRODUCED
TARGET_SPEED = 0.01

# ---- what is measured


def approach_speed(result):
    """Mean speed of the first leg [m/s]."""
    return speed(result)[approaching(result)].mean()


def speed_ripple(result):
    """Spread of the speed of the first leg relative to its mean."""
    leg = speed(result)[approaching(result)]
    return np.ptp(leg) / leg.mean()


def hold_error(result):
    """Largest distance from 50 m after the arrival [m]."""
    return np.abs(distance(result)[holding(result)] - HOLD).max()


def hold_speed(result):
    """Mean speed after the arrival relative to that of the target."""
    return speed(result)[holding(result)].mean() / TARGET_SPEED


def heading(result):
    """Mean angle between the velocities of servicer and target in the last 2000 s [deg]."""
    v_S, v_T = (v[last(result, 2000)] for v in velocities(result))
    cosine = (v_S * v_T).sum(axis=1) / np.linalg.norm(v_S, axis=1) / np.linalg.norm(v_T, axis=1)
    return np.degrees(np.arccos(cosine)).mean()


def rate_error(result):
    """Root mean square of required less actual angular rate after 2000 s [rad/s]."""
    return np.sqrt((result["controller.domega_S"][result.time >= 2000] ** 2).sum(axis=1).mean())


def final_transition(result):
    """Largest rotation angle of the transition quaternion in the last 5000 s [deg]."""
    return transition(result)[last(result, 5000)].max()


def translation_impulse(result):
    return impulse(result, MAIN) + impulse(result, BRAKES)


# ---- claims: bands of "reproduced" and "partly", then our figure per set (tolerance in %) and the verdict

CLAIMS = {
    # "approach to 50 m [point r1]": within the time axis we chose, 40 000 s
    "arrival": (arrival, (0, 40000), None),
    # "to the distance of 50 m it moves at a constant velocity ...": speed within 2 %, or 20 %
    "constant speed": (speed_ripple, (0, 0.02), (0, 0.2)),
    # "... v = 2 v_tar = 0.02 m/s": within 5 %, or 25 %
    "approach speed": (approach_speed, (0.019, 0.021), (0.015, 0.025)),
    # "moves at the distance of 50 m from the target": within 1 m, or 5 m
    "constant distance": (hold_error, (0, 1), (0, 5)),
    # "at the speed of the target, 0.01 m/s": within 2 %, or 10 %
    "speed of the target": (hold_speed, (0.98, 1.02), (0.9, 1.1)),
    # "after the direction of the velocity has been aligned with the motion of the target": 5 deg, or 15 deg
    "direction of the target": (heading, (0, 5), (0, 15)),
    # figure 8, required and actual rates: rms error up to the threshold xi2/Kp = 1 mrad/s, or three times that
    "rates follow": (rate_error, (0, 1e-3), (0, 3e-3)),
    # figure 9, "the transition quaternion tends to 1": 2 deg at the end, or 10 deg
    "transition quaternion": (final_transition, (0, 2), (0, 10)),
}

FIGURES = {
    ("arrival", PAPER): (32429, REPRODUCED),
    ("arrival", SMALL): (39004, REPRODUCED),
    ("arrival", NEWTON): (30077, REPRODUCED),
    ("constant speed", PAPER): (2.11e-4, REPRODUCED),
    ("constant speed", SMALL): (2.6e-4, REPRODUCED),
    ("constant speed", NEWTON): (0.166, PARTLY),
    ("approach speed", PAPER): (0.01765, PARTLY),
    ("approach speed", SMALL): (0.01600, PARTLY),
    ("approach speed", NEWTON): (0.01708, PARTLY),
    ("constant distance", PAPER): (0.752, REPRODUCED),
    ("constant distance", NEWTON): (3.05, PARTLY),
    ("speed of the target", PAPER): (0.9957, REPRODUCED),
    ("speed of the target", NEWTON): (0.943, PARTLY),
    ("direction of the target", PAPER): (5.00, PARTLY),
    ("direction of the target", NEWTON): (7.57, PARTLY),
    ("rates follow", PAPER): (8.70e-4, REPRODUCED),
    ("rates follow", SMALL): (8.72e-4, REPRODUCED),
    ("rates follow", NEWTON): (7.38e-4, REPRODUCED),
    ("transition quaternion", PAPER): (1.63, REPRODUCED),
    ("transition quaternion", SMALL): (1.58, REPRODUCED),
    ("transition quaternion", NEWTON): (31.1, NOT),
}
"""The hold of paper_small_thrust is too short to be judged: it arrives 1000 s before the end, at 1.6 instead of 2 cm/s.
newton turns its thrust axis along the velocity error before a burn, so its transition quaternion leaves 1 by design."""


def verdict(value, reproduced, partly):
    if reproduced[0] <= value <= reproduced[1]:
        return REPRODUCED
    return PARTLY if partly and partly[0] <= value <= partly[1] else NOT


@pytest.mark.parametrize(("claim", "params"), FIGURES)
def test_claim(claim, params):
    measure, reproduced, partly = CLAIMS[claim]
    figure, expected = FIGURES[claim, params]
    value = measure(flight(params))
    assert value == pytest.approx(figure, rel=0.02)
    assert verdict(value, reproduced, partly) is expected


def test_the_paper_flies_at_the_price_of_kilonewton_seconds():
    """Not said in the paper: 8 kN s; a tenth of the thrust does it with 23 N s, and momentum alone would need 20."""
    assert translation_impulse(flight(PAPER)) == pytest.approx(8127, rel=0.01)
    assert translation_impulse(flight(SMALL)) == pytest.approx(22.8, rel=0.01)
