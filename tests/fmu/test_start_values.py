# SPDX-License-Identifier: BSD-2-Clause
"""What an FMU flies with if nobody says otherwise: the constants of its paper as the references of
the tests, which were written apart from it, have them, and the data sheets of sensors and filters.
"""

from __future__ import annotations

from dataclasses import asdict
from math import radians

import pytest

from ..reference import paper_case, ppc, relay, theta_d
from .driver import flat

STARS = {"sigma_A": (1.94e-4, 2.9e-5, 2.9e-5)}  # 40 arcsec about the boresight, 6 across
GYRO = {"sigma_v": 2.04e-5, "sigma_u": 8e-8}  # 0.07 deg/sqrt(h), 1 deg/h over an hour
FIX = {"sigma_fix_r": 5.0, "sigma_fix_v": 0.05}
CAMERA = {
    "sigma_range_0": 0.01,
    "sigma_range_2": 1e-4,
    "sigma_bearing_0": 0.002,
    "sigma_bearing_1": 5e-4,
    "sigma_theta_0": 0.0087,  # 0.5 deg
    "sigma_theta_1": 4.4e-4,
    "p_KS_S": (0.5, 0.0, 0.3),
    "q_KS": (1.0, 0.0, 0.0, 0.0),
    "p_GT_T": (0.6, 0.0, 0.0),
    "flip_axis": (1.0, 0.0, 0.0),
}
SENSORS_AND_FILTERS = {
    "star_tracker": STARS | {"sample_period": 0.5, "stream": 1, "rate_max": 0.05, "p_drop": 0},
    "gyro": GYRO
    | {
        "sample_period": 0.1,
        "stream": 2,
        "bias_0": (4.8e-6, -4.8e-6, 4.8e-6),
        "sigma_bias_0": (0,) * 3,
    }
    | {"misalignment": (0,) * 9, "quantum": 0},
    "pose_sensor": CAMERA
    | {"sample_period": 0.5, "stream": 3, "fov": 0.5236, "range_min": 0.5, "range_max": 100}
    | {"latency": 0.3, "outlier_r": 2, "outlier_theta": 1, "p_drop": 0, "p_flip": 0},
    "orbit_sensor": FIX | {"sample_period": 1.0, "stream": 4, "p_drop": 0},
    "attitude_filter": STARS
    | GYRO
    | {"sample_period": 0.1, "sigma_bias_0": 1e-3, "sigma_att_0": 0.1, "gate": 16.27}
    | {"reset_after": 10, "age_max": 60},
    "orbit_filter": FIX
    | {"a": 7158140, "e": 0.01, "inc": radians(30), "argp": radians(60), "raan": radians(120)}
    | {"nu": radians(30)}
    | {"sigma_r_0": 100, "sigma_v_0": 0.1, "sigma_a": 1e-4, "mass_hat": 95, "gate": 22.46}
    | {"reset_after": 10, "age_max": 100, "use_J2": 1},
    "relative_filter": CAMERA
    | {"sigma_rho_0": 1, "sigma_drho_0": 0.05, "sigma_att_0": 0.5, "sigma_omega_0": 0.02}
    | {"sigma_inertia_0": (0,) * 5, "sigma_p_0": (0,) * 3, "sigma_acc_0": 3e-4, "mass_hat": 95}
    | {"sigma_a": 3e-5, "sigma_thrust": 0.1, "sigma_alpha": 3e-5, "sigma_acc": 1e-6}
    | {"sigma_kappa": 0, "sigma_d": 0, "sigma_mount": 1e-4, "use_J2": 1}
    | {"use_gravity_gradient": 1, "acquire": 1, "reset_after": 10, "age_max": 5, "gate": 22.46}
    | {"use_time_stamp": 1, "resolve_flip": 0},
}
CASES = SENSORS_AND_FILTERS | {
    "ppc_controller": ppc.settings(ppc.Ppc()),
    "pid_controller": ppc.settings(ppc.Pid()),
    "theta_d_controller": ppc.settings(theta_d.ThetaD()),
    "adaptive_controller": asdict(paper_case.CONTROLLER) | {"t_att": 0},
    "pursuit_guidance": asdict(relay.Parameters()) | {"mu": 0},
}


@pytest.mark.parametrize("name", CASES)
def test_start_values_are_the_constants_of_the_paper(fmu, name):
    unit = fmu(name)
    wanted = {k: v for k, v in flat(CASES[name]).items() if k in unit.kind.references}
    other = {k: v for k, v in wanted.items() if unit.get(k) != pytest.approx(v.squeeze())}
    assert other == {}
    assert len(wanted) > 4
    if name in SENSORS_AND_FILTERS:
        assert wanted.keys() == flat(CASES[name]).keys()
