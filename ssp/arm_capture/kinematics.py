# SPDX-License-Identifier: BSD-2-Clause
"""Kinematics of an arm in base axes: pose at given joint angles, and the Jacobian J_m of the end
effector E.

    R_0 = I, o_0 = 0;   a_i = R_(i-1) joint_axis_i,   o_i = o_(i-1) + R_(i-1) joint_offset_i
    R_i = R_(i-1) Rot(joint_axis_i, q_i);   p_E = o_n + R_n p_EA_A;   J_m = [a_j x (p_E - o_j); a_j]

R_i: matrix from axes of link i to base axes; o_i, a_i, q_i: position, axis and angle of joint i;
p_E: position of E. joint_axis, joint_offset and p_EA_A are parameters of the servicer, see Arm.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from harness.results.histories import turned
from harness.results.result import Array, Result

NAMES = ("joints", "joint_axis", "joint_offset", "p_EA_A", "q_EA", "link_mass", "link_inertia")
ARM = tuple(f"servicer.{name}" for name in NAMES)


class Arm(NamedTuple):
    """Geometry of an arm with n joints, lengths in m.

    axis: axis of each joint (n, 3); offset: position of each joint from the joint before it, of the
    first joint from S (n, 3); both in base axes, with all joint angles 0. tip: position of the end
    effector E from the last joint (3,); frame: axes of E as columns (3, 3); both in axes of the
    last link. radius: radius of each link (n,).
    """

    axis: Array
    offset: Array
    tip: Array
    frame: Array
    radius: Array


class Pose(NamedTuple):
    """Pose of an arm with n joints in base axes, one row per set of joint angles.

    joint: positions of the joints (rows, n, 3) [m]; axis: axes of the joints (rows, n, 3); link:
    axes of each link as columns (rows, n, 3, 3); tip: origin of the end effector E (rows, 3) [m];
    frame: axes of E as columns (rows, 3, 3).
    """

    joint: Array
    axis: Array
    link: Array
    tip: Array
    frame: Array


def arm_of(result: Result) -> Arm:
    """Return the arm that the parameters of the servicer describe. The radius r of a link is the
    radius of the uniform cylinder with its mass m and its least moment of inertia m r^2/2.
    """
    count, axis, offset, tip, q, mass, inertia = (result.parameter(name) for name in ARM)
    n = int(count)
    frame = turned(np.tile(q, (3, 1)), np.eye(3)).T
    return Arm(axis[:n], offset[:n], tip, frame, np.sqrt(2 * inertia[:n].min(axis=1) / mass[:n]))


def rotations(axis: Array, angle: Array) -> Array:
    """Return the matrices (rows, 3, 3) that turn vectors about a unit axis (3,) by angles (rows,)
    [rad], by the formula of Rodrigues.
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
    """Return the Jacobian J_m (rows, 6, n): the velocity and angular velocity of the end effector E
    relative to the base are J_m times the joint rates.
    """
    lever = at.tip[:, None] - at.joint
    return np.concatenate([np.cross(at.axis, lever), at.axis], axis=2).transpose(0, 2, 1)
