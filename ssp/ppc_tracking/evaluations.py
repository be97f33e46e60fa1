# SPDX-License-Identifier: BSD-2-Clause
"""Evaluations of a line-of-sight approach for the claims of Yin et al. 2017.

The evaluation of a claim returns first the value that decides on the verdict, then further values
that the report shows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.mission.claim import ROUNDING, NotJudgedError, between, parameter, since
from harness.results.result import Array, Result

from ..shared.relative_motion import attitude_error

RANGE, ELEVATION = "guidance.range", "controller.error.elevation"
FEATURE, COMMAND = "guidance.beta_t", "controller.a_cmd_L"
ATTITUDES = ("servicer.q_SN", "guidance.q_DN")
FUNNEL = tuple(f"controller.{name}" for name in ("kappa", "kappa_att", "theta", "theta_att"))

STOP = 120.0
"""Duration of the run [s], which the paper does not state."""
BAND = 0.02
"""Share of the first range error within which the approach counts as converged."""
LATE, SETTLED, LAST = 40.0, 60.0, 20.0
"""Times from which errors count as steady, with a manoeuvre of the target (LATE) and without one
(SETTLED), and length of the last part of the run (LAST) [s].
"""


def manoeuvring(result: Result) -> bool:
    """Return whether the target manoeuvres in this run."""
    names = ("bias", "amplitude")
    return any(np.any(parameter(result, f"target.a_manoeuvre_N.{name}")) for name in names)


# ---- histories


def range_error(result: Result) -> Array:
    """Return the range minus the range of the hovering point, (rows,) [m]."""
    return np.asarray(result[RANGE] - parameter(result, "guidance.rho_f"))


def last_rows(result: Result) -> NDArray[np.intp]:
    """Return the indices of the rows in the last 20 s; raise NotExercisedError for a run that ends
    before 80 s.
    """
    since(result, 2 * LATE, 2 * LATE)
    return np.asarray(np.flatnonzero(result.time >= result.time[-1] - LAST - ROUNDING))


# ---- metrics


def convergence(result: Result) -> tuple[float, ...]:
    """Return the time after which the range error stays within 2 % of the first range error [s],
    and these 2 % [m]; raise NotJudgedError if the error is larger at the end of the run.
    """
    error = np.abs(range_error(result))
    band = BAND * error[0]
    outside = np.flatnonzero(error > band)
    between(result, 0.0, LATE)
    if len(outside) and outside[-1] + 1 == len(error):
        raise NotJudgedError(f"the range has not settled by {result.time[-1]:g} s")
    return (result.time[outside[-1]] if len(outside) else 0.0), band


def hovering(result: Result) -> tuple[float, ...]:
    """Return the largest range error after 60 s [m], and the largest angle after 60 s between the
    line of sight and the axis of the feature of the target above which the servicer hovers [deg].
    """
    rows = since(result, SETTLED, SETTLED)
    return np.abs(range_error(result)[rows]).max(), np.degrees(result[FEATURE][rows]).max()


def steady_range_error(result: Result) -> tuple[float, ...]:
    """Return the largest range error after 40 s and after 60 s [m]."""
    error = np.abs(range_error(result))
    return error[since(result, LATE, LATE)].max(), error[since(result, SETTLED, SETTLED)].max()


def last_range_error(result: Result) -> tuple[float, ...]:
    """Return the largest range error in the last 20 s [m]."""
    return (np.abs(range_error(result)[last_rows(result)]).max(),)


def steady_attitude_error(result: Result) -> tuple[float, ...]:
    """Return the largest attitude error after 60 s and in the last 20 s [deg]."""
    error = np.degrees(attitude_error(result))
    return error[since(result, SETTLED, SETTLED)].max(), error[last_rows(result)].max()


def overshoot(result: Result) -> tuple[float, ...]:
    """Return the overshoot of the elevation [deg] and the minimum range [m]. The overshoot is the
    largest error whose sign is opposite to the sign of the first error, 0 if there is none.
    """
    error = np.degrees(result[ELEVATION])
    between(result, 0.0, LATE)
    first = error[np.flatnonzero(error)[0]] if error.any() else 1.0
    return max(0.0, (-np.sign(first) * error).max()), result[RANGE].min()


def barrier(result: Result) -> tuple[float, ...]:
    """Return the largest barrier variable kappa of the controller, which must stay below 1, and the
    largest |theta|, the ratio of a generalised state to its bound; both over position and attitude.
    """
    kappa = max(result[name].max() for name in FUNNEL[:2])
    return kappa, max(np.abs(result[name]).max() for name in FUNNEL[2:])


def chatter(result: Result) -> tuple[float, ...]:
    """Return the total variation of the commanded acceleration after 60 s, divided by its
    maximum minus its minimum, and the total variation [m/s2], each for the axis with the largest
    value. The first value is 2 per period for a sinusoid.
    """
    command = result[COMMAND][since(result, SETTLED, 2 * LATE)]
    variation, span = np.abs(np.diff(command, axis=0)).sum(axis=0), np.ptp(command, axis=0)
    return (variation / span).max(), variation.max()
