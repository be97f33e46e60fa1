# SPDX-License-Identifier: BSD-2-Clause
"""optimal_problem.h against dense linear algebra and numerical projections; docs/models.md N."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from scipy.optimize import minimize

from tests.close import close
from tests.each import each

from ..reference import optimal

X = np.array([1.0, 0, 0])
SETTING = {"rho": (10, 1, 0), "most": (0.02, 0.01, 0.01), "end": (4, 0, 0)}
"""From 10 m and 1 m beside the axis to 4 m in 40 s, four nodes."""


def gains(core, nodes, speed_limit=0):
    out = np.zeros((nodes, 3))
    core.library.call_gains(nodes, speed_limit, out.ctypes.data_as(ctypes.c_void_p))
    return out


def iterations(core, count, nodes=4, T=40.0):
    """Accelerations, path and slab points [m] after some iterations from a cold start."""
    rho, end = (np.divide(SETTING[name], T * T) for name in ("rho", "end"))
    setting = np.array([*rho, *SETTING["most"], *end, 0.005 * 0.02, 0.15, 3.9 / T**2, 1e6 / T**2])
    out = np.zeros((nodes, 3, 3))
    pointer = ctypes.POINTER(ctypes.c_double)
    core.library.call_iterations(
        nodes, count, setting.ctypes.data_as(pointer), out.ctypes.data_as(pointer)
    )
    return out[:, 0], out[:, 1] * T * T, out[:, 2] * T * T


@pytest.mark.parametrize("speed_limit", [0, 1])
@pytest.mark.parametrize("nodes", [4, 60])
def test_the_recursion_solves_the_linear_system_of_an_iteration(core, rng, nodes, speed_limit):
    """Forward and backward sweep with the gains against (1 + weights Phi^T Phi ...) u = c."""
    Phi, Psi, H = optimal.matrices(nodes, bool(speed_limit))
    c, tp, tv = rng.normal(size=(3, nodes))
    K_p, K_v, R_inverse = gains(core, nodes, speed_limit).T
    h, q, sp, sv = 1 / nodes, np.zeros(nodes), 0.0, 0.0
    for k in reversed(range(nodes)):
        sp, sv = sp + tp[k], sv + tv[k]
        q[k] = c[k] + h * h / 2 * sp + h * sv
        sp, sv = sp - K_p[k] * q[k], sv - K_v[k] * q[k]
        sv += h * sp
    x = w = 0.0
    u = np.zeros(nodes)
    for k in range(nodes):
        x += h * w
        u[k] = q[k] * R_inverse[k] - K_p[k] * x - K_v[k] * w
        x, w = x + h * h / 2 * u[k], w + h * u[k]
    close(u, np.linalg.solve(H, c + Phi.T @ tp + Psi.T @ tv), rel=1e-10)


def test_gains_have_the_published_digits(core):
    """Values to ten digits, computed with dense matrices."""
    table = gains(core, 60)
    close(table[0], (29.05973735, 7.13929124, 0.87697574), rel=1e-9)
    close(table[58, :2], (196.28033592, 29.47562538), rel=1e-9)
    close(table[59], (7.68921545, 57.63069539, 0.03842046), rel=1e-9)
    close(gains(core, 60, 1)[0, :2], (28.60935376, 8.62478919), rel=1e-9)


def test_three_iterations_of_the_small_problem(core):
    """The first three iterates, which were computed independently with dense matrices."""
    u, p, slab = iterations(core, 1)
    close(u[:, 0], (0.002740936, -0.02, -0.02, 0.02), rel=1e-7)
    close(u[:, 1], (0.000373489, -0.004847325, -0.007405607, 0.01), rel=1e-7)
    close(p[:, 0], (10.08877924, 9.33871425, 6.25372452, 4.00654303), rel=1e-9)
    close(slab[:, 0], (10.14204678, 8.94194280, 4.00595923, 3.9), rel=1e-9)
    u, p, slab = iterations(core, 3)
    close(u[:, 1], (0, -0.003759608, -0.005199939, 0.006966151), rel=1e-7)
    close(p[:, 0], (8.92580232, 6.44363110, 4.51945300, 4.00267172), rel=1e-9)
    close(slab[:, 0], (8.68231574, 6.29327008, 3.96730144, 3.9), rel=1e-9)


def test_many_iterations_give_the_optimum_that_is_known_in_closed_form(core):
    """6 m in 30 s of coasting and 1 m in 30 s: 2 x 0.2 + 2/30 m/s."""
    u, _, _ = iterations(core, 2000)
    close(np.abs(u).sum() * 10, 0.4 + 2 / 30, rel=1e-5)


def test_projections_onto_cone_and_box_by_hand(core):
    close(core.onto_cone(X, 0.5, 0, (3, 4, 0)), (4, 2, 0), rel=1e-15)
    close(core.onto_cone(X, 0.5, 0.5, (3, 4, 0)), (3.8, 2.4, 0), rel=1e-15)
    assert np.all(core.onto_cone(X, 0.5, 0, (-3, 1, 0)) == 0)
    turned = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1.0]])
    found = core.box_projection((0.02, 0.01, 0.01), 1e-4, turned, (0.03, -0.004, 0.012))
    close(found, (0.01, -0.0039, 0.01), rel=1e-14)


def nearest(x, constraints, start):
    return minimize(
        lambda z: (z - x) @ (z - x), start, jac=lambda z: 2 * (z - x), method="SLSQP",
        constraints=constraints, options={"ftol": 1e-14, "maxiter": 200},
    ).x  # fmt: skip


@each("seed", range(3))
def test_projections_give_the_nearest_point_of_their_set(core, seed):
    """Against a numerical optimizer, which knows the sets as inequalities only."""
    rng = np.random.default_rng(seed)
    a, x = rng.normal(size=(2, 3))
    a, t, o = a / np.linalg.norm(a), rng.uniform(0.1, 1), rng.uniform(0, 0.5)

    def inside_cone(z):
        along = z @ a
        return t * along + o - np.sqrt((z - along * a) @ (z - along * a) + 1e-24)

    found = core.onto_cone(a, t, o, x)
    expected = nearest(x, {"type": "ineq", "fun": inside_cone}, a * 0.5)
    assert np.linalg.norm(found - x) <= np.linalg.norm(expected - x) * (1 + 1e-6) + 1e-7
    assert inside_cone(found) >= -1e-11
    low, high = np.sort(rng.normal(size=2))
    found = core.onto_slab(a, low, high, x)
    close(found, x + (np.clip(x @ a, low, high) - x @ a) * a, rel=1e-14)
    centre = rng.normal(size=3)
    found = core.onto_ball(centre, 0.5, x)
    close(found - centre, (x - centre) * min(1, 0.5 / np.linalg.norm(x - centre)), rel=1e-14)
