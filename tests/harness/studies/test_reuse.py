# SPDX-License-Identifier: BSD-2-Clause
"""A reused simulation: every further run has the bits of a fresh one, after any earlier run."""

from __future__ import annotations

from dataclasses import replace

import pytest

from harness import Simulation, load, run
from harness.errors import InterruptionError, RunError, StructureError, UsageError
from harness.files import paths
from harness.master.changes import set_names
from tests.harness.third_party_fmu import MODELS, Model, build, p, u, x, y

SYSTEMS = sorted(paths.systems())
FEW = ("relay_approach", "space_robot", "sync_approach")


def same_bits(a, b):
    assert a.columns == b.columns
    assert a.time.tobytes() == b.time.tobytes()
    assert a.values.tobytes() == b.values.tobytes()
    assert a.parameters.columns == b.parameters.columns
    assert a.parameters.values.tobytes() == b.parameters.values.tobytes()
    assert (a.units, a.descriptions) == (b.units, b.descriptions)
    assert (a.complete, a.message) == (b.complete, b.message)
    return True


def short(system):
    """Some twenty steps, whole ones for the slowest component."""
    with load(system) as found:
        return {"stop": found.experiment.start + 20 * found.experiment.step}


def loads(monkeypatch):
    """Names of the instances that are loaded from now on."""
    from harness.master import fmu

    seen, original = [], fmu.Calls

    def calls(name, *rest, **how):
        seen.append(name)
        return original(name, *rest, **how)

    monkeypatch.setattr(fmu, "Calls", calls)
    return seen


# ---- the systems of the project


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in FEW else pytest.mark.long) for n in SYSTEMS]
)
def test_every_set_of_every_system_has_the_bits_of_a_fresh_run(name, monkeypatch):
    with load(name) as system, Simulation(system) as simulation:
        simulation.run(**short(name))
        seen = loads(monkeypatch)
        for params in (*set_names(system), "default"):
            reused = simulation.run(params=params, **short(name))
            assert seen == []
            with Simulation(replace(simulation.system)) as fresh:
                fresh.advance()
                assert same_bits(reused, fresh.result())
            seen.clear()


def test_step_stop_latency_algorithm_and_start_values_may_change(monkeypatch):
    variants = [
        {"stop": 4.0},
        {"stop": 2.0, "step": 0.05},
        {"stop": 2.0, "latency": {"guidance": 1}},
        {"stop": 2.0, "algorithm": "jacobi"},
        {"stop": 2.0, "set": {"servicer.mass_0": 77.0, "target.omega_TN_T_0": [0.01, 0.02, 0.0]}},
        {"stop": 4.0},
    ]
    with load("sync_approach") as system, Simulation(system) as simulation:
        seen = loads(monkeypatch)
        reused = [simulation.run(**changes) for changes in variants]
        assert seen == []
    for result, changes in zip(reused, variants, strict=True):
        assert same_bits(result, run("sync_approach", **changes))


def test_a_swap_loads_the_new_fmu_only(monkeypatch):
    with load("sync_approach") as system, Simulation(system) as simulation:
        swap = {"controller": "pid_controller"}
        simulation.run(stop=2.0)
        seen = loads(monkeypatch)
        swapped = simulation.run(stop=2.0, swap=swap)
        assert seen == ["controller"]
        simulation.run(stop=2.0, swap=swap)
        assert seen == ["controller"]
        back = simulation.run(stop=2.0)
        assert seen == ["controller", "controller"]
    assert same_bits(swapped, run("sync_approach", stop=2.0, swap=swap))
    assert same_bits(back, run("sync_approach", stop=2.0))


def test_a_result_is_not_touched_by_later_runs():
    with load("sync_approach") as system, Simulation(system) as simulation:
        first = simulation.run(stop=2.0)
        before = first.values.copy()
        simulation.run(stop=2.0, set={"servicer.mass_0": 50.0})
    assert first.values.tobytes() == before.tobytes()


@pytest.mark.parametrize("retained", ["values", "range", "time"])
def test_the_table_of_an_unreferenced_run_is_used_again(retained):
    with load("sync_approach") as system, Simulation(system) as simulation:
        first = simulation.run(stop=2.0)
        table = simulation.recorder.table.ctypes.data
        views = {"values": first.values, "time": first.time, "range": first["guidance.range"][1:]}
        view = views.pop(retained)
        before = view.copy()
        del first, views
        further = simulation.run(stop=2.0, set={"servicer.mass_0": 50.0})
        assert (simulation.recorder.table.ctypes.data != table) is (retained != "time")
        assert same_bits(further, run("sync_approach", stop=2.0, set={"servicer.mass_0": 50.0}))
    assert view.tobytes() == before.tobytes()


# ---- runs that ended early


def test_a_run_after_one_that_was_stopped_in_the_middle(monkeypatch):
    def stop(done):
        if done > 5:
            raise KeyboardInterrupt

    with load("sync_approach") as system, Simulation(system) as simulation:
        with pytest.raises(InterruptionError) as caught:
            simulation.run(stop=1800.0, progress=stop)
        assert not caught.value.partial.complete
        assert same_bits(simulation.run(stop=2.0), run("sync_approach", stop=2.0))


def test_a_run_after_one_whose_parameters_an_fmu_rejected():
    with load("sync_approach") as system, Simulation(system) as simulation:
        for _ in range(2):
            with pytest.raises(UsageError, match="mass_0"):
                simulation.run(set={"servicer.mass_0": -1.0})
        assert same_bits(simulation.run(stop=2.0), run("sync_approach", stop=2.0))


def test_changes_that_make_no_sense_leave_the_simulation_as_it_is():
    with load("sync_approach") as system, Simulation(system) as simulation:
        with pytest.raises(UsageError, match=r"--set servicer\.masse"):
            simulation.run(set={"servicer.masse": 1.0})
        with pytest.raises(StructureError, match="not a multiple"):
            simulation.run(stop=2.05)
        with pytest.raises(StructureError, match="guidance: latency must lie in"):
            simulation.run(latency={"guidance": 7})
        assert same_bits(simulation.run(stop=2.0), run("sync_approach", stop=2.0))


def test_a_closed_simulation_does_not_run():
    with load("sync_approach") as system, Simulation(system) as simulation:
        pass
    with pytest.raises(UsageError, match="inside its `with` block only"):
        simulation.run()


# ---- FMUs from elsewhere


FINE = [m.name for m in MODELS if m.name not in ("crashing", "slow", "mixed", "failing", "silent")]


@pytest.mark.parametrize("name", FINE)
def test_third_party_fmus_too(make, name):
    system = make({"a": name}, stop=3.0)
    try:
        fresh = run(system)
    except RunError as error:
        fresh = error.partial
    with Simulation(system) as simulation:
        for _ in range(3):
            try:
                again = simulation.run()
            except RunError as error:
                again = error.partial
            assert same_bits(again, fresh)


@pytest.mark.parametrize("status", [2, 3, 4])
def test_a_third_party_fmu_that_failed_runs_again(make, status):
    system = make({"counter": "counter", "bad": "failing"}, parameters={"bad.status": status})
    fresh = run(system, set={"bad.t_fail": 50.0})
    with Simulation(system) as simulation:
        for _ in range(2):
            with pytest.raises(RunError, match=r"burnt through .* \(at t = 3 s\)") as caught:
                simulation.run()
            assert caught.value.partial["counter.n"].tolist() == [0, 1, 2, 3]
            assert same_bits(simulation.run(set={"bad.t_fail": 50.0}), fresh)


STUBBORN = Model(
    "stubborn", [u("u"), y("y"), p("y_0"), x("z")], "y = z + y_0;", "z += h * u + c->real[4];"
)
"""An integrator; its spare number c->real[4] is no variable and adds to every step."""

VICES = {
    "rejects": "return fmi2Error;",
    "retains its state": "return fmi2OK;",
    "retains hidden data": "c->latched = 0; @START@ c->real[4] = 0.25; return fmi2OK;",
}


@pytest.mark.parametrize("vice", VICES)
def test_a_third_party_fmu_is_loaded_anew_regardless_of_what_its_reset_leaves_behind(
    make, tmp_path, monkeypatch, vice
):
    path = build(replace(STUBBORN, reset=VICES[vice]), tmp_path)
    system = make({"a": "integrator", "b": "counter"}, ["b.n > a.u"])
    system = replace(
        system, components=(replace(system.components[0], fmu=path), system.components[1])
    )
    fresh = run(system)
    with Simulation(system) as simulation:
        simulation.run()
        seen = loads(monkeypatch)
        for _ in range(3):
            assert same_bits(simulation.run(), fresh)
    assert seen.count("a") == 3
