# SPDX-License-Identifier: BSD-2-Clause
"""Systems as environments: the bits of the run, rewards that are what is evaluated, episodes."""

import pickle
import shutil
import zipfile

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from harness import environment, run
from harness.errors import FmuError, UsageError
from harness.files import paths
from harness.learning.apart import Apart, trusted
from harness.learning.scoring import Scoring
from harness.learning.vector import Environments, environments
from harness.mission.library import campaigns
from harness.results.requirements import margin
from harness.studies.campaign.draft import read_plan
from tests.close import close


@pytest.fixture
def tracking():
    env = environment("ppc_tracking", stop=2.0, params="limited", every=2, ends=())
    yield env
    env.close()


def recorded(env, name, every):
    """Actions that the component has recorded in a run of the system."""
    whole = run(name, stop=2.0, params="limited", every=1)
    names = dict.fromkeys(n.partition("[")[0].partition(" ")[0] for n in env.action_names)
    actions = np.hstack([whole[n].reshape(len(whole.time), -1) for n in names])
    return whole, actions[1::every]


def test_an_episode_under_recorded_actions_has_the_bits_of_the_run():
    env = environment("ppc_tracking", stop=2.0, params="limited", every=1, ends=())
    whole, actions = recorded(env, "ppc_tracking", 1)
    env.reset()
    for k, action in enumerate(actions):
        _, _, terminated, truncated, info = env.step(action)
        assert (terminated, truncated) == (False, k == len(actions) - 1)
    result, set_ = env.result(), tuple({n.partition("[")[0] for n in env.action_names})
    for column in whole.columns:
        if column.startswith(set_) or not column.startswith("controller."):
            assert result[column].tobytes() == whole[column].tobytes(), column
    for name, found in info["requirements"].items():
        expected = margin(whole, dict(whole.provenance.requirements)[name])
        np.testing.assert_equal(np.nan if found.margin is None else found.margin, expected)
    env.close()


def test_observations_are_the_inputs_of_the_component_in_their_units(tracking):
    observation, _ = tracking.reset()
    assert tracking.observation_names[0] == "controller.r_TN_N[1] [m]"
    place = tracking.observation_names.index("controller.v_SN_N[2] [m/s]")
    assert observation[place] == tracking.simulation.get("servicer.v_SN_N")[1]


def test_actions_are_bounded_by_the_actuators_of_the_limited_set(tracking):
    bounds = dict(zip(tracking.action_names, tracking.action_space.high, strict=True))
    assert bounds["controller.F_cmd_S[1] [N]"] == 490
    assert bounds["controller.M_cmd_S[3] [N.m]"] == 10
    np.testing.assert_array_equal(tracking.action_space.low, -tracking.action_space.high)


def test_rewards_add_up_to_delta_v_and_weighted_violations(tracking):
    tracking.reset()
    rewards, violations = 0.0, 0.0
    rng = np.random.default_rng(1)
    over = False
    while not over:
        action = 0.1 * tracking.action_space.high * rng.uniform(-1, 1, 9)
        _, reward, _, over, info = tracking.step(action)
        rewards += reward
        violations += sum(max(0.0, -m) for m in info["margins"].values())
    result = tracking.result()
    spent = result["propulsion.impulse"].sum(axis=1) / result["servicer.mass"]
    close(rewards, -(spent[-1] - spent[0]) - violations, rel=1e-12)


def scored(result, requirements, **worth):
    terms = worth.get("reward", ""), worth.get("cost", ""), worth.get("weights", 1.0)
    return Scoring(result, requirements, terms, (worth.get("ends", ()), ()), "")


@pytest.mark.parametrize("name", ["sync_approach", "ppc_tracking", "space_robot", "arm_capture"])
def test_margins_of_a_row_are_the_margins_of_the_evaluation(name):
    """The least margin over all rows is the margin of the requirement."""
    result = run(name, stop={"space_robot": 3000.0}.get(name, 4.0), every=2)
    texts = dict(result.provenance.requirements)
    scoring = scored(result, texts)
    constants = scoring.values.constants(result.parameters.values[0])
    rows = [scoring.margins(scoring.values(row, constants, time))
            for row, time in zip(result.values, result.time, strict=True)]  # fmt: skip
    checked = 0
    for each in scoring.requirements:
        expected = margin(result, texts[each])
        if np.isfinite(expected):
            close(min(row[each] for row in rows), expected, rel=1e-12)
            checked += 1
    assert checked


def test_a_lost_requirement_ends_the_episode(tracking):
    calm = {"calm": "time <= 0.97 s or time >= 9 s"}
    env = environment("ppc_tracking", stop=2.0, every=1, require=calm, ends=("calm",))
    env.reset()
    over, steps = False, 0
    while not over:
        _, _, over, out, info = env.step(0 * env.action_space.high)
        assert not out
        steps += 1
    assert info["ended"] == ["calm"]
    assert steps == 20


def test_a_failing_fmu_ends_the_episode(tracking):
    tracking.reset()
    _, _, over, _, info = tracking.step(np.full(9, np.nan))
    assert over
    assert "not a finite number" in info["ended"][0]
    assert not tracking.result().complete
    observation, _ = tracking.reset()
    assert np.isfinite(observation).all()


def test_resets_are_the_runs_of_the_campaign():
    file = campaigns()["ppc_tracking_worst"]
    plan, _ = read_plan(file)
    env = environment("ppc_tracking", factors=file, stop=1.0, every=20)
    for k, options in ((0, None), (1, None), (5, {"run": 5}), (6, None)):
        _, info = env.reset(options=options)
        assert info["run"] == k
        assert info["factors"] == plan.values(k)
        expected = run("ppc_tracking", **{**plan.changes(plan.values(k)), "stop": 1.0}, every=20)
        found = env.result()
        assert found.values[0].tobytes() == expected.values[0].tobytes()
        np.testing.assert_array_equal(found.parameters.values, expected.parameters.values)
    env.close()


def test_margins_depend_on_the_parameters_of_the_episode():
    plan = {"system": "ppc_tracking", "runs": 3, "seed": 1,
            "factors": {"guidance.rho_f": {"uniform": {"low": 18.0, "high": 30.0}}}}  # fmt: skip
    require = {"far": "guidance.range >= parameter(guidance.rho_f)"}
    env = environment("ppc_tracking", factors=plan, require=require, stop=1.0, every=20, ends=())
    for k in (0, 2):
        _, info = env.reset(seed=k)
        drawn = info["factors"]["guidance.rho_f"]
        *_, info = env.step(0 * env.action_space.high)
        assert info["margins"]["far"] == env.result()["guidance.range"][-1] - drawn
    env.close()


def test_a_vector_gives_the_bits_of_single_environments_and_begins_anew():
    how = {"system": "ppc_tracking", "stop": 1.0, "every": 10, "ends": ()}
    how["factors"] = campaigns()["ppc_tracking_worst"]
    vector, rng = Environments(3, **how), np.random.default_rng(2)
    seen, _ = vector.reset(seed=4)
    actions = rng.uniform(-1, 1, (3, 3, 9))
    singles = [environment(how["system"], **{k: x for k, x in how.items() if k != "system"})
               for _ in range(3)]  # fmt: skip
    starts = [env.reset(seed=4 + i)[0] for i, env in enumerate(singles)]
    np.testing.assert_array_equal(seen, starts)
    for k in range(2):
        observed, rewards, _, truncated, infos = vector.step(actions[k])
        alone = [env.step(a) for env, a in zip(singles, actions[k], strict=True)]
        np.testing.assert_array_equal(observed, [a[0] for a in alone])
        np.testing.assert_array_equal(rewards, [a[1] for a in alone])
        assert truncated.tolist() == [a[3] for a in alone]
    assert truncated.all()
    assert "requirements" in infos
    observed, rewards, *_, infos = vector.step(actions[2])
    assert infos["run"].tolist() == [7, 8, 9]
    np.testing.assert_array_equal(rewards, 0)
    np.testing.assert_array_equal(observed[0], singles[0].reset(options={"run": 7})[0])
    vector.close()


def test_a_copy_made_by_pickle_goes_the_same_way(tracking):
    other = pickle.loads(pickle.dumps(tracking))
    action = 0.01 * tracking.action_space.high
    for env in (tracking, other):
        env.reset(seed=1)
        env.step(action)
    assert tracking.result().values.tobytes() == other.result().values.tobytes()
    other.close()


IDS = ["ArchRendezvous", "PpcTracking", "SyncApproachThrusters", "SpaceRobot", "Transposition"]


@pytest.mark.parametrize("name", IDS)
def test_checks_of_gymnasium_pass(name):
    env = gymnasium.make(f"servicing/{name}-v0", disable_env_checker=True)
    check_env(env.unwrapped, skip_render_check=True)
    env.close()


@pytest.mark.long
@pytest.mark.parametrize(
    "made", sorted(i for i in gymnasium.registry if i.startswith("servicing/"))
)
def test_checks_of_gymnasium_pass_for_every_id(made):
    env = gymnasium.make(made, disable_env_checker=True)
    check_env(env.unwrapped, skip_render_check=True)
    env.close()


@pytest.mark.long
def test_vectors_and_processes_give_the_same_episodes():
    """Two episodes of each environment: in one process, in a process each, and alone."""
    file, rng = campaigns()["ppc_tracking_worst"], np.random.default_rng(5)
    how = {"factors": file, "stop": 2.0, "every": 20, "ends": (), "stride": 2}
    made, actions = "servicing/PpcTracking-v0", rng.uniform(-1, 1, (4, 2, 9))
    inside = gymnasium.make_vec(made, 2, **{k: x for k, x in how.items() if k != "stride"})
    apart = gymnasium.make_vec(made, 2, vectorization_mode="async", **how)
    seen, other = inside.reset(seed=4)[0], apart.reset(seed=4)[0]
    np.testing.assert_array_equal(seen, other)
    runs = []
    for action in actions:
        found, expected = inside.step(action), apart.step(action)
        for a, b in zip(found[:4], expected[:4], strict=True):
            np.testing.assert_array_equal(a, b)
        runs += found[4].get("run", np.empty(0)).tolist()
    assert runs == [6, 7]
    inside.close()
    apart.close()


def test_every_system_has_an_id():
    names = ("".join(word.title() for word in name.split("_")) for name in paths.systems())
    assert {f"servicing/{name}-v0" for name in names} <= gymnasium.registry.keys()


def test_wrong_names_are_errors():
    with pytest.raises(UsageError, match=r"observe.*close: r_SN_N"):
        environment("ppc_tracking", observe=["servicer.r_SN"])
    with pytest.raises(UsageError, match=r"act controller.F.*no output"):
        environment("ppc_tracking", act=["controller.F"])
    with pytest.raises(UsageError, match=r"has no bounds; give some"):
        environment("ppc_tracking", act=["controller.z_att"])
    with pytest.raises(UsageError, match="present row only"):
        environment("ppc_tracking", reward="max(guidance.range)")
    with pytest.raises(UsageError, match="shield filter"):
        environment("ppc_tracking", shield="filter")


def test_a_crash_of_a_third_party_fmu_ends_the_episode(make):
    """The next episode begins in a new process."""
    system = make({"law": "counter", "plant": "gain", "c": "crashing"}, ["law.n > plant.u"])
    env = environment(system, open=["law"], bounds={"law.n": (0.0, 9.0)}, every=1)
    seen, _ = env.reset()
    steps, over = 0, False
    while not over:
        _, _, over, out, info = env.step(np.array([3.0]))
        steps += 1
        assert not out
    assert steps == 3
    assert "crashed (SIGSEGV" in info["ended"][0]
    again, _ = env.reset()
    np.testing.assert_array_equal(again, seen)
    env.close()


def test_third_party_fmus_of_a_vector_run_in_child_processes(make):
    """A crash ends the episode of one environment."""
    system = make({"law": "counter", "plant": "gain", "c": "crashing"}, ["law.n > plant.u"])
    how = {"open": ["law"], "bounds": {"law.n": (0.0, 9.0)}, "every": 1}
    vector = environments(2, system, **how)
    assert all(isinstance(env.unwrapped, Apart) for env in vector.envs)
    vector.reset(seed=0)
    for k in range(5):
        _, _, lost, *_ = vector.step(np.full((2, 1), 3.0))
        assert lost.tolist() == [k == 2] * 2
    vector.close()


def test_third_party_fmus_that_a_campaign_swaps_in_run_in_child_processes(tmp_path):
    assert trusted("sync_approach", {})
    fmu, file = tmp_path / "third.fmu", tmp_path / "c.toml"
    shutil.copy(paths.fmus()["adaptive_controller"], fmu)
    with zipfile.ZipFile(fmu, "a") as archive:
        archive.writestr("resources/own.txt", "own")
    masses = '"servicer.mass_0" = {uniform = {low = 100.0, high = 110.0}}'
    for table in (
        f'runs = 2\n[fixed]\nswap = {{controller = "{fmu}"}}\n[factors]\n{masses}\n',
        f'[factors]\n"swap.controller" = {{list = ["{fmu}"]}}\n',
    ):
        file.write_text(f'system = "sync_approach"\n{table}')
        assert not trusted("sync_approach", {"factors": file})


def test_environments_of_a_vector_in_child_processes_begin_with_runs_of_their_own():
    file, how = campaigns()["ppc_tracking_worst"], {"stop": 1.0, "every": 20, "stride": 2}
    runs = []
    for i in range(2):
        env = Apart("ppc_tracking", factors=file, begin=i, **how)
        runs += [env.reset()[1]["run"] for _ in range(2)]
        env._child.process.kill()
        env._child.process.join()
        with pytest.raises(FmuError, match="SIGKILL"):
            env.result()
        env.close()
    assert runs == [0, 2, 1, 3]


def test_after_a_crash_the_campaign_goes_on():
    file = campaigns()["ppc_tracking_worst"]
    env = Apart("ppc_tracking", factors=file, stop=1.0, every=20, stride=2)
    _, info = env.reset(seed=3)
    env._child.process.kill()
    env._child.process.join()
    _, info = env.reset()
    assert info["run"] == 5
    env.close()


def test_the_abort_of_a_monitor_ends_the_episode():
    env = environment("sync_approach_thrusters_guarded", shield="monitor", stop=400)
    env.reset()
    over, towards = False, np.array([0, -1, 0, 0, 0, 0, 0, 0, 0]) * env.action_space.high
    while not over:
        _, _, over, out, info = env.step(towards)
        assert not out
    assert info["ended"] == ["monitor.abort"]
    assert env.result()["monitor.abort"][-2:].tolist() == [0, 1]
    env.close()


def test_a_filter_corrects_the_agent():
    """A push towards the target is corrected before it violates the sphere."""
    env = environment("sync_approach_thrusters_filtered", shield="filter", stop=400, ends=())
    env.reset()
    over, towards, found = False, np.array([0, -1, 0, 0, 0, 0, 0, 0, 0]), []
    while not over:
        _, _, lost, over, info = env.step(towards * env.action_space.high)
        assert not lost
        found.append(info["intervention"])
    result = env.result()
    assert found[0] == 0
    assert max(found) > 1
    np.testing.assert_array_equal(found, result["filter.intervention"][1:])
    distance = np.linalg.norm(result["servicer.r_SN_N"] - result["target.r_TN_N"], axis=1)
    assert distance.min() >= 4.0 - 1e-9
    env.close()
