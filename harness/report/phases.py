# SPDX-License-Identifier: BSD-2-Clause
"""Phase plots: a quantity against its rate, for every result that holds both."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.report.plots import AXES, DASHES, Canvas, Plot
from harness.report.thinning import kept_points
from harness.results.derived import SERVICER, TARGET, VELOCITIES, range_, release_time
from harness.results.result import Result

Array = NDArray[np.float64]


class Phase(NamedTuple):
    """A phase plot: title, labels of the axes, what it needs, (rows,) or (rows, n) of both."""

    title: str
    x: str
    y: str
    needs: tuple[str, ...]
    value: Callable[[Result], Array]
    rate: Callable[[Result], Array]
    acting: bool = False
    """Only from the release of the attitude on."""


def _range_rate(result: Result) -> Array:
    """Derivative of the range, (rows,) [m/s]."""
    rho = result[SERVICER] - result[TARGET]
    drho = result[VELOCITIES[0]] - result[VELOCITIES[1]]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sum(rho * drho, axis=1) / range_(result))


def _of(name: str, factor: float = 1.0) -> Callable[[Result], Array]:
    return lambda result: np.asarray(factor * result[name])


DEG = float(np.degrees(1.0))
PHASES = (
    Phase(
        "Range", "range [m]", "its rate [m/s]", (SERVICER, TARGET, *VELOCITIES), range_, _range_rate
    ),
    Phase(
        "Attitude error",
        "MRP of S relative to D",
        "rate error [deg/s]",
        ("controller.epsilon", "controller.domega_S"),
        _of("controller.epsilon"),
        _of("controller.domega_S", DEG),
        acting=True,
    ),
    Phase(
        "Pitch",
        "pitch [deg]",
        "its rate [deg/s]",
        ("robot.pitch", "robot.pitch_rate"),
        _of("robot.pitch", DEG),
        _of("robot.pitch_rate", DEG),
    ),
    Phase(
        "Joints",
        "joint angle [deg]",
        "joint rate [deg/s]",
        ("robot.joint_angle", "robot.joint_rate"),
        _of("robot.joint_angle", DEG),
        _of("robot.joint_rate", DEG),
    ),
    Phase(
        "Tracking of the planned attitude",
        "vector part of the error",
        "rate error [deg/s]",
        ("controller.eps_e", "controller.domega_S"),
        _of("controller.eps_e"),
        _of("controller.domega_S", DEG),
    ),
)


def phases(canvas: Canvas, result: Result) -> Iterator[Plot]:
    """Phase plots of a result whose quantities move."""
    for phase in PHASES:
        if not result.holds(*phase.needs):
            continue
        first = int(np.searchsorted(result.time, release_time(result))) if phase.acting else 0
        columns = [
            np.atleast_2d(values.T).T[first:]
            for values in (phase.value(result), phase.rate(result))
        ]
        if all(c.size and np.nanmax(c) > np.nanmin(c) for c in columns):
            yield _plot(canvas, phase, *columns)


def _plot(canvas: Canvas, phase: Phase, x: Array, y: Array) -> Plot:
    curves = []
    for k in range(x.shape[1]):
        rows = kept_points(x[:, k], y[:, k], canvas.points)
        canvas.thinned |= len(rows) < len(x)
        name = "" if x.shape[1] == 1 else AXES[k] if x.shape[1] == 3 else str(k + 1)
        curves.append(
            {
                "name": name,
                "x": canvas.arrays.keep(x[rows, k]),
                "y": canvas.arrays.keep(y[rows, k]),
                "colour": k,
                "dash": DASHES[k],
                "ends": True,
            }
        )
    return {"title": phase.title, "x": phase.x, "y": phase.y, "time": False, "curves": curves}
