# SPDX-License-Identifier: BSD-2-Clause
"""Four run-time assurance filters of Dunlap, Hibbard, Mote & Hobbs 2022 (the numbers of their
example: 12 kg, 1 N, speed limit 0.2 m/s + 4 n R), written anew, beside safety_filter, with a force
that is held for 1 s on the exact motion.

    python -m tests.reference.published_filters 60

runs 60 starts per filter and prints runs above the limit, the worst excess, interventions, impulse.

The filters differ in what they monitor (explicit: the next state; implicit: a backup course) and in
what they do (switching: another force; optimisation: the nearest force). The backup is the natural
motion through the present place, v = (n y/2, -2 n x, 0), towards which a velocity gain steers. The
condition of the optimising filters is the published one, at the sample: dh/dt >= -(0.05 h + 0.1
h^3).
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
from numpy.linalg import norm
from scipy.linalg import expm

from . import safety_filter as ours

N, MASS, F_MAX, P = 0.001027, 12.0, 1.0, 1.0
V_0, K, V_MAX = 0.2, 4 * 0.001027, 10.0
HORIZON, GAIN = 5, 0.05
"""Steps of the backup course; gain of its velocity [1/s]."""
A = np.zeros((6, 6))
A[:3, 3:] = np.eye(3)
A[3, 0], A[3, 4], A[4, 3], A[5, 2] = 3 * N * N, 2 * N, -2 * N, -N * N
B = np.vstack((np.zeros((3, 3)), np.eye(3) / MASS))
POINTS = 8
"""Points of a hold at which the speed is compared with its limit."""


def held(step: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the exact transition over a step with the force held."""
    whole = expm(np.block([[A, B], [np.zeros((3, 9))]]) * step)
    return whole[:6, :6], whole[:6, 6:]


EXACT, PART = held(P), held(P / POINTS)
Force = np.ndarray
Filter = Callable[[np.ndarray, Force], Force]


def margin(x: np.ndarray) -> float:
    """Return the speed that is left below the limit [m/s]."""
    return min(V_0 + K * norm(x[:3]), V_MAX) - norm(x[3:])


def gradient(x: np.ndarray) -> np.ndarray:
    """Return the gradient of the margin."""
    out, ahead = x[:3] / norm(x[:3]), x[3:] / max(norm(x[3:]), 1e-12)
    return np.concatenate((K * out, -ahead))


def clipped(u: Force) -> Force:
    return np.clip(u, -F_MAX, F_MAX)


# ---- the four kinds ----
def backup(x: np.ndarray) -> Force:
    """Return the force towards the natural motion through the place."""
    natural = np.array((N * x[1] / 2, -2 * N * x[0], 0))
    return clipped(MASS * GAIN * 4 * (natural - x[3:]))


def explicit_switching(x: np.ndarray, u: Force) -> Force:
    """Pass u if the next state is safe, else the force that ends on the limit."""
    ahead = EXACT[0] @ x + EXACT[1] @ u
    if margin(ahead) >= 0:
        return clipped(u)
    speed = ahead[3:] * (V_0 + K * norm(ahead[:3])) / norm(ahead[3:])
    return clipped(MASS * ((speed - x[3:]) / P - A[3:] @ x))


def course(x: np.ndarray) -> list[np.ndarray]:
    """Return the backup course, the present state first."""
    found = [x]
    for _ in range(HORIZON):
        found.append(EXACT[0] @ found[-1] + EXACT[1] @ backup(found[-1]))
    return found


def implicit_switching(x: np.ndarray, u: Force) -> Force:
    """Pass u if every state of the backup course after it is safe, else the backup."""
    ahead = course(EXACT[0] @ x + EXACT[1] @ u)
    return clipped(u) if all(margin(s) >= 0 for s in ahead) else backup(x)


def nearest_force(rows: list[ours.Row], u: Force) -> Force:
    box = list(ours.box_rows(ours.Settings(F_max=(F_MAX,) * 3)))
    program = ours.Program(ours.Settings(F_max=(F_MAX,) * 3), box + rows, u)
    return program.solve()


def barrier_row(h: float, slope: np.ndarray, drift: float) -> ours.Row:
    """Return the row slope.u + drift >= -(0.05 h + 0.1 h^3)."""
    size = max(norm(slope), 1e-12)
    return ours.Row(ours.SPEED, slope / size, (-(0.05 * h + 0.1 * h**3) - drift) / size)


def explicit_optimisation(x: np.ndarray, u: Force) -> Force:
    g = gradient(x)
    return nearest_force([barrier_row(margin(x), g @ B, g @ A @ x)], u)


def implicit_optimisation(x: np.ndarray, u: Force) -> Force:
    """The condition along the backup course, with its sensitivity to the present state."""
    rows, S, gain = [], np.eye(6), np.zeros((3, 6))
    gain[:, 3:] = -4 * MASS * GAIN * np.eye(3)
    gain[0, 1], gain[1, 0] = 4 * MASS * GAIN * N / 2, -4 * MASS * GAIN * 2 * N
    for state in course(x):
        g = gradient(state) @ S
        rows.append(barrier_row(margin(state), g @ B, g @ A @ x))
        free = np.all(np.abs(backup(state)) < F_MAX)
        S = (EXACT[0] + EXACT[1] @ gain * free) @ S
    return nearest_force(rows, u)


# ---- safety_filter ----
MU = 3.986004415e14
RADIUS = (MU / N**2) ** (1 / 3)
SETTINGS = ours.Settings(
    mu=MU, mass=MASS, mass_error=0, F_max=(F_MAX,) * 3, keep_out_radius=0, use_speed_limit=1,
    speed_at_zero=V_0, speed_slope=K, speed_max=V_MAX, sample_period=P,
)  # fmt: skip


def safety_filter(x: np.ndarray, u: Force) -> Force:
    """The least change, with H as the inertial axes of this instant."""
    w, q = np.array((0, 0, N)), np.array((1.0, 0, 0, 0))
    r, v = np.array((RADIUS, 0, 0)), np.array((0, N * RADIUS, 0))
    inputs = ours.Inputs(r, v, q, np.zeros(3), r + x[:3], v + x[3:] + np.cross(w, x[:3]), q, w, u)
    return ours.filtered(SETTINGS, inputs, P).F_safe_S


FILTERS: dict[str, Filter] = {
    "none": lambda x, u: clipped(u),
    "explicit switching": explicit_switching,
    "implicit switching": implicit_switching,
    "explicit optimisation": explicit_optimisation,
    "implicit optimisation": implicit_optimisation,
    "safety_filter, least change": safety_filter,
}


# ---- runs ----
def policy(kind: int, x: np.ndarray, last: Force, rng: np.random.Generator) -> Force:
    if kind == 0:
        return rng.uniform(-2, 2, 3) * F_MAX
    if kind == 1:
        return last if norm(last) and rng.random() < 0.9 else rng.choice((-1.0, 1.0), 3)
    if kind == 2:
        return -2 * F_MAX * x[:3] / norm(x[:3])
    return 2 * F_MAX * x[3:] / max(norm(x[3:]), 1e-9)


def simulate(rule: Filter, seed: int, steps: int = 300) -> dict[str, float]:
    """Return least margin, share of changed samples, impulses of one run."""
    rng = np.random.default_rng([9, seed])
    direction = rng.normal(size=3)
    x = np.concatenate((direction / norm(direction) * rng.uniform(20, 300), np.zeros(3)))
    x[3:] = rng.normal(size=3) * 0.03
    u, least, changed, passed, change = np.zeros(3), np.inf, 0, 0.0, 0.0
    for _ in range(steps):
        u = policy(seed % 4, x, u, rng)
        safe = rule(x, u)
        changed += norm(safe - u) > 1e-9
        change += norm(safe - u) * P
        passed += norm(safe) * P
        for _part in range(POINTS):
            x = PART[0] @ x + PART[1] @ safe
            least = min(least, margin(x))
        if norm(x[:3]) < 1:
            break
    return {"least": least, "changed": changed / steps, "passed": passed, "change": change}


def table(count: int) -> dict[str, dict[str, float]]:
    """Return for each filter: runs above the limit, worst margin [m/s], means per run."""
    found = {}
    for name, rule in FILTERS.items():
        runs = [simulate(rule, seed) for seed in range(count)]
        least = np.array([r["least"] for r in runs])
        found[name] = {
            "violated": int(np.sum(least < 0)),
            "least": float(least.min()),
            "changed": float(100 * np.mean([r["changed"] for r in runs])),
            "passed": float(np.mean([r["passed"] for r in runs])),
            "change": float(np.mean([r["change"] for r in runs])),
        }
    return found


def main(count: int) -> None:
    """Print the table."""
    for name, row in table(count).items():
        print(
            f"| {name} | {row['violated']} of {count} | {row['least']:.3g} "
            f"| {row['changed']:.1f} | {row['passed']:.0f} | {row['change']:.0f} |"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]))
