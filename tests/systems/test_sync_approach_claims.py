# SPDX-License-Identifier: BSD-2-Clause
"""Claims of Zhu & Yang 2009: verdict, our value, and the same value from the independent
program.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from harness.mission import Verdict
from harness.results.result import Result
from harness.system.values import expand
from ssp.sync_approach.claims import PAPER as ZHU_YANG_2009

from .sync_case import PAPER, recording, reference_run

REPRODUCED, PARTLY, NOT = Verdict.REPRODUCED, Verdict.PARTLY, Verdict.NOT_REPRODUCED

VERDICTS = {
    # "the range shrinks ... and is then maintained": within m of rho_M after 20 min
    "arrival": (REPRODUCED, 0.0217, 0.001),
    # "the whole simulation satisfies the requirement of the safe distance": mm below rho_M
    "safe distance": (PARTLY, 2.6, 0.1),
    # "beta_t -> 0": deg after 10 min
    "grasp axis": (REPRODUCED, 0.43, 0.01),
    # "effective tracking can be realised": m after 10 min
    "position tracking": (REPRODUCED, 0.0338, 0.0005),
    # "continuous thrust": largest change, % of the peak per second
    "continuous thrust": (REPRODUCED, 2.73, 0.02),
    # "the estimated mass converges to a steady value ...": kg in the last 10 min
    "mass settles": (REPRODUCED, 1e-4, 5e-5),
    # "... but not the true one": kg
    "mass is not the truth": (REPRODUCED, 5.018, 0.001),
    # "(12) guarantees uniform asymptotic stability": error of the last 10 min over the error of the
    # 10 min before
    "position law is asymptotically stable": (NOT, 1.01, 0.01),
    # "effective tracking can be realised": deg in the last 100 s
    "attitude tracking": (PARTLY, 6.17, 0.02),
    # figure 10: rad/s
    "wheel speeds": (REPRODUCED, 0.326, 0.001),
    # "all inertia estimates converge to a steady value ...": % in the last 100 s
    "inertias settle": (NOT, 5.67, 0.05),
    # "... (not the true one)": %
    "inertias are not the truth": (REPRODUCED, 31.7, 0.2),
    # "(19) guarantees uniform asymptotic stability": error of the last 100 s over the error of the
    # 100 s before
    "attitude law is asymptotically stable": (NOT, 1.43, 0.02),
    # "after the attitude error has converged to the permitted range, grasping is possible at any
    # time": % of 200 s
    "grasp": (PARTLY, 76.7, 0.5),
}
CLAIMS = {claim.name: claim for claim in ZHU_YANG_2009.claims}


@cache
def reference_result() -> Result:
    """The history of the independent program in the form of a result."""
    history = {name: values for name, values in reference_run(PAPER).items() if name != "time"}
    columns = [
        column for name, values in history.items() for column in expand(name, values[0].tolist())
    ]
    table = np.hstack([values.reshape(len(values), -1) for values in history.values()])
    return Result(
        "reference", reference_run(PAPER)["time"], tuple(columns), ("",) * len(columns), table
    )


def test_every_claim_is_tested():
    assert list(VERDICTS) == list(CLAIMS)


@pytest.mark.parametrize("name", VERDICTS)
def test_claim(name):
    """Verdict, and our value within a band around the known value."""
    verdict, expected, band = VERDICTS[name]
    claim = CLAIMS[name]
    value = claim.numbers(recording(PAPER))[0]
    assert claim.evaluate(recording(PAPER)).verdict is verdict, (
        f"{claim.text}: {value} {claim.unit}"
    )
    assert value == pytest.approx(expected, abs=band)


@pytest.mark.long
@pytest.mark.parametrize("name", VERDICTS)
def test_the_independent_program_computes_the_same_values(name):
    """1e-5: positions agree within 1e-7 m, of which centimetres and the 9e-5 kg of the mass
    estimate are evaluated.
    """
    claim = CLAIMS[name]
    ours, theirs = claim.numbers(recording(PAPER)), claim.numbers(reference_result())
    assert ours == pytest.approx(theirs, rel=1e-5)
    assert claim.verdict(ours[0]) is claim.verdict(theirs[0])


# ---- values along the way, computed once by a program that shares nothing with this repository

RANGE = {0: 20.0, 600: 4.1181, 1200: 4.0169, 1800: 4.0206}
POSITION_ERROR = {300: 0.0219, 600: 0.0135, 900: 0.0188, 1200: 0.0280, 1800: 0.0320}
ATTITUDE_ERROR = {1200: 155.2, 1260: 84.6, 1320: 49.9, 1500: 16.7, 1800: 6.10}


def row(time: float) -> int:
    return round(time / 0.1)


@pytest.mark.parametrize("time", RANGE)
def test_range(time):
    assert recording(PAPER)["guidance.range"][row(time)] == pytest.approx(RANGE[time], abs=1e-4)


@pytest.mark.parametrize("time", POSITION_ERROR)
def test_position_error(time):
    error = np.linalg.norm(recording(PAPER)["controller.e1_H"][row(time)])
    assert error == pytest.approx(POSITION_ERROR[time], abs=1e-4)


@pytest.mark.parametrize("time", ATTITUDE_ERROR)
def test_attitude_error(time):
    """The row at 1200 s was computed at 1199.9 s, hence one digit less."""
    error = np.degrees(
        4 * np.arctan(np.linalg.norm(recording(PAPER)["controller.epsilon"][row(time)]))
    )
    assert error == pytest.approx(ATTITUDE_ERROR[time], abs=0.1)


def test_force_and_mass_estimate():
    result = recording(PAPER)
    assert np.linalg.norm(result["controller.F_cmd_S"][0]) == pytest.approx(1.0046, abs=1e-4)
    assert result["controller.m_hat"][-1] == pytest.approx(94.98236, abs=1e-5)
