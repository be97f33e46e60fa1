# SPDX-License-Identifier: BSD-2-Clause
"""Bound of a run: the least impulse with which its constraints can be met, as a convex problem in
the motion relative to the target, whose path and attitude are data.

    x_{i+1} = A_i x_i + B_i (C_NS,i F_i / m + d_i),   x = (rho, v),   A_i = exp(h [0 1; G_i 0])
    min h sum_i |F_i|_1  or  h sum_i |F_i|,   F_i in axes S, held in N over a step

Constraints are cones |A rho + B v + b| <= c . rho + e at nodes of the grid. A mission states them.
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
"""Costs of a step: of every axis on its own, or of the length of the force."""
LATE = 2 / 3
"""Share of a run from which on optimum and run are reported on their own, too."""


def transitions(problem: Problem) -> tuple[Array, Array]:
    """Return A (n, 6, 6) and B (n, 6, 3) of the steps, from the series of the exponential."""
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
    """Return the optimum of a problem; raise HarnessError if there is none."""
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
        raise HarnessError(f"the convex problem has no optimum ({task.status})")
    return Optimum(problem.time, rho.value, v.value, force.value, float(task.value))


def _each(matrices: Array, rows: Any) -> Any:
    """Return matrices (n, i, j) times rows (n, j)."""
    cp = library("cvxpy", "optimum")
    sparse = library("scipy.sparse", "optimum")
    n, i, j = matrices.shape
    block = sparse.bsr_array((matrices, np.arange(n), np.arange(n + 1)), shape=(n * i, n * j))
    return cp.reshape(block.tocsr() @ cp.vec(rows, order="C"), (n, i), order="C")


def _rule(cone: Cone, rho: Any, v: Any) -> Any:
    cp = library("cvxpy", "optimum")
    here, there = rho[cone.nodes], v[cone.nodes]
    far = cp.sum(cp.multiply(cone.slope, here), axis=1) + cone.limit
    if not cone.offset.shape[1]:
        return far >= 0
    left = _each(cone.position, here) + _each(cone.velocity, there) + cone.offset
    if not (cone.slope.any() or cone.limit.any()):
        return left == 0
    return cp.norm(left, 2, axis=1) <= far


# ---- the bound of a run


@dataclass(frozen=True)
class Answer:
    """Run, its optimum, and the optimal force in the simulation; cost: one of COSTS."""

    offered: Bound
    run: Result
    optimum: Optimum
    verified: Result
    cost: str
    spent: float
    """Cost of the run [N s]."""

    def lines(self) -> Iterator[str]:
        """Yield the ratio, what the verification shows, and the requirements in it."""
        best = self.optimum.impulse
        ratio = f"{self.spent / best:.3g} times the optimum of {best:.4g} N s"
        yield f"{self.run.system}: {self.spent:.4g} N s, {ratio}{self._late()}"
        yield f"open loop in the simulation: {1e3 * self.miss:.0f} mm off the plan at the end"
        yield from (f"{f.name}: {f.statement}" for f in findings(self.verified))

    def _late(self) -> str:
        """Return what optimum and run spend late, as text, where all force is counted."""
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
        """Return the distance of the verification from the plan at the end [m]."""
        own, other = (self.verified[name][-1] for name in self.offered.positions)
        return float(np.linalg.norm(own - other - self.optimum.position[-1]))


class PhaseOptimum(NamedTuple):
    """Impulse of a phase in the run [N s], its optimum, the initial mass [kg], and how far position
    [m] and velocity [m/s] are off the plan at the end of a simulation of the optimal force.
    """

    spent: float
    optimum: Optimum
    mass: float
    miss: tuple[float, float]


NOTHING = 1e-6
"""Velocity increment that counts as none: far below what a solver resolves [m/s]."""


@dataclass(frozen=True)
class PhaseAnswer:
    """Run and the optima of its phases by name."""

    offered: PhaseBounds
    run: Result
    phases: Mapping[str, PhaseOptimum]

    def lines(self) -> Iterator[str]:
        """Yield the increments of each phase beside its optimum, with the verification, and their
        sums.
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
"""Solutions of a phase, each with what is not convex replaced along the path of the one before."""


def phase_optimum(phase: Phase, cost: str = "sum", without: Collection[str] = ()) -> Optimum:
    """Return the optimum of a phase, the best of PASSES; raise HarnessError if there is none."""
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
    """Return how far position [m] and velocity [m/s] are off the plan at the end of a phase: of a
    simulation of the plants of both bodies alone, in which the actuator gives the optimal force,
    held in N over a step of the grid.
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
    """Return the optimal force of every step in N (n, 3)."""
    return np.asarray(np.einsum("nij,nj->ni", problem.axes, optimum.force))


def bound(
    system: str | Path,
    *,
    cost: str = "sum",
    grid: float | None = None,
    without: Collection[str] = (),
    **changes: Unpack[Changes],
) -> Answer | PhaseAnswer:
    """Return what a run costs at least under its constraints, and the run of the optimal force; of
    a mission with phases what each of them costs at least.

    cost: `sum` of the axes, or `norm`; grid: step of the problem [s] (None: of the mission);
    without: constraints by name that are left out. Raises UsageError, the exceptions of run(), and
    HarnessError if there is no optimum.
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


def _of_phases(  # noqa: PLR0913, PLR0917 - what bound() has found and was given
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
    """Store the optima of a run for reports and comparisons of its case, and return the file; raise
    UsageError if its mission cannot, ResultsError.
    """
    if answer.offered.store is None:
        raise UsageError(f"--store: the mission of {answer.run.system} cannot store optima")
    parts = [answer] if isinstance(answer, Answer) else answer.phases.values()
    return answer.offered.store(answer.run, [part.optimum for part in parts])


def _fitting(offered: Sequence[Bound | PhaseBounds], result: Result) -> Bound | PhaseBounds:
    """Return the first bound that fits a result; raise UsageError."""
    for each in offered:
        if result.holds(*each.needs, parameters=each.parameters):
            return each
    raise UsageError(f"{result.system}: its mission offers no convex problem")


def _check(without: Collection[str], problems: Sequence[Problem]) -> None:
    """Raise UsageError for a name that no constraint has."""
    names = dict.fromkeys(cone.name for problem in problems for cone in problem.cones)
    if unknown := {*without} - {*names}:
        raise UsageError(f"--without {min(unknown)}: the constraints are {', '.join(names)}")


def _reduced(problem: Problem, without: Collection[str]) -> Problem:
    return replace(problem, cones=tuple(c for c in problem.cones if c.name not in without))


def _sizes(force: Array, cost: str) -> Array:
    return np.asarray(np.linalg.norm(force, 1 if cost == "sum" else 2, axis=1))


def _spent(result: Result, name: str, cost: str, since: float = -np.inf) -> float:
    late = result.time[1:] > since
    return float(_sizes(result[name][1:], cost)[late] @ np.diff(result.time)[late])


def verified(system: System, offered: Bound, problem: Problem, optimum: Optimum) -> Result:
    """Return the run in which the actuator gives the optimal force, turned into the axes of the
    servicer, and all other components work as ever.
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
            middle = (1.5 * q - 0.5 * before) * inverse  # of the step, in which the body turns
            force[:] = turned(middle / np.linalg.norm(middle), push[i])
            before = q.copy()
            impulse += np.abs(force) * h
            for output, command in follows:
                output[:] = command
            simulation.forward(k + 1)
        return simulation.result()
