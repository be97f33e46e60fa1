# SPDX-License-Identifier: BSD-2-Clause
"""Property tests draw the same examples wherever they run, and say how to repeat what chance has
found.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

ROOT = Path(__file__).parents[2]


def drawn():
    """Return the examples with which a property is tried."""
    found = []

    @given(st.text(max_size=5), st.integers(), st.floats(allow_nan=False))
    def collect(text, whole, real):
        found.append((text, whole, real))

    collect()
    return found


def test_the_examples_do_not_depend_on_other_loaded_modules(tmp_path, monkeypatch):
    assert settings().derandomize or settings.get_current_profile_name() == "random"
    before = drawn()
    names = [f"loaded_{i}" for i in range(20)]
    constants = "\n".join(f"A{i} = {10**9 + i}, {i + 0.123}, 'constant{i}'" for i in range(200))
    monkeypatch.syspath_prepend(tmp_path)
    for name in names:
        (tmp_path / f"{name}.py").write_text(constants)
        __import__(name)
    if settings().derandomize:
        assert drawn() == before


FAILING = """
from hypothesis import given, strategies as st

@given(st.integers())
def test_small(n):
    assert n < 1000
"""


def test_a_failure_at_random_prints_the_line_that_repeats_it(tmp_path):
    module = tmp_path / "test_fails.py"
    module.write_text(FAILING)
    options = ["-n", "0", "-q", "--hypothesis-profile=random", "--hypothesis-seed=771"]
    command = [sys.executable, "-m", "pytest", *options, "-p", "tests.conftest", str(module)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 1, run.stderr
    begin = ".venv/bin/pytest -n 0 -m '' --hypothesis-profile=random --hypothesis-seed=771 "
    (line,) = (line for line in run.stdout.splitlines() if line.startswith(begin))
    assert line.endswith("test_fails.py::test_small")
