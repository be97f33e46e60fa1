# SPDX-License-Identifier: BSD-2-Clause
"""Simulations of published cases (cases/*.json), and the differences between simulated and
published values. Each function of SIMULATIONS takes a case and returns one dictionary for each row
of the case: the simulated values of the quantities that the row names.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from harness.mission.claim import Row
from harness.results.result import Array

from .case import Case
from .library import Instance, Library
from .orbits import angle_between, dcm, eccentricity, node_and_perigee
from .rendezvous import rendezvous

Quantities = dict[str, Array]
Simulation = Callable[[Case, Library], list[Quantities]]
SHORTEST = 1e-9
"""Shortest part of a step [s]; a shorter one is a rounding error and is not taken."""


def simulate(case: Case, library: Library) -> list[Quantities]:
    """Return the simulated values of a case, one dictionary per row."""
    return SIMULATIONS[case.simulation](case, library)


def evaluate(case: Case, library: Library) -> list[Row]:
    """Simulate a case and return one Row per quantity, with the largest difference in all rows."""
    worst = dict.fromkeys(case.tolerance, 0.0)
    for row, ours in zip(case.rows, simulate(case, library), strict=True):
        for name in expected(row):
            worst[name] = float(np.fmax(worst[name], difference(name, ours[name], row[name])))
            if not np.all(np.isfinite(ours[name])):
                worst[name] = np.inf
    return [
        Row(case.id, case.tests, case.source, name, worst[name], limit, case.units[name])
        for name, limit in case.tolerance.items()
    ]


def difference(name: str, ours: Array, theirs: Any) -> float:
    """Return the difference between simulated and published values of a quantity: the Euclidean
    norm; for the matrix C the rotation angle [rad]; for published limits {above, below} the amount
    by which they are violated.
    """
    if isinstance(theirs, Mapping):
        return float(
            max(
                0.0,
                np.max(theirs.get("above", -np.inf) - ours),
                np.max(ours - theirs.get("below", np.inf)),
            )
        )
    if name == "C":
        return angle_between(ours.reshape(3, 3), np.reshape(theirs, (3, 3)))
    return float(np.linalg.norm(ours - np.ravel(theirs)))


# ---- pieces


def advance(unit: Instance, end: float, step: float) -> Iterator[float]:
    """Step an FMU to the time `end` [s] with steps of at most `step` [s], and yield the length of
    each step before it is taken, so that the caller can set inputs.
    """
    while (left := end - unit.time) > SHORTEST:
        h = min(step, left) if left > step * (1 + SHORTEST) else left
        yield h
        unit.step(h)


def held(case: Case, time: float) -> dict[str, Any]:
    """Return the inputs of a case at a time [s], from the last entry of its list `inputs` that has
    begun.
    """
    begun = [piece for piece in case.setup.get("inputs", ()) if piece["from"] <= time + SHORTEST]
    return {name: value for name, value in begun[-1].items() if name != "from"} if begun else {}


def body(unit: Instance) -> str:
    """Return the letter of the body whose state an FMU publishes, T (target) or S (servicer)."""
    return "T" if "r_TN_N" in unit.ports else "S"


def quantity(unit: Instance, name: str) -> Array:
    """Return the output `name` of an FMU as a vector; for the name C, return the direction cosine
    matrix from N to body axes, row by row (9,).
    """
    return dcm(unit.get(f"q_{body(unit)}N")).ravel() if name == "C" else unit.get(name)


def expected(row: Mapping[str, Any]) -> list[str]:
    """Return the names of the quantities of a row: all its keys except the time `t`."""
    return [name for name in row if name != "t"]


# ---- simulations


def held_inputs(case: Case, library: Library) -> list[Quantities]:
    """Return the outputs at the time of each row; inputs of the case are held over each step."""
    unit, answer = library.unit(case.fmu, case.setup["parameters"], held(case, 0)), []
    for row in case.rows:
        for _ in advance(unit, row["t"], case.setup["step"]):
            unit.set(held(case, unit.time))
        answer.append({name: quantity(unit, name) for name in expected(row)})
    return answer


def start(case: Case, library: Library) -> list[Quantities]:
    """Return the outputs after initialisation."""
    unit = library.unit(case.fmu, case.setup["parameters"])
    return [{name: quantity(unit, name) for name in expected(row)} for row in case.rows]


def norms(case: Case, library: Library) -> list[Quantities]:
    """Return the distance from the centre of the Earth [m] and the speed [m/s] at the time of each
    row.
    """
    unit, answer = library.unit(case.fmu, case.setup["parameters"]), []
    for row in case.rows:
        for _ in advance(unit, row["t"], case.setup["step"]):
            pass
        distance, speed = (np.linalg.norm(unit.get(f"{x}_{body(unit)}N_N")) for x in "rv")
        answer.append({"distance": np.array([distance]), "speed": np.array([speed])})
    return answer


def node_rates(case: Case, library: Library) -> list[Quantities]:
    """Return the mean rates of the ascending node and of the perigee, from the osculating elements
    at start and end [deg/h].
    """
    unit = library.unit(case.fmu, case.setup["parameters"])
    mu, end = case.setup["parameters"]["mu"], case.rows[-1]["t"]
    first = node_and_perigee(mu, unit.get("r_TN_N"), unit.get("v_TN_N"))
    for _ in advance(unit, end, case.setup["step"]):
        pass
    last = node_and_perigee(mu, unit.get("r_TN_N"), unit.get("v_TN_N"))
    turn = (np.degrees(last - first) + 180) % 360 - 180
    raan_rate, argp_rate = turn / (end / 3600)
    return [{"raan_rate": np.array([raan_rate]), "argp_rate": np.array([argp_rate])}]


def relative_start(case: Case, library: Library) -> list[Quantities]:
    """Return the outputs of flight software for the states of target and servicer at t = 0. The
    case gives each body's state directly, or as parameters of the body's FMU.
    """
    inputs: dict[str, Any] = {}
    for letter, name in (("T", "target"), ("S", "servicer")):
        r, v = _state(name, letter, case.setup[name], library)
        inputs |= {f"r_{letter}N_N": r, f"v_{letter}N_N": v, f"q_{letter}N": [1, 0, 0, 0]}
        inputs |= {f"omega_{letter}N_{letter}": [0, 0, 0]}
    unit = library.unit(case.fmu, case.setup["parameters"], inputs)
    unit.set({name: np.zeros(3) for name in unit.inputs if name.endswith("rho_ref_N")})
    unit.step(case.setup["step"])
    return [{name: unit.get(name) for name in expected(row)} for row in case.rows]


def _state(name: str, letter: str, given: Mapping[str, Any], library: Library) -> tuple[Any, Any]:
    if "r" in given:
        return given["r"], given["v"]
    unit = library.unit(name, given)
    return unit.get(f"r_{letter}N_N"), unit.get(f"v_{letter}N_N")


def formation(case: Case, library: Library) -> list[Quantities]:
    """Return the relative state in the Hill frame that flight software computes for simulated
    target and servicer. The simulated distance is the published one times `scale`, an entry of the
    case, and the returned values are divided by `scale`.
    """
    scale, answer = case.setup["scale"], []
    small = {name: scale * np.array(case.setup["start"][name]) for name in ("rho_0_H", "drho_0_H")}
    target = library.unit("target", case.setup["parameters"])
    servicer = library.unit("servicer", case.setup["parameters"] | small)
    software = library.unit(case.fmu, {"mu": [case.setup["parameters"]["mu"]]})
    for row in case.rows:
        for unit in (target, servicer):
            for _ in advance(unit, row["t"], case.setup["step"]):
                pass
            software.set({name: unit.get(name) for name in software.inputs & set(unit.ports)})
        software.step(case.setup["step"])
        answer.append({name: software.get(name) / scale for name in expected(row)})
    return answer


def motor_torque(case: Case, library: Library) -> list[Quantities]:
    """Return the outputs of a servicer whose wheels are driven by motor torques u.

    The wheels are commanded with their acceleration dOmega at the middle of each step, from
    A (dOmega + domega) = u,   (J - A) domega = -omega x (J omega + A Omega) - u.
    J: inertia of the servicer with its wheels, A: inertias of the wheels about their axes; omega,
    Omega: angular velocity of the body, wheel speeds; domega, dOmega: their derivatives.
    """
    unit, answer = library.unit(case.fmu, case.setup["parameters"]), []
    J, A = (np.reshape(case.setup["parameters"][name], (3, 3)) for name in ("J_S", "A_w"))
    bare, wheels, u = np.linalg.inv(J - A), np.linalg.inv(A), np.array(case.setup["motor_torque"])

    def rates(omega: Array, speed: Array) -> tuple[Array, Array]:
        domega = bare @ (-np.cross(omega, J @ omega + A @ speed) - u)
        return domega, wheels @ u - domega

    for row in case.rows:
        for h in advance(unit, row["t"], case.setup["step"]):
            omega, speed = unit.get("omega_SN_S"), unit.get("wheel_speed")
            domega, dspeed = rates(omega, speed)
            middle = rates(omega + h / 2 * domega, speed + h / 2 * dspeed)
            unit.set({"wheel_accel_cmd": middle[1]})
        answer.append({name: quantity(unit, name) for name in expected(row)})
    return answer


def thrust_along_velocity(case: Case, library: Library) -> list[Quantities]:
    """Return the outputs of a servicer with thrust along the velocity that it has in the middle of
    each step; its axes stay aligned with N.
    """
    unit, answer = library.unit(case.fmu, case.setup["parameters"]), []
    mu, thrust = case.setup["parameters"]["mu"], case.setup["thrust"]
    for row in case.rows:
        for h in advance(unit, row["t"], case.setup["step"]):
            r, v, mass = (unit.get(name) for name in ("r_SN_N", "v_SN_N", "mass"))
            push = thrust / mass * v / np.linalg.norm(v)
            middle = v + h / 2 * (push - mu * r / np.linalg.norm(r) ** 3)
            F = thrust * middle / np.linalg.norm(middle)
            unit.set({"F_S": F, "mdot": [case.setup["mdot"]]})
        e = eccentricity(mu, unit.get("r_SN_N"), unit.get("v_SN_N"))
        answer.append(
            {name: np.array([e]) if name == "e" else unit.get(name) for name in expected(row)}
        )
    return answer


def steady_filter(case: Case, library: Library) -> list[Quantities]:
    """Return the standard deviations of the attitude filter for a body at rest with a star-tracker
    measurement in every sample: of the attitude before and after the last measurement, and of the
    gyro bias after it.

    The value before the measurement is computed from 1/before^2 = 1/after^2 - 1/star^2 (star:
    standard deviation of the measurement), because the reciprocals of variances add.
    """
    unit = library.unit(case.fmu, case.setup["parameters"])
    star, step = np.array(case.setup["parameters"]["sigma_A"]), case.setup["stars_every"]
    unit.set({"gyro_valid": [1], "star_valid": [1], "q_AN": [1, 0, 0, 0], "dtheta_S": [0, 0, 0]})
    answer = []
    for row in case.rows:
        for _ in advance(unit, row["t"], step):
            unit.set({"star_time": [unit.time], "gyro_time": [unit.time]})
        after = unit.get("sigma_theta_S")
        before = 1 / np.sqrt(1 / after**2 - 1 / star**2)
        bias = unit.get("sigma_bias_S")
        answer.append({"sigma_before": before, "sigma_after": after, "sigma_bias": bias})
    return answer


SIMULATIONS: dict[str, Simulation] = {
    "held_inputs": held_inputs,
    "start": start,
    "norms": norms,
    "node_rates": node_rates,
    "relative_start": relative_start,
    "formation": formation,
    "motor_torque": motor_torque,
    "steady_filter": steady_filter,
    "thrust_along_velocity": thrust_along_velocity,
    "rendezvous": rendezvous,
}
