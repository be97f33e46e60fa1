# SPDX-License-Identifier: BSD-2-Clause
"""harness report for runs of space_robot: the claims that belong to its eccentricity."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from harness import run
from harness.errors import ResultsError
from harness.mission import Verdict
from ssp.space_robot import claims as guo_2014
from ssp.space_robot import evaluations as guo_metrics
from tests.missions import PAPERS
from tests.reported import report

from ..fmu.robot_cases import PAPER, Q, pitch_constants

REPRODUCED, NOT = Verdict.REPRODUCED, Verdict.NOT_REPRODUCED
MANY = {"step": 60.0, "stop": 3e5}


@cache
def recording(params="default", e=None, deuler=None):
    given = {"robot.max_step": 10.0} if params != "circular" else {}
    if e is not None:
        given["robot.e"] = e
    if deuler is not None:
        given["robot.deuler_0"] = [0, 0, deuler]
    return run("space_robot", params=params, set=given, **(MANY if params != "circular" else {}))


def verdicts_of(result):
    papers = [p for p in PAPERS if p in guo_2014.PAPERS and p.belongs_to(result)]
    assert len(papers) == 1
    return {claim.name: claim.evaluate(result).verdict for claim in papers[0].claims}


@pytest.mark.parametrize(
    ("case", "verdicts"),
    [
        (("circular",), {"critical rate": REPRODUCED, "closed curve": REPRODUCED}),
        (("default", 0.004), {"periodic": NOT}),
        (("default", 0.05), {"libration": REPRODUCED}),
        (("default", 0.0655), {"tumbling": NOT}),
        (("default", 0.07), {"libration": REPRODUCED}),
        (("default", 0.1), {"tumbling": REPRODUCED}),
    ],
)
def test_the_eccentricity_decides_which_claims_belong_to_a_run(case, verdicts):
    assert verdicts_of(recording(*case)) == {"equilibrium": REPRODUCED} | verdicts


def test_the_constants_of_the_pitch_equation_match_the_point_masses():
    kappa, theta_hat = pitch_constants(PAPER, Q)
    found = guo_metrics.pitch_constants(recording("circular"))
    assert found == pytest.approx((theta_hat, kappa), abs=1e-12)


def test_above_the_critical_rate_a_circular_orbit_tumbles_and_the_claim_holds():
    n = np.sqrt(3.986004418e14 / 7e6**3)
    result = recording("circular", None, 2 * n)
    claim = guo_2014.CRITICAL
    assert claim.numbers(result)[1] > 1
    assert claim.numbers(result)[2] > 180
    assert claim.evaluate(result).verdict is REPRODUCED


def test_the_table_names_the_part_of_the_paper_and_is_complete():
    text, passed = report(recording("circular"))
    assert passed
    assert "circular orbit" in text
    assert "3 claims: 3 reproduced" in text


def test_moving_joints_are_not_the_case_of_the_paper():
    result = run("space_robot", params="joint_motion", stop=600.0)
    text, _ = report(result)
    assert "space_robot: no claims of a paper apply to this result\n" in f"{text}\n"
    assert "Guo" not in text
    bare = replace(result, provenance=replace(result.provenance, requirements=()))
    with pytest.raises(ResultsError, match="no claims of a paper"):
        report(bare)
