# SPDX-License-Identifier: BSD-2-Clause
"""A system as one FMU: other tools accept it, and FMPy and libcosim get the bits of our own run
from it.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.validation import validate_fmu

from harness import load
from harness.errors import StructureError
from harness.exports.container import write_container
from harness.files import paths
from harness.master.simulation import simulate

pytestmark = [
    pytest.mark.interop,
    pytest.mark.skipif(
        importlib.util.find_spec("fmu_manipulation_toolbox") is None,
        reason="fmu-manipulation-toolbox is not installed",
    ),
]
MACRO_STEPS = 300


@pytest.fixture(scope="module", params=sorted(paths.systems()))
def system(request):
    return request.param


@pytest.fixture(scope="module", params=["jacobi", "gauss-seidel"])
def contained(request, system, tmp_path_factory):
    """Container of a system, its macro step, and our run with the same algorithm."""
    with load(system) as found:
        h = found.experiment.step
        stop = found.experiment.start + MACRO_STEPS * h
        changed = replace(
            found, experiment=replace(found.experiment, stop=stop, algorithm=request.param)
        )
        try:
            file = tmp_path_factory.mktemp("container") / f"{system}.fmu"
            write_container(changed, file)
            return file, h, simulate(changed)
        except StructureError as error:
            pytest.skip(f"{system}: {error}")


@pytest.mark.tool("fmucontainer + FMPy", "fmu-manipulation-toolbox")
def test_fmpy_gets_our_bits_out_of_a_container(contained):
    path, h, ours = contained
    assert validate_fmu(str(path)) == []
    stop = MACRO_STEPS * h
    theirs = fmpy.simulate_fmu(str(path), stop_time=stop, step_size=h, output_interval=h)
    assert sorted(theirs.dtype.names) == sorted(("time", *ours.columns))
    different = [name for name in ours.columns if not np.array_equal(theirs[name], ours[name])]
    assert different == []


@pytest.mark.tool("fmucontainer + libcosim", "fmu-manipulation-toolbox")
def test_libcosim_steps_a_container(contained):
    pytest.importorskip("libcosimpy", reason="libcosimpy is not installed")
    path, h, ours = contained
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
    from libcosimpy.CosimSlave import CosimLocalSlave

    log_output_level(CosimLogLevel.FATAL)
    execution = CosimExecution.from_step_size(step_size=round(h * 1e9))
    index = execution.add_local_slave(CosimLocalSlave(str(path), "whole"))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer=observer)
    assert execution.step(MACRO_STEPS)
    variables = execution.slave_variables(index)
    values = observer.last_real_values(index, [v.reference for v in variables])
    got = {v.name.decode(): value for v, value in zip(variables, values, strict=True)}
    assert got == {name: ours[name][-1] for name in ours.columns}


@pytest.mark.tool("fmutool -check", "fmu-manipulation-toolbox")
def test_fmutool_finds_no_fault_in_a_container(contained):
    path, _, _ = contained
    command = [str(Path(sys.executable).with_name("fmutool")), "-input", str(path), "-check"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    assert "No semantic error" in done.stdout + done.stderr


def test_the_same_system_gives_the_same_container(system, tmp_path):
    first, again = tmp_path / "a.fmu", tmp_path / "again" / "a.fmu"
    again.parent.mkdir()
    with load(system) as found:
        try:
            write_container(found, first)
        except StructureError as error:
            pytest.skip(f"{system}: {error}")
        write_container(found, again)
    assert again.read_bytes() == first.read_bytes()


@pytest.mark.parametrize("system", sorted(paths.systems()))
@pytest.mark.tool("fmucontainer on the .ssp itself", "fmu-manipulation-toolbox")
def test_fmucontainer_by_itself_starts_every_system_but_drops_the_values_of_its_ssv(
    system, tmp_path
):
    """It begins loops with zero inputs; the harness writes containers because of the values."""
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
