# SPDX-License-Identifier: BSD-2-Clause
"""Figure of escapes against the reference, and aborts of whole missions at every 10 s: for an hour
they leave the target alone, on truth and on estimates. Single aborts in the FMUs of the bodies:
tests/fmu/test_safety_escape.py.
"""

from __future__ import annotations

import numpy as np
import pytest

from harness import run
from ssp.servicing_mission import escapes
from tests.fmu.test_safety_escape import INSTANTS
from tests.reference.escape import Bounds, drawn, increment, ranges

# ---- the figure of escapes ----


@pytest.fixture(scope="module")
def begun():
    return run("servicing_mission", stop=30.0)


def test_drifts_of_the_figure_match_the_matrix_exponential(begun):
    """Drawn errors have the least ranges of the reference; none moves farther towards the
    target than the radius of its circle.
    """
    rho, drho, rate = escapes.hill_states(begun)
    assert rho[0] == pytest.approx((100, -500, 0), abs=1e-6)
    assert drho[0] == pytest.approx((0, 0, 0), abs=1e-9)
    p, n = Bounds(), float(rate[0])
    rho, drho = np.array(INSTANTS[8][1]), np.array(INSTANTS[8][2])
    e = escapes.escape(begun, rho, drho, n)
    assert e.dv == pytest.approx(increment(p, rho, drho))
    tau = np.arange(0.0, 3601.0, 1.0)
    none = np.zeros((1, 10))
    least = np.linalg.norm(escapes.drift(n, e.r[None], e.v[None], tau), axis=-1).min()
    assert least == pytest.approx(ranges(p, n, rho, drho, none)[0], rel=1e-9)
    path, h = escapes.support(begun, e, tau[::20])
    r, v = escapes.drawn(begun, e, 50, np.random.default_rng(1))
    toward = path / np.linalg.norm(path, axis=1)[:, None]
    off = np.sum((escapes.drift(n, r, v, tau[::20]) - path[:, None]) * toward[:, None], axis=-1)
    assert np.all(np.abs(off) <= h[:, None] + 1e-9)
    assert off.min() < -0.3 * h[-1]
    errors = drawn(p, increment(p, rho, drho), np.random.default_rng(1), 50)
    assert np.abs(r - e.r).max() <= 0.05 >= np.abs(errors[:, :3]).max()


# ---- whole missions ----


FINAL = 5
"""Phase of the last straight approach, which ends in the reach of the docking mechanism."""


def aborted(system, instant):
    """Phase and range at the instant of the abort, and least range in the hour after it."""
    changes = {"monitor.abort_time": instant, "mechanism.max_step": 0.01}
    result = run(system, set=changes, stop=instant + 3660, every=50)
    since = result.time >= instant
    distance = np.linalg.norm(result["servicer.r_SN_N"] - result["target.r_TN_N"], axis=1)
    return result["manager.phase"][~since][-1], distance[~since][-1], distance[since].min()


@pytest.mark.long
@pytest.mark.parametrize(
    ("system", "end"), [("servicing_mission", 3060), ("servicing_mission_navigated", 2560)]
)
def test_aborts_of_the_nominal_mission_at_every_10_s_stay_outside_the_zone(system, end):
    """From the final approach on the servicer is inside the zone: it comes no nearer than its
    speed at the instant carries it.
    """
    for instant in range(70, end, 10):
        phase, distance, least = aborted(system, float(instant))
        outside = 12 if phase < FINAL else min(2.9, distance - 0.1)
        assert least > outside, (instant, phase, distance, least)


# ---- the drift without thrust ----
@pytest.mark.long
def test_the_passive_margin_is_true_in_every_phase():
    """The sign of passive_margin, up to 5 s old, against drifts of an hour without oblateness: two
    bodies, Runge-Kutta at 5 s.
    """
    result = run("servicing_mission", stop=3600.0)
    here = np.arange(0, len(result.time), 11)
    bodies = ("target.r_TN_N", "servicer.r_SN_N"), ("target.v_TN_N", "servicer.v_SN_N")
    r, v = (np.stack([result[name][here] for name in names], axis=1) for names in bodies)
    least, h = np.full(len(here), np.inf), 5.0
    for _ in range(720):
        least = np.minimum(least, np.linalg.norm(r[:, 1] - r[:, 0], axis=1))
        r, v = drifted(r, v, h)
    margin, phase = result["monitor.passive_margin"][here], result["manager.phase"][here]
    assert np.max(result["monitor.passive_age"]) < 5
    for number in range(5):
        found = (phase == number) & (margin < 1e8)
        right = np.mean((margin[found] < 0) == (least[found] < 12))
        print(f"phase {number}: {100 * right:.1f} % of {found.sum()} instants")
        assert found.sum() > 20 and right > 0.95


def drifted(r, v, h):
    """Return positions and velocities after a step without thrust about a point mass."""

    def pull(r):
        return -3.986004415e14 * r / np.linalg.norm(r, axis=-1, keepdims=True) ** 3

    k1, k2 = pull(r), pull(r + h / 2 * v)
    k3 = pull(r + h / 2 * v + h * h / 4 * k1)
    k4 = pull(r + h * v + h * h / 2 * k2)
    return r + h * v + h * h / 6 * (k1 + k2 + k3), v + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
