# SPDX-License-Identifier: BSD-2-Clause
"""The rendezvous benchmark SPRE in closed form, in its own units (m, min, kg): thrust in continuous
time by eigenvectors, free motion by Clohessy & Wiltshire. States are (x, y, vx, vy).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
MASS, END = 500.0, 300.0
SWITCH, BOX, SPEED = -100.0, 0.2, 3.3
"""x where the attempt begins, half the side of the target [m]; speed limit [m/min]."""
N = np.sqrt(3.986e14 * 3600 / 42164e3**3)
FREE = np.array(((0, 0, 1, 0), (0, 0, 0, 1), (3 * N**2, 0, 0, 2 * N), (0, 0, -2 * N, 0)))
K1 = ((-28.8287, 0.1005, -1449.9754, 0.0046), (-0.087, -33.2562, 0.00462, -1451.5013))
K2 = ((-288.0288, 0.1312, -9614.9898, 0.0), (-0.1312, -288.0, 0.0, -9614.9883))


START = ((-925.0, -875.0), (-425.0, -375.0))
"""x and y of the start box [m]."""
NEVER = 1e9


@dataclass(frozen=True)
class Instance:
    """An instance of the benchmark: abort interval [min] and the published verdict."""

    name: str
    abort: tuple[float, float]
    safe: bool = True


INSTANCES = (
    Instance("SRNA01", (NEVER, NEVER)),
    Instance("SRA01", (120, 120)),
    Instance("SRA02", (120, 125)),
    Instance("SRA03", (120, 145)),
    Instance("SRA04", (240, 240)),
    Instance("SRA05", (235, 240)),
    Instance("SRA06", (230, 240)),
    Instance("SRA07", (50, 150)),
    Instance("SRA08", (0, 240)),
    Instance("SRU01", (260, 260), safe=False),
    Instance("SRU02", (0, 260), safe=False),
)


def starts(xy: Array) -> Array:
    """At rest in x, y (n, 2)."""
    return np.concatenate([xy, np.zeros_like(xy)], axis=1)


def driven(gains: tuple[tuple[float, ...], ...], s: Array, t: Array) -> Array:
    """States (n, k, 4) after t (n, k) under feedback from s (n, 4): V exp(w t) V^-1 s."""
    w, V = np.linalg.eig(FREE + np.vstack((np.zeros((2, 4)), np.array(gains) / MASS)))
    c = s @ np.linalg.inv(V).T
    return np.real((np.exp(w * t[..., None]) * c[:, None, :]) @ V.T)


def drifting(s: Array, t: Array) -> Array:
    """The same without thrust."""
    (x, y, u, v), a = (s[:, None, i] for i in range(4)), N * t
    c, k = np.cos(a), np.sin(a)
    return np.stack(
        (
            (4 - 3 * c) * x + k / N * u + 2 / N * (1 - c) * v,
            6 * (k - a) * x + y - 2 / N * (1 - c) * u + (4 * k - 3 * a) / N * v,
            3 * N * k * x + c * u + 2 * k * v,
            -6 * N * (1 - c) * x - 2 * k * u + (4 * c - 3) * v,
        ),
        axis=-1,
    )


def switch_time(s: Array) -> Array:
    """When x has risen to SWITCH under K1 (n,), by halving; beyond END if it does not before."""
    low, high = np.zeros(len(s)), np.full(len(s), 2 * END)
    for _ in range(60):
        middle = (low + high) / 2
        below = driven(K1, s, middle[:, None])[:, 0, 0] < SWITCH
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return high


@dataclass(frozen=True)
class Trajectories:
    """n trajectories from s (n, 4) with aborts at these times (n,): the attempt begins at `tried`
    with the states s_tried, thrust ends at `off` with s_off; equal times: no such phase.
    """

    s: Array
    tried: Array
    off: Array
    s_tried: Array
    s_off: Array

    def at(self, t: Array) -> Array:
        """States (n, k, 4) at the times t (k,)."""
        tried, off = self.tried[:, None], self.off[:, None]
        far = driven(K1, self.s, np.minimum(t, tried))
        near = driven(K2, self.s_tried, np.clip(t - tried, 0, off - tried))
        free = drifting(self.s_off, np.maximum(t - off, 0))
        return np.where((t < off)[..., None], np.where((t < tried)[..., None], far, near), free)


def trajectories(s: Array, abort: float | Array) -> Trajectories:
    """From these starts (n, 4)."""
    off = np.minimum(np.broadcast_to(abort, len(s)), END)
    tried = np.minimum(switch_time(s), off)
    s_tried = driven(K1, s, tried[:, None])[:, 0]
    return Trajectories(s, tried, off, s_tried, driven(K2, s_tried, (off - tried)[:, None])[:, 0])


@dataclass(frozen=True)
class Margins:
    """Least margins (n,) of box, line of sight (distance to the cone) [m] and speed [m/min], and
    first entry into the box [min]; infinite: never.
    """

    box: Array
    corridor: Array
    speed: Array
    entry: Array


def outside(s: Array) -> Array:
    """Distance of (..., 4) to the box along its axes; negative inside."""
    return np.max(np.abs(s[..., :2]), axis=-1) - BOX


def inside_cone(s: Array) -> Array:
    """Distance to |y| = -x tan 30 deg."""
    return -s[..., 0] / 2 - np.abs(s[..., 1]) * np.sqrt(3) / 2


def slack(s: Array) -> Array:
    """Return the margin of the speed limit."""
    return SPEED - np.hypot(s[..., 2], s[..., 3])


def margins(f: Trajectories, *, samples: int = 6000) -> Margins:
    """From dense samples, closer together at the beginning of a phase where it is fastest. The box
    counts outside of the attempt.
    """
    share = np.linspace(0, 1, samples) ** 2
    attempt = driven(K2, f.s_tried, (f.off - f.tried)[:, None] * share)
    drift = (END - f.off)[:, None] * share
    clear = outside(drifting(f.s_off, drift))
    entry = (f.off[:, None] + drift)[np.arange(len(f.s)), np.argmax(clear < 0, axis=1)]
    approach = np.minimum(outside(f.s), outside(f.s_tried))  # it comes nearer all the way

    def during(kind: Array, value: Array) -> Array:
        return np.where(kind, value, np.inf)

    return Margins(
        np.minimum(approach, during(f.off < END, clear.min(1))),
        during(f.off > f.tried, inside_cone(attempt).min(1)),
        during(f.off > f.tried, slack(attempt).min(1)),
        during(clear.min(1) < 0, entry),
    )
