# SPDX-License-Identifier: BSD-2-Clause
"""The input `active` of the guidances of a mission: at 0 they are as before their first sample,
however long, and begin anew with the first active one.
"""

from __future__ import annotations

import numpy as np
import pytest

from .cases import random_direction, random_rotation
from .driver import bits
from .theory import MU, quaternion_of_dcm

GEO, P = 42164e3, 0.1
UNITS = {
    "pursuit_guidance": {"mu": MU, "v_close": 0.5, "omega_fire": 0.05, "alpha_fire": 1.4},
    "los_guidance": {"mu": MU, "guard_angle": 0.5},
    "sync_guidance": {"mu": MU, "guard_angle": 1.0},
    "sync_guidance, carried": {"mu": MU, "frame": 1, "range_input": 1},
}
FLAGS = {
    "pursuit_guidance": ("translate",),
    "los_guidance": ("attitude_guard", "los_guard"),
    "sync_guidance": ("attitude_guard",),
}


def states(rng):
    r, v = GEO * np.eye(3)[0], np.sqrt(MU / GEO) * np.eye(3)[1]
    return {
        "r_TN_N": r, "v_TN_N": v + 0.1 * rng.normal(size=3),
        "q_TN": quaternion_of_dcm(random_rotation(rng)), "omega_TN_T": 0.01 * rng.normal(size=3),
        "r_SN_N": r + 100 * random_direction(rng), "v_SN_N": v + 0.1 * rng.normal(size=3),
        "q_SN": quaternion_of_dcm(random_rotation(rng)), "omega_SN_S": 0.01 * rng.normal(size=3),
    }  # fmt: skip


def unit(fmu, case, inputs, start=0.0):
    return fmu(case.partition(",")[0], UNITS[case] | {"sample_period": P}, inputs, start)


@pytest.mark.verifies("A.4-6", "C.3-7")
@pytest.mark.parametrize("case", UNITS)
@pytest.mark.parametrize("before", [0, 30])
def test_after_a_rest_a_unit_has_the_bits_of_a_fresh_one(fmu, rng, case, before):
    """Active for `before` samples, then at rest for a while: the state of a fresh instance whose
    time starts there.
    """
    old = unit(fmu, case, states(rng) | {"active": 1})
    for active in (1,) * before + (0,) * 20:
        old.step(P, states(rng) | {"active": active})
    now = states(rng) | {"active": 1}
    fresh = unit(fmu, case, now, old.time)
    for _ in range(40):
        old.step(P, now)
        fresh.step(P, now)
        assert bits(old) == bits(fresh)
        now = states(rng) | {"active": 1}


@pytest.mark.parametrize("case", UNITS)
def test_at_rest_the_outputs_match_a_first_sample_with_its_flags_down(fmu, rng, case):
    old = unit(fmu, case, states(rng) | {"active": 1})
    for _ in range(20):
        old.step(P, states(rng))
    raised = 0
    for _ in range(20):
        now = states(rng)
        first = unit(fmu, case, now, old.time)
        first.step(P, now | {"active": 1})
        old.step(P, now | {"active": 0})
        for name in old.kind.outputs:
            if name in FLAGS[case.partition(",")[0]]:
                raised += first.get(name)
                assert old.get(name) == 0
            else:
                assert np.array_equal(old.get(name), first.get(name)), name
    assert raised > 0 or case == "sync_guidance, carried"


@pytest.mark.verifies("B.4-6")
def test_closing_speed_limits_take_the_place_of_the_speed_of_the_target(fmu, rng):
    """s = clip(k_r (range - zeta1), -v_close/2, v_close) in any frame, no frame_radius needed."""
    u = states(rng)
    for range_, expected in ((300, 0.5), (150, 0.25), (90, -0.05), (30, -0.25)):
        line = random_direction(rng)
        u["r_SN_N"] = u["r_TN_N"] + range_ * line
        p = {"mu": MU, "v_close": 0.5, "zeta1": 100, "k_r": 5e-3}
        guidance = fmu("pursuit_guidance", p, u)
        assert guidance.get("v_req") == pytest.approx(expected, abs=1e-7)
        assert guidance.get("drho_ref_N") == pytest.approx(-expected * line, abs=1e-8)
