# SPDX-License-Identifier: BSD-2-Clause
"""Meanings of metrics of the missions, a sentence each, for readers of a page."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from harness.mission import Metric

MEANINGS = {
    "range settles": "Time after which the range stays within the band about its reference.",
    "position settles": "Time after which the position stays within the band about its reference.",
    "attitude settles": "Time after which the attitude, once free to turn, stays within the band.",
    "range error": "Largest error of the range against its reference in the last fifth of the run.",
    "position error": "Largest distance from the reference position in the last fifth of the run.",
    "attitude error": "Largest angle from the reference, last fifth of the time free to turn.",
    "minimum range": "Smallest distance between the centres of mass of the two bodies.",
    "inside reference": "Largest shortfall of the range against the range of the reference.",
    "estimate error": "Largest error of the estimated relative position, last fifth of the run.",
    "estimate attitude": "Largest error of the target's estimated attitude, last fifth of the run.",
    "estimate NEES": "Mean sum of 12 squared errors over variances; 12 for a consistent filter.",
    "delta-v": "Sum of the impulses of all thrusters or axes over the mass of the servicer.",
    "x optimum": "Impulse of the run over the least impulse that any controller needs.",
    "torque impulse": "Integral of thruster and wheel torques once the attitude is free to turn.",
    "peak force": "Largest force of the actuators.",
    "peak torque": "Largest torque of thrusters and wheels once the attitude is free to turn.",
    "saturated": "Share of the rows in which an actuator, allocation or controller is at a limit.",
    "force at limit": "Share of the run in which the force is at its limit.",
    "torque at limit": "Share of the run in which the torque is at its limit.",
    "thrusters at limit": "Share of the run in which thrusters cannot give the commanded wrench.",
    "wheels at limit": "Share of the run in which a wheel has its largest speed.",
    "panel angle": "Largest angle of a panel.",
    "residual vibration": "Largest angle of a panel in the last fifth of the run.",
    "slosh": "Largest displacement of the propellant in its tank.",
    "elastic energy": "Energy in the springs of panels and propellant at the end of the run.",
    "pitch swing": "Largest minus smallest pitch of the robot.",
    "rotation number": "Poincare points: turns about their centre per orbit; rational: resonance.",
    "saturates at": "Time at which the gyroscopes first cannot absorb the commanded momentum.",
    "peak momentum": "Largest angular momentum of the gyroscopes.",
    "largest rotation": "Largest angle of the assembly from its flight attitude.",
    "tracking error": "Largest angle from the planned attitude.",
    "tip error, aligning and closing": "Largest tip distance from the reference in these modes.",
    "tip error, late": "Rms distance of the tip from its reference, second half of closing.",
    "base attitude, deploying": "Largest angle of the servicer from its reference, arm deploying.",
    "base position, deploying": "Largest distance of servicer off its reference, arm deploying.",
    "miss at the grip": "Distance of the tip from its seat in the fixture when the gripper closes.",
    "grip": "Time at which the gripper closes.",
    "hard capture": "Time at which the mechanism locks.",
    "load of the gripper": "Largest force in the gripper.",
    "captured": "1 if the target is captured and the stack at rest, otherwise 0.",
    "aborted": "1 if the safety monitor ended the approach, otherwise 0.",
    "retreated": "1 if the servicer retreated from the target, otherwise 0.",
    "collided": "1 if the bodies touched anywhere but in the drogue, otherwise 0.",
    "under way": "1 if the mission had not ended, otherwise 0.",
}
"""Meanings of metrics by their names; not every metric has one."""


def explained(metrics: Iterable[Metric]) -> tuple[Metric, ...]:
    """Return metrics with their meanings from MEANINGS; a metric without an entry is unchanged."""
    return tuple(replace(m, meaning=MEANINGS.get(m.name, m.meaning)) for m in metrics)
