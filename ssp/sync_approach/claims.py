# SPDX-License-Identifier: BSD-2-Clause
"""Claims of Zhu & Yang 2009 on the synchronised approach (docs/models.md A).

The paper prints curves without numbers. For a claim without a number, the bands are this project's
interpretation.
"""

from __future__ import annotations

from harness.mission.claim import Case, Claim, Paper, at_least, at_most

from ..shared.relative_motion import FORCE_H, POSITION_H, RATE
from . import evaluations as metrics
from .evaluations import (
    BETA_P,
    BETA_T,
    ESTIMATES,
    MASS,
    MASS_ESTIMATE,
    RANGE,
    REFERENCE,
    TURNED,
    WHEELS,
)

CLAIMS = (
    Claim(
        name="arrival",
        text=(
            "the range shrinks until the target is within reach of the arm and is then "
            "maintained at rho_M"
        ),
        where="section 2, figure 5",
        needs=(RANGE, REFERENCE),
        compute=metrics.arrival,
        value=(
            "within {0:.3f} m of rho_M after 20 min; 0, 10, 20 min, end: {1:.4f}, {2:.4f}, "
            "{3:.4f}, {4:.4f} m"
        ),
        unit="m",
        reproduced=at_most(0.1),
        partly=at_most(0.5),
    ),
    Claim(
        name="safe distance",
        text="the safe distance rho >= rho_M holds throughout",
        where="section 3, figure 5",
        needs=(RANGE, REFERENCE),
        compute=metrics.shortfall,
        value="{0:.1f} mm below rho_M; minimum range {1:.4f} m at {2:.0f} s",
        unit="mm",
        reproduced=at_most(0.0),
        partly=at_most(50.0),
    ),
    Claim(
        name="grasp axis",
        text="the servicer stays in front of the grasp point: beta_t -> 0",
        where="section 2.1, figure 2",
        needs=(BETA_T,),
        compute=metrics.grasp_axis_error,
        value="at most {0:.2f} deg after 10 min ({1:.2f} deg at the start)",
        unit="deg",
        reproduced=at_most(1.0),
        partly=at_most(5.0),
    ),
    Claim(
        name="position tracking",
        text="tracking of the relative position is effective",
        where="section 3, figure 7",
        needs=POSITION_H,
        compute=metrics.tracking_error,
        value="error at most {0:.4f} m after 10 min; {1:.4f} m at the start, {2:.4f} m at the end",
        unit="m",
        reproduced=at_most(0.1),
        partly=at_most(0.5),
    ),
    Claim(
        name="continuous thrust",
        text="the control force is continuous",
        where="section 3, figure 6",
        needs=FORCE_H,
        compute=metrics.force_rate,
        value=(
            "changes by at most {0:.1f} % of its peak per second; {1:.4f} N at the start, "
            "peak {2:.4f} N"
        ),
        unit="%/s",
        reproduced=at_most(10.0),
        partly=at_most(50.0),
        interval=1.0,
    ),
    Claim(
        name="mass settles",
        text="the estimated mass converges to a constant",
        where="section 3, figure 8",
        needs=(MASS_ESTIMATE,),
        compute=metrics.mass_drift,
        value=(
            "moves by {0:.1g} kg in the last 10 min; {1:.5f} kg at the start, {2:.5f} kg at the end"
        ),
        unit="kg",
        reproduced=at_most(0.1),
        partly=at_most(1.0),
    ),
    Claim(
        name="mass is not the truth",
        text="the constant to which the estimated mass converges is not the true mass",
        where="section 3, figure 8",
        needs=(MASS_ESTIMATE, MASS),
        compute=metrics.mass_offset,
        value="{0:.3f} kg from the truth: {1:.3f} kg instead of {2:.3f} kg",
        unit="kg",
        reproduced=at_least(1.0),
        partly=at_least(0.1),
    ),
    Claim(
        name="position law is asymptotically stable",
        text=(
            "the closed loop of the position is uniformly asymptotically stable (proved without "
            "disturbances)"
        ),
        where="below (14)",
        needs=POSITION_H,
        compute=metrics.position_decay,
        value="largest error {1:.1f} mm, 10 min later {2:.1f} mm, ratio {0:.2f}",
        unit="",
        reproduced=at_most(0.1),
        partly=at_most(0.5),
    ),
    Claim(
        name="attitude tracking",
        text="tracking of the attitude is effective",
        where="section 3, figure 9",
        needs=TURNED,
        compute=metrics.attitude_end,
        value=(
            "at most {0:.2f} deg in the last 100 s; after 1, 2, 5, 10 min of control {1:.1f}, "
            "{2:.1f}, {3:.1f}, {4:.2f} deg"
        ),
        unit="deg",
        reproduced=at_most(2.0),
        partly=at_most(10.0),
    ),
    Claim(
        name="wheel speeds",
        text="the wheel speeds stay bounded (a curve without comment in the paper)",
        where="section 3, figure 10",
        needs=(WHEELS, RATE),
        compute=metrics.wheel_speed,
        value="at most {0:.3f} rad/s, {1:.3f} rad/s in the last 100 s",
        unit="rad/s",
        reproduced=at_most(1.0),
        partly=at_most(10.0),
    ),
    Claim(
        name="inertias settle",
        text="all inertia estimates converge to constants",
        where="section 3, figure 11",
        needs=(ESTIMATES, RATE),
        compute=metrics.inertia_drift,
        value=(
            "move by up to {0:.1f} % of the largest element in the last 100 s: J {1:.2f}, "
            "A {2:.2f} kg m2"
        ),
        unit="%",
        reproduced=at_most(0.5),
        partly=at_most(2.0),
    ),
    Claim(
        name="inertias are not the truth",
        text="the estimated inertias are not the true inertias",
        where="section 3, figure 11",
        needs=(ESTIMATES, RATE),
        compute=metrics.inertia_offset,
        value=(
            "up to {0:.0f} % of the largest element from the true values of the paper: J {1:.1f}, "
            "A {2:.1f} kg m2"
        ),
        unit="%",
        reproduced=at_least(5.0),
        partly=at_least(1.0),
    ),
    Claim(
        name="attitude law is asymptotically stable",
        text=(
            "the closed loop of the attitude is uniformly asymptotically stable (proved without "
            "disturbances)"
        ),
        where="below (21)",
        needs=TURNED,
        compute=metrics.attitude_decay,
        value="largest error {1:.2f} deg, 100 s later {2:.2f} deg, ratio {0:.2f}",
        unit="",
        reproduced=at_most(0.5),
        partly=at_most(0.9),
    ),
    Claim(
        name="grasp",
        text="once the attitude error has converged, the target can be grasped at any time",
        where="section 3, section 4",
        needs=(RANGE, REFERENCE, BETA_T, BETA_P, RATE),
        compute=metrics.grasp_share,
        value=(
            "rho_M +- 5 cm, beta_t <= 1 deg, beta_p <= 5 deg in {0:.0f} % of the last 200 s; "
            "beta_p <= {1:.1f} deg"
        ),
        unit="%",
        reproduced=at_least(100.0),
        partly=at_least(50.0),
    ),
)

PAPER = Paper(
    title=(
        "Zhu Y., Yang L.: 6-DOF synchronization control approach strategy for space robots "
        "capture mission. Journal of National University of Defense Technology 31(6), 2009, 43-49"
    ),
    needs=(RANGE, REFERENCE, BETA_T, BETA_P),
    claims=CLAIMS,
    cases=(Case("sync_approach"),),
)
