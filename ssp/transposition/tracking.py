# SPDX-License-Identifier: BSD-2-Clause
"""How far the attitude of the assembly is from its reference."""

from __future__ import annotations

import numpy as np

from harness.results.histories import rotation_angle
from harness.results.result import Array, Result

ASSEMBLY = ("assembly.q_SH", "guidance.q_DH")


def attitude_error(result: Result) -> Array:
    """Angle between the attitude of the assembly and its reference, relative to H, (rows,) [rad].

    The guidance samples at the beginning of a step: the reference of a row stands in the next one.
    """
    errors = rotation_angle(result[ASSEMBLY[0]][:-1], result[ASSEMBLY[1]][1:])
    return np.concatenate((errors, errors[-1:]))
