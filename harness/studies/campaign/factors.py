# SPDX-License-Identifier: BSD-2-Clause
"""Factors: the differences between the runs of a campaign, and their values from numbers between 0
and 1.

Every draw is the inverse of a distribution function, so random, Latin hypercube and Sobol numbers
serve all factors alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import Annotated, Any, NamedTuple

import numpy as np
from msgspec import Meta, Struct, convert
from msgspec.structs import asdict, fields

from harness.results.result import Array
from harness.system.tables import Number

SMALLEST = 2.0**-53
"""Smallest distance of numbers from 0 and 1, where a normal draw is infinite."""
LEAST_PROBABILITY = 1e-300
"""Smallest probability that `within` may have."""
MAX_VALUES = 1_000_000
"""Largest number of listed values of one factor."""

Numbers = Annotated[Number | list[Number], Meta(description="a number or a vector")]
Vector = Annotated[list[Number], Meta(description="a vector of numbers")]
Matrix = Annotated[list[list[Number]], Meta(description="rows of numbers")]
Pair = Annotated[list[Number], Meta(min_length=2, max_length=2, description="two numbers")]
Values = Annotated[list[Any], Meta(min_length=1, description="values in brackets")]
NONE: Any = None


class Draw(NamedTuple):
    """Function that turns `numbers` numbers between 0 and 1 into one value."""

    numbers: int
    value: Callable[[Array], Any]


@dataclass(frozen=True)
class Factor:
    """Parameter or option that varies: listed values, or a draw.

    name: `component.parameter`, or a change: `swap.C`, `latency.C`, `params`, `algorithm`, `step`,
    `stop`.
    """

    name: str
    choices: tuple[Any, ...] = ()
    draw: Draw | None = None


class Range(Struct, frozen=True):
    """Equally spaced values."""

    first: Number
    last: Number
    count: Annotated[
        int, Meta(ge=1, le=MAX_VALUES, description=f"a whole number from 1 to {MAX_VALUES}")
    ]


class Normal(Struct, frozen=True):
    """Normal distribution: independent elements of deviation sigma, which `within` can limit, or
    a vector with a covariance.
    """

    mean: Numbers
    sigma: Numbers = NONE
    covariance: Matrix = NONE
    within: Pair = NONE

    def draw(self) -> Draw:
        """Return the draw; raise ValueError with the rule that an entry breaks."""
        _demand(
            (self.sigma is None) != (self.covariance is None),
            "either sigma or covariance, not both or none",
        )
        if self.covariance is not None:
            return self._correlated()
        m, s = _vectors(self.mean, self.sigma)
        _demand(s > 0, f"a positive sigma, not {self.sigma}")
        side, low, width = self._probabilities(m, s)

        def value(u: Array) -> Any:
            z = side * normal_quantile(low + u * width)
            return _shaped(m + s * z, self.mean, self.sigma)

        return Draw(m.size, value)

    def _probabilities(self, m: Array, s: Array) -> tuple[Any, Any, Any]:
        """Return a side, 1 or -1, the distribution function at the lower end of `within`, and its
        increase to the upper end. An interval above the mean is mirrored (side -1): the function is
        exact in the lower tail only.
        """
        if self.within is None:
            return 1.0, 0.0, 1.0
        lowest, highest = self.within
        _demand(lowest < highest, f"the smaller number of within first, not {self.within}")
        side = np.where(lowest > m, -1.0, 1.0)
        ends = _normal_below(side * (lowest - m) / s), _normal_below(side * (highest - m) / s)
        low, width = np.minimum(*ends), np.abs(ends[1] - ends[0])
        _demand(width > LEAST_PROBABILITY, f"within nearer to the mean, not {self.within}")
        return side, low, width

    def _correlated(self) -> Draw:
        """Return the draw x = mean + L z, L L^T = covariance."""
        _demand(self.within is None, "`within` only with sigma, not with a covariance")
        m = np.asarray(self.mean, dtype=np.float64)
        _demand(m.ndim == 1, f"a vector as mean, not {self.mean}")
        size = f"a symmetric, positive definite covariance, {m.size} x {m.size}"
        _demand([len(row) for row in self.covariance] == [m.size] * m.size, size)
        c = np.asarray(self.covariance, dtype=np.float64)
        _demand(c == c.T, size)
        try:
            factor_l = np.linalg.cholesky(c)
        except np.linalg.LinAlgError as error:
            raise ValueError(f"expected {size}") from error
        return Draw(m.size, lambda u: (m + factor_l @ normal_quantile(u)).tolist())


class LogNormal(Struct, frozen=True):
    """Log-normal: x = median exp(sigma z)."""

    median: Numbers
    sigma: Numbers

    def draw(self) -> Draw:
        """Return the draw; raise ValueError with the rule that an entry breaks."""
        m, s = _vectors(self.median, self.sigma)
        _demand(s > 0, f"a positive sigma, not {self.sigma}")
        _demand(m > 0, f"a positive median, not {self.median}")

        def value(u: Array) -> Any:
            return _shaped(m * np.exp(s * normal_quantile(u)), self.median, self.sigma)

        return Draw(m.size, value)


class Uniform(Struct, frozen=True):
    """Uniform between both."""

    low: Numbers
    high: Numbers

    def draw(self) -> Draw:
        """Return the draw; raise ValueError with the rule that an entry breaks."""
        a, b = _vectors(self.low, self.high)
        _demand(a < b, f"a low that is smaller than high, not {self.low} and {self.high}")
        return Draw(a.size, lambda u: _shaped(a + u * (b - a), self.low, self.high))


class Rotation(Struct, frozen=True):
    """Rotation vector phi = sigma z [rad]; with an attitude q the quaternion q * exp(phi / 2)."""

    sigma: Numbers
    attitude: Vector = NONE

    def draw(self) -> Draw:
        """Return the draw; raise ValueError with the rule that an entry breaks."""
        s = _vectors(self.sigma, [0.0] * 3)[0]
        _demand(s > 0, f"a positive sigma, not {self.sigma}")
        if self.attitude is None:
            return Draw(3, lambda u: (s * normal_quantile(u)).tolist())
        q = np.array(self.attitude)
        unit = len(q) == 4 and abs(np.linalg.norm(q) - 1) <= 1e-9
        _demand(unit, f"an attitude that is a unit quaternion, not {self.attitude}")
        return Draw(3, lambda u: _product(q, _exponential(s * normal_quantile(u))).tolist())


class Inertia(Struct, frozen=True):
    """Inertia of a body: second moments P_i = tr(J)/2 - J_i times exp(spread z), axes turned by a
    rotation vector of deviation `axes` [rad].

    Every drawn inertia is positive definite and satisfies the triangle inequality, because all P_i
    are positive.
    """

    principal: Vector
    spread: Number
    axes: Number = 0.0

    def draw(self) -> Draw:
        """Return the draw; raise ValueError with the rule that an entry breaks."""
        j = np.array(self.principal)
        p = j.sum() / 2 - j
        fine = len(j) == 3 and (p > 0).all()
        words = "three principal moments, each smaller than the sum of the others"
        _demand(fine, f"{words}, not {self.principal}")
        _demand(
            min(self.spread, self.axes) >= 0,
            f"spread and axes of at least 0, not {self.spread} and {self.axes}",
        )

        def value(u: Array) -> list[list[float]]:
            z = normal_quantile(u)
            moments = p * np.exp(self.spread * z[:3])
            turn = _matrix(_exponential(self.axes * z[3:]))
            return _symmetric(turn @ np.diag(moments.sum() - moments) @ turn.T)

        return Draw(6, value)


class Varied(Struct, frozen=True):
    """Factor in the file of a campaign: exactly one of these entries."""

    list: Values = NONE
    range: Range | None = None
    normal: Normal | None = None
    log_normal: LogNormal | None = None
    uniform: Uniform | None = None
    rotation: Rotation | None = None
    inertia: Inertia | None = None


CHOICES = ("list", "range")
"""Kinds of factors that are listed, not drawn."""


def factor(name: str, table: Varied | Mapping[str, Any]) -> Factor:
    """Return a factor from its table, e.g. {normal = {mean = 1.0, sigma = 0.1}}; raise ValueError
    with its problem.
    """
    entries = asdict(convert(table, Varied))
    given = {kind: each for kind, each in entries.items() if each is not None}
    if len(given) != 1:
        raise ValueError(f"expected exactly one of {', '.join(f.name for f in fields(Varied))}")
    ((kind, each),) = given.items()
    if isinstance(each, Range):
        return Factor(name, tuple(map(float, np.linspace(each.first, each.last, each.count))))
    if kind in CHOICES:
        return Factor(name, tuple(each))
    try:
        return Factor(name, draw=each.draw())
    except ValueError as error:
        raise ValueError(f"{kind}: {error}") from error


def _demand(holds: Any, words: str) -> None:
    """Raise ValueError unless a rule holds for all elements."""
    if not np.all(holds):
        raise ValueError(f"expected {words}")


def _vectors(a: Any, b: Any) -> tuple[Array, Array]:
    """Return two numbers or vectors as vectors of equal length."""
    x, y = np.atleast_1d(np.asarray(a, np.float64)), np.atleast_1d(np.asarray(b, np.float64))
    _demand(len({x.size, y.size} - {1}) <= 1, f"vectors of one length, not {a} and {b}")
    size = max(x.size, y.size)
    return np.broadcast_to(x, size), np.broadcast_to(y, size)


def _shaped(values: Array, *given: Any) -> Any:
    """Return a number if numbers were given, else a list."""
    return values.tolist() if any(np.ndim(g) for g in given) else float(values[0])


def normal_quantile(p: Array) -> Array:
    """Return the quantiles z of the standard normal distribution, Phi(z) = p, in the shape of p;
    p is between 0 and 1.
    """
    return np.asarray(_quantiles(np.minimum(p, 1 - SMALLEST)))


_quantiles = np.vectorize(NormalDist().inv_cdf, otypes=[np.float64])
_normal_below = np.vectorize(lambda z: math.erfc(-z / math.sqrt(2)) / 2, otypes=[np.float64])
"""Distribution function; erfc() is exact in the lower tail too."""


def _exponential(phi: Array) -> Array:
    """Return the quaternion of a rotation vector, scalar first."""
    angle = float(np.linalg.norm(phi))
    return np.array([math.cos(angle / 2), *(0.5 * np.sinc(angle / (2 * math.pi)) * phi)])


def _product(a: Array, b: Array) -> Array:
    """Return the product of quaternions, scalar first."""
    vector = a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.array([a[0] * b[0] - a[1:] @ b[1:], *vector])


def _matrix(q: Array) -> Array:
    """Return the rotation matrix of a quaternion, scalar first."""
    x = np.array([[0, -q[3], q[2]], [q[3], 0, -q[1]], [-q[2], q[1], 0]])
    return np.asarray(np.eye(3) + 2 * q[0] * x + 2 * x @ x)


def _symmetric(j: Array) -> list[list[float]]:
    """Return the matrix with bit-identical elements on both sides of the diagonal."""
    return [[float(j[min(a, b), max(a, b)]) for b in range(3)] for a in range(3)]


# ---- numbers for all draws of a campaign, and the seeds of its runs

LARGEST_SEED = 2**31
"""Upper limit of seeds: every FMU stores smaller ones exactly."""


def _random(n: int, d: int, seed: int) -> Array:
    """Return random numbers. Row k depends on seed and k alone: a longer campaign begins with the
    runs of a shorter one.
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
    """Return numbers between 0 and 1, (n, d), never 0 or 1."""
    if d == 0:
        return np.empty((n, 0))
    return np.clip(SAMPLERS[sampler](n, d, seed), SMALLEST, 1 - SMALLEST)


def run_seed(seed: int, k: int, place: int) -> int:
    """Return the seed of draw k for the parameter in this place of the list."""
    return int(np.random.default_rng([seed, k, place + 1]).integers(LARGEST_SEED))
