# SPDX-License-Identifier: BSD-2-Clause
"""Claims of this project (not of a paper) about navigation (docs/models.md F): errors are within
their standard deviations, innovations follow chi-square, sensors are available.
"""

from __future__ import annotations

import numpy as np

from harness.mission.claim import (
    Band,
    Claim,
    NotExercisedError,
    NotJudgedError,
    Paper,
    at_least,
    at_most,
)
from harness.results.result import Result

from .estimates import (
    FIXES,
    KINDS,
    MOTION,
    NIS,
    SENSORS,
    STAMPS,
    availability,
    bounds,
    errors,
    innovations,
    tracking,
)

SETTLED = 100.0
"""Time after the start of the filters from which errors count [s]."""


def _late(result: Result, count: int) -> slice:
    if result.time[-1] <= 2 * SETTLED:
        raise NotExercisedError(
            f"the run ends at {result.time[-1]:g} s; the claim needs more than {2 * SETTLED:g} s"
        )
    return slice(int(np.searchsorted(result.time[:count], SETTLED)), None)


def within_bands(result: Result) -> tuple[float, ...]:
    """Return the share of the rows in which all errors are within 3 standard deviations on all axes
    [%], then this share for each error alone: of position, velocity, attitude and rate.
    """
    found = []
    for part in errors(result):
        late = _late(result, len(part.error))
        found.append(np.all(np.abs(part.error[late]) <= 3 * part.sigma[late], axis=1))
    return tuple(100 * float(np.mean(each)) for each in (np.all(found, axis=0), *found))


def mean_innovation(result: Result) -> tuple[float, ...]:
    """Return the mean normalised innovation squared divided by its degrees of freedom: first the
    value that is farthest from 1, then the values of the pose sensor (poses), the star tracker
    (stars) and the orbit sensor (fixes).
    """
    means = []
    for _, filter_, name, stamp, degrees in KINDS:
        time, nis = innovations(result, filter_, name, stamp)
        late = nis[time > SETTLED]
        if not len(late):
            raise NotJudgedError(f"the filter used no {name} measurement after {SETTLED:g} s")
        means.append(float(np.mean(late)) / degrees)
    return max(means, key=lambda mean: abs(mean - 1)), *means


def inside_bounds(result: Result) -> tuple[float, ...]:
    """Return the share of the poses whose normalised innovation squared is within the bounds that
    chi-square values with six degrees of freedom meet with a probability of 95 % [%].
    """
    _, filter_, name, stamp, degrees = KINDS[0]
    time, nis = innovations(result, filter_, name, stamp)
    low, high = bounds(degrees)
    late = nis[time > SETTLED]
    if not len(late):
        raise NotJudgedError(f"the filter used no pose measurement after {SETTLED:g} s")
    return (100 * float(np.mean((low <= late) & (late <= high))),)


def least_available(result: Result) -> tuple[float, ...]:
    """Return the availability of the least available sensor, then of every sensor [%]."""
    parts = [100 * availability(result, name) for name in (*SENSORS, *FIXES)]
    return min(parts), *parts


def tracking_in_truth(result: Result) -> tuple[float, ...]:
    """Return the ratio of the true to the estimated tracking error, then the true and the estimated
    error [mm]; each error is a root mean square over the rows after SETTLED.
    """
    true, estimate = tracking(result)
    late = _late(result, len(true))
    in_truth, on_estimates = (
        1e3 * float(np.sqrt(np.mean(np.square(values[late])))) for values in (true, estimate)
    )
    return in_truth / on_estimates, in_truth, on_estimates


CLAIMS = (
    Claim(
        name="errors within their bands",
        text="errors stay within three standard deviations",
        where="docs/models.md F.6",
        needs=MOTION,
        compute=within_bands,
        value="{0:.1f} % (rho {1:.1f}, its rate {2:.1f}, attitude {3:.1f}, rate {4:.1f})",
        unit="%",
        reproduced=at_least(95),
        partly=at_least(85),
        interval=1.0,
    ),
    Claim(
        name="mean innovations",
        text="innovations are as large as expected",
        where="docs/models.md F.3",
        needs=(*NIS, *STAMPS),
        compute=mean_innovation,
        value="{0:.3f} of the mean of chi-square (poses {1:.3f}, stars {2:.3f}, fixes {3:.3f})",
        unit="",
        reproduced=Band(0.9, 1.1),
        partly=Band(0.7, 1.4),
        interval=0.5,
    ),
    Claim(
        name="innovations of poses",
        text="the normalised innovation of a pose follows chi-square with six degrees of freedom",
        where="docs/models.md F.3",
        needs=(*NIS, *STAMPS),
        compute=inside_bounds,
        value="{0:.1f} % of the poses within the bounds of 95 %",
        unit="%",
        reproduced=at_least(93),
        partly=at_least(85),
        interval=0.5,
    ),
    Claim(
        name="availability",
        text="every sensor delivers measurements throughout",
        where="docs/models.md F.2",
        needs=(*SENSORS, *FIXES),
        compute=least_available,
        value="{0:.1f} % (star tracker {1:.1f}, gyro {2:.1f}, camera {3:.1f}, receiver {4:.1f})",
        unit="%",
        reproduced=at_least(99),
        partly=at_least(80),
    ),
    Claim(
        name="tracking",
        text="the true tracking error agrees with the error on estimates",
        where="docs/models.md F.7",
        needs=(*MOTION, "guidance.rho_ref_N"),
        compute=tracking_in_truth,
        value="{1:.1f} mm in truth, {2:.1f} mm on estimates",
        unit="",
        reproduced=at_most(1.2),
        partly=at_most(2),
        interval=1.0,
    ),
)

PAPER = Paper(
    title="Navigation (docs/models.md F)",
    needs=(*NIS, *STAMPS),
    claims=CLAIMS,
)
