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
    """Drawn errors have the least ranges of the reference; the tube contains their paths."""
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


def aborted(system, instant):
    """Phase of the abort and least range afterwards, for an hour."""
    changes = {"monitor.abort_time": instant, "mechanism.max_step": 0.01}
    result = run(system, set=changes, stop=instant + 3660, every=50)
    since = result.time >= instant
    distance = np.linalg.norm(result["servicer.r_SN_N"] - result["target.r_TN_N"], axis=1)
    return result["manager.phase"][~since][-1], distance[since].min()


@pytest.mark.long
@pytest.mark.parametrize(
    ("system", "end"), [("servicing_mission", 3060), ("servicing_mission_navigated", 2560)]
)
def test_aborts_of_the_nominal_mission_at_every_10_s_stay_outside_the_zone(system, end):
    for instant in range(70, end, 10):
        phase, least = aborted(system, float(instant))
        assert least > (12 if phase < 5 else 2.9), (instant, phase, least)
