# SPDX-License-Identifier: BSD-2-Clause
"""Requirements of the system in every run of a campaign, success in their grammar, and what of both
decides on the exit status.
"""

from __future__ import annotations

import tomllib

import numpy as np
import pytest

from harness import campaign
from harness.errors import StructureError
from harness.ssp.build import system_of
from harness.ssp.writer import write_ssp
from harness.studies.campaign import summary

TOML = """
name = "demo"
[experiment]
stop = 6.0
step = 1.0
[components]
count = "counter"
twice = "gain"
bad = "failing"
[connections]
"twice.u" = "count.n"
[parameters.bad]
t_fail = 100.0
[requirements]
small = "twice.y <= 20"
late = "time < 4 s or twice.y >= 10"
"""
# count.n counts calls from n_0; over the 7 rows y = k n
MET, NOT_MET, NOT_EXERCISED = 1, 2, 3


@pytest.fixture
def system(fmus, tmp_path):
    write_ssp(system_of(tomllib.loads(TOML), fmus), tmp_path / "demo.ssp")
    return tmp_path / "demo.ssp"


def table(system, **more):
    gains = {"twice.k": {"list": [0.5, 2.0, 3.0, 4.0]}}
    return {"system": str(system), "factors": gains, "metrics": {"end": "last(twice.y)"}, **more}


def test_requirements_of_the_system_are_judged_in_every_run(system, tmp_path):
    store = campaign(table(system), tmp_path / "c.zarr", workers=0).store
    n = np.arange(7.0)
    wanted = [
        [MET if k * n.max() <= 20 else NOT_MET, MET if (k * n[4:] >= 10).all() else NOT_MET]
        for k in (0.5, 2.0, 3.0, 4.0)
    ]
    assert store.array("requirement").tolist() == ["small", "late"]
    assert store.array("requirement_text").tolist()[0] == "twice.y <= 20"
    assert store.array("verdict").tolist() == wanted
    assert len({tuple(row) for row in wanted}) == 3
    assert store.array("success").tolist() == [float(row == [MET, MET]) for row in wanted]
    assert store.array("message")[0] == "late: not met, worst 2 at 4 s"


def test_a_requirement_whose_time_never_came_is_neither_met_nor_missed(system, tmp_path):
    found = campaign(table(system, fixed={"stop": 3.0}), tmp_path / "c.zarr", workers=0)
    assert found.store.array("verdict")[:, 1].tolist() == [NOT_EXERCISED] * 4
    share = summary.requirements(found.store)["late"]
    assert (share.met, share.judged, share.unjudged) == (0, 0, [0, 1, 2, 3])
    assert np.isnan(found.store.array("success")).all()
    line = "requirement late: cannot be judged in 4 of 4 runs, first run 0 (not exercised, the run"
    assert line in found.summary()
    assert "requirement small: 4 of 4, 100.0 %" in found.summary()


def test_a_run_that_fails_has_met_nothing(system, tmp_path):
    given = table(system, fixed={"set": {"bad.t_fail": 3.0}})
    found = campaign(given, tmp_path / "c.zarr", workers=0)
    assert found.store.array("verdict").tolist() == [[0, 0]] * 4
    assert "requirement small: 0 of 4, 0.0 %" in found.summary()
    assert "success: 0 of 4, 0.0 %" in found.summary()


@pytest.mark.parametrize(
    ("text", "successes"),
    [
        ("twice.y <= 15", [1, 1, 0, 0]),  # 3, 12, 18, 24 at the end
        ("time < 5 s or twice.y >= 10", [0, 1, 1, 1]),
        ("time < 0.1 min or last(twice.y) > 20", [0, 0, 0, 1]),
        ("twice.y[-1] > 15", [0, 0, 1, 1]),
        ("max(twice.y) > 10 and not (max(twice.y) > 20)", [0, 1, 1, 0]),
    ],
)
def test_success_is_stated_as_a_requirement_is(system, tmp_path, text, successes):
    store = campaign(table(system, success=text), tmp_path / "c.zarr", workers=0).store
    assert store.array("success").tolist() == successes
    for run, met in enumerate(successes):
        assert ("success: not met" in store.array("message")[run]) != bool(met)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("time < 7 s or twice.y > 1", "the run ends at 6 s, before its time"),
        ("twice.y", "is no condition"),
        ("time < 2 kg or twice.y > 1", "kg"),
    ],
)
def test_a_success_that_no_run_can_tell_is_refused_before_the_first(system, tmp_path, text, why):
    with pytest.raises(StructureError, match=f"^campaign: success: .*{why}"):
        campaign(table(system, success=text), tmp_path / "c.zarr", workers=0)
    assert not (tmp_path / "c.zarr").exists()
