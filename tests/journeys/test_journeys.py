# SPDX-License-Identifier: BSD-2-Clause
"""Journeys of seven people: the commands of their page, pasted in order into an empty folder, and a
check of what they needed. From the wheel: `make test-wheel`; from this tree: `make test-long`.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from tests.each import Each
from tests.site.test_wheel import WHEELS, installed, outside

FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[1]
JOURNEYS = {path.stem: path for path in sorted(FOLDER.glob("*.sh"))}
COMMAND = re.compile(r"^(?:harness|fmpy|make) (?:[^\n]*\\\n)*[^\n>]*", re.M)
posix = pytest.mark.skipif(os.name == "nt", reason="of POSIX")
each_journey = pytest.mark.parametrize("name", JOURNEYS)


@pytest.fixture
def journey():
    return Each(list(JOURNEYS), str)


def test_seven_people_have_a_journey():
    assert len(JOURNEYS) == 7


def test_a_journey_consists_of_the_commands_of_its_page_in_their_order(journey):
    text = JOURNEYS[journey].read_text(encoding="utf-8")
    page = (ROOT / text.partition("# from ")[2].split()[0]).read_text(encoding="utf-8")
    shown, place = " ".join(page.split()), 0
    commands = [" ".join(line.split()) for line in COMMAND.findall(text)]
    assert len(commands) >= 2
    for command in commands:
        place = shown.find(command, place)
        assert place >= 0, command
    assert "# check: " in text


def follow(name, folder, programs):
    """Run the commands and the check of a journey."""
    path = f"{programs}{os.pathsep}{os.defpath}"
    environment = outside() | {"PATH": path, "MPLBACKEND": "agg", "DOCS": str(ROOT / "docs")}
    done = subprocess.run(
        ["sh", "-e", JOURNEYS[name]],
        cwd=folder, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    return installed(tmp_path_factory.mktemp("all") / "venv", "[all]")


@posix
@pytest.mark.wheel
@pytest.mark.skipif(not WHEELS, reason="needs the wheel: make release or make wheel")
@each_journey
def test_a_journey_from_the_wheel_ends_where_it_should(name, tmp_path, programs):
    follow(name, tmp_path, programs)


@posix
@pytest.mark.long
@each_journey
def test_a_journey_from_this_tree_ends_where_it_should(name, tmp_path):
    follow(name, tmp_path, Path(sys.executable).parent)
