# SPDX-License-Identifier: BSD-2-Clause
"""Targets of the Makefile that build something long only when it is requested."""

from __future__ import annotations

import io
import os
import subprocess
from contextlib import redirect_stdout
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.skipif(os.name == "nt", reason="of POSIX")
def test_a_wheel_contains_the_site_only_when_requested():
    """Commands that make would run, with an edited mkdocs.yml."""
    plain, whole = (
        subprocess.run(
            ["make", "-n", "-W", "mkdocs.yml", "wheel", *words],
            cwd=ROOT, capture_output=True, text=True, check=True,
        ).stdout
        for words in ([], ["SITE=1"])
    )  # fmt: skip
    assert "pip wheel" in plain
    assert "pip wheel" in whole
    assert "mkdocs build" in whole
    assert "mkdocs build" not in plain


def test_long_work_of_the_site_reports_its_progress(writer):
    with redirect_stdout(io.StringIO()) as shown:
        assert list(writer["text"].counted("live page", ["a", "b"])) == ["a", "b"]
    assert shown.getvalue() == "live page 1 of 2: a\nlive page 2 of 2: b\n"
