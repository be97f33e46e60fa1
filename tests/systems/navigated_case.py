# SPDX-License-Identifier: BSD-2-Clause
"""Runs of sync_approach_navigated and their errors: estimates and tracking against the truth."""

from __future__ import annotations

from functools import cache

import numpy as np

from harness import run
from harness.results.result import Result

SYSTEM = "sync_approach_navigated"
TRUTH_FED = (
    "servicer.t_att=0",
    "controller.t_att=0",
    "servicer.sigma_SN_0=[0.33,0.6,0.38]",
    "servicer.M_dist_S.start=0",
)
"""Changes that turn sync_approach, parameter set robust, into the same run on truth."""


@cache
def recording(params: str = "nominal", changes: tuple[str, ...] = (), **options) -> Result:
    return run(SYSTEM, params=params, set=changes, **options)


def arrays_of_dcm(q: np.ndarray) -> np.ndarray:
    """C of each row, stacked."""
    w, x, y, z = q.T
    rows = (
        (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
    )
    return np.moveaxis(np.array(rows), 2, 0)


def turns(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Angle between the attitudes of each row; precise when tiny."""
    C = np.einsum("nij,nkj->nik", arrays_of_dcm(a), arrays_of_dcm(b))
    sine = np.stack([C[:, 1, 2] - C[:, 2, 1], C[:, 2, 0] - C[:, 0, 2], C[:, 0, 1] - C[:, 1, 0]], 1)
    return np.arctan2(np.linalg.norm(sine, axis=1), np.trace(C, axis1=1, axis2=2) - 1)


def rms(e: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(e).reshape(len(e), -1).sum(axis=1))))


class Errors:
    """Values at the samples between two times. A row holds the outputs of the software at the
    sample before, so its truth is one row higher; every step must be recorded.
    """

    def __init__(self, result: Result, begin: float = 600.0, end: float = 1800.0) -> None:
        t = result.time[:-1]
        self.result, self.rows = result, np.flatnonzero((t >= begin) & (t <= end))

    def reported(self, name: str) -> np.ndarray:
        return self.result[f"relative_filter.{name}"][self.rows + 1]

    def true(self, name: str) -> np.ndarray:
        return self.result[name][self.rows]

    def rho(self) -> np.ndarray:
        true = self.true("servicer.r_SN_N") - self.true("target.r_TN_N")
        return self.reported("r_SN_N") - self.reported("r_TN_N") - true

    def drho(self) -> np.ndarray:
        true = self.true("servicer.v_SN_N") - self.true("target.v_TN_N")
        return self.reported("v_SN_N") - self.reported("v_TN_N") - true

    def target_attitude(self) -> np.ndarray:
        return np.degrees(turns(self.reported("q_TN"), self.true("target.q_TN")))

    def target_rate(self) -> np.ndarray:
        return self.reported("omega_TN_T") - self.true("target.omega_TN_T")

    def own_attitude(self) -> np.ndarray:
        """Arc seconds."""
        return 3600 * np.degrees(turns(self.reported("q_SN"), self.true("servicer.q_SN")))

    def tracking(self) -> np.ndarray:
        return tracking(self.result)[self.rows]


def tracking(result: Result) -> np.ndarray:
    """True position against the reference that truth would give: on the grasp axis, +X of T."""
    range_ref = 4 + 16 * np.exp(-result.time / 120)
    grasp = arrays_of_dcm(result["target.q_TN"])[:, 0, :]
    return result["servicer.r_SN_N"] - result["target.r_TN_N"] - range_ref[:, None] * grasp


def impulse(result: Result) -> float:
    return float(result["propulsion.impulse"][-1].sum())
