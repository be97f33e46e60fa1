# SPDX-License-Identifier: BSD-2-Clause
"""Optional extras: a run needs none, and a command that needs one states how to install it."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from harness.errors import EXTRAS

LIBRARIES = sorted(name for names in EXTRAS.values() for name in names)
ROOT = Path(__file__).parents[2]
BARE = """
import sys
class Bare:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {names}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Bare())
from harness.cli import main
for line in sys.argv[1:]:
    print("status", main(line.split()), file=sys.stderr)
"""


def bare(folder, *lines):
    """Status and last words of command lines in a process that has no library of any extra."""
    script = BARE.format(names=set(LIBRARIES))
    done = subprocess.run(
        [sys.executable, "-c", script, *lines],
        cwd=folder, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert "Traceback" not in done.stderr
    found, reported = [], ""
    for line in done.stderr.splitlines():
        if line.startswith("status "):
            found.append((int(line.split()[1]), reported))
        reported = line
    assert len(found) == len(lines), done.stderr
    return found


def test_without_extras_a_system_runs_and_is_evaluated_and_the_rest_states_what_it_needs(tmp_path):
    (tmp_path / "c.toml").write_text(
        'system = "sync_approach"\nruns = 2\n[fixed]\nstop = 1.0\n'
        '[factors]\n"servicer.mass_0" = {uniform = {low = 90, high = 110}}\n'
        '[metrics]\nend = "last(time)"\n'
    )
    (tmp_path / "x.tle").write_text(
        "1 25544U 98067A   20194.88612269 -.00002218  00000-0 -31515-4 0  9992\n"
        "2 25544  51.6461 221.2784 0001413  89.1723 280.4612 15.49507896236008\n"
    )
    needing = {
        "plot x.csv": "plot",
        "report x.csv -o x.html": "report",
        "campaign c.toml -o c.zarr": "campaign",
        "run sync_approach --start target=x.tle -o y.csv": "exchange",
    }
    simulated, *others = bare(tmp_path, "run sync_approach --stop 5 -o x.csv", *needing)
    assert simulated[0] == 0, simulated[1]
    assert (tmp_path / "x.csv").is_file()
    for (status, reported), extra in zip(others, needing.values(), strict=True):
        assert status == 1, reported
        assert "pip install 'servicing-fmus[" in reported
        assert extra in reported or extra == "report", reported


NOT_FOR_A_RUN = [
    *(f"harness.cli.{name}" for name in ("look", "models", "studies", "verdicts")),
    *("harness.exports", "harness.studies.campaign", "importlib.metadata"),
]
"""Modules that a run could do without, each of which would lengthen every start."""


@pytest.mark.parametrize("ending", ["csv", "nc"])
def test_a_run_loads_no_extra_and_nothing_of_other_commands(tmp_path, ending):
    script = (
        "import gc, os, sys; from harness.cli import main\n"
        f"assert main(['run', 'sync_approach', '--stop', '1', '-o', 'x.{ending}']) == 0\n"
        f"print('loaded:', sorted(set({LIBRARIES + NOT_FOR_A_RUN}) & set(sys.modules)))\n"
        "print(sum(each['collections'] for each in gc.get_stats()), end=' ')\n"
        "print(len(os.listdir('/proc/self/task')) if sys.platform == 'linux' else 1)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        cwd=tmp_path, capture_output=True, text=True, check=True,
        env={k: v for k, v in os.environ.items() if k != "OPENBLAS_NUM_THREADS"},
    )  # fmt: skip
    loaded, counts = done.stdout.splitlines()[-2:]
    collections, threads = map(int, counts.split())
    assert loaded == "loaded: []"
    assert collections <= 40  # 150 by default
    assert threads == 1


def test_the_list_of_systems_loads_neither_numpy_nor_the_modules_of_a_run(tmp_path):
    """Once the text is in the cache, it is read with the hashes of the files alone."""
    script = (
        "import sys; from harness.cli import main\n"
        "main(['list'])\n"
        "print('loaded:', sorted({'harness.cli.runs', 'harness.ssp', 'numpy'} & set(sys.modules)))"
    )
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=True
        )
    assert done.stdout.splitlines()[-1] == "loaded: []"


@pytest.mark.skipif(not (ROOT / "pyproject.toml").is_file(), reason="the sources are not there")
def test_every_library_of_the_table_belongs_to_an_extra():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    needed = {text.partition(">")[0] for text in project["dependencies"]}
    assert needed == {"fmpy", "lxml", "msgspec", "netCDF4", "numpy", "rich", "tomli-w", "typer"}
    assert set(EXTRAS) <= set(extras)
