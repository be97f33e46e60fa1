# SPDX-License-Identifier: BSD-2-Clause
"""Runs of ppc_tracking and what is measured on them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

import numpy as np

from harness import run
from harness.results.result import Result

from ..reference import ppc_case
from ..reference.attitude import Array
from ..reference.los import inertial
from ..reference.orbit import hill_frame, state_of_elements

LOS = ("range", "elevation", "azimuth")
BAND = 5.6
"""m, 2 % of the initial range error of 280 m: the band behind the convergence times"""


@cache
def recording(controller: str, params: str = "nominal") -> Result:
    """A whole run, made once for all tests that look at it."""
    return run("ppc_tracking", params=params, swap={"controller": controller})


def los(result: Result, name: str) -> Array:
    """History of a vector of LOS coordinates, (rows, 3)."""
    return np.stack([result[f"{name}.{coordinate}"] for coordinate in LOS], axis=1)


def settled(result: Result, error: Array, band: float) -> float:
    """Last time outside the band [s]."""
    outside = np.flatnonzero(np.abs(error) > band)
    return float(result.time[outside[-1]]) if len(outside) else 0.0


def range_error(result: Result) -> Array:
    return result["guidance.range"] - 20.0


def attitude_error(result: Result) -> Array:
    """Angle from the reference attitude at the same sample [rad]."""
    q = result["controller.q_SD"]
    return 2 * np.arctan2(np.linalg.norm(q[:, 1:], axis=1), q[:, 0])


def after(result: Result, seconds: float, values: Array) -> float:
    """Largest magnitude after a time."""
    return float(np.max(np.abs(values[result.time > seconds])))


def effort(result: Result) -> float:
    """Integral of the commanded acceleration, summed over the LOS axes [m/s]."""
    return float(
        np.sum(np.abs(result["controller.a_cmd_L"][1:])) * (result.time[1] - result.time[0])
    )


def start(q: Array, dq: Array) -> dict[str, list[float]]:
    """Settings that start the servicer at these LOS coordinates (Y up) and rates."""
    r, v = inertial(np.asarray(q), np.asarray(dq))
    elements = {
        name: ppc_case.ORBIT[name] for name in ("mu", "a", "e", "inc", "argp", "raan", "nu")
    }
    C_HN = hill_frame(*state_of_elements(**elements), ppc_case.ORBIT["mu"])
    return {
        "servicer.rho_0_H": (C_HN.x @ -r).tolist(),
        "servicer.drho_0_H": (C_HN.x @ -v + C_HN.d @ -r).tolist(),
    }


def history(result: Result, name: str) -> Array:
    """Variable or LOS coordinates by name."""
    return result[name] if name in result else los(result, name)


def deviations(
    result: Result, expected: Mapping[str, Array], names: Callable[[str], bool]
) -> dict[str, Any]:
    """Largest differences of the histories whose name passes, relative to 1 + their size; row by
    row equal in time.
    """
    found = {}
    for name, values in expected.items():
        if names(name):
            rows = history(result, name)[: len(values)].reshape(values.shape)
            found[name] = float(np.max(np.abs(rows - values)) / (1 + np.max(np.abs(values))))
    return found
