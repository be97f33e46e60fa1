# SPDX-License-Identifier: BSD-2-Clause
"""Tables of the servicing mission: events of two runs, velocity increments, parameter sets, aborts.
In one run the flight software uses estimates, in the other the arm captures the target. The events
of the run on truth have no table here, since the table of claims of the mission shows them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from results import Column, cell, of_runs, result_of
from text import table

ESTIMATES = "servicing_mission_navigated --every 10"
RUNS = {"on estimates": ESTIMATES, "by arm": "servicing_mission_by_arm --every 10"}
"""Commands of the runs, by title of the column; with `--every 10`, a result has a row per sample of
the flight software.
"""
ZONE = 12.0
"""Radius of the keep-out zone of the mission [m]."""
LISTED = 6
"""Largest number of phases in the text of ending()."""
PHASES = {
    "100 to 20 m": "closing",
    "fly-around": "fly-around",
    "20 to 3 m": "final",
    "at 3 m": "hold 3",
    "mating": "mating",
}


def event(name: str) -> Column:
    """Return the table column of an event: for each run, the value that the claim about this event
    has in the run. name: name of the claim of the mission, which is also the title of the column.
    """

    def evaluate(result: Any) -> str:
        from ssp.servicing_mission.claims import CLAIMS

        return str(next(c for c in CLAIMS if c.name == name).evaluate(result).value)

    return Column(name, evaluate)


def events() -> str:
    """Return a table of the events with a column per run."""
    from ssp.servicing_mission.claims import CLAIMS

    return of_runs("event", RUNS, [event(c.name) for c in CLAIMS], across=True)


def estimates() -> str:
    """Return as text the rms error of the estimated relative position [mm] in each of PHASES."""
    from ssp.servicing_mission.events import stays
    from ssp.shared.estimates import errors, rows

    result = result_of(ESTIMATES)
    true, _ = rows(result)
    time, error = result.time[true], np.linalg.norm(errors(result)[0].error, axis=1)
    first = {s.phase: s for s in reversed(stays(result))}

    def size(phase: str) -> str:
        begin, end = first[phase].begin, first[phase].end
        squares = error[(time >= begin) & (time < end)] ** 2
        return f"{1e3 * np.sqrt(np.mean(squares)):.0f} mm"

    return ", ".join(f"{size(phase)} ({name})" for name, phase in PHASES.items())


def ending(result: Any) -> str:
    """Return as text the first LISTED phases of a run that are back-off, retreat, safe, aborted or
    stack, each with its reason, start time and range, and then the outcome of the mission.
    """
    from ssp.servicing_mission.events import outcome, stays
    from ssp.shared.relative_motion import range_

    far, found = range_(result), stays(result)
    left = [s for s in found if s.phase in {"back-off", "retreat", "safe", "aborted", "stack"}]
    steps = [f"{s.phase}{f' ({s.reason})' if s.reason else ''} {s.begin:.0f} s, {far[s.row]:.1f} m"
             for s in left[:LISTED]]  # fmt: skip
    return "; ".join([*steps, outcome(result)])


def used(result: Any) -> float:
    """Return the sum of the velocity increments of the whole mission [m/s]."""
    from ssp.servicing_mission.events import increments

    return float(increments(result)[-1])


INCREMENTS = {
    f"{law}{where}": f"{system}{params} --every 10"
    for where, system in (("", "servicing_mission"), (", estimates", "servicing_mission_navigated"))
    for law, params in (("laws of J.7", ""), ("`optimal`", " --params optimal"))
}
SPENDING = ("far", "closing", "fly-around", "final")
"""Phases with a row of their own in the table of velocity increments."""


def spent(phase: str) -> Callable[[Any], float]:
    """Return a function from a result to the velocity increments of a phase [m/s]; phase "": of all
    phases that are not in SPENDING.
    """

    def evaluate(result: Any) -> float:
        from ssp.servicing_mission.events import increments, stays

        used = dict.fromkeys(("", *SPENDING), 0.0)
        so_far, found = increments(result), stays(result)
        ends = [*(s.row for s in found[1:]), -1]
        for stay, end in zip(found, ends, strict=True):
            used[stay.phase if stay.phase in used else ""] += so_far[end] - so_far[stay.row]
        return used[phase]

    return evaluate


def spending() -> str:
    """Return a table of the velocity increments by phase, with a column per run."""
    columns = [Column(name or "others", spent(name), "{:.2f}") for name in (*SPENDING, "")]
    columns.append(Column("all", used, "{:.2f}"))
    return of_runs("phase", INCREMENTS, columns, across=True)


def sets(system: str, names: Sequence[str]) -> Callable[[], str]:
    """Return a function that returns a table with a row per parameter set: how the run ends, its
    least range and its velocity increments.
    """
    runs = {f"`{name}`": f"{system} --params {name} --every 10" for name in names}
    columns = [
        Column("ends", ending),
        Column("least range [m]", "minimum range", "{:.2f}"),
        Column("increments [m/s]", used, "{:.2f}"),
    ]
    return lambda: of_runs("set", runs, columns)


def shown(least: float, inside: float) -> str:
    """Return as text the least range of drifts (motions without thrust) [m], and in parentheses the
    share of the drifts that enter the keep-out zone; without the parentheses if none does. inside:
    this share, 0 to 1.
    """
    return f"{least:.2f} m" + (f" ({100 * inside:.0f} % inside)" if inside else "")


def instants() -> str:
    """Return a table of the least range of drifts, with a row for each of the first five phases
    (far to fly-around). A drift (motion without thrust) begins every 10 s of such a phase of the
    mission on truth and lasts an hour. The columns are: drifts without a burn, and drifts after the
    burn of an abort with the monitor's parameter `abort_relative` = 0, and with 1.
    """
    from ssp.servicing_mission import escapes

    result = result_of("servicing_mission --every 10")
    rho, drho, rate = escapes.hill_states(result)
    axis = escapes.in_hill(result, escapes.grasp_axis(result))
    tau = np.arange(0.0, 3601.0, 10.0)
    lines = []
    for number, name in enumerate(result.mode_names("manager.phase")[:5]):
        rows = np.flatnonzero(result["manager.phase"] == number)[::100]
        least = [
            [
                np.linalg.norm(escapes.drift(e.n, e.r[None], e.v[None], tau), axis=-1).min()
                for e in (
                    escapes.Escape(rho[k], drho[k], np.zeros(3), rate[k]),
                    escapes.escape(result, rho[k], drho[k], rate[k], axis[k]),
                    escapes.escape(result, rho[k], drho[k], rate[k]),
                )
            ]
            for k in rows
        ]
        inside = np.mean(np.array(least) < ZONE, axis=0)
        lines.append([name, *map(shown, np.min(least, axis=0), inside)])
    head = ("phase", "no burn", "`abort_relative` 0", "`abort_relative` 1")
    return f"\n{table(head, lines)}"


def of_arm(expression: str, show: str) -> Any:
    """Return a function without arguments that returns as text the value of an expression in the
    run in which the arm captures the target; show: format of the value.
    """
    return lambda: cell(Column("", expression, show), result_of(RUNS["by arm"]))


TRUTH = ("no_go", "dropout", "bounce", "thruster_stuck", "manoeuvre", "ground_retreat", "limited")
REENACTED = (
    *("dart", "dart_blind", "elsa_d", "elsa_d_blind", "adras_j", "adras_j_blind"),
    *("orbital_express", "orbital_express_again", "orbital_express_blind"),
)
ARM = (
    *("no_go", "thruster_stuck", "manoeuvre", "ground_retreat", "momentum", "dropout", "bounce"),
    "limited",
)
VALUES = {
    "mission_sets": sets("servicing_mission", TRUTH),
    "mission_reenacted": sets("servicing_mission_navigated", REENACTED),
    "mission_arm_sets": sets("servicing_mission_by_arm", ARM),
    "mission_events": events,
    "mission_increments": spending,
    "abort_instants": instants,
    "mission_estimates": estimates,
    "mission_tip": of_arm("tip error, aligning and closing", "{:.3f} mm"),
}
