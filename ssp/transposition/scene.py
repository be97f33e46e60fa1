# SPDX-License-Identifier: BSD-2-Clause
"""3D replay of the assembly: two docked bodies, one of which swings about a hinge on the other."""

from __future__ import annotations

import numpy as np

from harness.report.arrays import Arrays
from harness.results.result import Array, Result

from ..shared import bodies
from ..shared.scene import Body, Part, Scene, instants, joint, number, scene
from ..shared.sky import HILL, INERTIAL, sky
from .figures import SHAPE

ASSEMBLY = ("assembly.q_SN", "assembly.q_SH", "assembly.arm_angle")
NUMBERS = {
    "arm_angle": "angle of the hinge",
    "rotation": "rotation from the flight attitude",
    "h_cmg": "momentum of the gyros",
    "momentum_share": "momentum of the gyros as a share of the largest",
}
"""Outputs of the assembly whose values the replay shows, with their labels."""


def assembly(result: Result, arrays: Arrays) -> Scene:
    """Return the scene of two docked bodies: the base, whose centre of mass is the origin, and the
    module, which swings about the hinge on the base.
    """
    rows = instants(result, ASSEMBLY[1])
    attitude, relative, angle = ASSEMBLY
    hill = _after(result[attitude][rows], result[relative][rows])
    hinge, module, box_0, box_1, *facets = (result.parameter(name) for name in SHAPE)
    base, swinging = (_panels(facets, body) for body in (0, 1))
    moved = [bodies.box(box_1, module, "second"), *bodies.shifted(swinging, module)]
    swung = joint(
        hinge, arrays.sample(result, rows, angle), 0, [*moved, bodies.ball((0, 0, 0), 0.8)]
    )
    reach = float(np.linalg.norm(hinge) + np.linalg.norm(module) + box_1[0] / 2)
    still, q = arrays.store(np.zeros((len(rows), 3))), arrays.sample(result, rows, attitude)
    body = Body("base", still, q, [bodies.box(box_0), *base], 0, float(np.linalg.norm(box_0) / 2),
                (swung,), trail=False, reach=reach)  # fmt: skip
    radius = float(result.parameter("assembly.R_C"))
    return scene(
        arrays,
        result.time[rows],
        "centre of mass of the base",
        [body],
        frames=[HILL, INERTIAL],
        hill=arrays.store(hill),
        **sky(result, arrays, rows, radius * _turned_axes(hill)),
        numbers=[
            number(result, arrays, rows, f"assembly.{name}", text=text)
            for name, text in NUMBERS.items()
            if f"assembly.{name}" in result
        ],
    )


def _after(q_SN: Array, q_SH: Array) -> Array:
    """Return the quaternions of H relative to N (rows, 4) from the quaternions of S relative to N
    and to H.
    """
    (a, u), (b, w) = ((q[:, :1], q[:, 1:]) for q in (q_SN, q_SH))
    scalar = a * b + np.sum(u * w, axis=1)[:, None]
    return np.concatenate((scalar, b * u - a * w - np.cross(u, w)), axis=1)


def _turned_axes(q: Array) -> Array:
    """Return the x axis of a frame in N axes (rows, 3); q: its attitude relative to N (rows, 4)."""
    w, x, y, z = q.T
    return np.stack([w**2 + x**2 - y**2 - z**2, 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=1)


def _panels(facets: list[Array], body: int) -> list[Part]:
    area, carrier, position, normal = facets
    mine = carrier == body
    return list(bodies.panels(area[mine], position[mine], normal[mine]))
