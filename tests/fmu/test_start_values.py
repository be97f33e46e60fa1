# SPDX-License-Identifier: BSD-2-Clause
"""Default values of an FMU: the constants of its paper, as in the references of the tests, which
were written independently, and the data sheets of sensors and filters. A value that is not named
here is zero.
"""

from __future__ import annotations

from dataclasses import asdict
from math import pi, radians, sqrt

import numpy as np
import pytest

from tests.each import each

from ..reference import (
    arm,
    assembly,
    carried,
    docking,
    guidance,
    mission,
    optimal,
    paper_case,
    ppc,
    relay,
    safety_filter,
    theta_d,
)
from ..reference.arm_software import CONTROL, GUIDANCE
from ..reference.transposition import Cluster, Planning, Tracking
from .assembly_cases import PANELS
from .driver import archive, flat
from .robot_cases import PAPER

AHEAD = (1, 0, 0, 0)
EARTH = {name: paper_case.ORBIT[name] for name in ("mu", "R_E", "J2")}
PLANET = {"mu": 3.986004415e14}
# ---- unconnected inputs: a circular orbit, nothing turns
TARGET = {"r_TN_N": (7158140, 0, 0), "v_TN_N": (0, 7462.286, 0), "q_TN": AHEAD}
BEHIND = {"r_SN_N": (7158140, 20, 0), "v_SN_N": (-0.0208, 7462.286, 0), "q_SN": AHEAD}
"""20 m along track, at rest in H: -20 n"""
AWAY = (-180, 180, sqrt(300**2 - 2 * 180**2))
"""300 m, 45 deg below the track"""
FAR = {"r_SN_N": np.add((7158140, 0, 0), AWAY), "v_SN_N": (0, 7462.286, 0), "q_SN": AHEAD}
LOS = TARGET | FAR | {"rho_ref_N": AWAY, "q_DN": AHEAD}
BOTH = {"q_TN": AHEAD, "q_SN": AHEAD}

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
    "star_tracker": STARS
    | {"q_AS": AHEAD, "sun_N": (1, 0, 0), "q_SN": AHEAD}
    | {"sample_period": 0.5, "stream": 1, "rate_max": 0.05, "p_drop": 0},
    "gyro": GYRO
    | {
        "q_SN": AHEAD,
        "sample_period": 0.1,
        "stream": 2,
        "bias_0": (4.8e-6, -4.8e-6, 4.8e-6),
        "sigma_bias_0": (0,) * 3,
    }
    | {"misalignment": (0,) * 9, "quantum": 0},
    "pose_sensor": CAMERA
    | {"sun_N": (1, 0, 0), "r_TN_N": (20, 0, 0), "q_TN": AHEAD, "q_SN": AHEAD}
    | {"sample_period": 0.5, "stream": 3, "fov": 0.5236, "range_min": 0.5, "range_max": 100}
    | {"latency": 0.3, "outlier_r": 2, "outlier_theta": 1, "p_drop": 0, "p_flip": 0}
    | {"fault_duration": 0},
    "orbit_sensor": FIX | {"sample_period": 1.0, "stream": 4, "p_drop": 0},
    "range_sensor": {"sample_period": 0.5, "stream": 5, "p_drop": 0, "sigma_range_0": 0.1}
    | {"sigma_range_1": 1e-3, "bias_0": 0, "sigma_bias_0": 0, "range_min": 0.5, "range_max": 5000}
    | {"latency": 0.1, "r_TN_N": (20, 0, 0)},
    "attitude_filter": STARS
    | GYRO
    | {"q_AS": AHEAD, "acquire": 1, "q_AN": AHEAD, "gyro_time": -1, "star_time": -1}
    | {"sample_period": 0.1, "sigma_bias_0": 1e-3, "sigma_att_0": 0.1, "gate": 16.27}
    | {"reset_after": 10, "age_max": 60},
    "orbit_filter": FIX
    | EARTH
    | {"sample_period": 0.1, "acquire": 1, "fix_time": -1, "q_SN": AHEAD}
    | {"a": 7158140, "e": 0.01, "inc": radians(30), "argp": radians(60), "raan": radians(120)}
    | {"nu": radians(30)}
    | {"sigma_r_0": 100, "sigma_v_0": 0.1, "sigma_a": 1e-4, "mass_hat": 95, "gate": 22.46}
    | {"reset_after": 10, "age_max": 100, "use_J2": 1},
    "relative_filter": CAMERA
    | EARTH
    | {"sample_period": 0.1, "J_T": paper_case.J_T, "rho_0_H": (0, 20, 0)}
    | {"r_SN_N_hat": (7158140, 0, 0), "v_SN_N_hat": (0, 7462.286, 0), "q_SN_hat": AHEAD}
    | {"q_TK": AHEAD, "pose_time": -1}
    | {"sigma_rho_0": 1, "sigma_drho_0": 0.05, "sigma_att_0": 0.5, "sigma_omega_0": 0.02}
    | {"sigma_inertia_0": (0,) * 5, "sigma_p_0": (0,) * 3, "sigma_acc_0": 3e-4, "mass_hat": 95}
    | {"sigma_a": 3e-5, "sigma_thrust": 0.1, "sigma_alpha": 3e-5, "sigma_acc": 1e-6}
    | {"sigma_kappa": 0, "sigma_d": 0, "sigma_mount": 1e-4, "use_J2": 1}
    | {"use_gravity_gradient": 1, "acquire": 1, "reset_after": 10, "age_max": 5, "gate": 22.46}
    | {"use_time_stamp": 1, "resolve_flip": 0},
}
ORBIT = {name: paper_case.ORBIT[name] for name in ("a", "e", "inc", "argp", "raan", "nu")}
LINEAR = {"rho": -0.04, "drho": -4.0}
SATELLITE = EARTH | ORBIT | {"use_J2": 1, "max_step": 0.1}
STATION = assembly.Assembly()
BOTH_BODIES = {
    "m0": STATION.mass[0],
    "m1": STATION.mass[1],
    "J0": STATION.J0,
    "J1": STATION.J1,
    "hinge": STATION.node,
    "module": STATION.arm,
    "box_0": (16, 4, 4),
    "box_1": (14, 4, 4),
    "panel_area": (*(panel[1] for panel in PANELS), 0),
    "panel_body": (*(panel[0] for panel in PANELS), 0),
    "panel_position": (*(panel[2] for panel in PANELS), (0, 0, 0)),
    "panel_normal": (*(panel[3] for panel in PANELS), (0, 0, 1)),
    "mu": STATION.mu,
    "R_C": STATION.R_C,
    "rho": STATION.rho,
    "C_D": STATION.C_D,
}
SWING = dict(zip(("swing_start", "swing_duration", "swing_angle"), STATION.swing, strict=True))
SWING |= {"swing_smooth": 1}
GYROS = {"h_w": Cluster.h_w, "gimbal_rate_max": Cluster.fastest}
GIMBALS = np.radians(Cluster.start)
THRUSTERS = {
    "thruster_position": [position for position, _ in relay.GEOMETRY] + 3 * [(0, 0, 0)],
    "thruster_direction": [direction for _, direction in relay.GEOMETRY] + 3 * [(0, 0, 0)],
    "thrust_nominal": 8 * [0.5] + 4 * [10] + [50] + 3 * [0],
    "centre_of_mass": relay.CENTRE_OF_MASS,
}
RELAY = relay.Parameters()
PLANTS = {
    "target": SATELLITE
    | {"mass": 100, "J_T": paper_case.J_T, "use_gravity_gradient": 1}
    | {name: getattr(paper_case.TARGET, name) for name in ("sigma_TN_0", "omega_TN_T_0")},
    "servicer": SATELLITE
    | {"rho_0_H": (0, 20, 0), "mass_0": 100, "J_S": paper_case.J_S, "A_w": paper_case.A_W},
    "space_robot": asdict(PAPER)
    | {"a": 7e6, "mu": 3.986004418e14, "use_gravity_gradient": 1, "max_step": 1}
    | {"joint_angle_0": (radians(30), radians(20))},
    "assembly": BOTH_BODIES
    | SWING
    | GYROS
    | {"H_sat": 1500, "gimbal_angle_0": GIMBALS}
    | {"use_gravity_gradient": 1, "use_aero": 1, "max_step": 0.5},
    "propulsion": THRUSTERS | {name: getattr(RELAY, name) for name in ("T0", "Tl", "T2up", "T2dn")},
    "ideal_propulsion": {"max_step": 0.1},
    "docking_mechanism": docking.PARAMETERS
    | {"q_TN": AHEAD, "q_SN": (0, 0, 0, 1), "r_SN_N": (3, 0, 0)},
}
GUIDANCES = {
    "stack_guidance": {"J_stack": np.diag((300, 550, 390)), "A_w": paper_case.A_W}
    | {"wheel_accel_max": 0.01, "wheel_speed_max": 0.3, "torque_share": 0.5, "duration_min": 60}
    | {"unload_on": 0.7, "unload_off": 0.1, "k_unload": 0.02, "M_unload_max": 0.05}
    | {"q_TN": AHEAD, "q_SN": AHEAD, "active": 1},
    "sync_guidance": asdict(guidance.Parameters())
    | asdict(carried.Steering())
    | {"J_T": paper_case.J_T, "active": 1, "L_ref": 4, "inertia_hat": (1.5, 0.9, 0, 0, 0)}
    | TARGET
    | BEHIND,
    "los_guidance": TARGET
    | FAR
    | {"mu": 3.986004418e14, "J_T": paper_case.J_T, "p_T": (1, 0, 0), "sun_N": (0.3, 0.9, 0.3)}
    | {"rho_f": 20, "force_scale": 100, "up_axis": 2, "guard_angle": 1e-3}
    | {"elevation_limit": radians(80), "range_limit": 5, "active": 1},
    "pursuit_guidance": asdict(RELAY)
    | {"mu": 0, "omega_fire": 2e-3, "t_burn_min": 0.5, "main_thrust": 5, "brake_thrust": 4}
    | {"r_TN_N": RELAY.r_tar, "v_TN_N": RELAY.v_tar, "active": 1}
    | BOTH,
    "transposition_guidance": BOTH_BODIES
    | SWING
    | {"window": Planning.stop, "nodes": 24, "H_sat": Planning.H_sat, "use_plan": 1}
    | {"momentum_share": Planning.margin, "rotation_max": Planning.limit}
    | {"alpha": Planning.step, "lambda": Planning.smoothing, "iterations_max": 25},
}
CONTROLLERS = {
    "ppc_controller": ppc.settings(ppc.Ppc()) | LOS | {"position": 1},
    "pid_controller": ppc.settings(ppc.Pid()) | LOS,
    "theta_d_controller": ppc.settings(theta_d.ThetaD()) | LOS,
    "adaptive_controller": asdict(paper_case.CONTROLLER)
    | {"t_att": 0, "rho_ref_N": (0, 20, 0), "q_DN": AHEAD}
    | TARGET
    | BEHIND,
    "switched_controller": LOS
    | PLANET
    | {
        f"K_{error}_{phase}": np.diag((gain,) * 3)
        for phase in (1, 2, 3)
        for error, gain in LINEAR.items()
    }
    | {"axis_H": (0, 1, 0), "t_abort": 1e9, "K_att": (40,) * 3, "P_att": (60,) * 3}
    | {"M_max": (10,) * 3, "wheel_scale": 10},
    "relay_controller": {name: getattr(RELAY, name) for name in ("law", "Kp_v", "Kd_v")}
    | {name: getattr(RELAY, name) for name in ("rho1", "rho2")}
    | {name: (getattr(RELAY, name),) * 3 for name in ("Kp_w", "Kd_w", "xi1", "xi2")}
    | BOTH
    | {"q_DN": AHEAD},
    "thruster_allocation": THRUSTERS
    | {"weight_F": (1, 1, 1), "weight_M": (1, 1, 1), "keep_direction": 1}
    | {"pulse_period": 1, "min_on_time": 0.2, "sample_period": 0.1, "lost": (0,) * 16},
    "joint_controller": {"joint_angle_ref": (radians(60), radians(-40))}
    | {"Kp": (2, 1), "Kd": (60, 20)},
    "assembly_controller": BOTH_BODIES
    | {"law": 1, "k1": Tracking.k1, "k2": Tracking.k2, "k2_printed": 3000, "use_plan_rate": 1}
    | {"q_SH": (0.5, -0.5, -0.5, 0.5), "q_DH": (0.5, -0.5, -0.5, 0.5)},
    "cmg_steering": GYROS
    | {"use_cluster": 1, "gimbal_angle": GIMBALS}
    | {"lambda_0": Cluster.damping, "k_null": Cluster.k_null},
    "mission_manager": mission.PARAMETERS
    | {"r_TN_N": (42164000, 0, 0), "v_TN_N": (0, 3074.66, 0), "q_TN": AHEAD}
    | {"r_SN_N": (42164000, -100, 0), "v_SN_N": (0.00729, 3074.66, 0), "q_SN": AHEAD}
    | {"mass": 100, "relative_valid": 1, "go_1": 1, "go_2": 1, "go_3": 1},
    "command_selector": {"main_thrust": 2, "brake_thrust": 2, "relay_torque": (0.5,) * 3}
    | {"A_w": np.diag((12, 15, 10)), "push_force": 1, "blend_time": 5, "sample_period": 0.1}
    | {"wheel_speed_max": 0.3, "unload_on": 0.7, "unload_off": 0.1, "M_unload_max": 0.05},
    "timeline": {"times": (1e30,) * 16, "rows": ((1, 1, 1, 0, 0, 1),) * 16},
    "safety_monitor": TARGET
    | BEHIND
    | EARTH
    | {"use_J2": 1, "keep_out_shape": 1, "keep_out_half": (2, 2, 2), "corridor_axis": (0, 1, 0)}
    | {
        "corridor_half_angle": radians(20),
        "speed_at_zero": 0.1,
        "speed_slope": 0.01,
        "tumble_max": 0.04,
    }
    | {"passive_step": 60, "plume_half_angle": radians(20), "plume_range": 20}
    | {"plume_force_min": 1e-3, "lost_time": 20, "abort_on": (1,) * 7, "mass": 100}
    | {"abort_force": 20, "abort_speed": 0.1, "approaching": 1, "relative_valid": 1}
    | {"use_range": 0, "range_at_zero": 1, "range_slope": 0.01, "range_patience": 5}
    | {"range_tau": 10, "range_alone": 0, "range_meas": 0, "range_time": -1, "range_valid": 0}
    | {"abort_relative": 1, "axis_radius": 3, "abort_time": 1e30, "escape_reserve": (1, 0)}
    | {"e_r": 0.05, "e_v": 5e-3, "k_p": 0.05, "k_n": 0.01, "r_max": 80, "e_model": 1e-8},
    "safety_filter": TARGET
    | BEHIND
    | {k: v for k, v in asdict(safety_filter.Settings()).items() if v}
    | {"approaching": 1, "relative_valid": 1},
}
CONTROLLERS |= {
    name: CONTROLLERS[name] | {"active": 1} for name in CONTROLLERS if name.endswith("_controller")
}
CONTROLLERS["optimal_controller"] = (
    {name: value for name, value in optimal.DEFAULTS.items() if np.any(value)}
    | {name: asdict(paper_case.CONTROLLER)[name] for name in ("K_att", "P_att", "eta_hat_0")}
    | {"use_attitude": 1, "use_wheels": 1, "sample_period": 0.1, "q_DN": AHEAD}
    | {"mass": 95, "goal": 3}
    | TARGET
    | BEHIND
)
ARM = arm.DEFAULT.parameters()
RIGID = {"friction_rate": 0.005, "joint_angle_0": arm.STOWED, "joint_lock": (1,) * 7}
NEAR = {"r_SN_N": (7158142.6, 0, 0), "v_SN_N": (0, 7462.286, 0), "q_SN": (0, 0, 0, 1)}
ARMS = {
    "arm_servicer": PLANTS["servicer"] | ARM | RIGID,
    "arm_guidance": ARM | GUIDANCE | TARGET | NEAR | {"arm_mode_cmd": -1},
    "arm_controller": ARM | CONTROL,
}
MIRRORED = [[0, 1, 0], [0, -1, 0]] * 2
"""Along +y for parts 1 and 3, along -y for 2 and 4"""
PARTS = {
    "panel_mass": (8, 8, 0, 0),
    "panel_hinge_S": 0.5 * np.array(MIRRORED),
    "panel_arm_S": 0.75 * np.array(MIRRORED),
    "panel_axis_S": [[0, 0, 1]] * 4,
    "panel_inertia": [[0.43, 1.31, 1.73]] * 4,
    "panel_frequency": (pi / 2,) * 4,
    "panel_damping_ratio": (0.003,) * 4,
    "slosh_mass_0": (3, 3, 0, 0),
    "slosh_position_S": [[0, 0, 0.25], [0, 0, -0.25], [0, 0, 0], [0, 0, 0]],
    "slosh_axis_S": [[1, 0, 0], [0, 1, 0]] * 2,
    "slosh_frequency": (pi / 10,) * 4,
    "slosh_damping_ratio": (0.02,) * 4,
    "slosh_travel": (0.15,) * 4,
}
FLEXIBLE = {
    "flexible_servicer": PLANTS["servicer"] | PARTS,
    "notch_filter": {"depth": (0.05,) * 2, "width": (0.7,) * 2, "sample_period": 0.1},
}
CASES = ARMS | FLEXIBLE | SENSORS_AND_FILTERS | PLANTS | GUIDANCES | CONTROLLERS


@each("name", CASES)
def test_start_values_match_the_paper_and_of_data_sheets(fmu, name):
    """To the last digit that is written down; constants with a sign, a place or a digit wrong are
    off by more.
    """
    unit = fmu(name)
    rows = {v.name.partition("[")[0] for v in unit.kind.description.modelVariables}
    rows -= unit.kind.outputs.keys()
    required = {k: v for k, v in flat(CASES[name]).items() if k in rows}
    other = {
        k: (unit.get(k), required.get(k, 0))
        for k in rows
        if np.atleast_1d(unit.get(k)) != pytest.approx(required.get(k, 0), rel=1e-9, abs=1e-99)
    }
    assert other == {}
    if name in SENSORS_AND_FILTERS:
        assert required.keys() == flat(CASES[name]).keys()


def test_every_fmu_has_its_line():
    assert CASES.keys() == {path.stem for path in archive("target").parent.glob("*.fmu")}
