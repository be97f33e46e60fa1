# SPDX-License-Identifier: BSD-2-Clause
"""Effects of the macro step, the order of execution and latencies on sync_approach, against theory.

The case is the gyroscopic one with attitude control from the start: every wire carries something
that changes.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from harness.master.isolated import simulate

from ..reference import adaptive, closed_loop, guidance, integrate, servicer, target
from .sync_case import GYROSCOPIC, STEP, Case, deviation, recording, reference_system, system

RELEASED = {"servicer.t_att": 0, "servicer.M_dist_S.start": 0, "controller.t_att": 0}
CASE = Case("released", 60.0, GYROSCOPIC.changes | RELEASED)
SOFTWARE = ("guidance", "controller", "propulsion")
PLANTS = ("servicer", "target")

STATES = {
    "servicer.r_SN_N": slice(13, 16),
    "servicer.v_SN_N": slice(16, 19),
    "servicer.q_SN": slice(19, 23),
    "servicer.omega_SN_S": slice(23, 26),
    "servicer.wheel_speed": slice(26, 29),
    "controller.m_hat": slice(30, 31),
    "controller.eta_hat": slice(31, 43),
}
"""Places in the state of the continuous loop; the target is not part of the loop."""


def at_step(h: float) -> Case:
    """The case with sample period and internal steps equal to the macro step."""
    names = (
        "guidance.sample_period",
        "controller.sample_period",
        *(f"{c}.max_step" for c in (*PLANTS, "propulsion")),
    )
    return Case(f"step {h}", CASE.stop, CASE.changes | dict.fromkeys(names, h))


@cache
def final_state(h: float, algorithm: str) -> dict[str, np.ndarray]:
    result = recording(at_step(h), step=h, algorithm=algorithm)
    return {name: np.atleast_1d(result[name][-1]) for name in STATES}


def differences(a: dict[str, np.ndarray], b: dict[str, np.ndarray]) -> np.ndarray:
    """Size of the difference, one number per state."""
    return np.array([deviation(name, a[name][None], b[name][None])[0] for name in STATES])


# ---- theory


@cache
def continuous_loop() -> dict[str, np.ndarray]:
    """Final state with software that computes all the time: RK4 at 0.25 s, error (0.4/s x 0.25 s)^4
    x 1e-3.
    """
    s = reference_system(CASE)

    def rate(t, y):
        yT, yS, x = y[:13], y[13:30], adaptive.Estimate(y[30], y[31:])
        _, command, _, later = closed_loop.software(
            t, yT, yS, None, x, s, 1.0
        )  # estimates one explicit second later
        dT, dS = (
            target.rhs(t, yT, s.target, target.Input()),
            servicer.rhs(t, yS, s.servicer, held(command), True),
        )
        return np.concatenate((dT, dS, [later.m_hat - x.m_hat], later.eta_hat - x.eta_hat))

    y = np.concatenate(start(s))
    for k in range(round(CASE.stop / 0.25)):
        y = integrate.rk4_step(rate, y, 0.25 * k, 0.25)
    y[STATES["servicer.q_SN"]] /= np.linalg.norm(y[STATES["servicer.q_SN"]])
    return {name: y[place] for name, place in STATES.items()}


def start(s: closed_loop.System) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    x = adaptive.initial_estimate(s.controller)
    return (
        target.initial_state(s.target),
        servicer.initial_state(s.servicer),
        np.array([x.m_hat, *x.eta_hat]),
    )


def held(forces, wheels=None) -> servicer.Input:
    """Input of the servicer: forces of one command, wheel acceleration of the same or another."""
    wheel_accel = (wheels or forces)["wheel_accel_cmd"]
    return servicer.Input(F_S=forces["F_cmd_S"], M_S=forces["M_cmd_S"], wheel_accel_cmd=wheel_accel)


@cache
def delayed_program() -> dict[str, np.ndarray]:
    """History with the value of the previous step on every wire: reference, command and force come
    late.
    """
    s, h = reference_system(CASE), STEP
    yT, yS, _ = start(s)
    x = adaptive.initial_estimate(s.controller)
    ref, command, guard, _ = closed_loop.software(0.0, yT, yS, None, x, s, h)
    forces, rec = command, closed_loop.Recorder()
    for k in range(round(CASE.stop / h)):
        t, T, S = k * h, target.body(yT), servicer.body(yS)
        wheel_speed = servicer.outputs(t, yS, s.servicer)["wheel_speed"]
        next_ref, guard = guidance.sample(t, T, S, s.guidance, guard)
        next_command, x = adaptive.sample(t, T, S, wheel_speed, ref, x, s.controller, h)
        yS, yT = (
            servicer.step(s.servicer, yS, t, t + h, held(forces, command)),
            target.step(s.target, yT, t, t + h),
        )
        ref, forces, command = next_ref, command, next_command
        rec.add("servicer", servicer.outputs(t + h, yS, s.servicer))
        rec.add("target", target.outputs(yT, s.target))
        rec.add("controller", {"m_hat": x.m_hat, "eta_hat": x.eta_hat})
    return rec.history(h)


# ---- size of the macro step


@pytest.mark.parametrize(
    "algorithm", ["gauss-seidel", pytest.param("jacobi", marks=pytest.mark.long)]
)
def test_half_the_macro_step_halves_the_distance_to_the_continuous_loop(algorithm):
    """A hold is half a step late: the error is of first order. Second order shows as (0.4/s x 0.05
    s) x a few.
    """
    exact = continuous_loop()
    coarse, fine = (differences(final_state(h, algorithm), exact) for h in (0.05, 0.025))
    assert coarse / fine == pytest.approx(2, rel=0.05)


def test_half_the_macro_step_halves_the_difference_between_the_algorithms():
    coarse, fine = (
        differences(final_state(h, "jacobi"), final_state(h, "gauss-seidel")) for h in (0.05, 0.025)
    )
    assert coarse / fine == pytest.approx(2, rel=0.05)


def test_smaller_macro_steps_leave_sampled_software_and_plants_as_they_are():
    """The software decides on its own grid and the plants integrate on theirs: same bits at every
    sample.
    """
    fine_grid = Case(
        "fine", CASE.stop, CASE.changes | {f"{name}.max_step": 0.05 for name in PLANTS}
    )
    coarse, fine = recording(fine_grid), recording(fine_grid, step=0.05)
    assert set(coarse.columns) == set(fine.columns)
    for name in coarse.vectors:
        if not name.startswith("propulsion"):  # sums of half steps round differently
            assert fine[name][::2].tobytes() == coarse[name].tobytes(), name


@pytest.mark.parametrize(("period", "tolerance"), [(0.2, 0), (0.0, 1e-12)])
def test_software_sampled_every_other_step_may_as_well_be_called_every_other_step(
    period, tolerance
):
    """With a period of its own: same bits. With none it takes the time of the call, a sum t + h
    that is rounded.
    """
    sampled = recording(with_period(0.2))
    with system(with_period(period)) as changed:
        components = [
            replace(c, every=2) if c.name in SOFTWARE[:2] else c for c in changed.components
        ]
        called = simulate(replace(changed, components=tuple(components)))
    difference = np.abs(called.values - sampled.values).max(axis=0)
    assert (difference <= tolerance * np.abs(sampled.values).max(axis=0)).all()


def with_period(period: float) -> Case:
    names = (f"{name}.sample_period" for name in SOFTWARE[:2])
    return Case(f"period {period}", CASE.stop, CASE.changes | dict.fromkeys(names, period))


# ---- latency


def test_jacobi_is_the_system_with_one_step_of_delay_in_every_wire():
    """Tolerances as for Gauss-Seidel in test_sync_approach."""
    result, expected = recording(CASE, algorithm="jacobi"), delayed_program()
    tolerance = {"servicer.r_SN_N": 3e-6, "servicer.v_SN_N": 2e-8, "controller.m_hat": 1e-8}
    for name in expected.keys() & result.vectors.keys():
        ours = result[name][1:]
        worst = deviation(name, ours, expected[name]).max()
        assert worst < tolerance.get(name, 1e-8 * np.abs(expected[name]).max()), name


def test_jacobi_is_gauss_seidel_with_a_latency_of_one_step_in_all_software_and_actuators():
    """To the bit for the plants; late components publish, and are recorded, one row later."""
    with system(CASE) as changed:
        components = [replace(c, latency=int(c.name in SOFTWARE)) for c in changed.components]
        late = simulate(replace(changed, components=tuple(components)))
    jacobi = recording(CASE, algorithm="jacobi")
    for name in jacobi.vectors:
        ours, expected = late[name], jacobi[name]
        if name.startswith(SOFTWARE):
            ours, expected = ours[1:], expected[:-1]
        assert ours.tobytes() == expected.tobytes(), name


def test_latency_of_the_software_costs_accuracy():
    """Jacobi is later than Gauss-Seidel by two steps in the force and by one in wheels and
    reference.
    """
    exact = continuous_loop()
    early, late = (
        differences(final_state(0.05, algorithm), exact) for algorithm in ("gauss-seidel", "jacobi")
    )
    assert (late > early).all()
