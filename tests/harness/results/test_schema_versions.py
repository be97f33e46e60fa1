# SPDX-License-Identifier: BSD-2-Clause
"""Results and datasets carry the version of their schema: older ones are read, newer ones rejected
by name.
"""

from __future__ import annotations

from dataclasses import replace

import pytest

from harness import read, run
from harness.cli import main
from harness.errors import ResultsError
from harness.results import provenance
from harness.studies.campaign import store
from harness.studies.campaign.campaign import campaign

CAMPAIGN = {
    "system": "sync_approach",
    "runs": 2,
    "fixed": {"stop": 1.0},
    "factors": {"servicer.mass_0": {"uniform": {"low": 90, "high": 110}}},
    "metrics": {"range": "last(guidance.range)"},
}


@pytest.fixture(scope="module")
def result():
    return run("sync_approach", stop=1.0)


@pytest.mark.parametrize("ending", ["nc", "csv"])
def test_a_result_of_a_newer_schema_is_rejected_by_name(result, ending, tmp_path):
    path = tmp_path / f"x.{ending}"
    newer = replace(result.provenance, schema=provenance.SCHEMA + 1)
    replace(result, provenance=newer).save(path)
    with pytest.raises(ResultsError, match=r"schema 2 is newer than 1.*install a newer version"):
        read(path)


def test_a_result_without_a_number_has_the_first_schema(result):
    table = provenance.table(result.provenance)
    assert table.pop("schema") == 1
    assert provenance.from_table(table) == result.provenance


def test_a_dataset_of_another_schema_is_rejected_and_one_without_a_number_is_read(tmp_path, capsys):
    import zarr

    place = tmp_path / "x.zarr"
    found = campaign(CAMPAIGN, place, workers=0)
    assert found.store.group.attrs["schema"] == 1
    group = zarr.open_group(place, mode="r+", zarr_format=3)
    del group.attrs["schema"]
    assert store.Store.open(place).group.attrs["block"] > 0
    group.attrs["schema"] = 2
    with pytest.raises(ResultsError, match=r"has schema 2, but .* reads only 1"):
        store.Store.open(place)
    assert main(["run", "sync_approach", "--like", f"{place}#0", "-o", str(tmp_path / "y.nc")]) == 1
    assert "has schema 2" in capsys.readouterr().err
