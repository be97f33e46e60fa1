# SPDX-License-Identifier: BSD-2-Clause
"""Situations of the controllers in line-of-sight (LOS) coordinates, made from the errors that they
are to see.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from ..reference import los
from ..reference.body import Body
from .cases import random_direction, random_orbit_state, random_rotation
from .theory import quaternion_of_dcm

REFERENCE = ("rho_ref_N", "drho_ref_N", "ddrho_ref_N", "q_DN", "omega_DN_D", "alpha_DN_D")
CONTROLLERS = ("ppc_controller", "pid_controller", "theta_d_controller")
IDENTITY = np.array((1.0, 0.0, 0.0, 0.0))
ZERO3 = np.zeros(3)


@dataclass(frozen=True)
class Scene:
    """Errors and their rates (range, elevation, azimuth) about a reference, rotation vector of
    q_SD, rates of both.
    """

    x1: np.ndarray = field(default_factory=lambda: np.zeros(3))
    x2: np.ndarray = field(default_factory=lambda: np.zeros(3))
    ref: np.ndarray = field(default_factory=lambda: np.array((100.0, 0.2, 0.5)))
    dref: np.ndarray = field(default_factory=lambda: np.zeros(3))
    ddrho_ref_N: np.ndarray = field(default_factory=lambda: np.zeros(3))
    turn: np.ndarray = field(default_factory=lambda: np.zeros(3))
    omega: np.ndarray = field(default_factory=lambda: np.zeros(3))
    omega_D: np.ndarray = field(default_factory=lambda: np.zeros(3))
    alpha_D: np.ndarray = field(default_factory=lambda: np.zeros(3))
    q_DN: np.ndarray = field(default_factory=lambda: IDENTITY)
    r_TN_N: np.ndarray = field(
        default_factory=lambda: np.zeros(3)
    )  # deep space, where nothing cancels
    v_TN_N: np.ndarray = field(default_factory=lambda: np.zeros(3))
    up_axis: int = 2

    def inputs(self) -> dict[str, np.ndarray]:
        """The same situation on the wires of a controller."""
        r, v = los.inertial(self.ref + self.x1, self.dref + self.x2, self.up_axis)
        r_ref, v_ref = los.inertial(self.ref, self.dref, self.up_axis)
        q_DN = Rotation.from_quat(np.roll(self.q_DN, -1))
        q_SN = q_DN * Rotation.from_rotvec(self.turn)
        return {
            "r_TN_N": self.r_TN_N,
            "v_TN_N": self.v_TN_N,
            "q_TN": IDENTITY,
            "omega_TN_T": ZERO3,
            "r_SN_N": self.r_TN_N - r,
            "v_SN_N": self.v_TN_N - v,
            "q_SN": np.roll(q_SN.as_quat(), 1),
            "omega_SN_S": self.omega,
            "wheel_speed": ZERO3,
            "rho_ref_N": -r_ref,
            "drho_ref_N": -v_ref,
            "ddrho_ref_N": self.ddrho_ref_N,
            "q_DN": self.q_DN,
            "omega_DN_D": self.omega_D,
            "alpha_DN_D": self.alpha_D,
        }


def random_scene(rng, up_axis=2, error=1.0) -> Scene:
    """Anything a controller may meet far from the poles; error 1: metres, tenths of a radian, tens
    of degrees.
    """
    r, v = random_orbit_state(rng)
    return Scene(
        x1=error * rng.normal(size=3) * (5.0, 0.05, 0.05),
        x2=error * rng.normal(size=3) * (0.5, 0.01, 0.01),
        ref=np.array((rng.uniform(15.0, 200.0), rng.uniform(-1.0, 1.0), rng.uniform(-3.1, 3.1))),
        dref=rng.normal(size=3) * (0.5, 0.01, 0.01),
        ddrho_ref_N=0.05 * rng.normal(size=3),
        turn=error * rng.uniform(0.1, 1.0) * random_direction(rng),
        omega=0.05 * rng.normal(size=3),
        omega_D=0.03 * rng.normal(size=3),
        alpha_D=0.003 * rng.normal(size=3),
        q_DN=quaternion_of_dcm(random_rotation(rng)),
        r_TN_N=r,
        v_TN_N=v,
        up_axis=up_axis,
    )


def bodies(u: Mapping[str, np.ndarray]) -> tuple[Body, Body]:
    return tuple(
        Body(u[f"r_{X}N_N"], u[f"v_{X}N_N"], u[f"q_{X}N"], u[f"omega_{X}N_{X}"]) for X in "TS"
    )


def reference_of(u: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    return {name: u[name] for name in REFERENCE}


def sample(unit, u, h=0.1):
    """Outputs after a step with these inputs; coordinates `e.range`, `e.elevation`, `e.azimuth` are
    the vector e.
    """
    unit.step(h, u)
    return gathered(unit.outputs())


def gathered(outputs):
    result = {}
    for name, value in outputs.items():
        base, dot, part = name.partition(".")
        if dot:
            result.setdefault(base, np.zeros(3))[("range", "elevation", "azimuth").index(part)] = (
                value
            )
        else:
            result[name] = value
    return result


SIZES = dict.fromkeys(Scene().inputs(), 3) | {"q_TN": 4, "q_SN": 4, "q_DN": 4}
ANY = st.floats(allow_nan=False, allow_infinity=False)
ANY_INPUTS = st.fixed_dictionaries(
    {n: st.lists(ANY, min_size=k, max_size=k) for n, k in SIZES.items()}
)
"""Every finite double on every wire."""
