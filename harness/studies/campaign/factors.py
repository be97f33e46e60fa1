# SPDX-License-Identifier: BSD-2-Clause
"""Factors: the parameters and options in which the runs of a campaign differ, and how their values
are drawn from numbers between 0 and 1.

A random factor applies the inverse of its distribution function to these numbers, which come from
a random, Latin hypercube or Sobol sampler.
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
"""Smallest distance from 0 and from 1 of the numbers from which factors are drawn; a normal draw
for 0 or 1 would be infinite.
"""
LEAST_PROBABILITY = 1e-300
"""Smallest permitted probability that a normally distributed value is inside the limits `within`.
"""
MAX_VALUES = 1_000_000
"""Largest number of values of a factor `range`."""

Numbers = Annotated[Number | list[Number], Meta(description="a number or a vector")]
Vector = Annotated[list[Number], Meta(description="a vector of numbers")]
Matrix = Annotated[list[list[Number]], Meta(description="rows of numbers")]
Pair = Annotated[list[Number], Meta(min_length=2, max_length=2, description="two numbers")]
Values = Annotated[list[Any], Meta(min_length=1, description="values in brackets")]
NONE: Any = None


class Draw(NamedTuple):
    """Distribution of a random factor: the function `value` takes an array of numbers between 0
    and 1 and returns one value of the factor; `numbers` is the length of the array.
    """

    numbers: int
    value: Callable[[Array], Any]


@dataclass(frozen=True)
class Factor:
    """Parameter or option that varies between runs, with either listed values (`choices`) or a
    random `draw`.

    name: `component.parameter`, or an option of run(): `swap.COMPONENT`, `latency.COMPONENT`,
    `params`, `algorithm`, `step`, `stop`, `epoch`.
    """

    name: str
    choices: tuple[Any, ...] = ()
    draw: Draw | None = None


class Range(Struct, frozen=True):
    """Equally spaced values: `count` values from `first` to `last`, both included; for count = 1
    only `first`.
    """

    first: Number
    last: Number
    count: Annotated[
        int, Meta(ge=1, le=MAX_VALUES, description=f"a whole number from 1 to {MAX_VALUES}")
    ]


class Normal(Struct, frozen=True):
    """Normal distribution: independent elements with standard deviation sigma, or a vector with a
    covariance; within: limits [low, high] of independent elements.
    """

    mean: Numbers
    sigma: Numbers = NONE
    covariance: Matrix = NONE
    within: Pair = NONE

    def draw(self) -> Draw:
        """Return the distribution of the factor; raise ValueError if an entry breaks a rule."""
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
        """Return three arrays with a value per element, or 1, 0, 1 without `within`: a sign, the
        distribution function at the lower end of the interval `within`, and its increase up to the
        upper end. m: means; s: standard deviations.

        If the interval is above the mean, the sign is -1 and the other two values belong to the
        interval mirrored at the mean, because floating-point numbers near 1 cannot represent the
        distribution function of the upper tail precisely. Otherwise the sign is 1.
        """
        if self.within is None:
            return 1.0, 0.0, 1.0
        lowest, highest = self.within
        _demand(lowest < highest, f"the smaller limit first in `within`, not {self.within}")
        side = np.where(lowest > m, -1.0, 1.0)
        ends = _normal_below(side * (lowest - m) / s), _normal_below(side * (highest - m) / s)
        low, width = np.minimum(*ends), np.abs(ends[1] - ends[0])
        _demand(
            width > LEAST_PROBABILITY,
            f"limits `within` nearer to the mean, not {self.within}: the probability of values "
            "between these limits is almost 0",
        )
        return side, low, width

    def _correlated(self) -> Draw:
        """Return the distribution x = mean + L z with L L^T = covariance and a standard normal
        vector z.
        """
        _demand(self.within is None, "no `within` with a covariance: limits need sigma")
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
    """Log-normal distribution: x = median exp(sigma z), with a standard normal number z."""

    median: Numbers
    sigma: Numbers

    def draw(self) -> Draw:
        """Return the distribution of the factor; raise ValueError if an entry breaks a rule."""
        m, s = _vectors(self.median, self.sigma)
        _demand(s > 0, f"a positive sigma, not {self.sigma}")
        _demand(m > 0, f"a positive median, not {self.median}")

        def value(u: Array) -> Any:
            return _shaped(m * np.exp(s * normal_quantile(u)), self.median, self.sigma)

        return Draw(m.size, value)


class Uniform(Struct, frozen=True):
    """Uniform distribution between low and high."""

    low: Numbers
    high: Numbers

    def draw(self) -> Draw:
        """Return the distribution of the factor; raise ValueError if an entry breaks a rule."""
        a, b = _vectors(self.low, self.high)
        _demand(a < b, f"a low that is smaller than high, not {self.low} and {self.high}")
        return Draw(a.size, lambda u: _shaped(a + u * (b - a), self.low, self.high))


class Rotation(Struct, frozen=True):
    """Random rotation: the rotation vector phi = sigma z [rad] with a standard normal vector z (3,)
    or, if an attitude q is given, the quaternion q * exp(phi / 2), scalar first.
    """

    sigma: Numbers
    attitude: Vector = NONE

    def draw(self) -> Draw:
        """Return the distribution of the factor; raise ValueError if an entry breaks a rule."""
        s = _vectors(self.sigma, [0.0] * 3)[0]
        _demand(s > 0, f"a positive sigma, not {self.sigma}")
        if self.attitude is None:
            return Draw(3, lambda u: (s * normal_quantile(u)).tolist())
        q = np.array(self.attitude)
        unit = len(q) == 4 and abs(np.linalg.norm(q) - 1) <= 1e-9
        _demand(unit, f"an attitude that is a unit quaternion, not {self.attitude}")
        return Draw(3, lambda u: _product(q, _exponential(s * normal_quantile(u))).tolist())


class Inertia(Struct, frozen=True):
    """Random inertia matrix of a body with the nominal principal moments J_i (`principal`).

    The second moments P_i = tr(J)/2 - J_i are multiplied by exp(spread z_i), where the z_i are
    independent and standard normal. The principal axes are turned by a random rotation vector with
    standard deviation `axes` [rad]. Every drawn inertia is positive definite and satisfies the
    triangle inequality, because all P_i are positive.
    """

    principal: Vector
    spread: Number
    axes: Number = 0.0

    def draw(self) -> Draw:
        """Return the distribution of the factor; raise ValueError if an entry breaks a rule."""
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
    """Table of one factor in the file of a campaign. It must have exactly one of these entries."""

    list: Values = NONE
    range: Range | None = None
    normal: Normal | None = None
    log_normal: LogNormal | None = None
    uniform: Uniform | None = None
    rotation: Rotation | None = None
    inertia: Inertia | None = None


CHOICES = ("list", "range")
"""Entries in the table of a factor that list its values; all other entries are random
distributions.
"""


def factor(name: str, table: Varied | Mapping[str, Any]) -> Factor:
    """Return the factor that a table defines, e.g. {normal = {mean = 1.0, sigma = 0.1}}; raise
    ValueError with the problem of a wrong table.
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
    """Raise ValueError("expected " + words) unless all elements of `holds` are true."""
    if not np.all(holds):
        raise ValueError(f"expected {words}")


def _vectors(a: Any, b: Any) -> tuple[Array, Array]:
    """Return two numbers or vectors as vectors of equal length; a number is repeated. Raise
    ValueError if two vectors differ in length.
    """
    x, y = np.atleast_1d(np.asarray(a, np.float64)), np.atleast_1d(np.asarray(b, np.float64))
    _demand(len({x.size, y.size} - {1}) <= 1, f"vectors of one length, not {a} and {b}")
    size = max(x.size, y.size)
    return np.broadcast_to(x, size), np.broadcast_to(y, size)


def _shaped(values: Array, *given: Any) -> Any:
    """Return `values` as a list if one of the given entries of the user is a list, otherwise as a
    number.
    """
    return values.tolist() if any(np.ndim(g) for g in given) else float(values[0])


def normal_quantile(p: Array) -> Array:
    """Return the quantiles z of the standard normal distribution, Phi(z) = p, in the shape of p;
    p is between 0 and 1.
    """
    return np.asarray(_quantiles(np.minimum(p, 1 - SMALLEST)))


_quantiles = np.vectorize(NormalDist().inv_cdf, otypes=[np.float64])
_normal_below = np.vectorize(lambda z: math.erfc(-z / math.sqrt(2)) / 2, otypes=[np.float64])
"""Standard normal distribution function, computed by erfc(), which is precise in the lower tail
too.
"""


def _exponential(phi: Array) -> Array:
    """Return the unit quaternion, scalar first, of a rotation vector [rad]."""
    angle = float(np.linalg.norm(phi))
    return np.array([math.cos(angle / 2), *(0.5 * np.sinc(angle / (2 * math.pi)) * phi)])


def _product(a: Array, b: Array) -> Array:
    """Return the product of two quaternions, scalar first."""
    vector = a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])
    return np.array([a[0] * b[0] - a[1:] @ b[1:], *vector])


def _matrix(q: Array) -> Array:
    """Return the rotation matrix (3, 3) of a unit quaternion, scalar first."""
    x = np.array([[0, -q[3], q[2]], [q[3], 0, -q[1]], [-q[2], q[1], 0]])
    return np.asarray(np.eye(3) + 2 * q[0] * x + 2 * x @ x)


def _symmetric(j: Array) -> list[list[float]]:
    """Return a nearly symmetric matrix (3, 3) as a list of rows that is exactly symmetric: elements
    below the diagonal are copied from above it.
    """
    return [[float(j[min(a, b), max(a, b)]) for b in range(3)] for a in range(3)]


# ---- numbers for all draws of a campaign, and the seeds of its runs

LARGEST_SEED = 2**31
"""Upper limit of seeds, not included. Every FMU can represent smaller seeds exactly."""


def _random(n: int, d: int, seed: int) -> Array:
    """Return independent random numbers (n, d) between 0 and 1. Row k depends on seed and k only,
    so that a longer campaign begins with the runs of a shorter campaign.
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
"""Functions of (n, d, seed) that return numbers between 0 and 1, in an array (n, d), by name of the
sampler; n: number of draws; d: numbers per draw.
"""


def numbers(sampler: str, n: int, d: int, seed: int) -> Array:
    """Return numbers (n, d) from a sampler for n draws of all factors, above 0 and below 1;
    sampler: a key of SAMPLERS; d: numbers per draw.
    """
    if d == 0:
        return np.empty((n, 0))
    return np.clip(SAMPLERS[sampler](n, d, seed), SMALLEST, 1 - SMALLEST)


def run_seed(seed: int, k: int, place: int) -> int:
    """Return the seed that a parameter gets in draw k; seed: seed of the campaign; place: index of
    the parameter in the list `seeds` of the campaign.
    """
    return int(np.random.default_rng([seed, k, place + 1]).integers(LARGEST_SEED))
