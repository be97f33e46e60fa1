# SPDX-License-Identifier: BSD-2-Clause
"""harness report: the table for sync_approach, its verdicts, and results for which some claims are
not judged.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.cli.app import main
from harness.errors import ResultsError
from harness.mission import Verdict
from harness.results.files import ResultFile, read
from harness.results.result import Result
from ssp.sync_approach.claims import PAPER as ZHU_YANG_2009
from tests.each import each
from tests.reported import report

from .sync_case import PAPER, recording

CLAIMS = {claim.name: claim for claim in ZHU_YANG_2009.claims}


@pytest.fixture(scope="module")
def result() -> Result:
    return recording(PAPER)


def rows(result: Result, chosen) -> Result:
    return replace(result, time=result.time[chosen], values=result.values[chosen])


def columns(result: Result, required) -> Result:
    chosen = [i for i, name in enumerate(result.columns) if required(name)]
    names, units = (tuple(part[i] for i in chosen) for part in (result.columns, result.units))
    return Result(result.system, result.time, names, units, result.values[:, chosen])


def changed(result: Result, variable: str, change) -> Result:
    values = result.values.copy()
    places = result.vectors[variable].reshape(-1)
    values[:, places] = change(values[:, places])
    return replace(result, values=values)


def steps(x: np.ndarray) -> np.ndarray:
    return np.arange(len(x))[:, None]


def decay(seconds: float):
    """Falls by a factor e in so many seconds."""
    return lambda x: np.exp(-0.1 * steps(x) / seconds)


def erring(change):
    """A reference position from which the servicer is off by another error."""

    def reference(x):
        actual = recording(PAPER)["guidance.rho_H"]
        return actual - change(actual - x)

    return reference


def nearer(weight):
    """A reference attitude on the way from the servicer's own to what it was; the sample of a row
    belongs to the state one row before.
    """

    def reference(x):
        own = np.concatenate((x[:1], recording(PAPER)["servicer.q_SN"][:-1]))
        own *= np.sign(np.sum(own * x, axis=1, keepdims=True))
        between = own + weight(x) * (x - own)
        between[0] = between[1]  # as after initialization
        return between / np.linalg.norm(between, axis=1, keepdims=True)

    return reference


def verdict(result: Result, name: str) -> Verdict:
    return CLAIMS[name].evaluate(result).verdict


# ---- the table


def test_a_complete_run_passes_and_shows_every_claim_within_120_columns(result):
    text, passed = report(result)
    assert passed
    assert max(map(len, text.splitlines())) <= 120
    assert text.isascii()
    assert "14 claims: 8 reproduced, 3 partly, 3 not reproduced" in text
    words = " ".join(text.split())
    for claim in CLAIMS.values():
        assert claim.text.split()[0] in words


def test_the_table_is_the_same_from_a_file(result, tmp_path):
    """A .csv has no name of the system but its own."""
    for ending in (".nc", ".csv"):
        file = ResultFile(tmp_path / f"sync_approach{ending}")
        file.write(rows(result, slice(None, None, 10)))
        assert report(read(file.path)) == report(rows(result, slice(None, None, 10)))


def test_the_command_prints_the_table(result, tmp_path, capsys):
    file = ResultFile(tmp_path / "run.nc")
    file.write(rows(result, slice(None, None, 10)))
    assert main(["report", str(file.path)]) == 0
    assert "claims: 8 reproduced" in capsys.readouterr().out


def test_the_command_fails_if_a_claim_is_not_judged(result, tmp_path, capsys):
    file = ResultFile(tmp_path / "run.nc")
    file.write(rows(result, slice(0, 9001, 10)))
    assert main(["report", str(file.path)]) == 1
    assert "13 not exercised" in capsys.readouterr().out


# ---- verdicts follow the figures


@each(
    ("name", "variable", "change", "expected"),
    [
        ("safe distance", "guidance.range", lambda x: x + 0.01, Verdict.REPRODUCED),
        ("safe distance", "guidance.range", lambda x: x - 0.1, Verdict.NOT_REPRODUCED),
        ("arrival", "guidance.range", lambda x: x + 0.3, Verdict.PARTLY),
        (
            "position tracking",
            "guidance.rho_ref_H",
            erring(lambda e: 100 * e),
            Verdict.NOT_REPRODUCED,
        ),
        (
            "position law is asymptotically stable",
            "guidance.rho_ref_H",
            erring(lambda e: e * decay(200)(e)),
            Verdict.REPRODUCED,
        ),
        ("continuous thrust", "propulsion.F_S", np.sign, Verdict.NOT_REPRODUCED),
        ("mass settles", "controller.m_hat", lambda x: x + 1e-3 * steps(x), Verdict.NOT_REPRODUCED),
        (
            "mass is not the truth",
            "controller.m_hat",
            lambda x: 0 * x + 100,
            Verdict.NOT_REPRODUCED,
        ),
        ("attitude tracking", "guidance.q_DN", nearer(lambda x: 0.1), Verdict.REPRODUCED),
        (
            "attitude law is asymptotically stable",
            "guidance.q_DN",
            nearer(decay(50)),
            Verdict.REPRODUCED,
        ),
        ("wheel speeds", "servicer.wheel_speed", lambda x: 1000 * x, Verdict.NOT_REPRODUCED),
        ("inertias settle", "controller.eta_hat", lambda x: 0 * x + x[-1], Verdict.REPRODUCED),
        ("grasp", "guidance.beta_p", lambda x: 0 * x, Verdict.REPRODUCED),
        ("grasp", "guidance.beta_t", lambda x: x + 1, Verdict.NOT_REPRODUCED),
        ("grasp axis", "guidance.beta_t", lambda x: 5 * x, Verdict.PARTLY),
    ],
)
def test_another_history_gets_another_verdict(result, name, variable, change, expected):
    assert verdict(changed(result, variable, change), name) is expected


# ---- what is not judged


@pytest.mark.parametrize("stop", [0, 1, 100, 5999, 6000, 11999, 12000, 12001, 13000, 17999])
def test_a_run_that_ends_early_is_evaluated_as_far_as_it_goes(result, stop):
    text, passed = report(rows(result, slice(0, stop + 1)))
    assert not passed
    joined = " ".join(text.split())
    assert "Not the case of the paper: the run ends at" in joined
    assert joined.count("the run ends at") > 1


def test_a_run_that_has_failed_does_not_pass(result):
    text, passed = report(replace(result, complete=False, message="target.J_T: the reason"))
    assert not passed
    assert "incomplete: target.J_T: the reason" in text


def test_an_empty_result_is_not_judged(result):
    text, passed = report(rows(result, slice(0, 0)))
    assert not passed
    assert "14 not judged" in text


def test_missing_variables_are_named(result):
    text, passed = report(columns(result, lambda name: not name.startswith("controller.m_hat")))
    assert not passed
    assert "the result holds no controller.m_hat" in " ".join(text.split())
    assert "2 not judged" in text


def test_values_that_are_not_finite_are_not_judged(result):
    spoilt = changed(result, "guidance.range", lambda x: np.where(steps(x) == 15000, np.nan, x))
    assert verdict(spoilt, "safe distance") is Verdict.NOT_JUDGED


@pytest.mark.parametrize("every", [11, 200, 6000])
def test_a_run_recorded_too_seldom_is_not_judged(every):
    _, passed = report(recording(PAPER, every=every))
    assert not passed


def test_an_attitude_that_is_never_released_is_not_judged(result):
    resting = replace(changed(result, "servicer.omega_SN_S", np.zeros_like), parameters=None)
    assert verdict(resting, "attitude tracking") is Verdict.NOT_JUDGED


def test_a_result_of_no_known_system_is_rejected(result):
    with pytest.raises(ResultsError, match="no claims of a paper apply"):
        report(columns(result, lambda name: name.startswith("target")))


# ---- other parameters than the paper's


@pytest.mark.parametrize("name", ["robust", "clear", "informed", "undisturbed"])
def test_other_parameter_sets_are_evaluated_too(name):
    text, passed = report(recording(PAPER, params=name))
    assert passed
    words = " ".join(text.split())
    assert "Not the case of the paper" in words
    assert ("controller.m_hat_0 100 instead of 95 kg" in words) == (name == "informed")
