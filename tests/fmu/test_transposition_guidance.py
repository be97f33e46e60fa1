# SPDX-License-Identifier: BSD-2-Clause
"""transposition_guidance.fmu: limits of the plan, momentum balance along it by point masses, the
patent's scheme, what cannot be done.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.integrate import simpson

from tests.compliance.probe import Fmu, Instance

from ..reference import assembly as point_masses
from ..reference import transposition as reference
from ..reference.attitude import multiply
from .assembly_cases import C_HO, N_ORBIT, Q_FLIGHT, Assembly, C_SO_of, quintic
from .driver import archive
from .rejections import rejection

FULL = {"nodes": 90}
NAMES = ("q_DH", "omega_DN_D", "alpha_DN_D", "h_ref_D", "dh_ref_D", "rotation_ref", "eps_ref")


@pytest.fixture(scope="module")
def simulated(kind):
    """simulated(step, parameters): times and the reference at them."""
    from .driver import Unit

    @cache
    def history(h, parameters=()):
        unit = Unit(
            kind("transposition_guidance"), FULL | {"sample_period": h, **dict(parameters)}, {}, 0.0
        )
        unit.step(h)  # publishes the sample at t = 0
        rows = []
        for k in range(round(5400 / h)):
            rows.append([k * h, *map(unit.get, NAMES)])
            unit.step(h)
        unit.close()
        return dict(zip(("t", *NAMES), map(np.array, zip(*rows, strict=True)), strict=True))

    return history


def C_NO(t):
    """Orbital axes to N, the axes of H at t = 0."""
    c, s = np.cos(N_ORBIT * t), np.sin(N_ORBIT * t)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ C_HO


# ---- the plan


@pytest.mark.verifies("E.4-1")
def test_plan_stays_below_its_limits_in_a_handful_of_steps(fmu, simulated):
    unit, plan = fmu("transposition_guidance", FULL), simulated(5.0)
    assert unit.get("status") == 0
    assert unit.get("no_plan") == 0
    assert 1 <= unit.get("iterations") <= 6
    assert unit.get("momentum_max") < 0.9 * 1500
    assert np.degrees(unit.get("rotation_largest")) < 35
    h = np.linalg.norm(plan["h_ref_D"], axis=1)
    assert h.max() == pytest.approx(unit.get("momentum_max"), rel=1e-3)
    assert plan["rotation_ref"].max() == pytest.approx(unit.get("rotation_largest"), rel=1e-3)


def test_history_of_the_iteration_ends_with_the_plan(fmu):
    unit = fmu("transposition_guidance", FULL)
    n = int(unit.get("iterations"))
    peak, rotation = unit.get("peak"), unit.get("rotation")
    assert np.all(np.diff(peak[: n + 1]) < 0)
    assert peak[0] > 2 * 1500  # Earth pointing
    assert peak[n] < 0.9 * 1500 <= peak[n - 1]
    assert not peak[n + 1 :].any()
    assert rotation[0] == 0
    assert rotation[n] == pytest.approx(unit.get("rotation_largest"), rel=1e-9)
    # the trapezoidal rule of the iteration against the finer one of the prediction
    assert peak[n] == pytest.approx(unit.get("momentum_max"), abs=0.2)


@pytest.mark.verifies("E.4-2")
def test_reference_begins_and_ends_in_the_run_attitude_at_rest(fmu):
    unit = fmu("transposition_guidance", FULL | {"sample_period": 1.0})
    assert unit.get("q_DH") == pytest.approx(Q_FLIGHT, abs=1e-15)
    assert unit.get("omega_DN_D") == pytest.approx([0, -N_ORBIT, 0], abs=1e-15)
    assert not unit.get("h_ref_D").any()
    unit.step(5400.0)  # the last sample is that at 5399 s
    assert unit.get("q_DH") == pytest.approx(Q_FLIGHT, abs=1e-6)
    unit.step(10.0)
    assert unit.get("q_DH") == pytest.approx(Q_FLIGHT, abs=1e-15)
    assert unit.get("omega_DN_D") == pytest.approx([0, -N_ORBIT, 0], abs=1e-15)


def test_the_finest_grid_ends_in_the_run_attitude_too(fmu):
    """Its last node is the last that fits; a millisecond before the end."""
    unit = fmu("transposition_guidance", {"nodes": 120})
    unit.step(5400.0 - 1e-3)
    unit.step(1e-4)
    assert unit.get("status") == 0
    assert np.abs(unit.get("eps_ref")).max() < 1e-10


def test_weights_on_the_peak_and_other_grids_reach_the_limit_too(fmu):
    for change in ({"weight": 2}, {"nodes": 45}, {"nodes": 120}, {"lambda": 3e19}):
        unit = fmu("transposition_guidance", FULL | change)
        assert unit.get("status") == 0, change
        assert unit.get("momentum_max") < 1355, change


def test_a_small_step_takes_its_part_of_the_momentum_with_a_small_rotation(fmu):
    """With the true Jacobian and hardly any smoothing the momentum falls by alpha per step, but for
    what no attitude can change; with a wrong one the attitude runs away.
    """
    step = {"alpha": 0.02, "iterations_max": 2, "lambda": 1e15}
    unit = fmu("transposition_guidance", FULL | step)
    peak, rotation = unit.get("peak"), unit.get("rotation")
    assert 1 - peak[1] / peak[0] == pytest.approx(0.02, rel=0.05)
    assert 1 - peak[2] / peak[1] == pytest.approx(0.02, rel=0.05)
    assert np.degrees(rotation[2]) < 1.5


def test_a_step_beyond_any_attitude_counts_as_half_a_turn_and_ends_the_plan(fmu):
    """A vector part longer than 1 belongs to no quaternion."""
    unit = fmu("transposition_guidance", {"nodes": 24, "alpha": 50.0, "sample_period": 225})
    assert unit.get("rotation")[:2] == pytest.approx([0, np.pi])
    assert (unit.get("status"), unit.get("no_plan"), unit.get("iterations")) == (3, 1, 1)


@pytest.mark.verifies("E.4-3")
def test_momentum_at_the_start_is_part_of_the_plan(fmu):
    unit = fmu("transposition_guidance", FULL | {"h_0_S": (0, 400, 0), "sample_period": 1.0})
    assert unit.get("status") == 0
    assert unit.get("h_ref_D") == pytest.approx([0, 400, 0])
    assert unit.get("peak")[0] != fmu("transposition_guidance", FULL).get("peak")[0]


# ---- the plan of the point masses


def tried(unit):
    """Peak and rotation of every history that the iteration has tried."""
    count = int(unit.get("iterations")) + 1
    return unit.get("peak")[:count], unit.get("rotation")[:count]


def nodes_of(unit):
    """The reference at the nodes."""
    dt = unit.get("window") / unit.get("nodes")
    unit.step(unit.time + 1e-3 * dt)
    rows = []
    for _ in range(round(unit.get("nodes"))):
        rows.append(unit.get("eps_ref"))
        unit.step(dt)
    return np.array([*rows, unit.get("eps_ref")])


@pytest.mark.parametrize("weight", [0, 2])
def test_without_air_the_plan_matches_the_point_masses(fmu, weight):
    """The drag of a box has edges in the attitude, where finite differences depend on the step."""
    changes = {"rho": 0, "nodes": 24, "weight": weight, "h_0_S": (0, 300, 100)}
    unit = fmu("transposition_guidance", changes | {"sample_period": 225})
    planning = reference.Planning(intervals=24, weight_power=weight)
    without = replace(point_masses.Assembly(), rho=0.0)
    plan = reference.Planner(without, planning, h_0=(0, 300, 100)).plan()
    peaks, rotations = tried(unit)
    assert unit.get("status") == 0
    assert len(peaks) > 1
    assert peaks == pytest.approx(np.array(plan.peaks), rel=1e-8)
    assert rotations == pytest.approx(np.array(plan.rotations), abs=1e-9)
    assert nodes_of(unit) == pytest.approx(plan.nodes, abs=1e-9)


def test_with_air_the_plan_matches_the_point_masses(fmu):
    """Within the ambiguity of finite differences over the edges of the boxes, some 1e-6."""
    unit = fmu("transposition_guidance", {"nodes": 24, "sample_period": 225})
    plan = reference.Planner(p=reference.Planning(intervals=24)).plan()
    assert tried(unit)[0] == pytest.approx(np.array(plan.peaks), rel=1e-5)
    assert nodes_of(unit) == pytest.approx(plan.nodes, abs=1e-6)


@pytest.mark.parametrize("scheme", [1, 2])
def test_the_differences_of_the_patent_match_the_point_masses(fmu, scheme):
    """1: second difference corrected, 2: as printed."""
    few = {"iterations_max": 1, "rotation_max": 3.0, "nodes": 16, "rho": 0}
    unit = fmu("transposition_guidance", few | {"scheme": scheme})
    planning = reference.Planning(intervals=16, largest=1, limit=3.0)
    without = replace(point_masses.Assembly(), rho=0.0)
    patent = reference.PatentPlanner(without, planning, printed=scheme == 2)
    assert tried(unit)[0] == pytest.approx(np.array(patent.plan().peaks), rel=1e-8)


def test_reference_rates_and_momentum_match_the_planned_attitude(simulated):
    """Attitude, its derivatives as of a differentiated matrix, momentum of the gyros by Gauss'
    rule of three points in every second; edges of the boxes in the stream are left to the
    tolerance.
    """
    plan, planner = simulated(1.0), reference.Planner()
    nodes = np.concatenate((plan["eps_ref"][::60], np.zeros((1, 3))))
    rows = slice(None, None, 7)
    motion = reference.reference(N_ORBIT, planner.curve(nodes), plan["t"][rows])
    q = np.array([multiply(Q_FLIGHT, q_SO) for q_SO in motion.q_SO])
    assert plan["q_DH"][rows] == pytest.approx(q * np.sign(q[:, :1]), abs=1e-13)
    assert plan["omega_DN_D"][rows] == pytest.approx(motion.omega, abs=1e-15)
    assert plan["alpha_DN_D"][rows] == pytest.approx(motion.alpha, abs=1e-17)
    h = planner.predicted(nodes)
    assert plan["h_ref_D"] == pytest.approx(h[:-1], abs=2e-5)
    assert plan["dh_ref_D"] == pytest.approx(np.diff(h, axis=0), abs=2e-5)


def test_momentum_is_predicted_by_gauss_rule_of_two_points_on_a_sixteenth_of_the_grid(simulated):
    """Steps between nodes of 60 s, to the last digits; another number of steps would be off by
    1e-7 where edges of the boxes turn into the stream.
    """
    plan, planner = simulated(3.75), reference.Planner()
    nodes = np.concatenate((plan["eps_ref"][::16], np.zeros((1, 3))))
    h = planner.predicted(nodes, period=3.75, points=2)
    assert plan["h_ref_D"] == pytest.approx(h[:-1], abs=1e-9)


def test_a_later_window_has_the_same_plan(fmu):
    """The orbit looks the same everywhere."""
    late = {"window_start": 900, "swing_start": 1500}
    units = [
        fmu("transposition_guidance", {"sample_period": 225} | changes) for changes in ({}, late)
    ]
    assert units[1].get("status") == 0
    for name in ("peak", "rotation", "momentum_max", "rotation_largest"):
        assert units[1].get(name) == pytest.approx(units[0].get(name), rel=1e-9)
    units[0].step(2000.0)
    units[1].step(2900.0)
    for name in NAMES[3:]:
        assert units[1].get(name) == pytest.approx(units[0].get(name), rel=1e-8), name


# ---- the reference


def test_rates_and_accelerations_are_differences_of_the_attitude(simulated):
    """The slope of the acceleration jumps at the nodes, every 60 s."""
    plan, h = simulated(1.0), 1.0
    C_DN = [C_SO_of(q) @ C_NO(t).T for q, t in zip(plan["q_DH"], plan["t"], strict=True)]
    C_DN = np.array(C_DN)
    spin = -np.einsum("kij,klj->kil", C_DN[2:] - C_DN[:-2], C_DN[1:-1]) / (2 * h)
    w = np.array([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]]).T
    assert plan["omega_DN_D"][1:-1] == pytest.approx(w, abs=5e-8)
    dw = (plan["omega_DN_D"][2:] - plan["omega_DN_D"][:-2]) / (2 * h)
    smooth = plan["t"][1:-1] % 60 != 0
    assert plan["alpha_DN_D"][1:-1][smooth] == pytest.approx(dw[smooth], abs=1e-9)
    assert np.abs(plan["omega_DN_D"][:, 0]).max() > 1e-4  # far above the tolerances
    assert np.abs(plan["alpha_DN_D"]).max() > 1e-7


def balance(plan, model, torque, every=1):
    """Largest gap between the change of total momentum and the impulse, over every n-th span of
    60 s.
    """

    def at(k):
        C_SO, arm = C_SO_of(plan["q_DH"][k]), quintic(plan["t"][k])[:2]
        C_NS = C_NO(plan["t"][k]) @ C_SO.T
        carried = model.momentum(plan["omega_DN_D"][k], *arm)
        return C_NS @ (carried + plan["h_ref_D"][k]), C_NS @ torque(C_SO, arm[0])

    at, n, gaps = cache(at), 12, []
    for k in range(0, len(plan["t"]) - n, n * every):
        tau = [at(j)[1] for j in range(k, k + n + 1)]
        gaps.append(at(k + n)[0] - at(k)[0] - simpson(tau, dx=5.0, axis=0))
    return np.linalg.norm(gaps, axis=1).max()


@pytest.mark.verifies("E.4-3")
def test_predicted_momentum_balances_the_torques_on_point_masses(simulated):
    """Tolerance: Simpson's rule across the kinks of faces that turn into the flow."""
    model, plan = Assembly(), simulated(5.0)
    assert balance(plan, model, model.torque) < 0.02


def test_wrong_terms_do_not_balance(simulated):
    model, plan = Assembly(), simulated(5.0)
    prefix = 3 * N_ORBIT**2  # printed before the aerodynamic torque

    def printed_air(C_SO, angle):
        return model.gravity_torque(C_SO, angle) + prefix * model.aero_torque(C_SO, angle)

    assert balance(plan, model, printed_air, every=6) > 0.2
    assert balance(plan, model, model.aero_torque, every=6) > 1
    assert balance(plan, Assembly(hinge=(9.6, 0, 0.1)), model.torque, every=6) > 1


@pytest.mark.verifies("E.4-4")
def test_rate_of_momentum_is_its_mean_over_the_coming_sample(simulated):
    plan = simulated(5.0)
    steps = np.diff(plan["h_ref_D"], axis=0) / 5.0
    assert plan["dh_ref_D"][:-1] == pytest.approx(steps, abs=1e-9)


def test_without_a_sample_period_the_rate_is_the_derivative(fmu):
    unit = fmu("transposition_guidance", FULL)
    unit.step(1000.0)
    rows = []
    for h in (0.5, 0.5, 0.5):
        rows.append((unit.get("h_ref_D"), unit.get("dh_ref_D")))
        unit.step(h)
    # outputs are of the sample at the beginning of the step
    derivative = (rows[2][0] - rows[1][0]) / 0.5
    assert derivative == pytest.approx((rows[1][1] + rows[2][1]) / 2, abs=2e-5)


# ---- the patent's scheme


def test_patents_scheme_with_its_second_difference_corrected_finds_a_plan_but_errs_in_momentum(fmu):
    unit = fmu("transposition_guidance", FULL | {"scheme": 1})
    assert unit.get("status") == 0
    believed = unit.get("peak")[int(unit.get("iterations"))]
    assert believed < 0.9 * 1500
    assert 20 < abs(unit.get("momentum_max") - believed) < 100  # explicit Euler steps of 60 s


def test_second_difference_as_printed_believes_in_a_plan_that_saturates(fmu):
    unit = fmu("transposition_guidance", FULL | {"scheme": 2})
    assert unit.get("peak")[int(unit.get("iterations"))] < 0.9 * 1500
    assert unit.get("momentum_max") > 2 * 1500


# ---- what cannot be done


@pytest.mark.verifies("E.4-1")
@pytest.mark.parametrize(
    ("parameters", "status"),
    [
        ({"H_sat": 500}, 3),
        ({"rotation_max": 0.1}, 3),
        ({"iterations_max": 1}, 2),
        ({"alpha": 1e-6, "iterations_max": 5}, 2),
    ],
)
def test_an_impossible_task_ends_in_the_run_attitude_with_a_status(fmu, parameters, status):
    unit = fmu("transposition_guidance", FULL | parameters | {"sample_period": 1.0})
    assert unit.get("status") == status
    assert unit.get("no_plan") == 1
    assert unit.get("rotation_largest") == 0
    unit.step(2000.0)
    assert unit.get("q_DH") == pytest.approx(Q_FLIGHT, abs=1e-15)
    assert not unit.get("alpha_DN_D").any()


def test_an_impossible_task_is_reported_in_the_log(tmp_path):
    model = Fmu(archive("transposition_guidance"), tmp_path)
    with Instance(model) as instance:
        instance.start(model.settings(nodes=90, rotation_max=0.1))
        texts = [m.text for m in instance.host.messages if m.category == "logStatusWarning"]
    assert len(texts) == 1
    assert "no_plan" in texts[0]
    assert "no planned attitude satisfies the limits" in texts[0]


@pytest.mark.verifies("E.4-5")
def test_flight_attitude_can_be_requested(fmu):
    unit = fmu("transposition_guidance", FULL | {"use_plan": 0})
    assert (unit.get("status"), unit.get("no_plan"), unit.get("iterations")) == (1, 0, 0)
    assert unit.get("momentum_max") > 2 * 1500


@pytest.mark.verifies("E.4-6")
@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"nodes": 7}, "nodes = 7: must be a whole number from 8 to 120"),
        ({"nodes": 90.5}, "nodes = 90.5: must be a whole number from 8 to 120"),
        ({"nodes": 121}, "nodes = 121: must be a whole number from 8 to 120"),
        ({"window": 3599}, "window = 3599: must not end before swing_start + swing_duration"),
        ({"swing_start": -1}, "swing_start = -1: must not be before window_start"),
        ({"H_sat": 0}, "H_sat = 0: must be > 0"),
        ({"H_sat": -5}, "H_sat = -5: must be > 0"),
        ({"m1": 0}, "m1 = 0: must be > 0"),
        ({"J0": np.diag((1, 1, 3))}, "J0 = 3: must satisfy the triangle inequality"),
        ({"momentum_share": 1.1}, "momentum_share = 1.1: must be at most 1"),
        ({"rotation_max": 3.1}, "rotation_max = 3.1: must be at most 3.05 rad"),
        ({"scheme": 3}, "scheme = 3: must be 0, 1 or 2"),
        ({"iterations_max": 31}, "iterations_max = 31: must be a whole number from 0 to 30"),
    ],
)
def test_rejected(tmp_path, parameters, message):
    assert message in rejection("transposition_guidance", parameters, tmp_path)


# ---- cost


def test_an_instance_is_small_though_the_plan_is_large(tmp_path):
    model = Fmu(archive("transposition_guidance"), tmp_path)
    with Instance(model) as instance:
        instance.start(model.settings(nodes=90))
        assert len(instance.serialize(instance.save())) < 32768
