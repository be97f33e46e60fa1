# SPDX-License-Identifier: BSD-2-Clause
"""Figures that user pages quote: each is one that a run or a generated page gives."""

from __future__ import annotations

import re

import pytest

GENERATED = ("note", "compared", "overloads")
"""Those that come from docs/targets.md, in no time."""


@pytest.fixture(scope="module")
def quoted(writer):
    return writer["quoted"]


def quotations(quoted):
    return [
        (page.name, found[2], found[3])
        for page in quoted.pages()
        for found in quoted.QUOTE.finditer(page.read_text(encoding="utf-8"))
    ]


def test_every_figure_of_a_page_has_a_run_and_every_run_a_page(quoted):
    found = quotations(quoted)
    assert {name for _, name, _ in found} == set(quoted.FIGURES)
    assert all(text.strip() for _, _, text in found)
    marks = sum(p.read_text(encoding="utf-8").count("<!--=") for p in quoted.pages())
    assert marks == len(found), "a mark is not closed"


def test_pages_quote_the_table_of_processors_as_it_is(quoted):
    texts = {name: text for _, name, text in quotations(quoted)}
    for name in GENERATED:
        assert texts[name] == quoted.FIGURES[name](), f"{name}: make figures"


def test_a_page_loses_its_marks_and_keeps_its_figures(quoted):
    page = "It takes <!--=wait-->3 s<!----> here.\n"
    assert quoted.plain(page, {"wait": "3 s"}, "x.md") == "It takes 3 s here.\n"


@pytest.mark.parametrize(
    ("figures", "line"),
    [
        ({"mass": "1 kg"}, "x.md: no run gives 'wait'; there are mass"),
        ({"wait": "4 s"}, "x.md: wait is '4 s', the page has '3 s': make figures"),
    ],
)
def test_a_figure_that_no_run_gives_ends_the_build_of_the_site(quoted, figures, line):
    with pytest.raises(ValueError, match=f"^{re.escape(line)}$"):
        quoted.plain("It takes <!--=wait-->3 s<!----> here.\n", figures, "x.md")


def test_figures_are_written_into_the_pages(quoted, tmp_path, monkeypatch):
    page = tmp_path / "x.md"
    page.write_text("It takes <!--=wait-->3 s<!----> here.\n")
    monkeypatch.setattr(quoted, "pages", lambda: [page])
    quoted.fill({"wait": "4 s"})
    assert page.read_text() == "It takes <!--=wait-->4 s<!----> here.\n"
