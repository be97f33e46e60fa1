# SPDX-License-Identifier: BSD-2-Clause
"""harness report for runs of ppc_tracking: three controllers in two scenarios, each with the claims
made about it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.errors import ResultsError
from harness.mission import Verdict
from tests.missions import PAPERS
from tests.reported import report

from .ppc_recordings import recording

PPC, PID, THETA_D = "ppc_controller", "pid_controller", "theta_d_controller"
REPRODUCED, PARTLY, NOT = Verdict.REPRODUCED, Verdict.PARTLY, Verdict.NOT_REPRODUCED

FIGURES = {
    (PPC, "nominal"): {
        "convergence": (18.1, REPRODUCED),
        "hovering": (0.0041, REPRODUCED),
        "smooth line of sight": (1.3, REPRODUCED),
        "attitude accuracy": (0.0055, REPRODUCED),
        "barrier": (0.102, REPRODUCED),
    },
    (THETA_D, "nominal"): {
        "convergence": (22.8, REPRODUCED),
        "hovering": (0.00426, REPRODUCED),
        "smooth line of sight": (0.370, REPRODUCED),
        "attitude accuracy": (6e-6, REPRODUCED),
    },
    (PID, "nominal"): {
        "convergence": (42.2, REPRODUCED),
        "oscillation": (17.5, REPRODUCED),
        "attitude accuracy": (0.41, PARTLY),
    },
    (PPC, "manoeuvre"): {
        "convergence": (18.2, REPRODUCED),
        "accuracy under manoeuvre": (0.30, REPRODUCED),
        "barrier": (0.127, REPRODUCED),
    },
    (THETA_D, "manoeuvre"): {
        "accuracy under manoeuvre": (2.61, REPRODUCED),
        "chattering command": (3.0, NOT),
    },
    (PID, "manoeuvre"): {
        "convergence": (39.6, REPRODUCED),
        "oscillation": (25.1, REPRODUCED),
        "unaffected accuracy": (0.692, NOT),
    },
}


def paper(result):
    (found,) = (paper for paper in PAPERS if paper.belongs_to(result))
    return found


@pytest.mark.parametrize("case", FIGURES, ids=" ".join)
def test_every_claim_has_our_value_and_verdict(case):
    result, expected = recording(*case), FIGURES[case]
    claims = {claim.name: claim for claim in paper(result).claims}
    assert claims.keys() == expected.keys()
    for name, (value, verdict) in expected.items():
        assert claims[name].numbers(result)[0] == pytest.approx(value, rel=0.05), name
        assert claims[name].evaluate(result).verdict is verdict, name


@pytest.mark.parametrize("case", FIGURES, ids=" ".join)
def test_the_table_names_controller_and_scenario_within_120_columns(case):
    text, passed = report(recording(*case))
    assert passed
    assert max(map(len, text.splitlines())) <= 120
    assert text.isascii()
    words = " ".join(text.split())
    assert ("unknown manoeuvre" if case[1] == "manoeuvre" else "no manoeuvre") in words
    assert {PPC: "prescribed performance", PID: "PID", THETA_D: "theta-D"}[
        case[0]
    ] + ", section 4" in words


def changed(case, variable, change):
    result = recording(*case)
    values = result.values.copy()
    places = (
        [result.columns.index(variable)]
        if variable in result.columns
        else result.vectors[variable].reshape(-1)
    )
    values[:, places] = change(values[:, places])
    return replace(result, values=values)


@pytest.mark.parametrize(
    ("case", "claim", "variable", "change", "expected"),
    [
        (
            (PPC, "nominal"),
            "convergence",
            "guidance.range",
            lambda x: 20 + 1.3 * (x - 20) ** 1.2,
            PARTLY,
        ),
        ((PPC, "nominal"), "hovering", "guidance.range", lambda x: x + 0.5, PARTLY),
        ((PPC, "nominal"), "barrier", "controller.kappa", lambda x: 10 * x, NOT),
        (
            (PPC, "nominal"),
            "smooth line of sight",
            "controller.error.elevation",
            lambda x: np.where(x > 0, 9 * x, x),
            NOT,
        ),
        (
            (PPC, "manoeuvre"),
            "accuracy under manoeuvre",
            "guidance.range",
            lambda x: x + 0.5,
            PARTLY,
        ),
        (
            (THETA_D, "manoeuvre"),
            "accuracy under manoeuvre",
            "guidance.range",
            lambda x: np.clip(x, 19.9, 20.1),
            PARTLY,
        ),
        (
            (THETA_D, "manoeuvre"),
            "chattering command",
            "controller.a_cmd_L",
            lambda x: x + 0.1 * alternating(x),
            REPRODUCED,
        ),
        (
            (PID, "manoeuvre"),
            "unaffected accuracy",
            "guidance.range",
            lambda x: 20 + 0.05 * (x - 20),
            REPRODUCED,
        ),
        ((PID, "nominal"), "oscillation", "controller.error.elevation", lambda x: 0.1 * x, NOT),
    ],
)
def test_another_history_gets_another_verdict(case, claim, variable, change, expected):
    (found,) = (c for c in paper(recording(*case)).claims if c.name == claim)
    assert found.evaluate(changed(case, variable, change)).verdict is expected


def alternating(x):
    return np.where(np.arange(len(x)) % 2, 1.0, -1.0)[:, None]


def test_a_run_that_ends_early_is_not_judged():
    result = recording(PPC, "nominal")
    short = replace(result, time=result.time[:600], values=result.values[:600])
    text, passed = report(short)
    assert not passed
    assert "the run ends at 29.95 s" in " ".join(text.split())


def test_without_the_parameters_the_scenario_is_not_known():
    reported = "lacks the parameters by which some papers are recognised"
    bare = replace(recording(PPC, "nominal"), parameters=None)
    text = " ".join(report(bare)[0].split())
    assert reported in text
    assert "section 4" not in text
    with pytest.raises(ResultsError, match=reported):
        report(undemanding(bare))


def undemanding(result):
    """Without the requirements of its system."""
    return replace(result, provenance=replace(result.provenance, requirements=()))


def test_another_range_to_hover_at_is_not_the_case_of_the_paper():
    result = recording(PPC, "nominal")
    values = result.parameters.values.copy()
    values[0, result.parameters.columns.index("guidance.rho_f")] = 25.0
    other = replace(result, parameters=replace(result.parameters, values=values))
    assert "guidance.rho_f 25 instead of 20 m" in " ".join(report(other)[0].split())
