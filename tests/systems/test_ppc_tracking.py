# SPDX-License-Identifier: BSD-2-Clause
"""The system ppc_tracking: start, the same run as one program, funnel, software periods, exchange
of controllers.

The claims of the paper: test_ppc_claims.py.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from harness import run
from harness.errors import RunError
from tests.each import some

from ..reference import adaptive, ppc, ppc_case
from ..reference.attitude import dcm
from ..reference.los import triad
from .ppc_recordings import (
    BAND,
    after,
    attitude_error,
    deviations,
    los,
    range_error,
    recording,
    settled,
    start,
)

CONTROLLERS = ("ppc_controller", "pid_controller", "theta_d_controller")
FREE = {"controller.a_max": 0, "controller.M_max": [0, 0, 0], "propulsion.M_max": [0, 0, 0]}


# ---- start ----


def test_start_matches_the_scenario():
    """300 m, (2, 32) deg, closing at 10 m/s as seen in N; desired 20 m, (10, 20) deg; attitude 60
    deg off.
    """
    first = recording("ppc_controller")
    q, dq, ref = (los(first, f"guidance.{name}")[0] for name in ("los", "dlos", "los_ref"))
    assert np.max(np.abs(q - (300, np.radians(2), np.radians(32)))) < 1e-8
    assert np.max(np.abs(dq - (-10, 0, 0))) < 1e-10
    assert np.max(np.abs(ref - (20, np.radians(10), np.radians(20)))) < 1e-12
    assert abs(attitude_error(first)[0] - np.pi / 3) < 1e-10
    assert (
        np.max(np.abs(first["controller.q_SD"][0, 1:] - np.array((1, -1, 1)) / np.sqrt(12))) < 1e-10
    )
    _, y_l, z_l = triad(np.radians(10), np.radians(20))
    z_b = dcm(first["target.q_TN"][0])[2]
    assert np.max(np.abs(z_b - np.cos(np.radians(25)) * y_l - np.sin(np.radians(25)) * z_l)) < 1e-12


def test_line_of_sight_retains_far_from_the_poles_and_the_sun():
    for params in ("nominal", "manoeuvre"):
        for controller in CONTROLLERS:
            result = recording(controller, params)
            assert after(result, -1, result["guidance.los.elevation"]) < np.radians(45)
            assert not np.any(result["guidance.attitude_guard"])


# ---- one program ----

SCENARIOS = {"nominal": ppc_case.NOMINAL, "manoeuvre": ppc_case.MANOEUVRE}


def is_state(name):
    return name.startswith(("target.", "servicer.", "guidance.")) and "alpha" not in name


def is_command(name):
    return (
        name.startswith("controller.") and "integral" not in name and not name.endswith("alpha_att")
    )


def assert_same_run(result, expected):
    """States to 1e-9 relative; commands to 1e-7: 1e-9 m of rounding in 7e6 m times the gains and
    the barrier.
    """
    states, commands = (deviations(result, expected, names) for names in (is_state, is_command))
    assert {name: value for name, value in states.items() if value > 1e-9} == {}
    assert {name: value for name, value in commands.items() if value > 1e-7} == {}
    assert len(states) > 15
    assert len(commands) > 5


@pytest.mark.parametrize(("params", "controller"), some(product(SCENARIOS, CONTROLLERS), 2))
def test_the_fmus_run_as_the_monolithic_program_written_from_the_specification(controller, params):
    expected = ppc_case.run(SCENARIOS[params], ppc_case.laws()[controller], stop=25.0)
    assert_same_run(recording(controller, params), expected)


def test_the_literal_law_runs_as_the_monolithic_program():
    s = replace(ppc_case.NOMINAL, period=0.01)
    s = replace(
        s, target=replace(s.target, max_step=0.01), servicer=replace(s.servicer, max_step=0.01)
    )
    expected = ppc_case.run(s, lambda: ppc_case.ppc_law(ppc_case.LITERAL_LAW), stop=6.0)
    assert_same_run(recording("ppc_controller", "literal_law"), expected)


# ---- the funnel ----


def random_start(seed):
    """Inside the funnel with kappa < 1 (rejection), ranges of 60 to 400 m, tens of degrees off,
    moving, turning.
    """
    rng = np.random.default_rng(seed)
    while True:
        q = np.array(
            (
                rng.uniform(60, 400),
                np.radians(rng.uniform(-20, 40)),
                np.radians(rng.uniform(-10, 50)),
            )
        )
        dq = rng.normal(size=3) * (15, 0.05, 0.05)
        x1 = q - (20, np.radians(10), np.radians(20))
        z = x1 + np.array((4.3, 4, 4)) * dq
        theta = z / (600, 0.8, 0.8)
        if (
            np.max(np.abs(theta)) < 0.95
            and 0.1 * np.sum(np.log((1 + theta) / (1 - theta)) ** 2) < 0.95
        ):
            return x1, start(q, dq) | {"servicer.omega_SN_S_0": (0.2 * rng.normal(size=3)).tolist()}


@pytest.mark.parametrize("seed", range(6))
def test_without_saturation_no_state_leaves_its_funnel_from_any_start_inside(seed):
    """kappa < 1 and |theta| < 1 all the time, with the manoeuvring target too; x1 within the bound
    of docs/models.md C.4.
    """
    x1, settings = random_start(seed)
    settings |= FREE | {
        f"{component}.sample_period": 0.01 for component in ("guidance", "controller")
    }
    result = run("ppc_tracking", params="manoeuvre", set=settings, step=0.01, stop=40.0)
    assert result["controller.kappa"].max() < 1
    assert result["controller.kappa_att"].max() < 1
    assert np.abs(result["controller.theta"]).max() < 1
    assert np.abs(result["controller.theta_att"]).max() < 1
    assert not np.any(result["controller.violation"] + result["controller.violation_att"])
    t = np.maximum(result.time - 0.01, 0)[:, None]  # a row holds what the sample before it saw
    alpha_0, alpha_inf, w, beta = (
        np.array((600, 0.8, 0.8)),
        np.array((0.5, 0.03, 0.03)),
        1 / np.array((4.3, 4, 4)),
        0.2,
    )
    fading = np.exp(-w * t)
    bound = (alpha_0 - alpha_inf) * w / (w - beta) * (np.exp(-beta * t) - fading) + alpha_inf * (
        1 - fading
    )
    assert np.all(np.abs(los(result, "controller.error")) <= bound + np.abs(x1) * fading + 1e-9)


@pytest.mark.parametrize("law", [0, 1, 2])
def test_every_gain_law_brings_the_servicer_to_the_hover_point(law):
    """Law 0 with its own constants, law 1 with the same small-signal gain as law 2."""
    literal = recording("ppc_controller", "literal_law")
    result = run("ppc_tracking", set={"controller.law": law}) if law else literal
    assert settled(result, range_error(result), 0.05) < 60
    assert not np.any(result["controller.violation"])


@pytest.mark.parametrize(
    ("q", "dq", "margin"),
    [
        ((300, 0.035, 0.56), (-300, 0, 0), "start_margin"),
        ((300, 1.2, 0.56), (-10, 0, 0), "start_margin"),
    ],
    ids=["too fast", "too far aside"],
)
def test_a_start_outside_the_funnel_ends_the_run_in_its_first_step_with_the_reason(q, dq, margin):
    with pytest.raises(RunError) as rejected:
        run("ppc_tracking", set=start(q, dq))
    assert "controller" in str(rejected.value)
    assert margin in str(rejected.value)
    assert "must be > 0" in str(rejected.value)


# ---- software periods ----


@pytest.mark.parametrize("controller", some(CONTROLLERS, 3))
def test_software_periods_between_10_and_100_ms_run_alike(controller):
    """Convergence within 0.3 s, and ranges that differ in proportion to the period: the error of
    the hold.
    """
    recordings = {ms: recording(controller, f"period_{ms}ms") for ms in (10, 50, 100)}
    ranges = {
        ms: np.linalg.norm(r["servicer.r_SN_N"] - r["target.r_TN_N"], axis=1)
        for ms, r in recordings.items()
    }
    times = [settled(recordings[ms], ranges[ms] - 20, BAND) for ms in ranges]
    assert max(times) - min(times) < 0.3
    near, far = (np.max(np.abs(ranges[ms] - ranges[10][::5])) for ms in (50, 100))
    assert near < 0.6 * far
    assert far < 2.0


def test_reference_and_fmu_agree_on_the_default_parameters():
    """So that the closed loops compared above have the parameters of the specification, not of one
    another.
    """
    result = recording("ppc_controller")
    assert ppc.Ppc().range == ppc.Channel(15, 0.1, 4.3, 600, 0.5, 0.2)
    assert abs(result["controller.alpha.range"][1] - 600) < 1e-12
    assert adaptive.Parameters().m_hat_0 == 95
