# SPDX-License-Identifier: BSD-2-Clause
"""Tables of tracking with prescribed performance: the three controllers of the paper, final bounds
of the range error, and four controllers in two missions.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from results import Column, of_runs, result_of, value
from text import table

LAWS = {"ppc": "", "theta-D": " --swap controller=theta_d_controller",
        "PID": " --swap controller=pid_controller"}  # fmt: skip
FAST = " --step 0.01 --set guidance.sample_period=0.01 --set controller.sample_period=0.01"
BOUNDS = ("2", "0.5", "0.1", "0.05")
FOUR = ("adaptive", "ppc", "pid", "theta_d")
TASKS = {
    "sync": "sync_approach --params default",
    "sync, manoeuvre": "sync_approach --params manoeuvre",
    "LOS": "ppc_tracking --params nominal",
    "LOS, manoeuvre": "ppc_tracking --params manoeuvre",
}


def converged(result: Any) -> float:
    """Return the time from which the range error stays within 2 % of its first value [s]."""
    from ssp.ppc_tracking.evaluations import convergence

    return convergence(result)[0]


def after_a_minute(error: str) -> Any:
    """Return a function that takes a result and returns its largest absolute error after 60 s;
    error: `range` [m] or `attitude` [deg].
    """
    from ssp.ppc_tracking import evaluations
    from ssp.shared.relative_motion import attitude_error

    def evaluate(result: Any) -> float:
        late = result.time >= evaluations.SETTLED
        if error == "range":
            return float(np.abs(evaluations.range_error(result)[late]).max())
        return float(np.degrees(attitude_error(result)[late]).max())

    return evaluate


def effort(result: Any) -> float:
    """Return the integral of the absolute commanded acceleration, summed over its axes [m/s]."""
    command = np.abs(result["controller.a_cmd_L"]).sum(axis=1)
    return float(np.sum(command[1:] * np.diff(result.time)))


def by_law() -> str:
    """Return a table of the controllers of the paper in the sets `nominal` and `manoeuvre`."""
    runs = {f"{law}, {params}": f"ppc_tracking --params {params}{swap}"
            for params in ("nominal", "manoeuvre") for law, swap in LAWS.items()}  # fmt: skip
    return of_runs("controller, set", runs, [
        Column("converged [s]", converged, "{:.1f}"),
        Column("range error [m]", after_a_minute("range"), "{:.3g}"),
        Column("attitude error [deg]", after_a_minute("attitude"), "{:.2g}"),
        Column("minimum range [m]", "minimum range", "{:.2f}"),
        Column("control effort [m/s]", effort, "{:.0f}"),
    ])  # fmt: skip


def by_bound() -> str:
    """Return a table of the largest range error for several values of `alpha_inf`, the final bound
    of this error, at 100 Hz and at 20 Hz.
    """
    error = after_a_minute("range")

    def line(title: str, rate: str) -> list[str]:
        system = f"ppc_tracking --params manoeuvre{rate} --set controller.range.alpha_inf="
        return [title, *(f"{value(error, result_of(system + bound)):.3f}" for bound in BOUNDS)]

    rows = [
        line("largest range error after 60 s at 100 Hz [m]", FAST),
        line(
            "at 20 Hz [m]; with the last two bounds the error leaves the funnel, "
            "which the controller flags",
            "",
        ),
    ]
    return f"\n{table(('set `manoeuvre`, `alpha_inf` of the range [m]', *BOUNDS), rows)}"


def settles(error: str) -> Any:
    """Return a function that takes a result and returns how long an error takes to stay within 2 %
    of its largest value [s]; error: `position`, from t = 0 on, or `attitude`, from the time on at
    which torques begin to turn the servicer.
    """
    from harness.results.expressions import settling_time
    from ssp.shared import relative_motion as motion

    def evaluate(result: Any) -> float:
        found = motion.position_error if error == "position" else motion.attitude_error
        begun = result.time >= (0.0 if error == "position" else motion.release_time(result))
        size = found(result)[begun]
        return settling_time(result.time[begun], size, 0.02 * size.max())

    return evaluate


def by_task() -> str:
    """Return a table of four controllers in sync_approach and ppc_tracking, each without and with a
    manoeuvre of the target.
    """
    runs = {f"{task}: {law.replace('pid', 'PID').replace('theta_d', 'theta-D')}":
            f"{command} --swap controller={law}_controller"
            for task, command in TASKS.items() for law in FOUR}  # fmt: skip
    return of_runs("task, controller", runs, [
        Column("t pos", settles("position"), "{:.1f}"),
        Column("t att", settles("attitude"), "{:.1f}"),
        Column("e pos", "position error", "{:.2g}"),
        Column("e att", "attitude error", "{:.2g}"),
        Column("range", "minimum range", "{:.3f}"),
        Column("delta-v", "delta-v", "{:.3g}"),
        Column("impulse", "torque impulse", "{:.0f}"),
    ])  # fmt: skip


VALUES = {"ppc_laws": by_law, "ppc_bounds": by_bound, "ppc_tasks": by_task}
