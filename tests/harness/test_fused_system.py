# SPDX-License-Identifier: BSD-2-Clause
"""A system compiled into one FMU: the bits of its FMUs one by one, whatever its schedule, its
connections and its end, and the same columns.
"""

from __future__ import annotations

import logging
import math
import shutil
from dataclasses import replace

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu

from harness import Simulation, campaign, load, run
from harness.authoring.build import build
from harness.errors import RunError
from harness.exports.package import export
from harness.files import paths
from harness.system.model import Component, Connection, Experiment, Parameter, Port, System
from harness.system.units import Affine, Hop
from tests.harness.test_warm import same_bits

HEAD = """/* {name}.c - {name}. */
#include "fmu.h"
{body}
FMU_MODEL("{name}", "{name}");
"""

WAVE = """
typedef struct { double rate, limit; } Parameters;
typedef struct { double load[3]; double hold; } Input;
typedef struct { double sum; } State;
typedef struct { double flag; double y[3]; } Output;
MODEL_STRUCT;
static const Model start = {.p = {.rate = 0.1, .limit = 1e9}, .u = {.load = {1, 2, 3}}};
static const Variable variables[] = {
    NONNEGATIVE(rate, "1/s", "rate"), POSITIVE(limit, "1", "limit of the sum"),
    INPUT(load, "1", "load"), SWITCH_INPUT(hold, "1: stands still"),
    OUTPUT(y, "1", "waves"), ALARM(flag, "the sum is above 2"),
};
static void check(const Parameters *p, Problems *problems)
{
    if (p->rate > 5) refuse(problems, "rate", p->rate, "must be <= 5");
}
static void publish(const Parameters *p, const Input *u, const State *x, Output *y)
{
    double over = x->sum - p->limit;
    double root = sqrt(over > 0 ? -over : 0);
    for (int i = 0; i < 3; i++) y->y[i] = x->sum * (i + 1) + u->load[i] / 3 + root;
    y->flag = x->sum > 2;
}
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    x->sum = 0.25 * u->load[1] + t;
    publish(p, u, x, y);
}
static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    if (u->hold == 0) x->sum += p->rate * h * (u->load[0] + u->load[2]) + 1e-3 * (t > 0.5);
    publish(p, u, x, y);
}
"""

SWITCH = """
typedef struct { double level; } Parameters;
typedef struct { double v[3]; } Input;
typedef struct { double count; } State;
typedef struct { double on, gain; } Output;
MODEL_STRUCT;
static const Model start = {.p = {.level = 1.5}};
static const Variable variables[] = {
    PARAMETER(level, "1", "level"), INPUT(v, "1", "signal"),
    FLAG(on, "1: above the level"), OUTPUT(gain, "1", "gain"),
};
static void check(const Parameters *p, Problems *problems) { (void)p, (void)problems; }
static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    (void)t, (void)h;
    x->count += u->v[0];
    y->on = u->v[2] > p->level;
    y->gain = 0.3 * x->count - u->v[1];
}
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    x->count = 0;
    step(p, u, x, y, t, 0);
}
"""


@pytest.fixture(scope="module")
def models(tmp_path_factory):
    folder = tmp_path_factory.mktemp("models")
    for name, body in (("wave", WAVE), ("switch", SWITCH)):
        (folder / f"{name}.c").write_text(HEAD.format(name=name, body=body), encoding="utf-8")
        build(folder / f"{name}.c")
    return {path.stem: path for path in folder.glob("*.fmu")}


def wired(models, algorithm="gauss-seidel", **values):
    """Two waves and a switch in a loop: slow and late ones, an input driven in part, another one
    changed on the way.
    """
    components = (
        Component("slow", models["switch"], {"level": Parameter(6.0)}, every=2, latency=1),
        Component("a", models["wave"], {"rate": Parameter(0.7)}),
        Component("b", models["wave"], {n: Parameter(v) for n, v in values.items()}, every=4),
    )
    changed = (Hop(Affine(-0.01, 0.3)),)
    wires = [
        *((f"a.y[{i}]", f"slow.v[{i}]", ()) for i in (1, 2, 3)),
        ("slow.gain", "a.load[2]", ()),
        ("slow.on", "b.hold", ()),
        ("a.y[3]", "b.load[1]", changed),
        ("b.y[2]", "a.load[1]", changed),
    ]
    connections = tuple(
        Connection(Port(*start.split(".")), Port(*end.split(".")), hops)
        for start, end, hops in wires
    )
    span = Experiment(start=0.25, stop=0.25 + 40 * 0.1, step=0.1, algorithm=algorithm)
    if algorithm == "jacobi":
        components = (replace(components[0], latency=1), *components[1:])
    return System("loop", components, connections, span)


def fly(system, executor, **changes):
    return run(system, executor=executor, in_process=True, **changes)


@pytest.mark.parametrize(
    "algorithm", ["gauss-seidel", pytest.param("jacobi", marks=pytest.mark.long)]
)
def test_slow_late_and_transformed_signals_have_the_bits_of_the_fmus_one_by_one(
    models, algorithm, caplog
):
    system = wired(models, algorithm)
    with Simulation(system, executor="fused") as simulation:
        fused = simulation.fly()
        assert "whole: 2 warnings" in caplog.text  # of a.flag, and of the loop through the start
        assert [i.name for i in simulation.instances] == ["whole"]
        assert same_bits(fused, fly(system, "python"))
        for changes in ({"set": {"b.rate": 0.9, "a.load[3]": 4}}, {"step": 0.05, "stop": 2.25}):
            assert same_bits(simulation.fly(**changes), fly(system, "c", **changes))
        assert len(np.unique(fused["slow.on"])) == 2  # both ways were taken
        assert fused.provenance.executor == "fused"


def test_a_run_that_fails_ends_as_with_the_fmus_one_by_one(models):
    system = wired(models, limit=0.8)
    ends = []
    for executor in ("c", "fused"):
        with pytest.raises(RunError) as caught:
            fly(system, executor)
        ends.append(caught.value)
    assert str(ends[0]) == str(ends[1])
    assert same_bits(ends[0].partial, ends[1].partial)
    with Simulation(wired(models), executor="fused") as simulation:
        with pytest.raises(RunError):
            simulation.fly(set={"b.limit": 0.8})
        assert same_bits(simulation.fly(), fly(wired(models), "c"))


def test_refused_parameters_are_named_as_with_the_fmus_one_by_one(models):
    texts = []
    for executor in ("c", "fused"):
        with pytest.raises(Exception, match=r"b\.rate.*must be <= 5") as caught:
            fly(wired(models), executor, set={"b.rate": 6})
        texts.append(str(caught.value))
    assert texts[0] == texts[1]


def test_only_what_is_wanted_is_recorded_and_the_last_row_is_whole(models):
    system = wired(models)
    whole = fly(system, "c")
    with Simulation(system, executor="fused") as simulation:
        result = simulation.fly_system(system, wanted=["b.y", "slow.on"])
        assert result.columns == ("slow.on", "b.y[1]", "b.y[2]", "b.y[3]")
        assert result["b.y"].tobytes() == np.ascontiguousarray(whole["b.y"]).tobytes()
        assert simulation.last().tobytes() == whole.values[-1].tobytes()
        assert same_bits(simulation.fly(), whole)


def test_what_cannot_be_fused_runs_all_the_same_and_a_line_says_why(
    models, fmus, monkeypatch, caplog
):
    loop = wired(models)
    foreign = replace(loop, components=(Component("count", fmus["counter"]),), connections=())
    foreign = replace(foreign, experiment=replace(foreign.experiment, start=0.0, stop=4.0))
    with caplog.at_level(logging.WARNING):
        assert same_bits(fly(foreign, "fused"), fly(foreign, "c"))
    assert "loop: runs with the executor c: counter.fmu holds no sources" in caplog.text
    caplog.clear()
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with caplog.at_level(logging.WARNING):
        assert same_bits(fly(loop, "fused"), fly(loop, "c"))
    assert "loop: runs with the executor c: there is no C compiler (cc)" in caplog.text


# ---- the file


@pytest.fixture(scope="module")
def whole(models, tmp_path_factory):
    return export(wired(models), tmp_path_factory.mktemp("whole") / "whole.fmu")


@pytest.fixture(scope="module")
def other(models, tmp_path_factory):
    """Equal rows, another order of execution."""
    return export(wired(models, "jacobi"), tmp_path_factory.mktemp("other") / "other.fmu")


def slave(path, folder):
    model = read_model_description(str(path))
    files = extract(str(path), str(folder))
    made = FMU2Slave(
        guid=model.guid,
        unzipDirectory=files,
        modelIdentifier=model.coSimulation.modelIdentifier,
        instanceName="whole",
    )
    made.instantiate()
    return made, {v.name: v.valueReference for v in model.modelVariables}


def begun(path, folder, values=()):
    made, reference = slave(path, folder)
    for name, value in dict(values).items():
        made.setReal([reference[name]], [value])
    made.setupExperiment(startTime=0.25)
    made.enterInitializationMode()
    made.exitInitializationMode()
    return made, reference


def test_the_file_is_valid_and_always_has_the_same_bytes(models, whole, other, tmp_path):
    assert validate_fmu(str(whole)) == []
    assert export(wired(models), tmp_path / "whole.fmu").read_bytes() == whole.read_bytes()
    one, two = (read_model_description(str(path)).guid for path in (whole, other))
    assert one != two


def test_any_master_gets_the_bits_in_steps_of_whole_macro_steps(models, whole, tmp_path):
    ours = fly(wired(models), "c")
    names = list(ours.columns)
    made, reference = begun(whole, tmp_path)
    wanted = [reference[name] for name in names]
    at = 0
    for size in (1, 1, 4, 1, 3, 10):
        made.doStep(0.25 + at * 0.1, size * 0.1)
        at += size
        assert made.getReal(wanted) == ours.values[at].tolist()
    with pytest.raises(Exception, match="fmi2DoStep failed"):
        made.doStep(0.25 + at * 0.1, 0.05)
    made.doStep(0.25 + at * 0.1, 0.1)  # the refused step has done nothing
    assert made.getReal(wanted) == ours.values[at + 1].tolist()


def test_parameters_and_open_inputs_are_there_and_driven_inputs_are_not(models, whole, tmp_path):
    values = {"b.rate": 0.9, "a.load[3]": 4.0, "b.load[2]": 0.5}
    made, reference = begun(whole, tmp_path, values)
    assert "a.load[1]" not in reference
    assert "b.hold" not in reference
    ours = fly(wired(models), "c", set=values)
    for k in range(8):
        made.doStep(0.25 + k * 0.1, 0.1)
    wanted = [reference[name] for name in ours.columns]
    assert made.getReal(wanted) == ours.values[8].tolist()
    made.setReal([reference["a.load[3]"]], [40.0])
    made.doStep(0.25 + 0.8, 0.1)
    sum_now = made.getReal([reference["a.y[1]"]])[0]
    load = made.getReal([reference["b.y[2]"]])[0] * -0.01 + 0.3  # read before b steps again
    before = ours["a.y"][8][0] - load_of(ours, 8) / 3
    assert sum_now - load / 3 - before == pytest.approx(0.7 * 0.1 * (load + 40) + 1e-3, rel=1e-9)


def load_of(ours, row):
    """What a.load[1] was over the macro step that ended in this row: b.y[2] then, changed."""
    return -0.01 * ours["b.y"][row - 1][1] + 0.3


def test_states_bring_a_run_back_and_other_systems_refuse_them(whole, other, tmp_path):
    made, reference = begun(whole, tmp_path / "a")
    every = [reference[f"a.y[{i}]"] for i in (1, 2, 3)] + [reference["slow.gain"]]
    for k in range(3):
        made.doStep(0.25 + k * 0.1, 0.1)
    state = made.getFMUState()
    data = made.serializeFMUState(state)
    futures = []
    for _ in range(2):
        for k in range(3, 12):
            made.doStep(0.25 + k * 0.1, 0.1)
        futures.append(made.getReal(every))
        made.setFMUState(made.deserializeFMUState(data))
    assert futures[0] == futures[1]
    stranger, _ = begun(other, tmp_path / "b")
    with pytest.raises(Exception, match="fmi2DeSerializeFMUstate failed"):
        stranger.deserializeFMUState(data)


def test_derivatives_are_those_of_one_macro_step(whole, tmp_path):
    made, reference = begun(whole, tmp_path)
    made.doStep(0.25, 0.1)
    found = made.getDirectionalDerivative([reference["a.y[2]"]], [reference["a.load[3]"]], [1.0])
    assert found[0] == pytest.approx(2 * 0.7 * 0.1, rel=1e-9)


# ---- campaigns


def test_a_campaign_has_the_same_dataset_whoever_performs_its_steps(tmp_path):
    sets = []
    for executor in ("c", "fused"):
        table = {
            "system": "space_robot",
            "runs": 4,
            "executor": executor,
            "fixed": {"stop": 200.0},
            "factors": {"robot.e": {"uniform": {"low": 0.1, "high": 0.3}}},
            "metrics": {
                "rate": "max(norm(robot.omega_SN_S))",
                "pitch": "robot.pitch[-1]",
                "mine": f"{tmp_path}/mine.py:sometimes",
            },
            "keep": {"bands": ["robot.joint_angle"]},
        }
        sets.append(table)
    (tmp_path / "mine.py").write_text(MINE, encoding="utf-8")
    data = [
        campaign(table, tmp_path / f"{k}.zarr", workers=0).data.load()
        for k, table in enumerate(sets)
    ]
    assert set(data[0]) == set(data[1])
    for name in data[0]:
        assert data[0][name].values.tobytes() == data[1][name].values.tobytes(), name
    assert np.isfinite(data[0]["mine"].values.astype(float)).all()


MINE = '''
def sometimes(result):
    """Not always the same variable: the other one may not have been recorded."""
    e = float(result.parameter("robot.e"))
    name = "robot.true_anomaly" if e > 0.2 else "robot.h_N"
    return float(abs(result[name]).max())
'''


# ---- the systems of the project

FEW = ("space_robot", "transposition")
"""One with slow initialization in scratch memory; the others are compiled in the long tests."""


@pytest.mark.parametrize(
    "name",
    [pytest.param(n, marks=() if n in FEW else pytest.mark.long) for n in sorted(paths.systems())],
)
def test_every_system_has_the_bits_of_its_fmus_one_by_one(name):
    with load(name) as system, Simulation(system, executor="fused") as simulation:
        cycle = math.lcm(*(c.every for c in system.components))
        span = system.experiment
        stop = span.start + max(20 // cycle, 3) * cycle * span.step
        assert same_bits(simulation.fly(stop=stop), run(system, stop=stop))
        assert [i.name for i in simulation.instances] == ["whole"]
        assert simulation._folder is None  # unpacked once for all, in the cache


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(paths.systems()))
def test_the_default_run_of_every_system_has_the_same_bits(name):
    with load(name) as system, Simulation(system, executor="fused") as simulation:
        assert same_bits(simulation.fly(), run(name))
        assert [i.name for i in simulation.instances] == ["whole"]
