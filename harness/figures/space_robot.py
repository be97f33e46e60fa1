"""Figures of the space robot: pitch motion, attitude, joints, momentum and energy."""

from __future__ import annotations

from harness.figures.figure import Curve, Drawing, Figure, Panel, degrees

JOINTS = ("joint 1", "joint 2")

FIGURES: tuple[Figure | Drawing, ...] = (
    Figure(
        "pitch",
        "Pitch, from the radial direction to x of the base",
        (
            Panel("angle [deg]", (Curve("robot.pitch", convert=degrees),)),
            Panel("rate [deg/s]", (Curve("robot.pitch_rate", convert=degrees),)),
        ),
    ),
    Figure(
        "attitude",
        "Attitude relative to the orbital frame (turned about x, then z, then y)",
        (Panel("angle [deg]", (Curve("robot.euler", convert=degrees),)),),
    ),
    Figure(
        "joints",
        "Joints",
        (
            Panel("angle [deg]", (Curve("robot.joint_angle", convert=degrees, labels=JOINTS),)),
            Panel("rate [deg/s]", (Curve("robot.joint_rate", convert=degrees, labels=JOINTS),)),
            Panel("torque [N m]", (Curve("joints.joint_torque", labels=JOINTS),)),
            Panel("torque of the lock [N m]", (Curve("robot.lock_torque", labels=JOINTS),)),
        ),
    ),
    Figure(
        "momentum",
        "Angular momentum about the centre of mass and energy",
        (
            Panel("h, N axes [N m s]", (Curve("robot.h_N"),)),
            Panel("[J]", (Curve("robot.kinetic_energy", "kinetic"), Curve("robot.potential_energy", "potential"))),
        ),
    ),
)
