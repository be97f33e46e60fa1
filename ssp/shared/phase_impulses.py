# SPDX-License-Identifier: BSD-2-Clause
"""Least impulses of the phases of a run, the answer to `harness bound`: class in which a mission
defines a convex problem per phase, the optima of these problems, and simulations with the optimal
forces.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.master.changes import apply
from harness.master.simulation import Simulation
from harness.results.histories import turned
from harness.results.result import Array, Result
from harness.system.model import System

from . import optima
from .convex import Optimum, Problem, check, reduced, solve
from .least_impulse import pushes, simulated


class Phase(NamedTuple):
    """Phase of a run. problem: its convex problem; spent: impulse of the run in the phase [N s];
    start: parameters with which a simulation of both bodies begins where the phase begins, with a
    servicer that does not rotate; along: function that returns the problem with convex constraints
    along a given path (n + 1, 3) in place of constraints that are not convex (None: all constraints
    are convex).
    """

    problem: Problem
    spent: float
    start: Mapping[str, Any]
    along: Callable[[Problem, Array], Problem] | None = None


@dataclass(frozen=True)
class PhaseBounds:
    """Definition by a mission of the least possible impulses of the phases of a run, for systems
    that have the variables `needs` and the parameters `parameters`.

    phases: function of a result and the step of the grids [s] (None: the step of the mission) that
    returns the phases by name; positions, velocities: variables of both bodies; attitude: variable
    with the attitude of the body with thrusters; force: output of its actuator, in its axes; every:
    macro steps per row.
    """

    needs: tuple[str, ...]
    parameters: tuple[str, ...]
    phases: Callable[[Result, float | None], Mapping[str, Phase]]
    positions: tuple[str, str]
    velocities: tuple[str, str]
    attitude: str
    force: str
    every: int = 1

    def __call__(
        self, system: System, cost: str, grid: float | None, without: Collection[str]
    ) -> PhaseAnswer | None:
        """Simulate the system and return the least impulses of the phases of this run, None if the
        system lacks a variable or a parameter.

        cost: `sum` of the magnitudes of the force along the axes, or `norm` of the force; grid:
        step of the convex problems [s] (None: the steps of the mission); without: names of
        constraints to leave out. Raises UsageError, RunError, and HarnessError if there is no
        optimum.
        """
        run = simulated(system, self.needs, self.parameters, self.every)
        if run is None:
            return None
        phases = self.phases(run, grid)
        check(without, [phase.problem for phase in phases.values()])
        found = {}
        for name, phase in phases.items():
            best = phase_optimum(phase, cost, without)
            miss = phase_verified(system, self, phase, best)
            found[name] = PhaseOptimum(phase.spent, best, phase.problem.mass, miss)
        return PhaseAnswer(self, run, found)


class PhaseOptimum(NamedTuple):
    """Least impulse of a phase.

    spent: impulse of the phase in the run [N s]; optimum: solution of its convex problem; mass:
    mass of the servicer at the beginning of the phase [kg]; miss: distances of position [m] and
    velocity [m/s] between a simulation of the optimal force and the optimal path at the end of the
    phase.
    """

    spent: float
    optimum: Optimum
    mass: float
    miss: tuple[float, float]


NOTHING = 1e-6
"""Velocity increment below which an optimum counts as 0 [m/s]."""


@dataclass(frozen=True)
class PhaseAnswer:
    """Run and the least impulses of its phases, by name of the phase."""

    offered: PhaseBounds
    run: Result
    phases: Mapping[str, PhaseOptimum]

    @property
    def verified(self) -> None:
        """Return None, because each phase is simulated alone, and there is no run of all phases."""

    def store(self) -> Path:
        """Store the optima for later reports and comparisons, and return the path of the file;
        raise ResultsError if the file is damaged or cannot be written.
        """
        return optima.store(self.run, [phase.optimum for phase in self.phases.values()])

    def lines(self) -> Iterator[str]:
        """Yield a line per phase, and one for their sum: velocity increment in the run [m/s] and
        its ratio to the least one. The line of a phase also states `miss`, the distances [mm, mm/s]
        between a simulation of the optimal force and the optimal path at the end of the phase.
        """
        found = [
            (name, p.spent / p.mass, p.optimum.impulse / p.mass) for name, p in self.phases.items()
        ]
        ends = [f"; open loop ends {1e3 * r:.2g} mm, {1e3 * v:.1g} mm/s off the optimal path"
                for r, v in (p.miss for p in self.phases.values())]  # fmt: skip
        total = ("sum", sum(f[1] for f in found), sum(f[2] for f in found))
        for (name, spent, best), end in zip((*found, total), (*ends, ""), strict=True):
            ratio = f"{spent / best:.3g} times the optimum of {best:.3g} m/s"
            ratio = ratio if best > NOTHING else "the optimum is 0"
            yield f"{self.run.system}, {name}: {spent:.3g} m/s, {ratio}{end}"


PASSES = 3
"""Number of times that the problem of a phase is solved. From the second time on, constraints that
are not convex are replaced by convex ones along the best path so far.
"""


def phase_optimum(phase: Phase, cost: str = "sum", without: Collection[str] = ()) -> Optimum:
    """Return the best of PASSES solutions of a phase, or the only one if all its constraints are
    convex; raise HarnessError if it has none.

    cost: `sum` of the magnitudes of the force along the axes, or `norm` of the force; without:
    names of constraints that are left out.
    """
    best = solve(reduced(phase.problem, without), cost)
    for _ in range(PASSES - 1):
        if phase.along is None:
            break
        again = solve(reduced(phase.along(phase.problem, best.position), without), cost)
        if again.impulse < best.impulse:
            best = again
    return best


def phase_verified(
    system: System, offered: PhaseBounds, phase: Phase, optimum: Optimum
) -> tuple[float, float]:
    """Return the distances of position [m] and velocity [m/s] between a simulation of the optimal
    force and the optimal path at the end of a phase. The simulation contains only the plants of
    both bodies. The force is constant in frame N during each step of the grid.
    """
    begin, end = (float(phase.problem.time[k]) for k in (0, -1))
    bodies = {name.partition(".")[0] for name in offered.positions}
    opened = [c.name for c in system.components if c.name not in bodies]
    span = replace(system.experiment, start=begin, stop=end)
    changed = apply(replace(system, experiment=span), set=phase.start, open=opened)
    with Simulation(changed, every=offered.every) as simulation:
        q, force = simulation.port(offered.attitude), simulation.port(offered.force)
        h, into = simulation.clock.step, q * np.array([1, -1, -1, -1])
        ends = np.rint((optimum.time - begin) / h).astype(int)
        impulses = pushes(phase.problem, optimum) * np.diff(optimum.time)[:, None]
        for impulse, first, last in zip(impulses, ends[:-1], ends[1:], strict=True):
            force[:] = turned(into, impulse / (h * (last - first)))
            simulation.forward(int(last))
        pairs = (offered.positions, offered.velocities)
        own, other = (np.array([simulation.port(pair[k]) for pair in pairs]) for k in (0, 1))
    plan = np.array([optimum.position[-1], optimum.velocity[-1]])
    position, velocity = np.linalg.norm(own - other - plan, axis=1).tolist()
    return position, velocity
