# SPDX-License-Identifier: BSD-2-Clause
"""Safety monitor: its findings in the approach systems, and what it prevents if it may abort."""

from __future__ import annotations

from typing import Any

import numpy as np
from results import Column, of_runs

WATCHED = {
    "`sync_approach`": "sync_approach",
    "`sync_approach`, set `manoeuvre`": "sync_approach --params manoeuvre",
    "`sync_approach_thrusters`, set `pulsed`": "sync_approach_thrusters --params pulsed",
    "`sync_approach_navigated`": "sync_approach_navigated",
    "the same, `dropout`": "sync_approach_navigated --params dropout",
    "`ppc_tracking`, ppc": "ppc_tracking",
    "`ppc_tracking`, theta-D": "ppc_tracking --swap controller=theta_d_controller",
    "`ppc_tracking`, PID": "ppc_tracking --swap controller=pid_controller",
    "`relay_approach`": "relay_approach --every 10",
    "the same, `geo`": "relay_approach --params geo --every 10",
}
PID = "--swap controller=pid_controller"
GUARDED = {
    "`ppc_tracking`, PID": f"ppc_tracking {PID}",
    "`ppc_tracking_guarded`, PID": f"ppc_tracking_guarded {PID}",
    "`ppc_tracking`, PID, `manoeuvre`": f"ppc_tracking {PID} --params manoeuvre",
    "`ppc_tracking_guarded`, PID, `manoeuvre`": f"ppc_tracking_guarded {PID} --params manoeuvre",
    "`sync_approach_thrusters`, `guidance.rho_M=2`":
        "sync_approach_thrusters --set guidance.rho_M=2",
    "`sync_approach_thrusters_guarded`, the same":
        "sync_approach_thrusters_guarded --set guidance.rho_M=2",
}  # fmt: skip


def finding(rule: str) -> Any:
    """Return a function of a result that returns `MARGIN UNIT from TIME s`: the least margin of the
    rule and, only if the rule is violated, the time of the first violation; "-" if the monitor has
    not evaluated the rule.
    """

    def evaluate(result: Any) -> str:
        from ssp.shared.safety import findings

        found = next((f for f in findings(result) if f.name == rule), None)
        if found is None:
            return "-"
        late = f" from {found.violated:.4g} s" if np.isfinite(found.violated) else ""
        return f"{found.margin:.2g} {found.unit}{late}"

    return evaluate


def watched() -> str:
    """Return a table of the least margins by system and rule."""
    from ssp.shared.safety import RULES

    columns = [Column(r.name, finding(r.name)) for r in RULES if r.name != "escape"]
    return of_runs("run", WATCHED, columns)


def aborted(result: Any) -> str:
    """Return the time when the monitor aborts, as text."""
    rows = np.flatnonzero(result["monitor.abort"])
    return f"{result.time[rows[0]]:.4g} s" if len(rows) else "never"


def guarded() -> str:
    """Return a table of the time of the abort and the minimum range, for runs without and with the
    monitor between controller and actuators.
    """
    return of_runs("run", GUARDED, [
        Column("abort", aborted),
        Column("minimum range [m]", "minimum range", "{:.3g}"),
    ])  # fmt: skip


VALUES = {"safety_watched": watched, "safety_guarded": guarded}
