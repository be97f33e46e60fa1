# SPDX-License-Identifier: BSD-2-Clause
"""Runs per second of processor time of two rigid bodies around the earth in Basilisk (package
`bsk`): RK4 at 0.1 s for 1800 s, nothing is recorded, built anew for every run.

    PYTHON tests/bench/basilisk_runs.py
"""

from time import process_time
from typing import Any

from Basilisk.simulation import spacecraft, svIntegrators
from Basilisk.utilities import SimulationBaseClass, macros, simIncludeGravBody

STEP, STOP, RUNS = 0.1, 1800.0, 3


def body(number: int, gravity: Any) -> tuple[Any, Any]:
    """Return a rigid body with its integrator."""
    made = spacecraft.Spacecraft()
    made.ModelTag = f"body{number}"
    made.hub.mHub = 100.0 + 50 * number
    made.hub.IHubPntBc_B = [[50.0, 0, 0], [0, 60.0, 0], [0, 0, 40.0]]
    made.hub.r_CN_NInit = [[7.0e6 + 50 * number], [0], [0]]
    made.hub.v_CN_NInit = [[0], [7.546e3], [0]]
    made.hub.sigma_BNInit = [[0.1], [0.2], [-0.3]]
    made.hub.omega_BN_BInit = [[0.002], [0.01], [0.0]]
    made.gravField.gravBodies = spacecraft.GravBodyVector([*gravity.gravBodies.values()])
    integrator = svIntegrators.svIntegratorRK4(made)
    made.setIntegrator(integrator)
    return made, integrator


def run() -> None:
    simulation = SimulationBaseClass.SimBaseClass()
    process = simulation.CreateNewProcess("process")
    process.addTask(simulation.CreateNewTask("task", macros.sec2nano(STEP)))
    gravity = simIncludeGravBody.gravBodyFactory()
    gravity.createEarth().isCentralBody = True
    bodies = [body(number, gravity) for number in range(2)]
    for each, _ in bodies:
        simulation.AddModelToTask("task", each)
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(macros.sec2nano(STOP))
    simulation.ExecuteSimulation()


run()
began = process_time()
for _ in range(RUNS):
    run()
print(RUNS / (process_time() - began))
