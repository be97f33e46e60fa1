# SPDX-License-Identifier: BSD-2-Clause
"""Random cases for the tests of the identities, and the two comparisons they use."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace as Case
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from . import attitude, guidance, orbit, paper_case
from .attitude import Array
from .body import Body
from .jet import Jet

MU: float = paper_case.ORBIT["mu"]
EXACT = 1e-13
"""About a hundred roundings of the largest term."""


def close(a: Any, b: Any, tolerance: float = EXACT, scale: float | None = None) -> bool:
    """|a - b| <= tolerance times the scale (default: the larger of both)."""
    size = max(np.max(np.abs(a)), np.max(np.abs(b))) if scale is None else scale
    return bool(np.max(np.abs(np.asarray(a) - b)) <= tolerance * size)


def complex_step(f: Callable[[Array], Any], x: Array, direction: Array) -> Any:
    """Directional derivative without cancellation: Im f(x + i h d) / h."""
    h = 1e-30
    return np.imag(f(x + 1j * h * direction)) / h


def quaternion(rng: np.random.Generator) -> Array:
    return Rotation.random(random_state=rng).as_quat(scalar_first=True)


def direction(rng: np.random.Generator) -> Array:
    return Rotation.random(random_state=rng).apply((0.0, 0.0, 1.0))


def positive_definite(rng: np.random.Generator, eigenvalues: Any) -> Array:
    R = Rotation.random(random_state=rng).as_matrix()
    return R @ np.diag(eigenvalues) @ R.T


def orbits(rng: np.random.Generator) -> Case:
    """Jets (N axes) of a target on an eccentric orbit and of a servicer near it that accelerates by
    a_F.
    """
    r, v = orbit.state_of_elements(MU, 7.4e6, rng.uniform(0, 0.1), *rng.uniform(0.1, 3.0, 4))
    rS, vS = r + 200 * rng.normal(size=3), v + rng.normal(size=3)
    a_F = 0.01 * rng.normal(size=3)
    T = Jet(r, v, orbit.central_gravity(r, MU))
    S = Jet(rS, vS, orbit.central_gravity(rS, MU) + a_F)
    r_t = np.linalg.norm(r)
    th = np.linalg.norm(np.cross(r, v)) / r_t**2
    thd = -2 * (r @ v) / r_t**2 * th
    return Case(T=T, S=S, C_HN=orbit.hill_frame(r, v, MU), a_F=a_F, r_t=r_t, th=th, thd=thd)


def tumbling(rng: np.random.Generator) -> Case:
    """An orbit with a target of random attitude, rate, inertia and grasp axis; T is what the
    printed formulas need.
    """
    c = orbits(rng)
    p = guidance.Parameters(J_T=positive_definite(rng, (100, 150, 90)), p_T=direction(rng))
    body = Body(c.T.x, c.T.d, quaternion(rng), 0.02 * rng.normal(size=3))
    C_TN = attitude.dcm(body.q)
    w_H, w_H_dot = np.array((0, 0, c.th)), np.array((0, 0, c.thd))
    C_BH, r_B = c.C_HN.x @ C_TN.T, C_TN @ body.r
    T = Case(
        omega=body.omega, J=p.J_T, r_B=r_B, C_BH=C_BH, p_t=p.p_T, w_H=w_H, w_H_dot=w_H_dot, mu=MU
    )
    t = rng.uniform(0, 300)
    return Case(
        t=t, T=T, body=body, p=p, C_HN=c.C_HN, C_HT=c.C_HN @ guidance.target_frame(t, body, p)
    )
