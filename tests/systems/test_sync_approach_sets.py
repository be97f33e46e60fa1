# SPDX-License-Identifier: BSD-2-Clause
"""Parameter sets and variants of sync_approach: they run and do what their names state."""

from __future__ import annotations

import numpy as np
import pytest

from harness.results.requirements import findings
from harness.results.verdict import Verdict

from .sync_case import PAPER, STEP, Case, recording

TRUE_MASS, START_MASS = 100, 95
J_S = np.diag([200, 250, 150])
TRUE_ETA = np.array([200, 0, 0, 250, 0, 150, 12, 0, 0, 15, 0, 10])
START_ETA = np.array([180, 0, 0, 240, 0, 160, 14, 0, 0, 16, 0, 12])
GAMMA_ETA = 400 * np.array([200, 10, 10, 200, 10, 200, 10, 5, 5, 10, 4, 4])
K_RHO, P_RHO, GAMMA_M, K_ATT, P_ATT = 2e-3, 5e-2, 10, 2, 10


def attitude_error(result) -> np.ndarray:
    """deg"""
    return np.degrees(4 * np.arctan(np.linalg.norm(result["controller.epsilon"], axis=1)))


def position_error(result) -> np.ndarray:
    return np.linalg.norm(result["controller.e1_H"], axis=1)


def square(x: np.ndarray) -> np.ndarray:
    return (x**2).sum(axis=1)


# ---- undisturbed: the conditions of the stability proof


def dissipation(V: np.ndarray, rate: np.ndarray) -> tuple[float, float]:
    """Largest increase of V from sample to sample; error of V(0) - V(t) = integral of the rate,
    relative to V(0).
    """
    lost = STEP * np.concatenate(([0.0], np.cumsum(rate[:-1])))
    return np.diff(V).max(), np.abs(V[0] - V - lost).max() / V[0]


def at_samples(result, *names: str) -> list[np.ndarray]:
    """Errors computed at a sample are in the row after it, with the estimates that follow from
    them.
    """
    return [result[name][:-1] if name.endswith("_hat") else result[name][1:] for name in names]


def test_lyapunov_function_of_the_position_falls_as_proved():
    """(13), (14) with V' = -m_hat P e2.e2; the hold of the force costs about P h/2 = 0.25 %
    (measured: 0.3 %).
    """
    names = (f"controller.{x}" for x in ("e1_H", "e2_H", "m_hat"))
    e1, e2, m_hat = at_samples(recording(PAPER, params="undisturbed"), *names)
    V = TRUE_MASS / 2 * (K_RHO * square(e1) + square(e2)) + (TRUE_MASS - m_hat) ** 2 / (2 * GAMMA_M)
    increase, imbalance = dissipation(V, m_hat * P_RHO * square(e2))
    assert increase < 0
    assert imbalance < 0.01


def test_lyapunov_function_of_the_attitude_falls_as_proved():
    """(20), (21) with V' = -P dw.dw, J and A unknown. Hold: P h/(2 J) = 0.3 %; measured 0.2 % of
    V(1200 s).
    """
    names = (f"controller.{x}" for x in ("epsilon", "domega_S", "eta_hat"))
    epsilon, dw, eta_hat = (
        x[12000:] for x in at_samples(recording(PAPER, params="undisturbed"), *names)
    )
    kinetic = np.einsum("ki,ij,kj->k", dw, J_S, dw)
    V = (
        K_ATT * square(epsilon) + kinetic + ((TRUE_ETA - eta_hat) ** 2 / GAMMA_ETA).sum(axis=1)
    ) / 2
    increase, imbalance = dissipation(V, P_ATT * square(dw))
    assert increase < 0
    assert imbalance < 0.01


def test_without_disturbances_the_safe_distance_is_retained_but_the_error_stays():
    """It is the disturbance that brings the servicer 2.6 mm too close; the offset by the mass error
    remains without it: m_hat K e1 = (m - m_hat) Psi in the limit set (docs/models.md A.5.1)."""
    result = recording(PAPER, params="undisturbed")
    assert result["guidance.range"].min() > 4
    late = position_error(result)[-1]
    assert late == pytest.approx(0.011, abs=5e-4)
    Psi = (
        -result["controller.F_cmd_H"][-1] / result["controller.m_hat"][-1]
        - K_RHO * result["controller.e1_H"][-1]
    )
    mass_error = TRUE_MASS / result["controller.m_hat"][-1] - 1
    assert late == pytest.approx(mass_error * np.linalg.norm(Psi) / K_RHO, rel=0.1)


# ---- clear: the reference ends outside the safe distance


def test_the_clear_set_meets_every_requirement_and_the_case_of_the_paper_does_not():
    """The reference ends at 4.1 m; the servicer is never more than 1 cm closer."""
    clear, paper = recording(PAPER, params="clear"), recording(PAPER)
    assert {f.verdict for f in findings(clear)} == {Verdict.MET}
    assert 4.09 < clear["guidance.range"].min() < 4.1
    missed = {f.name for f in findings(paper) if f.verdict is Verdict.NOT_MET}
    assert missed == {"distance", "attitude"}
    assert 3.99 < paper["guidance.range"].min() < 4


# ---- informed: what the model knowledge costs


def test_informed_set_does_not_adapt():
    result = recording(PAPER, params="informed")
    assert (result["controller.m_hat"] == TRUE_MASS).all()
    assert (result["controller.eta_hat"] == TRUE_ETA).all()


def test_knowledge_of_mass_and_inertia_makes_every_error_smaller():
    default, informed = recording(PAPER), recording(PAPER, params="informed")
    assert position_error(informed)[6000:].max() < 0.5 * position_error(default)[6000:].max()
    assert attitude_error(informed)[-1000:].max() < 0.1 * attitude_error(default)[-1000:].max()


NOTHING_UNKNOWN = {"servicer.M_dist_S.amplitude": [0, 0, 0], "servicer.a_dist.bias": [0, 0, 0]}
UNKNOWNS = {
    "torque on the target": {"guidance.know_M_dist": 0},
    "acceleration of the servicer": {"servicer.a_dist.bias": [1.8e-5, -2.0e-5, -1.5e-5]},
    "mass": {"controller.m_hat_0": START_MASS, "controller.Gamma_m": GAMMA_M},
}


def final_position_error(name: str, changes) -> float:
    return position_error(recording(Case(name, PAPER.stop, changes), params="informed"))[-1]


def test_with_nothing_unknown_the_position_error_vanishes():
    """The software takes the orbit for Keplerian; J2 turns the Hill frame by 1e-6 rad/s more
    (docs/models.md A.4.1).
    """
    assert final_position_error("nothing unknown", NOTHING_UNKNOWN) < 1e-4


@pytest.mark.parametrize("name", UNKNOWNS)
def test_everything_unknown_costs_its_centimetre(name):
    """Acceleration over K_rho: 6e-6 rad/s2 x 4 m, 3e-5 m/s2, and 5 % of Psi = 4e-4 m/s2."""
    assert 0.008 < final_position_error(name, NOTHING_UNKNOWN | UNKNOWNS[name]) < 0.02


# ---- robust: estimates in known ranges, slower adaptation


def test_robust_set_retains_its_estimates_in_their_ranges():
    result = recording(PAPER, params="robust")
    space = np.where(START_ETA > 0, 0.3 * START_ETA, [20] * 6 + [2] * 6)
    rounding = 1 + 1e-12
    assert (np.abs(result["controller.m_hat"] - START_MASS) <= 0.3 * START_MASS * rounding).all()
    assert (np.abs(result["controller.eta_hat"] - START_ETA) <= space * rounding).all()


def test_default_set_leaves_the_ranges_of_the_robust_one():
    """A13 and A23 wander to -3.9 and -4.7 kg m2: the projection has something to do."""
    assert (recording(PAPER)["controller.eta_hat"][-1, [8, 10]] < -2).all()


def test_robust_set_tracks_better_than_the_default():
    default, robust = (
        attitude_error(recording(PAPER, params=name)) for name in ("default", "robust")
    )
    assert robust[-1000:].max() < 0.6 * default[-1000:].max()


# ---- how much adaptation is good for the attitude

VARIANTS = {
    "paper": ({}, 6.10),
    "no adaptation": ({"controller.Gamma_scale": 0}, 2.38),
    "a tenth of Gamma": ({"controller.Gamma_scale": 0.1}, 2.28),
    "projection": ({"controller.projection": 1}, 2.81),
    "true inertias": (
        {"controller.Gamma_scale": 0, "controller.eta_hat_0": TRUE_ETA.tolist()},
        0.35,
    ),
}


@pytest.mark.parametrize("name", VARIANTS)
def test_attitude_error_at_the_end_matches_an_independent_program(name):
    """Computed once by a program in Python that shares nothing with this repository; to its printed
    digits [deg].
    """
    changes, expected = VARIANTS[name]
    result = recording(Case(name, PAPER.stop, changes))
    assert attitude_error(result)[-1] == pytest.approx(expected, abs=0.006)
