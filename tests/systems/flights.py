# SPDX-License-Identifier: BSD-2-Clause
"""Flights of WebAssembly modules in node."""

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

SCRIPT = Path(__file__).with_name("fly.js")


def node(*arguments):
    """What a script of node prints, as data; skips the test where there is no node."""
    if (program := shutil.which("node")) is None:
        pytest.skip("needs node")
    said = subprocess.run(
        [program, *map(str, arguments)], capture_output=True, text=True, check=False
    )
    assert said.returncode == 0, said.stderr
    return json.loads(said.stdout)


def module(name, **changes):
    """The module of a system, and what its flight is told."""
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


def flown(folder, made, about):
    """What node says of a flight, and its rows."""
    flight, code, rows = folder / "flight.json", folder / "whole.wasm", folder / "rows"
    flight.write_text(json.dumps(about), encoding="utf-8")
    code.write_bytes(made.code)
    told = node(SCRIPT, flight, code, rows)
    return told, np.fromfile(rows).reshape(-1, len(about["columns"]))
