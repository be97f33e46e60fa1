# SPDX-License-Identifier: BSD-2-Clause
"""The replay of one body with moving parts: the robot with its links, the assembly with its arm."""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.figures.transposition import SHAPE
from harness.report import bodies
from harness.report.arrays import Arrays
from harness.report.scene import (
    EARTH,
    HILL,
    INERTIAL,
    Array,
    Body,
    Rows,
    Scene,
    frames,
    instants,
    scene,
)
from harness.results.result import Result

ROBOT = ("robot.r_SN_N", "robot.v_SN_N", "robot.q_SN", "robot.joint_angle")
LINKS = tuple(f"robot.{name}" for name in ("mass", "Ixx", "Iyy", "Izz", "l", "r"))


def robot(result: Result, arrays: Arrays) -> Scene:
    """A base with two links, about the centre of mass of the base: every body is the box of uniform
    density with its mass and inertia.
    """
    rows = instants(result, ROBOT[2])
    r, v, q, angles = (result[name][rows] for name in ROBOT)
    mass, Ixx, Iyy, Izz, inboard, outboard = (result.parameter(name) for name in LINKS)
    boxes = [bodies.uniform_box(m, np.array(J)) for m, *J in zip(mass, Ixx, Iyy, Izz, strict=True)]
    angle, reach = arrays.keep(angles), outboard[0]
    links = []
    for k in (0, 1):
        at = [outboard[0] if k == 0 else inboard[1] + outboard[1], 0, 0]
        hull = bodies.box(boxes[k + 1], (inboard[k + 1], 0, 0), "arm" if k == 0 else "accent")
        joint = bodies.rod((0, 0, -0.15), (0, 0, 0.15), 0.12)
        links.append({**_joint(at, angle, k, [hull, joint]), **({"on": 0} if k else {})})
        reach += inboard[k + 1] + (outboard[1] if k == 0 else boxes[2][0] / 2)
    size = boxes[0]
    base = Body("robot", 0 * r, q, [bodies.box(size)], 0, float(np.linalg.norm(size) / 2),
                tuple(links), trail=False, reach=float(reach))  # fmt: skip
    return scene(
        arrays,
        result.time[rows],
        "centre of mass of the base",
        [base],
        **frames(arrays, r, v, result),
        numbers=[
            _number(result, arrays, rows, "robot.pitch"),
            *(_number(result, arrays, rows, f"robot.joint_angle[{k}]") for k in (1, 2)),
        ],
    )


def _joint(at: Any, angle: str, index: int, parts: list[bodies.Part], **about: Any) -> Scene:
    """What turns about z of what carries it, by a column of an array of angles."""
    place = [float(x) for x in at]
    return {"at": place, "axis": [0, 0, 1], "angle": angle, "index": index, "parts": parts, **about}


def _number(result: Result, arrays: Arrays, rows: Rows, name: str) -> Scene:
    """A number that runs along with the replay; angles in degrees."""
    angle = result.unit(name) == "rad"
    return {
        "name": name.partition(".")[2].replace("_", " "),
        "unit": "deg" if angle else result.unit(name),
        "factor": float(np.degrees(1.0)) if angle else 1.0,
        "values": arrays.keep(result[name][rows]),
    }


ASSEMBLY = ("assembly.q_SN", "assembly.q_SH", "assembly.arm_angle")


def assembly(result: Result, arrays: Arrays) -> Scene:
    """Two docked bodies, the one swinging about the hinge on the other, about the centre of mass of
    the base.
    """
    rows = instants(result, ASSEMBLY[1])
    q, q_SH, angle = (result[name][rows] for name in ASSEMBLY)
    hill = _after(q, q_SH)
    hinge, module, box_0, box_1, *facets = (result.parameter(name) for name in SHAPE)
    base, swinging = (_panels(facets, body) for body in (0, 1))
    moved = [bodies.box(box_1, module, "second"), *bodies.shifted(swinging, module)]
    joint = _joint(hinge, arrays.keep(angle), 0, [*moved, bodies.ball((0, 0, 0), 0.8)])
    reach = float(np.linalg.norm(hinge) + np.linalg.norm(module) + box_1[0] / 2)
    r = np.zeros((len(rows), 3))
    body = Body("base", r, q, [bodies.box(box_0), *base], 0, float(np.linalg.norm(box_0) / 2),
                (joint,), trail=False, reach=reach)  # fmt: skip
    radius = float(result.parameter("assembly.R_C"))
    centre = -radius * _turned_axes(hill)
    return scene(
        arrays,
        result.time[rows],
        "centre of mass of the base",
        [body],
        frames=[HILL, INERTIAL],
        hill=arrays.keep(hill),
        planet={"r": arrays.keep(centre), "radius": min(EARTH, 0.99 * radius)},
        numbers=[
            _number(result, arrays, rows, f"assembly.{name}")
            for name in ("arm_angle", "rotation", "h_cmg", "momentum_share")
            if f"assembly.{name}" in result
        ],
    )


def _after(q_SN: Array, q_SH: Array) -> Array:
    """Quaternion of H relative to N from those of S, (rows, 4)."""
    from scipy.spatial.transform import Rotation

    S_to_N, S_to_H = (Rotation.from_quat(q[:, [1, 2, 3, 0]]) for q in (q_SN, q_SH))
    return np.asarray((S_to_N * S_to_H.inv()).as_quat()[:, [3, 0, 1, 2]])


def _turned_axes(q: Array) -> Array:
    """The x axis of a frame in N axes, (rows, 3)."""
    w, x, y, z = q.T
    return np.stack([w**2 + x**2 - y**2 - z**2, 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=1)


def _panels(facets: list[Array], body: int) -> list[bodies.Part]:
    area, carrier, position, normal = facets
    mine = carrier == body
    return list(bodies.panels(area[mine], position[mine], normal[mine]))
