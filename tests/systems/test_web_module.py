# SPDX-License-Identifier: BSD-2-Clause
"""Systems as WebAssembly modules in node: the bits of a run here, rejections in the words of the
models. Run by make test-wasm.
"""

from __future__ import annotations

import gzip
import hashlib

import numpy as np
import pytest

from harness import run
from harness.files import paths
from tests.systems.recordings import module, simulated

pytestmark = pytest.mark.wasm

LARGEST = 400_000
"""Bytes of a module as a page carries it."""


def differing(rows, result):
    """Values that have other bits."""
    assert rows.shape == result.values.shape
    return int((rows.view(np.uint64) != np.ascontiguousarray(result.values).view(np.uint64)).sum())


@pytest.mark.parametrize("system", sorted(paths.systems()))
def test_the_default_run_has_the_bits_of_the_fmus(tmp_path, system):
    made, about = module(system)
    stated, rows = simulated(tmp_path, made, about)
    result = run(system)
    assert stated["complete"] and stated["message"] == ""
    assert differing(rows, result) == 0
    assert stated["sha256"] == hashlib.sha256(result.values.tobytes()).hexdigest()
    assert len(gzip.compress(made.code)) <= LARGEST


def test_thinned_rows_and_other_values_have_the_bits_of_such_a_run(tmp_path):
    made, about = module("sync_approach", stop=30.05, step=0.05)
    about["values"][made.names.index("servicer.mass_0")] = 130.0
    about["every"] = 7
    _, rows = simulated(tmp_path, made, about)
    changes = {"set": {"servicer.mass_0": 130.0}, "stop": 30.05, "step": 0.05}
    assert differing(rows, run("sync_approach", every=7, **changes)) == 0


def test_a_rejected_value_is_reported_and_the_next_run_knows_nothing(tmp_path):
    made, about = module("sync_approach", stop=1.0)
    place = made.names.index("servicer.mass_0")
    good, about["values"][place] = about["values"][place], -1.0
    stated, rows = simulated(tmp_path, made, about)
    assert not stated["complete"] and len(rows) == 0
    assert "servicer.mass_0 = -1" in stated["message"] and "must be > 0" in stated["message"]
    about["values"][place] = good
    stated, _ = simulated(tmp_path, made, about)
    assert stated["complete"]
