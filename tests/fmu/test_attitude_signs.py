# SPDX-License-Identifier: BSD-2-Clause
"""A quaternion and its negative are the same attitude to every consumer, at half a turn too, where
q_0 decides nothing.
"""

from __future__ import annotations

import numpy as np
import pytest

from .cases import random_direction

CONSUMERS = (
    "sync_guidance",
    "los_guidance",
    "pursuit_guidance",
    "adaptive_controller",
    "ppc_controller",
    "pid_controller",
    "theta_d_controller",
    "relay_controller",
    "switched_controller",
    "safety_monitor",
    "safety_filter",
)
ATTITUDES = ("q_TN", "q_SN", "q_DN")


def scene(rng):
    """Two bodies 50 m apart in orbit and a reference between them, attitudes left out."""
    r, rho = 7e6 * random_direction(rng), 50 * random_direction(rng)
    v = np.cross([1e-4, 2e-4, 1e-3], r)
    rates = {
        name: 0.01 * rng.normal(size=3)
        for name in ("omega_TN_T", "omega_SN_S", "omega_DN_D", "drho_ref_N")
    }
    return {
        "r_TN_N": r,
        "v_TN_N": v,
        "r_SN_N": r + rho,
        "v_SN_N": v + 0.1 * rng.normal(size=3),
        "rho_ref_N": rho / 2,
    } | rates


def outputs(fmu, kind, name, inputs):
    description = kind(name).description
    ports = {v.name.partition("[")[0] for v in description.modelVariables if v.causality == "input"}
    unit = fmu(name, {}, {port: value for port, value in inputs.items() if port in ports})
    unit.step(0.1)
    return {port: unit.get(port) for port in unit.kind.outputs}


def attitudes(rng, half_turns):
    """Random ones, or such that the turn between any two is none or half a turn about a body
    axis.
    """
    if half_turns:
        return dict(zip(ATTITUDES, np.eye(4)[rng.integers(4, size=3)], strict=True))
    return {
        name: q / np.linalg.norm(q)
        for name, q in zip(ATTITUDES, rng.normal(size=(3, 4)), strict=True)
    }


@pytest.mark.parametrize("half_turns", [False, True])
@pytest.mark.parametrize("name", CONSUMERS)
def test_the_sign_of_an_attitude_changes_nothing(fmu, kind, rng, name, half_turns):
    for _ in range(3):
        inputs, q = scene(rng), attitudes(rng, half_turns)
        expected = outputs(fmu, kind, name, inputs | q)
        for flipped in (*ATTITUDES, "all"):
            signs = {
                port: -value if flipped in (port, "all") else value for port, value in q.items()
            }
            for port, value in outputs(fmu, kind, name, inputs | signs).items():
                assert np.array_equal(value, expected[port]), (port, flipped)
