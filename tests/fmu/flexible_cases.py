# SPDX-License-Identifier: BSD-2-Clause
"""Flexible servicers for the tests: random ones of four panels and four slosh masses, and parts of
the default one.
"""

from __future__ import annotations

import numpy as np

from .cases import DEEP_SPACE, random_direction, random_inertia

FULL = {"J_S": np.diag([900.0, 800.0, 700.0]), "mass_0": 180.0}
"""Enough for everything that random_parts hangs on it."""

NO_PANELS = {"panel_mass": np.zeros(4)}
NO_SLOSH = {"slosh_mass_0": np.zeros(4)}
UNDAMPED = {"panel_damping_ratio": np.zeros(4), "slosh_damping_ratio": np.zeros(4)}


DEFAULT = {
    "mass_0": 100.0,
    "J_S": np.diag([200.0, 250.0, 150.0]),
    "panel_mass": (8.0, 8.0, 0.0, 0.0),
    "panel_hinge_S": ((0, 0.5, 0), (0, -0.5, 0), (0, 0.5, 0), (0, -0.5, 0)),
    "panel_arm_S": ((0, 0.75, 0), (0, -0.75, 0), (0, 0.75, 0), (0, -0.75, 0)),
    "panel_inertia": ((0.43, 1.31, 1.73),) * 4,
    "slosh_mass_0": (3.0, 3.0, 0.0, 0.0),
    "slosh_position_S": ((0, 0, 0.25), (0, 0, -0.25), (0, 0, 0), (0, 0, 0)),
    "slosh_axis_S": ((1, 0, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0)),
    "slosh_frequency": np.full(4, 0.3141592653589793),
}
"""The vehicle of the specification; hinge axes z equal the reference's."""


def random_parts(rng):
    """Four panels and four slosh masses that have nothing in common."""
    axes = np.array([random_direction(rng) for _ in range(4)])
    arms = np.array([np.cross(a, random_direction(rng)) for a in axes])
    panels = {
        "panel_mass": rng.uniform(2, 8, 4),
        "panel_hinge_S": rng.uniform(-0.5, 0.5, (4, 3)),
        "panel_arm_S": arms / np.linalg.norm(arms, axis=1)[:, None] * rng.uniform(0.3, 0.9, (4, 1)),
        "panel_axis_S": axes * rng.uniform(0.5, 2, (4, 1)),
        "panel_inertia": np.array([np.diag(random_inertia(rng, 0.5, 2)) for _ in range(4)]),
        "panel_frequency": rng.uniform(0.5, 3, 4),
        "panel_damping_ratio": rng.uniform(0, 0.1, 4),
        "panel_angle_0": rng.uniform(-1, 1, 4),
        "panel_rate_0": rng.uniform(-0.5, 0.5, 4),
    }
    return panels | {
        "slosh_mass_0": rng.uniform(1, 5, 4),
        "slosh_position_S": rng.uniform(-0.4, 0.4, (4, 3)),
        "slosh_axis_S": rng.normal(size=(4, 3)),
        "slosh_frequency": rng.uniform(0.3, 3, 4),
        "slosh_damping_ratio": rng.uniform(0, 0.1, 4),
        "slosh_displacement_0": rng.uniform(-0.2, 0.2, 4),
        "slosh_rate_0": rng.uniform(-0.2, 0.2, 4),
        "slosh_draw": rng.uniform(0, 0.25, 4),
    }


def random_vehicle(rng, rate=0.5):
    """A tumbling vehicle of four panels and four slosh masses in deep space, full inertias."""
    J = FULL["J_S"] + random_inertia(rng, 20, 60)
    motion = {
        "sigma_SN_0": rng.uniform(-0.4, 0.4, 3),
        "omega_SN_S_0": rate * random_direction(rng),
        "wheel_speed_0": rng.normal(size=3),
    }
    return (
        DEEP_SPACE
        | {"J_S": J, "A_w": random_inertia(rng, 2, 12), "mass_0": FULL["mass_0"]}
        | motion
        | random_parts(rng)
    )


SMALL_PLANET = {
    "mu": 1e11,
    "a": 0,
    "r_0_N": (8e3, 5e3, -3e3),
    "v_0_N": (1.0, -2.0, 3.0),
    "use_J2": 0,
}
"""Tides of g = 0.1 1/s2."""
