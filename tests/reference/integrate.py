# SPDX-License-Identifier: BSD-2-Clause
"""Two ways through the same right-hand side: a tight-tolerance truth and the fixed-step RK4 of the
models.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from math import floor

import numpy as np
from scipy.integrate import solve_ivp

from .attitude import Array

Rhs = Callable[[float, Array], Array]


def truth(f: Rhs, y: Array, t0: float, t1: float, atol: Array, max_step: float = 10.0) -> Array:
    """DOP853. With the step limit an orbit's local error is below rounding; rtol alone would allow
    1e-6 m per step.
    """
    solution = solve_ivp(
        f, (t0, t1), y, method="DOP853", rtol=1e-13, atol=atol, max_step=max_step, t_eval=[t1]
    )
    if not solution.success:
        raise ArithmeticError(solution.message)
    return solution.y[:, -1]


def rk4_step(f: Rhs, y: Array, t: float, h: float) -> Array:
    k1 = f(t, y)
    k2 = f(t + 0.5 * h, y + 0.5 * h * k1)
    k3 = f(t + 0.5 * h, y + 0.5 * h * k2)
    k4 = f(t + h, y + h * k3)
    return y + h / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)


def grid(t0: float, t1: float, max_step: float) -> Iterator[tuple[float, float]]:
    """Intervals between t0 and t1 that end on the absolute grid k max_step (or at t1)."""
    slack = 1e-9 * max_step
    t = t0
    while t < t1 - slack:
        nearest = (floor((t + slack) / max_step) + 1) * max_step
        end = nearest if nearest < t1 - slack else t1
        yield t, end
        t = end


def breakpoints(t0: float, t1: float, times: tuple[float, ...]) -> list[float]:
    """t0, the given times that lie strictly between, t1."""
    return [t0, *sorted({t for t in times if t0 < t < t1}), t1]


def joined(*parts: Array) -> Array:
    return np.concatenate([np.atleast_1d(np.asarray(part, dtype=float)) for part in parts])
