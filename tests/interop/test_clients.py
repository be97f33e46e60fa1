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

from harness import load
from harness.files import paths

CLIENTS = Path(os.environ.get("CLIENTS", ""))
STEPS, STEP = 20, 0.1

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
