# SPDX-License-Identifier: BSD-2-Clause
"""Claims of Kozlova & Fomichev 2023 on the two-level guidance and stabilisation (docs/models.md B).

The paper prints curves and few numbers. For a claim without a number, the bands are this project's
interpretation.
"""

from __future__ import annotations

from harness.mission.claim import Band, Case, Claim, Paper, at_most

from . import evaluations as metrics
from .evaluations import RANGE, RATE_ERROR, TRANSITION, VELOCITIES

CLAIMS = (
    Claim(
        name="arrival",
        text="the servicer approaches the target to 50 m (point r1)",
        where="figure 6",
        needs=(RANGE,),
        compute=metrics.arrival,
        value="after {0:.0f} s, from {1:.1f} m",
        unit="s",
        reproduced=at_most(metrics.STOP),
    ),
    Claim(
        name="constant speed",
        text="on the first leg the servicer moves at a constant speed",
        where="figure 6",
        needs=(RANGE, *VELOCITIES),
        compute=metrics.speed_ripple,
        value="within {0:.2g} % of {1:.4f} m/s",
        unit="%",
        reproduced=at_most(2.0),
        partly=at_most(20.0),
    ),
    Claim(
        name="approach speed",
        text="on the first leg the speed is twice the speed of the target, 2 v_tar = 0.02 m/s",
        where="figure 6",
        needs=(RANGE, *VELOCITIES),
        compute=metrics.approach_speed,
        value="{0:.3f} of 2 v_tar: {1:.5f} m/s",
        unit="of 2 v_tar",
        reproduced=Band(0.95, 1.05),
        partly=Band(0.75, 1.25),
    ),
    Claim(
        name="constant distance",
        text="from point r2 on the servicer stays at a constant distance from the target",
        where="figure 6",
        needs=(RANGE,),
        compute=metrics.hold_error,
        value="{1:.2f} to {2:.2f} m, at most {0:.2f} m off",
        unit="m",
        reproduced=at_most(1.0),
        partly=at_most(5.0),
    ),
    Claim(
        name="speed of the target",
        text="from point r2 on the servicer moves at the speed of the target",
        where="figure 6",
        needs=(RANGE, *VELOCITIES),
        compute=metrics.hold_speed,
        value="{0:.3f} of v_tar: {1:.5f} m/s",
        unit="of v_tar",
        reproduced=Band(0.98, 1.02),
        partly=Band(0.9, 1.1),
    ),
    Claim(
        name="direction of the target",
        text="from point r2 on the servicer moves in the direction of the target's velocity",
        where="figures 6, 7",
        needs=(RANGE, *VELOCITIES),
        compute=metrics.heading,
        value="{0:.2f} deg apart in the last 2000 s",
        unit="deg",
        reproduced=at_most(5.0),
        partly=at_most(15.0),
    ),
    Claim(
        name="rates follow",
        text="the actual angular rates follow the required ones",
        where="figure 8",
        needs=(RATE_ERROR,),
        compute=metrics.rate_error,
        value="rms difference {0:.3f} mrad/s after 2000 s, largest {1:.2f} mrad/s",
        unit="mrad/s",
        reproduced=at_most(1.0),
        partly=at_most(3.0),
    ),
    Claim(
        name="transition quaternion",
        text="the transition quaternion tends to 1: the control of rotation is right",
        where="figure 9",
        needs=(TRANSITION,),
        compute=metrics.transition_angle,
        value="at most {0:.2f} deg in the last 5000 s, L0 >= {1:.5f}",
        unit="deg",
        reproduced=at_most(2.0),
        partly=at_most(10.0),
    ),
)

PAPER = Paper(
    title=(
        "Kozlova N. Yu., Fomichev A. V.: Algorithms of guidance and motion control of a space "
        "manipulation robot for servicing a non-cooperative spacecraft. Mekhatronika, "
        "Avtomatizatsiya, Upravlenie 24(4), 2023, 216-224"
    ),
    needs=(RANGE, TRANSITION, RATE_ERROR),
    claims=CLAIMS,
    cases=(Case("relay_approach", "paper"),),
)
