# SPDX-License-Identifier: BSD-2-Clause
"""Reference of the escape: increment of the abort, its bound on the least range, and paths of drawn
states.

The transition is the matrix exponential of the Clohessy-Wiltshire equations; distances of chords
come from a minimisation over the chord; paths of drawn states are evaluated every second.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm

from .attitude import cross
from .mission import hill_matrix

TIMES = np.concatenate((np.arange(0, 600, 20), np.arange(600, 3601, 60))).astype(float)
"""Instants of the bound for an escape_time of 3600 s."""
GEO = np.sqrt(3.986004415e14 / 42164e3**3)


@dataclass(frozen=True)
class Bounds:
    """Abort and bounds of its errors, as parameters of the monitor name them."""

    mass: float = 100.0
    abort_force: float = 0.9
    abort_speed: float = 0.1
    e_r: float = 0.05
    e_v: float = 5e-3
    k_p: float = 0.05
    k_n: float = 0.01
    r_max: float = 80.0
    e_model: float = 1e-8


def size(a):
    """Norms of the last axis."""
    return np.linalg.norm(a, axis=-1)


def increment(p: Bounds, rho, drho):
    """Velocity increment in Hill axes."""
    return p.abort_speed * np.asarray(rho) / size(rho) - drho


def after_burn(p: Bounds, rho, drho):
    """Relative state with which the drift begins."""
    T_b = p.mass * size(increment(p, rho, drho)) / p.abort_force
    return rho + np.asarray(drho) * T_b / 2, drho + increment(p, rho, drho)


def transitions(n, times):
    """Phi(tau) of all times, (times, 6, 6)."""
    return np.array([expm(hill_matrix(n) * t) for t in times])


def distance_of_chord(a, b):
    """Least distance of the points a + s (b - a), 0 <= s <= 1, from the origin."""
    d = b - a
    s = np.clip(-np.sum(a * d, axis=-1) / np.maximum(np.sum(d * d, axis=-1), 1e-300), 0, 1)
    return size(a + s[..., None] * d)


def bound(p: Bounds, n, rho, drho, dv=None):
    """Least range of the escape for all errors, and the beginning and end of its part [s]: the burn
    (0, 0), or between two of TIMES.
    """
    rho, drho = np.asarray(rho, float), np.asarray(drho, float)
    dv = increment(p, rho, drho) if dv is None else np.asarray(dv, float)
    T_b = p.mass * size(dv) / p.abort_force if dv.any() else 0.0
    r, v = rho + drho * T_b / 2, drho + dv
    phi = transitions(n, TIMES)
    c = phi[:, :3, :3] @ r + phi[:, :3, 3:] @ v
    toward = c / size(c)[:, None]
    a = np.einsum("kij,ki->kj", phi[:, :3, :3], toward)
    b = np.einsum("kij,ki->kj", phi[:, :3, 3:], toward)
    h = p.e_r * abs(a).sum(axis=1) + p.e_v * abs(b).sum(axis=1) + p.e_model * TIMES**2 / 2
    h += p.k_p * abs(b @ dv) + p.k_n * size(dv) * size(b)
    D = np.diff(TIMES)
    w = np.maximum(2 * (size(v) + p.e_v), 1.25 * size(np.diff(c, axis=0)) / D)
    s = D**2 / 8 * (2 * n * w + 3 * n**2 * p.r_max)
    k = np.sqrt(2 / (1 + np.sum(toward[1:] * toward[:-1], axis=1)))
    least = distance_of_chord(c[:-1], c[1:]) - k * np.maximum(h[1:], h[:-1]) - s
    part = int(least.argmin())
    u = rho / size(rho)
    burn = min(u @ rho, u @ r, u @ (r + v * T_b / 2)) - p.e_r * abs(u).sum()
    if burn < least.min():
        return burn, (0.0, 0.0)
    return least.min(), (TIMES[part], TIMES[part + 1])


def ranges(p: Bounds, n, rho, drho, errors, step=1.0):
    """Least range of the drift within an hour for every row of errors: position (3), velocity (3),
    share of the burn along its increment, velocity across it (3).
    """
    r, v = after_burn(p, rho, drho)
    dv = increment(p, rho, drho)
    starts = np.concatenate(
        (r + errors[:, :3], v + errors[:, 3:6] + errors[:, 6:7] * dv + errors[:, 7:]), axis=1
    )
    once, state, least = expm(hill_matrix(n) * step), starts.T, size(starts[:, :3])
    for _ in range(round(TIMES[-1] / step)):
        state = once @ state
        least = np.minimum(least, size(state[:3].T))
    return least


def corners(p: Bounds, dv):
    """All 64 corners of the box of navigation, with the burn 5 % long and short and 1 % aside in
    eight directions.
    """
    signs = np.array(np.meshgrid(*[(-1, 1)] * 6)).reshape(6, -1).T
    box = np.concatenate((p.e_r * signs[:, :3], p.e_v * signs[:, 3:]), axis=1)
    return np.array([(*x, along, *aside) for x in box for along, aside in burns(p, dv)])


def burns(p: Bounds, dv):
    """Errors of the burn at their bounds: share along, velocity across."""
    one = cross(dv, np.eye(3)[np.argmin(abs(dv))])
    one /= size(one)
    other = cross(dv, one) / size(dv)
    for angle in np.arange(8) * np.pi / 4:
        across = p.k_n * size(dv) * (np.cos(angle) * one + np.sin(angle) * other)
        for along in (-p.k_p, p.k_p):
            yield along, across


def drawn(p: Bounds, dv, rng, count):
    """Errors within the bounds, uniform in the box, the burn uniform along and across."""
    box = rng.uniform(-1, 1, (count, 6)) * np.repeat((p.e_r, p.e_v), 3)
    along = rng.uniform(-p.k_p, p.k_p, (count, 1))
    across = cross(rng.normal(size=(count, 3)), dv)
    across *= p.k_n * rng.uniform(0, 1, (count, 1)) * size(dv) / size(across)[:, None]
    return np.concatenate((box, along, across), axis=1)
