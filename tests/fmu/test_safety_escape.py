# SPDX-License-Identifier: BSD-2-Clause
"""Rule escape and the relative abort of safety_monitor.fmu: against matrix exponentials, closed
forms, all corners of the error set and drawn states.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from tests.close import close
from tests.reference import escape
from tests.reference.escape import GEO, Bounds
from tests.reference.mission import hill_matrix

from . import test_safety_monitor as monitor
from .rejections import rejection

MU, A = 3.986004415e14, 42164e3
TRUTH, ESTIMATES = Bounds(), Bounds(abort_speed=0.3)
ON = monitor.OFF | {"escape_time": 3600, "escape_radius": (12, 1.75), "mass": 100}
ON |= {"abort_force": 0.9, "abort_speed": 0.1, "act": 1}
RESTING, NOT_YET, ESCAPE = 1e9, -1, 6

INSTANTS = (
    (0, (100.003, -500, 0), (1e-4, 0, 0)),
    (0, (71.484, -388.055, 0.471), (-0.12628, 0.49051, -0.00578)),
    (0, (30.737, -192.824, 1.011), (-0.08557, 0.48955, 0.0028)),
    (0, (14.482, -105.122, 1.474), (-0.01164, 0.03283, -0.00087)),
    (1, (13.657, -103.146, 1.414), (-0.00908, 0.01698, -0.00065)),
    (1, (13.296, -102.466, 1.388), (-0.00897, 0.01704, -0.00065)),
    (2, (11.918, -100.966, 1.245), (-0.1156, 0.13329, -0.01192)),
    (2, (2.159, -58.997, 0.226), (-0.03982, 0.39725, -0.0042)),
    (2, (0.416, -34.064, 0.043), (-0.00613, 0.14352, -0.00064)),
    (2, (0.109, -25.068, 0.011), (-0.00134, 0.05173, -0.00014)),
    (2, (0.02, -21.096, 0.002), (-0.00021, 0.01119, -2e-05)),
    (3, (0.013, -20.693, 0.001), (-0.00013, 0.00707, -1e-05)),
    (3, (0.01, -20.565, 0.001), (-0.00011, 0.00576, -1e-05)),
    (4, (0.036, -20.492, -0.087), (0.01213, 0.01332, -0.04084)),
    (4, (-1.477, -7.323, -18.551), (-0.04785, 0.27597, -0.10517)),
    (4, (-4.115, 18.319, -6.887), (0.00883, 0.07823, 0.20279)),
    (5, (-3.353, 19.6, 1.381), (0.02941, -0.01706, 0.20443)),
    (5, (1.39, 3.912, 12.413), (0.02345, -0.15264, -0.05784)),
    (5, (1.312, -2.85, 3.26), (-0.01196, -0.0012, -0.06861)),
    (6, (0.628, -2.873, -0.591), (-0.00669, 0.00462, -0.02951)),
)
"""Phase, position and velocity as seen in H [m, m/s]: 20 instants of a mission."""


def states(t, rho, drho, a=A, **bodies):
    """Inputs of the monitor on a circular orbit of radius a."""
    scaled = {"MU": MU, "A": a, "N": np.sqrt(MU / a**3)}
    with pytest.MonkeyPatch.context() as patch:
        for name, value in scaled.items():
            patch.setattr(monitor, name, value)
        return monitor.states(t, rho, drho, **bodies)


def foreseen(fmu, rho, drho, a=A, approaching=0, **parameters):
    unit = fmu("safety_monitor", ON | parameters)
    unit.step(1, states(0, rho, drho, a) | {"approaching": approaching})
    return unit


# ---- the margin ----


@pytest.mark.parametrize("a", [A, 7.0e6])
def test_margin_matches_an_independent_derivation(fmu, rng, a):
    for _ in range(6):
        p = Bounds(*rng.uniform(0.3, 1.5, 9) * list(vars(Bounds()).values()))
        rho, drho = rng.normal(size=3) * 30, rng.normal(size=3) * 0.3
        expected, (low, high) = escape.bound(p, np.sqrt(MU / a**3), rho, drho)
        unit = foreseen(fmu, rho, drho, a, **vars(p))
        assert abs(unit.get("escape_margin") + 12 - expected) < 1e-6 * size_of(rho, expected)
        assert unit.get("escape_dv") == pytest.approx(
            np.linalg.norm(escape.increment(p, rho, drho))
        )
        assert low - 1e-6 <= unit.get("escape_time_least") <= high + 1e-6


def size_of(rho, expected):
    return max(np.linalg.norm(rho), abs(expected), 1)


def test_worked_example_in_closed_form_and_by_all_corners(fmu):
    """25 m behind, closing at 0.16 m/s, 0.3 m/s outwards: 0.46 m/s in 51.1 s, on at 20.9 m."""
    rho, drho, n = np.array((0, -25.0, 0)), np.array((0, 0.16, 0)), 7.292e-5
    dv = escape.increment(ESTIMATES, rho, drho)
    r, v = escape.after_burn(ESTIMATES, rho, drho)
    assert dv == pytest.approx((0, -0.46, 0)) and v == pytest.approx((0, -0.3, 0))
    assert r == pytest.approx((0, -25 + 0.08 * 100 * 0.46 / 0.9, 0)) and abs(r[1] + 20.911) < 1e-3
    # the path leaves along the track: the first chord is the nearest, its far end the least certain
    t = 20.0
    c = np.array((2 * (np.cos(n * t) - 1) / n * 0.3, r[1] - (4 * np.sin(n * t) / n - 3 * t) * 0.3))
    along, aside = (4 * np.sin(n * t) / n - 3 * t, 2 * (1 - np.cos(n * t)) / n)
    u = c / np.hypot(*c)
    b = np.array((np.sin(n * t) / n * u[0] - aside * u[1], aside * u[0] + along * u[1]))
    a = np.array(((4 - 3 * np.cos(n * t)) * u[0] + 6 * (np.sin(n * t) - n * t) * u[1], u[1]))
    h = 0.05 * abs(a).sum() + 5e-3 * abs(b).sum() + 0.05 * abs(0.46 * b[1]) + 0.0046 * np.hypot(*b)
    s = t**2 / 8 * (4 * n * 0.305 + 3 * n**2 * 80)
    k = np.sqrt(2 / (1 - u[1]))
    expected = 20.9111111111 - k * (h + 1e-8 * t**2 / 2) - s - 12
    radius = (MU / n**2) ** (1 / 3)
    margin = foreseen(fmu, rho, drho, radius, abort_speed=0.3).get("escape_margin")
    assert abs(margin - expected) < 1e-6 and abs(expected - 8.2) < 0.05
    least = escape.ranges(ESTIMATES, n, rho, drho, escape.corners(ESTIMATES, dv)).min()
    assert abs(least - (20.9111 - 0.05)) < 5e-3  # at once: no corner comes nearer later
    assert margin + 12 <= least < margin + 12 + 2


@pytest.mark.verifies("G.11-2")
@pytest.mark.parametrize("p", [TRUTH, ESTIMATES], ids=["truth", "estimates"])
@pytest.mark.parametrize("count", [100, pytest.param(10_000, marks=pytest.mark.long)])
def test_margin_is_never_above_drawn_states_of_any_phase_and_near_them(fmu, p, count):
    near = 0
    for k, (phase, rho, drho) in enumerate(INSTANTS):
        radius = 1.75 if phase >= 5 else 12
        dv = escape.increment(p, np.array(rho), np.array(drho))
        unit = foreseen(fmu, rho, drho, approaching=phase >= 5, axis_radius=0.1, **vars(p))
        errors = escape.drawn(p, dv, np.random.default_rng(k), count)
        if count <= 100:
            errors = np.concatenate((errors, escape.corners(p, dv)[::16]))
        step = 5.0 if count <= 100 else 1.0
        least = escape.ranges(p, GEO, np.array(rho), np.array(drho), errors, step).min()
        found = unit.get("escape_margin") + radius
        assert found <= least, (k, found, least)
        near += least - found < 2
    assert near >= 18


def test_margin_is_below_the_paths_of_all_corners_in_low_orbit(fmu, rng):
    """Drifts that return, pass fast and turn within the hour: a bound all the same."""
    n = np.sqrt(MU / 7.0e6**3)
    for _ in range(3):
        rho, drho = rng.normal(size=3) * 15, rng.normal(size=3) * 0.1
        dv = escape.increment(TRUTH, rho, drho)
        unit = foreseen(fmu, rho, drho, 7.0e6, **vars(TRUTH))
        errors = escape.corners(TRUTH, dv)[::8]
        assert unit.get("escape_margin") + 12 <= escape.ranges(TRUTH, n, rho, drho, errors).min()


def test_in_deep_space_the_drift_is_straight(fmu):
    """Outwards nothing comes nearer than the end of the burn, but by the errors of the first
    step.
    """
    p = ON | {"mu": 0, "k_p": 0, "k_n": 0, "e_model": 0}
    unit = fmu("safety_monitor", p)
    unit.step(1, monitor.states(0, (30.0, 0, 0), (-0.05, 0, 0), 0) | {"approaching": 0})
    T_b = 100 * 0.15 / 0.9
    expected = 30 - 0.05 * T_b / 2 - 0.05 - 0.005 * 20 - 12
    assert unit.get("escape_margin") == pytest.approx(expected, abs=1e-9)
    assert unit.get("escape_time_least") == 0
    assert unit.get("escape_dv") == pytest.approx(0.15)


@pytest.mark.verifies("G.11-2")
def test_margin_is_below_the_range_of_every_burn_in_deep_space(fmu, rng):
    """First a burn that turns through 90 degrees: it comes within 8.9 m, although both tangents of
    its path stay at 10 m.
    """
    p = ON | {"mu": 0, "e_r": 0, "e_v": 0, "k_p": 0, "k_n": 0, "e_model": 0, "r_max": 0}
    T = np.sqrt(100 * np.hypot(40, 20) / 0.9)
    turning = np.array(((10, 0, 0), (0, 20 / T, 0), (-40 / T, -20 / T, 0)))
    assert np.isclose(range_of_burn(*turning), 8.854, atol=1e-3)
    drawn = rng.normal(size=(20, 3, 3)) * np.array((20, 0.3, 0.3))[:, None]
    for rho, drho, dv in (turning, *drawn):
        unit = fmu("safety_monitor", p | {"abort_dv_H": dv})
        unit.step(1, monitor.states(0, rho, drho, 0) | {"approaching": 0})
        assert unit.get("escape_margin") + 12 <= range_of_burn(rho, drho, dv) + 1e-9


def range_of_burn(rho, drho, dv):
    """Least range during the burn of the increment dv by 0.9 N on 100 kg, without gravity."""
    T_b = 100 * np.linalg.norm(dv) / 0.9
    t = np.linspace(0, T_b, 2001)[:, None]
    return np.linalg.norm(rho + drho * t + dv * t**2 / (2 * T_b), axis=1).min()


def test_an_abort_that_drifts_freely_is_foreseen_as_the_drift(fmu):
    rho, drho = np.array((1.0, -30, 0.5)), np.array((0.01, 0.02, 0))
    p = Bounds(k_p=0, k_n=0)
    expected, _ = escape.bound(p, GEO, rho, drho, dv=(0, 0, 0))
    unit = foreseen(fmu, rho, drho, abort_force=0)
    assert unit.get("escape_margin") + 12 == pytest.approx(expected, abs=1e-6)
    assert unit.get("escape_dv") == 0


def test_an_abort_along_the_corridor_is_foreseen_with_its_own_increment(fmu):
    rho, drho = np.array((2.0, -30, 0.5)), np.array((0.01, 0.1, 0))
    axis = np.array((0.6, 0, 0.8))
    for changes, dv in (
        ({"abort_relative": 0}, 0.1 * axis),
        ({"abort_dv_H": (0.1, 0, 0)}, (0.1, 0, 0)),
    ):
        expected, _ = escape.bound(TRUTH, GEO, rho, drho, dv=dv)
        unit = foreseen(fmu, rho, drho, corridor_axis=axis, **changes)
        assert unit.get("escape_margin") + 12 == pytest.approx(expected, abs=1e-6)
        assert unit.get("escape_dv") == pytest.approx(0.1)


# ---- the rule ----


def closing(t):
    return (0.0, -30 + 0.2 * t, 0.0), (0.0, 0.2, 0.0)


@pytest.mark.verifies("G.11-1")
def test_the_rule_aborts_while_the_escape_is_still_certain(fmu):
    unit = fmu("safety_monitor", ON | {"abort_on": (0, 0, 0, 0, 0, 0, 1)})
    margins = []
    for t in range(100):
        unit.step(1, states(t, *closing(t)) | {"approaching": 0, "F_cmd_S": (1, 0, 0)})
        if unit.get("abort"):
            break
        margins.append(unit.get("escape_margin"))
    last = unit.get("least_margin")[ESCAPE]
    assert min(margins) >= 1 > last > 0
    assert unit.get("t_first")[ESCAPE] == t == len(margins)
    assert unit.get("rule_violated") == 7
    unit.step(1, states(t + 1, *closing(t + 1)) | {"approaching": 0})
    assert unit.get("escape_margin") == RESTING and unit.get("escape_dv") == 0
    assert unit.get("escape_time_least") == NOT_YET


@pytest.mark.parametrize("period", [0, 5])
def test_the_abort_is_foreseen_at_its_own_period(fmu, period):
    unit = fmu("safety_monitor", ON | {"escape_period": period, "abort_on": (0,) * 7})
    margins = []
    for t in range(12):
        unit.step(1, states(t, *closing(t)) | {"approaching": 0})
        margins.append(unit.get("escape_margin"))
    changes = 1 + np.flatnonzero(np.diff(margins))
    assert changes.tolist() == (list(range(1, 12)) if period == 0 else [5, 10])


@pytest.mark.verifies("G.11-3")
def test_radius_and_reserve_follow_the_approach_and_the_rule_rests_near_the_target(fmu):
    p = {"escape_radius": (12, 2), "escape_reserve": (1, 0.5), "axis_radius": 3}

    def margin(y, approaching=1, **changes):
        return foreseen(fmu, (0, y, 0), (0, 0, 0), approaching=approaching, **p | changes)

    far = margin(-20, 0).get("escape_margin")
    assert margin(-20).get("escape_margin") == pytest.approx(far + 10)
    assert margin(-3.01).get("escape_margin") < 1.01
    assert margin(-2.99).get("escape_margin") == RESTING
    assert margin(-20, escape_radius=(12, 0)).get("escape_margin") == RESTING
    assert margin(-20, 0, escape_time=0).get("escape_margin") == RESTING
    assert margin(-2.7, axis_radius=0).get("violated")[ESCAPE] == 1
    assert margin(-3.2, axis_radius=0).get("violated")[ESCAPE] == 0


def test_age_of_the_drift_without_thrust_is_published(fmu):
    p = monitor.DRIFT | monitor.DEEP | {"passive_period": 4}
    unit, ages = fmu("safety_monitor", p), []
    for t in range(10):
        unit.step(1, monitor.states(t, (-20, 8, 0), (0.1, 0, 0), 0) | {"relative_valid": t != 8})
        ages.append(unit.get("passive_age"))
    assert ages == [0, 1, 2, 3, 0, 1, 2, 3, 4, 0]
    assert fmu("safety_monitor", monitor.OFF).get("passive_age") == 0


# ---- the increment ----


def ordered(fmu, rho, drho, parameters=None, **bodies):
    unit = fmu("safety_monitor", ON | {"abort_time": 0, "abort_force": 0} | (parameters or {}))
    unit.step(1, states(0, rho, drho, **bodies))
    return unit.get("dv_left_N")


def C_NH(t=0):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(monitor, "N", GEO)
        return monitor.hill(t)[0]


def test_the_abort_makes_the_velocity_outwards(fmu, rng):
    rho, drho = rng.normal(size=3) * 30, rng.normal(size=3) * 0.3
    expected = C_NH() @ (0.1 * rho / np.linalg.norm(rho) - drho)
    close(ordered(fmu, rho, drho), expected, rel=1e-8)


@pytest.mark.parametrize("axes", [0, 1])
def test_near_the_target_and_inside_the_corridor_it_leaves_along_the_axis(fmu, axes):
    turn = Rotation.from_euler("xyz", (0.3, -0.5, 1))
    C_NT = turn.as_matrix() if axes else C_NH()
    axis, drho = np.array((0.6, 0, 0.8)), np.array((0.01, 0.02, -0.03))
    aside = np.cross(axis, (0, 1, 0))
    p = {"use_corridor": 1, "corridor_axes": axes, "corridor_axis": axis, "axis_radius": 3}
    for distance, off, along in ((2.9, 0.2, True), (2.9, 0.5, False), (3.1, 0.2, False)):
        rho_N = C_NT @ (distance * (np.cos(off) * axis + np.sin(off) * aside))
        out = C_NT @ axis if along else rho_N / distance
        T = (turn, np.zeros(3))
        dv = ordered(fmu, C_NH().T @ rho_N, drho, p, T=T)
        close(dv, 0.1 * out - C_NH() @ drho, rel=1e-8)
        if axes == 0:
            continue
        dv = ordered(fmu, C_NH().T @ rho_N, drho, p | {"use_corridor": 0}, T=T)
        close(dv, 0.1 * rho_N / distance - C_NH() @ drho, rel=1e-8)


@pytest.mark.verifies("G.10-1")
@pytest.mark.parametrize("lost", ["relative_valid", "range 0"])
def test_of_a_lost_target_the_last_valid_state_has_drifted_until_the_abort(fmu, lost):
    """The abort comes 400 s after the last state; what the inputs say meanwhile is not used."""
    rho, drho = np.array((3.0, -40, 2)), np.array((0.02, 0.11, -0.03))
    unit = fmu("safety_monitor", ON | {"abort_time": 400, "abort_force": 0, "escape_time": 0})
    unit.step(1, states(0, rho, drho))
    for t in range(1, 401):
        seen = states(t, (1, 5, 3), (1, 2, 3)) | {"relative_valid": 0}
        if lost == "range 0":
            seen = states(t, (0, 0, 0), (0, 0, 0))
        unit.step(1, seen)
    now = expm(hill_matrix(GEO) * 400) @ np.concatenate((rho, drho))
    dv = 0.1 * now[:3] / np.linalg.norm(now[:3]) - now[3:]
    assert unit.get("abort") == 1
    close(unit.get("dv_left_N"), C_NH(400) @ dv, rel=1e-7)


def test_without_any_valid_state_the_servicer_drifts(fmu):
    unit = fmu("safety_monitor", ON | {"abort_time": 0})
    unit.step(1, states(0, (0, -20, 0), (0, 0.1, 0)) | {"relative_valid": 0})
    assert unit.get("abort") == 1
    assert not unit.get("F_safe_S").any()


@pytest.mark.verifies("G.10-1")
def test_the_increment_is_formed_once_and_burnt_in_full(fmu):
    rho, drho = np.array((3.0, -40, 2)), np.array((0.02, 0.11, -0.03))
    unit, impulse = fmu("safety_monitor", ON | {"abort_time": 3}), np.zeros(3)
    for t in range(75):
        unit.step(1, states(t, rho + t, drho * (1 + t)) | {"F_cmd_S": (1, 2, 3)})
        if t < 3:
            assert unit.get("F_safe_S").tolist() == [1, 2, 3]
        else:
            impulse += unit.get("F_safe_S")
            assert np.linalg.norm(unit.get("F_safe_S")) < 0.9 + 1e-12
    at = rho + 3
    expected = C_NH(3) @ (0.1 * at / np.linalg.norm(at) - drho * 4)
    close(impulse / 100, expected, rel=1e-7)
    assert not unit.get("dv_left_N").any() or np.linalg.norm(unit.get("dv_left_N")) < 1e-12


# ---- simulated by the FMUs of both bodies, with oblateness ----
ORBIT = {"a": A, "e": 0, "inc": 0, "use_J2": 1, "mu": MU}
ORBIT |= {"R_E": 6378136.3, "J2": 1.0826360229829945e-3}
MONITOR = {name: ORBIT[name] for name in ("mu", "R_E", "J2")} | {"use_J2": 1, "act": 1}
MONITOR |= {"abort_time": 0, "mass": 100, "abort_force": 0.9, "lost_time": 0}
BODY = {"T": ("r_TN_N", "v_TN_N", "q_TN", "omega_TN_T"), "S": ("r_SN_N", "v_SN_N", "q_SN")}


def ranges_after(fmu, rho, drho, speed, changes=None):
    """Ranges of an hour in the FMUs after an abort from a relative state: burn every second, then
    every 10 s.
    """
    target = fmu("target", ORBIT)
    servicer = fmu("servicer", ORBIT | {"rho_0_H": rho, "drho_0_H": drho, "mass_0": 100})
    monitor = fmu("safety_monitor", MONITOR | {"abort_speed": speed} | (changes or {}))
    found, t = [], 0.0
    while t < 3600:
        inputs = {name: target.get(name) for name in BODY["T"]}
        inputs |= {name: servicer.get(name) for name in BODY["S"]}
        h = 1.0 if t < 130 else 10.0
        monitor.step(h, inputs)
        servicer.step(h, {"F_S": monitor.get("F_safe_S")})
        target.step(h)
        t += h
        found.append(np.linalg.norm(servicer.get("r_SN_N") - target.get("r_TN_N")))
    assert np.linalg.norm(monitor.get("dv_left_N")) < 1e-12
    return np.array(found)


@pytest.mark.parametrize("speed", [0.1, 0.3], ids=["truth", "estimates"])
def test_aborts_from_states_of_every_phase_stay_outside_the_zone(fmu, speed):
    """An instant of each phase; never nearer than the bound of rule escape states."""
    for k in (1, 4, 7, 8, 11, 14, 17):
        phase, rho, drho = INSTANTS[k]
        distance = ranges_after(fmu, rho, drho, speed)
        assert distance.min() > (12 if phase < 5 else 2.9)
        assert distance.min() >= escape.bound(Bounds(abort_speed=speed), GEO, rho, drho)[0]
        assert distance[-1] > 60


def test_an_abort_along_the_corridor_is_no_escape(fmu):
    """The same closing, 0.4 m/s at 59 m, with the velocity added along an axis of the target."""
    _, rho, drho = INSTANTS[7]
    along = {"abort_relative": 0, "corridor_axes": 1, "corridor_axis": (1, 0, 0)}
    assert ranges_after(fmu, rho, drho, 0.1, along).min() < 12


@pytest.mark.parametrize(
    ("parameters", "name"),
    [({"escape_time": -1}, "escape_time"), ({"escape_radius": (1, -1)}, "escape_radius")],
)
def test_bad_parameters_are_rejected(tmp_path, parameters, name):
    assert name in rejection("safety_monitor", parameters, tmp_path)
