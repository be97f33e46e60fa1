# SPDX-License-Identifier: BSD-2-Clause
"""Figures that user pages and pages of missions quote: each is one that a run or a generated page
gives.
"""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

GENERATED = ("note", "compared", "overloads")
"""Values that come from docs/processor_figures.md, without a run."""


@pytest.fixture(scope="module")
def quoted(writer):
    return writer["quoted"]


@pytest.fixture(scope="module")
def missions(writer):
    return writer["missions"]


@pytest.fixture(scope="module")
def results(writer):
    return writer["results"]


def quotations(quoted):
    return [
        (page.name, found[2], found[3])
        for page in quoted.pages()
        for found in quoted.QUOTE.finditer(page.read_text(encoding="utf-8"))
    ]


def test_every_figure_of_a_page_has_a_run_and_every_run_a_page(quoted, missions):
    found = quotations(quoted)
    claims = {f"claims_{name}" for name in missions.claiming()}
    assert {name for _, name, _ in found} == {*quoted.VALUES, *claims}
    assert all(text.strip() for _, _, text in found)
    markers = sum(p.read_text(encoding="utf-8").count("<!--=") for p in quoted.pages())
    assert markers == len(found), "a marker is not closed"


def test_no_quotation_within_a_paragraph_begins_a_line(quoted):
    """A comment at the beginning of a line ends the paragraph for other readers of Markdown."""
    for page in quoted.pages():
        assert not re.search(r"^<!--=\w+-->.", page.read_text(encoding="utf-8"), re.M), page


def test_pages_quote_the_table_of_processors_as_it_is(quoted):
    texts = {name: text for _, name, text in quotations(quoted)}
    for name in GENERATED:
        assert texts[name] == quoted.VALUES[name](), f"{name}: make quoted-values"


def test_a_page_loses_its_markers_and_retains_its_values(quoted):
    page = "It takes <!--=wait-->3 s<!----> here.\n"
    assert quoted.plain(page, {"wait": "3 s"}, "x.md") == "It takes 3 s here.\n"


@pytest.mark.parametrize(
    ("figures", "line"),
    [
        ({"mass": "1 kg"}, "x.md: no run gives 'wait'; there are mass"),
        ({"wait": "4 s"}, "x.md: wait is '4 s', the page has '3 s': run make quoted-values"),
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


def test_filling_a_page_with_what_it_has_changes_nothing(quoted, tmp_path, monkeypatch):
    """And filled, it is the page that the site shows, without its markers."""
    for page in quoted.pages():
        text = page.read_text(encoding="utf-8")
        figures = {found[2]: found[3] for found in quoted.QUOTE.finditer(text)}
        emptied = quoted.QUOTE.sub(lambda m: m[1] + m[4], text)
        copy = tmp_path / page.name
        copy.write_text(emptied, encoding="utf-8")
        monkeypatch.setattr(quoted, "pages", lambda copy=copy: [copy])
        quoted.fill(figures)
        filled = copy.read_text(encoding="utf-8")
        assert filled == text, page
        shown = quoted.plain(filled, figures, page.name)
        assert "<!--=" not in shown
        assert shown == re.sub(r"<!--=\w+-->|<!---->", "", text)
        monkeypatch.undo()


# ---- tables of runs


def test_no_page_of_a_mission_types_a_verdict(quoted):
    """Verdicts of claims are in the tables that the runs have filled."""
    for page in quoted.pages():
        if "ssp" in page.parts[-3:]:
            left = quoted.QUOTE.sub("", page.read_text(encoding="utf-8"))
            rows = [line for line in left.splitlines() if line.startswith("|")]
            assert not [row for row in rows if re.search(r"\|\s*(not )?reproduced", row)], page


def test_a_table_of_runs_has_a_row_per_command(results, monkeypatch):
    runs = {"short": "sync_approach --stop 1", "long": "sync_approach --stop 3 --set a.b=[1,2]"}
    monkeypatch.setattr(results, "result_of", lambda c: SimpleNamespace(options=results.options(c)))
    columns = [
        results.Column("end", lambda r: r.options["stop"], "{:.1f} s"),
        results.Column("set", lambda r: str(r.options.get("set", "-"))),
        results.Column("none", lambda _: np.nan),
    ]
    by_run = results.of_runs("run", runs, columns).splitlines()
    assert by_run[1:] == [
        "| run | end | set | none |",
        "| --- | --- | --- | --- |",
        "| short | 1.0 s | - | - |",
        "| long | 3.0 s | ['a.b=[1,2]'] | - |",
    ]
    across = results.of_runs("run", runs, columns, across=True).splitlines()
    assert across[1] == "| run | short | long |"
    assert across[3] == "| end | 1.0 s | 3.0 s |"


def test_a_value_is_a_metric_an_expression_or_a_function_of_a_run(results):
    command = "sync_approach --stop 2"
    assert results.value_of(command, "last(time)", "{:.0f} s")() == "2 s"
    assert results.value_of(command, "minimum range", "{:.1f} m")() == "20.0 m"
    assert results.value_of(command, lambda r: (len(r.time), 0.5), "{:g} rows, {:g}")() == (
        "21 rows, 0.5"
    )


def test_claims_of_a_mission_match_its_own_runs(missions):
    """A mission page also shows runs of other missions' systems, whose claims are there."""
    paper = {"claims": [("it docks", "figure 1", "<= 1 m", "0.5 m", "reproduced")]}
    runs = [
        {"command": "harness run transposition -o out.nc", "papers": [paper]},
        {"command": "harness run transposition --params cluster -o out.nc", "papers": [paper]},
        {"command": "harness run arm_capture -o out.nc", "papers": [paper]},
    ]
    found = missions.claims({"transposition": runs})
    assert found["claims_transposition"].splitlines()[1:] == [
        "| Run | Claim | Where | Here | Verdict |",
        "| --- | --- | --- | --- | --- |",
        "| default | it docks | figure 1 | 0.5 m | reproduced |",
        "| `--params cluster` | it docks | figure 1 | 0.5 m | reproduced |",
    ]
