"""Measures by which runs are compared: errors against the reference of the guidance, safety, and
what it has cost.

A measure is taken if the result holds what it needs, so systems without a reference simply have
fewer of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.results import derived, pitch
from harness.results.derived import attitude_error, position_error, range_, range_error
from harness.results.result import Result

Array = NDArray[np.float64]

BAND = 0.02
"""An error has settled when it stays within this part of its largest value."""

STEADY = 0.2
"""Last part of a run that counts as steady."""


@dataclass(frozen=True)
class Measure:
    """One column: heading, unit, variables and parameters that it needs, and the function of the
    result.
    """

    name: str
    unit: str
    needs: tuple[str, ...]
    value: Callable[[Result], float]
    parameters: tuple[str, ...] = ()

    def __call__(self, result: Result) -> float:
        """The value; NaN if the result does not hold what it needs, or there is no such
        value.
        """
        fits = result.holds(*self.needs, parameters=self.parameters)
        return float(self.value(result)) if fits else float("nan")


# ---- errors against the reference

POSITION = (derived.SERVICER, derived.TARGET, derived.REFERENCE)
ATTITUDE = (derived.ATTITUDE, derived.REFERENCE_ATTITUDE)
ATTITUDE_START = "servicer.t_att"
"""Attitude control begins at this time."""


def settling_time(time: Array, error: Array) -> float:
    """Time [s] after which an error (rows,) stays within 2 % of its largest value; NaN if it never
    does.
    """
    outside = np.flatnonzero(error > BAND * np.max(error))
    first_inside = outside[-1] + 1 if len(outside) else 0
    return float(time[first_inside] - time[0]) if first_inside < len(time) else float("nan")


def steady_error(time: Array, error: Array) -> float:
    """Largest error (rows,) in the last fifth of the time."""
    return float(np.max(error[time >= time[-1] - STEADY * (time[-1] - time[0])]))


def _controlled(result: Result) -> tuple[Array, Array]:
    """Time and attitude error [deg] since the beginning of attitude control."""
    begun = result.time >= result.parameter(ATTITUDE_START)
    return result.time[begun], np.degrees(attitude_error(result)[begun])


def _attitude_settling(result: Result) -> float:
    time, error = _controlled(result)
    return settling_time(time, error) if len(time) else float("nan")


def _attitude_steady(result: Result) -> float:
    time, error = _controlled(result)
    return steady_error(time, error) if len(time) else float("nan")


# ---- cost


def _delta_v(result: Result) -> float:
    """Impulse of all thrusters or axes over the mass [m/s]."""
    impulse = np.sum(np.diff(result["propulsion.impulse"], axis=0), axis=1)
    return float(np.sum(impulse / result["servicer.mass"][1:]))


TORQUE_IMPULSE = "propulsion.torque_impulse"


def _torque_impulse(result: Result) -> float:
    """Integral of the torque of thrusters and wheels on the body, summed over the axes [N m s].

    As the propulsion counts it, else from the torques of the rows; the wheels always from the
    speeds of the rows.
    """
    if TORQUE_IMPULSE in result:
        thrusters = result[TORQUE_IMPULSE][-1] - result[TORQUE_IMPULSE][0]
    else:
        thrusters = np.abs(result["propulsion.M_S"][1:]) * np.diff(result.time)[:, None]
    wheels = np.abs(
        np.diff(result["servicer.wheel_speed"], axis=0) @ result.parameter("servicer.A_w").T
    )
    return float(np.sum(thrusters) + np.sum(wheels))


MEASURES = (
    Measure("range settles", "s", POSITION, lambda r: settling_time(r.time, range_error(r))),
    Measure("position settles", "s", POSITION, lambda r: settling_time(r.time, position_error(r))),
    Measure("attitude settles", "s", ATTITUDE, _attitude_settling, (ATTITUDE_START,)),
    Measure("range error", "m", POSITION, lambda r: steady_error(r.time, range_error(r))),
    Measure("position error", "m", POSITION, lambda r: steady_error(r.time, position_error(r))),
    Measure("attitude error", "deg", ATTITUDE, _attitude_steady, (ATTITUDE_START,)),
    Measure("least range", "m", POSITION[:2], lambda r: float(np.min(range_(r)))),
    Measure("delta-v", "m/s", ("propulsion.impulse", "servicer.mass"), _delta_v),
    Measure(
        "torque impulse",
        "N m s",
        ("propulsion.M_S", "servicer.wheel_speed"),
        _torque_impulse,
        ("servicer.A_w",),
    ),
    Measure("pitch swing", "deg", (pitch.PITCH,), pitch.swing),
    Measure(
        "rotation number",
        "1/orbit",
        (pitch.PITCH, pitch.RATE, pitch.ANOMALY),
        pitch.rotation_number,
    ),
)
