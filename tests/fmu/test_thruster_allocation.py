# SPDX-License-Identifier: BSD-2-Clause
"""thruster_allocation.fmu: throttles against scipy's solvers on random geometries, scaling,
pulses.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog, lsq_linear

from .cases import random_direction
from .rejections import rejection

T0 = 0.1
DAMPING = 1e-5  # sqrt(eps) of the model's definition
N = 16


def box_of_thrusters():
    """Four thrusters along +x and -x each, two along each other direction: all six degrees of
    freedom.
    """
    rows = [
        ((-0.5 * s, y, z), (s, 0, 0)) for s in (1, -1) for y in (0.5, -0.5) for z in (0.5, -0.5)
    ]
    rows += [((x, -0.5 * s, 0), (0, s, 0)) for s in (1, -1) for x in (0.5, -0.5)]
    rows += [((0, y, -0.5 * s), (0, 0, s)) for s in (1, -1) for y in (0.5, -0.5)]
    position, direction = zip(*rows, strict=True)
    return geometry(position, direction, np.ones(N))


def geometry(position, direction, nominal, centre=(0, 0, 0)):
    return {
        "thruster_position": np.array(position, dtype=float),
        "thruster_direction": np.array(direction, dtype=float),
        "thrust_nominal": np.array(nominal, dtype=float),
        "centre_of_mass": np.array(centre, dtype=float),
    }


def random_geometry(rng):
    """Strengths over a decade and a half, centre of mass off the origin."""
    direction = [random_direction(rng) for _ in range(N)]
    return geometry(
        rng.uniform(-1, 1, (N, 3)),
        direction,
        10 ** rng.uniform(-1, 0.5, N),
        0.1 * rng.normal(size=3),
    )


def effect(g):
    """6 x 16: force and torque of the thrusters at full thrust."""
    force = g["thrust_nominal"][:, None] * g["thruster_direction"]
    return np.vstack([force.T, np.cross(g["thruster_position"] - g["centre_of_mass"], force).T])


def command(w):
    return {"F_cmd_S": w[:3], "M_cmd_S": w[3:]}


def allocated(unit):
    return np.concatenate([unit.get("F_alloc_S"), unit.get("M_alloc_S")])


def damped(A):
    return np.vstack([A, DAMPING * np.diag(np.linalg.norm(A, axis=0))])


def bounded_least_squares(B, w):
    """min |B x - w|, 0 <= x <= 1; in units in which |w| = 1, because scipy's tolerance is
    absolute.
    """
    c = np.linalg.norm(w)
    b = np.concatenate([w / c, np.zeros(len(B) - len(w))])
    return c * lsq_linear(B, b, (0, 1 / c), method="bvls", tol=1e-16, max_iter=500).x


def largest_scale(A, w):
    """max s <= 1 with A x = s w, 0 <= x <= 1."""
    return linprog(
        [*np.zeros(N), -1], A_eq=np.c_[A, -w], b_eq=np.zeros(6), bounds=[(0, 1)] * (N + 1)
    ).x[N]


# ---- bounded least squares


@pytest.mark.verifies("B.7-1")
def test_throttles_are_the_bounded_least_squares_solution(fmu, rng):
    """Commands from far inside to ten times outside the attainable wrenches, random weights."""
    for _ in range(5):
        g, weight = random_geometry(rng), 10 ** rng.uniform(-1, 1, 6)
        weights = {"weight_F": weight[:3], "weight_M": weight[3:], "keep_direction": 0}
        unit, A = fmu("thruster_allocation", g | weights), weight[:, None] * effect(g)
        for _ in range(20):
            w = A @ rng.uniform(0, 1, N) * 10 ** rng.uniform(-3, 1)
            unit.step(T0, command(w / weight))
            assert unit.get("throttle") == pytest.approx(
                bounded_least_squares(damped(A), w), abs=1e-8
            )


def test_a_command_in_reach_is_met(fmu, rng):
    g = random_geometry(rng)
    unit, A = fmu("thruster_allocation", g), effect(g)
    for _ in range(30):
        w = A @ rng.uniform(0, 1, N) * rng.uniform(0.001, 1)
        unit.step(T0, command(w))
        assert allocated(unit) == pytest.approx(w, abs=1e-6 * np.linalg.norm(w))
        assert A @ unit.get("throttle") == pytest.approx(allocated(unit), abs=1e-12)
        assert (unit.get("infeasible"), unit.get("scale")) == (0, 1)


@pytest.mark.verifies("B.7-3")
def test_lost_thrusters_are_left_out_from_the_time_on(fmu, rng):
    """The bits of an allocation with thrusters without thrust; before that the bits of a whole
    one.
    """
    g, lost = box_of_thrusters(), np.arange(N) % 2
    half = g | {"thrust_nominal": g["thrust_nominal"] * (1 - lost)}
    units = [fmu("thruster_allocation", g | {"lost": lost, "lost_from": 2 * T0})]
    units += [fmu("thruster_allocation", other) for other in (g, half)]
    for k in range(4):
        w = command(effect(g) @ rng.uniform(0, 0.1, N))
        for unit in units:
            unit.step(T0, w)
        there, other = units[0], units[1 + (k >= 2)]
        for name in ("throttle", "F_alloc_S", "M_alloc_S", "scale", "infeasible"):
            assert np.array_equal(there.get(name), other.get(name)), (k, name)
    assert not units[0].get("throttle")[lost == 1].any()


@pytest.mark.verifies("B.7-2")
def test_a_command_out_of_reach_is_scaled_to_the_largest_part_in_reach(fmu, rng):
    """Against a linear program; "in reach" means within 1e-6 of the command, and the facet may be
    oblique: 1e-5.
    """
    for g in (box_of_thrusters(), random_geometry(rng), random_geometry(rng)):
        unit, A = fmu("thruster_allocation", g), effect(g)
        for _ in range(15):
            w = rng.normal(size=6) * 10 ** rng.uniform(0, 1.5)
            unit.step(T0, command(w))
            s = largest_scale(A, w)
            assert unit.get("scale") == pytest.approx(s, abs=1e-5)
            assert allocated(unit) == pytest.approx(s * w, abs=1e-5 * np.linalg.norm(w))
            assert unit.get("infeasible") == (s < 1 - 1e-6)


def test_command_that_no_thruster_can_serve_gives_nothing(fmu):
    """The eight attitude thrusters of the paper have no pure force along Y: P1 and P3 also turn the
    vehicle.
    """
    unit = fmu("thruster_allocation", {"thrust_nominal": [0.5] * 8 + [0] * 8})
    unit.step(T0, command(np.array([0, 0.1, 0, 0, 0, 0])))
    assert unit.get("throttle") == pytest.approx(np.zeros(N), abs=1e-9)
    assert unit.get("scale") == pytest.approx(0, abs=1e-9)
    assert unit.get("infeasible") == 1


@pytest.mark.parametrize("size", [1e-9, 1e-4, 1e3, 1e8])
def test_reachable_commands_do_not_depend_on_the_unit_of_force(fmu, size):
    """Thrusters and command `size` times as strong."""
    strong = box_of_thrusters()
    strong["thrust_nominal"] = size * strong["thrust_nominal"]
    wrench = size * np.array([0.5, -0.2, 0.3, 0.1, -0.05, 0.2])
    for direction in (0, 1):
        unit = fmu("thruster_allocation", strong | {"keep_direction": direction}, command(wrench))
        unit.step(T0)
        assert (unit.get("infeasible"), unit.get("scale")) == (0, 1)
        assert allocated(unit) == pytest.approx(wrench, abs=1e-6 * size)
        unit.step(T0, command(20 * wrench))
        assert unit.get("infeasible") == 1


def test_weights_of_0_free_an_axis(fmu):
    """With torque about Z free, P3 alone gives the force along Y."""
    unit = fmu(
        "thruster_allocation", {"thrust_nominal": [0.5] * 8 + [0] * 8, "weight_M": (1, 1, 0)}
    )
    unit.step(T0, command(np.array([0, 0.1, 0, 0, 0, 0])))
    assert unit.get("throttle")[2] == pytest.approx(0.2, abs=1e-6)
    assert unit.get("infeasible") == 0


def test_no_command_no_throttle(fmu, rng):
    unit = fmu("thruster_allocation", random_geometry(rng))
    unit.step(T0, command(np.zeros(6)))
    assert unit.get("throttle").tolist() == [0] * N
    assert (unit.get("infeasible"), unit.get("scale")) == (0, 1)


def test_force_along_an_axis_is_shared_and_no_thruster_opposes_it(fmu):
    """Four thrusters along +x, the two pairs along y and z off."""
    unit = fmu("thruster_allocation", box_of_thrusters())
    unit.step(T0, command(np.array([2.0, 0, 0, 0, 0, 0])))
    assert unit.get("throttle") == pytest.approx([0.5] * 4 + [0] * 12, abs=1e-9)


@pytest.mark.verifies("B.7-5")
def test_opposite_thrusters_are_never_both_on(fmu, rng):
    """Thrusters in pairs with the same line of action: what both give could be taken from both."""
    position = np.repeat(rng.uniform(-1, 1, (8, 3)), 2, axis=0)
    direction = np.array(
        [s * d for d in (random_direction(rng) for _ in range(8)) for s in (1, -1)]
    )
    unit = fmu("thruster_allocation", geometry(position, direction, np.ones(N)))
    for _ in range(30):
        unit.step(T0, command(rng.normal(size=6)))
        pairs = unit.get("throttle").reshape(8, 2)
        assert np.all(pairs.min(axis=1) == 0)


def test_throttles_are_continuous_in_the_command(fmu, rng):
    """Along a straight line, partly out of reach: the largest of 1000 steps, cut into 200, falls
    into small ones.
    """
    g = random_geometry(rng)
    unit, A = fmu("thruster_allocation", g), effect(g)
    a, b = A @ rng.uniform(0, 1, N), A @ rng.uniform(-1, 2, N)

    def jumps(where):
        rows = []
        for s in where:
            unit.step(T0, command(a + s * (b - a)))
            rows.append(unit.get("throttle"))
        return np.abs(np.diff(rows, axis=0)).max(axis=1)

    line = np.linspace(0, 1, 1001)
    coarse = jumps(line)
    widest = coarse.argmax()
    assert jumps(np.linspace(line[widest], line[widest + 1], 201)).max() < 0.1 * coarse[widest]


def test_order_of_the_thrusters_does_not_matter(fmu, rng):
    g, order = random_geometry(rng), rng.permutation(N)
    shuffled = {name: value[order] if len(value) == N else value for name, value in g.items()}
    one, other = fmu("thruster_allocation", g), fmu("thruster_allocation", shuffled)
    for _ in range(10):
        w = effect(g) @ rng.uniform(-0.3, 1, N)
        for unit in (one, other):
            unit.step(T0, command(w))
        assert one.get("throttle")[order] == pytest.approx(other.get("throttle"), abs=1e-8)


@pytest.mark.verifies("B.7-1")
def test_hostile_geometries_end_in_bounds(fmu, rng):
    """Parallel columns, columns nearly dependent, thrusters that do not exist, strengths over six
    decades.
    """
    for _ in range(10):
        g = random_geometry(rng)
        g["thruster_direction"][:8] = g["thruster_direction"][0]
        g["thruster_position"][:8] = g["thruster_position"][0] + 1e-7 * rng.normal(size=(8, 3))
        g["thrust_nominal"] = 10 ** rng.uniform(-3, 3, N) * (rng.random(N) < 0.8)
        unit = fmu("thruster_allocation", g)
        for _ in range(10):
            unit.step(T0, command(rng.normal(size=6) * 10 ** rng.uniform(-6, 6)))
            assert np.all((unit.get("throttle") >= 0) & (unit.get("throttle") <= 1))


# ---- pulses

PULSES = {"pulsed": 1, "pulse_period": 1.0, "min_on_time": 0.2, "sample_period": T0}


@pytest.mark.verifies("B.7-4")
def test_on_time_follows_the_demand_with_what_is_unspent_carried_over(fmu, rng):
    """At every end of a period: demanded minus given on-time is what is unspent, below the shortest
    pulse.
    """
    unit = fmu("thruster_allocation", box_of_thrusters() | PULSES)
    demanded = given = np.zeros(N)
    for _ in range(60):
        w = rng.normal(size=6) * [0.5, 0.3, 0.3, 0.1, 0.1, 0.1]
        for k in range(10):
            unit.step(T0, command(w))
            demanded = demanded + (unit.get("demand") if k == 0 else 0)
            given = given + T0 * unit.get("throttle")
        assert unit.get("unspent") == pytest.approx(demanded - given, abs=1e-9)
        assert np.all((unit.get("unspent") >= 0) & (unit.get("unspent") < 0.2))


@pytest.mark.verifies("B.7-4")
@pytest.mark.parametrize("shortest", [0, 1, 2, 4])
def test_pulses_are_at_the_start_of_the_period_and_are_not_too_short(fmu, rng, shortest):
    unit = fmu("thruster_allocation", box_of_thrusters() | PULSES | {"min_on_time": shortest * T0})
    for _ in range(40):
        w, rows = rng.normal(size=6) * 0.3, []
        for _ in range(10):
            unit.step(T0, command(w))
            rows.append(unit.get("throttle"))
        lengths = np.sum(rows, axis=0)
        assert np.array_equal(rows, np.arange(10)[:, None] < lengths)
        assert set(lengths) <= {0, *range(max(shortest, 1), 11)}


def test_full_thrust_fills_the_first_period(fmu):
    """A command out of reach requests the full thrust of a thruster but rounding; nothing is left
    to be given later.
    """
    unit = fmu("thruster_allocation", {"pulsed": 1, "pulse_period": 1.0})
    on = []
    for k in range(30):
        unit.step(T0, command(np.array([500 if k < 20 else 0, 0, 0, 0, 0, 0])))
        on.append(unit.get("throttle")[12])
    assert on == [1] * 20 + [0] * 10


def test_small_demand_is_saved_up_for_a_pulse_now_and_then(fmu):
    """Throttle 0.05: 0.05 s per period, so a pulse of 0.2 s in every fourth one."""
    unit = fmu("thruster_allocation", box_of_thrusters() | PULSES)
    lengths = []
    for _ in range(12):
        total = 0.0
        for _ in range(10):
            unit.step(T0, command(np.array([0.2, 0, 0, 0, 0, 0])))
            total += unit.get("throttle")[0]
        lengths.append(total)
    assert lengths == [0, 0, 0, 2] * 3


def test_the_command_of_the_first_sample_of_a_period_rules_it(fmu):
    unit = fmu("thruster_allocation", box_of_thrusters() | PULSES)
    for k in range(10):
        unit.step(T0, command(np.array([2.0 if k == 0 else -4.0, 0, 0, 0, 0, 0])))
        assert unit.get("throttle")[0] == (k < 5)
        assert unit.get("throttle")[4] == 0


@pytest.mark.parametrize("pulsed", [0, 1])
def test_samples_do_not_depend_on_how_finely_a_master_steps(fmu, rng, pulsed):
    coarse, fine = (
        fmu("thruster_allocation", box_of_thrusters() | PULSES | {"pulsed": pulsed})
        for _ in range(2)
    )
    for k in range(50):
        inputs = command(rng.normal(size=6) * 0.3)
        coarse.step(T0, inputs)
        fine.set(inputs)
        for j in range(4):
            fine.slave.doStep((k + j / 4) * T0, T0 / 4)
        assert all(np.array_equal(coarse.get(name), fine.get(name)) for name in coarse.kind.outputs)


def test_first_outputs_leave_no_memory(fmu):
    """0.15 s of demand wait for the shortest pulse; were the start counted too, 0.3 s would not."""
    w = command(np.array([0.6, 0, 0, 0, 0, 0]))
    unit = fmu("thruster_allocation", box_of_thrusters() | PULSES, w)
    assert unit.get("unspent")[0] == pytest.approx(0.15, abs=1e-9)
    unit.step(T0, w)
    assert unit.get("unspent")[0] == pytest.approx(0.15, abs=1e-9)
    assert unit.get("throttle")[0] == 0


# ---- rejections


@pytest.mark.verifies("B.7-6")
@pytest.mark.parametrize(
    ("parameters", "rule"),
    [
        (
            {"thruster_direction": [[2, 0, 0]] * N},
            "|thruster_direction[1]| = 2: must be a unit vector",
        ),
        ({"thrust_nominal": [-1] * N}, "thrust_nominal[1] = -1: must be >= 0"),
        ({"weight_F": (1, -1, 1)}, "weight_F[2] = -1: must be >= 0"),
        ({"pulse_period": 0}, "pulse_period = 0: must be > 0"),
        (PULSES | {"sample_period": 0}, "sample_period = 0: must be > 0 with pulses"),
        (
            PULSES | {"pulse_period": 0.25},
            "pulse_period = 0.25: must be a multiple of sample_period",
        ),
        (PULSES | {"min_on_time": 1.1}, "min_on_time = 1.1: must not be above pulse_period"),
    ],
)
def test_bad_parameters_are_rejected_with_the_rule(tmp_path, parameters, rule):
    assert rule in rejection("thruster_allocation", parameters, tmp_path)
