# SPDX-License-Identifier: BSD-2-Clause
"""Probe and drogue of a docking mechanism as parts of the 3D replay, placed by its parameters.

The model of the probe is only a point, its tip. The replay adds a mast with the radius of the floor
of the drogue.
"""

from __future__ import annotations

import numpy as np

from harness.results.histories import turned
from harness.results.result import Array, Result

from . import bodies
from .scene import Part

DOCKING = tuple(
    f"mechanism.{name}"
    for name in (
        *("p_PS_S", "q_PS", "p_QT_T", "q_QT"),
        *("mouth_radius", "floor_radius", "cone_depth", "face_radius"),
    )
)
X = np.array([[1.0, 0.0, 0.0]])


def outward(q: Array) -> Array:
    """Return the X axis of a docking port (3,) in the axes of its body; q: attitude of the port
    relative to the body.
    """
    return np.asarray(turned(q[None], X)[0])


def probe(result: Result) -> list[Part]:
    """Return the parts of the probe: a mast along the axis of the port, and the tip."""
    tip, q, thick = (result.parameter(DOCKING[k]) for k in (0, 1, 5))
    out = outward(q)
    foot = tip - max(float(tip @ out), 0.0) * out
    return [
        bodies.rod(foot, tip, float(thick)),
        bodies.ball(tip, 1.5 * float(thick), "accent"),
    ]


def floor(result: Result) -> Array:
    """Return the centre of the floor of the drogue in target axes [m]; at this point the drogue is
    mounted on the target.
    """
    mouth, q, depth = (result.parameter(DOCKING[k]) for k in (2, 3, 6))
    return np.asarray(mouth - float(depth) * outward(q))


def drogue(result: Result) -> list[Part]:
    """Return the parts of the drogue: the cone, and the rim of the face around its mouth."""
    mouth, q = (result.parameter(DOCKING[k]) for k in (2, 3))
    wide, narrow, face = (float(result.parameter(DOCKING[k])) for k in (4, 5, 7))
    return [
        bodies.cup(floor(result), mouth, (narrow, wide)),
        bodies.hoop(mouth, outward(q), face),
    ]
