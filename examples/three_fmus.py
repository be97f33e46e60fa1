# SPDX-License-Identifier: BSD-2-Clause
"""Three FMUs in a master of your own, with FMPy alone: a servicer stays 20 m beside a target.

The start values of these FMUs belong to the system sync_approach, so they fit each other.
"""

import sys

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

FOLDER, STEP, STOP = (sys.argv[1] if len(sys.argv) > 1 else "build/fmus"), 0.1, 300.0


class Fmu:
    def __init__(self, name, **start):
        file = f"{FOLDER}/{name}.fmu"
        about = read_model_description(file)
        self.places = {v.name: v.valueReference for v in about.modelVariables}
        kind = about.coSimulation.modelIdentifier
        self.fmu = FMU2Slave(guid=about.guid, unzipDirectory=extract(file), modelIdentifier=kind)
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=0.0, stopTime=STOP)
        self.put(**start)
        self.fmu.enterInitializationMode()

    def places_of(self, name):
        return [r for n, r in self.places.items() if n == name or n.startswith(f"{name}[")]

    def get(self, *names):
        return {name: np.array(self.fmu.getReal(self.places_of(name))) for name in names}

    def put(self, **values):
        for name, value in values.items():
            self.fmu.setReal(self.places_of(name), np.ravel(value).tolist())


fmus = target, servicer, controller = (
    Fmu("target"),
    Fmu("servicer", t_att=0.0),
    Fmu("adaptive_controller", t_att=0.0),
)
begin = servicer.get("r_SN_N")["r_SN_N"] - target.get("r_TN_N")["r_TN_N"]
controller.put(rho_ref_N=begin)
for each in fmus:
    each.fmu.exitInitializationMode()
for time in np.arange(0.0, STOP, STEP):
    controller.put(**target.get("r_TN_N", "v_TN_N", "q_TN", "omega_TN_T"))
    controller.put(**servicer.get("r_SN_N", "v_SN_N", "q_SN", "omega_SN_S", "wheel_speed"))
    controller.fmu.doStep(time, STEP)
    servicer.put(F_S=controller.get("F_cmd_S")["F_cmd_S"], **controller.get("wheel_accel_cmd"))
    servicer.fmu.doStep(time, STEP)
    target.fmu.doStep(time, STEP)
away = servicer.get("r_SN_N")["r_SN_N"] - target.get("r_TN_N")["r_TN_N"] - begin
turned = 2 * np.degrees(np.arccos(abs(servicer.get("q_SN")["q_SN"][0])))
print(
    f"after {STOP:g} s: {100 * np.linalg.norm(away):.1f} cm and {turned:.1f} deg off the reference"
)
for each in fmus:
    each.fmu.terminate()
