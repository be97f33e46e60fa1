# SPDX-License-Identifier: BSD-2-Clause
"""Kinematics of an arm: positions at given joint angles and the Jacobian of its end effector, base
axes.

    R_0 = I, o_0 = 0;   a_i = R_(i-1) joint_axis_i,   o_i = o_(i-1) + R_(i-1) joint_offset_i
    R_i = R_(i-1) Rot(joint_axis_i, q_i);   p_E = o_n + R_n p_EA_A;   J_m = [a_j x (p_E - o_j); a_j]
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from harness.results.histories import turned
from harness.results.result import Array, Result

NAMES = ("joints", "joint_axis", "joint_offset", "p_EA_A", "q_EA", "link_mass", "link_inertia")
ARM = tuple(f"servicer.{name}" for name in NAMES)


class Arm(NamedTuple):
    """Geometry of an arm. axis, offset: (n, 3), zero pose; tip: of E from the last joint (3,);
    frame: columns are the axes of E in the axes of the last link (3, 3); radius: of the links (n,)
    [m].
    """

    axis: Array
    offset: Array
    tip: Array
    frame: Array
    radius: Array


class Pose(NamedTuple):
    """Joints (rows, n, 3), their axes (rows, n, 3), frames of the links (rows, n, 3, 3), E: its
    origin (rows, 3) and its frame (rows, 3, 3); columns of frames are axes, all in base axes.
    """

    joint: Array
    axis: Array
    link: Array
    tip: Array
    frame: Array


def arm_of(result: Result) -> Arm:
    """Return the arm from the parameters of the servicer. A link is as thick as the cylinder of
    uniform density with its mass and its least moment of inertia, m r^2/2.
    """
    count, axis, offset, tip, q, mass, inertia = (result.parameter(name) for name in ARM)
    n = int(count)
    frame = turned(np.tile(q, (3, 1)), np.eye(3)).T
    return Arm(axis[:n], offset[:n], tip, frame, np.sqrt(2 * inertia[:n].min(axis=1) / mass[:n]))


def rotations(axis: Array, angle: Array) -> Array:
    """Return the matrices (rows, 3, 3) that turn vectors about an axis (3,) by angles (rows,),
    Rodrigues.
    """
    x, y, z = axis
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.asarray(np.eye(3) + s * across + (1 - c) * (across @ across))


def pose(arm: Arm, q: Array) -> Pose:
    """Return the pose of the arm at joint angles (rows, n) [rad]."""
    R, o = np.tile(np.eye(3), (len(q), 1, 1)), np.zeros((len(q), 3))
    joints, axes, links = [], [], []
    for k, (axis, offset) in enumerate(zip(arm.axis, arm.offset, strict=True)):
        o = o + R @ offset
        joints.append(o)
        axes.append(R @ axis)
        R = R @ rotations(axis, q[:, k])
        links.append(R)
    return Pose(
        np.stack(joints, axis=1),
        np.stack(axes, axis=1),
        np.stack(links, axis=1),
        o + R @ arm.tip,
        R @ arm.frame,
    )


def jacobian(at: Pose) -> Array:
    """Return J_m, (rows, 6, n): velocity and angular velocity of E by the joint rates, base at
    rest.
    """
    lever = at.tip[:, None] - at.joint
    return np.concatenate([np.cross(at.axis, lever), at.axis], axis=2).transpose(0, 2, 1)
