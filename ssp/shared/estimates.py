# SPDX-License-Identifier: BSD-2-Clause
"""Comparison of the navigation estimates with the true states: errors with standard deviations,
innovations, availability of sensors.

The filters publish standard deviations but no correlations. A normalised error is therefore the sum
over three axes of the squared error divided by its variance.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from harness.results.result import Array, Result

from .samples import is_late

FILTER = "relative_filter"
BODIES = (
    "servicer.r_SN_N",
    "servicer.v_SN_N",
    "servicer.q_SN",
    "target.r_TN_N",
    "target.v_TN_N",
    "target.q_TN",
    "target.omega_TN_T",
)
ESTIMATES = tuple(
    f"{FILTER}.{name}"
    for name in ("r_SN_N", "v_SN_N", "q_SN", "r_TN_N", "v_TN_N", "q_TN", "omega_TN_T")
)
SIGMAS = ("sigma_rho_N", "sigma_drho_N", "sigma_theta_T", "sigma_omega_T")
SENSORS = ("star_tracker.star_valid", "gyro.gyro_valid", "pose_sensor.pose_valid")
FIXES = ("orbit_sensor.fix_valid",)
MOTION = (*BODIES, *ESTIMATES, *(f"{FILTER}.{name}" for name in SIGMAS))


class Errors(NamedTuple):
    """Errors of one part of the estimate, such as the relative position, and their standard
    deviations, (rows, 3) each in SI units; factor: converts them to the unit in the title.
    """

    title: str
    error: Array
    sigma: Array
    factor: float


# ---- errors


def rows(result: Result) -> tuple[slice, slice]:
    """Return two slices of rows: of the true states, and of the estimates of these states, which
    are in the next rows if the filter publishes them a sample later (ssp.shared.samples).
    """
    if len(result.time) > 2 and is_late(result, f"{FILTER}.q_TN"):
        return slice(0, -1), slice(1, None)
    return slice(None), slice(None)


def attitude_error(estimate: Array, truth: Array) -> Array:
    """Return the rotation vectors (rows, 3) [rad] of small attitude errors, from the estimated to
    the true attitude, given as quaternions (rows, 4): 4 times the modified Rodrigues parameters of
    q_hat* q.
    """
    w, v = estimate[:, :1], estimate[:, 1:]
    scalar = np.sum(estimate * truth, axis=1, keepdims=True)
    vector = w * truth[:, 1:] - truth[:, :1] * v - np.cross(v, truth[:, 1:])
    sign = np.where(scalar < 0, -1.0, 1.0)
    return np.asarray(4 * sign * vector / (1 + sign * scalar))


def errors(result: Result) -> tuple[Errors, ...]:
    """Return the errors (truth minus estimate) of relative position, its rate, attitude of the
    target, rate of the target.
    """
    true, sampled = rows(result)

    def difference(of_servicer: str, of_target: str) -> Array:
        relative = result[f"servicer.{of_servicer}"] - result[f"target.{of_target}"]
        estimate = result[f"{FILTER}.{of_servicer}"] - result[f"{FILTER}.{of_target}"]
        return np.asarray(relative[true] - estimate[sampled])

    found = (
        difference("r_SN_N", "r_TN_N"),
        difference("v_SN_N", "v_TN_N"),
        attitude_error(result[f"{FILTER}.q_TN"][sampled], result["target.q_TN"][true]),
        result["target.omega_TN_T"][true] - result[f"{FILTER}.omega_TN_T"][sampled],
    )
    titles = (
        "position, N axes [mm]",
        "velocity, N axes [mm/s]",
        "attitude of T [deg]",
        "rate of T [deg/s]",
    )
    factors = (1e3, 1e3, np.degrees(1.0), np.degrees(1.0))
    sigmas = (result[f"{FILTER}.{name}"][sampled] for name in SIGMAS)
    return tuple(map(Errors, titles, found, sigmas, factors))


def normalised(part: Errors) -> Array:
    """Return the squared errors divided by their variances, summed over three axes, (rows,); NaN or
    infinite where the standard deviation of an axis is 0.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.sum((part.error / part.sigma) ** 2, axis=1))


# ---- chi-square


def bounds(degrees: int, count: int = 1) -> tuple[float, float]:
    """Return the bounds within which the mean of `count` chi-square values with this number of
    degrees of freedom lies with a probability of 95 %.
    """
    from scipy.stats import chi2

    low, high = chi2.ppf((0.025, 0.975), degrees * count) / count
    return float(low), float(high)


def innovations(result: Result, filter_: str, name: str, stamp: str) -> tuple[Array, Array]:
    """Return the times (n,) [s] of the measurements that a filter has used, and the normalised
    innovation squared of each.

    name: name of the measurement in the outputs of the filter, such as `pose`; stamp: variable with
    the time stamp of the latest measurement.
    """
    nis = result[f"{filter_}.{name}_nis"]
    new = np.flatnonzero(np.diff(result[stamp]) > 0) + 1
    new = new[(nis[new] > 0) & (np.diff(nis)[new - 1] != 0)]
    return np.asarray(result.time[new]), np.asarray(nis[new])


def moving_mean(values: Array, count: int) -> Array:
    """Return the means of `count` successive values, len(values) - count + 1 of them."""
    total = np.cumsum(np.insert(values, 0, 0.0))
    return np.asarray((total[count:] - total[:-count]) / count)


KINDS = (
    ("poses", FILTER, "pose", "pose_sensor.pose_time", 6),
    ("stars", "attitude_filter", "star", "star_tracker.star_time", 3),
    ("fixes", "orbit_filter", "fix", "orbit_sensor.fix_time", 6),
)
"""Kinds of measurements: label, filter, name in the filter's outputs, time stamp, and number of
scalars in one measurement.
"""
NIS = tuple(f"{filter_}.{name}_nis" for _, filter_, name, _, _ in KINDS)
STAMPS = tuple(stamp for *_, stamp, _ in KINDS)


# ---- sensors, tracking


def availability(result: Result, name: str, begin: float = 1.0) -> float:
    """Return the share of the rows from t = `begin` [s] on in which a sensor has a measurement;
    name: variable that is 1 then.
    """
    return float(np.mean(result[name][result.time >= begin]))


def tracking(result: Result) -> tuple[Array, Array]:
    """Return the distances of the servicer from its reference position, true and estimated,
    (rows,) each [m].
    """
    true, sampled = rows(result)
    reference = result["guidance.rho_ref_N"][sampled]
    actual = (result["servicer.r_SN_N"] - result["target.r_TN_N"])[true]
    estimate = (result[f"{FILTER}.r_SN_N"] - result[f"{FILTER}.r_TN_N"])[sampled]
    actual_error, seen_error = (np.linalg.norm(x - reference, axis=1) for x in (actual, estimate))
    return np.asarray(actual_error), np.asarray(seen_error)
