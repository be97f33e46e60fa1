# SPDX-License-Identifier: BSD-2-Clause
"""make misra: places of rules, and deviations that hold both ways."""

from __future__ import annotations

import importlib
import shutil
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
with_cppcheck = pytest.mark.skipif(not shutil.which("cppcheck"), reason="needs cppcheck")


@pytest.fixture(scope="module")
def misra():
    """The module of .ci."""
    sys.path.insert(0, str(ROOT / ".ci"))
    yield importlib.import_module("misra")
    sys.path.remove(str(ROOT / ".ci"))


def test_a_rule_without_a_deviation_and_a_deviation_without_a_place_are_reported(misra):
    found = {"15.5": {("a.c", 3)}}
    assert list(misra.differences(found, {"15.5": "why"})) == []
    (absent,) = misra.differences(found, {})
    assert "rule 15.5: a.c:3" in absent
    (left,) = misra.differences({}, {"15.5": "why"})
    assert "found nowhere" in left


def test_every_deviation_has_a_reason(misra):
    assert all(len(reason.split()) > 3 for reason in misra.deviations().values())


@with_cppcheck
def test_places_are_read_from_the_addon(misra, tmp_path):
    lines = ["int f(int a);", "int f(int a)", "{", "    if (a > 1) {", "        goto end;", "    }"]
    (tmp_path / "a.c").write_text("\n".join([*lines, "end:", "    return a;", "}", ""]))
    assert misra.places([tmp_path / "a.c"])["15.1"] == {("a.c", 5)}


@pytest.mark.long
@with_cppcheck
def test_flight_software_has_no_place_without_a_deviation(misra):
    found = misra.places(misra.flight_rules.sources())
    assert list(misra.differences(found, misra.deviations())) == []
