# SPDX-License-Identifier: BSD-2-Clause
"""Claims of the patent of Zhang et al. 2016 on the transposition of an assembly (docs/models.md E).

The patent contains no numbers, so the bands are this project's interpretation of its claims.
"""

from __future__ import annotations

from harness.mission.claim import Case, Claim, Paper, at_least, at_most

from . import evaluations as metrics
from .evaluations import (
    AIR,
    ARM,
    ATTITUDE,
    GRAVITY,
    INERTIAL,
    ITERATIONS,
    MOMENTUM,
    PEAK,
    PREDICTED,
    RATE,
    REFERENCE,
    RELATIVE_RATE,
    ROTATION,
    SHARE,
    STATUS,
    TOTAL,
)

CLAIMS = (
    Claim(
        name="flight attitude saturates",
        text="if the stack always points to the Earth, its actuators may saturate",
        where="step (4)",
        needs=(PEAK,),
        compute=metrics.first_peak,
        value="{0:.2f} of H_sat of the plan would be needed, {1:.0f} N m s",
        unit="of H_sat",
        reproduced=at_least(1.0),
    ),
    Claim(
        name="plan below saturation",
        text="repeated corrections of the attitude history lead to one without saturation",
        where="abstract, steps (4), (5)",
        needs=(STATUS, ITERATIONS, PEAK),
        compute=metrics.last_peak,
        value="{0:.3f} of H_sat of the plan after {1:.0f} steps: {2:.0f} -> {3:.0f} N m s",
        unit="of H_sat",
        reproduced=at_most(1.0 - 1e-9),
    ),
    Claim(
        name="every step helps",
        text="each correction reduces the momentum",
        where="abstract, step (5)",
        needs=(ITERATIONS, PEAK),
        compute=metrics.descent,
        value="each peak at most {0:.2f} of the one before, {1:.0f} steps",
        unit="",
        reproduced=at_most(1.0 - 1e-9),
    ),
    Claim(
        name="no saturation",
        text="during the transposition the momentum of the actuators does not saturate",
        where="abstract",
        needs=(SHARE, MOMENTUM),
        compute=metrics.peak_share,
        value="at most {0:.3f} of the gyros' capacity, at {2:.0f} s; momentum up to {1:.0f} N m s",
        unit="",
        reproduced=at_most(0.98),
        partly=at_most(1.0 - 1e-9),
    ),
    Claim(
        name="attitude tracking",
        text="the tracking controller lets the assembly follow the wanted attitude history",
        where="abstract, step (6)",
        needs=(ATTITUDE, REFERENCE),
        compute=metrics.tracking_error,
        value="within {0:.2g} deg, worst at {1:.0f} s, {2:.2g} deg at the end",
        unit="deg",
        reproduced=at_most(0.1),
        partly=at_most(1.0),
    ),
    Claim(
        name="transposition completed",
        text="the transposition is completed, the assembly ends in Earth-pointing attitude",
        where="abstract, step (5a)",
        needs=(ROTATION, RELATIVE_RATE, ARM[0]),
        compute=metrics.end_attitude,
        value="{0:.2g} deg and {1:.1g} deg/s from it, arm at {2:.2f} deg",
        unit="deg",
        reproduced=at_most(0.1),
        partly=at_most(1.0),
    ),
    Claim(
        name="momentum equation",
        text="the momentum of base, target and actuators changes by gravity gradient and drag",
        where="step (1)",
        needs=(TOTAL, INERTIAL, GRAVITY, AIR),
        compute=metrics.balance_error,
        value="within {0:.2g} ppm of H_sat of the plan; the external torques add {1:.0f} N m s",
        unit="ppm",
        reproduced=at_most(1.0),
        partly=at_most(100.0),
        interval=1.0,
    ),
    Claim(
        name="equation as printed",
        text="the equation holds with its printed term read as 2 m0 m1/(m0+m1) R x (R' x omega_0)",
        where="step (1), first equation",
        needs=(RATE, INERTIAL, *ARM),
        compute=metrics.printed_equation_error,
        value="misses the momentum by up to {0:.1f} % of H_sat, the torque by {1:.2f} N m",
        unit="%",
        reproduced=at_most(0.1),
        partly=at_most(1.0),
        interval=10.0,
    ),
    Claim(
        name="prediction",
        text="the simulated history of the momentum matches the transposition",
        where="steps (4), (6)",
        needs=(MOMENTUM, PREDICTED),
        compute=metrics.prediction_error,
        value="within {0:.2g} % of H_sat of the plan, {1:.2g} N m s",
        unit="%",
        reproduced=at_most(1.0),
        partly=at_most(5.0),
    ),
    Claim(
        name="integer gains",
        text="k1 and k2 are positive integers",
        where="step (6)",
        needs=(),
        compute=metrics.gains,
        value="k1 = {1:g}, k2 = {2:g} as run",
        unit="",
        reproduced=at_least(1.0),
    ),
)

PAPER = Paper(
    title="Zhang J., Zhang Zh., Liu Ch., Lin H., Dong W., He Y.: Transposition control method for "
    "a large assembly. Patent application CN106020225A, Beijing Institute of Control Engineering, "
    "2016",
    needs=(SHARE, ROTATION, REFERENCE),
    claims=CLAIMS,
    cases=tuple(Case("transposition", name) for name in ("default", "cluster", "printed_law")),
)
