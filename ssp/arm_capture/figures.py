# SPDX-License-Identifier: BSD-2-Clause
"""Figures of the capture by arm: joints, end effector, manipulability, base, momentum, gripper."""

from __future__ import annotations

from harness.mission.figure import Curve, Figure, Panel

JOINTS = tuple(f"joint {k}" for k in range(1, 8))

ARM = (
    Figure(
        "joints",
        "Joints of the arm",
        (
            Panel("angle [deg]", (Curve("degrees(servicer.joint_angle)", labels=JOINTS),)),
            Panel("rate [deg/s]", (Curve("degrees(servicer.joint_rate)", labels=JOINTS),)),
            Panel("torque [N m]", (Curve("arm_controller.joint_torque", labels=JOINTS),)),
            Panel("torque of the lock [N m]", (Curve("servicer.lock_torque", labels=JOINTS),)),
        ),
    ),
    Figure(
        "tip",
        "End effector: error from its reference, and position in axes of the grapple fixture",
        (
            Panel("position error [m]", (Curve("arm_guidance.position_error"),)),
            Panel("angle error [deg]", (Curve("degrees(arm_guidance.angle_error)"),)),
            Panel("position, Q axes [m]", (Curve("arm_guidance.tip_Q"),)),
            Panel("mode", (Curve("arm_guidance.arm_mode"),)),
        ),
    ),
    Figure(
        "manipulability",
        "How far the arm is from singular poses",
        (
            Panel("manipulability", (Curve("arm_guidance.manipulability"),)),
            Panel("damping", (Curve("arm_guidance.damping"),)),
            Panel("scale of the rates", (Curve("arm_guidance.rate_scale"),)),
        ),
    ),
    Figure(
        "base",
        "What the arm does to the base",
        (
            Panel("position error, H axes [m]", (Curve("controller.e1_H"),)),
            Panel("attitude error, MRP", (Curve("controller.epsilon", jump=1.0),)),
            Panel("feed-forward torque [N m]", (Curve("arm_controller.M_ff_S"),)),
            Panel("centre of mass from S [m]", (Curve("servicer.r_CS_S"),)),
        ),
    ),
)
"""Figures of every system with an arm."""
FIGURES = (
    *ARM,
    Figure(
        "momentum",
        "Angular momentum of base, arm and wheels about their centre of mass, and energy",
        (
            Panel("h, N axes [N m s]", (Curve("servicer.h_N"),)),
            Panel("kinetic energy [J]", (Curve("servicer.kinetic_energy"),)),
        ),
    ),
    Figure(
        "grip",
        "Gripper and grapple fixture",
        (
            Panel("phase", (Curve("mechanism.phase"),)),
            Panel("force [N]", (Curve("mechanism.load_force"),)),
            Panel("torque [N m]", (Curve("mechanism.load_moment"),)),
        ),
    ),
)
