# SPDX-License-Identifier: BSD-2-Clause
"""harness plan: what a guidance will command, without running the system."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness import run
from harness.cli.app import main
from harness.errors import UsageError
from harness.ssp.library import load
from harness.studies.show import plan

COARSE = {"guidance.nodes": 24}


@pytest.fixture(scope="module")
def found():
    return plan("transposition", set=COARSE)


def test_the_plan_matches_the_whole_system(found):
    first = run("transposition", set=COARSE, stop=1.0)
    for name in ("h_ref_D", "peak", "rotation", "status"):
        assert np.array_equal(found.after[f"guidance.{name}"][0], first[f"guidance.{name}"][0])


def test_the_table_has_a_line_for_every_history_that_was_tried(found):
    *rows, verdict = found.text().splitlines()[1:]
    count = int(found.after["guidance.iterations"][0]) + 1
    assert [int(row.split()[0]) for row in rows] == list(range(count))
    peaks = [float(row.split()[1]) for row in rows]
    assert peaks == pytest.approx(found.after["guidance.peak"][0, :count], abs=0.06)
    assert peaks[0] > 1500 > peaks[-1]
    assert "limit 1350 N m s: planned" in verdict


def test_without_a_plan_the_momentum_matches_the_first_history(found):
    largest = np.linalg.norm(found.before["guidance.h_ref_D"], axis=1).max()
    assert largest == pytest.approx(found.after["guidance.peak"][0, 0], rel=1e-3)
    assert not found.before["guidance.rotation_ref"].any()


def test_a_plan_that_cannot_be_found_states_why_and_fails(tmp_path, capsys):
    narrow = ["--set", "guidance.rotation_max=0.1", "--set", "guidance.nodes=24"]
    assert main(["plan", "transposition", *narrow, "-o", str(tmp_path)]) == 1
    assert "rotation would exceed rotation_max" in capsys.readouterr().out
    assert [path.name for path in tmp_path.iterdir()] == ["planned_momentum.png"]


def test_a_system_without_a_mission_is_planned_by_the_one_that_can(found):
    with load("transposition") as system:
        assert plan(replace(system, mission=""), set=COARSE).text() == found.text()


def test_planning_a_system_whose_mission_does_not_plan_is_wrong_use():
    with pytest.raises(UsageError, match="its mission has no plan"):
        plan("sync_approach")
