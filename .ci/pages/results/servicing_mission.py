# SPDX-License-Identifier: BSD-2-Clause
"""Servicing mission: its events on estimates and by the arm; those on truth are in its claims."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from results import Column, cell, flown, of_runs

ESTIMATES = "servicing_mission_navigated --every 10"
RUNS = {"on estimates": ESTIMATES, "by arm": "servicing_mission_by_arm --every 10"}
"""A row per sample of the software."""
LISTED = 6
"""Phases of an ending that are shown."""
PHASES = {
    "100 to 20 m": "CLOSING",
    "fly-around": "FLYAROUND",
    "20 to 3 m": "FINAL",
    "at 3 m": "HOLD_3",
    "mating": "MATING",
}


def event(name: str) -> Column:
    """What the table of events has of an event, in this run."""

    def measure(result: Any) -> str:
        from ssp.servicing_mission.claims import CLAIMS

        return str(next(c for c in CLAIMS if c.name == name).evaluate(result).figure)

    return Column(name, measure)


def events() -> str:
    """The events of the two runs side by side."""
    from ssp.servicing_mission.claims import CLAIMS

    return of_runs("event", RUNS, [event(c.name) for c in CLAIMS], across=True)


def estimates() -> str:
    """Error of the relative position by phase, rms."""
    from ssp.servicing_mission.flight import stays
    from ssp.shared.estimates import errors, rows

    result = flown(ESTIMATES)
    true, _ = rows(result)
    time, error = result.time[true], np.linalg.norm(errors(result)[0].error, axis=1)
    first = {s.phase: s for s in reversed(stays(result))}

    def size(phase: str) -> str:
        begin, end = first[phase].begin, first[phase].end
        squares = error[(time >= begin) & (time < end)] ** 2
        return f"{1e3 * np.sqrt(np.mean(squares)):.0f} mm"

    return ", ".join(f"{size(phase)} ({name})" for name, phase in PHASES.items())


def ending(result: Any) -> str:
    """What follows the last approach: phases with time, reason and range."""
    from ssp.servicing_mission.flight import outcome, stays
    from ssp.shared.relative_motion import range_

    far, found = range_(result), stays(result)
    left = [s for s in found if s.phase in {"BACKOFF", "RETREAT", "SAFE", "ABORTED", "STACK"}]
    steps = [f"{s.phase}{f' ({s.reason})' if s.reason else ''} {s.begin:.0f} s, {far[s.row]:.1f} m"
             for s in left[:LISTED]]  # fmt: skip
    return "; ".join([*steps, outcome(result)])


def used(result: Any) -> float:
    """Velocity increments of the whole mission [m/s]."""
    from ssp.servicing_mission.flight import increments

    return float(increments(result)[-1])


def sets(system: str, names: Sequence[str]) -> Callable[[], str]:
    """How the sets of a system end."""
    runs = {f"`{name}`": f"{system} --params {name} --every 10" for name in names}
    columns = [
        Column("ends", ending),
        Column("least range [m]", "minimum range", "{:.2f}"),
        Column("increments [m/s]", used, "{:.2f}"),
    ]
    return lambda: of_runs("set", runs, columns)


def of_arm(expression: str, show: str) -> Any:
    """A figure of the run by the arm."""
    return lambda: cell(Column("", expression, show), flown(RUNS["by arm"]))


TRUTH = ("no_go", "dropout", "bounce", "thruster_stuck", "manoeuvre", "ground_retreat", "limited")
STORIES = (
    *("dart", "dart_blind", "elsa_d", "elsa_d_blind", "adras_j", "adras_j_blind"),
    *("orbital_express", "orbital_express_unloaded", "orbital_express_blind"),
)
ARM = (
    *("no_go", "thruster_stuck", "manoeuvre", "ground_retreat", "momentum", "dropout", "bounce"),
    "limited",
)
FIGURES = {
    "mission_sets": sets("servicing_mission", TRUTH),
    "mission_stories": sets("servicing_mission_navigated", STORIES),
    "mission_arm_sets": sets("servicing_mission_by_arm", ARM),
    "mission_events": events,
    "mission_estimates": estimates,
    "mission_tip": of_arm("tip error, aligning and closing", "{:.3f} mm"),
}
