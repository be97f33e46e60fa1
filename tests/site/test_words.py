# SPDX-License-Identifier: BSD-2-Clause
"""The words of the project and of its commits: what `make lint` finds, and what it leaves alone."""

from __future__ import annotations

import ast

import pytest

from tests.site.scripts import script


@pytest.fixture(scope="module")
def words():
    return script("words")


@pytest.fixture(scope="module")
def subjects():
    return script("subjects")


@pytest.mark.long
def test_no_tracked_text_has_a_word_of_the_list(words):
    assert list(words.problems()) == []


@pytest.mark.parametrize("word", ["flies", "Told", "judged", "foreign", "of it", "that of", "said"])
def test_a_word_of_the_list_is_found(words, word):
    text = f"A page.\n\nWhat {word} here.\n"
    assert [(line, found) for line, found, _ in words.findings(text)] == [(3, word)]


@pytest.mark.parametrize("name", ["is_told", "wasToldBy", "told2", "TOLD_NOT", "def told(x):"])
def test_a_word_of_the_list_is_found_in_names(words, name):
    assert [found.lower() for _, found, _ in words.findings(name)] == ["told"] * (name != "told2")


@pytest.mark.parametrize(
    "text",
    [
        "fly-around",
        "not judged",
        "flywheel",
        "flight software",
        "fmus/flight/a.c",
        "foreigner",
        "keep-out zone",
        "keep_direction",
        "out of it",
        "handshake",
        "pytest.param(1, marks=x)",
    ],
)
def test_other_words_are_not(words, text):
    assert list(words.findings(text)) == []


def test_docstrings_that_hide_their_subject_are_found(words):
    source = '"""What it is."""\nclass A:\n    """Of two."""\ndef f():\n    """Return whether."""\n'
    lines = list(words.in_python("harness/a.py", ast.parse(source + 'X = 1\n"""How many."""\n')))
    assert [line.split(":")[1] for line in lines] == ["1", "7", "3"]


def test_help_texts_begin_with_a_capital(words):
    source = 'x = Option(help="its key")\ndef run_command():\n    """Run."""\n'
    tree = ast.parse(source)
    assert sorted(words.helps(tree)) == [(1, "its key"), (2, "Run.")]
    (line,) = words.in_python("harness/cli/a.py", tree)
    assert line == "harness/cli/a.py:1: 'its key': a help text begins with a capital"


@pytest.mark.parametrize(
    "subject",
    ["Reject a zero step", "Pass the seed on", "Merge branch 'a'", "Feed the filter", "Add x: y"],
)
def test_imperative_subjects_are_accepted(subjects, subject):
    assert list(subjects.problems(subject)) == []


@pytest.mark.parametrize(
    ("subject", "problem"),
    [
        ("Rejects a zero step", "imperative"),
        ("Rejected a zero step", "imperative"),
        ("Rejecting a zero step", "imperative"),
        ("The step is rejected", "imperative"),
        ("docs: a page", "capital"),
        ("Reject a zero step.", "full stop"),
        ("Reject " + "x" * 70, "77 characters, at most 72"),
    ],
)
def test_other_subjects_are_not(subjects, subject, problem):
    assert any(problem in line for line in subjects.problems(subject))


def test_the_hook_reads_the_first_line_of_a_message(subjects, tmp_path, capsys):
    file = tmp_path / "COMMIT_EDITMSG"
    file.write_text("Reject a zero step\n\nIt was accepted.\n", encoding="utf-8")
    assert subjects.main(str(file)) == 0
    file.write_text("It was accepted\n", encoding="utf-8")
    assert subjects.main(str(file)) == 1
    assert "not It" in capsys.readouterr().out


def test_all_commits_since_the_rule_follow_it(subjects):
    assert subjects.main() == 0


def test_help_texts_by_position_begin_with_a_capital(words):
    tree = ast.parse(
        'a = option("--key K", "its key")\nb = output("where")\nc = argument("N", text)\n'
    )
    assert sorted(words.helps(tree)) == [(1, "its key"), (2, "where")]
    assert len(list(words.in_python("harness/cli/a.py", tree))) == 2
