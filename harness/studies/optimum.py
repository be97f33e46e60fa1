# SPDX-License-Identifier: BSD-2-Clause
"""Least impulse of a run: the smallest impulse with which the servicer can meet the constraints of
the run. It is the optimum of a convex problem in the motion of the servicer relative to the target;
path and attitude of the target are taken from the run.

    x_{i+1} = A_i x_i + B_i (C_NS,i F_i / m + d_i),   x = (rho, v),   A_i = exp(h [0 1; G_i 0])
    min h sum_i |F_i|_1  or  h sum_i |F_i|,   F_i in axes S, held in N over a step

i: step of the time grid, h: its length, rho and v: relative position and velocity in N, G: gravity
gradient, d: known acceleration, F: force of the thrusters, m: mass. Constraints are cones
|A rho + B v + b| <= c . rho + e at nodes of the grid, which the mission states.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Unpack

import numpy as np

from harness.errors import HarnessError, UsageError, library
from harness.master.changes import Changes, apply
from harness.master.simulation import Simulation
from harness.mission.library import mission
from harness.mission.optimum import Bound, Cone, Optimum, Phase, PhaseBounds, Problem
from harness.results.histories import turned
from harness.results.requirements import findings
from harness.results.result import Array, Result
from harness.ssp.library import load
from harness.system.model import System

COSTS = ("sum", "norm")
"""Costs of a force: the sum of its absolute components, or its Euclidean norm."""
LATE = 2 / 3
"""Share of the time span after which the impulses are also reported separately."""


def transitions(problem: Problem) -> tuple[Array, Array]:
    """Return the matrices A (n, 6, 6) and B (n, 6, 3) of the n steps of a problem, from the power
    series of the matrix exponential.
    """
    step = np.diff(problem.time)[:, None, None]
    rate = np.zeros((len(step), 6, 6))
    rate[:, :3, 3:], rate[:, 3:, :3] = np.eye(3), problem.gradient
    power = np.broadcast_to(np.eye(6), rate.shape)
    A, integral = power.copy(), step * power
    for k in range(1, 9):  # |G| h^2 is far below 1
        power = power @ rate * step / k
        A += power
        integral += power * step / (k + 1)
    return A, integral[:, :, 3:]


def solve(problem: Problem, cost: str = "sum") -> Optimum:
    """Return the solution of a convex problem; raise HarnessError if it has none.

    cost: one of COSTS.
    """
    cp = library("cvxpy", "optimum")
    n = len(problem.time) - 1
    rho, v, force = (cp.Variable((k, 3)) for k in (n + 1, n + 1, n))
    state = cp.hstack([rho, v])
    A, B = transitions(problem)
    thrust = np.einsum("nij,njk->nik", B, problem.axes) / problem.mass
    drift = np.einsum("nij,nj->ni", B, problem.known)
    rules = [
        state[0] == problem.start,
        state[1:] == _each(A, state[:-1]) + _each(thrust, force) + drift,
        *(_rule(cone, rho, v) for cone in problem.cones if len(cone.nodes)),
    ]
    limited = np.isfinite(problem.box)
    if limited.any():
        rules.append(cp.abs(force[:, limited]) <= np.tile(problem.box[limited], (n, 1)))
    step = np.diff(problem.time)
    size = cp.norm(force, 1 if cost == "sum" else 2, axis=1)
    task = cp.Problem(cp.Minimize(step @ size), rules)
    task.solve(solver=cp.CLARABEL)
    if task.status != cp.OPTIMAL:
        raise HarnessError(f"the convex problem has no optimum ({task.status}); try --without NAME")
    return Optimum(problem.time, rho.value, v.value, force.value, float(task.value))


def _each(matrices: Array, rows: Any) -> Any:
    """Return the products (n, i) of each of n matrices (n, i, j) with its own row (n, j), as an
    expression of cvxpy.
    """
    cp = library("cvxpy", "optimum")
    sparse = library("scipy.sparse", "optimum")
    n, i, j = matrices.shape
    block = sparse.bsr_array((matrices, np.arange(n), np.arange(n + 1)), shape=(n * i, n * j))
    return cp.reshape(block.tocsr() @ cp.vec(rows, order="C"), (n, i), order="C")


def _rule(cone: Cone, rho: Any, v: Any) -> Any:
    """Return a cone as a constraint of cvxpy on positions rho and velocities v (nodes, 3)."""
    cp = library("cvxpy", "optimum")
    here, there = rho[cone.nodes], v[cone.nodes]
    far = cp.sum(cp.multiply(cone.slope, here), axis=1) + cone.limit
    if not cone.offset.shape[1]:
        return far >= 0
    left = _each(cone.position, here) + _each(cone.velocity, there) + cone.offset
    if not (cone.slope.any() or cone.limit.any()):
        return left == 0
    return cp.norm(left, 2, axis=1) <= far


# ---- least impulse of a run


@dataclass(frozen=True)
class Answer:
    """Least impulse of a run.

    offered: definition by the mission; run: the run itself; optimum: solution of the convex
    problem; verified: simulation in which the actuator gives the optimal force; cost: one of COSTS.
    """

    offered: Bound
    run: Result
    optimum: Optimum
    verified: Result
    cost: str
    spent: float
    """Impulse of the run by the same cost [N s]."""

    def lines(self) -> Iterator[str]:
        """Yield the report: impulse of the run relative to the optimum, distance between simulation
        and plan, and the verdicts on the requirements in the simulation of the optimal force.
        """
        best = self.optimum.impulse
        ratio = f"{self.spent / best:.3g} times the optimum of {best:.4g} N s"
        yield f"{self.run.system}: {self.spent:.4g} N s, {ratio}{self._late()}"
        yield f"open loop in the simulation: {1e3 * self.miss:.0f} mm off the plan at the end"
        yield from (f"{f.name}: {f.statement}" for f in findings(self.verified))

    def _late(self) -> str:
        """Return the impulses of optimum and run in the last third of the time, as text; "" if the
        mission counts the impulse of the run in another way than over all force.
        """
        if self.offered.spent:
            return ""
        time = self.optimum.time
        since = float(time[0] + LATE * (time[-1] - time[0]))
        late = time[1:] > since
        best = _sizes(self.optimum.force, self.cost)[late] @ np.diff(time)[late]
        spent = _spent(self.run, self.offered.force, self.cost, since)
        return f"; after {since:g} s {best:.3g} N s (the run: {spent:.3g} N s)"

    @property
    def miss(self) -> float:
        """Return the distance between the simulation of the optimal force and the optimum at the
        end [m].
        """
        own, other = (self.verified[name][-1] for name in self.offered.positions)
        return float(np.linalg.norm(own - other - self.optimum.position[-1]))


class PhaseOptimum(NamedTuple):
    """Least impulse of a phase.

    spent: impulse of the phase in the run [N s]; optimum: solution of its convex problem; mass: at
    the beginning [kg]; miss: distances of position [m] and velocity [m/s] between a simulation of
    the optimal force and the optimum at the end of the phase.
    """

    spent: float
    optimum: Optimum
    mass: float
    miss: tuple[float, float]


NOTHING = 1e-6
"""Velocity increment below which an optimum counts as 0, far below the solver's accuracy [m/s]."""


@dataclass(frozen=True)
class PhaseAnswer:
    """Run and the least impulses of its phases, by name of the phase."""

    offered: PhaseBounds
    run: Result
    phases: Mapping[str, PhaseOptimum]

    def lines(self) -> Iterator[str]:
        """Yield a line per phase, and one for their sum: velocity increment in the run relative to
        the optimum, and distance between the simulation of the optimal force and the optimum.
        """
        found = [
            (name, p.spent / p.mass, p.optimum.impulse / p.mass) for name, p in self.phases.items()
        ]
        ends = [f"; open loop {1e3 * r:.2g} mm, {1e3 * v:.1g} mm/s off the plan"
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
    """Return the best of PASSES solutions of a phase; raise HarnessError if it has none.

    cost: one of COSTS; without: names of constraints that are left out.
    """
    best = solve(_reduced(phase.problem, without), cost)
    for _ in range(PASSES - 1):
        if phase.along is None:
            break
        again = solve(_reduced(phase.along(phase.problem, best.position), without), cost)
        if again.impulse < best.impulse:
            best = again
    return best


def phase_verified(
    system: System, offered: PhaseBounds, phase: Phase, optimum: Optimum
) -> tuple[float, float]:
    """Return the distances of position [m] and velocity [m/s] between a simulation of the optimal
    force and the optimum at the end of a phase. The simulation contains only the plants of both
    bodies. The force is constant in frame N during each step of the grid.
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
        impulses = _pushes(phase.problem, optimum) * np.diff(optimum.time)[:, None]
        for impulse, first, last in zip(impulses, ends[:-1], ends[1:], strict=True):
            force[:] = turned(into, impulse / (h * (last - first)))
            simulation.forward(int(last))
        pairs = (offered.positions, offered.velocities)
        own, other = (np.array([simulation.port(pair[k]) for pair in pairs]) for k in (0, 1))
    plan = np.array([optimum.position[-1], optimum.velocity[-1]])
    position, velocity = np.linalg.norm(own - other - plan, axis=1).tolist()
    return position, velocity


def _pushes(problem: Problem, optimum: Optimum) -> Array:
    """Return the optimal force of every step (n, 3) [N], in axes of frame N."""
    return np.asarray(np.einsum("nij,nj->ni", problem.axes, optimum.force))


def bound(
    system: str | Path,
    *,
    cost: str = "sum",
    grid: float | None = None,
    without: Collection[str] = (),
    **changes: Unpack[Changes],
) -> Answer | PhaseAnswer:
    """Run a system and return the least impulse with which its constraints can be met: of the whole
    run, or of each phase if the mission defines phases.

    cost: `sum` of the absolute components of the force, or `norm`; grid: step of the convex problem
    [s] (None: as the mission defines); without: names of constraints to leave out; changes: as for
    run(). Raises UsageError, the exceptions of run(), and HarnessError if there is no optimum.
    """
    if cost not in COSTS:
        raise UsageError(f"--cost {cost}: expected {' or '.join(COSTS)}")
    with load(system) as found:
        changed = apply(found, **changes)
        own = mission(changed.mission) if changed.mission else None
        offered = own.bounds if own else ()
        with Simulation(changed, every=min((b.every for b in offered), default=1)) as simulation:
            simulation.advance()
            run = simulation.result()
        chosen = _fitting(offered, run)
        if isinstance(chosen, PhaseBounds):
            return _of_phases(changed, chosen, run, chosen.phases(run, grid), cost, without)
        problem = chosen.problem(run, grid or chosen.grid)
        _check(without, [problem])
        problem = _reduced(problem, without)
        best = solve(problem, cost)
        spent = chosen.spent(run) if chosen.spent else _spent(run, chosen.force, cost)
        return Answer(chosen, run, best, verified(changed, chosen, problem, best), cost, spent)


def _of_phases(  # noqa: PLR0913, PLR0917 - arguments and results of bound()
    system: System,
    offered: PhaseBounds,
    run: Result,
    phases: Mapping[str, Phase],
    cost: str,
    without: Collection[str],
) -> PhaseAnswer:
    _check(without, [phase.problem for phase in phases.values()])
    found = {}
    for name, phase in phases.items():
        best = phase_optimum(phase, cost, without)
        miss = phase_verified(system, offered, phase, best)
        found[name] = PhaseOptimum(phase.spent, best, phase.problem.mass, miss)
    return PhaseAnswer(offered, run, found)


def store(answer: Answer | PhaseAnswer) -> Path:
    """Store the optima of a run for later reports and comparisons, and return the path of the file.

    Raises UsageError if the mission cannot store optima, ResultsError if the file cannot be
    written.
    """
    if answer.offered.store is None:
        raise UsageError(f"--store: the mission of {answer.run.system} cannot store optima")
    parts = [answer] if isinstance(answer, Answer) else answer.phases.values()
    return answer.offered.store(answer.run, [part.optimum for part in parts])


def _fitting(offered: Sequence[Bound | PhaseBounds], result: Result) -> Bound | PhaseBounds:
    """Return the first definition of a least impulse whose variables and parameters a result has;
    raise UsageError if there is none.
    """
    for each in offered:
        if result.holds(*each.needs, parameters=each.parameters):
            return each
    raise UsageError(f"{result.system}: its mission defines no convex problem for this system")


def _check(without: Collection[str], problems: Sequence[Problem]) -> None:
    """Raise UsageError if `without` contains a name that no constraint of these problems has."""
    names = dict.fromkeys(cone.name for problem in problems for cone in problem.cones)
    if unknown := {*without} - {*names}:
        raise UsageError(f"--without {min(unknown)}: expected one of {', '.join(names)}")


def _reduced(problem: Problem, without: Collection[str]) -> Problem:
    return replace(problem, cones=tuple(c for c in problem.cones if c.name not in without))


def _sizes(force: Array, cost: str) -> Array:
    return np.asarray(np.linalg.norm(force, 1 if cost == "sum" else 2, axis=1))


def _spent(result: Result, name: str, cost: str, since: float = -np.inf) -> float:
    late = result.time[1:] > since
    return float(_sizes(result[name][1:], cost)[late] @ np.diff(result.time)[late])


def verified(system: System, offered: Bound, problem: Problem, optimum: Optimum) -> Result:
    """Return the result of a simulation in which the actuator is replaced by the optimal force,
    turned into the axes of the servicer. All other components run as in the system.
    """
    push = _pushes(problem, optimum)
    actuator = offered.force.partition(".")[0]
    with Simulation(system, open=[actuator], every=offered.every) as simulation:
        q, force = (simulation.port(name) for name in (offered.attitude, offered.force))
        impulse = simulation.port(offered.impulse) if offered.impulse else np.zeros(3)
        follows = [tuple(map(simulation.port, pair)) for pair in offered.follows]
        inverse, h = np.array([1, -1, -1, -1]), simulation.clock.step
        places = np.searchsorted(problem.time, np.arange(simulation.steps) * h + h / 2) - 1
        before = q.copy()
        for k, i in enumerate(places):
            middle = (1.5 * q - 0.5 * before) * inverse  # attitude in the middle of the step
            force[:] = turned(middle / np.linalg.norm(middle), push[i])
            before = q.copy()
            impulse += np.abs(force) * h
            for output, command in follows:
                output[:] = command
            simulation.forward(k + 1)
        return simulation.result()
