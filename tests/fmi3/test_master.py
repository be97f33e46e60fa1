# SPDX-License-Identifier: BSD-2-Clause
"""The master with FMUs of FMI 3.0, alone, among FMUs of FMI 2.0, and from elsewhere."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness import run
from harness.errors import FmuError, HarnessError, RunError, StructureError
from harness.files import paths
from harness.master.changes import apply
from harness.master.simulation import Simulation
from harness.ssp.library import load
from harness.studies.linearize import linearize
from harness.system.graph import build_graph
from harness.system.interface import read_interface
from harness.system.model import Component, Connection, Experiment, Port, System
from tests.compliance.fmus import BUILD
from tests.fmi3 import odd, probe
from tests.fmi3.odd import Model, Var

SYSTEM = "sync_approach"
needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="there is no gcc")
needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")


def of_fmi_3(system, chosen=lambda i: True):
    """The system with the FMUs of FMI 3.0 in the places that are chosen."""
    return replace(
        system,
        components=tuple(
            replace(c, fmu=BUILD / "fmus3" / c.fmu.name) if chosen(i) else c
            for i, c in enumerate(system.components)
        ),
    )


def rows(system, executor="c", **changes):
    with Simulation(system, executor=executor, **changes) as simulation:
        simulation.advance()
        return simulation.recorder.rows.tobytes()


def differences(name, **changes):
    """In which way a system with FMUs of FMI 3.0 gives other bits."""
    with load(name) as system:
        expected = rows(system, **changes)
        half = of_fmi_3(system, lambda i: i % 2 == 0)
        found = {
            "all": rows(of_fmi_3(system), **changes),
            "half": rows(half, **changes),
            "half, python": rows(half, "python", **changes),
        }
    return [way for way, bits in found.items() if bits != expected]


def test_a_mixed_system_gives_the_bits_of_fmi_2():
    assert differences(SYSTEM, stop=5.0) == []


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(paths.systems()))
def test_every_system_gives_the_bits_of_fmi_2(name):
    assert differences(name) == []


def test_another_system_would_give_other_bits():
    with load(SYSTEM) as system:
        assert rows(system, stop=1.0) != rows(
            of_fmi_3(system), stop=1.0, set=["target.omega_TN_T_0[1]=0.09"]
        )


def test_a_swap_works_across_versions_of_fmi():
    plain = run(SYSTEM, stop=2.0)
    path = BUILD / "fmus3/sync_guidance.fmu"
    swapped = run(SYSTEM, stop=2.0, swap={"guidance": str(path)})
    np.testing.assert_array_equal(plain["guidance.range"], swapped["guidance.range"])
    np.testing.assert_array_equal(plain["servicer.r_SN_N"], swapped["servicer.r_SN_N"])


def test_elements_of_an_array_are_set_one_by_one():
    """Variables that are not set retain their start values."""
    values = ["servicer.r_0_N[2]=4.5", "target.omega_TN_T_0[1]=0.02"]
    with load(SYSTEM) as system:
        assert rows(system, stop=1.0, set=values) == rows(of_fmi_3(system), stop=1.0, set=values)


def test_a_rejected_parameter_is_named():
    with load(SYSTEM) as system, pytest.raises(HarnessError, match="mass_0=-5: must be > 0"):
        rows(of_fmi_3(system), stop=1.0, set=["servicer.mass_0=-5"])


def test_states_are_saved_and_restored():
    with load(SYSTEM) as system, Simulation(of_fmi_3(system), stop=4.0) as simulation:
        simulation.advance(to=20)
        saved = simulation.save()
        simulation.advance()
        expected = simulation.recorder.rows.tobytes()
        simulation.restore(saved)
        simulation.advance()
        assert simulation.recorder.rows.tobytes() == expected


def test_a_further_run_gives_the_bits_of_a_fresh_one():
    with load(SYSTEM) as system:
        mixed = of_fmi_3(system, lambda i: i % 2 == 1)
        with Simulation(mixed, stop=2.0) as simulation:
            first = simulation.run(stop=2.0)["servicer.r_SN_N"]
            simulation.run(stop=2.0, set=["servicer.mass_0=120"])
            again = simulation.run(stop=2.0)["servicer.r_SN_N"]
    np.testing.assert_array_equal(first, again)


def test_a_linear_model_has_the_numbers_of_fmi_2():
    two, three = (linearize(BUILD / folder / "target.fmu", at=0.5) for folder in ("fmus", "fmus3"))
    for matrix in "ABCD":
        np.testing.assert_array_equal(getattr(two, matrix), getattr(three, matrix))
    assert two.point == three.point


@needs_compiler
@pytest.mark.parametrize("name", ["space_robot", pytest.param(SYSTEM, marks=pytest.mark.long)])
def test_a_whole_system_is_one_fmu_of_fmi_3(tmp_path, name):
    from harness import export

    with load(name) as found:
        system = apply(found, step=0.1, stop=2.0)
        with Simulation(system) as simulation:
            simulation.advance()
            expected, slots = simulation.recorder.rows.copy(), simulation.graph.slots
        whole = export(of_fmi_3(system, lambda i: i % 2 == 0), tmp_path / "whole.fmu", fmi=3)
    assert probe.failures(whole) == []
    fmu = probe.Fmu(whole, tmp_path / "unpacked")
    place = {}
    for v in fmu.of("output"):
        shape = [int(e.get("start")) for e in _element(fmu, v.name).iter("Dimension")]
        for k in range(v.size):
            index = [str(i + 1) for i in np.unravel_index(k, shape)] if shape else []
            place[v.name + (f"[{','.join(index)}]" if index else "")] = len(place)
    order = [place[slot.name] for slot in slots]
    with probe.Instance(fmu) as one:
        one.start()
        for k in range(20):
            assert one.step(0.1 * k)[0] == probe.OK
            np.testing.assert_array_equal(
                np.frombuffer(one.outputs())[order], expected[k + 1], strict=True
            )


def _element(fmu, name):
    return next(e for e in fmu.root.find("ModelVariables") if e.get("name") == name)


@needs_compiler
def test_a_controller_is_built_for_fmi_3(tmp_path):
    from harness.authoring.build import build

    source = tmp_path / "my_controller.c"
    shutil.copy(Path(__file__).parents[2] / "examples/my_controller.c", source)
    assert read_interface(build(source, tmp_path / "mine.fmu", fmi=3)).fmi == 3
    assert probe.failures(tmp_path / "mine.fmu") == []


# ---- from elsewhere

ALL = Model(
    "every",
    (
        Var("n", "UInt64", "structuralParameter", "3"),
        Var("u", "Float64", "input", "1 2 3", 3, "n"),
        Var("y", "Float64", "output", size=3, by="n"),
        *(
            Var(f"{kind}_{way}", kind, f"{way}put", "1")
            for kind in (*odd.NUMBERS, "Boolean", "Enumeration") for way in ("in", "out")
        ),
        Var("label", "String", "parameter", "hello"),
        Var("data", "Binary", "input"),
        Var("picture", "Binary", "output"),
        Var("gain", "Float64", "parameter", "2 3", 2),
    ),
    "for (int i = 0; i < 3; i++) y[i] = gain[0] * u[i] + gain[1];"
    + "".join(f"{k}_out = {k}_in;" for k in (*odd.NUMBERS, "Boolean", "Enumeration")),
)  # fmt: skip
COUNT = Model(
    "count",
    (
        Var("c", "Float64", "output"), Var("n", "Int64", "output"), Var("wide", "UInt64", "output"),
        Var("flag", "Boolean", "output"), Var("colour", "Enumeration", "output"),
        Var("big", "Float64", "parameter"), Var("stop_at", "Float64", "parameter", "1e9"),
        Var("early_at", "Float64", "parameter", "1e9"),
        Var("fail_at", "Float64", "parameter", "1e9"), Var("single", "Float32", "output"),
        Var("lost_at", "Float64", "parameter", "1e9"),
    ),
    "c += 1; n = (fmi3Int64)c; wide = (fmi3UInt64)(big * c) + (c > 3 && big > 0); "
    "single = t >= lost_at ? (fmi3Float32)NAN : 1; "
    "flag = n % 2; colour = n % 2 ? 1 : 7; *terminate = t >= stop_at; *early = t >= early_at;"
    'if (t >= fail_at) return fail(self, "burnt, 100 % of fuse");',
)  # fmt: skip
KINDS = {
    **dict.fromkeys(("Float64", "Float32"), "c"),
    **{kind: "n" for kind in odd.NUMBERS if "Int" in kind},
    "Boolean": "flag",
    "Enumeration": "colour",
}


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    if shutil.which("gcc") is None:
        pytest.skip("there is no gcc")
    folder = tmp_path_factory.mktemp("odd")
    return {model.name: odd.build(model, folder) for model in (ALL, COUNT)}


def system_of(components, wires=(), **values):
    """A system of FMUs by name."""
    from harness.system.model import Parameter

    parameters = {name: {} for name in components}
    for key, value in values.items():
        component, _, name = key.partition("__")
        parameters[component][name] = Parameter(value)
    return System(
        name="odd",
        components=tuple(
            Component(name, path, parameters=parameters[name]) for name, path in components.items()
        ),
        connections=tuple(Connection(Port(*a.split(".")), Port(*b.split("."))) for a, b in wires),
        experiment=Experiment(0.0, 1.0, 0.1),
    )


def simulated(system, executor):
    with Simulation(system, executor=executor) as simulation:
        simulation.advance()
        return simulation.result()


@pytest.mark.parametrize("executor", ["c", "python"])
def test_all_types_go_over_the_bus(built, executor):
    wires = [(f"count.{source}", f"every.{kind}_in") for kind, source in KINDS.items()]
    wires += [("count.c", "every.u[2]")]
    system = system_of({"count": built["count"], "every": built["every"]}, wires)
    system = replace(system, strict=False)
    result = simulated(system, executor)
    for kind, source in KINDS.items():
        sent, got = result[f"count.{source}"], result[f"every.{kind}_out"]
        assert got[-1] in (sent[-1], sent[-2])
    y = result["every.y"][-1]
    assert (y[0], y[2]) == (2 * 1 + 3, 2 * 3 + 3)
    assert y[1] in (2 * result["count.c"][-1] + 3, 2 * result["count.c"][-2] + 3)


@pytest.mark.parametrize("executor", ["c", "python"])
def test_a_single_precision_output_that_is_not_a_number_is_named(built, executor):
    system = system_of({"count": built["count"]}, count__lost_at=0.45)
    with pytest.raises(RunError, match=r"^count\.single: output is not a finite number"):
        simulated(system, executor)


def test_both_executors_agree(built):
    wires = [(f"count.{source}", f"every.{kind}_in") for kind, source in KINDS.items()]
    system = system_of({"count": built["count"], "every": built["every"]}, wires)
    system = replace(system, strict=False)
    assert rows(system, "c") == rows(system, "python")


@pytest.mark.parametrize("executor", ["c", "python"])
@pytest.mark.parametrize(
    ("values", "line"),
    [
        ({"count__stop_at": 0.3}, r"^count: requested termination \(at t = 0.3 s\)"),
        (
            {"count__early_at": 0.3},
            r"^count: returned early although that was not allowed \(at t = 0.3 s\)",
        ),
        ({"count__fail_at": 0.5}, r"^count: step failed: burnt, 100 % of fuse \(at t = 0.5"),
        (
            {"count__big": 2.0**53},
            r"^count: wide = 36028797018963969: is beyond 2\^53 and not exact as a double",
        ),
    ],
)
def test_a_step_that_reports_an_end_ends_the_run(built, executor, values, line):
    system = system_of({"count": built["count"]}, **values)
    with pytest.raises(RunError, match=line) as caught:
        simulated(system, executor)
    assert caught.value.partial is not None


def test_binary_variables_run_unconnected(built):
    interface = read_interface(built["every"])
    assert interface.variables["data"].type == "Binary"
    assert "picture" not in interface.outputs()
    system = replace(system_of({"every": built["every"]}), strict=False)
    assert simulated(system, "c").time[-1] == 1.0


def test_binary_variables_cannot_be_connected(built):
    system = system_of({"a": built["every"], "b": built["every"]}, [("a.picture", "b.data")])
    with pytest.raises(StructureError, match=r"has type Binary, cannot be driven by a\.picture"):
        build_graph(system)


def test_structural_parameters_cannot_be_set(built):
    line = "every.n: is a structuralParameter and cannot be set"
    with pytest.raises(StructureError, match=line):
        build_graph(system_of({"every": built["every"]}, every__n=5))


@pytest.mark.parametrize(
    ("name", "value", "line"),
    [
        ("UInt8_in", 256, "256 is beyond UInt8, 0 to 255"),
        ("Int16_in", -32769, "-32769 is beyond Int16, -32768 to 32767"),
        ("Int64_in", 2**63, "is beyond Int64"),
        ("Boolean_in", 2, "2 is not true or false"),
        ("Int32_in", 0.5, "0.5 is not a whole number"),
    ],
)
def test_values_fit_their_types(built, name, value, line):
    system = replace(
        system_of({"every": built["every"]}, **{f"every__{name}": value}), strict=False
    )
    with pytest.raises(StructureError, match=f"every.{name}: .*{line}"):
        build_graph(system)


def test_whole_numbers_beyond_the_bus_can_be_set(built):
    """They do not go over it; the outputs of the FMU are checked."""
    system = replace(system_of({"every": built["every"]}, every__Int64_in=2**53 + 1), strict=False)
    with pytest.raises(RunError, match="every: Int64_out = 9007199254740993: is beyond 2"):
        simulated(system, "c")


@needs_gcc
def test_clocks_of_inputs_and_outputs_are_rejected(tmp_path):
    clock = Var("tick", "Clock", "input")
    clocked = Var("y", "Float64", "output", more=' variability="discrete" clocks="1"')
    path = odd.build(Model("clocked", (clock, clocked)), tmp_path)
    with pytest.raises(FmuError, match="tick: clocks are not supported, but y has this clock"):
        read_interface(path)


@needs_gcc
def test_other_clocks_are_left_out_and_reported(tmp_path):
    path = odd.build(
        Model("ticking", (Var("tick", "Clock", "input"), Var("y", "Float64", "output"))), tmp_path
    )
    interface = read_interface(path)
    assert "tick" not in interface.variables
    assert "tick: clocks are not supported; the variable is omitted" in interface.warnings
    assert simulated(system_of({"a": path}), "c").time[-1] == 1.0


@needs_gcc
@pytest.mark.parametrize(
    ("kind", "words"),
    [("ModelExchange", "model exchange"), ("ScheduledExecution", "scheduled execution")],
)
def test_other_interfaces_are_rejected(tmp_path, kind, words):
    path = odd.build(Model("other", (Var("y", "Float64", "output"),), interface=kind), tmp_path)
    line = f"other.fmu: supports {words} only; export it for co-simulation"
    with pytest.raises(FmuError, match=line):
        read_interface(path)
