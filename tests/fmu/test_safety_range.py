# SPDX-License-Identifier: BSD-2-Clause
"""safety_monitor.fmu and the independent range: an estimate that is wrong and looks well.

Straight motion in deep space; disagreements against closed forms and an independent recursion.
"""

from __future__ import annotations

import numpy as np
import pytest

from .driver import bits
from .rejections import rejection
from .test_safety_monitor import DEEP, OFF, SPHERE, states

ALONE = OFF | DEEP | {"lost_time": 1.0, "sample_period": 0, "use_range": 1, "range_slope": 0}
ZONE = {"keep_out_shape": 1, "keep_out_half": (3, 3, 3)}
H = 0.5


def stated(k, y, v, range_meas=None, **changes):
    """The estimate at sample k: y on the y axis, with v; range_meas at this sample."""
    inputs = states(k * H, (0, y, 0), (0, v, 0), 0)
    if range_meas is not None:
        inputs |= {"range_meas": range_meas, "range_time": k * H, "range_valid": 1}
    return inputs | changes


def first_loss(unit, motion, stop=80.0):
    """Time at which the navigation margin first falls below lost_time, and when it aborts."""
    lost = None
    for k in range(round(stop / H)):
        unit.step(H, motion(k))
        if lost is None and unit.get("navigation_margin") < 1:
            lost = k * H
        if unit.get("abort"):
            return lost, k * H
    return lost, None


def drift_of_dead_reckoning(b, tau, n):
    """b tau (1 - (1 - P/tau)^n): closed form of the n-th residual with every range used."""
    return b * tau * (1 - (1 - H / tau) ** n)


@pytest.mark.verifies("G.8-1")
@pytest.mark.parametrize("b", [0.6, -0.6])
@pytest.mark.parametrize(("tolerance", "tau"), [(1.0, 10.0), (2.0, 10.0), (1.0, 4.0)])
def test_velocity_in_error_aborts_though_position_is_right(fmu, b, tolerance, tau):
    """As in the DART mishap 0.6 m/s; the rules on the estimate hold all the time."""
    p = {"range_at_zero": tolerance, "range_tau": tau, "range_patience": 3}
    unit = fmu("safety_monitor", ALONE | ZONE | p)
    lost, abort = first_loss(unit, lambda k: stated(k, 100, b, 100))
    n = 1
    while abs(drift_of_dead_reckoning(b, tau, n)) <= tolerance:
        n += 1
    assert lost == pytest.approx(n * H + 3)
    assert abort == pytest.approx(lost + 1.0)  # lost_time after the last sample that was trusted
    assert unit.get("rule_violated") == 6
    assert unit.get("t_first")[5] == pytest.approx(lost - H + 1.0)
    assert list(unit.get("violated")[:5]) == [0] * 5


def test_velocity_error_that_stays_below_the_tolerance_in_its_time_constant_is_borne(fmu):
    p = {"range_at_zero": 1.0, "range_tau": 10, "range_patience": 3}
    for b, aborts in ((0.0999, False), (0.105, True)):
        unit = fmu("safety_monitor", ALONE | p)
        assert (first_loss(unit, lambda k, b=b: stated(k, 100, b, 100))[1] is not None) == aborts


@pytest.mark.verifies("G.8-1")
def test_drifting_position_aborts_when_it_is_off_by_the_tolerance(fmu):
    """The estimate rests at 50 m and believes so; truth closes with 0.04 m/s."""
    p = {"range_at_zero": 1.0, "range_tau": 10, "range_patience": 3}
    unit = fmu("safety_monitor", ALONE | ZONE | p)
    lost, _ = first_loss(unit, lambda k: stated(k, 50, 0, 50 - 0.04 * k * H))
    assert lost == pytest.approx(25.5 + 3)  # 0.04 t > 1 at the sample after 25 s
    assert unit.get("abort") == 1
    assert unit.get("keep_out_margin") == pytest.approx(47)  # as estimated


@pytest.mark.parametrize("alone", [0, 1])
def test_alone_the_range_counts_only_against_a_state_that_is_called_valid(fmu, alone):
    """Ten seconds called invalid, on purpose or not; then valid and in error by 5 m."""
    p = {"range_at_zero": 1.0, "range_tau": 10, "range_patience": 0, "range_alone": alone}
    unit = fmu("safety_monitor", ALONE | p)
    for k in range(20):
        unit.step(H, stated(k, 50, 0, 50, relative_valid=0))
    assert unit.get("abort") == 1 - alone
    for k in range(20, 24):
        unit.step(H, stated(k, 50, 0, 45, relative_valid=1))
    assert unit.get("abort") == 1
    assert unit.get("rule_violated") == 6
    # valid at 9.5 s for the last time; abort after lost_time
    assert unit.get("t_first")[5] == pytest.approx(10.5 if alone else 1.0)


def test_tolerance_grows_with_the_range(fmu):
    p = {"range_at_zero": 0.5, "range_slope": 0.01, "range_patience": 0}
    for off, aborts in ((1.49, False), (1.52, True)):
        unit = fmu("safety_monitor", ALONE | p)
        motion = lambda k, off=off: stated(k, 100 + off, 0, 100)  # noqa: E731
        assert (first_loss(unit, motion, 10)[1] is not None) == aborts


@pytest.mark.verifies("G.8-2")
def test_single_outliers_and_a_cured_estimate_are_forgiven(fmu):
    p = {"range_at_zero": 1.0, "range_tau": 10, "range_patience": 3}
    unit = fmu("safety_monitor", ALONE | p | {"lost_time": 20})
    for k in range(60):
        unit.step(H, stated(k, 100, 0, 130 if k % 10 == 5 else 100))
        assert unit.get("navigation_margin") == 20 if k < 5 else True
    margins = []
    for k in range(60, 120):
        unit.step(H, stated(k, 100 if k >= 80 else 110, 0, 100))
        margins.append(unit.get("navigation_margin"))
    assert min(margins) < 20
    assert margins[-1] == 20
    assert not unit.get("abort")


def test_range_is_compared_at_its_own_time(fmu):
    """Closing with 5 m/s, ranges 1 s late: 5 m off if the time stamp were ignored."""
    p = {"range_at_zero": 1e-6, "range_tau": 10, "range_patience": 0}
    unit = fmu("safety_monitor", ALONE | p)

    def late(k):
        taken = k * H - 1.0
        range_ = {"range_meas": 400 - 5 * taken, "range_time": taken, "range_valid": taken >= 0}
        return stated(k, 400 - 5 * k * H, -5) | range_

    assert first_loss(unit, late, 40) == (None, None)
    unit = fmu("safety_monitor", ALONE | p)
    assert first_loss(unit, lambda k: late(k) | {"range_time": k * H}, 40)[1] is not None


def test_dead_reckoning_is_exact_under_constant_acceleration(fmu):
    """Trapezoidal in the rate: 0.25 m off in the steady state if it were held over the sample."""
    p = {"range_at_zero": 1e-6, "range_tau": 10, "range_patience": 0}

    def pulled(k, a=0.1):
        y, v = 50 + a * (k * H) ** 2 / 2, a * k * H
        return stated(k, y, v, y)

    assert first_loss(fmu("safety_monitor", ALONE | p), pulled, 40) == (None, None)


def test_an_estimate_called_invalid_is_not_compared_and_reckoning_begins_anew(fmu):
    p = {"range_at_zero": 1e-6, "range_tau": 10, "range_patience": 0, "lost_time": 20}
    unit = fmu("safety_monitor", ALONE | p)
    for k in range(30):
        gone = 10 <= k < 15
        estimate = stated(k, 7, 5, 100) if gone else stated(k, 100, 0, 100)
        unit.step(H, estimate | {"relative_valid": not gone})
        assert unit.get("navigation_margin") == 20 - (k - 9) * H * gone, k


@pytest.mark.parametrize("seed", [1, 2])
def test_verdict_matches_an_independent_recursion(fmu, seed):
    """Noise, gaps, estimates that come and go, three-dimensional motion at uneven ranges."""
    rng = np.random.default_rng(seed)
    p = {"range_at_zero": 0.6, "range_slope": 0.005, "range_tau": 4, "range_patience": 1}
    unit = fmu("safety_monitor", ALONE | p | {"lost_time": 1e4})
    rho, v = np.array((30.0, -60, 20)), np.array((-0.4, 0.5, 0.1))
    reckoned, before, stamp, since, lost, t_valid = None, None, -1, None, False, 0.0
    verdicts = []
    for k in range(300):
        t, seen = k * H, (rho + v * k * H) * (1.05 if 100 < k < 160 else 1.0)
        ok = k % 37 != 20
        R = float(np.linalg.norm(seen))
        speed = v + rng.normal(size=3) * 0.05
        rate = float(seen @ speed) / R
        taken = t - 0.3
        measured = float(np.linalg.norm(rho + v * taken)) + 0.3 * rng.normal()
        good = rng.random() > 0.3 and taken > 0
        reckoned = None if not ok or reckoned is None else reckoned + H * (before + rate) / 2
        if ok and good:
            back = rate * 0.3
            reckoned = measured + back if reckoned is None else reckoned
            off, drift = measured - R + back, measured - reckoned + back
            most = 0.6 + 0.005 * measured
            reckoned += min(1, (taken - stamp) / 4) * np.clip(drift, -most, most)
            agreed = max(abs(off), abs(drift)) <= most
            since = None if agreed else taken if since is None else since
            stamp = taken
            lost = since is not None and stamp - since >= 1 - 1e-6
        before = rate
        if ok and not lost:
            t_valid = t
        verdicts.append(lost)
        inputs = states(t, seen, speed, 0) | {"relative_valid": ok}
        unit.step(
            H, inputs | {"range_meas": measured, "range_time": taken, "range_valid": float(good)}
        )
        assert unit.get("navigation_margin") == pytest.approx(t_valid + 1e4 - t, abs=1e-9), k
    assert 5 < sum(verdicts) < 150


def test_without_new_ranges_the_verdict_stays(fmu):
    p = {"range_at_zero": 1.0, "range_patience": 1, "lost_time": 5}
    unit = fmu("safety_monitor", ALONE | p)
    for k in range(40):
        measured = {"range_valid": k <= 4, "range_meas": 100.0 if k <= 4 else 0.0}
        unit.step(H, stated(k, 110, 0, 0) | measured)
    assert unit.get("abort") == 1
    assert unit.get("t_first")[5] == pytest.approx(0.5 + 5)


def test_range_states_nothing_before_the_monitor_is_armed(fmu):
    """Its patience begins then too."""
    p = {"range_at_zero": 1.0, "range_patience": 5, "t_armed": 20}
    assert first_loss(fmu("safety_monitor", ALONE | p), lambda k: stated(k, 110, 0, 100))[0] == 25


def test_switched_off_the_range_moves_no_bit(fmu):
    p = SPHERE | {"passive_time": 300, "act": 1}
    a, b = fmu("safety_monitor", p), fmu("safety_monitor", p)
    for k in range(12):
        a.step(H, stated(k, 9 - k, -1))
        b.step(H, stated(k, 9 - k, -1, 500.0))
        assert bits(a) == bits(b)


@pytest.mark.parametrize(
    ("parameters", "name"),
    [
        ({"use_range": 1, "lost_time": 0}, "use_range"),
        ({"range_tau": 0}, "range_tau"),
        ({"range_patience": -1}, "range_patience"),
        ({"range_at_zero": -1}, "range_at_zero"),
        ({"range_slope": -1}, "range_slope"),
    ],
)
def test_bad_parameters_are_rejected(tmp_path, parameters, name):
    assert name in rejection("safety_monitor", parameters, tmp_path)
