# SPDX-License-Identifier: BSD-2-Clause
"""Proportional and derivative control of the position, in Python."""

import numpy as np
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

INPUTS = {"r_TN_N": 3, "v_TN_N": 3, "r_SN_N": 3, "v_SN_N": 3, "q_SN": 4}
INPUTS |= {"rho_ref_N": 3, "drho_ref_N": 3}
OUTPUTS = {"F_cmd_S": 3, "M_cmd_S": 3, "wheel_accel_cmd": 3}


class MyController(Fmi2Slave):
    description = "Proportional and derivative control of the position, in Python"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.K, self.D = 10.0, 60.0
        fixed = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.tunable}
        self.register_variable(Real("K", **fixed))
        self.register_variable(Real("D", **fixed))
        for names, causality in ((INPUTS, Fmi2Causality.input), (OUTPUTS, Fmi2Causality.output)):
            for name, size in names.items():
                setattr(self, name, np.zeros(size))
                for i in range(size):
                    self.register_variable(self.element(name, i, causality))

    def element(self, name, i, causality):
        def get():
            return float(getattr(self, name)[i])

        def put(value):
            getattr(self, name)[i] = value

        return Real(f"{name}[{i + 1}]", causality=causality, getter=get, setter=put)

    def control(self):
        e = self.r_SN_N - self.r_TN_N - self.rho_ref_N
        de = self.v_SN_N - self.v_TN_N - self.drho_ref_N
        w, v = self.q_SN[0], self.q_SN[1:]
        F_N = -self.K * e - self.D * de
        # C_SN F_N of the unit quaternion q_SN = [w, v]
        self.F_cmd_S[:] = F_N - 2 * w * np.cross(v, F_N) + 2 * np.cross(v, np.cross(v, F_N))

    def exit_initialization_mode(self):
        self.control()

    def do_step(self, current_time, step_size):
        self.control()
        return True
