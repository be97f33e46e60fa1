# SPDX-License-Identifier: BSD-2-Clause
"""Synchronised approach: attitude error with and without adaptation, changes of the estimated
inertias and mass.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from results import Column, of_runs, value_of

ETA = "controller.eta_hat_0=[200,0,0,250,0,150,12,0,0,15,0,10]"
ADAPTATION = {
    "no option: gains as printed": "sync_approach",
    "`--set controller.Gamma_scale=0.1`": "sync_approach --set controller.Gamma_scale=0.1",
    "`--set controller.Gamma_scale=0`": "sync_approach --set controller.Gamma_scale=0",
    "`--set controller.Gamma_scale=0 --set 'controller.eta_hat_0=ETA'`: true inertias":
        f"sync_approach --set controller.Gamma_scale=0 --set {ETA}",
    "`--params informed`: in addition the true mass, and `M_dist` known to the guidance":
        "sync_approach --params informed",
}  # fmt: skip
POINTING = "degrees(last(angle(guidance.q_DN, servicer.q_SN)))"
LONG = "sync_approach --stop 14400 --every 10"


def adaptation() -> str:
    """Return a table of the attitude error with the printed adaptation gains, with a tenth of these
    gains, without adaptation, and without adaptation but with true inertias, or with true inertias
    and mass and a known disturbance torque on the target.
    """
    return of_runs("`harness run sync_approach` with", ADAPTATION,
                   [Column("attitude error at 1800 s", POINTING, "{:.2g} deg")])  # fmt: skip


def span(begin: float) -> Any:
    """Return a function that computes from a result how far the estimated inertias move: the
    largest difference [kg m2] between two values of one element from the time `begin` [s] on.
    """

    def evaluate(result: Any) -> float:
        late = result.time >= begin
        return float(np.ptp(result["controller.eta_hat"][late], axis=0).max())

    return evaluate


def mass_moves(result: Any) -> float:
    """Return the largest distance of the estimated mass from its start value [g]."""
    mass = result["controller.m_hat"]
    return float(1e3 * np.abs(mass - mass[0]).max())


VALUES = {
    "sync_adaptation": adaptation,
    "sync_mass": value_of("sync_approach", mass_moves, "{:.0f} g"),
    "sync_inertia": value_of("sync_approach", span(1500.0), "{:.1f} kg m2"),
    "sync_inertia_hour": value_of(LONG, span(3600.0), "{:.1f} kg m2"),
    "sync_inertia_late": value_of(LONG, span(5400.0), "{:.1f} kg m2"),
}
