# SPDX-License-Identifier: BSD-2-Clause
"""Answers of studies: the same bits from any kind of worker, runs that repeat, edges of a map."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import ssp
from harness import campaign, run, sensitivity, worst
from harness.results.requirements import margin
from harness.studies.campaign.campaign import like

pytestmark = pytest.mark.long

SYSTEMS = Path(ssp.__file__).parent
FILE = SYSTEMS / "sync_approach" / "campaigns" / "sync_approach_studies.toml"
STUDIES = {
    "worst": (worst, {"runs": 28}),
    "sensitivity": (sensitivity, {"runs": 26}),
}


def answered(name, path, workers):
    study, entry = STUDIES[name]
    given = tomllib.loads(FILE.read_text()) | {name: entry | {"of": "clearance"}}
    return study(given, path, workers=workers, notify=lambda _: None)


def bits(study):
    """Requested runs and their answers."""
    names = ("numbers", "margin", "status")
    return [study.store.array(name).tobytes() for name in names]


@pytest.mark.parametrize("name", STUDIES)
def test_one_worker_and_four_answer_with_equal_bits(name, tmp_path):
    one, four = (answered(name, tmp_path / f"{n}.zarr", n) for n in (1, 4))
    assert one.store.runs == four.store.runs > 20
    assert bits(one) == bits(four)
    assert one.estimate == four.estimate


def test_twenty_runs_of_a_study_repeat_with_equal_bits(tmp_path):
    study = answered("worst", tmp_path / "w.zarr", 0)
    place = study.store.array("requirement").tolist().index("clearance")
    retained, text = study.store.array("margin")[:, place], "guidance.range >= 3.95 m"
    runs = np.random.default_rng(20).choice(np.arange(1, study.store.runs), 20, replace=False)
    assert len(set(retained[runs])) == 20
    for k in runs:
        assert margin(run("sync_approach", **like(f"{study.path}#{k}")[1]), text) == retained[k]


def test_a_map_finds_both_edges_of_the_unsafe_abort_times(tmp_path):
    """Of the rendezvous benchmark: its unsafe instances (15 300, 15 600 s) lie inside, SRA04
    (14 400 s) outside. The map has abort times every 150 s.
    """
    path = SYSTEMS / "arch_rendezvous" / "campaigns" / "arch_rendezvous_map.toml"
    store = campaign(path, tmp_path / "m.zarr", workers=0).store
    distance = store.array("requirement").tolist().index("distance")
    margin = store.array("margin")[:, distance].reshape(5, 41)  # radial start, abort time
    abort = store.array("controller.t_abort").reshape(5, 41)
    assert np.ptp(abort, axis=0).max() == 0
    for row in margin < 0:
        times = abort[0, row]
        assert 14_400 < times[0] <= 15_300
        assert 15_600 < times[-1] < 16_800
        assert len(times) == 1 + (times[-1] - times[0]) / 150
    assert margin.min() == pytest.approx(-0.0795, abs=1e-4)
