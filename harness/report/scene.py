# SPDX-License-Identifier: BSD-2-Clause
"""The replay of a run as data: bodies with their parts, where they are and how they stand at
chosen rows, marks that belong to a body or to a frame.

Positions are relative to the origin of the scene, in N axes; attitudes are quaternions of the body
relative to N, scalar first, v_N = q v_B q*. With the quaternion of the Hill frame the page turns
all of it into H axes. A system is replayed by the first of SCENES that its result fits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.figures.transposition import SHAPE
from harness.report import bodies
from harness.report.arrays import Arrays
from harness.results.derived import SERVICER, TARGET, VELOCITIES, rotation_angle
from harness.results.result import Result

Array = NDArray[np.float64]
Rows = NDArray[np.intp]
Scene = dict[str, Any]

LEAST, MOST = 600, 3000
"""Instants of a replay."""
TURN = np.radians(8)
"""Angle that a body turns between two instants, if MOST allows it."""
IN_ORBIT = 1e6
"""A body farther than that [m] from the origin of N is in orbit, and has a Hill frame."""
HILL = {"key": "H", "name": "Hill frame", "axes": ["radial", "along track", "normal"]}
INERTIAL = {"key": "N", "name": "inertial axes", "axes": ["x N", "y N", "z N"]}


# ---- instants and frames


def instants(result: Result, *attitudes: str) -> Rows:
    """Rows of the replay, equally spaced, so many that turning bodies are followed."""
    turned = [_turned(result[name]) for name in attitudes]
    count = int(np.clip(max(turned, default=0.0) / TURN, LEAST, MOST))
    last = len(result.time) - 1
    return np.unique(np.linspace(0, last, min(count, last + 1)).round().astype(np.intp))


def _turned(q: Array) -> float:
    return float(np.nansum(rotation_angle(q[:-1], q[1:])))


def hill_quaternion(r: Array, v: Array) -> Array:
    """Quaternion (rows, 4) of the Hill frame of an orbit relative to N: x: r, z: r x v."""
    from scipy.spatial.transform import Rotation

    normal = np.cross(r, v)
    axes = np.stack([r, np.cross(normal, r), normal], axis=2)
    axes /= np.linalg.norm(axes, axis=1)[:, None, :]
    return np.asarray(Rotation.from_matrix(axes).as_quat()[:, [3, 0, 1, 2]])


def _in_orbit(r: Array) -> bool:
    return bool(np.linalg.norm(r[0]) > IN_ORBIT)


class Body(NamedTuple):
    """A body of the scene: position and attitude (rows), its parts, bodies that hang on it."""

    name: str
    r: Array
    q: Array
    parts: list[bodies.Part]
    colour: int
    radius: float
    links: tuple[dict[str, Any], ...] = ()
    trail: bool = True
    reach: float = 0.0
    """Distance of its farthest part, if that is beyond the radius of its hull."""


def _scene(arrays: Arrays, time: Array, origin: str, found: list[Body], **about: Any) -> Scene:
    return {
        "time": arrays.keep(time),
        "origin": origin,
        "bodies": [
            {
                **body._asdict(),
                "r": arrays.keep(body.r),
                "q": arrays.keep(body.q),
                "links": list(body.links),
            }
            for body in found
        ],
        **about,
    }


def _frames(arrays: Arrays, r: Array, v: Array, result: Result) -> Scene:
    """Hill frame, the planet and both kinds of axes in orbit; N only in deep space."""
    if not _in_orbit(r):
        return {"frames": [INERTIAL]}
    planet = {"r": arrays.keep(-r), "radius": _radius(result, float(np.linalg.norm(r[0])))}
    hill = arrays.keep(hill_quaternion(r, v))
    return {"frames": [HILL, INERTIAL], "hill": hill, "planet": planet}


EARTH = 6378137.0
"""Equatorial radius of the planet where no parameter says it [m]."""


def _radius(result: Result, distance: float) -> float:
    names = ("target.R_E", "robot.R_E", "monitor.R_E")
    radii = [float(result.parameter(n)) for n in names if result.holds(parameters=(n,))]
    return min([*radii, EARTH][0], 0.99 * distance)


# ---- servicer and target

PAIR = (SERVICER, TARGET, *VELOCITIES, "servicer.q_SN", "target.q_TN")


def pair(result: Result, arrays: Arrays) -> Scene:
    """A servicer about its target."""
    rows = instants(result, "servicer.q_SN", "target.q_TN")
    r, v = result[TARGET][rows], result[VELOCITIES[1]][rows]
    orbit = _in_orbit(r)
    centre = r if orbit else np.zeros_like(r)
    chaser, size = _servicer(result, rows, centre)
    client = _target(result, rows, centre, not orbit)
    return _scene(
        arrays,
        result.time[rows],
        "target" if orbit else "origin of N",
        [chaser, client],
        **_frames(arrays, r, v, result),
        marks=_marks(result, rows, arrays, centre),
        plumes=_plumes(result, rows, arrays, size),
        range=arrays.keep(np.linalg.norm((result[SERVICER] - result[TARGET])[rows], axis=1)),
        speed=arrays.keep(
            np.linalg.norm((result[VELOCITIES[0]] - result[VELOCITIES[1]])[rows], axis=1)
        ),
    )


def _servicer(result: Result, rows: Rows, centre: Array) -> tuple[Body, Array]:
    size, middle = bodies.edges(result, "servicer.mass_0", "servicer.J_S"), np.zeros(3)
    unit = bodies.thrusters(result)
    parts = []
    if unit is not None:
        fitted = np.flatnonzero(unit[2] > 0)
        size, middle = bodies.hull_of(unit[0][fitted])
        parts = [bodies.nozzle(unit[0][k], unit[1][k], 0.08 * size.max()) for k in fitted]
    parts += [bodies.box(size, middle), *bodies.wings(size)]
    if result.holds(parameters=("guidance.rho_M",)):
        face = size[0] / 2 + middle[0]
        reach = float(result.parameter("guidance.rho_M")) - face - _target_face(result)
        parts += bodies.arm(max(reach, 0.2 * face), face, 0.04 * size.max())
    r, q = (result[name][rows] for name in (SERVICER, "servicer.q_SN"))
    return Body("servicer", r - centre, q, parts, 0, float(np.linalg.norm(size) / 2)), size


def _target_size(result: Result) -> Array:
    return bodies.edges(result, "target.mass", "target.J_T")


def _target_face(result: Result) -> float:
    """Distance of the grasp point from the centre of the target [m]."""
    axis, size = _grasp_axis(result), _target_size(result)
    return float(0.5 / np.max(np.abs(axis) / size)) if axis is not None else float(size.max() / 2)


def _grasp_axis(result: Result) -> Array | None:
    if not result.holds(parameters=("guidance.p_T",)):
        return None
    axis = np.asarray(result.parameter("guidance.p_T"))
    return np.asarray(axis / np.linalg.norm(axis))


def _target(result: Result, rows: Rows, centre: Array, trail: bool) -> Body:
    size = _target_size(result)
    parts = [bodies.box(size), *bodies.wings(size)]
    if (axis := _grasp_axis(result)) is not None:
        parts.append(bodies.ring(axis, size, 0.18 * float(size.min())))
    r, q = result[TARGET][rows] - centre, result["target.q_TN"][rows]
    return Body("target", r, q, parts, 1, float(np.linalg.norm(size) / 2), trail=trail)


# ---- marks


def _marks(result: Result, rows: Rows, arrays: Arrays, centre: Array) -> list[Scene]:
    """Zones, corridor, grasp axis, reference position."""
    found = [*_zones(result), *_corridor(result)]
    if (axis := _grasp_axis(result)) is not None:
        length = max(
            _parameter(result, "guidance.rho_0"), 1.5 * _parameter(result, "guidance.rho_f")
        )
        found.append(
            {
                "kind": "axis",
                "on": "target",
                "axis": axis.tolist(),
                "length": length or 10.0,
                "text": _meaning(result, "guidance.p_T"),
            }
        )
    if "guidance.rho_ref_N" in result and result["guidance.rho_ref_N"].any():
        place = (result["guidance.rho_ref_N"] + result[TARGET])[rows] - centre
        text = result.description("guidance.rho_ref_N") or "guidance.rho_ref_N"
        found.append({"kind": "point", "on": "N", "r": arrays.keep(place), "text": text})
    return found


def _zones(result: Result) -> list[Scene]:
    """The keep-out zone of the monitor; without one, the distance that the guidance holds."""
    names = [f"monitor.{n}" for n in ("keep_out_shape", "keep_out_half", "keep_out_axes")]
    if result.holds(parameters=names) and result.parameter(names[0]) > 0:
        shape, half, axes = (result.parameter(name) for name in names)
        kind = "ellipsoid" if shape == 1 else "cuboid"
        on = "target" if axes else "H"
        text = _meaning(result, names[1])
        return [{"kind": kind, "on": on, "half": half.tolist(), "text": text}]
    for name in ("guidance.rho_M", "guidance.rho_f", "guidance.zeta1"):
        if radius := _parameter(result, name):
            text = _meaning(result, name)
            return [{"kind": "ellipsoid", "on": "target", "half": [radius] * 3, "text": text}]
    return []


def _corridor(result: Result) -> list[Scene]:
    """The approach corridor of the monitor: a cone."""
    names = [f"monitor.corridor_{n}" for n in ("axis", "apex", "half_angle", "length", "axes")]
    if not result.holds(parameters=(*names, "monitor.use_corridor")):
        return []
    if not result.parameter("monitor.use_corridor"):
        return []
    axis, apex, angle, length, axes = (result.parameter(name) for name in names)
    farthest = np.linalg.norm(result[SERVICER] - result[TARGET], axis=1).max()
    return [
        {
            "kind": "cone",
            "on": "target" if axes else "H",
            "axis": axis.tolist(),
            "at": apex.tolist(),
            "angle": float(angle),
            "length": float(length or 1.1 * farthest),
            "text": _meaning(result, names[2]),
        }
    ]


def _parameter(result: Result, name: str) -> float:
    return float(result.parameter(name)) if result.holds(parameters=(name,)) else 0.0


def _meaning(result: Result, name: str) -> str:
    text = result.parameters.description(name) if result.parameters else ""
    return f"{name}: {text}" if text else name


# ---- plumes

COMMANDS = ("allocation.throttle", "controller.throttle")
FORCES = ("controller.F_cmd_S", "propulsion.F_S")


def _plumes(result: Result, rows: Rows, arrays: Arrays, size: Array) -> list[Scene]:
    """What the thrusters are commanded, as parts of the nominal thrust; without thrusters the
    commanded force along the body axes, as parts of its largest element.
    """
    unit = bodies.thrusters(result)
    command = next((name for name in COMMANDS if name in result), None)
    if unit is not None and command is not None:
        share = _mean_between(result[command], rows)
        places, directions, nominal = unit
        return [
            _plume(arrays, places[k], directions[k], share[:, k], command)
            for k in np.flatnonzero(nominal > 0)
        ]
    force = next((name for name in FORCES if name in result), None)
    if force is None or not (largest := float(np.nanmax(np.abs(result[force])))):
        return []
    share = _mean_between(result[force], rows) / largest
    return [
        _plume(
            arrays, -side * axis * size / 2, side * axis, np.maximum(side * share[:, k], 0), force
        )
        for k, axis in enumerate(np.eye(3))
        for side in (1, -1)
    ]


def _plume(arrays: Arrays, at: Array, force: Array, share: Array, source: str) -> Scene:
    return {
        "body": "servicer",
        "at": np.asarray(at, dtype=float).tolist(),
        "out": (-np.asarray(force, dtype=float)).tolist(),
        "share": arrays.keep(np.clip(share, 0, 1)),
        "source": source,
    }


def _mean_between(values: Array, rows: Rows) -> Array:
    """Mean of the rows from one instant to the next: a pulse is seen however short it is."""
    counts = np.diff(np.append(rows, len(values)))
    return np.asarray(np.add.reduceat(values, rows, axis=0) / counts[:, None])


# ---- one body with moving parts

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
    return _scene(
        arrays,
        result.time[rows],
        "centre of mass of the base",
        [base],
        **_frames(arrays, r, v, result),
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
    return _scene(
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


# ---- the table


class Kind(NamedTuple):
    """Results that hold these variables and parameters are replayed by this function."""

    needs: tuple[str, ...]
    parameters: tuple[str, ...]
    build: Callable[[Result, Arrays], Scene]


SCENES = (
    Kind(PAIR, (), pair),
    Kind(ROBOT, LINKS, robot),
    Kind(ASSEMBLY, (*SHAPE, "assembly.R_C"), assembly),
)


def replay(result: Result, arrays: Arrays) -> Scene | None:
    """The replay of a result; None if it holds nothing that moves."""
    if len(result.time) < 2:
        return None
    for kind in SCENES:
        if result.holds(*kind.needs, parameters=kind.parameters):
            return kind.build(result, arrays)
    return None


def replay_of_many(results: Mapping[str, Result], arrays: Arrays) -> Scene | None:
    """The servicers of several runs, by label, about the target of the longest one; None if they
    are no such runs. A run that ended early stays where it was.
    """
    moving = {n: r for n, r in results.items() if len(r.time) > 1 and r.holds(*PAIR)}
    if not moving:
        return None
    longest = max(moving.values(), key=lambda result: float(result.time[-1]))
    rows = instants(longest, "target.q_TN")
    time, r, v = longest.time[rows], longest[TARGET][rows], longest[VELOCITIES[1]][rows]
    orbit = _in_orbit(r)
    centre = r if orbit else np.zeros_like(r)
    found, numbers = [], []
    for k, (label, result) in enumerate(moving.items()):
        own = np.minimum(np.searchsorted(result.time, time - INSTANT), len(result.time) - 1)
        body, _ = _servicer(result, own, result[TARGET][own] if orbit else centre)
        found.append(body._replace(name=label, colour=k))
        apart = np.linalg.norm((result[SERVICER] - result[TARGET])[own], axis=1)
        numbers.append({"name": label, "unit": "m", "factor": 1.0, "values": arrays.keep(apart)})
    client = _target(longest, rows, centre, trail=False)._replace(colour=NEUTRAL)
    return _scene(
        arrays,
        time,
        "target" if orbit else "origin of N",
        [*found, client],
        **_frames(arrays, r, v, longest),
        marks=_marks(longest, rows, arrays, centre),
        numbers=numbers,
    )


INSTANT = 1e-6
"""Times closer than this [s] are the same."""
NEUTRAL = 7
"""Colour of what belongs to no run."""
