# SPDX-License-Identifier: BSD-2-Clause
"""Convex problem of a run, as a mission states it, and its optimum; harness.studies.optimum solves
the problem.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from harness.results.result import Array, Result, Rows


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


Store = Callable[[Result, Sequence[Optimum]], Path]
"""Function that stores the optima of a run for figures and metrics, and returns the file."""


class Bound(NamedTuple):
    """Least possible impulse of a run, for results with these variables and parameters (`needs`,
    `parameters`).

    problem: function of a result and the step of the grid [s] that returns the convex problem;
    positions: variables with the positions of both bodies; attitude: variable with the attitude of
    the body with thrusters; force, impulse ("": none): outputs of its actuator, in axes of that
    body; follows: further outputs of the actuator, each with the command that it follows; grid:
    default step of the grid [s]; every: macro steps per row; spent: function that returns the
    impulse of a run [N s] (None: the impulse of all its force); store: function that stores the
    optimum (None: it cannot be stored).
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
    store: Store | None = None


class Phase(NamedTuple):
    """Phase of a run. problem: its convex problem; spent: impulse of the run in the phase [N s];
    start: parameters with which a simulation of both bodies begins where the phase begins, with a
    servicer that does not rotate; along: function that returns the problem for a given path (n + 1,
    3), on which it replaces what is not convex (None: all is convex).
    """

    problem: Problem
    spent: float
    start: Mapping[str, Any]
    along: Callable[[Problem, Array], Problem] | None = None


class PhaseBounds(NamedTuple):
    """Least possible impulses of the phases of a run, for results with these variables and
    parameters (`needs`, `parameters`).

    phases: function of a result and the step of the grids [s] (None: the step of the mission) that
    returns the phases by name; positions, velocities: variables of both bodies; attitude, force,
    every and store as in Bound.
    """

    needs: tuple[str, ...]
    parameters: tuple[str, ...]
    phases: Callable[[Result, float | None], Mapping[str, Phase]]
    positions: tuple[str, str]
    velocities: tuple[str, str]
    attitude: str
    force: str
    every: int = 1
    store: Store | None = None
