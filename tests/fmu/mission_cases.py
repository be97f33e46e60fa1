# SPDX-License-Identifier: BSD-2-Clause
"""Made-up runs for the mission manager: states of both bodies from distances, speeds and angles,
and a script that leads it into any phase.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from tests.reference import mission

from .theory import MU, dcm_of_quaternion, quaternion_of_dcm

P = 1.0
"""Sample period of these runs, s."""
QUICK = {"sample_period": P, "dwell": [3.0] * 15, "drift_step": 1200.0, "capture_time": 2.0}
QUICK |= {"v_final": 10.0, "v_back": 10.0}
"""Short waits and profiles, so that every phase is near."""
GEO = 42164e3
RATE = np.sqrt(MU / GEO**3)
AXIS = Rotation.from_euler("zyx", (0.7, -0.3, 0.2)).as_matrix()  # turns the orbit out of its axes
T = {
    "r_TN_N": AXIS @ (GEO, 0, 0),
    "v_TN_N": AXIS @ (0, GEO * RATE, 0),
    "q_TN": np.roll(Rotation.from_mrp((-0.02, 0.015, -0.25)).as_quat(), 1),
    "omega_TN_T": np.array((0.002, 0.01, 0)),
}
GROUND = {"mass": 100.0, "relative_valid": 1, "abort": 0, "retreat": 0, "resume": 0}
GROUND |= {"go_1": 1, "go_2": 1, "go_3": 1, "contact": 0, "soft": 0, "hard": 0, "done": 0}


def in_hill(rho_H, drho_H=(0, 0, 0), a=GEO, **other):
    """The servicer at rho_H with drho_H as seen in H; the target on a circular orbit."""
    n, rho, drho = np.sqrt(MU / a**3), AXIS @ np.array(rho_H, float), np.array(drho_H, float)
    orbit = {"r_TN_N": AXIS @ (a, 0, 0), "v_TN_N": AXIS @ (0, a * n, 0)}
    v = orbit["v_TN_N"] + AXIS @ (drho + np.cross((0, 0, n), rho_H))
    S = {"r_SN_N": orbit["r_TN_N"] + rho, "v_SN_N": v}
    S |= {"q_SN": (1, 0, 0, 0), "omega_SN_S": (0, 0, 0)}
    return T | orbit | S | GROUND | other


def on_axis(distance, off=0.0, v_rel=0.0, pointing=0.0, w_rel=0.0, **other):
    """The servicer `distance` along the grasp axis and `off` beside it, moving outwards with v_rel
    as seen in T, its X axis `pointing` away from -a, turning w_rel faster than T.
    """
    C_NT = dcm_of_quaternion(T["q_TN"]).T
    a, b, w_T = C_NT[:, 0], C_NT[:, 1], C_NT @ T["omega_TN_T"]
    rho = distance * a + off * b
    X = -np.cos(pointing) * a + np.sin(pointing) * b
    Z = C_NT[:, 2]
    C_SN = np.array((X, np.cross(Z, X), Z))
    S = {
        "r_SN_N": T["r_TN_N"] + rho,
        "v_SN_N": T["v_TN_N"] + np.cross(w_T, rho) + v_rel * a,
        "q_SN": quaternion_of_dcm(C_SN),
        "omega_SN_S": C_SN @ (w_T + w_rel * Z),
    }
    return T | S | GROUND | other


def line(R):
    return (0, -R, 0)


GOOD = {
    0: in_hill(line(100)),
    1: in_hill(line(100)),
    2: in_hill(line(20)),
    3: in_hill(line(20)),
    4: on_axis(20),
    5: on_axis(3),
    6: on_axis(3),
    7: on_axis(1.6, soft=1),
    8: on_axis(1.58, hard=1),
    9: on_axis(1.58, done=1) | {"omega_SN_S": (0, 0, 1e-4)},
    10: on_axis(1.58),
    11: on_axis(3),
    12: in_hill(line(201)),
    13: in_hill(line(300), resume=1),
    14: in_hill(line(300)),
}
"""Inputs that end each phase once they have held."""
STAY = {"soft": 0, "hard": 0, "done": 0, "resume": 0}
WAIT = {k: {"relative_valid": 0} for k in (0, 2, 4, 5, 11)}
WAIT |= {1: {"go_1": 0}, 3: {"go_2": 0}, 6: {"go_3": 0}}
HOLDING = {k: GOOD[k] | STAY | WAIT.get(k, {}) for k in GOOD}
"""The same place, but the phase stays."""

ROUTE = {1: 0, 2: 1, 3: 2, 4: 3, 5: 4, 6: 5, 7: 6, 8: 7, 9: 8, 10: 9, 11: 7, 12: 0, 13: 12, 14: 0}
"""Phase -> the one before it on the way."""
ORDER = {11: {"soft": 0, "contact": 1}, 12: {"retreat": 1}, 14: {"abort": 1}}
"""Inputs that lead into these phases."""


def path_to(phase):
    path = [phase]
    while path[0] != 0:
        path.insert(0, ROUTE[path[0]])
    return path


class Recording:
    """A manager led by made-up inputs, one sample at a time; the reference runs beside it and must
    agree in every output to 1e-9 (of 1, or of its size where that is larger).
    """

    def __init__(self, fmu, changes=None, start=0.0, place=GOOD[0]):
        self.p = QUICK | (changes or {})
        self.unit = fmu("mission_manager", self.p, place, start)
        self.model = mission.Manager(mission.PARAMETERS | self.p)
        self.found: dict[str, np.ndarray] = {}

    def sample(self, inputs):
        """Phase after one more sample."""
        t, unit = self.unit.time, self.unit
        expected = self.model.sample(inputs, t)
        references = [r for name in inputs for r in unit.kind.references[name]]
        unit.slave.setReal(references, [float(x) for v in inputs.values() for x in np.ravel(v)])
        unit.step(self.p["sample_period"])
        self.found = self.outputs()
        for name, value in expected.items():
            got = self.found[name]
            if name == "q_VN" and got @ value < 0:
                got = -got
            size = max(1.0, float(np.abs(value).max()))
            assert np.abs(got - value).max() <= 1e-9 * size, (name, t, self.model.phase)
        return int(self["phase"])

    def outputs(self):
        kind = self.unit.kind
        values = self.unit.slave.getReal([r for n in kind.outputs for r in kind.references[n]])
        sizes = np.cumsum([len(kind.references[name]) for name in kind.outputs])[:-1]
        return dict(zip(kind.outputs, np.split(np.array(values), sizes), strict=True))

    def __getitem__(self, name):
        value = self.found[name]
        return value if len(value) > 1 else value[0]

    def lead_to(self, phase, most=200):
        """Through the phases before it."""
        for before, after in pairwise(path_to(phase)):
            for _ in range(most):
                if self.sample(GOOD[before] | ORDER.get(after, {})) == after:
                    break
            else:
                raise AssertionError(f"phase {before} does not end")
        return self

    def stay(self, inputs, seconds):
        """Phases of the samples of so many seconds."""
        return [self.sample(inputs) for _ in range(round(seconds / self.p["sample_period"]))]
