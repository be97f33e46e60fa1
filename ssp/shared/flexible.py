# SPDX-License-Identifier: BSD-2-Clause
"""Metrics, figures, a note and moving parts of the 3D replay for a servicer with flexible panels
and sloshing propellant. They do not apply to a rigid servicer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from harness.mission import Figure, Metric
from harness.mission.figure import Curve, Panel, degrees
from harness.report.arrays import Arrays
from harness.results.result import Array, Result

from . import bodies

Link = dict[str, Any]

ANGLES, SLOSH = "servicer.panel_angle", "servicer.slosh_displacement"
BEYOND, TRAVEL = "servicer.slosh_beyond_travel", "servicer.slosh_travel"
PLACE = "servicer.r_CS_S"
ENERGIES = tuple(f"servicer.{name}_energy" for name in ("kinetic", "elastic", "dissipated"))
PANELS = tuple(f"servicer.panel_{n}" for n in ("mass", "hinge_S", "arm_S", "axis_S", "inertia"))
MASSES = tuple(f"servicer.slosh_{name}" for name in ("mass_0", "position_S", "axis_S"))

# ---- metrics


METRICS = (
    Metric("panel angle", "mrad", (), f"1000 * max(abs({ANGLES}))"),
    Metric("residual vibration", "mrad", (), f"1000 * steady(time, abs({ANGLES}))"),
    Metric("slosh", "m", (), f"max(abs({SLOSH}))"),
    Metric("elastic energy", "J", (), f"last({ENERGIES[1]})"),
)

# ---- figures

NUMBERS = tuple("1234")


def _chosen(name: str, mass: str) -> Callable[[Result], Array]:
    """Return a function that returns the time series of a vector without the elements of panels or
    slosh masses that do not exist; mass: parameter that is 0 for these.
    """

    def history(result: Result) -> Array:
        exist = result.parameter(mass) > 0 if result.holds(parameters=(mass,)) else slice(None)
        return np.asarray(result[name][:, exist])

    return history


FIGURES = (
    Figure(
        "flexible_parts",
        "Panels and slosh",
        (
            Panel(
                "panel angle [deg]",
                (Curve(_chosen(ANGLES, PANELS[0]), "", degrees, NUMBERS, needs=(ANGLES,)),),
            ),
            Panel(
                "slosh displacement [m]",
                (Curve(_chosen(SLOSH, MASSES[0]), "", None, NUMBERS, needs=(SLOSH,)),),
            ),
        ),
    ),
    Figure(
        "centre_of_mass",
        "Centre of mass of the deformed servicer",
        (Panel("from S, body axes [m]", (Curve(PLACE),)),),
    ),
    Figure(
        "flexible_energies",
        "Energies of panels and slosh",
        (
            Panel("kinetic, about the centre of mass [J]", (Curve(ENERGIES[0], "kinetic"),)),
            Panel(
                "springs and dampers [J]",
                tuple(Curve(name, name.partition(".")[2][:-7]) for name in ENERGIES[1:]),
                log=True,
            ),
        ),
    ),
)

# ---- note


def notes(result: Result) -> Iterator[str]:
    """Yield a line if the propellant has moved beyond the travel that the tank model permits."""
    if BEYOND not in result or not (beyond := result[BEYOND] > 0).any():
        return
    rows = beyond.any(axis=1)
    share, largest = 100 * float(np.mean(rows)), float(np.abs(result[SLOSH][rows]).max())
    yield (
        f"slosh alarm: propellant is beyond servicer.slosh_travel in {share:.2g} % of the rows, "
        f"first at {float(result.time[np.argmax(rows)]):.5g} s, up to {largest:.2g} m: the tank is "
        f"not modelled there, the mass continues to move on its spring"
    )


# ---- replay

THIN = 0.02
"""Least thickness of a drawn panel [m]."""
TANK = 1.15
"""Radius of a drawn tank, less the radius of the drawn slosh mass, divided by the travel of the
mass.
"""


def moves(result: Result) -> bool:
    """Return whether the result has the variables and parameters of a flexible servicer, so that
    the replay can draw panels and slosh masses.
    """
    return result.holds(ANGLES, SLOSH, parameters=(*PANELS, *MASSES))


def links(result: Result, rows: Any, arrays: Arrays) -> tuple[Link, ...]:
    """Return the moving parts of the replay: panels that turn about their hinges, and slosh masses
    that slide along their axes.
    """
    return (*_panels(result, rows, arrays), *_sloshes(result, rows, arrays))


def _panels(result: Result, rows: Any, arrays: Arrays) -> Iterator[Link]:
    mass, hinge, arm, axis, inertia = (result.parameter(name) for name in PANELS)
    angle = arrays.sample(result, rows, ANGLES)
    for k in np.flatnonzero(mass > 0):
        along, about = (v[k] / np.linalg.norm(v[k]) for v in (arm, axis))
        across = np.cross(along, about)
        # edges of a plate of uniform density with the moments of inertia inertia[k]
        squares = 6 * (inertia[k].sum() - 2 * inertia[k]) / mass[k]
        edges = np.sqrt(np.maximum(squares, THIN**2))
        frame = np.column_stack((along, about, across))
        plate = bodies.box(np.abs(frame) @ edges, arm[k], "panel")
        yield {
            "at": hinge[k].tolist(),
            "axis": about.tolist(),
            "angle": angle,
            "index": int(k),
            "parts": [bodies.rod((0, 0, 0), arm[k] - along * edges[0] / 2, 0.02), plate],
        }


def _sloshes(result: Result, rows: Any, arrays: Arrays) -> Iterator[Link]:
    mass, place, axis = (result.parameter(name) for name in MASSES)
    travel = result.parameter(TRAVEL) if result.holds(parameters=(TRAVEL,)) else np.zeros(4)
    shift = arrays.sample(result, rows, SLOSH)
    for j in np.flatnonzero(mass > 0):
        radius = 0.04 * float(np.cbrt(mass[j]))
        at, along = place[j].tolist(), (axis[j] / np.linalg.norm(axis[j])).tolist()
        if travel[j] > 0:
            tank = bodies.ball((0, 0, 0), TANK * float(travel[j]) + radius, "tank")
            yield {"at": at, "axis": along, "parts": [tank]}
        slide = {"slide": shift, "index": int(j)}
        yield {"at": at, "axis": along, **slide, "parts": [bodies.ball((0, 0, 0), radius, "fluid")]}
