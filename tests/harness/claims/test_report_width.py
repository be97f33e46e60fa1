# SPDX-License-Identifier: BSD-2-Clause
"""`harness report` on terminals of any width, with and without colours."""

from __future__ import annotations

import os
import re
import sys
from functools import cache

import pytest

from harness import run
from harness.claims.report import CELLS, WIDTH, lines
from harness.cli.app import main
from harness.results.files import ResultFile
from harness.results.verdict import Kind, Verdict
from tests.reported import report

VERDICTS = {Kind.CLAIM.word(verdict) for verdict in Verdict}
ESCAPES = re.compile(r"\x1b\[[0-9;]*m")


@cache
def recording(**changes):
    return run("sync_approach", **changes)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "x.nc"
    ResultFile(path).write(recording())
    return path


@pytest.mark.parametrize("width", [40, 70, 119, 120, 200])
def test_no_line_is_wider_than_requested(width):
    text, _ = report(recording(), width)
    assert max(map(len, text.splitlines())) <= max(width, 40)


def test_narrow_and_wide_state_the_same():
    wide, narrow = (re.sub(r"[\s-]+", "", report(recording(), width)[0]) for width in (WIDTH, 70))
    for word in ("5.018kgfromthetruth", "14claims:8reproduced,3partly,3notreproduced"):
        assert word in wide
        assert word in narrow


@pytest.mark.parametrize("width", [70, WIDTH])
def test_a_line_with_a_verdict_states_it_behind_its_name(width):
    reported = [line.text[CELLS:] for line in lines(recording(), width) if line.verdict]
    assert len(reported) == 14
    assert set(reported) <= VERDICTS


def test_of_another_case_no_verdict_is_marked():
    found = lines(recording(set=("guidance.rho_M=6",), stop=1800.0), 70)
    assert not any(line.verdict for line in found)


# ---- the command


def printed(file, capsys, monkeypatch, terminal, **environment):
    for name in ("NO_COLOR", "COLUMNS", "FORCE_COLOR"):
        monkeypatch.delenv(name, raising=False)
    for name, value in {"TERM": "xterm", **environment}.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(sys.stdout, "isatty", lambda: terminal)
    assert main(["report", str(file)]) == 0
    return capsys.readouterr().out


def test_on_a_terminal_verdicts_are_coloured_and_lines_fit(file, capsys, monkeypatch):
    out = printed(file, capsys, monkeypatch, True, COLUMNS="70")
    assert out.count("\x1b[32mreproduced") == 8
    assert out.count("\x1b[33mpartly") == 3
    assert out.count("\x1b[31mnot reproduced") == 3
    assert max(map(len, ESCAPES.sub("", out).splitlines())) <= 70


def test_no_color_is_honoured(file, capsys, monkeypatch):
    out = printed(file, capsys, monkeypatch, True, COLUMNS="70", NO_COLOR="1")
    assert "\x1b" not in out


def test_elsewhere_it_is_the_plain_table(file, capsys, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    out = printed(file, capsys, monkeypatch, False)
    assert out == report(recording())[0] + os.linesep.replace("\r", "")
