# SPDX-License-Identifier: BSD-2-Clause
"""Convex problem of a servicer relative to a target, and its solution: the least impulse with which
the servicer can meet the constraints of a run. Path and attitude of the target are taken from the
run.

    x_{i+1} = A_i x_i + B_i (C_NS,i F_i / m + d_i),   x = (rho, v),   A_i = exp(h [0 1; G_i 0])
    min h sum_i |F_i|_1  or  h sum_i |F_i|,   F_i in axes S, held in N over a step

i: step of the time grid, h: its length, rho and v: relative position and velocity in N, G: gravity
gradient, d: known acceleration, F: force of the thrusters, m: mass. Constraints are cones
|A rho + B v + b| <= c . rho + e at nodes of the grid.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from harness.errors import HarnessError, UsageError, library
from harness.results.result import Array, Rows


class Cone(NamedTuple):
    """Constraint of the convex problem at some nodes of its time grid, with position rho and
    velocity v: |position rho + velocity v + offset| <= slope . rho + limit.

    nodes: indices (k,) of the nodes; position, velocity: matrices (k, m, 3); offset (k, m); slope
    (k, 3); limit (k,). With m = 0 the constraint is slope . rho + limit >= 0. With slope and limit
    0 it is position rho + velocity v + offset = 0.
    """

    name: str
    nodes: Rows
    position: Array
    velocity: Array
    offset: Array
    slope: Array
    limit: Array


@dataclass(frozen=True)
class Problem:
    """Data of the convex problem for n steps of a time grid, for the motion relative to the target
    in the inertial frame N. time (n + 1,) [s]; start: relative position rho and velocity v (6,);
    gradient (n, 3, 3) of gravity [1/s2]; known: further acceleration (n, 3) [m/s2], besides those
    by gradient and force; axes (n, 3, 3): C_NS, attitude of the servicer in the middle of a step;
    mass [kg]; box (3,) [N]: largest force per axis of the servicer, inf: no limit; cones:
    constraints.
    """

    time: Array
    start: Array
    gradient: Array
    known: Array
    axes: Array
    mass: float
    box: Array
    cones: tuple[Cone, ...] = ()


@dataclass(frozen=True)
class Optimum:
    """Solution of the convex problem: time (n + 1,) [s], relative position and velocity (n + 1, 3)
    in N, force (n, 3) [N] in axes of the servicer, and impulse [N s].
    """

    time: Array
    position: Array
    velocity: Array
    force: Array
    impulse: float


def transitions(problem: Problem) -> tuple[Array, Array]:
    """Return the matrices A (n, 6, 6) and B (n, 6, 3) of the n steps of a problem, from the power
    series of the matrix exponential.
    """
    step = np.diff(problem.time)[:, None, None]
    rate = np.zeros((len(step), 6, 6))
    rate[:, :3, 3:], rate[:, 3:, :3] = np.eye(3), problem.gradient
    power = np.broadcast_to(np.eye(6), rate.shape)
    A, integral = power.copy(), step * power
    for k in range(1, 9):  # |G| h^2 is far below 1: 8 terms suffice
        power = power @ rate * step / k
        A += power
        integral += power * step / (k + 1)
    return A, integral[:, :, 3:]


def solve(problem: Problem, cost: str = "sum") -> Optimum:
    """Return the solution of a convex problem; raise HarnessError if it has none.

    cost of a force: `sum` of its absolute components, or its Euclidean `norm`.
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
        raise HarnessError(
            f"the convex problem has no optimum ({task.status}); try --without CONSTRAINT"
        )
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


# ---- constraints by name


def check(without: Collection[str], problems: Sequence[Problem]) -> None:
    """Raise UsageError if `without` contains a name that no constraint of these problems has."""
    names = dict.fromkeys(cone.name for problem in problems for cone in problem.cones)
    if unknown := {*without} - {*names}:
        raise UsageError(f"--without {min(unknown)}: expected one of {', '.join(names)}")


def reduced(problem: Problem, without: Collection[str]) -> Problem:
    """Return the problem without the constraints whose names are in `without`."""
    return replace(problem, cones=tuple(c for c in problem.cones if c.name not in without))
