# SPDX-License-Identifier: BSD-2-Clause
"""The wheel in an empty folder: installed by pip into fresh environments, without a compiler and
without this tree. `make test-wheel`, with a network.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import venv
from pathlib import Path

import pytest

from tests.site.tutorial import BLOCKS, LEFT, follow, run

ROOT = Path(__file__).resolve().parents[2]
WHEELS = sorted((ROOT / "dist").glob("servicing_fmus-*.whl"))
COMPILERS = ("cc", "gcc", "clang", "c++", "tcc")
pytestmark = [
    pytest.mark.wheel,
    pytest.mark.skipif(os.name == "nt", reason="of POSIX"),
    pytest.mark.skipif(not WHEELS, reason="needs the wheel: make release or make wheel"),
]


def installed(place, extras):
    """Folder of the programs of an environment that pip has filled from the wheel."""
    venv.create(place, with_pip=True, symlinks=True)
    command = [place / "bin/python", "-m", "pip", "install", "--quiet", f"{WHEELS[-1]}{extras}"]
    subprocess.run(command, check=True, env=outside())
    return place / "bin"


def outside():
    """The environment without what leads to this tree."""
    return {n: v for n, v in os.environ.items() if n not in {"CC", "PYTHONPATH", "PATH"}} | {
        "PATH": os.defpath
    }


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
    """With all extras."""
    return installed(tmp_path_factory.mktemp("all") / "venv", "[all]")


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """Without any extra."""
    return installed(tmp_path_factory.mktemp("bare") / "venv", "")


@pytest.fixture
def tools(tmp_path):
    folder = tmp_path / "tools"
    folder.mkdir()
    return folder


@pytest.fixture
def work(tmp_path):
    folder = tmp_path / "work"
    folder.mkdir()
    return folder


@pytest.fixture
def harness(programs, work, tools):
    """Runs a line of the command line in the empty folder; gives its exit status and its output."""
    path = f"{programs}{os.pathsep}{tools}"
    assert not any(shutil.which(name, path=path) for name in COMPILERS)
    environment = outside() | {"PATH": path, "MPLBACKEND": "agg"}

    def call(line):
        words = [programs / "harness", *shlex.split(line)[1:]]
        done = subprocess.run(
            words, cwd=work, env=environment, capture_output=True, text=True, check=False
        )
        output = done.stdout + done.stderr
        assert "Traceback" not in output
        return done.returncode, output

    return call


@pytest.mark.skipif(
    not (ROOT / "build/site/index.html").is_file(), reason="the site is not built: make site"
)
def test_the_site_lies_in_the_wheel(harness, programs):
    status, where = harness("harness docs --where")
    assert status == 0
    page = Path(where.strip())
    assert page.is_relative_to(programs.parent)
    assert "servicing-fmus" in page.read_text(encoding="utf-8")


def test_every_block_of_the_tutorial_runs_and_prints_what_it_states(programs, work, tools):
    assert {kind for kind, _ in BLOCKS} == {"sh", "python", "toml", "text"}
    follow(work, tools, programs)
    assert {path.name for path in work.iterdir()} >= LEFT


def test_the_page_about_missions_leads_to_a_report(harness, work):
    page = (ROOT / "docs/own_mission.md").read_text(encoding="utf-8")
    commands = re.findall(r"^    (harness [^#\n]*)", page.partition("\n## The system")[0], re.M)
    assert [line.split()[1] for line in commands] == ["new", "run", "report"]
    for line in commands:
        status, output = harness(line)
        assert status == 0, output
    assert "plotly" in (work / "mine.html").read_text(encoding="utf-8")


SYSTEM = """\
extends = "sync_approach"
name = "heavy"
[experiment]
stop = 300
[parameters.servicer]
mass_0 = 140
[requirements]
near = "time < 250 s or guidance.range <= 12 m"
away = "guidance.range >= 3.9 m"
"""
MISSION = """\
from harness.mission import Metric, Mission, inherit

SPEED = "servicer.v_SN_N"

def largest(result, limits):
    return float(abs(result[SPEED]).max())

MISSION = inherit(
    "sync_approach",
    Mission(metrics=(Metric("largest speed", "m/s", (SPEED,), largest),)),
)
"""
CAMPAIGN = """\
system = "heavy"
runs = 50
success = "last(guidance.range) < 12"
[factors]
"servicer.mass_0" = {normal = {mean = 140.0, sigma = 5.0}}
"""


DISPERSED = "harness campaign spread.toml --workers 0"
OF_EXTRAS = ["matplotlib", "pandas", "plotly", "scipy", "xarray"]


def test_an_own_mission_is_run_reported_drawn_exported_dispersed_and_gated(harness, work):
    (work / "heavy").mkdir()
    (work / "heavy/system.toml").write_text(SYSTEM)
    (work / "heavy/mission.py").write_text(MISSION)
    assert (SYSTEM + MISSION).count("\n") <= 25
    (work / "spread.toml").write_text(CAMPAIGN)
    for line, found in (
        ("harness run heavy -o heavy.nc --require 'guidance.range >= 3.9 m'", "met: near"),
        ("harness report heavy.nc --mission heavy -o heavy.html", ""),
        ("harness plot heavy.nc --mission heavy", ""),
        ("harness draw heavy -o heavy.svg", ""),
        ("harness export heavy out", ""),
        (f"{DISPERSED} -o spread.zarr --require 'lower(success) >= 90 %'", "50 of 50"),
    ):
        status, output = harness(line)
        assert status == 0, output
        assert found in output, output
    assert "largest speed" in (work / "heavy.html").read_text(encoding="utf-8")
    assert list((work / "heavy_figures").iterdir())
    assert list((work / "out").glob("*.ssp"))
    # fifty runs do not show as much
    status, output = harness(f"{DISPERSED} -o again.zarr --require 'lower(success) >= 99 %'")
    assert status == 1, output
    assert harness("harness run heavy -o no.nc --require 'guidance.range >= 12 m'")[0] == 1


def test_without_extras_a_run_has_and_needs_none_of_them(bare, work, tools):
    environment = outside() | {"PATH": f"{bare}{os.pathsep}{tools}"}
    run([bare / "harness", "run", "sync_approach", "-o", "x.csv"], work, environment)
    assert (work / "x.csv").stat().st_size > 1e6
    there = f"from importlib.util import find_spec; print([n for n in {OF_EXTRAS} if find_spec(n)])"
    assert run([bare / "python", "-c", there], work, environment) == "[]\n"
