# SPDX-License-Identifier: BSD-2-Clause
"""Claims of Guo, Li, Fan & Meng 2014 on the pitch motion of a locked space robot (docs/models.md
D).

The paper states neither the start of the motion nor its duration, so a verdict applies to one run
only: with other starts tumbling begins at other eccentricities. The eccentricity of a run
determines which claims belong to it.
"""

from __future__ import annotations

from harness.mission.claim import Band, Case, Claim, Paper, at_least, at_most
from harness.results.result import Result

from . import evaluations as metrics
from .evaluations import ANGLES, ECCENTRICITY, MOTION
from .pitch import PITCH

PERIODIC, FIRST, LAST, END = 0.005, 0.06331, 0.06872, 0.08594
"""Eccentricities of the paper: end of periodic motion, begin and end of the window of tumbling, end
of quasi-periodic motion.
"""
INTERVAL = 600.0
"""Largest permitted time between rows, a tenth of an orbit [s]."""


def _tumbles(where: str, text: str) -> Claim:
    return Claim(
        name="tumbling",
        text=text,
        where=where,
        needs=MOTION,
        compute=metrics.largest_turn,
        value="up to {0:.1f} deg from the equilibrium in {1:.0f} orbits",
        unit="deg",
        reproduced=at_least(180.0),
        interval=INTERVAL,
    )


def _librates(text: str, where: str) -> Claim:
    return Claim(
        name="libration",
        text=text,
        where=where,
        needs=MOTION,
        compute=metrics.largest_turn,
        value="up to {0:.1f} deg from the equilibrium in {1:.0f} orbits",
        unit="deg",
        reproduced=at_most(180.0),
        interval=INTERVAL,
    )


EQUILIBRIUM = Claim(
    name="equilibrium",
    text="the smallest amplitude of the pitch, at the equilibrium, is 25 deg",
    where="section 3.1, figure 3",
    needs=(PITCH, ANGLES),
    compute=metrics.equilibrium,
    value="theta_hat = {0:.2f} deg off the local vertical, kappa = {1:.4f}",
    unit="deg",
    reproduced=Band(24.0, 26.0),
    partly=Band(20.0, 30.0),
    interval=INTERVAL,
)
CRITICAL = Claim(
    name="critical rate",
    text="on a circular orbit the robot tumbles if it starts above the critical rate, not below",
    where="section 3.1, (9)",
    needs=MOTION,
    compute=metrics.critical_rate,
    value="agreement with (9): {0:.0f} (1: yes, 0: no); starts at {1:.3f} of the critical rate, "
    "turns up to {2:.1f} deg from the equilibrium",
    unit="",
    reproduced=at_least(1.0),
)
CLOSED = Claim(
    name="closed curve",
    text="on a circular orbit the phase curve is a level line of the first integral (6)",
    where="section 3.1, (6), figure 2",
    needs=MOTION,
    compute=metrics.level_change,
    value="delta'^2 + kappa sin^2 delta changes by {0:.1g} of kappa",
    unit="",
    reproduced=at_most(1e-4),
    partly=at_most(1e-2),
)
ONE_POINT = Claim(
    name="periodic",
    text="for e < 0.005 the motion is periodic",
    where="section 3.2, figure 6 (a)",
    needs=MOTION,
    compute=metrics.strobe_spread,
    value="the points of the Poincare section spread over {0:.2f} of the swing in {1:.0f} orbits",
    unit="",
    reproduced=at_most(0.01),
    partly=at_most(0.1),
    interval=INTERVAL,
)

FREE = (
    "stop",
    "robot.a",
    "robot.e",
    "robot.nu",
    "robot.euler_0",
    "robot.deuler_0",
)
"""Parameters whose values may differ from the values in the system, and `stop`, for any stop time:
the paper states neither orbit nor start nor duration, and its sections consider different
eccentricities.
"""

TABLES: dict[str, tuple[float, float, tuple[Claim, ...]]] = {
    "circular orbit": (0.0, 0.0, (EQUILIBRIUM, CRITICAL, CLOSED)),
    "e below 0.005": (1e-12, PERIODIC, (EQUILIBRIUM, ONE_POINT)),
    "e from 0.005 to 0.06331": (
        PERIODIC,
        FIRST,
        (EQUILIBRIUM, _librates("quasi-periodic, no tumbling", "section 3.2, figures 5, 6")),
    ),
    "e from 0.06331 to 0.06872": (
        FIRST,
        LAST,
        (EQUILIBRIUM, _tumbles("section 3.2, figure 5", "a window of tumbling")),
    ),
    "e from 0.06872 to 0.08594": (
        LAST,
        END,
        (EQUILIBRIUM, _librates("quasi-periodic again", "section 3.2, figures 5, 6 (f)")),
    ),
    "e above 0.08594": (
        END,
        1.0,
        (EQUILIBRIUM, _tumbles("section 3.2, figure 9", "tumbling for e > 0.08594")),
    ),
}
"""Lower and upper limit of the eccentricity, and claims, for each part of the paper. An upper limit
itself belongs to the next part.
"""


def _paper(part: str, low: float, high: float, claims: tuple[Claim, ...]) -> Paper:
    def meant(result: Result) -> bool:
        e = float(result.parameter(ECCENTRICITY))
        return metrics.locked(result) and (e == low == high or low <= e < high)

    return Paper(
        title="Guo S., Li D., Fan C., Meng Y.: Nonlinear attitude dynamics of a space robot under "
        f"gravity gradient. Acta Physica Sinica 63, 2014, 100504: {part}",
        needs=(*MOTION, ANGLES),
        parameters=metrics.SHAPE,
        claims=claims,
        meant=meant,
        cases=(Case("space_robot", free=FREE),),
    )


PAPERS = tuple(_paper(part, *rest) for part, rest in TABLES.items())
