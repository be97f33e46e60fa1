# SPDX-License-Identifier: BSD-2-Clause
"""Random numbers of the sensors: Philox4x32-10 in whole numbers of any size, normal draws by
scipy's quantile.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from .attitude import Array

WORD = 2**32


def philox(counter: tuple[int, ...], key: tuple[int, int]) -> tuple[int, ...]:
    """Ten rounds of Salmon et al. 2011."""
    c, k = list(counter), list(key)
    for _ in range(10):
        (p_hi, p_lo), (q_hi, q_lo) = (
            divmod(0xD2511F53 * c[0], WORD),
            divmod(0xCD9E8D57 * c[2], WORD),
        )
        c = [q_hi ^ c[1] ^ k[0], q_lo, p_hi ^ c[3] ^ k[1], p_lo]
        k = [(k[0] + 0x9E3779B9) % WORD, (k[1] + 0xBB67AE85) % WORD]
    return tuple(c)


def uniforms(seed: int, stream: int, n: int, count: int, once: int = 0) -> Array:
    """The first draws of sample n, or of the run (once = 1, n = 0)."""
    u: list[float] = []
    for block in range((count + 1) // 2):
        w = philox((n % WORD, n // WORD % WORD, block, once), (seed, stream))
        u += [((a >> 6) * 2**26 + (b >> 6) + 0.5) / 2**52 for a, b in (w[:2], w[2:])]
    return np.array(u[:count])


def normals(seed: int, stream: int, n: int, count: int, once: int = 0) -> Array:
    return ndtri(uniforms(seed, stream, n, count, once))
