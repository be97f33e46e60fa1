# SPDX-License-Identifier: BSD-2-Clause
"""Systems from which the start values of the flight-software FMUs are taken, for the pages of these
FMUs.
"""

from __future__ import annotations

START_VALUES: dict[str, tuple[str, tuple[str, ...]]] = {
    "adaptive_controller": ("sync_approach.controller", ("t_att", "sample_period")),
    "arm_controller": ("arm_capture.arm_controller", ("sample_period",)),
    "arm_guidance": ("arm_capture.arm_guidance", ("sample_period",)),
    "assembly_controller": ("transposition.controller", ("sample_period",)),
    "attitude_filter": ("sync_approach_navigated.attitude_filter", ()),
    "cmg_steering": ("transposition.steering", ("use_cluster", "sample_period")),
    "command_selector": (
        "servicing_mission.selector",
        ("relay_torque", "far_wheels", "k_unload", "M_unload_max"),
    ),
    "joint_controller": ("space_robot.joints", ("use_lock",)),
    "los_guidance": ("ppc_tracking.guidance", ("sample_period",)),
    "mission_manager": (
        "servicing_mission.manager",
        ("budget", "rate_2", "await_axis", "spin_accel", "aim_radius", "monitor_stack"),
    ),
    "notch_filter": ("ppc_tracking_notched.filter", ("sample_period",)),
    "optimal_controller": ("sync_approach.controller", ("cone", "t_att")),
    "orbit_filter": ("sync_approach_navigated.orbit_filter", ()),
    "pid_controller": ("ppc_tracking.controller", ("sample_period",)),
    "ppc_controller": ("ppc_tracking.controller", ("sample_period",)),
    "pursuit_guidance": ("relay_approach.guidance", ("sample_period",)),
    "relative_filter": ("sync_approach_navigated.relative_filter", ("rho_0_H", "sigma_TN_0")),
    "relay_controller": ("relay_approach.controller", ("sample_period",)),
    "safety_filter": (
        "sync_approach_thrusters_filtered.filter",
        ("reaction", "keep_out_radius", "use_speed_limit", "speed_at_zero", "speed_max"),
    ),
    "safety_monitor": (
        "sync_approach_navigated.monitor",
        (
            "keep_out_half",
            "use_corridor",
            "corridor_axes",
            "corridor_half_angle",
            "corridor_axis",
            "use_speed_limit",
            "speed_at_zero",
            "speed_slope",
            "passive_time",
            "passive_step",
            "passive_period",
            "abort_on",
            "sample_period",
        ),
    ),
    "stack_guidance": (
        "servicing_mission.stack_guidance",
        ("torque_share", "unload_on", "k_unload", "M_unload_max", "sample_period"),
    ),
    "switched_controller": (
        "arch_rendezvous.controller",
        (
            "mu",
            "K_rho_1",
            "K_drho_1",
            "K_rho_2",
            "K_drho_2",
            "axis_H",
            "switch_distance",
            "K_att",
            "P_att",
            "sample_period",
        ),
    ),
    "sync_guidance": (
        "sync_approach.guidance",
        ("sample_period", "M_dist_T.amplitude", "M_dist_T.frequency"),
    ),
    "theta_d_controller": ("ppc_tracking.controller", ("sample_period",)),
    "thruster_allocation": (
        "servicing_mission.allocation",
        ("thruster_position", "thruster_direction", "thrust_nominal", "centre_of_mass"),
    ),
    "timeline": ("servicing_mission.timeline", ("sample_period",)),
    "transposition_guidance": (
        "transposition.guidance",
        ("nodes", "iterations_max", "sample_period"),
    ),
}
"""Component (SYSTEM.COMPONENT) from whose parameters the start values of an FMU are taken, and
names of the parameters whose start value differs from the value in this component, by name of the
FMU.
"""
