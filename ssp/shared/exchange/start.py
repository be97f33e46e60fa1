# SPDX-License-Identifier: BSD-2-Clause
"""Start values of the bodies of a system from orbit files.

A body that has no file, and whose start is given in the Hill frame of the target, follows the
target: it gets the target's orbital elements, while its position in the Hill frame does not change.
Start attitudes, given relative to N, are turned with the Hill frame H of the target, so that they
do not change relative to H, unless `attitude` is N. Angular rates, in body axes, do not change.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import UsageError
from harness.mission import Start
from harness.results.result import Array, Result
from harness.spelling import did_you_mean
from harness.system.instants import epoch_of, start_note, written
from harness.system.model import System

from .bodies import Bodies, sun_direction
from .sources import State, source_of, state_of

ATTITUDE = "attitude"
"""Key of `files` that is not a component: its value is the frame relative to which start attitudes
do not change, H (default) or N.
"""
SAME = 1e-9
"""Angle between the old and the new Hill frame [rad] up to which attitudes are not turned."""


def start_values(
    names: Bodies,
    system: System,
    files: Mapping[str, str | Path],
    epoch: str | None = None,
    **changes: Any,
) -> Start:
    """Return the start values that follow from OEM files or two-line elements, with notes on the
    assumptions and the epoch; see harness.mission.mission.Start.

    files: file of each component, and ATTITUDE; epoch: UTC at t = 0 (None: of the system or of the
    files); changes: options of the simulation of the system, such as `set`. Parameters for the
    direction of the Sun get this direction at the epoch.
    """
    from harness.master.simulation import Simulation

    parameters = Simulation(system, **changes).parameters()
    files = {**system.starts, **files}
    if (frame := files.pop(ATTITUDE, "H")) not in ("H", "N"):
        raise UsageError(f"--start {ATTITUDE}={frame}: expected H (Hill axes) or N (inertial)")
    for component in files:
        _check(component, system, parameters, names)
    sources = {component: source_of(component, file) for component, file in files.items()}
    date = system.experiment.epoch if epoch is None else epoch
    dated = date or epoch is not None or not files
    instant = epoch_of(date) if dated else max(s.first for s in sources.values())
    states = {component: state_of(component, s, instant) for component, s in sources.items()}
    axes = [f"{component}: {Path(s.path).name}, {s.axes}" for component, s in sources.items()]
    values = _orbits(parameters, states, names)
    turned = _turned(parameters, states, names) if frame == "H" else {}
    if turned:
        axes.append(
            "start attitudes turned with the target's Hill frame, so unchanged relative to it: "
            f"{', '.join(turned)} (--start {ATTITUDE}=N: unchanged relative to N)"
        )
    sun, known = _sun(parameters, names.sun, instant)
    return Start(values | turned | sun, (start_note(instant), *axes, *known), written(instant))


def _orbits(parameters: Result, states: Mapping[str, State], names: Bodies) -> dict[str, Any]:
    """Return the parameters with which the bodies of `states` start in their states, and the
    parameters with which bodies without a file follow the target.
    """
    values: dict[str, Any] = {}
    for component, state in states.items():
        values |= {
            f"{component}.{names.semi_major_axis}": 0.0,  # 0: position and velocity are used
            f"{component}.{names.start[0]}": state.r.tolist(),
            f"{component}.{names.start[1]}": state.v.tolist(),
        }
    return values | _beside(parameters, states, names)


def _sun(parameters: Result, name: str, instant: np.datetime64) -> tuple[dict[str, Any], list[str]]:
    """Return the parameters COMPONENT.`name` of all components that have a parameter `name`, set to
    the direction to the Sun at `instant` (UTC at t = 0), and a list with a note about them.
    """
    needing = [n for n in parameters.vectors if name and n.endswith(f".{name}")]
    if not needing:
        return {}, []
    to_sun = sun_direction(np.array([instant]))[0].tolist()
    shown = ", ".join(f"{x:.6f}" for x in to_sun)
    return dict.fromkeys(needing, to_sun), [f"Sun at t = 0: {', '.join(needing)} = [{shown}]"]


def _check(component: str, system: System, parameters: Result, names: Bodies) -> None:
    known = [c.name for c in system.components]
    if component not in known:
        raise UsageError(
            f"--start {component}: {system.name} has no such component"
            f"{did_you_mean(component, known)}"
        )
    for name in (names.semi_major_axis, names.field, *names.start):
        if f"{component}.{name}" not in parameters:
            raise UsageError(f"--start {component}: it has no parameter {name}")


def _beside(parameters: Result, states: Mapping[str, State], names: Bodies) -> dict[str, float]:
    """Return, for all bodies without a file that start in the Hill frame of the target, the orbital
    elements of the target as parameters of these bodies; {} if no target has a file. Raises
    UsageError if there are such bodies and the orbit of the target is open.
    """
    target = _target(parameters, states, names)
    if target is None:
        return {}
    rows = (names.semi_major_axis, *names.elements)
    found: dict[str, float] = {}
    for component in _followers(parameters, states, names):
        orbit = elements(states[target], float(parameters[f"{component}.{names.field}"][0]))
        if not orbit[1] < 1:
            raise UsageError(
                f"--start {target}: its orbit is open (e = {orbit[1]:.6g}), and {component}, which "
                f"starts beside it, needs a closed one; add --start {component}=FILE"
            )
        found |= {f"{component}.{name}": x for name, x in zip(rows, orbit, strict=True)}
    return found


def _target(parameters: Result, states: Mapping[str, State], names: Bodies) -> str | None:
    """Return the target: the first body with an orbit file that has no parameters for a start in
    the Hill frame of another body. Return None if there is none.
    """
    return next((c for c in states if f"{c}.{names.beside[0]}" not in parameters), None)


def _turned(parameters: Result, states: Mapping[str, State], names: Bodies) -> dict[str, Any]:
    """Return the start attitudes of bodies and estimates, turned so that they are the same relative
    to the new Hill frame of the target as before relative to its old one.
    """
    from scipy.spatial.transform import Rotation

    if (target := _target(parameters, states, names)) is None:
        return {}
    new, old = hill_axes(*states[target]), _hill_axes_before(parameters, target, names)
    turn = Rotation.from_matrix(new @ old.T)
    if turn.magnitude() < SAME:
        return {}
    named = re.compile(r"\w+\." + names.attitude_start.format("[A-Z]"))
    found = {
        n: Rotation.from_mrp(np.array(parameters[n][0]))
        for n in parameters.vectors
        if named.fullmatch(n)
    }
    return {name: (turn * attitude).as_mrp().tolist() for name, attitude in found.items()}


def _hill_axes_before(parameters: Result, target: str, names: Bodies) -> Array:
    """Return the matrix (3, 3) with the axes of the Hill frame as columns, in N axes, at the start
    that the parameters of the component `target` describe.
    """
    from scipy.spatial.transform import Rotation

    if parameters[f"{target}.{names.semi_major_axis}"][0] <= 0:
        return hill_axes(*(parameters[f"{target}.{name}"][0] for name in names.start))
    _, inc, argp, raan, nu = (float(parameters[f"{target}.{n}"][0]) for n in names.elements)
    return np.asarray(Rotation.from_euler("ZXZ", [raan, inc, argp + nu]).as_matrix())


def hill_axes(r: Array, v: Array) -> Array:
    """Return the matrix (3, 3) with the axes of the Hill frame at position r and velocity v as
    columns, in N axes.
    """
    normal = np.cross(r, v)
    axes = np.stack([r, np.cross(normal, r), normal], axis=1)
    return np.asarray(axes / np.linalg.norm(axes, axis=0))


def _followers(parameters: Result, states: Mapping[str, State], names: Bodies) -> Iterator[str]:
    """Yield the bodies without a file that start in the Hill frame of another body."""
    ending = f".{names.beside[0]}"
    others = {name.removesuffix(ending) for name in parameters.vectors if name.endswith(ending)}
    for component in sorted(others - states.keys()):
        size = f"{component}.{names.semi_major_axis}"
        # skips estimates, which have no semi-major axis, and bodies in deep space, where it is 0
        if size in parameters and parameters[size][0] > 0:
            yield component


def elements(state: State, mu: float) -> tuple[float, ...]:
    """Return the osculating elements of an orbit about a point mass mu [m3/s2]: semi-major axis
    [m], eccentricity, inclination, argument of perigee, right ascension and true anomaly [rad]. By
    definition the node of an equatorial orbit is on the x axis, and the perigee of a circular orbit
    is at the node.

    Vallado, Fundamentals of Astrodynamics, RV2COE: h = r x v, n = z x h, e = v x h / mu - r / |r|.
    """
    r, v = state
    h = np.cross(r, v)
    node = np.array([-h[1], h[0], 0.0]) if h[:2].any() else np.array([1.0, 0.0, 0.0])
    towards = np.cross(v, h) / mu - r / np.linalg.norm(r)
    perigee = towards if towards.any() else node
    distance = float(np.linalg.norm(r))
    return (
        1 / (2 / distance - float(v @ v) / mu),
        float(np.linalg.norm(towards)),
        float(np.arctan2(np.hypot(h[0], h[1]), h[2])),
        _about(h, node, perigee),
        float(np.arctan2(node[1], node[0])),
        _about(h, perigee, r),
    )


def _about(axis: Array, begin: Array, end: Array) -> float:
    """Return the angle from one vector to another about an axis perpendicular to both [rad]."""
    sine = np.cross(begin, end) @ axis / np.linalg.norm(axis)
    return float(np.arctan2(sine, begin @ end))
