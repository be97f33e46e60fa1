# SPDX-License-Identifier: BSD-2-Clause
"""Factors: what differs between the runs of a campaign, and how numbers between 0 and 1 become a
value of it.

Every draw is the inverse of a distribution function, so that random, Latin hypercube and Sobol
numbers serve all factors alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.spelling import did_you_mean

Array = NDArray[np.float64]

SMALLEST = 2.0**-53
"""Numbers between 0 and 1 are kept this far from both ends, where a normal draw is infinite."""

MAX_VALUES = 1_000_000
"""Listed values of one factor."""


class Draw(NamedTuple):
    """So many numbers between 0 and 1 become one value."""

    numbers: int
    value: Callable[[Array], Any]


@dataclass(frozen=True)
class Factor:
    """One thing that varies: values to go through, or a draw.

    name: `component.parameter`, or a change: `swap.C`, `latency.C`, `params`, `algorithm`, `step`,
    `stop`.
    """

    name: str
    choices: tuple[Any, ...] = ()
    draw: Draw | None = None


def factor(name: str, table: Any) -> Factor:
    """A factor from its table, e.g. {normal = {mean = 1.0, sigma = 0.1}}; ValueError with what is
    wrong with it.
    """
    if not isinstance(table, Mapping) or len(table) != 1:
        raise ValueError(f"expected one of {', '.join((*CHOICES, *DRAWS))}")
    (kind, given), *_ = table.items()
    if kind in CHOICES:
        if not (choices := tuple(CHOICES[kind](given))):
            raise ValueError(f"{kind}: is empty")
        return Factor(name, choices)
    if kind not in DRAWS:
        raise ValueError(f"there is no {kind}{did_you_mean(kind, (*CHOICES, *DRAWS))}")
    if not isinstance(given, Mapping):
        raise ValueError(f"{kind}: expected a table of numbers")
    try:
        return Factor(name, draw=DRAWS[kind](**given))
    except TypeError as error:  # Python's words name the argument
        raise ValueError(f"{kind}: {str(error).partition('() ')[2]}") from error
    except ValueError as error:
        raise ValueError(f"{kind}: {error}") from error


# ---- values to go through


def _list(given: Any) -> Sequence[Any]:
    if not isinstance(given, Sequence) or isinstance(given, str):
        raise ValueError("list: expected values in brackets")
    return given


def _range(given: Any) -> Sequence[float]:
    wanted = {"first", "last", "count"}
    if not isinstance(given, Mapping) or given.keys() != wanted:
        raise ValueError("range: expected first, last and count")
    if not isinstance(given["count"], int) or given["count"] < 0:
        raise ValueError(f"range: count must be a whole number, not {given['count']}")
    if given["count"] > MAX_VALUES:
        raise ValueError(f"range: count must be at most {MAX_VALUES}")
    first, last = _two([given["first"], given["last"]], "range: first and last")
    return [float(x) for x in np.linspace(first, last, given["count"])]


CHOICES: dict[str, Callable[[Any], Sequence[Any]]] = {"list": _list, "range": _range}

# ---- numbers for all draws of a campaign, and the seeds of its runs


def normal_quantile(p: Array) -> Array:
    """Quantile of the normal distribution: Phi(z) = p."""
    from scipy.special import ndtri

    return np.asarray(ndtri(p))


def _normal(
    mean: Any, sigma: Any = None, covariance: Any = None, within: Sequence[float] | None = None
) -> Draw:
    """Normal: independent elements of deviation sigma, cut to `within`, or of a covariance."""
    if (sigma is None) == (covariance is None):
        raise ValueError("expected either sigma or covariance")
    if covariance is not None:
        return _correlated(mean, covariance, within)
    m, s = _vectors(mean, sigma)
    _demand(s > 0, "sigma", "must be positive", sigma)
    low, high = (0.0, 1.0) if within is None else _probabilities(m, s, within)
    return Draw(
        m.size, lambda u: _shaped(m + s * normal_quantile(low + u * (high - low)), mean, sigma)
    )


def _probabilities(m: Array, s: Array, within: Sequence[float]) -> tuple[Any, Any]:
    """Values of the distribution function at both ends of the truncation."""
    from scipy.special import ndtr

    lowest, highest = _two(within, "within")
    if not lowest < highest:
        raise ValueError(f"within: expected the smaller number first, got {list(within)}")
    return ndtr((lowest - m) / s), ndtr((highest - m) / s)


def _correlated(mean: Any, covariance: Any, within: Any) -> Draw:
    """Correlated normal: x = mean + L z, L L^T = covariance."""
    if within is not None:
        raise ValueError("a covariance cannot be cut to within")
    m, c = _numbers(mean, "mean"), _numbers(covariance, "covariance")
    if m.ndim != 1 or c.shape != (m.size, m.size):
        raise ValueError(f"covariance must be {m.size} x {m.size}")
    if not np.array_equal(c, c.T):
        raise ValueError("covariance must be symmetric")
    try:
        factor_l = np.linalg.cholesky(c)
    except np.linalg.LinAlgError as error:
        raise ValueError("covariance must be positive definite") from error
    return Draw(m.size, lambda u: (m + factor_l @ normal_quantile(u)).tolist())


def _log_normal(median: Any, sigma: Any) -> Draw:
    """Log-normal: x = median exp(sigma z)."""
    m, s = _vectors(median, sigma)
    _demand(s > 0, "sigma", "must be positive", sigma)
    _demand(m > 0, "median", "must be positive", median)
    return Draw(m.size, lambda u: _shaped(m * np.exp(s * normal_quantile(u)), median, sigma))


def _uniform(low: Any, high: Any) -> Draw:
    a, b = _vectors(low, high)
    _demand(a < b, "low", "must be smaller than high", low)
    return Draw(a.size, lambda u: _shaped(a + u * (b - a), low, high))


def _rotation(sigma: Any, attitude: Sequence[float] | None = None) -> Draw:
    """Rotation vector phi = sigma z [rad]; with an attitude q the quaternion q * exp(phi / 2)."""
    s = np.broadcast_to(_numbers(sigma, "sigma"), 3)
    _demand(s > 0, "sigma", "must be positive", sigma)
    if attitude is None:
        return Draw(3, lambda u: (s * normal_quantile(u)).tolist())
    q = _numbers(attitude, "attitude")
    if q.shape != (4,) or abs(np.linalg.norm(q) - 1) > 1e-9:
        raise ValueError("attitude must be a unit quaternion")
    return Draw(3, lambda u: _product(q, _exponential(s * normal_quantile(u))).tolist())


def _exponential(phi: Array) -> Array:
    """Quaternion of a rotation vector, scalar first."""
    angle = float(np.linalg.norm(phi))
    return np.array([math.cos(angle / 2), *(0.5 * np.sinc(angle / (2 * math.pi)) * phi)])


def _product(a: Array, b: Array) -> Array:
    """Quaternion product, scalar first."""
    vector = a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.array([a[0] * b[0] - a[1:] @ b[1:], *vector])


def _inertia(principal: Any, spread: float, axes: float = 0.0) -> Draw:
    """Inertia of a body: second moments P_i = tr(J)/2 - J_i times exp(spread z), axes turned by a
    rotation vector of deviation `axes` [rad].

    Whatever is drawn is positive definite and obeys the triangle rule, for all P_i are positive.
    """
    j = _numbers(principal, "principal")
    if j.shape != (3,):
        raise ValueError("principal: expected three moments of inertia")
    p = j.sum() / 2 - j
    if not (p > 0).all():
        raise ValueError(f"principal must obey the triangle rule, not {list(principal)}")
    if not (spread >= 0 and axes >= 0):
        raise ValueError("spread and axes must not be negative")

    def value(u: Array) -> list[list[float]]:
        z = normal_quantile(u)
        moments = p * np.exp(spread * z[:3])
        turn = _matrix(_exponential(axes * z[3:]))
        return _symmetric(turn @ np.diag(moments.sum() - moments) @ turn.T)

    return Draw(6, value)


def _matrix(q: Array) -> Array:
    """Rotation matrix of a quaternion, scalar first."""
    x = np.array([[0, -q[3], q[2]], [q[3], 0, -q[1]], [-q[2], q[1], 0]])
    return np.asarray(np.eye(3) + 2 * q[0] * x + 2 * x @ x)


def _symmetric(j: Array) -> list[list[float]]:
    """Equal to the last bit on both sides of the diagonal."""
    return [[float(j[min(a, b), max(a, b)]) for b in range(3)] for a in range(3)]


DRAWS: dict[str, Callable[..., Draw]] = {
    "normal": _normal,
    "log_normal": _log_normal,
    "uniform": _uniform,
    "rotation": _rotation,
    "inertia": _inertia,
}

# ---- numbers


def _numbers(given: Any, name: str) -> Array:
    try:
        array = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{name} must be numbers, not {given}") from error
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    return array


def _vectors(a: Any, b: Any) -> tuple[Array, Array]:
    try:
        x, y = np.broadcast_arrays(_numbers(a, "it"), _numbers(b, "it"))
    except ValueError as error:
        raise ValueError(f"{a} and {b} do not fit together ({error})") from error
    if x.ndim > 1:
        raise ValueError("expected a number or a vector")
    return np.atleast_1d(x), np.atleast_1d(y)


def _two(given: Sequence[float], name: str) -> tuple[float, float]:
    array = _numbers(given, name)
    if array.shape != (2,):
        raise ValueError(f"{name}: expected two numbers")
    return float(array[0]), float(array[1])


def _demand(holds: NDArray[np.bool_], name: str, rule: str, given: Any) -> None:
    if not holds.all():
        raise ValueError(f"{name} {rule}, not {given}")


def _shaped(values: Array, *given: Any) -> Any:
    """A number where numbers were given, else a list."""
    return values.tolist() if any(np.ndim(g) for g in given) else float(values[0])


# ---- numbers for all draws of a campaign, and the seeds of its runs

LARGEST_SEED = 2**31
"""Seeds lie below, so that every FMU holds them exactly."""


def _random(n: int, d: int, seed: int) -> Array:
    """Row k depends on seed and k alone: a longer campaign begins with the runs of a shorter
    one.
    """
    rows = (np.random.default_rng([seed, k]).random(d) for k in range(n))
    return np.array(list(rows)).reshape(n, d)


def _latin_hypercube(n: int, d: int, seed: int) -> Array:
    from scipy.stats.qmc import LatinHypercube

    return np.asarray(LatinHypercube(d, rng=seed).random(n))


def _sobol(n: int, d: int, seed: int) -> Array:
    from scipy.stats.qmc import Sobol

    return np.asarray(Sobol(d, rng=seed).random_base2(max(n - 1, 0).bit_length())[:n])


SAMPLERS: dict[str, Callable[[int, int, int], Array]] = {
    "random": _random,
    "latin-hypercube": _latin_hypercube,
    "sobol": _sobol,
}


def numbers(sampler: str, n: int, d: int, seed: int) -> Array:
    """Numbers between 0 and 1, (n, d), never 0 or 1."""
    if d == 0:
        return np.empty((n, 0))
    return np.clip(SAMPLERS[sampler](n, d, seed), SMALLEST, 1 - SMALLEST)


def run_seed(seed: int, k: int, place: int) -> int:
    """Seed of draw k for the parameter in this place of the list."""
    return int(np.random.default_rng([seed, k, place + 1]).integers(LARGEST_SEED))
