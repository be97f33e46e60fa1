# SPDX-License-Identifier: BSD-2-Clause
"""Zones, corridor, axes, safety rules and fields of view of an approach, as parts of the 3D replay.

Labels show names and values, tool tips show the parameter.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from harness.report.arrays import Arrays
from harness.results.histories import turned
from harness.results.result import Array, Result, Rows

from .relative_motion import REFERENCE, SERVICER, TARGET
from .safety import FIRST, RESTING, RULES, Rule, findings, limit
from .scene import Scene

DISTANCES = {
    "guidance.rho_M": "safe distance",
    "guidance.rho_f": "hover distance",
    "guidance.zeta1": "distance to reach",
}
"""Parameters with the distance from the target at which the guidance holds the servicer, and their
labels. Without a keep-out zone of the monitor, a sphere is drawn for the first one that is not 0.
"""
HOLDS, VIOLATED = 1, 2
"""States of a safety rule: met or violated; 0: the rule does not apply."""
RESERVE = "monitor.escape_reserve"
PLUS_X = np.array([[1.0, 0.0, 0.0]])


def zones(
    result: Result, rows: Rows, arrays: Arrays, orbit: bool, checked: bool = True
) -> list[Scene]:
    """Return zones, corridor, fields of view, grasp axis and reference position of a run; orbit:
    whether the target is in orbit, so that positions are relative to it; checked: whether zones
    show the state of their safety rule.
    """
    states = _states(result, rows, arrays) if checked else {}
    found = [*_zones(result, states), *_corridor(result, states), *_views(result)]
    if (axis := grasp_axis(result)) is not None:
        length = max(parameter(result, "guidance.rho_0"), 1.5 * parameter(result, "guidance.rho_f"))
        found.append(
            {
                "kind": "axis",
                "on": "target",
                "axis": axis.tolist(),
                "length": length or 10.0,
                "text": "axis of the grasp point",
                "title": meaning(result, "guidance.p_T"),
            }
        )
    if REFERENCE in result and result[REFERENCE].any():
        place = REFERENCE if orbit else f"{REFERENCE} + {TARGET}"
        title = f"{REFERENCE}: {result.description(REFERENCE)}"
        about = {"text": "reference position", "title": title}
        found.append({"kind": "point", "on": "N", "r": arrays.sample(result, rows, place), **about})
    return found


def _zones(result: Result, states: Scene) -> Iterator[Scene]:
    """Yield the keep-out zone of the monitor; without a zone, a sphere about the target, whose
    radius is the distance at which the guidance holds the servicer, if this is not 0.
    """
    names = [f"monitor.{n}" for n in ("keep_out_shape", "keep_out_half", "keep_out_axes")]
    if result.holds(parameters=names) and result.parameter(names[0]) > 0:
        shape, half, axes = (result.parameter(name) for name in names)
        sizes = half[:1] if np.ptp(half) == 0 else half
        yield {
            "kind": "ellipsoid" if shape == 1 else "cuboid",
            "on": "target" if axes else "H",
            "half": half.tolist(),
            "text": f"keep-out zone, {' x '.join(f'{x:g}' for x in sizes)} m",
            "title": meaning(result, names[1]),
            **states.get("keep-out", {}),
        }
        return
    for name, words in DISTANCES.items():
        if radius := parameter(result, name):
            about = {"text": f"{words}, {radius:g} m", "title": meaning(result, name)}
            yield {"kind": "ellipsoid", "on": "target", "half": [radius] * 3, **about}
            return


def _corridor(result: Result, states: Scene) -> Iterator[Scene]:
    """Yield the approach corridor of the monitor, a cone."""
    names = [f"monitor.corridor_{n}" for n in ("axis", "apex", "half_angle", "length", "axes")]
    if not result.holds(parameters=(*names, "monitor.use_corridor")):
        return
    if not result.parameter("monitor.use_corridor"):
        return
    axis, apex, angle, length, axes = (result.parameter(name) for name in names)
    farthest = np.linalg.norm(result[SERVICER] - result[TARGET], axis=1).max()
    yield {
        "kind": "cone",
        "on": "target" if axes else "H",
        "axis": axis.tolist(),
        "at": apex.tolist(),
        "angle": float(angle),
        "length": float(length or 1.1 * farthest),
        "text": f"approach corridor, {np.degrees(angle):.3g} deg to each side",
        "title": meaning(result, names[2]),
        **states.get("corridor", {}),
    }


# ---- rules


def _state(result: Result, rule: Rule, rows: Rows, arrays: Arrays) -> str:
    """Store an array with the state of a rule at the instants of the replay, and return the name of
    the array. Each element is the worst state (VIOLATED, else HOLDS, else 0) from its instant until
    before the next. Once the rule escape is violated, it counts as violated wherever its margin is
    below the larger element of escape_reserve.
    """
    name = rule.history
    bad = f"({name} < 0)"
    if rule.name == "escape" and result.holds("monitor.violated", parameters=(RESERVE,)):
        reserve = float(result.parameter(RESERVE).max())
        bad = f"({name} < {reserve} m) * monitor.violated[{RULES.index(rule) + 1}]"
    text = f"{VIOLATED} * {bad} + {HOLDS} * (1 - {bad}) * ({name} < {RESTING})"
    return arrays.sample(result, rows, text, over="largest")


def _states(result: Result, rows: Rows, arrays: Arrays) -> Scene:
    """Return, by the name of each rule of the monitor, a scene with the entry `state`: the name of
    the array that contains the state of the rule at every instant of the replay.
    """
    known = (rule for rule in RULES if rule.history in result)
    return {rule.name: {"state": _state(result, rule, rows, arrays)} for rule in known}


def rules(result: Result, rows: Rows, arrays: Arrays) -> list[Scene]:
    """Return every rule of the monitor that was in force, with its margin and its first
    violation.
    """
    if FIRST not in result:
        return []
    found = {f.name: f for f in findings(result)}
    return [_rule(result, rule, rows, arrays, found) for rule in RULES if rule.name in found]


def _rule(result: Result, rule: Rule, rows: Rows, arrays: Arrays, found: Scene) -> Scene:
    first = found[rule.name].violated
    return {
        "name": rule.name,
        "unit": rule.unit,
        "title": f"{limit(result, rule)} ({rule.history})",
        "margin": arrays.sample(result, rows, rule.history, over="least"),
        "state": _state(result, rule, rows, arrays),
        "violated": None if np.isnan(first) else float(first),
    }


def overall(label: str, result: Result, rows: Rows, arrays: Arrays) -> list[Scene]:
    """Return a list with one rule that represents all rules of a run, for a replay of several runs.

    The rule is violated where any rule is violated, and its text names the violated one. It does
    not apply where no rule applies. The list is [] if the run has no rules. label: label of the
    run, which is the name of the returned rule.
    """
    if FIRST not in result:
        return []
    found = {f.name: f for f in findings(result)}
    known = [rule for rule in RULES if rule.name in found]
    if not known:
        return []
    states = np.array([arrays.take(_state(result, rule, rows, arrays)) for rule in known])
    first = [found[rule.name].violated for rule in known]
    return [
        {
            "name": label,
            "unit": "",
            "title": ", ".join(rule.name for rule in known),
            "words": [rule.name for rule in known],
            "which": arrays.store(states.argmax(axis=0).astype(float)),
            "state": arrays.store(states.max(axis=0)),
            "violated": None if np.isnan(first).all() else float(np.nanmin(first)),
        }
    ]


# ---- fields of view of sensors

CAMERA = tuple(f"pose_sensor.{name}" for name in ("p_KS_S", "q_KS", "fov", "range_max"))


def sensors(result: Result) -> list[Scene]:
    """Return a list with the camera: its origin and axis on the servicer, and the full angle of its
    field of view [rad]; [] without a camera.
    """
    if not result.holds(parameters=CAMERA):
        return []
    at, q, half, _ = (result.parameter(name) for name in CAMERA)
    axis, up = (turned(q[None], x)[0] for x in (PLUS_X, np.array([[0.0, 0.0, 1.0]])))
    return [
        {
            "body": "servicer",
            "at": at.tolist(),
            "axis": axis.tolist(),
            "up": up.tolist(),
            "field": 2 * float(half),
            "text": "camera",
            "title": f"what the camera sees within {np.degrees(half):.3g} deg of its axis",
        }
    ]


def _views(result: Result) -> Iterator[Scene]:
    """Yield the field of view of the camera as a cone."""
    for sensor in sensors(result):
        reach = np.linalg.norm(result[SERVICER] - result[TARGET], axis=1).max()
        half = sensor["field"] / 2
        yield {
            "kind": "view",
            "on": sensor["body"],
            "axis": sensor["axis"],
            "at": sensor["at"],
            "angle": half,
            "length": float(min(parameter(result, CAMERA[3]) or reach, reach)),
            "text": f"field of view, {np.degrees(half):.3g} deg to each side",
            "title": meaning(result, CAMERA[2]),
        }


# ---- parameters


def grasp_axis(result: Result) -> Array | None:
    """Return the direction of the grasp point, target axes; None if no parameter defines it."""
    if not result.holds(parameters=("guidance.p_T",)):
        return None
    axis = np.asarray(result.parameter("guidance.p_T"))
    return np.asarray(axis / np.linalg.norm(axis))


def parameter(result: Result, name: str) -> float:
    """Return a parameter, 0 if the result lacks it."""
    return float(result.parameter(name)) if result.holds(parameters=(name,)) else 0.0


def meaning(result: Result, name: str) -> str:
    """Return the name and the description of a parameter, for a tool tip."""
    text = result.parameters.description(name) if result.parameters else ""
    return f"{name}: {text}" if text else name
