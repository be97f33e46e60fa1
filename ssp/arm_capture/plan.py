# SPDX-License-Identifier: BSD-2-Clause
"""Plan of a capture by arm without a run of the system: whether the arm reaches the fixture from
the position at which the guidance holds the base, how far its poses are from singular ones, and
whether the stowed arm touches itself.

Only guidance and target are run. The position of the fixture relative to a base at its reference
position is

    r_QS = C_DN (C_TN^T p_QT_T - rho_ref_N),   X_E = -X_Q

in axes of the reference attitude D of the base. p_QT_T: position of the fixture Q from the centre
of the target T, target axes; rho_ref_N: reference position of the base from T, N axes; X_E: X axis
of the end effector, which must be opposite to the X axis X_Q of the fixture.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Unpack

import numpy as np

from harness.errors import UsageError
from harness.master.changes import Changes, apply
from harness.master.isolated import simulate
from harness.master.simulation import Simulation
from harness.results.histories import turned
from harness.results.result import Array, Result
from harness.ssp.library import load
from harness.system.model import System

from ..shared.docking_scene import DOCKING, outward
from .kinematics import ARM, arm_of
from .reach import Limits, Reach, clearance, reach

ALONE = ("guidance", "target")
POSES = tuple(f"arm_guidance.joint_angle_{name}" for name in ("min", "max", "ready", "stowed"))
GOALS = tuple(
    f"arm_guidance.{name}"
    for name in ("standoff", "seat_depth", "track_from", "manipulability_min")
)
KNOWN = (*ARM, *DOCKING, *POSES, *GOALS)
POINTS = {"stand": "the point at arm_guidance.standoff", "seat": "the seat in the fixture"}
"""Goals of the grapple in texts, by the names of Plan.histories."""
INSTANTS = 60
"""Largest number of instants at which the plan evaluates the position of the fixture."""
LINE = np.arange(-1.2, 1.2001, 0.05)
"""Positions along the axis of the fixture at which the plan computes whether the arm reaches them:
0 at the seat, positive into the target [m].
"""


@dataclass(frozen=True)
class Plan:
    """Plan of a capture by arm.

    stand, seat: results whose variables `plan.*` are time series of the reach of the arm, for the
    standoff position before the fixture and for the seat in the fixture; line: mask of the
    positions LINE that the arm reaches at the first instant; touches: least distance between two
    links of the stowed arm [m], negative if they overlap, and the numbers of these links.
    """

    stand: Result
    seat: Result
    line: Array
    touches: tuple[float, tuple[int, int]]

    @property
    def histories(self) -> Mapping[str, Result]:
        """Return the results for the standoff position and for the seat, by name."""
        return {"stand": self.stand, "seat": self.seat}

    @property
    def good(self) -> bool:
        """Return whether the arm reaches standoff position and seat at every instant, with enough
        manipulability, and does not touch itself when stowed.
        """
        return not any(self._reasons())

    def text(self) -> str:
        """Return a table of the reach, the permitted offset of the base, the clearance of the
        stowed arm, and the verdict.
        """
        return "\n".join(self._lines())

    def _lines(self) -> Iterator[str]:
        yield (
            "place      from S, base axes [m]   reached   "
            "least singular value, slowest direction of E"
        )
        for name, r in self.histories.items():
            row = int(np.argmin(r["plan.singular"]))
            place = " ".join(f"{round(x, 3) + 0.0:7.3f}" for x in r["plan.place"][row])
            worst = " ".join(f"{x:5.2f}" for x in r["plan.worst"][row])
            held = r["plan.reached"]
            pose = f"{r['plan.singular'][row]:20.3f}   {worst}" if held.all() else f"{'-':>20}"
            yield f"{name:5}   {place}   {np.mean(held):8.0%}   {pose}"
        yield self._clearance()
        distance, (i, j) = self.touches
        yield f"stowed: links {i} and {j} are nearest, {1e3 * distance:.0f} mm between them"
        yield (
            "; ".join(self._reasons()) or "planned: the arm always reaches standoff point and seat"
        )

    def _clearance(self) -> str:
        """Return a text that states how far the base may be offset along the axis of the fixture so
        that the arm still reaches the seat.
        """
        held, seat = self.line, int(np.argmin(np.abs(LINE)))
        if not held.any():
            return (
                f"the arm reaches no point of the fixture's axis within {LINE[-1]:g} m of the seat"
            )
        if not held[seat]:
            off = LINE[held][np.argmin(np.abs(LINE[held]))]
            return (
                f"the arm would reach the seat from a base {abs(off):.2f} m {_way(off)} "
                "than planned"
            )
        gaps = np.flatnonzero(np.logical_not(held))
        low, high = gaps[gaps < seat], gaps[gaps > seat]
        near = LINE[low[-1] + 1] if len(low) else LINE[0]
        far = LINE[high[0] - 1] if len(high) else LINE[-1]
        return (f"the arm reaches the seat from a base between {abs(near):.2f} m {_way(near)} and "
                f"{abs(far):.2f} m {_way(far)} than planned")  # fmt: skip

    def _reasons(self) -> Iterator[str]:
        for name, r in self.histories.items():
            least = float(r.parameter(GOALS[3]))
            if not r["plan.reached"].all():
                yield f"not planned: the arm does not reach {POINTS[name]} at every instant"
            elif r["plan.manipulability"].min() < least:
                yield (
                    f"not planned: at {POINTS[name]} manipulability is below "
                    f"arm_guidance.manipulability_min = {least:g}"
                )
        if self.touches[0] < 0:
            yield "not planned: the stowed arm touches itself"


def _way(off: float) -> str:
    return "farther from the target" if off > 0 else "nearer to the target"


def plan(system: str | Path | System, **changes: Unpack[Changes]) -> Plan:
    """Return the plan of a capture by arm; changes: as for run().

    Raises UsageError if the system has no arm with its guidance, or the errors of run().
    """
    with load(system) as found:
        whole = apply(found, **changes)
        known = _parameters(whole)
        run = simulate(_alone(whole), every=1)
    arm, limits, stowed = arm_of(known), limits_of(known), known.parameter(POSES[3])
    time, fixture, out = _fixture(run, known)
    standoff, depth = (float(known.parameter(name)) for name in GOALS[:2])
    places = [fixture - standoff * out, fixture + depth * out]
    stand, seat = (
        _result(run, known, time, place, reach(arm, limits, place, out)) for place in places
    )
    line = reach(
        arm, limits, places[1][0] + LINE[:, None] * out[0], np.tile(out[0], (len(LINE), 1))
    )
    return Plan(stand, seat, line.reached, clearance(arm, stowed[: len(arm.axis)]))


def limits_of(known: Result) -> Limits:
    """Return the joint limits and the preferred posture in the parameters of arm_guidance."""
    n = int(known.parameter(ARM[0]))
    low, high, ready = (known.parameter(name)[:n] for name in POSES[:3])
    return Limits(low, high, ready)


def _parameters(system: System) -> Result:
    """Return a result without rows that has the parameters of a system."""
    known = Simulation(system).parameters()
    names = {component.name for component in system.components}
    table = replace(
        known, time=np.zeros(0), values=np.zeros((0, len(known.columns))), parameters=known
    )
    if not (names.issuperset(ALONE) and table.holds(parameters=KNOWN)):
        raise UsageError(
            f"{system.name}: lacks guidance, target or an arm with arm_guidance; try arm_capture"
        )
    if table.parameter(ARM[0]) < 1:
        raise UsageError(f"{system.name}: servicer.joints is 0: there is no arm to plan for")
    return table


def _alone(system: System) -> System:
    """Return the system of guidance and target with the connections between them."""
    chosen = tuple(c for c in system.components if c.name in ALONE)
    wires = tuple(
        wire
        for wire in system.connections
        if {wire.source.component, wire.target.component} <= set(ALONE)
    )
    return replace(
        system,
        components=chosen,
        connections=wires,
        sets=(),
        alternatives=(),
        strict=False,
        requirements={},
        declared={},
    )


def _fixture(run: Result, known: Result) -> tuple[Array, Array, Array]:
    """Return times (rows,) [s], positions of the fixture from S (rows, 3) [m] and required
    directions of the X axis of the end effector (rows, 3), both in base axes.

    run: result of guidance and target; known: parameters of the system. The times begin when the
    arm starts to track the fixture. The guidance computes a reference from the target in one row
    and publishes this reference in the next row, so each target is combined with the reference of
    the next row.
    """
    rho, late = run["guidance.rho_ref_N"], float(known.parameter(GOALS[2]))
    new = np.array([0, *np.flatnonzero(np.diff(rho, axis=0).any(axis=1))])
    new = new[run.time[new] >= late] if (run.time[new] >= late).any() else new
    row = new[np.unique(np.linspace(0, len(new) - 1, INSTANTS).round().astype(int))]
    q_T, q_D = run["target.q_TN"][row], run["guidance.q_DN"][row + 1]
    place, X = known.parameter(DOCKING[2]), outward(known.parameter(DOCKING[3]))
    to_D = q_D * (1, -1, -1, -1)
    seen = turned(q_T, np.tile(place, (len(row), 1))) - rho[row + 1]
    return (
        run.time[row],
        turned(to_D, seen),
        -turned(to_D, turned(q_T, np.tile(X, (len(row), 1)))),
    )


def _result(run: Result, known: Result, time: Array, place: Array, found: Reach) -> Result:
    """Return a result whose variables `plan.*` are the reach for positions `place` (rows, 3) over
    time.
    """
    tables = {
        "place": (place, "m"),
        "error": (found.error, "m"),
        "reached": (found.reached.astype(float), "1"),
        "singular": (found.singular[:, -1], "1"),
        "manipulability": (found.manipulability, "1"),
        "worst": (found.worst, "1"),
        "joint_angle": (found.angle, "rad"),
    }
    columns, units, values = [], [], []
    for name, (history, unit) in tables.items():
        one = history.ndim == 1
        for k, column in enumerate(np.atleast_2d(history.T)):
            columns.append(f"plan.{name}" if one else f"plan.{name}[{k + 1}]")
            units.append(unit)
            values.append(column)
    return replace(
        run,
        time=time,
        columns=tuple(columns),
        units=tuple(units),
        values=np.stack(values, axis=1),
        descriptions=(),
        parameters=known.parameters,
    )
