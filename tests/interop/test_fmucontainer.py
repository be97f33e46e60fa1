# SPDX-License-Identifier: BSD-2-Clause
"""fmucontainer on the systems of the project: what docs/other_tools.md states about it."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import pytest

from harness import load
from harness.files import paths

pytestmark = [
    pytest.mark.interop,
    pytest.mark.skipif(
        importlib.util.find_spec("fmu_manipulation_toolbox") is None,
        reason="fmu-manipulation-toolbox is not installed",
    ),
]


@pytest.mark.parametrize("system", sorted(paths.systems()))
@pytest.mark.tool("fmucontainer on the .ssp itself", "fmu-manipulation-toolbox")
def test_fmucontainer_by_itself_starts_every_system_but_drops_the_values_of_its_ssv(
    system, tmp_path
):
    """It begins loops with zero inputs; `harness export` to one FMU has all values."""
    shutil.copy(paths.systems()[system], tmp_path)
    with load(system) as found:
        step, steps = found.experiment.step, 5
        with_values = next(c for c in found.components if c.parameters)
    program = str(Path(sys.executable).with_name("fmucontainer"))
    command = [program, "-container", f"{system}.ssp:{step}", "-fmu-directory", "."]
    subprocess.run(command, capture_output=True, check=True, cwd=tmp_path, timeout=60)
    container = tmp_path / f"{system}.fmu"
    with zipfile.ZipFile(container) as archive:
        runtime = archive.read("resources/container.txt").decode().splitlines()
    name = Path(with_values.fmu).name
    head = runtime.index(next(x for x in runtime if x.startswith(f"# Start values of {name} - r")))
    assert runtime[head + 1] == "0 0"
    times = {"stop_time": steps * step, "step_size": step, "output_interval": step}
    if system == "ppc_tracking_navigated":  # without the values it begins outside of the funnel
        with pytest.raises(fmpy.fmi1.FMICallException, match="fmi2DoStep"):
            fmpy.simulate_fmu(str(container), **times)
    else:
        assert len(fmpy.simulate_fmu(str(container), **times)) == steps + 1
