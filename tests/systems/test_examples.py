# SPDX-License-Identifier: BSD-2-Clause
"""examples/: every script runs as its text states, in a folder of its own."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from harness import run
from harness.files.paths import fmus
from harness.mission import Limits
from harness.mission.library import notes_of
from harness.results.requirements import findings
from harness.results.verdict import Verdict
from ssp.shared.metrics import AT_LIMITS

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
PRINTS = {
    "run_and_read.py": r"from 20\.00 m to 4\.\d\d m in 600 s\n"
    r"mass at the start 120(\.0)? kg\n"
    r"moments of inertia \[200\. 250\. 150\.\] kg m2\n"
    r"unchanged: True\n",
    "compare_controllers.py": r"(?s).*ppc_controller: at most \d{3} N along an axis\n"
    r"theta_d_controller: at most \d{3} N along an axis\n",
    "stiff_contact.py": r"theta +held +held, a step late +extrapolated +predicted mean +latency 1 "
    r"+closed form\n(?:.*\n)* 0\.50 +1\.125000 +1\.32\d{4} +1\.000000(?: +0\.997439){3}\n"
    r"(?:.*\n)* 1\.90 +2\.805000 +3\.\d{6} +1\.0000\d\d(?: +0\.5756\d\d){3}\n",
    "environment.py": r"return -0\.\d{3}, position error at the end 0\.\d\d m\n"
    r"distance: met(?:.*\n)+",
    "falsify.py": r"violated after 1 run\(s\) by 1\.\d deg\n",
    "three_fmus.py": r"after 300 s: 0\.\d cm and 0\.\d deg off the reference\n",
    "own_controller.py": r"(?s).*position error after 5 min: at most \d\.\d mm\n",
}
"""Output of the scripts, by name; my_controller.py is run by the interoperability tests;
learn.py (test_learn_example.py) and psy_taliro.py need packages that no extra has.
"""
BY_FOLDER = ("three_fmus.py",)
"""Scripts that take the folder of the FMUs."""
QUICK = ("run_and_read.py", "own_controller.py", "three_fmus.py")
LONG = pytest.mark.long


def test_every_script_is_run():
    scripts = {path.name for path in EXAMPLES.glob("*.py")}
    assert scripts == {*PRINTS, "my_controller.py", "learn.py", "psy_taliro.py"}
    assert all(f"`{name}`" in (EXAMPLES / "README.md").read_text() for name in scripts)


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name in QUICK else LONG) for name in PRINTS],
)
def test_an_example_runs_and_prints_what_it_found(name, tmp_path):
    done = subprocess.run(
        [
            sys.executable,
            EXAMPLES / name,
            *([fmus()["target"].parent] if name in BY_FOLDER else []),
        ],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert re.fullmatch(PRINTS[name], done.stdout), done.stdout


def test_the_page_about_controllers_shows_the_controller_of_the_examples():
    page = (ROOT / "docs/own_controller.md").read_text()
    lines = (EXAMPLES / "my_controller.c").read_text().splitlines(keepends=True)
    code = "".join(line for line in lines if "SPDX" not in line)
    assert page.split("```c\n")[1].split("```")[0] == code


def test_the_gains_of_the_pid_controller_stay_within_the_limits():
    """And the published ones do not: the thrusters are at their limit all the time."""
    swap = {"controller": "pid_controller"}
    gains = run("sync_approach", swap=swap, params=EXAMPLES / "pid_gains.toml", every=10)
    assert {f.verdict for f in findings(gains)} == {Verdict.MET}
    published = run("sync_approach", swap=swap, params="limited", stop=600.0, every=10)
    force = {m.name: m for m in AT_LIMITS}["force at limit"]
    assert force(gains, Limits()) < 2
    assert force(published, Limits()) > 95
    assert [line for line in notes_of(published) if line.startswith("force at limit in ")]
    assert not [line for line in notes_of(gains) if " at limit in " in line]
