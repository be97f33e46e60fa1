# SPDX-License-Identifier: BSD-2-Clause
"""Comparison of computed arrays whose tolerance is a share of the largest element.

The rounding errors of a sum are shares of its largest term. An element that is small because larger
terms cancel has the absolute error of these terms, and which error that is depends on the order of
the additions, which differs between processors (kernels of OpenBLAS, vectors of numpy). A tolerance
relative to that element is met on one processor and exceeded on another one.

    close(result["assembly.J_A"], inertia, rel=1e-13)  # of the largest moment of inertia
    close(rho_now - rho_before, v * h, rel=1e-15, of=7e6)  # differences of positions in orbit
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

SHOWN = 5
"""Elements in a message, the worst first."""


def close(found: ArrayLike, expected: ArrayLike, rel: float, of: float | None = None) -> None:
    """Compare every element of an array with the expected one; the error may be `rel` times the
    largest expected magnitude.

    Parameters
    ----------
    found: array of any shape; it has to be the shape of `expected`, unless that is one number.
    expected: array or number; all elements are quantities of one kind, in one unit.
    rel: largest accepted error, a share of `of`.
    of: magnitude of the largest term of the computation, where that is not the largest element of
        `expected` (by default).

    Raises
    ------
    AssertionError
        with the index, both values and the error of the worst elements. NaN and infinity are never
        close to anything.
    """
    values, right = np.asarray(found, float), np.asarray(expected, float)
    if right.ndim:
        assert values.shape == right.shape, f"shape {values.shape}, expected {right.shape}"
    assert np.isfinite(right).all(), f"the expected values are not finite: {right}"
    size = float(np.abs(right).max(initial=0.0)) if of is None else of
    error = np.abs(values - right)
    wrong = ~(error <= rel * size)
    if not wrong.any():
        return
    lines = [
        f"{wrong.sum()} of {wrong.size} elements differ by more than {rel * size:.3g}"
        f" ({rel:g} of {size:.6g}):"
    ]
    wanted = np.broadcast_to(right, values.shape)
    for index in sorted(map(tuple, np.argwhere(wrong)), key=lambda k: -error[k])[:SHOWN]:
        where, share = list(map(int, index)), error[index] / size if size else np.inf
        lines.append(
            f"  {where}: {float(values[index])}, expected {float(wanted[index])}, error "
            f"{error[index]:.3g} = {share:.3g} of the largest"
        )
    raise AssertionError("\n".join(lines))
