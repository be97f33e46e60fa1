# SPDX-License-Identifier: BSD-2-Clause
"""A servicer under thrust and a free tumbling target, in numpy, with what relative_filter hears of
them.
"""

from __future__ import annotations

import numpy as np

from tests.reference import kalman
from tests.reference.attitude import conjugate, dcm, multiply
from tests.reference.cases import quaternion
from tests.reference.integrate import rk4_step
from tests.reference.kalman import rot, turn
from tests.reference.orbit import state_of_elements

from .theory import EARTH, MU

T = 0.1
ELEMENTS = {"a": 7158140.0, "e": 0.01, "inc": 0.5, "argp": 1.0, "raan": 2.0, "nu": 0.6}
J_T = np.array([[100, 4, -6], [4, 150, 5], [-6, 5, 90.0]])
POSE_SIGMAS = (0.01, 1e-4, 0.002, 5e-4, 0.0087, 4.4e-4)
POSE_NAMES = ("range_0", "range_2", "bearing_0", "bearing_1", "theta_0", "theta_1")
NO_POSE = {"pose_valid": 0, "pose_time": -1}
START_SIGMAS = {
    "rho": [1.0] * 3,
    "v": [0.05] * 3,
    "theta": [0.5] * 3,
    "w": [0.02] * 3,
    "kappa": [0.0] * 5,
    "d": [0.0] * 3,
    "a": [3e-4] * 3,
}
START_NAMES = {
    "rho": "sigma_rho_0",
    "v": "sigma_drho_0",
    "theta": "sigma_att_0",
    "w": "sigma_omega_0",
    "kappa": "sigma_inertia_0",
    "d": "sigma_p_0",
    "a": "sigma_acc_0",
}


def ratios(J):
    return np.array((J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])) / J[0, 0]


class World:
    """Sample by sample: slots (what the filter knows of the servicer), truth of the target."""

    def __init__(self, rng, thrust=2.0, rate=0.05, planet=EARTH, sigma_0=None, **model):
        self.rng, self.thrust, self.planet = rng, thrust, planet
        self.sigma_0 = START_SIGMAS | (sigma_0 or {})
        self.model = kalman.Relative(planet, sigma_0=self.sigma_0, **model)
        r, v = state_of_elements(MU, **ELEMENTS)
        self.F = [np.zeros(3)]
        self.turning = 0.05 * rng.normal(size=3)
        self.slots = [{"r": r, "v": v, "q": quaternion(rng), "thrust": np.zeros(3)}]
        self.start = kalman.start_relative(
            np.array((0.5, 20.6, -0.4)),
            np.array((0.01, -0.02, 0.005)),
            r,
            v,
            q=quaternion(rng),
            w=np.zeros(3),
            kappa=ratios(J_T),
            d=np.array((0.6, -0.3, 0.2)),
        )
        self.x = [self.start | {"w": rate * rng.normal(size=3)}]

    def parameters(self, **more):
        """Of the filter; start in Hill axes as in `start`."""
        m = self.model
        p = {START_NAMES[n]: s if n in ("kappa", "d") else s[0] for n, s in self.sigma_0.items()}
        p |= {f"sigma_{n}": s for n, s in zip(POSE_NAMES, m.noise, strict=True)}
        p |= {n: getattr(m, n) for n in ("sigma_a", "sigma_thrust", "sigma_alpha", "sigma_kappa")}
        p |= {n: getattr(m, n) for n in ("sigma_d", "sigma_acc", "sigma_mount", "mass_hat")}
        p |= {"p_KS_S": m.p_KS_S, "q_KS": m.q_KS, "gate": m.gate, "reset_after": m.reset_after}
        p |= {"use_gravity_gradient": m.gradient, "J_T": J_T, "p_GT_T": self.start["d"]}
        p |= {"rho_0_H": [0.5, 20.6, -0.4], "drho_0_H": [0.01, -0.02, 0.005]}
        p |= {"sigma_TN_0": kalman.mrp_of_quaternion(kalman.canonical(self.start["q"]))}
        return self.planet | p | {"sample_period": m.T} | more

    def advance(self):
        """The next sample: a command held over it, in the attitude of its start."""
        s, h = self.slots[-1], self.model.T
        F = self.thrust * self.rng.normal(size=3)
        s["thrust"] = dcm(s["q"]).T @ F / self.model.mass_hat
        start = np.concatenate((s["r"], s["v"]))

        def f(_, y):
            return np.concatenate((y[3:], kalman.gravity(y[:3], self.planet) + s["thrust"]))

        y = rk4_step(f, start, 0.0, h)
        q = multiply(s["q"], turn(h * self.turning))
        self.x.append(self.model.propagate(self.x[-1], np.zeros((23, 23)), s)[0])
        self.slots.append({"r": y[:3], "v": y[3:], "q": q, "thrust": np.zeros(3)})
        self.F.append(F)

    def inputs(self, k):
        while len(self.slots) <= k:
            self.advance()
        s = self.slots[k]
        return NO_POSE | {
            "r_SN_N_hat": s["r"],
            "v_SN_N_hat": s["v"],
            "q_SN_hat": s["q"],
            "omega_SN_S_hat": self.turning,
            "F_cmd_S": self.F[k],
        }

    def pose(self, m, wrong=(0, 0, 0), noise=1.0):
        """Taken at sample m: for the reference; `wrong` turns and moves it."""
        x, s = self.x[m], self.slots[m]
        h = self.model.predicted(x, s["q"])
        sigma_r, sigma_t = self.model.sigmas(np.linalg.norm(h))
        q_KN = multiply(s["q"], self.model.q_KS)
        error = rot(noise * sigma_t * self.rng.normal(size=3) + wrong)
        q = multiply(multiply(conjugate(q_KN), x["q"]), error)
        return {"r": h + noise * sigma_r * self.rng.normal(size=3) + wrong, "q": q}

    def port(self, m, pose):
        """The same as the filter hears it."""
        return {
            "r_GK_K": pose["r"],
            "q_TK": pose["q"],
            "pose_time": m * self.model.T,
            "pose_valid": 1,
        }
