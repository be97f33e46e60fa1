# SPDX-License-Identifier: BSD-2-Clause
"""The same .ssp, unchanged, in other masters: every output has the bits of our Jacobi run in which
all components have the period of the macro step. libcosim gives the bits of slower components too,
from a file with hints; ecos reads the outputs of such a component before its step is over.
"""

import importlib
import importlib.util
import platform
from dataclasses import replace

import numpy as np
import pytest

from harness import export, load
from harness.files import paths
from harness.master.changes import apply
from harness.master.simulation import Simulation
from harness.ssp.writer import write_ssp
from tests.systems import docking_case

pytestmark = pytest.mark.interop

DOCKING = "docking"
"""Contact and capture of a pair, with the latency that a Jacobi master requires."""
FLEXIBLE = "flexible"
"""sync_approach with panels that swing and propellant that sloshes."""
SYSTEMS = [*sorted(paths.systems()), DOCKING, FLEXIBLE]
SLOW = ("arm_capture_navigated", *(n for n in SYSTEMS if n.startswith("servicing_mission")))
"""Systems in which the software has a longer period than the plants."""
MACRO_STEPS = 1000
CHECKED = (1, 2, 3, 10, 100, 500, 1000)
"""Macro steps after which all outputs are compared."""


def require(module):
    """Import a master, or skip and say why."""
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"{module} is not installed on {platform.system()}")
    try:
        return importlib.import_module(module)
    except OSError as error:
        pytest.skip(f"{module} does not load: {error}")


def jacobi(path, every=None):
    """Return macro step and result of our Jacobi run; every: period of all components."""
    with load(path) as system:
        h = system.experiment.step
        stop = system.experiment.start + MACRO_STEPS * h
        experiment = replace(system.experiment, stop=stop, algorithm="jacobi", every=1)
        components = tuple(replace(c, every=every or c.every) for c in system.components)
        with Simulation(replace(system, components=components, experiment=experiment)) as run:
            run.advance()
            return h, run.result()


@pytest.fixture(scope="module", params=SYSTEMS)
def ours(request, tmp_path_factory):
    """Path of the .ssp, macro step, rows of our Jacobi run by column name."""
    path = paths.systems().get(request.param) or (
        tmp_path_factory.mktemp("ssp") / f"{request.param}.ssp"
    )
    if request.param == DOCKING:
        write_ssp(docking_case.capture_a_step_late(), path)
    if request.param == FLEXIBLE:
        with load("sync_approach") as system:
            write_ssp(apply(system, swap=["servicer=flexible_servicer"]), path)
    h, result = jacobi(path, every=1)
    if request.param == DOCKING:
        assert {1, 2} <= set(result["mechanism.phase"])
    return path, h, result


def same_bits(theirs, result, k):
    names = list(theirs)
    expected = np.array([result[name][k] for name in names])
    got = np.array([theirs[name] for name in names])
    different = [n for n, a, b in zip(names, got, expected, strict=True) if a != b]
    assert not different, (
        f"after {k} macro steps {len(different)} of {len(names)} outputs differ: {different[:5]}"
    )
    assert set(names) == set(result.columns)


@pytest.mark.tool("libcosim", "libcosimpy")
def test_libcosim_gives_our_bits(ours):
    path, _, result = ours
    compared_in_libcosim(path, result)


@pytest.mark.parametrize("name", SLOW)
@pytest.mark.tool("libcosim", "libcosimpy")
def test_libcosim_gives_our_bits_of_slow_components_from_hints(name, tmp_path):
    path = export(name, tmp_path / "hinted.ssp", hints=True)
    compared_in_libcosim(path, jacobi(path)[1])


def compared_in_libcosim(path, result):
    require("libcosimpy")
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    log_output_level(CosimLogLevel.ERROR)
    execution = CosimExecution.from_ssp_file(str(path))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer=observer)
    execution.real_time_simulation_enabled(enabled=False)
    slaves = {info.name.decode(): info.index for info in execution.slave_infos()}
    done = 0
    for k in CHECKED:
        assert execution.step(k - done)
        done = k
        same_bits(libcosim_outputs(execution, observer, slaves), result, k)


def libcosim_outputs(execution, observer, slaves):
    values = {}
    for slave, index in slaves.items():
        outputs = [
            v for v in execution.slave_variables(index) if v.causality == 2
        ]  # COSIM_VARIABLE_CAUSALITY_OUTPUT
        numbers = observer.last_real_values(index, [v.reference for v in outputs])
        values |= {f"{slave}.{v.name.decode()}": x for v, x in zip(outputs, numbers, strict=True)}
    return values


@pytest.mark.tool("ecos", "ecospy")
def test_ecos_gives_our_bits(ours):
    ecospy = require("ecospy")
    path, h, result = ours
    with ecospy.EcosSimulation(h, ssp_path=str(path)) as simulation:
        assert simulation.init(parameter_set="default")
        done = 0
        for k in CHECKED:
            simulation.step(k - done)
            done = k
            theirs = {
                column: simulation.get_real(column.replace(".", "::", 1))
                for column in result.columns
            }
            same_bits(theirs, result, k)
