# SPDX-License-Identifier: BSD-2-Clause
"""Python clients of FMUs, each in a virtual environment of its own: CLIENTS names the folder in
which `make clients` has made them.
"""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu

from harness import export, load
from harness.files import paths

CLIENTS = Path(os.environ.get("CLIENTS", ""))
STEPS, STEP = 20, 0.125
FORCES = ("F_S[1]", "F_S[2]", "M_S[3]")

pytestmark = [
    pytest.mark.interop,
    pytest.mark.skipif("CLIENTS" not in os.environ, reason="CLIENTS is not set: make clients"),
]

LOADER = """
import json, sys
from fmuloader.fmi2 import Fmi2Slave, Fmi2Type
from fmuloader.fmi3 import Fmi3Slave

path, name, token, references, steps, step, fmi = json.loads(sys.argv[1])
slave = (Fmi2Slave if fmi == 2 else Fmi3Slave)(path, model_identifier=name)
if fmi == 2:
    own = {"guid": token, "cannot_use_memory_management_functions": True}
    slave.instantiate("one", Fmi2Type.CO_SIMULATION, **own)
    slave.setup_experiment(0.0)
    slave.enter_initialization_mode()
else:
    slave.instantiate_co_simulation("one", instantiation_token=token)
    slave.enter_initialization_mode(start_time=0.0)
slave.exit_initialization_mode()
read = slave.get_real if fmi == 2 else slave.get_float64
rows = [read(references)]
for k in range(steps):
    slave.do_step(k * step, step)
    rows.append(read(references))
print(json.dumps(rows))
"""

GYM = """
import json, sys
import numpy as np
from fmugym import FMUGym, FMUGymConfig, VarSpace

path, inputs, outputs, steps, step = json.loads(sys.argv[1])


class Environment(FMUGym):
    def _noisy_init(self):
        return {}

    def compute_reward(self, *_):
        return 0.0


def space(names):
    found = VarSpace("space")
    for name in names:
        found.add_var_box(name, np.array([-1e9]), np.array([1e9]))
    return found


spaces = {"inputs": space(inputs), "outputs": space(outputs), "random_vars": space([])}
environment = Environment(FMUGymConfig(path, 0.0, steps * step, step, step, **spaces))
rows = [environment.reset()[0].tolist()]
for _ in range(steps):
    rows.append(environment.step(np.array([*inputs.values()]))[0].tolist())
print(json.dumps(rows))
"""

SOFIRPY = """
import json, sys
from sofirpy import simulate

path, inputs, outputs, steps, step = json.loads(sys.argv[1])
table = simulate(
    steps * step,
    step,
    fmu_paths={"one": path},
    start_values={"one": inputs},
    parameters_to_log={"one": outputs},
)
print(json.dumps(table[[f"one.{name}" for name in outputs]].to_numpy().tolist()))
"""

PATHSIM = """
import json, sys
from pathsim import Connection, Simulation
from pathsim.blocks import Constant, Scope
from pathsim_fmi import CoSimulationFMU

path, inputs, outputs, steps, step = json.loads(sys.argv[1])
unit, scope = CoSimulationFMU(path, dt=step), Scope()
sources = [Constant(value) for value in inputs.values()]
wires = [Connection(source, unit[name]) for name, source in zip(inputs, sources)]
wires += [Connection(unit[name], scope[k]) for k, name in enumerate(outputs)]
first = unit.outputs.to_array()[[unit.outputs._map(name) for name in outputs]].tolist()
Simulation([*sources, unit, scope], wires, dt=step, log=False).run((steps - 1) * step)
print(json.dumps([first, *scope.read()[1].T.tolist()]))
"""

COFMUPY = """
import json, sys
from cofmupy import Coordinator

coordinator = Coordinator()
coordinator.start(sys.argv[1])
try:
    for _ in range(int(sys.argv[2])):
        coordinator.do_step(float(sys.argv[3]), save_data=True)
except Exception as error:
    print(json.dumps(str(error)))
else:
    print(json.dumps("stepped"))
"""


def answered(client, script, *arguments):
    """Return what a script prints in the environment of a client."""
    command = [CLIENTS / client / "bin" / "python", "-c", script, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.tool("fmuloader", "0.1.2rc0")
@pytest.mark.parametrize("fmi", [2, 3])
def test_fmuloader_gives_the_bits_of_fmpy(fmi):
    """It binds every function of the standard when it loads a library. Its own functions for memory
    crash, so they are switched off; it reads no arrays.
    """
    path = paths.fmus()["target" if fmi == 2 else "servicer"]
    if fmi == 3:
        path = path.parent.parent / "fmus3" / path.name
    model = read_model_description(str(path))
    names = {
        v.name: v.valueReference
        for v in model.modelVariables
        if v.causality == "output" and not v.dimensions
    }
    token = model.guid if fmi == 2 else model.instantiationToken
    given = [str(path), model.modelName, token, [*names.values()], STEPS, STEP, fmi]
    rows = answered("fmuloader", LOADER, json.dumps(given))
    expected = simulate_fmu(
        str(path), stop_time=STEPS * STEP, step_size=STEP, output_interval=STEP, output=[*names]
    )
    assert len(names) >= (10 if fmi == 2 else 1)
    assert np.array_equal(np.array(rows), np.column_stack([expected[n] for n in names]))


@pytest.fixture(scope="module", params=[2, 3])
def robot(request, tmp_path_factory):
    """FMU with inputs of forces, of FMI 2.0 or as one FMU of FMI 3.0 without arrays: path, inputs,
    outputs, and the rows of FMPy after the start, whose outputs most clients read before the inputs
    are set. Multiples of the step are exact, so that all pass the same times.
    """
    path, prefix = paths.fmus()["space_robot"], ""
    if request.param == 3:
        path, prefix = tmp_path_factory.mktemp("scalar") / "robot.fmu", "robot."
        export("space_robot", path, fmi=3, scalars=True, step=STEP)
    inputs = {f"{prefix}{name}": 0.1 * k for k, name in enumerate(FORCES, 1)}
    model = read_model_description(str(path))
    outputs = [v.name for v in model.modelVariables if v.causality == "output"]
    times = {"stop_time": STEPS * STEP, "step_size": STEP, "output_interval": STEP}
    rows = simulate_fmu(str(path), start_values=inputs, output=outputs, **times)
    return path, inputs, outputs, np.column_stack([rows[name] for name in outputs])[1:]


def rows_of(client, script, robot):
    path, inputs, outputs, _ = robot
    given = json.dumps([str(path), inputs, outputs, STEPS, STEP])
    return np.array(answered(client, script, given))[1:]


@pytest.mark.tool("FMUGym", "0.2.0")
def test_fmugym_gives_the_numbers_of_fmpy(robot):
    """Its observations have single precision."""
    found, expected = rows_of("fmugym", GYM, robot), robot[-1]
    assert np.array_equal(found, expected.astype(np.float32).astype(float))
    assert np.ptp(found, axis=0).max() > 1


@pytest.mark.tool("sofirpy", "1.0.2")
def test_sofirpy_gives_the_bits_of_fmpy(robot):
    """It reads FMI 2.0 only."""
    if robot[0] != paths.fmus()["space_robot"]:
        pytest.skip("sofirpy has no FMI 3.0")
    assert np.array_equal(rows_of("sofirpy", SOFIRPY, robot), robot[-1])


@pytest.mark.tool("pathsim-fmi", "0.1.1")
def test_pathsim_gives_the_bits_of_fmpy(robot):
    """It shows the outputs at the end of a step at its start."""
    assert np.array_equal(rows_of("pathsim-fmi", PATHSIM, robot), robot[-1])


@pytest.mark.tool("cofmupy", "1.0.0")
@pytest.mark.parametrize("name", sorted(paths.systems()))
def test_cofmupy_starts_every_system(name, tmp_path):
    """It makes the first step with inputs of zero, which an FMU that needs a direction rejects."""
    with load(name) as system:
        ends = [(c.source, c.target) for c in system.connections]
        config = {
            "fmus": [
                {
                    "id": c.name,
                    "path": str(c.fmu),
                    "initialization": {n: float(p.value) for n, p in c.parameters.items()},
                }
                for c in system.components
            ],
            "connections": [
                {
                    "source": {"id": a.component, "variable": a.variable},
                    "target": {"id": b.component, "variable": b.variable},
                }
                for a, b in ends
            ],
            "cosim_method": "jacobi",
            "iterative": False,
        }
        file = tmp_path / "system.json"
        file.write_text(json.dumps(config))
        answer = answered("cofmupy", COFMUPY, file, 3, system.experiment.step)
        assert answer == "stepped" or "fmi2DoStep failed with status 3 (error)" in answer
