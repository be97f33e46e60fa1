# SPDX-License-Identifier: BSD-2-Clause
"""The tutorial works literally: every block is run in an empty folder, without a compiler, and
prints what the page shows. So does the way to a verdict. From the wheel: test_wheel.py.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from tests.site.tutorial import BLOCKS, LEFT, blocks, follow

pytestmark = pytest.mark.skipif(os.name == "nt", reason="of POSIX")


@pytest.fixture
def folders(tmp_path):
    """An empty folder to work in, and one for the shell."""
    found = tmp_path / "work", tmp_path / "tools"
    for folder in found:
        folder.mkdir()
    return found


@pytest.mark.long
def test_every_block_runs_and_prints_what_it_states(folders):
    assert {kind for kind, _ in BLOCKS} == {"sh", "python", "toml", "text"}
    follow(*folders, Path(sys.executable).parent)
    assert {path.name for path in folders[0].iterdir()} >= LEFT


@pytest.mark.long
def test_from_a_system_to_a_verdict_with_a_number(folders):
    follow(*folders, Path(sys.executable).parent, blocks("how_to/verdict.md"), "my.toml")
    left = {path.name for path in folders[0].iterdir()}
    files = {"worst.html", "run.html", "mass.html", "probability.html", "mended.toml"}
    assert left >= files | {"s.zarr", "w.zarr", "mended.zarr", "p.zarr", "w_worst", "mass"}
