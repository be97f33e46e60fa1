# SPDX-License-Identifier: BSD-2-Clause
"""Runs of WebAssembly modules in node."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from harness import load
from harness.master.changes import apply
from harness.master.fused import module_of
from harness.system.graph import checked

SCRIPT = Path(__file__).with_name("simulation.js")


def node(*arguments):
    """Return the output of a script of node as data; skip the test where there is no node."""
    if (program := shutil.which("node")) is None:
        pytest.skip("needs node")
    reported = subprocess.run(
        [program, *map(str, arguments)], capture_output=True, text=True, check=False
    )
    assert reported.returncode == 0, reported.stderr
    return json.loads(reported.stdout)


def module(name, **changes):
    """The module of a system, and the inputs of its run."""
    pytest.importorskip("ziglang", reason="needs ziglang: make test-wasm installs it")
    with load(name) as found:
        system = apply(found, **changes)
        steps = checked(system)
        made = module_of(system, steps)
    span = system.experiment
    return made, {
        "start": span.start,
        "step": span.step,
        "steps": steps.steps,
        "every": span.every,
        "columns": list(made.outputs.values()),
        "settings": list(made.references),
        "values": made.values.tolist(),
    }


def simulated(folder, made, about):
    """Return node's report of a run, and its rows."""
    recording, code, rows = folder / "run.json", folder / "whole.wasm", folder / "rows"
    recording.write_text(json.dumps(about), encoding="utf-8")
    code.write_bytes(made.code)
    stated = node(SCRIPT, recording, code, rows)
    return stated, np.fromfile(rows).reshape(-1, len(about["columns"]))
