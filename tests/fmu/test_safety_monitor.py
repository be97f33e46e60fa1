# SPDX-License-Identifier: BSD-2-Clause
"""safety_monitor.fmu against geometry and closed forms: margins at a point, straight drift and
drift ellipses between samples, grazing passes, the drift without thrust, lost navigation, abort.

States come from the relative motion in the Hill frame of a circular orbit, turned into inertial
axes here. Margins are never above the margins of dense sampling.
"""

from __future__ import annotations

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy.interpolate import CubicHermiteSpline
from scipy.optimize import brentq, minimize_scalar
from scipy.spatial.transform import Rotation

from tests.each import each
from tests.reference.attitude import cross

from .driver import bits
from .rejections import rejection

MU, A = 3.986004415e14, 7.0e6
N = np.sqrt(MU / A**3)
PLANE = Rotation.from_euler("ZXZ", (1.1, 0.7, -0.4)).as_matrix()
RESTING, NOT_YET = 1e9, -1
RESOLUTION = 1e-7
Z = np.array((0, 0, 1))
RULES = ("keep_out", "corridor", "speed", "passive", "plume", "navigation", "escape")
OFF = {"keep_out_shape": 0, "lost_time": 0, "use_J2": 0, "mu": MU}
SPHERE = OFF | {"keep_out_shape": 1, "keep_out_half": (3, 3, 3)}
DEEP = {"mu": 0, "use_J2": 0}


# ---- states ----


def hill(t, mu=MU):
    """C_NH of the orbit, target position and velocity."""
    if mu == 0:
        return np.eye(3), np.array((5.0, -3.0, 2.0)), np.array((0.1, 0.2, -0.3))
    c, s = np.cos(N * t), np.sin(N * t)
    C_NH = PLANE @ np.array(((c, -s, 0), (s, c, 0), (0, 0, 1)))
    return C_NH, A * C_NH[:, 0], A * N * C_NH[:, 1]


def states(t, rho_H, drho_H, mu=MU, *, T=None, S=None):
    """Inputs from relative position and velocity in the Hill frame; T, S: attitude (Rotation, body
    to N) and rate in body axes.
    """
    C_NH, r, v = hill(t, mu)
    spin = np.array((0, 0, N if mu else 0))
    inputs = {
        "r_TN_N": r,
        "v_TN_N": v,
        "r_SN_N": r + C_NH @ rho_H,
        "v_SN_N": v + C_NH @ (np.asarray(drho_H) + cross(spin, rho_H)),
    }
    for letter, body in (("T", T), ("S", S)):
        turn, omega = body or (Rotation.identity(), np.zeros(3))
        inputs |= {
            f"q_{letter}N": np.roll(turn.as_quat(), 1),
            f"omega_{letter}N_{letter}": omega,
        }
    return inputs


def cw(rho, drho, t):
    """Free motion near a circular orbit (Clohessy & Wiltshire)."""
    (x, y, z), (u, v, w), c, s = rho, drho, np.cos(N * t), np.sin(N * t)
    position = (
        (4 - 3 * c) * x + s / N * u + 2 / N * (1 - c) * v,
        6 * (s - N * t) * x + y - 2 / N * (1 - c) * u + (4 * s - 3 * N * t) / N * v,
        z * c + w * s / N,
    )
    velocity = (
        3 * N * s * x + c * u + 2 * s * v,
        -6 * N * (1 - c) * x - 2 * s * u + (4 * c - 3) * v,
        -z * N * s + w * c,
    )
    return np.array(position), np.array(velocity)


def watch(fmu, parameters, motion, h, end, **changes):
    """Monitor fed with motion(t) -> (rho_H, drho_H) every h, and its outputs sample by sample."""
    mu = parameters.get("mu", MU)
    unit, rows = fmu("safety_monitor", parameters, states(0, *motion(0), mu) | changes), []
    for k in range(round(end / h) + 1):
        unit.step(h, states(k * h, *motion(k * h), mu) | changes)
        rows.append(unit.outputs())
    return unit, rows


def column(rows, name):
    return np.array([row[name] for row in rows])


# ---- margins at a point ----


def ellipsoid(p, d):
    return min(d) * (np.linalg.norm(p / d) - 1)


def box(p, d):
    return min(d) * (np.max(np.abs(p) / d) - 1)


def cone(p, axis, half_angle):
    """Signed distance to the surface from inside (and to its generator from outside)."""
    along = p @ axis
    off = np.arctan2(np.linalg.norm(cross(axis, p)), along)
    return np.linalg.norm(p) * np.sin(half_angle - off)


def random_case(rng):
    rho, drho = rng.normal(size=3) * 10, rng.normal(size=3) * 0.1
    bodies = [(Rotation.random(random_state=rng), rng.normal(size=3) * 0.1) for _ in "TS"]
    return rho, drho, *bodies


def in_target_axes(rho, T):
    return T[0].as_matrix().T @ hill(0)[0] @ rho


def point(fmu, parameters, case, **changes):
    rho, drho, T, S = case
    unit = fmu("safety_monitor", OFF | parameters)
    unit.step(1, states(0, rho, drho, T=T, S=S) | changes)
    return unit


@pytest.mark.parametrize("axes", [0, 1])
@pytest.mark.parametrize(("shape", "margin"), [(1, ellipsoid), (2, box)])
def test_keep_out_margin_matches_its_shape_in_its_axes(fmu, rng, axes, shape, margin):
    case, d = random_case(rng), rng.uniform(1, 20, 3)
    unit = point(fmu, {"keep_out_shape": shape, "keep_out_half": d, "keep_out_axes": axes}, case)
    p = in_target_axes(case[0], case[2]) if axes else case[0]
    assert abs(unit.get("keep_out_margin") - margin(p, d)) < 1e-8
    assert unit.get("violated")[0] == (margin(p, d) < 0)


@pytest.mark.parametrize("axes", [0, 1])
def test_corridor_margin_is_the_distance_to_the_cone_in_its_axes(fmu, rng, axes):
    case, axis, apex = random_case(rng), rng.normal(size=3), rng.normal(size=3)
    axis, alpha = axis / np.linalg.norm(axis), rng.uniform(0.1, 1.5)
    p = {"use_corridor": 1, "corridor_axes": axes, "corridor_axis": axis, "corridor_apex": apex}
    unit = point(fmu, p | {"corridor_half_angle": alpha}, case)
    q = (in_target_axes(case[0], case[2]) if axes else case[0]) - apex
    assert abs(unit.get("corridor_margin") - cone(q, axis, alpha)) < 1e-8


def test_corridor_ends_at_its_length(fmu):
    p = {"use_corridor": 1, "corridor_axis": (0, 1, 0), "corridor_half_angle": 0.5}
    aside = np.array((30.0, 12.0, 0.0)), np.zeros(3), None, None
    assert point(fmu, p, aside).get("corridor_margin") < 0
    for length in (10, 0.5):
        unit = point(fmu, p | {"corridor_length": length}, aside)
        assert abs(unit.get("corridor_margin") - (12 - length)) < 1e-8


def test_speed_margin_is_the_limit_at_this_range_minus_the_speed_in_the_hill_frame(fmu, rng):
    case = random_case(rng)
    p = {"use_speed_limit": 1, "speed_at_zero": 0.05, "speed_slope": 0.02}
    expected = 0.05 + 0.02 * np.linalg.norm(case[0]) - np.linalg.norm(case[1])
    assert abs(point(fmu, p, case).get("speed_margin") - expected) < 1e-8


@pytest.mark.parametrize(("most", "counted"), [(1.0, 1.0), (0.01, 0.01)])
def test_speed_limit_rises_with_the_tumble_rate(fmu, rng, most, counted):
    """As estimated, at most tumble_max; without speed_tumble it does not count."""
    case = random_case(rng)
    p = {"use_speed_limit": 1, "speed_at_zero": 0.05, "speed_slope": 0.02, "tumble_max": most}
    plain, unit = (point(fmu, p | {"speed_tumble": k}, case) for k in (0, 1))
    more = min(np.linalg.norm(case[2][1]), counted) * np.linalg.norm(case[0])
    assert more > 1e-3
    assert abs(unit.get("speed_margin") - plain.get("speed_margin") - more) < 1e-8


def test_plume_margin_is_the_distance_of_the_target_from_the_cone_of_exhaust(fmu, rng):
    """Exhaust leaves against the force; the target is seen from the servicer at -rho."""
    case, F, beta = random_case(rng), rng.normal(size=3), rng.uniform(0.1, 1.2)
    C_SH = case[3][0].as_matrix().T @ hill(0)[0]
    target, exhaust = -C_SH @ case[0], -F / np.linalg.norm(F)
    p = {"use_plume": 1, "plume_half_angle": beta, "plume_range": 15}
    margin = point(fmu, p, case, F_cmd_S=F).get("plume_margin")
    outside = max(-cone(target, exhaust, beta), np.linalg.norm(target) - 15)
    assert abs(margin - outside) < 1e-8
    assert point(fmu, p, case, F_cmd_S=1e-4 * F / np.linalg.norm(F)).get("plume_margin") == RESTING


def test_rules_that_are_off_or_rest_state_so(fmu):
    case = np.zeros(3), np.ones(3), None, None
    unit = point(fmu, {}, case)
    for rule in RULES:
        assert unit.get(f"{rule}_margin") == RESTING
    assert unit.get("nearest") == 0
    p = {"use_corridor": 1, "use_speed_limit": 1, "keep_out_shape": 1, "keep_out_opens": 1}
    given_up = point(fmu, p, case, approaching=0)
    assert given_up.get("corridor_margin") == given_up.get("speed_margin") == RESTING
    assert given_up.get("keep_out_margin") < 0
    assert point(fmu, p, case).get("keep_out_margin") == RESTING


@pytest.mark.verifies("G.2-6")
def test_nearest_rule_is_the_one_with_the_least_share_of_its_size(fmu):
    p = SPHERE | {"use_speed_limit": 1, "speed_at_zero": 1, "speed_slope": 0}
    for distance, rate, which in ((30, 0.2, 3), (4, 0.2, 1), (30, 0, 3), (3.3, 0.2, 1)):
        case = np.array((0, distance, 0)), np.array((rate, 0, 0)), None, None
        assert point(fmu, p, case).get("nearest") == which


# ---- between samples: straight drift in deep space, where the cubic arc is exact ----


def straight(rho, drho):
    return lambda t: (np.asarray(rho) + t * np.asarray(drho), np.asarray(drho))


def entry_into_sphere(rho, drho, R):
    """The smaller root of |rho + t drho| = R."""
    a, b, c = drho @ drho, rho @ drho, rho @ rho - R * R
    return (-b - np.sqrt(b * b - a * c)) / a


@pytest.mark.parametrize("h", [0.1, 1.0, 8.0])
def test_straight_drift_enters_the_sphere_when_the_quadratic_equation_states(fmu, h):
    rho, drho = np.array((-20.0, 1.0, 0.5)), np.array((0.83, 0.02, -0.01))
    p = SPHERE | DEEP
    unit, _ = watch(fmu, p, straight(rho, drho), h, 40)
    assert abs(unit.get("t_first")[0] - entry_into_sphere(rho, drho, 3)) < 1e-9
    assert unit.get("t_violation") == unit.get("t_first")[0]
    assert unit.get("rule_violated") == 1


@pytest.mark.parametrize("h", [0.7, 5.0, 40.0])
@pytest.mark.parametrize("miss", [1e-6, -1e-6])
def test_grazing_pass_is_seen_and_a_miss_by_a_micrometre_is_none(fmu, h, miss):
    """Closest approach 3 m + miss at t = 17.3 s, far from any sample."""
    p = SPHERE | DEEP
    motion = straight((-17.3 * 0.8, 3 + miss, 0), (0.8, 0, 0))
    unit, rows = watch(fmu, p, motion, h, 40)
    least = column(rows, "keep_out_margin").min()
    assert miss - RESOLUTION - 1e-12 <= least <= miss + 1e-12
    assert unit.get("violated")[0] == (miss < 0)
    if miss < 0:
        first = 17.3 - np.sqrt(9 - (3 + miss) ** 2) / 0.8
        assert abs(unit.get("t_first")[0] - first) < 1e-6


@pytest.mark.parametrize("miss", [1e-6, -1e-6])
def test_grazing_an_edge_of_the_box(fmu, miss):
    """A diagonal pass beside the edge x = 2, y = 1: between two samples both faces are crossed."""
    p = OFF | DEEP | {"keep_out_shape": 2, "keep_out_half": (2, 1, 5)}
    motion = straight((2 - 6.2 + miss, 1 + 6.2 + miss, 0), (1, -1, 0))
    unit, _ = watch(fmu, p, motion, 4, 12)
    assert unit.get("violated")[0] == (miss < 0)
    if miss < 0:  # inside while x < 2 and y < 1
        assert abs(unit.get("t_first")[0] - (6.2 + miss)) < 1e-9


@pytest.mark.parametrize("miss", [1e-6, -1e-6])
def test_grazing_the_corridor_and_the_plume(fmu, miss):
    """A pass across the cone of 30 deg about y, in the plane z = 1; its edge is a hyperbola with
    its vertex at y = sqrt 3.
    """
    p = OFF | DEEP | {"use_corridor": 1, "corridor_half_angle": np.pi / 6}
    leaves = straight((-0.2, 3, 1), (0.1, -0.1 * np.sqrt(3), 0))
    unit, _ = watch(fmu, p, leaves, 30, 30)
    gone = brentq(lambda t: cone(leaves(t)[0], np.array((0, 1, 0)), np.pi / 6), 0, 30)
    assert abs(unit.get("t_first")[1] - gone) < 1e-6

    p = OFF | DEEP | {"use_plume": 1, "plume_half_angle": np.pi / 6}
    passes = straight((-7.3, np.sqrt(3) - 2 * miss, 1), (1, 0, 0))
    unit, rows = watch(fmu, p, passes, 15, 15, F_cmd_S=(0, 1, 0))
    assert unit.get("violated")[4] == (miss < 0)
    assert abs(column(rows, "plume_margin").min() - miss) < RESOLUTION + 1e-9


def curved(p0, v0, a):
    """Constant acceleration in deep space: the cubic arc is exact."""
    p0, v0, a = (np.asarray(x, dtype=float) for x in (p0, v0, a))
    return lambda t: (p0 + t * v0 + t * t / 2 * a, v0 + t * a)


def grazing_the_ellipsoid(miss):
    """Along a tangent plane: |p|_Z is least where the line touches, there 1 + miss/b."""
    d = np.array((2.0, 5.0, 3.0))
    touch = d * np.array((0.48, -0.6, 0.64))
    along = cross(touch / d**2, (0.3, 0.2, 1.0))
    u = 0.4 * along / np.linalg.norm(along)
    return {"keep_out_shape": 1, "keep_out_half": d}, straight((1 + miss / 2) * touch - 17.3 * u, u)


def grazing_the_corridor(miss):
    """Along the edge x = y tan 30 deg and up to it from inside, least margin at 17.3 s."""
    edge, out = np.array((0.5, np.sqrt(0.75), 0)), np.array((np.sqrt(0.75), -0.5, 0))
    u, a = 0.3 * edge, -0.02 * out
    touch = 20 * edge - miss * out
    start = touch - 17.3 * u + 17.3**2 / 2 * a
    p = {"use_corridor": 1, "corridor_half_angle": np.pi / 6}
    return p, curved(start, u - 17.3 * a, a)


def grazing_the_speed_limit(miss):
    """The limit falls with the range, which is least at 17.3 s."""
    limit = {"use_speed_limit": 1, "speed_slope": 0.1, "speed_at_zero": 0.8 - 0.3 + miss}
    return limit, straight((-17.3 * 0.8, 3, 0), (0.8, 0, 0))


GRAZING = {
    "keep_out": grazing_the_ellipsoid,
    "corridor": grazing_the_corridor,
    "speed": grazing_the_speed_limit,
}


@pytest.mark.verifies("G.2-2")
@each("h", [0.7, 5.0, 40.0])
@each("miss", [1e-6, -1e-6])
@each("rule", GRAZING)
def test_every_rule_sees_a_graze_and_takes_a_miss_by_a_micrometre_for_none(fmu, rule, miss, h):
    p, motion = GRAZING[rule](miss)
    unit, rows = watch(fmu, OFF | DEEP | p, motion, h, 40)
    assert abs(column(rows, f"{rule}_margin").min() - miss) < RESOLUTION + 1e-12
    assert unit.get("violated")[RULES.index(rule)] == (miss < 0)
    if miss < 0:
        assert abs(unit.get("t_first")[RULES.index(rule)] - 17.3) < 0.1


@pytest.mark.parametrize("miss", [1e-6, -1e-6])
def test_a_drift_that_grazes_the_zone_hours_later(fmu, miss):
    """2300 s ahead, between two integration steps of 30 s."""
    unit = fmu("safety_monitor", DRIFT | DEEP)
    unit.step(1, states(0, (-23.0, 3 + miss, 0), (0.01, 0, 0), 0))
    assert abs(unit.get("passive_margin") - miss) < RESOLUTION + 1e-12
    assert unit.get("violated")[3] == (miss < 0)
    expected = (23 - np.sqrt(9 - (3 + miss) ** 2)) / 0.01 if miss < 0 else NOT_YET
    assert abs(unit.get("passive_entry") - expected) < 1e-3


def test_first_violation_in_axes_that_turn_is_the_same_at_10_hz_and_1_hz(fmu):
    """Target and servicer turn at 1 and 2 deg/s; where the truth falls below zero by brentq."""
    motion = straight((-1.5, 6.4, -0.7), (0.0, -0.1, 0.05))
    spin, d = np.array((0.012, 0.011, -0.009)), np.array((6.0, 2.0, 3.0))
    F, y = np.array((0.3, 1.0, 0.2)), np.array((0.0, 1.0, 0.0))
    p = OFF | DEEP | {"keep_out_shape": 2, "keep_out_half": d, "keep_out_axes": 1}
    p |= {"use_plume": 1, "plume_half_angle": 0.4, "plume_range": 50}
    p |= {"use_corridor": 1, "corridor_axes": 1, "corridor_half_angle": 0.9}

    def body(rate, t):
        return Rotation.from_rotvec(rate * t), rate

    def seen(rate, t):
        return body(rate, t)[0].inv().apply(motion(t)[0])

    truth = {
        0: lambda t: box(seen(spin, t), d),
        1: lambda t: cone(seen(spin, t), y, 0.9),
        4: lambda t: -cone(seen(-2 * spin, t), F / np.linalg.norm(F), 0.4),
    }
    for h in (0.1, 1.0):
        unit = fmu("safety_monitor", p)
        for k in range(round(45 / h)):
            T, S = body(spin, k * h), body(-2 * spin, k * h)
            unit.step(h, states(k * h, *motion(k * h), 0, T=T, S=S) | {"F_cmd_S": F})
        for rule, margin in truth.items():
            grid = np.linspace(0, 45, 451)
            k = np.flatnonzero([margin(t) < 0 for t in grid])[0]
            first = brentq(margin, grid[k - 1], grid[k])
            assert abs(unit.get("t_first")[rule] - first) < 1e-3, RULES[rule]


# ---- between samples: drift ellipses ----

ELLIPSES = {
    "passes_twice": ((-4.0, 0.3, 0.1), (0, 2 * N * 4.0, 0.4 * N)),
    "drifts_by": ((1.5, -30.0, 0.2), (0.001, -1.5 * N * 1.5, 0)),
    "far": ((20.0, 4.0, 1.0), (0, -2 * N * 20.0, 0.02)),
}


@pytest.mark.parametrize("h", [1.0, 30.0])
@pytest.mark.parametrize("name", ELLIPSES)
def test_margins_on_a_drift_ellipse_are_never_above_margins_of_dense_samples(fmu, name, h):
    """Motion and dense samples by Clohessy & Wiltshire; a cubic misses it by h^4/384 |d4 rho|."""
    d = np.array((5.0, 3.0, 2.0))
    p = SPHERE | {"keep_out_half": d, "use_corridor": 1, "use_speed_limit": 1}
    start = [np.array(x) for x in ELLIPSES[name]]
    _, rows = watch(fmu, p, lambda t: cw(*start, t), h, 100 * h)
    fine = np.linspace(0, h, 41)
    slack = h**4 / 384 * N**4 * 100 + 2e-9
    for k in range(1, len(rows)):
        dense = [cw(*start, (k - 1) * h + s) for s in fine]
        for margin, values, unit in (
            ("keep_out_margin", [ellipsoid(q, d) for q, _ in dense], 1),
            (
                "corridor_margin",
                [cone(q, np.array((0, 1, 0)), 0.3490658503988659) for q, _ in dense],
                1,
            ),
            (
                "speed_margin",
                [0.1 + 0.01 * np.linalg.norm(q) - np.linalg.norm(w) for q, w in dense],
                h,
            ),
        ):
            least = rows[k][margin]
            wave = slack if unit == 1 else h**2 * N**2 / 8 * 0.1 + 1e-8
            assert least <= min(values) + wave
            assert least >= min(values) - RESOLUTION - wave - np.ptp(values) / 40


@pytest.mark.verifies("G.2-2")
def test_first_violation_is_the_same_at_10_hz_and_1_hz(fmu):
    """A drift ellipse about y = 1.5 m with half axes 4 m and 8 m, from its outer end on."""
    start = np.array((0.0, 9.5, 0.1)), np.array((4 * N, 0, 0.4 * N))
    d, alpha = np.array((6.0, 9.0, 4.0)), 0.3
    p = SPHERE | {"keep_out_half": d, "use_corridor": 1, "corridor_half_angle": alpha}
    p |= {"use_speed_limit": 1, "speed_at_zero": 0.0055, "speed_slope": 0}
    times = [watch(fmu, p, lambda t: cw(*start, t), h, 700)[0].get("t_first") for h in (0.1, 1.0)]
    assert np.all(times[0][:3] > 0)
    assert np.max(np.abs(times[0] - times[1])) < 1e-3
    grid = np.linspace(0, 700, 701)
    functions = (
        lambda t: ellipsoid(cw(*start, t)[0], d),
        lambda t: cone(cw(*start, t)[0], np.array((0, 1, 0)), alpha),
        lambda t: 0.0055 - np.linalg.norm(cw(*start, t)[1]),
    )
    for f, t in zip(functions, times[1], strict=False):
        k = np.flatnonzero([f(s) < 0 for s in grid])[0]
        assert abs(brentq(f, grid[k - 1], grid[k]) - t) < 1e-3


def test_random_arcs_against_the_least_of_a_hermite_spline(fmu, rng):
    """Wild motion: arcs of any shape, deep space; splines and sampling by scipy."""
    d = np.array((2.0, 1.0, 3.0))
    p = DEEP | {"use_corridor": 1, "corridor_half_angle": 0.7, "corridor_apex": (0.5, 2, 0)}
    p |= {"use_plume": 1, "plume_half_angle": 0.5, "plume_range": 6, "corridor_length": 3}
    p |= {"use_speed_limit": 1, "speed_at_zero": 0.5, "speed_slope": 0.3}
    apex = np.array((0.5, 2, 0))

    def corridor(p):
        return max(cone(p - apex, np.array((0, 1, 0)), 0.7), p[1] - apex[1] - 3)

    def spare_speed(p, v, s):
        return 0.5 + 0.3 * np.linalg.norm(p) - np.linalg.norm(v[0] + s * (v[1] - v[0]))

    for shape, norm in ((1, ellipsoid), (2, box)):
        unit = fmu("safety_monitor", OFF | p | {"keep_out_shape": shape, "keep_out_half": d})
        knots = rng.normal(size=(14, 3)) * 4, rng.normal(size=(14, 3)) * 6
        for k in range(14):
            unit.step(1, states(k, knots[0][k], knots[1][k], 0) | {"F_cmd_S": (0, 0, 1)})
            if k == 0:
                continue
            ends, rates = (x[k - 1 : k + 1] for x in knots)
            path = CubicHermiteSpline([0, 1], ends, rates)
            for name, f in (
                ("keep_out_margin", lambda s, path=path, norm=norm: norm(path(s), d)),
                ("corridor_margin", lambda s, path=path: corridor(path(s))),
                ("speed_margin", lambda s, path=path, v=rates: spare_speed(path(s), v, s)),
                (
                    "plume_margin",
                    lambda s, path=path: max(-cone(path(s), Z, 0.5), np.linalg.norm(path(s)) - 6),
                ),
            ):
                least = dense_minimum(f)
                assert least - 2e-6 < unit.get(name) <= least + 1e-9


def dense_minimum(f):
    """Least value on 0..1: every low valley of 201 samples is searched."""
    grid = np.linspace(0, 1, 201)
    values = np.array([f(s) for s in grid])
    valleys = [
        k
        for k in range(201)
        if values[k] == min(values[max(k - 1, 0) : k + 2]) and values[k] < min(values) + 0.2
    ]
    bounds = [(grid[max(k - 1, 0)], grid[min(k + 1, 200)]) for k in valleys]
    options = {"xatol": 1e-10}
    fine = [minimize_scalar(f, bounds=b, method="bounded", options=options).fun for b in bounds]
    return min(*values, *fine)


def test_arcs_in_axes_of_a_turning_target_and_servicer(fmu):
    """Body axes that turn with constant rate; dense samples of the true motion."""
    axis, rate = np.array((0.6, 0.0, 0.8)), 0.02
    d, beta = np.array((6.0, 2.0, 3.0)), 0.4
    motion = straight((-4.0, 5.5, 0.3), (0.05, -0.02, 0.01))
    p = OFF | DEEP | {"keep_out_shape": 2, "keep_out_half": d, "keep_out_axes": 1}
    p |= {"use_plume": 1, "plume_half_angle": beta, "plume_range": 50}
    p |= {"use_corridor": 1, "corridor_axes": 1, "corridor_half_angle": 0.9}

    def turned(t):
        return Rotation.from_rotvec(axis * rate * t), axis * rate

    def inputs(t):
        return states(t, *motion(t), 0, T=turned(t), S=(*turned(-2 * t)[:1], -2 * rate * axis))

    unit, h = fmu("safety_monitor", p, inputs(0)), 4.0
    F = np.array((0.3, 1.0, 0.2))
    for k in range(40):
        unit.step(h, inputs(k * h) | {"F_cmd_S": F})
        if k == 0:
            continue
        zone, corridor, plume = [], [], []
        for t in np.linspace((k - 1) * h, k * h, 201):
            rho = motion(t)[0]
            q = turned(t)[0].inv().apply(rho)
            zone.append(box(q, d))
            corridor.append(cone(q, np.array((0, 1, 0)), 0.9))
            plume.append(-cone(turned(-2 * t)[0].inv().apply(rho), F / np.linalg.norm(F), beta))
        for name, values in (("keep_out", zone), ("corridor", corridor), ("plume", plume)):
            spacing = np.max(np.abs(np.diff(values)))  # an edge may lie between two samples
            assert min(values) - spacing < unit.get(f"{name}_margin") < min(values) + 2e-5


@pytest.mark.parametrize("first", [0, 1])
def test_rules_in_force_at_a_sample_hold_until_the_next(fmu, first):
    """Out of the corridor and across the plume between two samples; flag and force at one of
    them.
    """
    p = OFF | DEEP | {"use_corridor": 1, "corridor_half_angle": 0.5, "use_speed_limit": 1}
    p |= {"speed_slope": 0, "use_plume": 1, "plume_half_angle": 0.3}
    unit, motion = fmu("safety_monitor", p), straight((-5.0, 8, 0), (1, 0, 0))
    for k, on in enumerate((first, 1 - first)):
        force = {"approaching": on, "F_cmd_S": (0, on, 0)}
        unit.step(10, states(10 * k, *motion(10 * k), 0) | force)
    violated = unit.get("violated")
    assert violated[1] == violated[2] == violated[4] == first


@pytest.mark.verifies("G.2-1")
def test_least_margin_is_the_least_since_the_start(fmu):
    p = SPHERE | DEEP | {"use_speed_limit": 1}
    unit, rows = watch(fmu, p, straight((-20, 6, 0), (0.9, 0, 0)), 1, 60)
    assert abs(unit.get("least_margin")[0] - 3) < 2 * RESOLUTION
    least = np.minimum.accumulate(column(rows, "keep_out_margin"))
    assert np.array_equal(column(rows, "least_margin")[:, 0], least)
    assert unit.get("least_margin")[1] == RESTING


# ---- passive safety ----

DRIFT = SPHERE | {"passive_time": 5000, "passive_step": 30}


@pytest.mark.verifies("G.2-3")
@pytest.mark.parametrize("name", ELLIPSES)
def test_drift_without_thrust_comes_as_close_as_clohessy_and_wiltshire_state(fmu, name):
    """Linear equations at 20 m to 40 m: off by 25 rho^2/a, 6 mm."""
    start = [np.array(x) for x in ELLIPSES[name]]
    unit = fmu("safety_monitor", DRIFT)
    unit.step(1, states(0, *start))
    distance = [np.linalg.norm(cw(*start, t)[0]) for t in np.linspace(0, 5000, 50001)]
    assert abs(unit.get("passive_margin") - (min(distance) - 3)) < 6e-3
    inside = np.flatnonzero(np.array(distance) < 3)
    entry = 0.1 * inside[0] if len(inside) else NOT_YET
    assert abs(unit.get("passive_entry") - entry) < 5


@pytest.mark.parametrize("e", [0.0, 0.1])
def test_prediction_is_the_simulated_drift_with_oblateness_and_eccentricity(fmu, e):
    """The drift is simulated by target.fmu and servicer.fmu; 1e-3 of the distance is required."""
    orbit = {"a": 7.2e6, "e": e, "inc": 0.9, "argp": 0.4, "raan": 0.3, "nu": 0.2, "use_J2": 1}
    start = {"rho_0_H": (30.0, -250.0, 20.0), "drho_0_H": (0.12, 0.02, -0.01)}
    bodies = fmu("target", orbit), fmu("servicer", orbit | start)
    body = {name: bodies[0].get(name) for name in ("r_TN_N", "v_TN_N", "q_TN", "omega_TN_T")}
    body |= {name: bodies[1].get(name) for name in ("r_SN_N", "v_SN_N", "q_SN", "omega_SN_S")}
    p = {"keep_out_half": (10, 10, 10), "passive_time": 4000, "use_J2": 1, "passive_step": 40}
    unit = fmu("safety_monitor", p)
    unit.step(1, body)
    distance = []
    for _ in range(4000):
        for b in bodies:
            b.step(1)
        distance.append(np.linalg.norm(bodies[1].get("r_SN_N") - bodies[0].get("r_TN_N")))
    closest = min(distance)
    assert abs(unit.get("passive_margin") + 10 - closest) < 1e-3 * closest
    assert (unit.get("passive_entry") == NOT_YET) == (closest > 10)


def test_drift_in_deep_space_is_straight(fmu):
    rho, drho = np.array((-20.0, 3.5, 0.0)), np.array((0.1, 0, 0))
    unit = fmu("safety_monitor", DRIFT | DEEP)
    unit.step(1, states(0, rho, drho, 0))
    assert abs(unit.get("passive_margin") - 0.5) < RESOLUTION
    unit.step(1, states(1, rho - (0, 1, 0), drho, 0))
    assert abs(unit.get("passive_entry") - entry_into_sphere(rho - (0, 1, 0), drho, 3)) < 1e-9
    # the offset of the drift goes from 3.5 m to 2.5 m as a cubic, half-way at half time
    assert unit.get("t_first")[3] == pytest.approx(0.5, abs=1e-6)


def test_zone_that_turns_with_the_target_counts_as_the_sphere_around_it(fmu):
    case = states(0, (-40.0, 4.5, 0), (0.1, 0, 0), 0)
    for shape, around in ((1, 4.0), (2, np.sqrt(1 + 4 + 16))):
        p = DRIFT | DEEP | {"keep_out_shape": shape, "keep_out_half": (1, 2, 4), "keep_out_axes": 1}
        unit = fmu("safety_monitor", p)
        unit.step(1, case)
        assert abs(unit.get("passive_margin") - (4.5 - around)) < 1e-6


def test_passive_rule_fails_at_the_same_instant_at_10_hz_and_1_hz(fmu):
    """The servicer pushes itself towards the target; it is simulated once with held force."""
    orbit = {"a": A, "e": 0, "inc": 0.4, "use_J2": 0}
    start = {"rho_0_H": (1.0, -60.0, 0.5), "mass_0": 100}
    times = []
    for every in (1, 10):
        bodies = fmu("target", orbit), fmu("servicer", orbit | start)
        unit = fmu("safety_monitor", DRIFT | {"passive_time": 2000, "keep_out_half": (5.5,) * 3})
        for k in range(0, 400, every):
            u = {n: bodies[0].get(n) for n in ("r_TN_N", "v_TN_N", "q_TN", "omega_TN_T")}
            u |= {n: bodies[1].get(n) for n in ("r_SN_N", "v_SN_N", "q_SN", "omega_SN_S")}
            unit.step(0.1 * every, u)
            push = {"F_S": bodies[1].get("v_SN_N") / 7500 * 5}
            if k == 0:
                held = push
            bodies[0].step(0.1 * every)
            bodies[1].step(0.1 * every, held)
        times.append(unit.get("t_first")[3])
    assert 1 < times[0] < 39
    assert abs(times[0] - times[1]) < 1e-3


# ---- navigation lost, zero range, not a number ----


@pytest.mark.verifies("G.5-2")
def test_target_lost_for_longer_than_allowed_aborts_at_that_instant(fmu):
    motion = straight((0, 20, 0), (0, 0, 0))
    unit = fmu("safety_monitor", SPHERE | DEEP | {"lost_time": 3.0, "act": 1})
    for k in range(40):
        valid = k < 10 or k == 25
        garbage = {name: np.zeros_like(v) for name, v in states(0, *motion(0), 0).items()}
        u = states(0.25 * k, *motion(0), 0) if valid else garbage
        unit.step(0.25, u | {"relative_valid": valid})
        assert unit.get("keep_out_margin") == 17  # unchanged
        lost = max(0.0, 0.25 * k - (2.25 if k < 25 else 6.25))
        assert abs(unit.get("navigation_margin") - (3 - (0.0 if k < 10 else lost))) < 1e-12
        assert unit.get("abort") == (k > 21)
    assert unit.get("t_first")[5] == 2.25 + 3.0
    assert unit.get("rule_violated") == 6


@pytest.mark.parametrize("axes", [0, 1])
@pytest.mark.parametrize("dv_H", [(0, 0, 0), (0.02, -0.03, 0.01)])
def test_a_lost_target_is_left_in_the_axes_of_its_last_valid_state(fmu, axes, dv_H):
    """Hill axes turn by 0.03 rad and the target by 0.5 rad until the abort; what the inputs say
    meanwhile is not looked at.
    """
    axis, turn = np.array((0.6, 0, 0.8)), Rotation.from_euler("xyz", (0.3, -0.5, 1))
    p = SPHERE | {"lost_time": 20, "act": 1, "corridor_axis": axis, "corridor_axes": axes}
    p |= {"abort_relative": 0}
    unit = fmu("safety_monitor", p | {"abort_dv_H": dv_H, "abort_speed": 0.07, "abort_force": 0})
    for k in range(40):
        spun = (Rotation.from_rotvec((0, 0, 0.05 * k)) * turn, np.zeros(3))
        seen = states(k, (0, 20, 0), (0, 0, 0), T=spun)
        if k > 10:
            seen |= states(k, (0, -5, 3), (0.4, 2, 1), T=(turn, np.ones(3))) | {"v_TN_N": (1, 2, 3)}
        unit.step(1, seen | {"relative_valid": k <= 10})
        assert unit.get("abort") == (k > 30)
    C_NH, C_NT = hill(10)[0], (Rotation.from_rotvec((0, 0, 0.5)) * turn).as_matrix()
    out = (C_NT if axes else C_NH) @ (0.07 * axis)
    expected = C_NH @ dv_H if np.any(dv_H) else out
    assert np.max(np.abs(unit.get("dv_left_N") - expected)) < 1e-12


@pytest.mark.verifies("G.2-4")
def test_a_target_that_is_found_again_begins_a_new_arc_with_its_velocity(fmu):
    """Within the limit before and after the loss; the path in between, a jump with another
    velocity, is not evaluated, and the next arc begins with the velocity at which it was found.
    """
    p = SPHERE | DEEP | {"use_speed_limit": 1, "speed_at_zero": 0.5, "speed_slope": 0}
    unit = fmu("safety_monitor", p | {"approaching": 1})
    simulated = [(0.0, 0.1, 1), (0.1, 0.1, 1), (7.0, 3.0, 0), (9.0, 0.2, 1), (9.3, 0.4, 1)]
    for k, (y, speed, valid) in enumerate(simulated):
        position, velocity = (0, 20 + y, 0), (0, speed, 0)
        unit.step(1, states(k, position, velocity, 0) | {"relative_valid": valid})
    assert unit.get("least_margin")[2] == pytest.approx(0.5 - 0.4, abs=2e-7)
    assert not unit.get("violated").any()


@pytest.mark.verifies("G.2-4")
def test_nothing_is_evaluated_while_the_target_is_lost(fmu):
    unit = fmu("safety_monitor", SPHERE | DEEP)
    for k, (y, valid) in enumerate(((-20.0, 1), (0.0, 0), (20.0, 1), (21.0, 1))):
        unit.step(1, states(k, (0, y, 0), (0, 1, 0), 0) | {"relative_valid": valid})
    assert not unit.get("violated").any()


@pytest.mark.verifies("G.2-5")
def test_nothing_is_evaluated_before_the_monitor_is_armed(fmu):
    """A cold filter: within the zone, too fast and not valid until 6 s, outside and slow after."""
    p = SPHERE | DEEP | {"use_speed_limit": 1, "speed_slope": 0, "lost_time": 3, "act": 1}
    found = []
    for t_armed in (0, 5.5, 6):
        unit = fmu("safety_monitor", p | {"t_armed": t_armed, "passive_time": 100})
        for k in range(12):
            y, speed = (1.0, 2.0) if k < 6 else (20.0, 0.01)
            u = states(k, (0, y, 0), (0, speed, 0), 0) | {"F_cmd_S": (1, k, 0)}
            unit.step(1, u | {"relative_valid": k in (0, 5, 6, 7)})
            if t_armed and k < 6:
                assert unit.get("keep_out_margin") == unit.get("navigation_margin") == RESTING
            if t_armed and k < 10:
                assert unit.get("F_safe_S").tolist() == [1, k, 0]
        found.append(unit.get("t_first").tolist())
    assert found[0][:4] == [0, NOT_YET, 0, 0]
    assert found[1] == found[2] == [NOT_YET] * 5 + [10.0, NOT_YET]


def test_time_without_a_state_counts_from_when_the_monitor_is_armed(fmu):
    unit = fmu("safety_monitor", OFF | {"lost_time": 3, "t_armed": 5.5})
    for k in range(10):
        unit.step(1, states(k, (0, 20, 0), (0, 0, 0)) | {"relative_valid": k == 0})
    assert unit.get("t_first")[5] == 8.5


def test_zero_range_violates_the_zone_and_lies_on_the_edge_of_the_cones(fmu):
    p = SPHERE | {"use_corridor": 1, "use_plume": 1, "use_speed_limit": 1, "passive_time": 100}
    unit = fmu("safety_monitor", p | {"act": 1})
    unit.step(1, states(0, np.zeros(3), np.zeros(3)) | {"F_cmd_S": (1, 0, 0)})
    assert abs(unit.get("keep_out_margin") + 3) < 1e-8
    assert abs(unit.get("passive_margin") + 3) < 1e-3
    assert abs(unit.get("corridor_margin")) < 1e-8
    assert abs(unit.get("plume_margin")) < 1e-8
    assert unit.get("violated")[:4].tolist() == [1, 0, 0, 1]
    assert unit.get("passive_entry") == 0
    assert np.all(np.isfinite(np.concatenate([np.ravel(v) for v in unit.outputs().values()])))


@pytest.mark.filterwarnings("ignore")
def test_a_number_that_is_none_is_rejected_and_the_monitor_continues(fmu):
    unit = fmu("safety_monitor", SPHERE | DEEP)
    good = states(0, (0, 20, 0), (0, 0, 0), 0)
    unit.step(1, good)
    with pytest.raises(FMICallException):
        unit.set({"r_SN_N": (np.nan, 0, 0)})
    unit.step(1, good)
    assert unit.get("keep_out_margin") == 17


@pytest.mark.parametrize(
    ("size", "rate", "h"), [(1e6, 1e6, 1), (1e12, 1e12, 1), (1e20, 1e20, 1), (1, 1e15, 1e-6)]
)
def test_evaluating_absurd_but_finite_inputs_ends(fmu, rng, size, rate, h):
    """Rounding of such numbers is far coarser than 1e-7 m: halving has to end all the same."""
    p = SPHERE | DEEP | {"use_corridor": 1, "use_speed_limit": 1, "use_plume": 1}
    unit = fmu("safety_monitor", p)
    for k in range(20):
        inputs = states(k, rng.normal(size=3) * size, rng.normal(size=3) * rate, 0)
        unit.step(h, inputs | {"F_cmd_S": rng.normal(size=3)})
        assert all(np.all(np.isfinite(value)) for value in unit.outputs().values())


# ---- first violation, abort ----


@pytest.mark.verifies("G.2-1")
def test_first_violation_stays_and_names_the_rule(fmu):
    p = SPHERE | DEEP | {"use_speed_limit": 1, "speed_at_zero": 0.5, "speed_slope": 0}
    unit, rows = watch(fmu, p, straight((-20, 0, 0), (0.8, 0, 0)), 1, 60)
    assert unit.get("t_first").tolist()[2] == 0
    assert abs(unit.get("t_first")[0] - 17 / 0.8) < 1e-9
    assert unit.get("rule_violated") == 3
    assert unit.get("t_violation") == 0
    assert np.all(np.diff(column(rows, "abort")) >= 0)
    assert unit.get("keep_out_margin") > 0  # it has passed; the memory stays
    assert unit.get("violated").tolist() == [1, 0, 1, 0, 0, 0, 0]


@pytest.mark.verifies("G.5-1")
def test_only_chosen_rules_abort(fmu):
    p = SPHERE | DEEP | {"abort_on": (0, 1, 1, 1, 1, 1, 1)}
    unit, _ = watch(fmu, p, straight((-20, 0, 0), (0.8, 0, 0)), 1, 40)
    assert unit.get("violated")[0] == 1
    assert unit.get("abort") == 0


@pytest.mark.verifies("G.5-3")
@pytest.mark.parametrize("period", [0, 0.5])
@pytest.mark.parametrize(
    ("dv_H", "axes"), [((0.02, -0.03, 0.01), 0), ((0, 0, 0), 0), ((0, 0, 0), 1)]
)
def test_abort_manoeuvre_spends_the_velocity_increment_and_no_more(fmu, dv_H, axes, period):
    T, S = (
        (Rotation.from_euler("xyz", (0.3, -0.5, 1)), np.zeros(3)),
        (Rotation.from_euler("zyx", (1, 0.2, 2)), np.zeros(3)),
    )
    axis = np.array((0.6, 0, 0.8))
    p = SPHERE | {"act": 1, "mass": 80, "abort_force": 3, "abort_dv_H": dv_H, "abort_speed": 0.07}
    p |= {"corridor_axis": axis, "corridor_axes": axes, "sample_period": period}
    p |= {"abort_relative": 0}
    unit, impulse, F_cmd = fmu("safety_monitor", p), np.zeros(3), np.array((1.0, 2.0, -1.0))
    for k in range(30):
        y = 20.0 if k < 5 else 1.0
        unit.step(0.5, states(0.5 * k, (0, y, 0), (0, 0, 0), T=T, S=S) | {"F_cmd_S": F_cmd})
        F = unit.get("F_safe_S")
        if k < 5:
            assert F.tolist() == F_cmd.tolist()
            continue
        assert np.linalg.norm(F) < 3 + 1e-12
        impulse += 0.5 * S[0].as_matrix() @ F
    C_NH = hill(2.5)[0]
    out = (T[0].as_matrix() if axes else C_NH) @ (0.07 * axis)
    expected = C_NH @ dv_H if np.any(dv_H) else out
    assert np.max(np.abs(impulse / 80 - expected)) < 1e-12
    assert np.linalg.norm(unit.get("dv_left_N")) < 1e-12


@pytest.mark.verifies("G.5-4")
def test_the_command_passes_between_the_samples_too_and_ends_with_the_abort(fmu):
    unit = fmu("safety_monitor", SPHERE | {"sample_period": 1, "act": 1, "abort_force": 0})
    for k in range(16):
        y = 20.0 if k < 8 else 1.0
        F = (1.0, k, -k)
        unit.step(0.25, states(0.25 * k, (0, y, 0), (0, 0, 0)) | {"F_cmd_S": F})
        assert unit.get("F_safe_S").tolist() == ([1, k, -k] if k < 8 else [0, 0, 0])


@pytest.mark.verifies("G.2-3")
@pytest.mark.parametrize("period", [0, 5])
def test_drift_is_predicted_at_its_own_period(fmu, period):
    """Straight flight in deep space with a velocity that turns towards the zone."""
    unit = fmu("safety_monitor", DRIFT | DEEP | {"passive_period": period})
    margins = []
    for k in range(12):
        drho = (0.1, -0.002 * k, 0)
        unit.step(1, states(k, (-20 + 0.1 * k, 8, 0), drho, 0))
        margins.append(unit.get("passive_margin"))
    changes = 1 + np.flatnonzero(np.diff(margins))
    assert changes.tolist() == (list(range(1, 12)) if period == 0 else [5, 10])


def test_drift_may_rest_while_approaching_and_is_evaluated_from_then_on(fmu):
    """Straight flight towards the zone: the rule rests from 2 s to 5 s, and the violation begins
    with the first sample at which it is evaluated again; nothing is remembered from before.
    """
    simulated = {}
    for opens in (0, 1):
        unit = fmu("safety_monitor", DRIFT | DEEP | {"passive_opens": opens, "passive_period": 4})
        shown = []
        for k in range(9):
            drho = (0.1, 0, 0) if k > 2 else (0, 0.1, 0)
            here = states(k, (-20 + 0.1 * k, 0, 0), drho, 0)
            unit.step(1, here | {"approaching": 2 <= k < 6})
            shown.append((unit.get("passive_margin"), unit.get("passive_entry")))
        simulated[opens] = shown, unit.get("t_first")[3], unit.get("least_margin")[3]
    shown, first, least = simulated[1]
    assert shown[:2] == simulated[0][0][:2] == [(shown[0][0], NOT_YET)] * 2
    assert shown[2:6] == [(1e9, NOT_YET)] * 4
    assert first == 6 and least == shown[6][0] == pytest.approx(-3)
    assert shown[6][1] == pytest.approx((19.4 - 3) / 0.1)
    assert 2 < simulated[0][1] <= 4 and simulated[0][0][4][0] == pytest.approx(-3)


@pytest.mark.verifies("G.5-4")
def test_without_act_the_command_passes_unchanged(fmu):
    unit = fmu("safety_monitor", SPHERE)
    unit.step(1, states(0, (0, 1, 0), (0, 0, 0)) | {"F_cmd_S": (1, 2, 3)})
    assert unit.get("abort") == 1
    assert unit.get("F_safe_S").tolist() == [1, 2, 3]


# ---- as software ----


def test_result_does_not_depend_on_how_the_step_is_cut(fmu):
    p = SPHERE | {"sample_period": 1, "passive_time": 500, "use_corridor": 1, "act": 1}
    whole, cut = fmu("safety_monitor", p), fmu("safety_monitor", p)
    for k in range(10):
        u = states(k, (0, 8 - k, 0.3), (0, -1, 0))
        whole.step(1, u)
        for _ in range(4):
            cut.step(0.25, u)
        assert bits(cut) == bits(whole)


@pytest.mark.verifies("G.5-5")
def test_nothing_is_retained_from_the_initialization(fmu):
    unit = fmu("safety_monitor", SPHERE, states(0, (0, 1, 0), (0, 0, 0)))
    assert unit.get("keep_out_margin") < 0
    assert not unit.get("violated").any()
    assert unit.get("abort") == 0
    unit.step(1, states(0, (0, 20, 0), (0, 0, 0)))
    assert not unit.get("violated").any()


@pytest.mark.verifies("G.2-7")
@pytest.mark.parametrize(
    ("parameters", "name"),
    [
        ({"keep_out_shape": 3}, "keep_out_shape"),
        ({"corridor_axis": (0, 0, 0)}, "corridor_axis"),
        ({"corridor_half_angle": 1.6}, "corridor_half_angle"),
        ({"plume_half_angle": 2}, "plume_half_angle"),
        ({"keep_out_shape": 0, "passive_time": 10}, "passive_time"),
        ({"passive_time": 1e4, "passive_step": 1e-3}, "passive_step"),
        ({"keep_out_half": (1, 0, 1)}, "keep_out_half"),
    ],
)
def test_bad_parameters_are_rejected(tmp_path, parameters, name):
    assert name in rejection("safety_monitor", parameters, tmp_path)
