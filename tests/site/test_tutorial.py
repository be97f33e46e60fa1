# SPDX-License-Identifier: BSD-2-Clause
"""The tutorial works literally: every block is run in an empty folder, and prints what it says."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).resolve().parents[2] / "docs/tutorial.md"
BLOCKS = re.findall(r"^```(\w+)\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.M | re.S)


def run(kind, text, folder):
    """Run a block; its output."""
    environment = os.environ | {
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "MPLBACKEND": "agg",
    }
    command = ["sh", "-ec", text] if kind == "sh" else [sys.executable, "-c", text]
    done = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{text}\n{done.stdout}{done.stderr}"
    return done.stdout + done.stderr


@pytest.mark.skipif(os.name == "nt", reason="of POSIX")
def test_every_block_of_the_tutorial_runs_and_prints_what_it_says(tmp_path):
    output = ""
    assert {kind for kind, _ in BLOCKS} == {"sh", "python", "toml", "text"}
    for kind, text in BLOCKS:
        if kind == "toml":
            (tmp_path / "mass.toml").write_text(text)
        elif kind == "text":
            missing = [line for line in text.splitlines() if line not in output]
            assert not missing, f"{missing} not in\n{output}"
        else:
            output = run(kind, text, tmp_path)
    assert {"approach.nc", "approach.html", "mass.zarr", "three.nc", "compared", "mine"} <= {
        path.name for path in tmp_path.iterdir()
    }
