# SPDX-License-Identifier: BSD-2-Clause
"""orbit_filter.fmu: against dense matrices, thrust of the right step in the right attitude, gate
over both parts of a fix, late fixes.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from tests.close import close
from tests.reference import kalman
from tests.reference.attitude import dcm
from tests.reference.cases import quaternion
from tests.reference.integrate import truth
from tests.reference.orbit import hill_frame, state_of_elements

from .driver import bits
from .estimates import estimate, put_covariance
from .rejections import rejection
from .theory import EARTH, MU

T = 0.1
ELEMENTS = {"a": 7158140.0, "e": 0.01, "inc": 0.5, "argp": 1.0, "raan": 2.0, "nu": 0.6}
START = np.concatenate(state_of_elements(MU, **ELEMENTS))
QUIET = {"fix_valid": 0, "fix_time": -1, "F_cmd_S": np.zeros(3), "q_SN": (1, 0, 0, 0)}


def filter_and_reference(fmu, start=None, **p):
    start = START if start is None else start
    own = {"a": 0, "r_0_N": start[:3], "v_0_N": start[3:]}
    return fmu("orbit_filter", EARTH | own | p), kalman.Orbit(np.array(start), EARTH)


def same(unit, reference):
    """1e-9 of the standard deviations, and rounding of 7e6 m."""
    x, P = estimate(unit)
    sigma = np.sqrt(np.diag(reference.P))
    assert (np.abs(x - reference.s) < 1e-9 * sigma + np.repeat((1e-8, 1e-11), 3)).all()
    assert np.abs((P - reference.P) / np.outer(sigma, sigma)).max() < 1e-9
    assert unit.get("sigma_r_N") == pytest.approx(sigma[:3], rel=1e-9)
    assert unit.get("sigma_v_N") == pytest.approx(sigma[3:], rel=1e-9)
    assert unit.get("fix_nis") == pytest.approx(reference.track.nis, rel=1e-6, abs=1e-9)
    assert unit.get("fix_rejected") == reference.track.rejected


def simulated(s, a, h=T):
    """Truth over a step under a constant acceleration."""

    def f(_, x):
        return np.concatenate((x[3:], kalman.gravity(x[:3], EARTH) + a))

    return truth(f, s, 0.0, h, np.repeat((1e-9, 1e-12), 3))


def fix(rng, s, time):
    noisy = s + np.repeat((5, 0.05), 3) * rng.normal(size=6)
    return {"fix_valid": 1, "fix_time": time, "r_fix_N": noisy[:3], "v_fix_N": noisy[3:]}


@pytest.mark.parametrize("late", [0, 1, 7, 15])
def test_filter_is_the_dense_one(fmu, rng, late):
    """Random commands and attitudes, a fix every ten samples, `late` samples old, wrong ones."""
    unit, reference = filter_and_reference(fmu)
    history, q = [START], None
    for k in range(100):
        u = QUIET | {"q_SN": quaternion(rng), "F_cmd_S": 2 * rng.normal(size=3)}
        if k:
            history.append(simulated(history[-1], dcm(q).T @ u["F_cmd_S"] / 95))
        q = u["q_SN"]
        if k % 10 == 5 and k >= late:
            u |= fix(rng, history[k - late], (k - late) * T)
            if k in (45, 75):
                part = "r_fix_N" if k == 45 else "v_fix_N"
                u[part] = u[part] + (100 if k == 45 else 1.0)
        unit.step(T, u)
        reference.sample(k, u)
        same(unit, reference)
    assert reference.track.rejected == 2


def test_a_fix_that_remains_at_the_port_is_used_once(fmu, rng):
    once, _ = filter_and_reference(fmu)
    held, _ = filter_and_reference(fmu)
    last = {}
    for k in range(12):
        new = fix(rng, START, k * T) if k % 6 == 0 else {}
        last = new or last
        once.step(T, QUIET | new)
        held.step(T, QUIET | last)
        for ours, theirs in zip(estimate(once), estimate(held), strict=True):
            assert ours.tobytes() == theirs.tobytes(), k


def test_start_is_beside_the_orbit_of_the_elements(fmu, rng):
    """rho and its rate as seen in the Hill frame, as of the servicer."""
    rho, drho = rng.normal(size=3) * 30, rng.normal(size=3) * 0.1
    unit = fmu("orbit_filter", EARTH | ELEMENTS | {"rho_0_H": rho, "drho_0_H": drho})
    H = hill_frame(START[:3], START[3:], MU)
    close(unit.get("r_SN_N"), START[:3] + H.x.T @ rho, rel=1e-14)
    v = START[3:] + H.x.T @ drho + H.d.T @ rho
    close(unit.get("v_SN_N"), v, rel=1e-14)
    assert unit.get("orbit_valid") == 0


@pytest.mark.verifies("F.5-4")
def test_thrust_acts_in_the_attitude_of_the_sample_before(fmu, rng):
    """1 kN along X of the attitude that the vehicle had while it was held."""
    unit, _ = filter_and_reference(fmu)
    first, second = quaternion(rng), quaternion(rng)
    unit.step(T, QUIET | {"q_SN": first, "F_cmd_S": [-4e5, 0, 0]})
    close(unit.get("v_SN_N"), START[3:], rel=1e-15)  # not at the first sample
    unit.step(T, QUIET | {"q_SN": second, "F_cmd_S": [1000, 0, 0]})
    expected = simulated(START, dcm(first)[0] * 1000 / 95)
    assert unit.get("v_SN_N") == pytest.approx(expected[3:], abs=1e-10)


def test_transition_is_the_derivative_of_the_flow(fmu):
    """Columns of Phi from one error at a time, against central differences of the exact flow with
    the two-body gradient: 2e-9 of J2's part, T^3 of the rest.
    """
    point = {"mu": MU, "R_E": 0.0, "J2": 0.0}
    for i, e in enumerate(np.eye(6)):
        unit = fmu(
            "orbit_filter", EARTH | {"a": 0, "r_0_N": START[:3], "v_0_N": START[3:], "sigma_a": 0}
        )
        unit.step(T, QUIET)
        put_covariance(unit, np.outer(e, e))
        unit.step(T, QUIET)
        P = estimate(unit)[1]
        h = 100.0 if i < 3 else 0.1
        reference = kalman.Orbit(START, point)
        ends = [reference._flow(START + sign * h * e, np.zeros(3), T) for sign in (1, -1)]
        column = (ends[0] - ends[1]) / (2 * h)
        assert P[i] / np.sqrt(P[i, i]) == pytest.approx(column, rel=1e-6, abs=1e-9)


@pytest.mark.verifies("F.5-2")
def test_gate_tests_both_parts_together(fmu):
    """Each part below the gate, together above it: nothing is used."""
    unit, reference = filter_and_reference(fmu, acquire=0)
    reference.track.acquired = True
    s = START.copy()
    sigma_r, sigma_v = np.hypot(100, 5), np.hypot(0.1, 0.05)
    wrong = s + np.concatenate((2.3 * sigma_r * np.ones(3), 2.0 * sigma_v * np.ones(3)))
    u = QUIET | {"fix_valid": 1, "fix_time": 0.0, "r_fix_N": wrong[:3], "v_fix_N": wrong[3:]}
    before = estimate(unit)
    unit.step(T, u)
    assert unit.get("fix_nis") == pytest.approx(3 * (2.3**2 + 2.0**2), rel=1e-9)
    assert unit.get("fix_rejected") == 1
    for a, b in zip(estimate(unit), before, strict=True):
        assert (a == b).all()


@pytest.mark.verifies("F.5-3")
def test_tenth_rejection_in_a_row_acquires(fmu):
    rng = np.random.default_rng(1)
    unit, _ = filter_and_reference(fmu, reset_after=10)
    far, state = START + np.repeat((3000.0, 0), 3), START
    for k in range(140):
        u = QUIET
        if k:
            state, far = simulated(state, np.zeros(3)), simulated(far, np.zeros(3))
        if k % 10 == 0:
            u = QUIET | fix(rng, state if k < 20 else far, k * T)
        unit.step(T, u)
    assert unit.get("fix_rejected") == 10
    assert unit.get("r_SN_N") == pytest.approx(far[:3], abs=50)


@pytest.mark.verifies("F.5-1")
@pytest.mark.parametrize("change", ["late", "future", "repeated", "invalid"])
def test_fixes_that_cannot_be_used_change_nothing(fmu, rng, change):
    units = [filter_and_reference(fmu)[0] for _ in range(2)]
    first = fix(rng, START, 0.0)
    for unit in units:
        for k in range(20):
            unit.step(T, QUIET | (first if k == 0 else {}))
    stamp = {"late": 0.4, "future": 2.1, "repeated": 0.0, "invalid": 2.0}[change]
    other = fix(rng, START, stamp) | {"fix_valid": float(change != "invalid")}
    units[0].step(T, QUIET)
    units[1].step(T, QUIET | other)
    assert bits(units[0]) == bits(units[1])


def consistency(fmu, runs, samples, rng):
    """Mean NEES and NIS: a free orbit, white acceleration as assumed."""
    nees, nis = [], []
    for _ in range(runs):
        unit, _ = filter_and_reference(fmu, sigma_a=1e-2, sample_period=1.0)
        s, rows, innovations = START, [], []
        for k in range(samples):
            if k:
                s = kalman.Orbit(s, EARTH, T=1.0)._flow(s, np.zeros(3), 1.0)
                s = s + np.linalg.cholesky(kalman.white_noise(1e-4, 1.0)) @ rng.normal(size=6)
            unit.step(1.0, QUIET | fix(rng, s, float(k)))
            x, P = estimate(unit)
            rows.append((s - x) @ np.linalg.solve(P, s - x))
            innovations.append(unit.get("fix_nis"))
        nees.append(rows)
        nis.append(innovations[1:])
    return np.array(nees), np.array(nis)


def test_errors_are_as_large_as_claimed(fmu):
    """NEES and NIS of 6: 40 runs of 40 fixes. The errors of a run hang together over 10 fixes and
    more, so that the mean NEES scatters by 0.5; innovations are independent, by 0.1.
    """
    nees, nis = consistency(fmu, 40, 40, np.random.default_rng(6))
    assert nees.mean() == pytest.approx(6, abs=1.0)
    assert nis.mean() == pytest.approx(6, abs=0.3)
    low, high = chi2.ppf((0.025, 0.975), 40 * 6) / 40
    assert np.mean((low <= nis.mean(axis=0)) & (nis.mean(axis=0) <= high)) > 0.85


@pytest.mark.verifies("F.5-6")
def test_finer_master_steps_give_the_same_bits(fmu, rng):
    coarse, fine = filter_and_reference(fmu)[0], filter_and_reference(fmu)[0]
    for k in range(30):
        u = QUIET | {"q_SN": quaternion(rng), "F_cmd_S": rng.normal(size=3)}
        u |= fix(rng, START, k * T) if k % 10 == 0 else {}
        coarse.step(T, u)
        fine.step(0.03, u)
        fine.step(0.07, QUIET)
        assert bits(coarse) == bits(fine)


@pytest.mark.verifies("F.5-5")
def test_covariance_stays_symmetric_and_not_negative(fmu):
    rng = np.random.default_rng(1)
    unit, s = filter_and_reference(fmu)[0], START
    for k in range(200):
        unit.step(T, QUIET | (fix(rng, s, k * T) if k % 10 == 0 else {}))
        s = simulated(s, np.zeros(3))
        P = estimate(unit)[1]
        assert (P == P.T).all()
        assert np.linalg.eigvalsh(P).min() > 0


@pytest.mark.verifies("F.5-7")
@pytest.mark.parametrize(
    ("parameters", "rule"),
    [
        ({"sample_period": 0}, "sample_period = 0: must be > 0"),
        ({"sigma_r_0": -1}, "sigma_r_0 = -1: must be >= 0"),
        ({"mass_hat": 0}, "mass_hat = 0: must be > 0"),
        ({"e": 1}, "e = 1: must be in [0, 1)"),
        ({"a": 0}, "r_0_N = 0: must not be the centre of the planet"),
    ],
)
def test_rejected_with_the_rule(parameters, rule, tmp_path):
    assert rule in rejection("orbit_filter", parameters, tmp_path)
