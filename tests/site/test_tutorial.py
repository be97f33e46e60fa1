# SPDX-License-Identifier: BSD-2-Clause
"""The tutorial works literally: every block is run in an empty folder, without a compiler, and
prints what it says; from this tree, and from the wheel.
"""

from __future__ import annotations

import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

from tests.site.tutorial import BLOCKS, follow, run

ROOT = Path(__file__).resolve().parents[2]
WHEELS = sorted((ROOT / "dist").glob("servicing_fmus-*.whl"))
LEFT = {"approach.nc", "approach.html", "mass.zarr", "three.nc", "compared", "mine"}
pytestmark = pytest.mark.skipif(os.name == "nt", reason="of POSIX")


@pytest.fixture
def folders(tmp_path):
    """An empty folder to work in, and one for the shell."""
    found = tmp_path / "work", tmp_path / "tools"
    for folder in found:
        folder.mkdir()
    return found


@pytest.mark.long
def test_every_block_runs_and_prints_what_it_says(folders):
    assert {kind for kind, _ in BLOCKS} == {"sh", "python", "toml", "text"}
    follow(*folders, Path(sys.executable).parent)
    assert {path.name for path in folders[0].iterdir()} >= LEFT


@pytest.mark.long
@pytest.mark.skipif(not WHEELS, reason="needs the wheel: make wheel")
def test_every_block_runs_from_the_wheel_and_the_site_lies_in_it(folders, tmp_path):
    place = tmp_path / "venv"
    venv.create(place, with_pip=True, symlinks=True)
    (packages,) = place.glob("lib/python*/site-packages")
    # dependencies from here, but not this tree: .pth files of a folder of a .pth are not read
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    pip = [place / "bin/pip", "install", "--quiet", "--no-index", "--no-deps", "--force-reinstall"]
    subprocess.run([*pip, WHEELS[-1]], check=True)
    where = run([place / "bin/harness", "docs", "--where"], tmp_path, dict(os.environ))
    page = Path(where.strip())
    assert page.is_relative_to(packages)
    assert "servicing-fmus" in page.read_text(encoding="utf-8")
    follow(*folders, place / "bin")
    assert {path.name for path in folders[0].iterdir()} >= LEFT
