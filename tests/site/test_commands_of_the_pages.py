# SPDX-License-Identifier: BSD-2-Clause
"""Every command that a page shows is one: its name, its options and their values are accepted."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from harness.cli.app import group
from tests.each import Each

ROOT = Path(__file__).resolve().parents[2]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
SHOWN = re.compile(r"^(?: {4}| {8})?harness ((?:[^\n]*\\\n)*[^\n]*)$", re.MULTILINE)
PLACEHOLDER = re.compile(r"\[-|\||\.\.\. |<|SYSTEM\.|PROCESSOR\b")
COMMANDS = group().commands


def commands_of(page):
    """Command lines of a page, as lists of words; those with placeholders are left out."""
    for found in SHOWN.finditer(page.read_text(encoding="utf-8")):
        line = found[1].replace("\\\n", " ").partition(";")[0]
        if not PLACEHOLDER.search(line):
            yield shlex.split(line, comments=True)


@pytest.fixture
def page():
    return Each([p for p in PAGES if any(commands_of(p))], lambda p: p.name)


def test_commands_are_found():
    assert sum(len(list(commands_of(p))) for p in PAGES) > 100


def test_every_command_of_a_page_is_accepted(page):
    for name, *words in commands_of(page):
        assert name in COMMANDS, f"harness {name}"
        COMMANDS[name].make_context(name, words)


def test_an_option_that_is_not_there_is_noticed():
    with pytest.raises(Exception, match="No such option"):
        COMMANDS["run"].make_context("run", ["sync_approach", "--stopp", "5"])
