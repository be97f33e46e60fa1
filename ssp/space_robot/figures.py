# SPDX-License-Identifier: BSD-2-Clause
"""Figures of the space robot: pitch motion with Poincare section and spectrum, attitude, joints,
momentum, energy.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from harness.figures.style import MANY, legend_above
from harness.mission.figure import Axes, Colour, Curve, Drawing, Figure, Overlay, Panel
from harness.results.result import Result

from .pitch import ANOMALY, PITCH, RATE, orbits, spectrum, strobe

JOINTS = ("joint 1", "joint 2")
FASTEST = 5.0
"""Largest frequency of the drawn spectrum [1/orbit]."""


def _section_and_spectrum(canvas: Axes, result: Result) -> None:
    """Draw the Poincare section (one point per orbit) and the spectrum of the pitch."""
    section, lines = canvas.add_subplot(1, 2, 1), canvas.add_subplot(1, 2, 2)
    pitch, rate = strobe(result)
    section.plot(np.degrees(pitch), rate, ".", markersize=4)
    section.set(
        xlabel="pitch [deg]",
        ylabel="d pitch / d true anomaly",
        title=f"{len(pitch)} points",
    )
    frequency, amplitude = spectrum(result)
    shown = (frequency > 0) & (frequency <= FASTEST)
    lines.semilogy(frequency[shown], np.degrees(amplitude[shown]), linewidth=1)
    lines.set(xlabel="frequency [1/orbit]", ylabel="amplitude [deg]", title="Hann window")


ECCENTRICITY = "robot.e"


def _sections(canvas: Axes, results: Mapping[str, Result], colours: Mapping[str, Colour]) -> None:
    """Draw the Poincare sections of all runs together, and the pitch at their points against the
    eccentricity of the run (bifurcation diagram).
    """
    section, diagram = canvas.add_subplot(1, 2, 1), canvas.add_subplot(1, 2, 2)
    for label, result in results.items():
        pitch, rate = strobe(result)
        eccentricity = np.full_like(pitch, result.parameter(ECCENTRICITY))
        section.plot(np.degrees(pitch), rate, ".", markersize=2, color=colours[label], label=label)
        diagram.plot(eccentricity, np.degrees(pitch), ".", markersize=2, color=colours[label])
    section.set(xlabel="pitch [deg]", ylabel="d pitch / d true anomaly")
    diagram.set(xlabel="eccentricity", ylabel="pitch [deg]")
    if len(results) < MANY:
        legend_above(section)


FIGURES: tuple[Figure | Drawing, ...] = (
    Figure(
        "pitch",
        "Pitch, from the radial direction to x of the base",
        (
            Panel("angle [deg]", (Curve("degrees(robot.pitch)"),)),
            Panel("rate [deg/s]", (Curve("degrees(robot.pitch_rate)"),)),
        ),
    ),
    Drawing(
        "poincare",
        "Pitch at the true anomaly of the start, once per orbit, and its spectrum",
        (PITCH, RATE, ANOMALY),
        _section_and_spectrum,
        shows=lambda result: orbits(result) > 1,
    ),
    Figure(
        "attitude",
        "Attitude relative to the orbital frame (turned about x, then z, then y)",
        (Panel("angle [deg]", (Curve("degrees(robot.euler)"),)),),
    ),
    Figure(
        "joints",
        "Joints",
        (
            Panel("angle [deg]", (Curve("degrees(robot.joint_angle)", labels=JOINTS),)),
            Panel("rate [deg/s]", (Curve("degrees(robot.joint_rate)", labels=JOINTS),)),
            Panel("torque [N m]", (Curve("joints.joint_torque", labels=JOINTS),)),
            Panel("torque of the lock [N m]", (Curve("robot.lock_torque", labels=JOINTS),)),
        ),
    ),
    Figure(
        "momentum",
        "Angular momentum about the centre of mass and energy",
        (
            Panel("h, N axes [N m s]", (Curve("robot.h_N"),)),
            Panel(
                "[J]",
                (
                    Curve("robot.kinetic_energy", "kinetic"),
                    Curve("robot.potential_energy", "potential"),
                ),
            ),
        ),
    ),
)
OVERLAYS: tuple[Figure | Overlay, ...] = (
    Overlay(
        "compared_sections",
        "Pitch at the true anomaly of the start, once per orbit",
        (PITCH, RATE, ANOMALY),
        _sections,
        parameters=(ECCENTRICITY,),
    ),
)
