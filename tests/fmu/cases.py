# SPDX-License-Identifier: BSD-2-Clause
"""Random and standard cases for the tests of single FMUs."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from .theory import MU, dcm_of_quaternion, quaternion_of_dcm

ELEMENTS = {"a": 7158140.0, "e": 0.01, "inc": 0.5, "argp": 1.0, "raan": 2.0, "nu": 0.6}
DEEP_SPACE = {"a": 0, "mu": 0}


def random_rotation(rng):
    return Rotation.random(random_state=rng).as_matrix()


def random_direction(rng):
    d = rng.normal(size=3)
    return d / np.linalg.norm(d)


def random_inertia(rng, low=50, high=300):
    """Symmetric inertia that a body can have: principal moments b+c, a+c, a+b with positive a, b,
    c.
    """
    E = rng.uniform(low / 2, high / 2, 3)
    R = random_rotation(rng)
    J = R @ np.diag(E.sum() - E) @ R.T
    return (J + J.T) / 2


def spinning_servicer(rng, rate=0.02):
    """A tumbling servicer in deep space with running wheels; both inertia matrices full."""
    A = random_inertia(rng, 2, 12)
    start = {"sigma_SN_0": rng.uniform(-0.4, 0.4, 3), "omega_SN_S_0": rate * random_direction(rng)}
    return (
        DEEP_SPACE
        | start
        | {"J_S": A + random_inertia(rng), "A_w": A, "wheel_speed_0": rng.normal(size=3)}
    )


def random_wave(rng, size, start=0.0):
    """Record of a sinusoidal disturbance, another one on each axis."""
    return {
        "bias": rng.normal(size=3) * size,
        "amplitude": rng.normal(size=3) * size,
        "frequency": rng.uniform(0.02, 0.2, 3),
        "phase": rng.uniform(-3, 3, 3),
        "start": start,
    }


def wave(record, t):
    w = {"bias": 0.0, "amplitude": 0.0, "frequency": 0.0, "phase": 0.0, "start": 0.0} | record
    on = np.array(w["bias"]) + np.array(w["amplitude"]) * np.sin(
        np.array(w["frequency"]) * t + np.array(w["phase"])
    )
    return on if t >= w["start"] else np.zeros(3)


def integral_of_wave(record, t):
    """Of bias + amplitude sin(frequency t + phase) from its start to t: once and twice."""
    b, A, f, p, s = (
        np.array(record[k]) for k in ("bias", "amplitude", "frequency", "phase", "start")
    )
    tau = t - s
    once = b * tau + A / f * (np.cos(f * s + p) - np.cos(f * t + p))
    twice = b * tau**2 / 2 + A / f * (
        np.cos(f * s + p) * tau - (np.sin(f * t + p) - np.sin(f * s + p)) / f
    )
    return once, twice


def random_orbit_state(rng, mu=MU):
    """Position and velocity somewhere on a low orbit of eccentricity up to 0.2 or so, N axes."""
    r, recording = 7e6 * random_direction(rng), random_direction(rng)
    across = np.cross(np.cross(r, recording), r)
    across /= np.linalg.norm(across)
    speed = np.sqrt(mu / 7e6)
    return r, speed * (rng.uniform(0.95, 1.05) * across + rng.uniform(-0.1, 0.1) * r / 7e6)


def random_bodies(rng, distance=20.0, rate=0.02):
    """Body states of target and servicer as they are on the wires."""
    r, v = random_orbit_state(rng)
    states = {"r_TN_N": r, "v_TN_N": v}
    states |= {
        "r_SN_N": r + distance * rng.normal(size=3),
        "v_SN_N": v + 0.01 * distance * rng.normal(size=3),
    }
    for body in "TS":
        states[f"q_{body}N"] = quaternion_of_dcm(random_rotation(rng))
        states[f"omega_{body}N_{body}"] = rate * rng.normal(size=3)
    return states


def turned(states, R):
    """The same situation with everything given in N axes turned by the rotation matrix R."""

    def turn(name, value):
        if name.startswith("q_"):
            return quaternion_of_dcm(dcm_of_quaternion(value) @ R.T)
        return R @ value if name.endswith("_N") else value

    return {name: turn(name, value) for name, value in states.items()}
