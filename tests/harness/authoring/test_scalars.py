# SPDX-License-Identifier: BSD-2-Clause
"""A system as one FMU of FMI 3.0 without arrays."""

from __future__ import annotations

import numpy as np
import pytest
from fmpy import simulate_fmu

from harness import export, run
from harness.errors import UsageError
from harness.system.interface import read_interface

SYSTEM, STEPS = "arch_rendezvous", 20


@pytest.mark.long
def test_elements_are_variables_with_the_bits_of_the_arrays(tmp_path):
    """FMPy reads every scalar by a reference of its own."""
    path = export(SYSTEM, tmp_path / "whole.fmu", 3, scalars=True)
    variables = read_interface(path).variables
    assert all(v.size == 1 for v in variables.values())
    whole = run(SYSTEM, stop=STEPS * 1.0)
    step = float(np.diff(whole.time)[0])
    names = [name for name in whole.columns if name in variables]
    assert sum("[" in name for name in names) > 20
    rows = simulate_fmu(
        str(path), stop_time=float(whole.time[-1]), step_size=step, output_interval=step,
        output=names,
    )  # fmt: skip
    for name in names:
        assert np.array_equal(rows[name], whole[name]), name


def test_scalars_need_fmi_3(tmp_path):
    for target, fmi in (("whole.fmu", None), ("whole.ssp", None)):
        with pytest.raises(UsageError, match=r"--scalars applies only to .fmu output with --fmi 3"):
            export(SYSTEM, tmp_path / target, fmi, scalars=True)
