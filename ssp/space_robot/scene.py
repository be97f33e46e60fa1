# SPDX-License-Identifier: BSD-2-Clause
"""3D replay of the space robot: a base with two links."""

from __future__ import annotations

import numpy as np

from harness.report.arrays import Arrays
from harness.results.result import Result

from ..shared import bodies
from ..shared.scene import Body, Scene, instants, joint, number, scene
from ..shared.sky import frames, in_orbit, sky

ROBOT = ("robot.r_SN_N", "robot.v_SN_N", "robot.q_SN", "robot.joint_angle")
RADIUS = "robot.R_E"
LINKS = tuple(f"robot.{name}" for name in ("mass", "Ixx", "Iyy", "Izz", "l", "r"))


def robot(result: Result, arrays: Arrays) -> Scene:
    """Return the scene of a base with two links. The origin of the scene is the centre of mass of
    the base. Every body is drawn as the box of uniform density with its mass and inertia.
    """
    rows = instants(result, ROBOT[2])
    position, velocity, attitude, angles = ROBOT
    mass, Ixx, Iyy, Izz, inboard, outboard = (result.parameter(name) for name in LINKS)
    boxes = [bodies.uniform_box(m, np.array(J)) for m, *J in zip(mass, Ixx, Iyy, Izz, strict=True)]
    angle, reach = arrays.sample(result, rows, angles), outboard[0]
    links = []
    for k in (0, 1):
        at = [outboard[0] if k == 0 else inboard[1] + outboard[1], 0, 0]
        hull = bodies.box(boxes[k + 1], (inboard[k + 1], 0, 0), "arm" if k == 0 else "accent")
        hinge = bodies.rod((0, 0, -0.15), (0, 0, 0.15), 0.12)
        links.append({**joint(at, angle, k, [hull, hinge]), **({"on": 0} if k else {})})
        reach += inboard[k + 1] + (outboard[1] if k == 0 else boxes[2][0] / 2)
    size = boxes[0]
    planet = float(result.parameter(RADIUS)) if result.holds(parameters=(RADIUS,)) else 0.0
    still, q = (arrays.sample(result, rows, text) for text in (f"0 * {position}", attitude))
    base = Body("robot", still, q, [bodies.box(size)], 0, float(np.linalg.norm(size) / 2),
                tuple(links), trail=False, reach=float(reach))  # fmt: skip
    return scene(
        arrays,
        result.time[rows],
        "centre of mass of the base",
        [base],
        **frames(result, arrays, rows, position, velocity),
        **(sky(result, arrays, rows, position, planet) if in_orbit(result[position]) else {}),
        numbers=[
            number(result, arrays, rows, "robot.pitch"),
            *(
                number(result, arrays, rows, f"robot.joint_angle[{k}]", text=f"joint {k}")
                for k in (1, 2)
            ),
        ],
    )
