# SPDX-License-Identifier: BSD-2-Clause
"""Convex problem of a run, as a mission states it; harness.studies.optimum solves it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from harness.results.result import Array, Result, Rows


class Cone(NamedTuple):
    """Constraint |position rho + velocity v + offset| <= slope . rho + limit at nodes (k,) of the
    grid: position, velocity (k, m, 3), offset (k, m), slope (k, 3), limit (k,). m = 0: slope . rho
    + limit >= 0; slope and limit 0: position rho + velocity v + offset = 0.
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
    """Data of the convex problem: time (n + 1,) [s]; start: rho, v (6,) in N; gradient (n, 3, 3) of
    gravity [1/s2] and known acceleration (n, 3) [m/s2] in N; axes (n, 3, 3): C_NS in the middle of
    a step; mass [kg]; box (3,) [N]: largest force per axis, inf: none.
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
    """Solution: time (n + 1,), rho and v (n + 1, 3) in N, force (n, 3) in S, and impulse [N s]."""

    time: Array
    position: Array
    velocity: Array
    force: Array
    impulse: float


Store = Callable[[Result, Sequence[Optimum]], Path]
"""Function that stores the optima of a run for figures and metrics, and returns the file."""


class Bound(NamedTuple):
    """Least impulse of a run, for results with these variables and parameters; problem: the convex
    problem of a result and the step of its grid [s]; positions of both bodies and attitude of the
    one with thrusters; force and impulse ("": none): outputs of its actuator in axes of that body;
    follows: further outputs of the actuator with the commands that they follow; grid: default of
    the step; every: macro steps per row; spent: impulse of a run [N s] (None: of all its force);
    store: None: the optimum cannot be stored.
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
    """Phase of a run: convex problem; impulse of the run [N s]; start: parameters of both bodies
    that begin where the phase begins, with a servicer that does not turn; along: the problem with
    what is not convex replaced along another path (n + 1, 3) (None: all is convex).
    """

    problem: Problem
    spent: float
    start: Mapping[str, Any]
    along: Callable[[Problem, Array], Problem] | None = None


class PhaseBounds(NamedTuple):
    """Least impulses of the phases of a run, for results with these variables and parameters;
    phases: of a result, for a step of the grids [s] (None: of the mission), by name; positions and
    velocities of both bodies, attitude, force, every and store as in Bound.
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
