# SPDX-License-Identifier: BSD-2-Clause
"""Sensors and navigation: parameter sets of the synchronised approach on estimates."""

from __future__ import annotations

from typing import Any

from results import Column, of_runs, of_the_tests

# parameter sets of sync_approach_navigated, each with the text that follows its name in the table
SETS = {
    "nominal": "", "dropout": ", 60 s without pose", "sun_blinding": ", 84 s without pose",
    "gyro_bias": ", 100 deg/h", "wrong_inertia": "",
    "compensated": ", 0.5 s late, stamps used", "uncompensated": ", stamps ignored",
    "outliers": ", drop-outs, flips", "estimate": " of p_GT_T and inertia",
}  # fmt: skip
PARTS = ("rho", "drho", "target_attitude", "target_rate", "own_attitude")
SCALES = (1e3, 1e3, 1.0, 1.0, 1.0)


def errors(result: Any) -> tuple[float, ...]:
    """Return the rms errors of the estimates from 600 s on: relative position rho [mm], its rate
    [mm/s], attitude of the target [deg], its rate [rad/s], attitude of the servicer [arcsec]; for a
    run on truth return a single NaN, because it has no estimates.
    """
    case = of_the_tests("navigated_case")
    if "relative_filter.q_TN" not in result:
        return (float("nan"),)
    found = case.Errors(result)
    return tuple(
        scale * case.rms(getattr(found, part)()) for part, scale in zip(PARTS, SCALES, strict=True)
    )


def tracking(result: Any) -> float:
    """Return the rms distance of the true position from the reference position that the guidance
    would compute from the true states, from 600 to 1800 s [mm].
    """
    case = of_the_tests("navigated_case")
    late = (result.time >= 600.0) & (result.time <= 1800.0)
    return float(1e3 * case.rms(case.tracking(result)[late]))


def sets() -> str:
    """Return a table with a row for a run on truth, then one per parameter set in SETS."""
    given = " ".join(f"--set {value}" for value in of_the_tests("navigated_case").TRUTH_FED)
    runs = {"on truth": f"sync_approach --params robust {given}"}
    runs |= {f"`{s}`{what}": f"sync_approach_navigated --params {s}" for s, what in SETS.items()}
    head = "rho [mm], v [mm/s], target attitude [deg], its rate [rad/s], S attitude [arcsec]"
    return of_runs("set", runs, [
        Column(head, errors, "{:.1f}, {:.2f}, {:.2f}, {:.1e}, {:.0f}"),
        Column("tracking [mm]", tracking, "{:.1f}"),
        Column("impulse [N s]", "total(last(propulsion.impulse))", "{:.1f}"),
    ])  # fmt: skip


VALUES = {"navigation_sets": sets}
