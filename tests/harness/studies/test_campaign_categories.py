# SPDX-License-Identifier: BSD-2-Clause
"""Campaigns over laws: a factor of texts is no number, each law has its own shares."""

from __future__ import annotations

import numpy as np
import pytest

from harness import campaign
from harness.cli import main
from harness.report.campaign import of_dataset
from harness.studies.campaign import summary

LAWS = ("adaptive_controller", "pid_controller")
TABLE = {
    "system": "sync_approach",
    "runs": 4,
    "seed": 1,
    "fixed": {"params": "limited", "stop": 1.0},
    "factors": {
        "servicer.mass_0": {"uniform": {"low": 90.0, "high": 110.0}},
        "swap.controller": {"list": list(LAWS)},
    },
    "metrics": {"range": "last(guidance.range)", "cost": "delta-v"},
    "requirements": {"weak": "norm(propulsion.F_S) <= 1.2 N", "far": "guidance.range >= 4 m"},
}


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    folder = tmp_path_factory.mktemp("laws")
    table = TABLE
    return campaign(table, folder / "laws.zarr", workers=0), folder / "laws.zarr"


def test_the_names_of_laws_are_no_numbers(found):
    store = found[0].store
    assert list(summary.factor_columns(store)) == ["servicer.mass_0"]
    assert list(summary.categories(store)) == ["swap.controller"]
    assert "swap.controller +" not in found[0].summary()
    assert "swap.controller -" not in found[0].summary()


def test_each_law_has_its_shares_of_every_requirement(found):
    """Counted from the verdicts of the dataset."""
    store = found[0].store
    rows = summary.by_category(store)["swap.controller"]
    assert list(rows) == sorted(LAWS)
    laws, names = store.array("swap.controller"), list(store.array("requirement"))
    verdict = store.array("verdict")
    for law in LAWS:
        for name in ("weak", "far"):
            column = verdict[laws == law, names.index(name)]
            assert (rows[law][name].met, rows[law][name].evaluated) == ((column == 1).sum(), 4)
    assert rows[LAWS[0]]["weak"].met == 4
    assert rows[LAWS[1]]["weak"].met == 0
    text = found[0].summary()
    line = next(each for each in text.splitlines() if each.startswith("pid_controller"))
    assert "0/4 (0-49 %)" in line
    assert "4/4 (51-100 %)" in line


def test_the_page_shows_laws_by_name(found):
    page = of_dataset(found[1])
    assert "<h2>By swap.controller</h2>" in page
    assert "cost [m/s] by swap.controller" in page
    assert '<th scope="row">pid_controller</th>' in page


def test_runs_that_fail_are_listed_by_law(found):
    lines = [x for x in found[0].summary().splitlines() if x.startswith("failed: run")]
    laws = [x.partition("swap.controller = ")[2].partition(":")[0] for x in lines]
    assert laws == sorted(laws)
    assert set(laws) == {"pid_controller"}
    assert "swap.controller = pid_controller: " in of_dataset(found[1])


def test_the_size_of_an_effect_is_beside_its_rank():
    x = np.linspace(0.0, 1.0, 101)
    assert summary.effect(x, 10 + 0.1 * x) == pytest.approx(0.09 / 10.05, rel=1e-9)
    assert summary.effect(x, -10 - 0.1 * x) == pytest.approx(0.09 / 10.05, rel=1e-9)
    assert summary.effect(x, np.zeros(101)) == 0


def test_a_campaign_without_a_page_names_the_command(found, capsys):
    assert main(["report", str(found[1])]) == 2
    assert f"harness report {found[1]} -o laws.html" in capsys.readouterr().err
