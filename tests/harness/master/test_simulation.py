# SPDX-License-Identifier: BSD-2-Clause
"""Loading, initial propagation, stepping with both executors, rollback, and runs that fail."""

from __future__ import annotations

import itertools
import zipfile
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest

from harness import run
from harness.errors import FmuError, InterruptionError, RunError, StructureError, UsageError
from harness.master.isolated import simulate
from harness.master.simulation import Simulation

pytestmark = pytest.mark.usefixtures("trusted")

EXECUTORS = pytest.mark.parametrize("executor", ["c", "python"])


def same_bits(a, b):
    return (
        a.columns == b.columns
        and a.values.tobytes() == b.values.tobytes()
        and a.time.tobytes() == b.time.tobytes()
    )


# ---- executors


@pytest.mark.parametrize("algorithm", ["gauss-seidel", "jacobi"])
def test_executors_agree_bit_for_bit_on_a_feedback_loop_of_fast_and_slow_units(make, algorithm):
    system = make(
        {"gain": "gain", "integrator": "integrator", "counter": "counter", "slow": "integrator"},
        ["integrator.y > gain.u", "gain.y > integrator.u", "counter.n > slow.u"],
        {"gain.k": -0.7, "integrator.y_0": 1.1},
        {"slow": (5, 1), "counter": (2, 0)},
        stop=10.0,
        step=0.1,
        algorithm=algorithm,
    )
    assert same_bits(run(system, executor="c"), run(system, executor="python"))


@EXECUTORS
def test_integer_boolean_and_string_variables_work_beside_real_ones(make, executor):
    system = make(
        {"a": "mixed", "b": "mixed"},
        ["a.n > b.i", "a.odd > b.b", "a.r_out > b.r"],
        {"a.offset": 5, "a.flip": True, "a.label": "text", "b.r": 0.0},
        stop=4.0,
    )
    result = run(system, executor=executor)
    assert result["a.n"].tolist() == [5, 6, 7, 8, 9]
    assert result["a.odd"].tolist() == [0, 1, 0, 1, 0]
    assert result["b.r_out"].tolist() == [50, 61, 70, 81, 90]


def test_a_run_repeats_to_the_bit(make):
    system = make(
        {"gain": "gain", "counter": "counter"}, ["counter.n > gain.u"], stop=3.0, step=0.1
    )
    assert same_bits(run(system), run(system))


@pytest.mark.parametrize("executor", ["c", "python"])
@pytest.mark.parametrize("in_process", [False, True])
@pytest.mark.parametrize(
    ("every", "rows"),
    [(4, [0, 4, 8, 10]), (5, [0, 5, 10]), (7, [0, 7, 10]), (11, [0, 10]), (2**62, [0, 10])],
)
def test_recording_every_nth_step_retains_those_rows_and_the_last(
    make, monkeypatch, executor, in_process, every, rows
):
    monkeypatch.setattr("harness.master.isolated.all_ours", lambda _: in_process)
    system = make({"gain": "gain", "counter": "counter"}, ["counter.n > gain.u"], stop=10.0)
    how = {"executor": executor, "in_process": in_process}
    full, thin = run(system, **how), run(system, every=every, **how)
    assert thin.time.tolist() == rows
    assert thin.values.tobytes() == full.values[rows].tobytes()
    assert thin.complete


@pytest.mark.parametrize("executor", ["c", "python"])
def test_a_thinned_run_that_is_stopped_or_taken_back_has_no_last_row(make, executor):
    system = make({"counter": "counter"}, stop=10.0)
    with Simulation(system, executor=executor, every=4) as simulation:
        simulation.advance(to=9)
        assert simulation.result().time.tolist() == [0, 4, 8]
        assert not simulation.result().complete
        simulation.advance()
        assert simulation.result().time.tolist() == [0, 4, 8, 10]
        assert simulation.run()["counter.n"].tolist() == [0, 4, 8, 10]
        assert simulation.run(every=10**6)["counter.n"].tolist() == [0, 10]
        assert simulation.run()["counter.n"].tolist() == [0, 4, 8, 10]


def test_columns_are_all_outputs_in_order_with_units(make):
    result = run(make({"s": "source", "v": "vector"}, [f"s.v[{i}] > v.v[{i}]" for i in (1, 2, 3)]))
    assert result.columns == ("s.v[1]", "s.v[2]", "s.v[3]", "v.w[1]", "v.w[2]", "v.w[3]")
    assert set(result.units) == {"m"}
    assert result["s.v"].shape == (7, 3)
    assert result["s.v"][-1].tolist() == [6, 60, 600]


# ---- initialization


def test_initial_values_travel_through_a_chain_against_the_order_of_execution(make):
    names = [f"p{i}" for i in range(8)]
    wires = [f"{b}.y > {a}.u" for a, b in itertools.pairwise(names)]
    result = run(make(dict.fromkeys(names, "plus_one"), wires))
    assert result.values[0].tolist() == [8, 7, 6, 5, 4, 3, 2, 1]


def test_start_values_of_open_inputs_and_parameters_reach_the_first_row(make):
    result = run(make({"gain": "gain"}, parameters={"gain.u": 3.0, "gain.k": 5.0}))
    assert result["gain.y"].tolist() == [15.0] * 7


def test_an_algebraic_loop_that_does_not_settle_is_named_and_simulated(make, caplog):
    result = run(make({"a": "plus_one", "b": "plus_one"}, ["a.y > b.u", "b.y > a.u"]))
    assert caplog.messages == ["test: initial values do not settle (an algebraic loop): a.y, b.y"]
    assert result.complete


def test_an_algebraic_loop_that_settles_starts_from_its_solution(make, caplog):
    wires = ["half.y > one.u", "one.y > half.u"]
    result = run(make({"one": "plus_one", "half": "gain"}, wires, {"half.k": 0.5}))
    assert (result["one.y"][0], result["half.y"][0]) == (2.0, 1.0)  # y = 1 + y / 2
    assert caplog.messages == []


def test_an_algebraic_loop_that_diverges_beyond_all_numbers_is_an_error(make):
    system = make({"a": "gain", "b": "plus_one"}, ["a.y > b.u", "b.y > a.u"], {"a.k": 1e10})
    with pytest.raises(RunError, match=r"[ab]\.y: output is not a finite number \(at t = 0 s\)"):
        run(system)


def test_a_chain_that_passes_the_same_units_again_and_again_settles(make):
    system = make(
        {"a": "ladder", "b": "ladder"},
        [
            "a.w[1] > b.v[1]",
            "b.w[1] > a.v[2]",
            "a.w[2] > b.v[2]",
            "b.w[2] > a.v[3]",
            "a.w[3] > b.v[3]",
        ],
        {"a.v[1]": 1.0},
    )
    first = run(system)
    assert first["a.w"][0].tolist() == [2, 4, 6]
    assert first["b.w"][0].tolist() == [3, 5, 7]


def test_a_closed_simulation_does_not_step(make):
    with Simulation(make({"a": "counter"})) as simulation:
        simulation.advance(to=1)
    with pytest.raises(UsageError, match="inside its `with` block only"):
        simulation.advance()


def test_a_time_in_place_of_a_number_of_macro_steps_is_a_sentence(make):
    with Simulation(make({"a": "counter"})) as simulation:
        with pytest.raises(UsageError, match=r"advance\(to=0\.1\): expected a whole number of"):
            simulation.advance(to=0.1)
        simulation.advance(to=np.int64(2))
        assert simulation.step == 2


def test_a_parameter_that_the_fmu_rejects_is_reported_in_its_own_words(make):
    with pytest.raises(RunError, match=r"^bad: .*mass must be > 0 \(at t = 0 s\)$") as caught:
        run(make({"good": "picky", "bad": "picky"}, parameters={"bad.mass": -1.0}))
    assert caught.value.partial is None


# ---- rollback


@EXECUTORS
def test_a_restored_system_has_the_same_future(make, executor):
    system = make(
        {"gain": "gain", "integrator": "integrator", "counter": "counter"},
        ["integrator.y > gain.u", "gain.y > integrator.u"],
        {"gain.k": -0.3, "integrator.y_0": 1.0},
        {"counter": (4, 2)},
        stop=8.0,
        step=0.1,
    )
    with Simulation(system, executor=executor) as simulation:
        simulation.advance(to=37)
        snapshot = simulation.save()
        simulation.advance()
        first = simulation.result().values.copy()
        simulation.restore(snapshot)
        assert simulation.step == 37
        assert len(simulation.result().time) == 38
        assert not simulation.result().complete
        simulation.recorder.table[38:] = np.nan
        simulation.advance()
        assert simulation.result().values.tobytes() == first.tobytes()
        simulation.free(snapshot)


def test_saving_without_state_support_is_a_clear_error(make):
    with Simulation(make({"a": "no_state"})) as simulation:
        simulation.initialize()
        with pytest.raises(RunError, match="a: this FMU cannot save and restore its state"):
            simulation.save()


def test_an_fmu_without_state_support_runs(make):
    assert run(make({"a": "no_state"}, parameters={"a.u": 2.0}))["a.y"][-1] == 12.0


# ---- runs that fail


@EXECUTORS
@pytest.mark.parametrize("status", [2, 3, 4])
def test_a_failing_fmu_ends_the_run_and_everything_before_is_retained(make, executor, status):
    system = make(
        {"counter": "counter", "bad": "failing"},
        parameters={"bad.t_fail": 4.0, "bad.status": status},
    )
    with pytest.raises(RunError) as caught:
        run(system, executor=executor)
    assert str(caught.value) == "bad: step failed: burnt through after too much heat (at t = 4 s)"
    assert (caught.value.component, caught.value.time) == ("bad", 4.0)
    partial = caught.value.partial
    assert not partial.complete
    assert partial.time.tolist() == [0, 1, 2, 3, 4]
    assert partial["counter.n"].tolist() == [0, 1, 2, 3, 4]
    assert partial.message == str(caught.value)


@EXECUTORS
def test_an_output_that_is_not_a_number_ends_the_run_and_is_named(make, executor):
    system = make({"counter": "counter", "bad": "not_a_number"})
    with pytest.raises(
        RunError, match=r"^bad\.y: output is not a finite number \(at t = 3 s\)$"
    ) as caught:
        run(system, executor=executor)
    assert len(caught.value.partial.time) == 4


@EXECUTORS
def test_an_fmu_that_fails_without_a_word_is_reported_by_its_status(make, executor):
    with pytest.raises(
        RunError, match=r"a: step failed: fmi2Error, without a message \(at t = 0 s\)"
    ):
        run(make({"a": "silent"}), executor=executor)


def test_an_old_message_is_not_blamed_for_a_later_failure(make):
    with pytest.raises(RunError, match="burnt through"):
        run(make({"a": "failing"}))
    with pytest.raises(RunError, match="without a message"):
        run(make({"a": "silent"}))


def test_warnings_of_an_fmu_do_not_stop_the_run_and_are_summed_up(make, caplog):
    assert run(make({"a": "warning"})).complete
    assert run(make({"a": "warning"}), stop=1.0).complete
    assert caplog.messages == [
        "a: 6 warnings, the last: getting hot",
        "a: 1 warning, the last: getting hot",
    ]


def test_interrupting_retains_what_was_recorded(make):
    def interrupt(done):
        raise KeyboardInterrupt

    with (
        Simulation(make({"a": "counter"}, stop=1000.0)) as simulation,
        pytest.raises(InterruptionError) as caught,
    ):
        simulation.advance(progress=interrupt)
    assert caught.value.partial.time.tolist() == [0, 1]
    assert "interrupted" in caught.value.partial.message


# ---- loading


@pytest.fixture
def with_library(make, fmus, tmp_path):
    """A system of one gain whose FMU has another file as its library."""

    def make_system(name, content):
        path = tmp_path / "odd.fmu"
        with zipfile.ZipFile(fmus["gain"]) as old, zipfile.ZipFile(path, "w") as new:
            new.writestr("modelDescription.xml", old.read("modelDescription.xml"))
            new.writestr(name, content)
        system = make({"a": "gain"})
        return replace(system, components=(replace(system.components[0], fmu=path),))

    return make_system


def test_an_fmu_without_a_binary_for_this_platform_is_rejected(with_library):
    with pytest.raises(FmuError, match=r"a: odd\.fmu cannot be loaded: it holds no binary"):
        run(with_library("binaries/vax/gain.so", b""))


def test_a_library_that_does_not_load_is_rejected_and_leaves_the_working_directory_alone(
    with_library, fmus
):
    """Its header is right, but nothing follows."""
    before, name = Path.cwd(), f"binaries/{fmpy.platform}/gain{fmpy.sharedLibraryExtension}"
    with zipfile.ZipFile(fmus["gain"]) as good:
        header = good.read(name)[:64]
    with pytest.raises(FmuError, match=r"a: odd\.fmu cannot be loaded: .*gain\.so"):
        run(with_library(name, header))
    assert Path.cwd() == before


def test_instances_of_one_fmu_do_not_share_anything(make):
    result = run(
        make({"a": "counter", "b": "counter"}, parameters={"b.n_0": 10.0}, timing={"b": (2, 0)})
    )
    assert result["a.n"].tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert result["b.n"].tolist() == [10, 11, 11, 12, 12, 13, 13]


def test_unpacked_files_are_removed_after_the_run_and_after_a_failure(make, monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    run(make({"a": "counter"}))
    with pytest.raises(RunError):
        run(make({"a": "failing"}))
    assert list(tmp_path.iterdir()) == []


def test_unknown_executors_and_senseless_thinning_are_wrong_use(make):
    with pytest.raises(UsageError, match="there is no executor fortran, only c, python and fused"):
        simulate(make({"a": "counter"}), executor="fortran")
    with pytest.raises(UsageError, match="--every must be at least 1, not 0"):
        simulate(make({"a": "counter"}), every=0)


def test_a_missing_c_executor_is_reported_clearly(make, monkeypatch):
    monkeypatch.setattr("harness.master.executors.built", lambda _: None)
    with pytest.raises(UsageError, match="the C executor has not been built"):
        simulate(make({"a": "counter"}))
    assert simulate(make({"a": "counter"}), executor="python").complete


def test_a_stop_time_beyond_whole_steps_is_rejected_before_anything_is_loaded(make):
    with pytest.raises(StructureError, match="not a multiple"):
        Simulation(make({"a": "counter"}, stop=6.5))
