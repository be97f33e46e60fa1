# SPDX-License-Identifier: BSD-2-Clause
"""Campaigns that go on after a kill or a power failure: nothing that was lost passes for a result,
and only one process writes it.
"""

from __future__ import annotations

import json
import shutil
from itertools import product

import pytest

from harness import campaign
from harness.errors import ResultsError, UsageError
from harness.studies.campaign.store import Store

RUNS = 4
DEFINITION = {
    "system": "sync_approach",
    "runs": RUNS,
    "fixed": {"stop": 2.0},
    "factors": {"servicer.mass_0": {"uniform": {"low": 90.0, "high": 110.0}}},
    "metrics": {"range": "last(guidance.range)"},
    "success": "last(guidance.range) > 0",
    "record": {"histories": ["guidance.range"], "bands": ["servicer.r_SN_N"], "rows": 5},
}


def simulate_case(path, **how):
    return campaign(DEFINITION, path, workers=0, **how).store


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """The campaign as it is without interruption; a block has one run."""
    path = tmp_path_factory.mktemp("run") / "c.zarr"
    simulate_case(path)
    return path


@pytest.fixture
def damaged(simulated, tmp_path):
    """A copy to be damaged."""
    return shutil.copytree(simulated, tmp_path / "c.zarr")


def files(path):
    """All that is in a dataset, byte by byte."""
    return {f.relative_to(path).as_posix(): f.read_bytes() for f in path.rglob("*") if f.is_file()}


def resumed(path):
    """Runs that are simulated when a campaign is resumed."""
    before = []
    campaign(DEFINITION, path, workers=0, resume=True, progress=lambda p: before.append(p.done))
    return len(before)


class Killed(BaseException):
    """Nothing catches it, as nothing catches a kill."""


@pytest.mark.parametrize("arrays", [0, 5])
def test_killed_while_the_dataset_is_laid_out(simulated, tmp_path, monkeypatch, arrays):
    """It appears whole or not at all; remains are removed by the next start."""
    import zarr

    path, create, made = tmp_path / "c.zarr", zarr.Group.create_array, []

    def die(self, *given, **how):
        if len(made) == arrays:
            raise Killed
        made.append(1)
        return create(self, *given, **how)

    monkeypatch.setattr(zarr.Group, "create_array", die)
    monkeypatch.setattr(shutil, "rmtree", lambda *_, **__: None)  # nothing cleans up after a kill
    monkeypatch.setattr("os.getpid", lambda: 2**22 + 1)  # of a process that has gone
    with pytest.raises(Killed):
        simulate_case(path, resume=True)
    monkeypatch.undo()
    assert not path.exists()
    assert len(list(tmp_path.glob(".c-*.zarr"))) == 1
    assert resumed(path) == RUNS
    assert list(tmp_path.glob(".c-*")) == []
    assert files(path) == files(simulated)


def test_every_chunk_of_a_run_that_is_lost_or_damaged_is_simulated_again(simulated, damaged):
    """Empty after a power failure, gone, or with a flipped bit, in any array."""
    chunks = [f for f in damaged.rglob("c/*") if f.is_file()]
    chunks += [f for f in damaged.rglob("c/*/0") if f.is_file()]
    chunks += [f for f in damaged.rglob("c/*/0/0") if f.is_file()]
    chunks = [f for f in chunks if not is_fixed(f, damaged)]
    assert len(chunks) >= 8 * RUNS
    for k, chunk in enumerate(chunks):
        data = bytearray(chunk.read_bytes())
        match k % 3:
            case 0:
                chunk.write_bytes(b"")
            case 1:
                chunk.unlink()
            case 2:
                data[len(data) // 2] ^= 1
                chunk.write_bytes(data)
        if k % 9 == 4:  # one at a time and several at once
            assert 1 <= resumed(damaged) <= RUNS
            assert files(damaged) == files(simulated)
    resumed(damaged)
    assert files(damaged) == files(simulated)


def is_fixed(chunk, path):
    """Whether an array has no runs."""
    name = chunk.relative_to(path).parts[0]
    axes = json.loads((path / name / "zarr.json").read_text())["dimension_names"]
    return axes[0] != "run"


LOST = list(
    product(["gone", "empty"], ["status", "range", "message", "column", "time", "guidance.range"])
)


@pytest.mark.parametrize(
    ("how", "name"),
    [pytest.param(*c, marks=() if k % 3 == 0 else pytest.mark.long) for k, c in enumerate(LOST)],
)
def test_an_array_that_is_lost_is_laid_out_again(simulated, damaged, name, how):
    if how == "gone":
        shutil.rmtree(damaged / name)
    else:
        (damaged / name / "zarr.json").write_text("")
    assert resumed(damaged) == (0 if name in ("column", "time") else RUNS)
    assert files(damaged) == files(simulated)


def test_remains_of_a_chunk_or_a_band_after_a_kill_are_no_band(simulated, damaged):
    (damaged / "guidance.range_band").rename(damaged / "unfinished_guidance.range_band")
    shutil.rmtree(damaged / "unfinished_guidance.range_band" / "c")
    assert Store.open(damaged).names("band") == ["servicer.r_SN_N_band"]
    (damaged / "range" / "c" / "3.0123456789abcdef.partial").write_bytes(b"half")
    assert resumed(damaged) == 0
    assert files(damaged) == files(simulated)


def test_reading_while_a_campaign_ends_reports_no_damage(damaged, monkeypatch):
    """Histories that are no longer needed go whole, and who has listed them before finds less."""
    scratch = damaged / "history_of_guidance.range"
    shutil.copytree(damaged / "guidance.range", scratch)
    reader, listed = Store.open(damaged), Store.open(damaged)._folders()
    assert scratch.name in listed
    monkeypatch.setattr(Store, "_folders", lambda _: listed)
    Store.open(damaged).finish()
    assert not scratch.exists()
    assert reader.names("history") == ["guidance.range"]
    monkeypatch.undo()
    shutil.copytree(damaged / "guidance.range", scratch)
    monkeypatch.setattr(shutil, "rmtree", lambda *_: None)  # killed before
    Store.open(damaged).finish()
    monkeypatch.undo()
    assert not scratch.exists()
    assert reader.names("history") == ["guidance.range"]
    assert resumed(damaged) == 0
    assert not list(damaged.glob("unfinished_*"))


def test_every_reader_of_a_damaged_dataset_reports_the_damage(damaged):
    (damaged / "range" / "c" / "3").write_bytes(b"")
    with pytest.raises(ResultsError, match=r"c.zarr: array range is damaged; .*--resume"):
        Store.open(damaged).array("range")


@pytest.mark.parametrize("value", [None, 0.5, [], {"a": 1}, True])
@pytest.mark.parametrize("name", ["definition", "folder", "sources", "system", "block"])
def test_attributes_of_a_wrong_type_are_reported_in_one_line(damaged, name, value):
    about = json.loads((damaged / "zarr.json").read_text())
    about["attributes"][name] = value
    (damaged / "zarr.json").write_text(json.dumps(about))
    with pytest.raises(ResultsError, match=r"c.zarr: is not the dataset of a campaign"):
        Store.open(damaged)
    with pytest.raises(ResultsError, match=r"c.zarr: is not the dataset of a campaign"):
        simulate_case(damaged, resume=True)


@pytest.mark.parametrize("attributes", [{"role": 5}, {"units": [1]}, {"whole": "yes"}])
def test_attributes_of_an_array_of_a_wrong_type_are_reported_in_one_line(damaged, attributes):
    file = damaged / "servicer.mass_0" / "zarr.json"
    about = json.loads(file.read_text())
    about["attributes"] |= attributes
    file.write_text(json.dumps(about))
    with pytest.raises(ResultsError, match=r"c.zarr: is not the dataset of a campaign"):
        simulate_case(damaged, resume=True)


def test_only_one_campaign_writes_a_dataset(damaged, tmp_path):
    (damaged / "range" / "c" / "3").unlink()
    met = []

    def second(_):
        for path in (damaged, tmp_path / "new.zarr"):
            if path.exists():
                with pytest.raises(
                    UsageError, match=r"another process is writing this dataset"
                ) as caught:
                    simulate_case(path, resume=True)
                met.append(str(caught.value))

    campaign(DEFINITION, damaged, workers=0, resume=True, progress=second)
    assert met == [f"{damaged}: another process is writing this dataset; wait until it has ended"]
    shutil.rmtree(damaged)
    campaign(DEFINITION, tmp_path / "new.zarr", workers=0, progress=second)
    assert (
        met[1:]
        == [
            f"{tmp_path / 'new.zarr'}: another process is writing this dataset; wait until it "
            "has ended"
        ]
        * RUNS
    )
    assert resumed(tmp_path / "new.zarr") == 0  # the lock went with its campaign


def test_a_dataset_gives_back_the_factors_of_a_run_as_they_were_drawn(tmp_path):
    given = {
        "system": "sync_approach",
        "fixed": {"stop": 0.2},
        "factors": {
            "algorithm": {"list": ["jacobi", "gauss-seidel"]},
            "servicer.mass_0": {"list": [100.0, 90.5]},
        },
    }
    store = campaign(given, tmp_path / "c.zarr", workers=0).store
    found = [tuple(store.values(run).values()) for run in range(4)]
    assert found == list(product(["jacobi", "gauss-seidel"], [100.0, 90.5]))
