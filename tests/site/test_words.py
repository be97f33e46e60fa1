# SPDX-License-Identifier: BSD-2-Clause
"""The words of user pages and help texts: what `make lint` finds, and what it leaves alone."""

from __future__ import annotations

import pytest

from tests.site.scripts import script


@pytest.fixture(scope="module")
def words():
    return script("words")


def test_pages_and_help_texts_have_none_of_them(words):
    assert list(words.problems()) == []


@pytest.mark.parametrize("word", ["flies", "Told", "judged", "foreign", "of it", "that of", "said"])
def test_a_word_of_the_list_is_found_in_prose(words, word):
    text = f"A page.\n\nWhat {word} here.\n"
    assert [(line, found) for line, found, _ in words.findings(text)] == [(3, word)]


@pytest.mark.parametrize("text", ["fly-around", "not judged", "flywheel", "credit", "foreigner"])
def test_other_words_are_not(words, text):
    assert list(words.findings(text)) == []


def test_code_and_addresses_are_left_alone(words):
    page = "Text `said`\n\n```sh\nflies\n```\n\n    told\n\n[a](kept.md)\n"
    assert list(words.findings(words.prose(page))) == []
    assert list(words.findings(words.prose("    told\n\nsaid\n"))) == [
        (3, "said", "states, reports, prints")
    ]


def test_help_texts_of_options_and_commands_are_read(words):
    source = 'x = Option(help="its key")\ndef run_command():\n    """Flies."""\n'
    assert sorted(words.helps(source)) == [(1, "its key"), (2, "Flies.")]
