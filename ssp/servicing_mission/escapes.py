# SPDX-License-Identifier: BSD-2-Clause
"""Escapes: predicted drifts of the servicer after an abort at any row of a run, with drawn errors
of navigation and burn, by the equations of Clohessy and Wiltshire in Hill axes (docs/models.md
G.11).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from harness.results.histories import turned
from harness.results.result import Array, Result

BOUNDS = ("e_r", "e_v", "k_p", "k_n", "e_model")
ABORT = ("mass", "abort_force", "abort_speed", "escape_time")
PARAMETERS = tuple(f"monitor.{name}" for name in (*BOUNDS, *ABORT, "escape_radius"))
STATES = ("servicer.r_SN_N", "servicer.v_SN_N", "target.r_TN_N", "target.v_TN_N")


class Escape(NamedTuple):
    """Abort at one row, in Hill axes, with the burn as a step of the velocity in its middle:
    position r [m] that the servicer has there without thrust, velocity v after the burn [m/s],
    velocity increment dv of the burn [m/s], rate n of the Hill frame [rad/s].
    """

    r: Array
    v: Array
    dv: Array
    n: float


def hill_axes(result: Result) -> tuple[Array, Array]:
    """Return the matrices (rows, 3, 3) that convert vectors from N to Hill axes of the target (the
    rows of a matrix are the Hill axes in N axes), and the rate of the Hill frame (rows,) [rad/s].
    """
    r, v = result["target.r_TN_N"], result["target.v_TN_N"]
    h = np.cross(r, v)
    x, z = r / _norm(r), h / _norm(h)
    rate = (_norm(h) / np.sum(r**2, axis=1, keepdims=True))[:, 0]
    return np.stack((x, np.cross(z, x), z), axis=1), rate


def in_hill(result: Result, vectors: Array) -> Array:
    """Return vectors (rows, 3), given in N axes, in Hill axes."""
    return np.asarray(np.einsum("kij,kj->ki", hill_axes(result)[0], vectors))


def grasp_axis(result: Result) -> Array:
    """Return the outward unit vector along the axis of the corridor in every row, N axes, (rows,
    3).
    """
    return turned(result["target.q_TN"], np.asarray(result.parameter("monitor.corridor_axis")))


def hill_states(result: Result) -> tuple[Array, Array, Array]:
    """Return position and velocity of the servicer as seen in the Hill frame of the target, (rows,
    3) [m, m/s], and the rate of the frame, (rows,) [rad/s].
    """
    r_S, v_S, r_T, v_T = (result[name] for name in STATES)
    rho, v = in_hill(result, r_S - r_T), in_hill(result, v_S - v_T)
    rate = hill_axes(result)[1]
    return rho, v - rate[:, None] * np.cross((0, 0, 1), rho), rate


def _norm(a: Array) -> Array:
    return np.asarray(np.linalg.norm(a, axis=-1, keepdims=True))


def escape(result: Result, rho: Array, drho: Array, n: float, along: Array | None = None) -> Escape:
    """Return the escape for a burn without errors at position rho [m] and velocity drho [m/s] in
    Hill axes, with the rate n of the frame [rad/s].

    Without `along`, the velocity relative to the Hill frame after the burn is monitor.abort_speed
    away from the target. With `along`, the burn adds monitor.abort_speed in the direction of this
    unit vector, as the monitor does with abort_relative = 0.
    """
    mass, force, speed = (float(result.parameter(f"monitor.{name}")) for name in ABORT[:3])
    dv = speed * rho / np.linalg.norm(rho) - drho if along is None else speed * along
    T_b = mass * np.linalg.norm(dv) / force
    return Escape(rho + drho * T_b / 2, drho + dv, dv, n)


def drift(n: float, r: Array, v: Array, tau: Array) -> Array:
    """Return positions (times, states, 3) of drifts in Hill axes [m].

    n: rate of the frame [rad/s]; r, v: positions and velocities at the start (states, 3); tau:
    times since then (times,) [s].
    """
    s, c, t = (a[:, None] for a in (np.sin(n * tau), np.cos(n * tau), tau))
    (x, y, z), (vx, vy, vz) = r.T, v.T
    return np.stack(
        (
            (4 - 3 * c) * x + s / n * vx + 2 * (1 - c) / n * vy,
            6 * (s - n * t) * x + y - 2 * (1 - c) / n * vx + (4 * s / n - 3 * t) * vy,
            c * z + s / n * vz,
        ),
        axis=-1,
    )


def drawn(result: Result, e: Escape, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return `count` positions r [m] and velocities v [m/s] as in Escape, (count, 3) each, Hill
    axes, with errors of navigation and burn drawn within e_r, e_v, k_p, k_n of the monitor.
    """
    e_r, e_v, k_p, k_n = (float(result.parameter(f"monitor.{name}")) for name in BOUNDS[:4])
    along = rng.uniform(-k_p, k_p, (count, 1)) * e.dv
    across = np.cross(rng.normal(size=(count, 3)), e.dv)
    across *= k_n * np.linalg.norm(e.dv) / np.maximum(_norm(across), 1e-12)
    r = e.r + rng.uniform(-e_r, e_r, (count, 3))
    return r, e.v + rng.uniform(-e_v, e_v, (count, 3)) + along + across


def support(result: Result, e: Escape, tau: Array) -> tuple[Array, Array]:
    """Return the path without errors, Hill axes, (times, 3) [m], and the largest displacement
    towards the target by errors within e_r to e_model of the monitor, (times,) [m].

    tau: times since the middle of the burn (times,) [s].
    """
    e_r, e_v, k_p, k_n, e_model = (float(result.parameter(f"monitor.{n}")) for n in BOUNDS)
    path = drift(e.n, e.r[None], e.v[None], tau)[:, 0]
    toward = path / _norm(path)
    unit = np.eye(3)
    a = np.einsum("tki,ti->tk", drift(e.n, unit, 0 * unit, tau), toward)
    b = np.einsum("tki,ti->tk", drift(e.n, 0 * unit, unit, tau), toward)
    h = e_r * np.abs(a).sum(axis=1) + e_v * np.abs(b).sum(axis=1) + k_p * np.abs(b @ e.dv)
    return path, h + k_n * np.linalg.norm(e.dv) * _norm(b)[:, 0] + e_model * tau**2 / 2
