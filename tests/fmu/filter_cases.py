# SPDX-License-Identifier: BSD-2-Clause
"""Random parameters and states near the edges of all rules of safety_filter.fmu, and its answer."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
from scipy.spatial.transform import Rotation

from tests.reference import safety_filter as reference
from tests.reference.safety_filter import Inputs, Settings

MU, A = 3.986004415e14, 7.0e6
N = np.sqrt(MU / A**3)
OUTPUTS = ("F_safe_S", "mode", "active", "feasible", "relaxed", "barrier")
SMALL = Settings(
    F_max=(2, 1, 1),
    keep_out_radius=4,
    brake_keep_out=2.5e-3,
    brake_corridor=2.5e-3,
    use_corridor=1,
    corridor_half_angle=np.radians(20),
    corridor_length=10,
    use_speed_limit=1,
    speed_at_zero=0.05,
    speed_slope=0.0125,
    speed_max=0.12,
    sample_period=0.5,
)


def quaternion(rng):
    return np.roll(Rotation.random(random_state=rng).as_quat(), 1)


def settings(rng, **changes):
    """Return random parameters: every rule may be on, errors and delay may be there."""
    some = lambda value: value * float(rng.random() < 0.5)  # noqa: E731
    P = rng.choice((0.1, 0.5, 1.0))
    axis = rng.normal(size=3)
    drawn = {
        "mu": some(MU) or 0,
        "mass": rng.uniform(80, 120),
        "mass_error": some(rng.uniform(0, 0.3)),
        "F_max": tuple(rng.uniform(0.5, 2, 3)),
        "position_error": some(0.02),
        "velocity_error": some(0.002),
        "attitude_error": some(0.005),
        "rate_error": some(1e-4),
        "reaction": some(0.8),
        "keep_out_radius": some(4.0) or some(3.0),
        "keep_out_opens": some(1) * some(1),
        "use_corridor": float(rng.random() < 0.7),
        "corridor_half_angle": rng.uniform(0.1, 0.6),
        "corridor_axis": tuple(axis / np.linalg.norm(axis)),
        "corridor_apex": tuple(some(1) * rng.normal(size=3)),
        "corridor_length": some(10.0),
        "use_speed_limit": float(rng.random() < 0.7),
        "speed_at_zero": rng.uniform(0.07, 0.1),
        "speed_max": rng.choice((0.12, 1e9)),
        "plume_range": some(8.0),
        "plume_force": rng.uniform(0, 0.5),
        "dwell": some(2 * P),
        "sample_period": P,
    }
    drawn |= {"passive_time": some(600.0) if drawn["keep_out_radius"] else 0}
    drawn |= {"passive_points": int(rng.integers(2, 33))}
    return replace(Settings(), **(drawn | changes))


def inputs(rng, p, **changes):
    """Return a random state near the corridor of the parameters, and a command."""
    q_TN, spin = quaternion(rng), Rotation.random(random_state=rng).apply((0, 0, 0.01))
    C_TN = reference.dcm(q_TN)
    far = rng.uniform(0.9, 2) * (p.keep_out_radius or 4)
    side = rng.normal(size=3) * far * 0.3
    rho = C_TN.T @ (far * np.asarray(p.corridor_axis) + side)
    plane = Rotation.random(random_state=rng).as_matrix()
    r_T, v_T = A * plane[0], A * N * plane[1]
    v = rng.normal(size=3) * 0.05 + np.cross(C_TN.T @ spin, rho) * float(rng.random() < 0.7)
    drawn = {
        "r_TN_N": r_T,
        "v_TN_N": v_T,
        "q_TN": q_TN,
        "omega_TN_T": spin,
        "r_SN_N": r_T + rho,
        "v_SN_N": v_T + v,
        "q_SN": quaternion(rng),
        "omega_SN_S": rng.normal(size=3) * 0.02,
        "F_cmd_S": rng.normal(size=3) * rng.choice((0.1, 1, 10)),
        "approaching": float(rng.random() < 0.85),
    }
    return Inputs(**(drawn | changes))


def answers(fmu, p, cases):
    """Return the outputs of the FMU at consecutive samples, as dicts."""
    unit = fmu("safety_filter", asdict(p), vars(cases[0]))
    rows = []
    for case in cases:
        unit.step(p.sample_period, vars(case))
        rows.append({name: unit.get(name) for name in (*OUTPUTS, "intervention", "least_barrier")})
    return rows
