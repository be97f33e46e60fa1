# SPDX-License-Identifier: BSD-2-Clause
"""Bounds of runs: closed forms of the double integrator, invariances, and a run of a system."""

import re
from dataclasses import replace
from pathlib import Path
from textwrap import dedent

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from harness import run
from harness.cli import main
from harness.errors import HarnessError, ResultsError, UsageError
from harness.figures.choice import figures_of
from harness.figures.plots import paint
from harness.mission import Limits
from harness.report.arrays import Arrays
from harness.report.plots import PAGE, painted
from harness.report.run import canvas_of
from harness.results.files import read
from harness.results.requirements import margin
from harness.results.result import Result
from harness.ssp.library import load
from harness.studies.show import bound
from ssp.arch_rendezvous import bound as arch_rendezvous
from ssp.ppc_tracking import bound as ppc_tracking
from ssp.relay_approach import bound as relay_approach
from ssp.servicing_mission import bound as servicing_mission
from ssp.servicing_mission.events import stays
from ssp.shared import bounds, optima
from ssp.shared.convex import Cone, Optimum, Problem, solve, transitions
from ssp.shared.phase_impulses import phase_optimum, phase_verified
from tests.close import close
from tests.reference import optimal_start

pytest.importorskip("cvxpy", reason="cvxpy is not installed")

EYE = np.eye(3)


def fixed(node, end, velocity=False):
    """Position, or velocity, at one node."""
    one, none = EYE[None], np.zeros((1, 3, 3))
    matrices = (none, one) if velocity else (one, none)
    zero = np.zeros((1, 3))
    return Cone("end", np.array([node]), *matrices, -np.array([end]), zero, zero[:, 0])


def double_integrator(n=4, step=10.0, box=0.02, end=(6.0, 1.0, 0.0)):
    """From rest to rest in free space, 1 kg."""
    zero = np.zeros((n, 3))
    axes = np.broadcast_to(EYE, (n, 3, 3))
    ends = fixed(n, end), fixed(n, np.zeros(3), velocity=True)
    time = step * np.arange(n + 1)
    return Problem(time, np.zeros(6), 0 * axes, zero, axes, 1.0, np.full(3, box), ends)


@pytest.mark.parametrize("n", [4, 40])
def test_rest_to_rest_has_the_closed_form(n):
    """Thrust, coast, brake: 6 m = 0.2 m/s (40 - 10) s at the limit, 0.5 m in a step of thrust."""
    step, end = 40.0 / n, (6.0, 0.5, 0.0)
    found = solve(double_integrator(n, step, end=end))
    close(found.impulse, 2 * 0.2 + 2 * 0.5 / (40 - step), rel=1e-6)
    close(found.position[-1], end, rel=1e-6)
    close(found.velocity[-1], np.zeros(3), rel=1e-6, of=1.0)


def test_a_known_acceleration_is_held_against():
    problem = replace(double_integrator(end=(0, 0, 0)), known=np.tile([0, 0, -0.01], (4, 1)))
    found = solve(problem)
    assert found.impulse >= 0.01 * 40 * (1 - 1e-7)
    for cost in ("sum", "norm"):
        close(solve(problem, cost).impulse, 0.01 * 40, rel=1e-6)


def test_turned_axes_change_no_optimum_and_a_larger_box_does_not_raise_it():
    turn = Rotation.from_rotvec([0.3, -0.5, 0.8]).as_matrix()
    given = double_integrator(8, 5.0)
    ends = (fixed(8, turn @ [6, 1, 0]), fixed(8, np.zeros(3), velocity=True))
    turned = replace(given, axes=np.broadcast_to(turn, (8, 3, 3)), cones=ends)
    for cost in ("sum", "norm"):
        close(solve(turned, cost).impulse, solve(given, cost).impulse, rel=1e-6)
    wide = replace(given, box=2 * given.box)
    assert solve(wide).impulse <= solve(given).impulse * (1 + 1e-7)
    assert solve(wide).impulse < solve(given).impulse - 0.01


def test_a_problem_that_nothing_solves_is_an_error():
    with pytest.raises(HarnessError, match="no optimum"):
        solve(double_integrator(box=1e-4))


def test_transitions_are_the_exponential():
    rng = np.random.default_rng(3)
    given = double_integrator(3)
    gradient = 1e-6 * rng.normal(size=(3, 3, 3))
    A, B = transitions(replace(given, gradient=gradient))
    for k in range(3):
        rate = np.zeros((9, 9))
        rate[:3, 3:6], rate[3:6, :3], rate[3:6, 6:] = EYE, gradient[k], EYE
        whole = expm(10.0 * rate)
        close(A[k], whole[:6, :6], rel=1e-13)
        close(B[k], whole[:6, 6:], rel=1e-13)


def test_iterations_of_the_controller_converge_to_the_optimum():
    """The first ten minutes of the synchronised approach, from a cold start."""
    best = solve(optimal_start.problem()).impulse
    spent, broken = zip(*map(optimal_start.iterated, (10, 50, 1000)), strict=True)
    close(spent[-1], best, rel=5e-3)
    assert broken[0] > broken[1] > broken[2]


@pytest.mark.long
@pytest.mark.parametrize("seed", [None, *range(5)])
def test_five_thousand_iterations_are_within_a_thousandth_of_the_optimum(seed):
    """The published start, and drawn ones; 50 iterations leave up to 6 %."""
    begin = optimal_start.PUBLISHED
    if seed is not None:
        begin = optimal_start.drawn(np.random.default_rng(seed))
    best = solve(optimal_start.problem(begin)).impulse
    spent, broken = optimal_start.iterated(5000, begin)
    close(spent, best, rel=1e-3)
    assert broken < 0.02
    assert abs(optimal_start.iterated(50, begin)[0] / best - 1) > 2e-3


@pytest.fixture(scope="module")
def minute():
    """The first minute of the synchronised approach, and its optimum."""
    return bound("sync_approach", params="limited", stop=60.0, grid=3.0)


def test_a_run_costs_more_than_its_optimum_and_the_optimum_can_be_simulated(minute):
    found = minute
    assert found.spent > found.optimum.impulse > 0
    close(found.spent, found.run["propulsion.impulse"][-1].sum(), rel=1e-12)
    verified = found.verified["propulsion.impulse"][-1].sum()
    close(verified, found.optimum.impulse, rel=1e-3)
    assert found.miss < 1e-3
    assert margin(found.verified, "monitor.corridor_margin >= 0 m") > -0.01
    late = [
        np.abs(force[time[1:] > 40] * np.diff(time)[time[1:] > 40, None]).sum()
        for force, time in (
            (found.optimum.force, found.optimum.time),
            (found.run["propulsion.F_S"][1:], found.run.time),
        )
    ]
    expected = "; after 40 s: optimum {:.3g} N s, run {:.3g} N s".format(*late)
    assert next(found.lines()).endswith(expected)


def test_accelerations_of_both_bodies_and_the_manoeuvre_are_in_the_problem():
    given = {
        "servicer.a_dist.bias": [2e-4, 0, 0], "servicer.a_dist.start": 20.0,
        "servicer.a_dist_axes": 0,
        "target.a_dist.amplitude": [0, 3e-4, 0], "target.a_dist.frequency": [0, 0.05, 0],
        "target.a_manoeuvre_N.bias": [0, 0, -1e-4], "target.a_manoeuvre_N.start": 40.0,
    }  # fmt: skip
    time = np.array([10.0, 30.0, 50.0])
    result = run("sync_approach", set=given, stop=1.0)
    found = bounds.disturbance(result, time, np.broadcast_to(np.eye(3), (3, 3, 3)))
    expected = np.column_stack(
        (2e-4 * (time >= 20), -3e-4 * np.sin(0.05 * time), 1e-4 * (time >= 40))
    )
    close(found, expected, rel=1e-12)


def curves(result):
    """Curves of the figure in the report, by plot: [(name, source or None, x, y)]."""
    canvas = canvas_of(result, Arrays())
    found = [figure for figure in figures_of(result) if figure.name == "optimum"]
    with PAGE.used():
        plots = [p for f in found for p in painted(canvas, paint(f, result, PAGE), result)]
    take = canvas.arrays.take
    return [
        [(c["name"], c.get("source"), take(c["x"]), take(c["y"])) for c in plot["curves"]]
        for plot in plots
    ]


def test_the_report_shows_a_stored_optimum_beside_the_run(minute, tmp_path, monkeypatch):
    """Only the curves of the run follow the sliders of a live page, which names the others "of the
    run in the file".
    """
    monkeypatch.chdir(tmp_path)
    assert curves(minute.run) == [] and np.isnan(optima.METRIC(minute.run, Limits()))
    assert minute.store() == optima.OWN and (tmp_path / optima.OWN).is_file()
    close(optima.METRIC(minute.run, Limits()), minute.spent / minute.optimum.impulse, rel=1e-6)
    impulse, range_, position = curves(minute.run)
    for plot, least in ((impulse, "impulse"), (range_, "range"), (position, "position")):
        follows = [source is not None for _, source, _, _ in plot]
        count = 3 if least == "position" else 1
        assert follows == [True] * count + [False] * count
        assert all(name.startswith(("run", "optimum")) for name, *_ in plot)
    time, place = minute.optimum.time, minute.optimum.position
    (_, _, t, y), there = range_[1], [np.linalg.norm(p) for p in place]
    close(np.interp(time, t, y), there, rel=1e-5)
    for k in range(3):
        close(np.interp(time, *position[3 + k][2:]), place[:, k], rel=1e-5, of=20.0)
    close(impulse[1][3][-1], minute.optimum.impulse, rel=1e-5)
    assert impulse[1][3][0] == 0


def test_the_optimum_of_a_phase_begins_with_the_impulse_of_the_run(near, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = np.outer([1, 2, 3], [1.0, 0, 0])
    force = np.array([[0.2, 0, 0], [0, -0.1, 0.1]])
    optima.store(near, [Optimum(np.array([40.0, 45, 50]), path, path, force, 2.0)])
    spent = np.sum(near["propulsion.impulse"], axis=1)
    begin, end = spent[np.searchsorted(near.time, (40.0 - 1e-9, 50.0 - 1e-9))]
    close(optima.METRIC(near, Limits()), (end - begin) / 2.0, rel=1e-9)
    _, _, time, drawn = curves(near)[0][1]
    shown = np.isfinite(drawn)
    assert time[shown].min() >= 40 and time[shown].max() <= 50
    close(drawn[shown][[0, -1]], [begin, begin + 2.0], rel=1e-5)


def test_a_file_without_optima_is_an_error(near, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    optima.OWN.parent.mkdir()
    optima.OWN.write_text('{"a": [{"time": [1]}]}')
    with pytest.raises(ResultsError, match=r"optima.json: contains no optima of `harness bound`"):
        optima.METRIC(near, Limits())
    assert main(["bound", "sync_approach", "--stop", "2", "--cost", "norm", "--store"]) == 2
    assert "--store: needs --cost sum and all constraints" in capsys.readouterr().err


NEAR = {
    "manager.dwell": [1.0] * 15, "manager.R_1": 25, "servicer.rho_0_H": [0, -25, 0],
    "manager.use_optimal": 1, "close_controller.position": 0, "optimal.duration": [60, 120, 304],
    "manager.bias_tol": 9.0,
}  # fmt: skip
"""From 25 to 20 m in a minute."""


@pytest.fixture(scope="module")
def near():
    return run("servicing_mission", set=NEAR, stop=90.0)


def test_phases_of_a_mission_cost_more_than_their_optima(near, capsys, tmp_path):
    found = bound("servicing_mission", set=NEAR, stop=90.0, grid=3.0)
    assert list(found.phases) == ["far", "hold 1", "closing", "hold 2"]
    closing = found.phases["closing"]
    assert closing.spent > closing.optimum.impulse > 0
    assert closing.optimum.impulse >= 2 * 100 * (5 - 1) / 70  # 100 kg, 4 m to the ball of tol_2
    for phase in found.phases.values():
        assert phase.miss[0] < 1e-3 and phase.miss[1] < 1e-6
    less = phase_optimum(servicing_mission.phases(near, 3.0)["closing"], "sum", ("speed",))
    assert less.impulse < closing.optimum.impulse - 0.1
    _, hold_1, closing, _, last = found.lines()
    assert "the optimum is 0; open loop" in hold_1 and "mm/s off the optimal path" in closing
    assert last.startswith("servicing_mission, sum: ")
    words = [x for name, value in NEAR.items() for x in ("--set", f"{name}={value}")]
    output = ["--stop", "5", "-o", str(tmp_path / "x.nc")]
    assert main(["bound", "servicing_mission", *words, *output]) == 2
    assert "optima of phases are simulated one by one" in capsys.readouterr().err


def test_the_simulation_of_a_phase_gives_the_force_of_the_plan_along_every_axis(near):
    """Any force along all axes, twice integrated by hand: a wrong sign is metres."""
    phase = servicing_mission.phases(near, 3.0)["closing"]
    given = phase.problem
    step, n = np.diff(given.time)[0], len(given.time) - 1
    force = np.random.default_rng(5).uniform([-0.7, -1.4, -0.5], [1.3, 0.6, 1.5], (n, 3))
    middle = given.time[:-1] + step / 2
    rows = near["servicer.q_SN"][np.searchsorted(near.time, middle)]
    push = Rotation.from_quat(rows, scalar_first=True).apply(force) / given.mass
    v = np.vstack([np.zeros(3), np.cumsum(push * step, axis=0)])
    r = np.vstack([np.zeros(3), np.cumsum((v[:-1] + v[1:]) / 2 * step, axis=0)])
    r, v = (
        r + given.start[:3] + np.outer(given.time - given.time[0], given.start[3:]),
        v + given.start[3:],
    )
    plan = Optimum(given.time, r, v, force, 0.0)
    with load("servicing_mission") as system:
        miss = phase_verified(system, servicing_mission.BOUND, phase, plan)
        assert miss[0] < 0.03 and miss[1] < 1e-3  # the tide, and the turning within a step
        for axis in range(3):
            wrong = replace(plan, force=force * np.where(np.arange(3) == axis, -1, 1))
            assert phase_verified(system, servicing_mission.BOUND, phase, wrong)[0] > 3


def test_a_phase_ends_at_rest_in_its_frame_and_outside_the_zone(near):
    given = servicing_mission.phases(near, None)["closing"].problem
    keep_out, _, speed = given.cones
    r, v = near["target.r_TN_N"][-1], near["target.v_TN_N"][-1]
    rho = np.array([3.0, -5.0, 2.0])
    at_rest = np.cross(np.cross(r, v) / (r @ r), rho)
    left = speed.position[0] @ rho + speed.velocity[0] @ at_rest
    close(left, np.zeros(3), rel=1e-3, of=np.linalg.norm(at_rest))  # the frame turns until the end
    assert speed.limit[0] == 0.03
    turned = servicing_mission.along(given, np.tile([0.0, 2.0, 0.0], (len(given.time), 1)))
    assert np.array_equal(turned.cones[0].slope[5], [0, 1, 0])
    assert np.array_equal(turned.cones[0].limit, keep_out.limit)
    assert keep_out.limit[0] == -12


def holds(cone, rho):
    """Whether a place satisfies a constraint of positions, at its first node."""
    left = np.linalg.norm(cone.position[0] @ rho + cone.offset[0])
    return left <= cone.slope[0] @ rho + cone.limit[0] + 1e-12


def test_a_hold_remains_at_its_place(near):
    """The second within a metre of 20 m behind the target; the third within 5 cm of 3 m on its
    axis, and 5 cm beside it.
    """
    time = near.time[:50]
    (second,) = servicing_mission.way(near, time, "hold 2")
    r, v = near["target.r_TN_N"][1], near["target.v_TN_N"][1]
    behind = -np.cross(np.cross(r, v), r)
    behind /= np.linalg.norm(behind)
    assert holds(second, 20.99 * behind) and not holds(second, 21.01 * behind)
    corridor, beside, along = servicing_mission.way(near, time, "hold 3")
    axis = Rotation.from_quat(near["target.q_TN"][1], scalar_first=True).apply([1, 0, 0])
    across = np.cross(axis, [0.6, 0, 0.8])
    across /= np.linalg.norm(across)
    for off, inside in ((0.049, True), (0.051, False)):
        assert holds(beside, 3 * axis + off * across) == inside
        assert holds(along, (3 + off) * axis) == holds(along, (3 - off) * axis) == inside
        assert holds(corridor, 3 * axis + off * across)


def test_speed_in_the_hill_frame_is_limited_in_the_attempt_only():
    """The attempt begins at once; a place at rest in H has no speed."""
    at_100_m = {"servicer.rho_0_H": [-90, -40, 0]}
    result = run("arch_rendezvous", set=at_100_m, stop=60.0)
    corridor, closing, end, rest = arch_rendezvous.problem(result, 20.0).cones
    assert corridor.nodes.tolist() == closing.nodes.tolist() == [1, 2, 3]
    r, v = result["target.r_TN_N"][-1], result["target.v_TN_N"][-1]
    rho = np.array([-90.0, -40, 10])
    at_rest = np.cross(np.cross(r, v) / (r @ r), rho)
    for cone in (closing, rest):
        left = cone.position[-1] @ rho + cone.velocity[-1] @ at_rest
        close(left, np.zeros(3), rel=1e-9, of=np.linalg.norm(at_rest))
    assert closing.limit[0] == 0.055
    far = np.linalg.norm(result["controller.rho_H"][-1])
    close(end.limit[0], far, rel=1e-3)
    axis = -r / np.linalg.norm(r)
    close(corridor.slope[-1], np.tan(np.pi / 6) * axis, rel=1e-9)
    with pytest.raises(UsageError, match="bound needs a run without an abort"):
        bound("arch_rendezvous", set={"controller.t_abort": 1}, stop=2.0)


def test_the_command_writes_the_run_of_the_optimal_force(tmp_path, monkeypatch, capsys):
    """A process of the command has not imported harness.api, which attaches Result.save."""
    monkeypatch.delattr(Result, "save")
    file = tmp_path / "best.nc"
    assert main(["bound", "ppc_tracking", "--stop", "2", "--grid", "1", "-o", str(file)]) == 0
    assert capsys.readouterr().out.startswith("ppc_tracking: ")
    found = read(file)
    assert found.complete and found.time[-1] == 2.0
    assert found.system == "ppc_tracking"


PAGE_OF_MISSIONS = Path(__file__).parents[2] / "docs" / "own_mission.md"


@pytest.mark.skipif(not PAGE_OF_MISSIONS.is_file(), reason="the sources are not there")
def test_a_mission_of_a_user_states_its_problem_as_the_page_shows(tmp_path, monkeypatch, capsys):
    """From 20 m to 19 m in 20 s: the last metre at no less than 1 m / 20 s."""
    text = PAGE_OF_MISSIONS.read_text(encoding="utf-8").partition("answer `harness bound`")[2]
    block = dedent(re.search(r"\n\n((?: {4}.*\n|\n)+)", text)[1])
    assert "600, target, 5.0" in block
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/system.toml").write_text('extends = "sync_approach"\nname = "mine"\n')
    (tmp_path / "mine/mission.py").write_text(block.replace("600, target, 5.0", "20, target, 19.0"))
    assert main(["bound", "mine", "--stop", "20", "--grid", "5", "--store"]) == 0
    out = capsys.readouterr().out
    assert out.endswith(f"stored in {optima.OWN}\n")
    (legs,) = optima.read(optima.OWN).values()
    assert np.linalg.norm(legs[0].position[0]) == pytest.approx(20, abs=1e-6)
    assert np.linalg.norm(legs[0].position[-1]) == pytest.approx(19, abs=1e-3)
    assert f"the optimum of {legs[0].impulse[-1]:.4g} N s" in out


def test_names_of_constraints_are_checked(capsys):
    with pytest.raises(UsageError, match=r"--without x: expected one of corridor, distance"):
        bound("sync_approach", stop=2.0, grid=1.0, without=("x",))
    with pytest.raises(UsageError, match="defines no convex problem"):
        bound("space_robot", stop=1.0)
    assert main(["bound", "sync_approach", "--stop", "2", "--cost", "cube"]) == 2
    assert "expected sum or norm" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("system", "params", "stop"),
    [
        ("sync_approach", "limited", 1800.0),
        ("ppc_tracking", "limited", 120.0),
        ("relay_approach", "limited", 40000.0),
        ("arch_rendezvous", None, 18000.0),
    ],
)
def test_the_default_cases_have_a_stored_optimum(system, params, stop):
    """Otherwise a parameter has changed: python .ci/bounds.py computes the optima anew."""
    result = run(system, params=params, stop=1.0)
    whole = replace(result, time=np.append(result.time[:-1], stop))
    assert optima.case(whole) in optima.stored()
    ratio = optima.METRIC(whole, Limits())
    spent = result["propulsion.impulse"][-1].sum()
    (leg,) = optima.stored()[optima.case(whole)]
    close(ratio * leg.impulse[-1], spent, rel=1e-14)
    assert leg.time[0] == 0 and leg.time[-1] == stop
    assert np.isnan(optima.METRIC(result, Limits()))


@pytest.mark.long
def test_the_rendezvous_benchmark_costs_more_than_three_times_its_optimum():
    found = bound("arch_rendezvous")
    assert found.spent > 3 * found.optimum.impulse
    assert found.miss < 0.05
    assert margin(found.verified, "monitor.corridor_margin >= -0.02 m") > 0
    assert margin(found.verified, "monitor.speed_margin >= 0 m/s") > 0
    (leg,) = optima.stored()[optima.case(found.run)]
    close(found.optimum.impulse, leg.impulse[-1], rel=1e-5)


@pytest.mark.long
@pytest.mark.parametrize("params", [None, "optimal", "limited"])
def test_the_missions_have_stored_optima_of_their_phases(params):
    result = run("servicing_mission", params=params, every=10)
    legs = optima.stored()[optima.case(result)]
    ends = [stay.end for stay in stays(result)[:8]]  # up to the contact
    close([leg.time[-1] for leg in legs], ends, rel=1e-3)
    assert 1 < optima.METRIC(result, Limits()) < 3


@pytest.mark.long
def test_the_synchronised_approach_has_its_published_bound():
    """142.1 N s and 100.4 N s of an independent set-up; half of the grid changes 0.5 % at most."""
    how = {"params": "limited"}
    found = bound("sync_approach", **how)
    close(found.optimum.impulse, 142.1, rel=1e-3)
    close(found.spent / found.optimum.impulse, 1.254, rel=2e-3)
    close(bound("sync_approach", cost="norm", **how).optimum.impulse, 100.4, rel=1e-3)
    half = bound("sync_approach", grid=1.0, **how).optimum.impulse
    close(half, found.optimum.impulse, rel=5e-3)
    assert found.miss < 0.005
    assert margin(found.verified, "guidance.range >= 3.999 m") > 0
    close(found.verified["propulsion.impulse"][-1].sum(), found.optimum.impulse, rel=2e-3)
    less = bound("sync_approach", without=("corridor",), **how).optimum.impulse
    assert less < found.optimum.impulse


@pytest.mark.long
@pytest.mark.parametrize(
    ("problem", "changes", "expected", "ratio"),
    [
        (ppc_tracking.BOUND, {"system": "ppc_tracking", "every": 1}, 1486, 6.48),
        (relay_approach.BOUND, {"system": "relay_approach", "every": 10}, 28.4, 2.03),
    ],
)
def test_two_more_approaches_have_their_published_bounds(problem, changes, expected, ratio):
    result = run(**changes, params="limited")
    found = solve(problem.problem(result, problem.grid))
    close(found.impulse, expected, rel=2e-3)
    spent = problem.spent(result) if problem.spent else result["propulsion.impulse"][-1].sum()
    close(spent / found.impulse, ratio, rel=3e-3)
    (leg,) = optima.stored()[optima.case(result)]
    close(found.impulse, leg.impulse[-1], rel=1e-5)
