# SPDX-License-Identifier: BSD-2-Clause
"""Names of the signals of bodies in all missions, the examples that `harness new` copies, and the
steering of an approach by an agent.
"""

from __future__ import annotations

from pathlib import Path

from harness.mission.mission import Example, Steering

from .exchange import orbits
from .exchange.bodies import Bodies

BODIES = Bodies(
    position="r_{}N_N",
    velocity="v_{}N_N",
    attitude="q_{}N",
    components=("servicer", "target", "robot"),
    start=("r_0_N", "v_0_N"),
    attitude_start="sigma_{}N_0",
    semi_major_axis="a",
    elements=("e", "inc", "argp", "raan", "nu"),
    field="mu",
    beside=("rho_0_H", "drho_0_H"),
    sun="sun_N",
)
ORBITS = orbits(BODIES)
RESTARTS = (("r_0_N[1]", "a", 0.0),)
"""Triples (p, q, v): parameter p, the start value of a state, has an effect only if parameter q has
the value v. A plant uses its start position r_0_N (and its start velocity v_0_N) only if its
parameter `a`, the semi-major axis, is 0.
"""
CONTROLLER = Example(
    place="sync_approach.controller",
    inputs=frozenset(("r_TN_N", "v_TN_N", "r_SN_N", "v_SN_N", "q_SN", "omega_SN_S"))
    | frozenset(("rho_ref_N", "drho_ref_N", "q_DN", "omega_DN_D")),
    outputs=frozenset(("F_cmd_S", "M_cmd_S", "wheel_accel_cmd")),
    file=Path("my_controller"),
    note="""\
The attitude of the servicer is frozen until `servicer.t_att`, 1200 s in `sync_approach`: torques
and wheel accelerations have no effect until then. `--set servicer.t_att=0` releases it at once.
""",
)
ADDED = tuple(
    Example(
        "sync_approach", frozenset(), frozenset(), Path(f"my_{kind}"),
        kind=kind, options="--params clear",
    )
    for kind in ("sensor", "plant")
)  # fmt: skip

DELTA_V = "total(propulsion.impulse) / servicer.mass"
# 0.02: largest wheel acceleration [rad/s2], as in the parameter sets `limited`, which gives torques
# of 0.2 to 0.3 N m
WHEELS = ("controller.wheel_accel_cmd", 0.02)
FLAGS = tuple((f"controller.{name}", (0.0, 1.0)) for name in ("throttle", "translation_firing"))
LIMITS = tuple((f"controller.{n}", x) for n, x in (("F_cmd_S", 1.0), ("M_cmd_S", 0.5)))
STEERED = Steering(("controller",), every=10, cost=DELTA_V, bounds=(WHEELS, *FLAGS, *LIMITS))
"""Steering of an approach by an agent in place of the controller, with the cost delta-v [m/s].
LIMITS bound the commands of force [N] and torque [N m] in systems in which an allocation is between
controller and thrusters; they suit the thrusters of 0.5 N of the synchronised approach.
"""
