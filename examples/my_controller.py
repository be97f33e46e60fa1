# SPDX-License-Identifier: BSD-2-Clause
"""Proportional and derivative control of position and attitude, in Python."""

import numpy as np
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

INPUTS = {"r_TN_N": 3, "v_TN_N": 3, "r_SN_N": 3, "v_SN_N": 3, "q_SN": 4}
INPUTS |= {"omega_SN_S": 3, "rho_ref_N": 3, "drho_ref_N": 3, "q_DN": 4, "omega_DN_D": 3}
OUTPUTS = {"F_cmd_S": 3, "M_cmd_S": 3, "wheel_accel_cmd": 3}


def turned(q, x):
    """C x of the unit quaternion q = [w, v]."""
    w, v = q[0], q[1:]
    return x - 2 * w * np.cross(v, x) + 2 * np.cross(v, np.cross(v, x))


class MyController(Fmi2Slave):
    description = "Proportional and derivative control of position and attitude, in Python"

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.K, self.D = 10.0, 60.0
        self.K_att, self.D_att = 5.0, 45.0
        fixed = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.tunable}
        for name in ("K", "D", "K_att", "D_att"):
            self.register_variable(Real(name, **fixed))
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
        self.F_cmd_S[:] = turned(self.q_SN, -self.K * e - self.D * de)

        a, b, c, d = self.q_DN[0], self.q_DN[1:], self.q_SN[0], self.q_SN[1:]
        q_SD = np.array([a * c + b @ d, *(a * d - c * b - np.cross(b, d))])
        q_SD *= 1 if q_SD[0] >= 0 else -1
        rate = self.omega_SN_S - turned(q_SD, self.omega_DN_D)
        self.M_cmd_S[:] = -self.K_att * q_SD[1:] - self.D_att * rate

    def exit_initialization_mode(self):
        self.control()

    def do_step(self, current_time, step_size):
        self.control()
        return True
