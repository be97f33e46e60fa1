# SPDX-License-Identifier: BSD-2-Clause
"""`harness docs`: opens the pages of this version, or states how to get them."""

from __future__ import annotations

import webbrowser

import pytest

from harness.cli import main
from harness.files import paths


@pytest.fixture
def opened(monkeypatch):
    """Addresses that a browser was requested to open."""
    found = []
    monkeypatch.setattr(webbrowser, "open", found.append)
    return found


@pytest.fixture
def page(monkeypatch, tmp_path):
    path = tmp_path / "site" / "index.html"
    path.parent.mkdir()
    path.write_text("<!doctype html>")
    monkeypatch.setattr(paths, "BUILD", tmp_path)
    monkeypatch.setattr(paths, "PACKAGE", tmp_path / "package")
    return path


def test_the_pages_are_opened_and_their_place_is_printed(opened, page, capsys):
    assert main(["docs"]) == 0
    assert capsys.readouterr().out == f"{page}\n"
    assert opened == [page.as_uri()]


def test_only_the_place_is_printed_where_that_is_required(opened, page, capsys):
    assert main(["docs", "--where"]) == 0
    assert capsys.readouterr().out == f"{page}\n"
    assert opened == []


def test_without_pages_one_line_states_how_to_get_them(opened, page, capsys):
    page.unlink()
    assert main(["docs"]) == 2
    assert "make site" in capsys.readouterr().err
    assert opened == []
