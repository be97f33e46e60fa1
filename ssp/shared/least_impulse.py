# SPDX-License-Identifier: BSD-2-Clause
"""Least impulse of a run, the answer to `harness bound`: class in which a mission defines its
convex problem, optimum of this problem, and simulation with the optimal force.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.master.simulation import Simulation
from harness.results.histories import turned
from harness.results.requirements import findings
from harness.results.result import Array, Result
from harness.system.model import System

from . import optima
from .convex import Optimum, Problem, check, reduced, solve

LATE = 2 / 3
"""Share of the time span after which the impulses are also reported separately."""


@dataclass(frozen=True)
class Bound:
    """Definition by a mission of the least possible impulse of a run, for systems that have the
    variables `needs` and the parameters `parameters`.

    problem: function of a result and the step of the grid [s] that returns the convex problem;
    positions: variables with the positions of both bodies; attitude: variable with the attitude of
    the body with thrusters; force, impulse ("": none): outputs of the actuator of this body, in its
    axes; follows: pairs of a further output of the actuator and the command to which this output is
    equal; grid: default step of the grid [s]; every: macro steps per row; spent: function that
    returns the impulse of a run [N s] (None: the integral of `force` is the impulse).
    """

    needs: tuple[str, ...]
    parameters: tuple[str, ...]
    problem: Callable[[Result, float], Problem]
    positions: tuple[str, str]
    attitude: str
    force: str
    impulse: str = ""
    follows: tuple[tuple[str, str], ...] = ()
    grid: float = 2.0
    every: int = 1
    spent: Callable[[Result], float] | None = None

    def __call__(
        self, system: System, cost: str, grid: float | None, without: Collection[str]
    ) -> Answer | None:
        """Run the system and return its least impulse, None if the system lacks a variable or a
        parameter.

        cost: `sum` or `norm`; grid: step of the convex problem [s] (None: `grid` of this object);
        without: names of constraints to leave out. Raises UsageError, RunError, and HarnessError if
        there is no optimum.
        """
        run = simulated(system, self.needs, self.parameters, self.every)
        if run is None:
            return None
        whole = self.problem(run, grid or self.grid)
        check(without, [whole])
        problem = reduced(whole, without)
        best = solve(problem, cost)
        spent = self.spent(run) if self.spent else _spent(run, self.force, cost)
        return Answer(self, run, best, verified(system, self, problem, best), cost, spent)


def simulated(
    system: System, needs: tuple[str, ...], parameters: tuple[str, ...], every: int
) -> Result | None:
    """Simulate a system and return its result; None if the system lacks one of the variables
    `needs` or of the `parameters`; every: macro steps per row. Raises UsageError and RunError.
    """
    with Simulation(system, every=every) as simulation:
        simulation.advance(0)
        if not simulation.result().holds(*needs, parameters=parameters):
            return None
        simulation.advance()
        return simulation.result()


@dataclass(frozen=True)
class Answer:
    """Least impulse of a run.

    offered: definition of the bound by the mission; run: result of the system; optimum: solution of
    the convex problem; verified: result of a second simulation, in which the actuator gives the
    optimal force; cost: `sum` or `norm`.
    """

    offered: Bound
    run: Result
    optimum: Optimum
    verified: Result
    cost: str
    spent: float
    """Impulse of the run [N s]: the value of the function Bound.spent if the mission has one, else
    the integral of the size of the force, by `cost` as for the optimum.
    """

    def lines(self) -> Iterator[str]:
        """Yield the lines of the report: the impulse of the run divided by the least impulse; the
        distance at the end between the optimal path and a simulation with the optimal force; and
        the verdict on each requirement in this simulation.
        """
        best = self.optimum.impulse
        ratio = f"{self.spent / best:.3g} times the optimum of {best:.4g} N s"
        yield f"{self.run.system}: {self.spent:.4g} N s, {ratio}{self._late()}"
        yield f"optimal force, open loop: {1e3 * self.miss:.0f} mm off the optimal path at the end"
        yield from (f"{f.name}: {f.statement}" for f in findings(self.verified))

    def store(self) -> Path:
        """Store the optimum for later reports and comparisons, and return the path of the file;
        raise ResultsError.
        """
        return optima.store(self.run, [self.optimum])

    def _late(self) -> str:
        """Return the impulses of optimum and run in the last third of the time, as text; "" if the
        mission counts only a part of the thrusters (`spent`).
        """
        if self.offered.spent:
            return ""
        time = self.optimum.time
        since = float(time[0] + LATE * (time[-1] - time[0]))
        late = time[1:] > since
        best = _sizes(self.optimum.force, self.cost)[late] @ np.diff(time)[late]
        spent = _spent(self.run, self.offered.force, self.cost, since)
        return f"; after {since:g} s: optimum {best:.3g} N s, run {spent:.3g} N s"

    @property
    def miss(self) -> float:
        """Return the distance at the end between the path that a simulation with the optimal force
        gives and the path of the optimum [m].
        """
        own, other = (self.verified[name][-1] for name in self.offered.positions)
        return float(np.linalg.norm(own - other - self.optimum.position[-1]))


def pushes(problem: Problem, optimum: Optimum) -> Array:
    """Return the optimal force of every step (n, 3) [N], in axes of frame N."""
    return np.asarray(np.einsum("nij,nj->ni", problem.axes, optimum.force))


def verified(system: System, offered: Bound, problem: Problem, optimum: Optimum) -> Result:
    """Return the result of a simulation in which the actuator is replaced by the optimal force,
    turned into the axes of the servicer. All other components run as in the system.
    """
    push = pushes(problem, optimum)
    actuator = offered.force.partition(".")[0]
    with Simulation(system, open=[actuator], every=offered.every) as simulation:
        q, force = (simulation.port(name) for name in (offered.attitude, offered.force))
        impulse = simulation.port(offered.impulse) if offered.impulse else np.zeros(3)
        follows = [tuple(map(simulation.port, pair)) for pair in offered.follows]
        inverse, h = np.array([1, -1, -1, -1]), simulation.clock.step
        places = np.searchsorted(problem.time, np.arange(simulation.steps) * h + h / 2) - 1
        before = q.copy()
        for k, i in enumerate(places):
            middle = (1.5 * q - 0.5 * before) * inverse  # inverse attitude in mid-step
            force[:] = turned(middle / np.linalg.norm(middle), push[i])
            before = q.copy()
            impulse += np.abs(force) * h
            for output, command in follows:
                output[:] = command
            simulation.forward(k + 1)
        return simulation.result()


def _sizes(force: Array, cost: str) -> Array:
    return np.asarray(np.linalg.norm(force, 1 if cost == "sum" else 2, axis=1))


def _spent(result: Result, name: str, cost: str, since: float = -np.inf) -> float:
    late = result.time[1:] > since
    return float(_sizes(result[name][1:], cost)[late] @ np.diff(result.time)[late])
