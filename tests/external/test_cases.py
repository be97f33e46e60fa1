# SPDX-License-Identifier: BSD-2-Clause
"""Published reference values: every case agrees within its tolerance, and every model that is wrong
on purpose misses. The data: ssp/validation/cases/*.json.
"""

from __future__ import annotations

import json
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from harness.claims.case import table, validate
from harness.cli import main
from harness.errors import UsageError
from ssp.validation.case import FOLDER, cases
from ssp.validation.library import Library
from ssp.validation.simulations import evaluate
from tests.each import each

ROOT = Path(__file__).parents[2]
ALL = cases()
LONG = {"basilisk-wheels"}
"""Cases of seconds, which `make validation` runs too."""
RIGHT = {"jeod-10C-robot-chain"}
"""Cases that are nearly as long, run with the right model."""
WRONG = [
    pytest.param(case, wrong, id=f"{case.id}-{k}", marks=pytest.mark.long if late else ())
    for case in ALL
    for k, wrong in enumerate(case.wrong)
    for late in [k > 0 or case.id in LONG | RIGHT]
]


@pytest.fixture(scope="module")
def library():
    with Library() as opened:
        yield opened


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case.id, marks=pytest.mark.long if case.id in LONG else ())
        for case in ALL
    ],
)
def test_the_fmus_agree_with_the_published_numbers(case, library):
    for row in evaluate(case, library):
        assert row.within, (
            f"{row.quantity}: {row.difference:.3g} {row.unit}, tolerance {row.tolerance:.3g}"
        )


@pytest.mark.parametrize(("case", "wrong"), WRONG)
def test_a_wrong_model_misses_the_published_values(case, wrong, library):
    assert not all(row.within for row in evaluate(case.changed(wrong["change"]), library)), wrong[
        "what"
    ]


@each("case", ALL)
def test_a_case_states_its_source_and_the_wrong_models(case):
    assert set(case.source) >= {"name", "where", "licence"}
    assert all(case.source.values())
    assert case.why
    assert case.wrong
    assert set(case.tolerance) == set(case.units)
    assert {name for row in case.rows for name in row} == {"t", *case.tolerance}


def test_the_data_are_small_and_the_names_unique():
    assert sum(path.stat().st_size for path in FOLDER.glob("*.json")) < 500_000
    assert len({case.id for case in ALL}) == len(ALL)
    for path in FOLDER.glob("*.json"):
        assert list(json.loads(path.read_text(encoding="utf-8"))) == ["cases"]


def test_chosen_cases_are_simulated_alone_and_a_wrong_name_gets_a_hint():
    rows = validate(["vallado-2-4"])
    assert [row.quantity for row in rows] == ["r_TN_N", "v_TN_N"]
    assert table(rows).endswith("1 of 1 cases agree")
    with pytest.raises(UsageError, match="vallado-2-4"):
        validate(["valado-2-4"])


def test_the_command_prints_the_cases(capsys):
    assert main(["validate", "jeod-lvlh-init"]) == 0
    assert "1 of 1 cases agree" in capsys.readouterr().out


def test_the_page_is_written_from_a_run():
    place = spec_from_file_location("validation_page", ROOT / ".ci" / "validation.py")
    page = module_from_spec(place)
    place.loader.exec_module(page)
    lines = page.markdown(validate(["jeod-lvlh-init"])).splitlines()
    assert "1 of 1 cases agree." in lines
    assert lines[-1].startswith("| `jeod-lvlh-init` |")


def test_a_case_that_differs_is_shown_as_such(library):
    (case,) = cases(["vallado-2-4"])
    rows = evaluate(case.changed(case.wrong[0]["change"]), library)
    assert "DIFFERS" in table(rows)
    assert table(rows).endswith("0 of 1 cases agree")
