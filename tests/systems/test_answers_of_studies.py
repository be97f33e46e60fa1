# SPDX-License-Identifier: BSD-2-Clause
"""Flights of a study about sync_approach repeat."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import ssp
from harness import run, worst
from harness.results.requirements import margin
from harness.studies.campaign.campaign import like

FILE = Path(ssp.__file__).parent / "sync_approach" / "campaigns" / "sync_approach_studies.toml"


@pytest.mark.long
def test_twenty_flights_of_a_study_repeat_with_equal_bits(tmp_path):
    given = tomllib.loads(FILE.read_text()) | {"worst": {"of": "clearance", "flights": 28}}
    study = worst(given, tmp_path / "w.zarr", workers=0, said=lambda _: None)
    place = study.store.array("requirement").tolist().index("clearance")
    kept, text = study.store.array("margin")[:, place], "guidance.range >= 3.95 m"
    runs = np.random.default_rng(20).choice(np.arange(1, study.store.runs), 20, replace=False)
    assert len(set(kept[runs])) == 20
    for k in runs:
        assert margin(run("sync_approach", **like(f"{study.path}#{k}")[1]), text) == kept[k]
