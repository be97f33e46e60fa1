# SPDX-License-Identifier: BSD-2-Clause
"""Convex problems whose optimum is the least impulse of an approach (`harness bound`).

Every constraint is linear or a second-order cone, with data from the run: path and attitude of the
target, attitude of the servicer with its thrusters. A requirement that is not convex is replaced by
a stricter convex one.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from harness.results.histories import turned
from harness.results.result import Array, Result, Rows

from .convex import Cone, Problem
from .least_impulse import Bound

BODIES = ("target.r_TN_N", "target.v_TN_N", "target.q_TN", "target.omega_TN_T",
          "servicer.r_SN_N", "servicer.v_SN_N", "servicer.q_SN", "servicer.mass")  # fmt: skip
IMPULSE = "propulsion.impulse"
EYE = np.eye(3)
Mask = NDArray[np.bool_]


def bound(
    needs: tuple[str, ...],
    parameters: tuple[str, ...],
    stated: Callable[[Result, float], Problem],
    grid: float = 2.0,
) -> Bound:
    """Return the Bound of an approach with ideal propulsion: the definition of its least impulse.

    needs: variables of the problem besides BODIES and IMPULSE; parameters: parameters of the
    problem; stated: function of a result and a time step [s] that returns the convex problem of the
    run; grid: default time step [s].
    """
    return Bound(
        (*BODIES, IMPULSE, *needs),
        parameters,
        stated,
        (BODIES[4], BODIES[0]),
        BODIES[6],
        "propulsion.F_S",
        IMPULSE,
        (("propulsion.M_S", "controller.M_cmd_S"),),
        grid,
    )


def at(result: Result, name: str, time: Array) -> Array:
    """Return a variable at instants (n,), interpolated linearly between rows: (n,) for a scalar,
    (n, k) for a vector.
    """
    values = np.asarray(result[name], dtype=np.float64)
    columns = [np.interp(time, result.time, column) for column in values.reshape(len(values), -1).T]
    return np.stack(columns, axis=1).reshape(len(time), *values.shape[1:])


def quaternions(result: Result, name: str, time: Array) -> Array:
    """Return an attitude at instants as unit quaternions (n, 4), interpolated linearly between
    rows. This is accurate because rows are close and the sign of a quaternion does not jump within
    a run.
    """
    found = at(result, name, time)
    return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])


def axes(q: Array) -> Array:
    """Return the matrices C_NB (n, 3, 3) of attitude quaternions (n, 4)."""
    return np.stack([turned(q, np.broadcast_to(e, (len(q), 3))) for e in EYE], axis=2)


def gradient(result: Result, r: Array) -> Array:
    """Return the gradient (n, 3, 3) [1/s2] of the gravity of the plants (point mass and J2) at
    positions r (n, 3), by central differences with steps of 1 m. Their error is far below the
    error of the linearized motion.
    """
    mu, R, J2 = (float(result.parameter(f"target.{name}")) for name in ("mu", "R_E", "J2"))
    J2 *= float(result.parameter("target.use_J2"))

    def gravity(x: Array) -> Array:
        if mu == 0:
            return np.zeros_like(x)
        rr = np.sum(x * x, axis=1)[:, None]
        zz, j = 5 * x[:, 2:] ** 2 / rr, 1.5 * J2 * R * R / rr
        return np.asarray(-mu / rr**1.5 * x * (1 + j * (np.array([1, 1, 3]) - zz)))

    return np.stack([(gravity(r + e) - gravity(r - e)) / 2 for e in EYE], axis=2)


def hill(r: Array, v: Array) -> tuple[Array, Array]:
    """Return the matrices C_NH (n, 3, 3) of the Hill frames at positions r and velocities v, and
    their angular velocity in N axes (n, 3) [rad/s].
    """
    h = np.cross(r, v)
    x, z = (a / np.linalg.norm(a, axis=1)[:, None] for a in (r, h))
    return np.stack([x, np.cross(z, x), z], axis=2), h / np.sum(r * r, axis=1)[:, None]


def disturbance(result: Result, time: Array, hill_axes: Array) -> Array:
    """Return the acceleration of the servicer relative to the target at instants `time` (n,) by the
    parameters `a_dist` of both bodies and `a_manoeuvre_N` of the target, in N axes (n, 3) [m/s2];
    hill_axes: matrices C_NH (n, 3, 3).
    """
    servicer, target = (_in_n(result, body, time, hill_axes) for body in ("servicer", "target"))
    return servicer - target - _sinusoid(result, "target.a_manoeuvre_N", time)


def _in_n(result: Result, body: str, time: Array, hill_axes: Array) -> Array:
    """Return the acceleration by `a_dist` of a body, N axes (n, 3) [m/s2]."""
    found = _sinusoid(result, f"{body}.a_dist", time)
    if result.parameter(f"{body}.a_dist_axes") == 1:
        found = np.einsum("nij,nj->ni", hill_axes, found)
    return found


def _sinusoid(result: Result, name: str, time: Array) -> Array:
    """Return bias + amplitude sin(frequency t + phase), zero before `start`, of the parameters that
    begin with `name`, (n, 3).
    """
    bias, amplitude, frequency, phase, start = (
        result.parameter(f"{name}.{part}")
        for part in ("bias", "amplitude", "frequency", "phase", "start")
    )
    wave = bias + amplitude * np.sin(frequency * time[:, None] + phase)
    return np.asarray(np.where(time[:, None] >= start, wave, 0.0))


def problem(result: Result, step: float, box: Array) -> Problem:
    """Return the convex problem of the least impulse in the time span of a run, without constraints
    on the path. Start, mass (of the first row), attitude of the servicer, gravity gradient along
    the path of the target, disturbances and the manoeuvre of the target are those in the run.

    step: time step [s]; box: largest force along each axis of the servicer [N], 0: unlimited.
    """
    count = max(round((result.time[-1] - result.time[0]) / step), 1)
    time = np.linspace(result.time[0], result.time[-1], count + 1)
    middle = 0.5 * (time[1:] + time[:-1])
    r, v = at(result, BODIES[0], middle), at(result, BODIES[1], middle)
    start = [result[BODIES[4 + k]][0] - result[BODIES[k]][0] for k in (0, 1)]
    return Problem(
        time,
        np.hstack(start),
        gradient(result, r),
        disturbance(result, middle, hill(r, v)[0]),
        axes(quaternions(result, BODIES[6], middle)),
        float(result[BODIES[7]][0]),
        np.where(box > 0, box, np.inf),
    )


# ---- constraints on the position rho from the target, at the grid points where `mask` is true.
# The time grid of the problem has n + 1 points; name: name of the constraint.


def _part(mask: Mask, *arrays: Array) -> tuple[Rows, list[Array]]:
    nodes = np.flatnonzero(mask)
    return nodes, [array[nodes] for array in arrays]


def about(name: str, mask: Mask, axis: Array, half_angle: float) -> Cone:
    """Return the constraint that rho is inside the cone with its apex at the target; axis: unit
    vectors (n + 1, 3); half_angle: [rad].
    """
    nodes, (a,) = _part(mask, axis)
    across = EYE - a[:, :, None] * a[:, None, :]
    zero = np.zeros(len(nodes))
    matrices = across, 0 * across
    return Cone(name, nodes, *matrices, 0 * a, np.tan(half_angle) * a, zero)


def beyond(name: str, mask: Mask, axis: Array, least: float) -> Cone:
    """Return the constraint axis . rho >= least: rho is beyond the plane that touches the keep-out
    sphere with radius `least` [m]; axis: unit vectors (n + 1, 3).
    """
    nodes, (a,) = _part(mask, axis)
    none = np.zeros((len(nodes), 0, 3))
    return Cone(name, nodes, none, none, none[:, :, 0], a, np.full(len(nodes), -least))


def within(name: str, mask: Mask, centre: Array, radius: float) -> Cone:
    """Return the constraint |rho - centre| <= radius; centre: (n + 1, 3) [m]."""
    nodes, (c,) = _part(mask, centre)
    matrix = np.broadcast_to(EYE, (len(nodes), 3, 3))
    limit = np.full(len(nodes), radius)
    return Cone(name, nodes, matrix, 0 * matrix, -c, 0 * c, limit)


def beside(name: str, mask: Mask, axis: Array, most: float) -> Cone:
    """Return the constraint that rho is at most `most` [m] from the axis through the target; axis:
    unit vectors (n + 1, 3).
    """
    nodes, (a,) = _part(mask, axis)
    across = EYE - a[:, :, None] * a[:, None, :]
    limit = np.full(len(nodes), most)
    return Cone(name, nodes, across, 0 * across, 0 * a, 0 * a, limit)


def between(name: str, mask: Mask, axis: Array, least: float, most: float) -> Cone:
    """Return the constraint least <= axis . rho <= most [m]; axis: unit vectors (n + 1, 3)."""
    nodes, (a,) = _part(mask, axis)
    middle, half = (
        np.full((len(nodes), 1), (least + most) / 2),
        np.full(len(nodes), (most - least) / 2),
    )
    along = a[:, None, :]
    return Cone(name, nodes, along, 0 * along, -middle, 0 * a, half)


def target_axis(result: Result, time: Array, axis: Array) -> Array:
    """Return the directions in N axes (n, 3), at instants `time` (n,), of the vector `axis` (3,),
    which is fixed in the target and given in target axes.
    """
    return np.asarray(axes(quaternions(result, BODIES[2], time)) @ axis)
