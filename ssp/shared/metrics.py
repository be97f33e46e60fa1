# SPDX-License-Identifier: BSD-2-Clause
"""Metrics by which runs are compared: errors against the reference of the guidance, safety, cost.

A metric is computed if the result contains its variables, so systems without a reference have fewer
metrics. The bands within which errors count as settled are common to all runs of a comparison. Most
metrics are expressions, which a live page also evaluates for its own runs (ssp/shared/live.py).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from harness.mission import Limits, Metric
from harness.results.expressions import STEADY, settling_time, steady_error
from harness.results.histories import minus, total
from harness.results.result import Array, Result

from . import estimates, live, optima, safety
from . import relative_motion as derived
from .relative_motion import DISTANCE, attitude_error, initial_range, release_time

APART = 10.0
"""Ratio of the peak forces, or peak torques, of two runs above which a comparison warns that their
controllers cannot have the same actuators.
"""
BAND = 1e-3
"""Default band of the position error as a share of the largest initial range of all runs."""


def bands(limits: Limits, results: Mapping[str, Result]) -> Limits:
    """Return the limits with a position band [m]: the given one, or else the default for these runs
    (BAND times the largest initial range).
    """
    if limits.position is not None:
        return limits
    approaches = (r for r in results.values() if r.holds(*POSITION[:2]) and len(r.time))
    return replace(limits, position=BAND * max(map(initial_range, approaches), default=0.0))


def definitions(limits: Limits) -> Iterator[str]:
    """Yield the notes below a table of comparison, which define columns that need a definition."""
    if not limits.position:
        return
    yield "settles: time after which the error stays within the band; -: it does not stay. error:"
    yield "  largest in the last fifth of the run. Attitude: both count once it is free to turn."
    yield "  inside reference: largest range shortfall against the reference. saturated: share of"
    yield "  rows with a limit reached. margin: least margin of a safety rule, also between rows"


# ---- errors against the reference

POSITION = (derived.SERVICER, derived.TARGET, derived.REFERENCE)
ATTITUDE = (derived.ATTITUDE, derived.REFERENCE_ATTITUDE)


def _controlled(result: Result) -> tuple[Array, Array]:
    """Return times [s] and attitude errors [deg] of the rows from release_time() on. Before, the
    plant holds the attitude of the servicer.
    """
    begun = result.time >= release_time(result)
    return result.time[begun], np.degrees(attitude_error(result)[begun])


def _band(limits: Limits) -> str:
    """Return the band of the position error as text for an expression. If `limits` has no position
    band, or an infinite one, it is the default band.
    """
    band = limits.position
    return f"{BAND} * {live.FIRST_RANGE}" if band is None or not np.isfinite(band) else repr(band)


def _range_settles(result: Result, limits: Limits) -> str:
    return f"settling_time(time, {live.range_error(result)}, {_band(limits)})"


def _position_settles(result: Result, limits: Limits) -> str:
    return f"settling_time(time, {live.position_error(result)}, {_band(limits)})"


def _attitude_settles(result: Result, limits: Limits) -> float:
    time, error = _controlled(result)
    return settling_time(time, error, limits.attitude) if len(time) else float("nan")


def _steady(error: Callable[[Result, slice], Array], result: Result, begin: float) -> float:
    """Return the largest error in the last fifth of the time after `begin`; NaN without such rows.

    `error` takes the result and a slice of rows. The slice also contains the row before these rows,
    because an error that is unknown in the last row is replaced by the error of the row before.
    """
    time = result.time[result.time >= begin]
    if not len(time):
        return float("nan")
    first = int(np.argmax(result.time >= time[-1] - STEADY * (time[-1] - time[0])))
    before = max(0, first - 1)
    return float(np.max(error(result, slice(before, None))[first - before :]))


def _attitude_steady(result: Result, _: Limits) -> float:
    return float(np.degrees(_steady(attitude_error, result, release_time(result))))


def _estimate_error(result: Result, part: int) -> float:
    """Return the largest error of a part of the estimate in the last fifth of the run; part: 0 for
    the position of S relative to T [m], 2 for the attitude of T [deg].
    """
    true, _ = estimates.rows(result)
    error = np.linalg.norm(estimates.errors(result)[part].error, axis=1)
    size = steady_error(result.time[true], np.asarray(error))
    return size if part == 0 else float(np.degrees(size))


def _estimate_nees(result: Result, _: Limits) -> float:
    """Return the mean, over the last fifth of the run, of the squared errors of the relative motion
    divided by their variances and summed over its 12 elements: 12 for a consistent filter.
    """
    true, _rows = estimates.rows(result)
    total = np.sum([estimates.normalised(part) for part in estimates.errors(result)], axis=0)
    time = result.time[true]
    return float(np.mean(total[time >= time[-1] - STEADY * (time[-1] - time[0])]))


# ---- safety


def _inside_reference(result: Result, _: Limits) -> str:
    """Return the expression of the largest amount by which the range is below the range of the
    reference position [m], 0 if it never is.
    """
    short = f"max({live.reference_range(result)} - {DISTANCE})"
    return f"({short} + abs({short})) / 2"


def _margin(rule: str, result: Result, _: Limits) -> float:
    """Return the least margin of a rule of the monitor in the run, in the unit of the rule."""
    return safety.least_margin(result, rule)


# ---- cost

OFTEN = 20.0
"""Share of rows at a limit [%] above which a comparison shows the metric of an actuator."""
WHEEL_LIMIT, FULL = "servicer.wheel_speed_max", 1e-9
"""Parameter with the largest speed of a wheel; relative difference from it at which a wheel counts
as being at this limit.
"""
LIMIT_FLAGS = ("F_saturated", "M_saturated", "a_saturated", "infeasible", "saturated")
"""Outputs of actuators, allocation and controllers that are 1 where a limit is reached."""


def _delta_v(result: Result, _: Limits) -> float:
    """Return delta-v [m/s]: the sum of the impulses of all thrusters or axes divided by the mass of
    the servicer.
    """
    impulse = result["propulsion.impulse"]
    spent = total(minus(impulse[1:], impulse[:-1]))
    return float(np.sum(spent / result["servicer.mass"][1:]))


def _acting(result: Result) -> slice:
    """Return the rows from release_time() on. Torques in earlier rows do not turn the servicer,
    because the plant holds its attitude.
    """
    return slice(int(np.searchsorted(result.time, release_time(result))), None)


def _wheel_torque_steps(result: Result) -> Array:
    """Return the change of the momentum of the wheels from row to row, (rows - 1, 3) [N m s], for
    the rows from release_time() on. Before, the plant does not turn the servicer.
    """
    speed = result["servicer.wheel_speed"][_acting(result)]
    return np.asarray(np.diff(speed, axis=0) @ result.parameter("servicer.A_w").T)


def _torque_impulse(result: Result, _: Limits) -> float:
    """Return the integral of the absolute torque of the thrusters, and of the wheels, on the
    body of the servicer from release_time() on, summed over the axes [N m s]. Before, the plant
    does not turn the servicer.

    The propulsion publishes the integral for thrusters; without that output it is computed from the
    recorded torques. The integral for wheels is computed from the recorded wheel speeds.
    """
    acting = _acting(result)
    if not len(result.time[acting]):
        return 0.0
    if live.TORQUE_IMPULSE in result:
        thrusters = np.ptp(result[live.TORQUE_IMPULSE][acting], axis=0)
    else:
        steps = np.diff(result.time[acting])[:, None]
        thrusters = np.abs(result["propulsion.M_S"][acting][1:]) * steps
    return float(np.sum(thrusters) + np.sum(np.abs(_wheel_torque_steps(result))))


def _peak_torque(result: Result, _: Limits) -> float:
    """Return the largest torque of thrusters and wheels on the body of the servicer from
    release_time() on [N m]. Before, the plant does not turn the servicer. The torque of the wheels
    is the mean from row to row.
    """
    acting = _acting(result)
    steps = np.diff(result.time[acting])[:, None]
    if not len(steps):
        return float("nan")
    torque = result["propulsion.M_S"][acting][1:] - _wheel_torque_steps(result) / steps
    return float(np.linalg.norm(torque, axis=1).max())


def _saturated(result: Result, _: Limits) -> str | float:
    """Return the expression of the share of rows in which an actuator, allocation or controller is
    at a limit [%]; NaN without such a flag.
    """
    flags = [n for n in result.vectors if n.rpartition(".")[2] in LIMIT_FLAGS]
    return _share(*flags) if flags else float("nan")


def _share(*flags: str) -> str:
    """Return the expression of the share of rows in which one of these variables is not 0 [%]."""
    return f"100 * mean({' or '.join(f'norm({flag}) != 0' for flag in flags)})"


def _wheels_full(result: Result, _: Limits) -> str | float:
    """Return the expression of the share of rows in which a wheel has its largest speed [%]; NaN
    without a limit.
    """
    most = f"{1 - FULL!r} * parameter({WHEEL_LIMIT})"
    wheels = range(1, result["servicer.wheel_speed"].shape[1] + 1)
    full = " or ".join(f"abs(servicer.wheel_speed[{k}]) >= {most}" for k in wheels)
    return f"100 * mean({full})" if result.parameter(WHEEL_LIMIT) > 0 else float("nan")


def _within(limits: Limits, _: Mapping[str, Result]) -> str:
    """Return the band of the position error, which also applies to the range, as text."""
    return f"within {limits.position or 0.0:.3g} m"


def _turned_within(limits: Limits, results: Mapping[str, Result]) -> str:
    """Return as text the band of the attitude error, and the time from which errors count."""
    begins = {release_time(r) for r in results.values() if r.holds(*ATTITUDE)}
    since = f"from {begins.pop():g} s" if len(begins) == 1 else "once free to turn"
    return f"{limits.attitude:.3g} deg {since}"


ACTUATORS = {
    "force at limit": "propulsion.F_saturated",
    "torque at limit": "propulsion.M_saturated",
    "thrusters at limit": "allocation.infeasible",
}
"""Flags of actuators that are 1 where a limit is reached, by the name of the metric for the share
of these rows.
"""
AT_LIMITS = (
    *(Metric(name, "%", (), _share(flag), above=OFTEN) for name, flag in ACTUATORS.items()),
    Metric(
        "wheels at limit", "%", ("servicer.wheel_speed",), _wheels_full, (WHEEL_LIMIT,), above=OFTEN
    ),
)
SATURATED = Metric("saturated", "%", (), _saturated)
METRICS = (
    Metric("range settles", "s", POSITION, _range_settles, about=_within),
    Metric("position settles", "s", POSITION, _position_settles, about=_within),
    Metric(
        "attitude settles",
        "s",
        ATTITUDE,
        _attitude_settles,
        about=_turned_within,
        live=live.attitude_settles,
    ),
    Metric("range error", "m", POSITION, lambda r, _: f"steady(time, {live.range_error(r)})"),
    Metric("position error", "m", POSITION, lambda r, _: f"steady(time, {live.position_error(r)})"),
    Metric("attitude error", "deg", ATTITUDE, _attitude_steady, live=live.attitude_steady),
    Metric("minimum range", "m", (), f"min({DISTANCE})"),
    Metric("inside reference", "m", POSITION, _inside_reference),
    Metric("estimate error", "m", estimates.MOTION, lambda r, _: _estimate_error(r, 0)),
    Metric("estimate attitude", "deg", estimates.MOTION, lambda r, _: _estimate_error(r, 2)),
    Metric("estimate NEES", "", estimates.MOTION, _estimate_nees),
    *(
        Metric(f"{r.name} margin", r.unit, safety.FOUND, partial(_margin, r.name), beside=True)
        for r in safety.RULES
    ),
    Metric(
        "first violated",
        "1",
        safety.FOUND,
        lambda r, _: float(r[safety.VIOLATED][-1]),
        beside=True,
        words=("none", *(rule.name for rule in safety.RULES)),
    ),
    Metric(
        "first violation", "s", safety.FOUND, lambda r, _: safety.first_violation(r), beside=True
    ),
    Metric("delta-v", "m/s", ("propulsion.impulse", "servicer.mass"), _delta_v, live=live.delta_v),
    optima.METRIC,
    Metric(
        "torque impulse",
        "N m s",
        live.TORQUES,
        _torque_impulse,
        ("servicer.A_w",),
        live=live.torque_impulse,
    ),
    Metric("peak force", "N", (), "max(norm(propulsion.F_S))", apart=APART),
    Metric(
        "peak torque",
        "N m",
        live.TORQUES,
        _peak_torque,
        ("servicer.A_w",),
        apart=APART,
        live=live.peak_torque,
    ),
    SATURATED,
    *AT_LIMITS,
)
