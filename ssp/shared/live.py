# SPDX-License-Identifier: BSD-2-Clause
"""Expressions from which a live page computes the metrics of an approach, for the runs that it
simulates in the browser. The functions return such expressions as text.

ssp/shared/relative_motion.py and metrics.py compute the same quantities from the rows of a result.
"""

from __future__ import annotations

from harness.mission import Limits
from harness.results.result import Result

from .relative_motion import (
    ATTITUDE,
    DISTANCE,
    REFERENCE,
    REFERENCE_ATTITUDE,
    RELEASE,
    SERVICER,
    TARGET,
    release_time,
)
from .samples import is_late

FIRST_RANGE = f"first({DISTANCE})"
TORQUE_IMPULSE = "propulsion.torque_impulse"
TORQUES = ("propulsion.M_S", "servicer.wheel_speed")
STEP = "(time - previous(time) + (time == first(time)) * 1 s)"
"""Expression: time since the row before. For the first row it is 1 s instead of 0: a rate, change
divided by STEP, is then 0 there and not 0/0.
"""


def at_samples(result: Result, name: str, error: str) -> str:
    """Return the expression `error` with the outputs of a sampled component aligned to the states
    of the plants (ssp/shared/samples.py).

    name: an output of that component; error: text of the expression, with {} in front of states of
    plants. {} is replaced by `previous` if the outputs for a state are in the next row of the
    result, else by nothing.
    """
    late = is_late(result, name)
    return f"next({error.format('previous')})" if late else error.format("")


def position_error(result: Result) -> str:
    """Return the expression of the distance of the servicer from its reference position [m]."""
    return at_samples(result, REFERENCE, f"norm({{}}({SERVICER} - {TARGET}) - {REFERENCE})")


def range_error(result: Result) -> str:
    """Return the expression of the absolute difference between the range and the range of the
    reference position [m].
    """
    error = f"abs(norm({{}}({SERVICER} - {TARGET})) - norm({REFERENCE}))"
    return at_samples(result, REFERENCE, error)


def reference_range(result: Result) -> str:
    """Return the expression of the range of the reference position [m]."""
    return at_samples(result, REFERENCE, f"norm({REFERENCE})")


def attitude_error(result: Result) -> str:
    """Return the expression of the angle between the attitude of the servicer and the reference
    attitude [rad].
    """
    error = f"angle({{}}({ATTITUDE}), {REFERENCE_ATTITUDE})"
    return at_samples(result, REFERENCE_ATTITUDE, error)


def first_time(condition: str) -> str:
    """Return the expression of the time of the first row in which a condition holds [s]; infinite
    without such a row.
    """
    since = f"(time - first(time) + 1 s) / ({condition})"
    return f"min({since}) + first(time) - 1 s"


# ---- attitude from release_time() on; before that time, the attitude of the servicer is frozen


def released(result: Result) -> str:
    """Return the expression that is true in rows from release_time() on, in which the attitude of
    the servicer is not frozen.
    """
    known = result.holds(parameters=(RELEASE,))
    release = f"parameter({RELEASE})" if known else f"{min(release_time(result), 1e300)!r} s"
    return f"time >= {release}"


def since_release(result: Result) -> str:
    """Return the expression of the time from the first row in which the attitude of the servicer
    is not frozen to the last row [s].
    """
    return f"max((last(time) - time) * ({released(result)}))"


def attitude_settles(result: Result, limits: Limits) -> str:
    """Return the expression of the time after which the attitude error stays within its band
    [s], counted from the end of the time in which the attitude of the servicer is frozen.
    """
    error = f"degrees({attitude_error(result)}) * ({released(result)})"
    frozen = f"(last(time) - first(time) - {since_release(result)})"
    settled = f"(settling_time(time, {error}, {limits.attitude!r}) - {frozen})"
    return f"{settled} * ({settled} > 0) / (last({released(result)}))"


def attitude_steady(result: Result, _: Limits) -> str:
    """Return the expression of the largest attitude error [deg] in the last fifth of the time in
    which the attitude of the servicer is not frozen.
    """
    late = f"(last(time) - time <= 0.2 * {since_release(result)})"
    error = f"max(degrees({attitude_error(result)}) * {late})"
    return f"{error} / (last({released(result)}))"


# ---- cost


def delta_v(result: Result, _: Limits) -> str:
    """Return the expression of delta-v [m/s]: the sum of the impulses of all thrusters or axes
    divided by the mass of the servicer.
    """
    del result
    impulse = "propulsion.impulse"
    return f"sum(total({impulse} - previous({impulse})) / servicer.mass)"


def acting(result: Result) -> str:
    """Return the expression that is true if the attitude of the servicer is not frozen in a row and
    in the row before.
    """
    return f"(time > last(time) - {since_release(result)}) * ({released(result)})"


def wheel_torque(result: Result) -> list[str]:
    """Return three expressions, one per axis: mean torque of the wheels on the body since the row
    before [N m].
    """
    wheels = range(1, result["servicer.wheel_speed"].shape[1] + 1)
    change = f"(servicer.wheel_speed - previous(servicer.wheel_speed)) / {STEP}"
    unit = "(1 N.m) / (1 kg.m2.rad/s2)"
    sums = (
        " + ".join(f"parameter(servicer.A_w[{axis},{k}]) * ({change})[{k}]" for k in wheels)
        for axis in (1, 2, 3)
    )
    return [f"(-({each}) * {unit})" for each in sums]


def torque_impulse(result: Result, _: Limits) -> str:
    """Return the expression of the integral of the torque of thrusters and wheels on the body while
    its attitude is not frozen, summed over the axes [N m s].
    """
    thrusters = f"({TORQUE_IMPULSE} - previous({TORQUE_IMPULSE}))"
    if TORQUE_IMPULSE not in result:
        thrusters = f"abs({TORQUES[0]}) * {STEP}"
    wheels = " + ".join(f"abs({each})" for each in wheel_torque(result))
    free = acting(result)
    return f"sum({thrusters} * {free}) + sum(({wheels}) * {STEP} * {free})"


def peak_torque(result: Result, _: Limits) -> str:
    """Return the expression of the largest torque of thrusters and wheels on the body while
    its attitude is not frozen [N m].
    """
    axes = enumerate(wheel_torque(result), 1)
    square = " + ".join(f"({TORQUES[0]}[{axis}] + {wheels}) ** 2" for axis, wheels in axes)
    return f"max(sqrt({square}) * {acting(result)}) / (last({released(result)}))"
