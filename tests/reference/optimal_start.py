# SPDX-License-Identifier: BSD-2-Clause
"""Start of the synchronised approach as one problem, for the solver of bounds and for iterations
from a cold start: ten minutes, 60 nodes, held attitude, no tide.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ssp.shared import bounds
from ssp.shared.convex import Cone, Problem
from tests.reference.optimal import Solve, matrix_of, tumble

N, DT, MASS = 60, 10.0, 95.0
RHO = np.array([10, -17.320508075878024, 0])
V = np.array([0.015911635730844864, 0.009186587172735017, -0.010607757154005526])
Q_SN = np.array([0.8140589569160998, 0.36281179138321995, -0.36281179138321995,
                 0.27210884353741494])  # fmt: skip
Q_TN = np.array([0.8812463256907703, -0.0376249265138154, 0.028218694885361554,
                 -0.4703115814226926])  # fmt: skip
OMEGA, J = np.array([0.002, 0.01, 0]), np.diag([100.0, 150, 90])
MOST, CONE, LEAST, END = np.array([1.9, 0.95, 0.95]), np.radians(8.8), 4.005, 4.02


class Start(NamedTuple):
    """Position and velocity from the target, and the length of a node [s]."""

    rho: np.ndarray = RHO
    v: np.ndarray = V
    dt: float = DT


PUBLISHED = Start()


def drawn(rng):
    """Start that turns with the target, in the corridor, 8 to 25 m away; 350 to 650 s."""
    axis = matrix_of(Q_TN).T[:, 0]
    across = np.cross(axis, rng.normal(size=3))
    rho = rng.uniform(8, 25) * (axis + rng.uniform(0, 0.1) * across / np.linalg.norm(across))
    return Start(rho, np.cross(matrix_of(Q_TN).T @ OMEGA, rho), rng.uniform(350, 650) / N)


def target(dt=DT):
    """Grasp axes at the ends of the nodes, and position and velocity of the goal at the last."""
    q, w, axes = Q_TN, OMEGA, []
    for _ in range(N):
        for _ in range(2):
            q, w = tumble(J, q, w, dt / 2)
        axes.append(matrix_of(q).T[:, 0])
    end = END * axes[-1]
    return np.array(axes), end, np.cross(matrix_of(q).T @ w, end)


def problem(begin=PUBLISHED):
    """For ssp.shared.convex."""
    axis, end, velocity = target(begin.dt)
    nodes = np.arange(N + 1) > 0
    axis = np.vstack([axis[:1], axis])
    axes = np.broadcast_to(matrix_of(Q_SN).T, (N, 3, 3))
    one, none, zero = np.eye(3)[None], np.zeros((1, 3, 3)), np.zeros((1, 3))
    last = np.array([N])
    cones = (
        bounds.about("corridor", nodes, axis, CONE),
        bounds.beyond("distance", nodes, axis, LEAST),
        Cone("end", last, one, none, -end[None], zero, zero[:, 0]),
        Cone("rest", last, none, one, -velocity[None], zero, zero[:, 0]),
    )
    still = np.zeros((N, 3))
    start = np.concatenate([begin.rho, begin.v])
    return Problem(begin.dt * np.arange(N + 1), start, 0 * axes, still, axes, MASS, MOST, cones)


def iterated(count, begin=PUBLISHED):
    """Impulse [N s] and largest violation of the corridor [m] after iterations, cold start."""
    axis, end, velocity = target(begin.dt)
    T = N * begin.dt
    time = begin.dt * np.arange(1, N + 1)[:, None]
    C = np.broadcast_to(matrix_of(Q_SN), (N, 3, 3))
    most = MOST / MASS
    open_, wide = np.zeros(N), np.full(N, 1e6)
    solve = Solve(
        T, N, C, most, 0.005 * most.max(),
        (begin.rho + time * begin.v) / T**2, np.tile(begin.v, (N, 1)) / T,
        end / T**2, velocity / T, (axis, np.full(N, np.tan(CONE)), open_),
        (axis, np.full(N, LEAST) / T**2, wide, np.zeros(N, bool), axis, wide),
    )  # fmt: skip
    solve.start()
    for _ in range(count):
        solve.iterate()
    force = np.einsum("kij,kj->ki", C, solve.z["u"])
    h = 1 / N
    k, j = np.mgrid[:N, :N]
    held = np.where(j <= k, h * h * (k - j + 0.5), 0.0)
    path = (solve.pf + held @ solve.z["u"]) * T**2
    along = np.sum(path * axis, axis=1)
    across = np.linalg.norm(path - along[:, None] * axis, axis=1)
    return MASS * begin.dt * np.abs(force).sum(), max(0.0, np.max(across - np.tan(CONE) * along))
