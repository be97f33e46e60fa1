# SPDX-License-Identifier: BSD-2-Clause
"""A system compiled into one FMU: the bits of its FMUs one by one, for any schedule, connections
and end, and the same columns.
"""

from __future__ import annotations

import json
import logging
import math
import os
import re
import shutil
import subprocess
import sys
import zipfile
from dataclasses import replace
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu

from harness import Simulation, campaign, load, run
from harness.authoring.build import build
from harness.authoring.export import export
from harness.errors import FmuError, RunError
from harness.files import paths
from harness.files.archive import pack, read_all
from harness.master import fused
from harness.report import live
from harness.spelling import first_error
from harness.system.graph import checked
from harness.system.interface import unpacked_sources
from harness.system.model import Component, Connection, Experiment, Parameter, Port, System
from harness.system.units import Affine, Hop
from tests.harness.studies.test_reuse import same_bits

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
    if (p->rate > 5) reject(problems, "rate", p->rate, "must be <= 5");
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


def simulate_case(system, executor, **changes):
    return run(system, executor=executor, in_process=True, **changes)


@pytest.mark.parametrize(
    "algorithm", ["gauss-seidel", pytest.param("jacobi", marks=pytest.mark.long)]
)
def test_slow_late_and_transformed_signals_have_the_bits_of_the_fmus_one_by_one(
    models, algorithm, caplog
):
    system = wired(models, algorithm)
    with Simulation(system, executor="fused") as simulation:
        fused = simulation.run()
        assert "whole: 2 warnings" in caplog.text  # of a.flag, and of the loop through the start
        assert [i.name for i in simulation.instances] == ["whole"]
        assert same_bits(fused, simulate_case(system, "python"))
        for changes in ({"set": {"b.rate": 0.9, "a.load[3]": 4}}, {"step": 0.05, "stop": 2.25}):
            assert same_bits(simulation.run(**changes), simulate_case(system, "c", **changes))
        assert len(np.unique(fused["slow.on"])) == 2  # both ways were taken
        assert fused.provenance.executor == "fused"


def test_a_run_that_fails_ends_as_with_the_fmus_one_by_one(models):
    system = wired(models, limit=0.8)
    ends = []
    for executor in ("c", "fused"):
        with pytest.raises(RunError) as caught:
            simulate_case(system, executor)
        ends.append(caught.value)
    assert str(ends[0]) == str(ends[1])
    assert same_bits(ends[0].partial, ends[1].partial)
    with Simulation(wired(models), executor="fused") as simulation:
        with pytest.raises(RunError):
            simulation.run(set={"b.limit": 0.8})
        assert same_bits(simulation.run(), simulate_case(wired(models), "c"))


def test_rejected_parameters_are_named_as_with_the_fmus_one_by_one(models):
    texts = []
    for executor in ("c", "fused"):
        with pytest.raises(Exception, match=r"b\.rate.*must be <= 5") as caught:
            simulate_case(wired(models), executor, set={"b.rate": 6})
        texts.append(str(caught.value))
    assert texts[0] == texts[1]


def test_only_what_is_required_is_recorded_and_the_last_row_is_whole(models):
    system = wired(models)
    whole = simulate_case(system, "c")
    with Simulation(system, executor="fused") as simulation:
        result = simulation.run_system(system, recorded=["b.y", "slow.on"])
        assert result.columns == ("slow.on", "b.y[1]", "b.y[2]", "b.y[3]")
        assert result["b.y"].tobytes() == np.ascontiguousarray(whole["b.y"]).tobytes()
        assert simulation.last().tobytes() == whole.values[-1].tobytes()
        assert same_bits(simulation.run(), whole)


def test_a_system_that_cannot_be_fused_runs_nevertheless_and_a_line_states_why(
    models, fmus, monkeypatch, caplog
):
    loop = wired(models)
    third_party = replace(loop, components=(Component("count", fmus["counter"]),), connections=())
    third_party = replace(
        third_party, experiment=replace(third_party.experiment, start=0.0, stop=4.0)
    )
    with caplog.at_level(logging.WARNING):
        assert same_bits(simulate_case(third_party, "fused"), simulate_case(third_party, "c"))
    reason = "counter.fmu does not contain the C sources of a model of this project"
    assert f"loop: cannot be fused, so it runs with the executor c: {reason}" in caplog.text
    caplog.clear()
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with caplog.at_level(logging.WARNING):
        assert same_bits(simulate_case(loop, "fused"), simulate_case(loop, "c"))
    reason = "there is no C compiler (cc)"
    assert f"loop: cannot be fused, so it runs with the executor c: {reason}" in caplog.text


def test_a_linker_that_fails_without_the_word_error_states_why():
    output = "/usr/bin/ld: cannot find -lc: Too many open files\ncollect2: error: ld returned 1"
    assert first_error(output) == "ld: cannot find -lc: Too many open files"
    assert first_error("x.c: In function f:\n/a/x.c:3:1: error: no") == "x.c:3:1: error: no"


# ---- third-party sources


CONSTRUCTOR = """
int {function};
int open(const char *path, int flags, ...);
long write(int file, const void *bytes, unsigned long count);
__attribute__((constructor)) static void begin(void)
{{
    {body}
}}
"""


def alone(fmu):
    """A system of one component."""
    span = Experiment(start=0.0, stop=1.0, step=0.1, algorithm="gauss-seidel")
    return System("alone", (Component("a", fmu),), (), span)


def with_sources(fmu, folder, text="", **files):
    """A copy of an FMU with more C at the end of its model, which its binary does not have, and
    with further files in its sources.
    """
    content = read_all(fmu)
    content[f"sources/{fmu.stem}.c"] += text.encode() + b"\n"
    content |= {f"sources/{name}.h": file.encode() for name, file in files.items()}
    pack(folder / fmu.name, content)
    return folder / fmu.name


def fused_in_every_way(system, folder):
    """A system in a run, a campaign and an FMU of the whole; the warnings are not looked at."""
    path = export(system, folder / "loop.ssp")
    run(path, executor="fused")
    table = {"system": str(path), "runs": 2, "executor": "fused"}
    factors = {"factors": {"a.rate": {"uniform": {"low": 0.1, "high": 0.3}}}}
    campaign(table | factors, folder / "runs.zarr", workers=0)
    export(path, folder / "whole.fmu")


posix = pytest.mark.skipif(os.name != "posix", reason="sessions and signals of POSIX")


@posix
def test_third_party_sources_reach_neither_other_folders_nor_the_session_of_the_harness(
    models, tmp_path
):
    """A child process has a session of its own."""
    trace, target = tmp_path / "trace", tmp_path / "outside.h"
    body = f"""int own = getsid(0), file = open("{trace}", 02101, 0600);
    write(file, &own, sizeof own);"""
    text = CONSTRUCTOR.format(function="getsid(int process)", body=body)
    bad = with_sources(models["wave"], tmp_path, text)
    with zipfile.ZipFile(bad, "a") as archive:
        archive.writestr(f"sources/{target}", "mine")
    fused_in_every_way(alone(bad), tmp_path)
    assert not target.exists()
    sessions = np.frombuffer(trace.read_bytes(), dtype=np.int32)
    assert len(sessions) > 3
    assert os.getsid(0) not in sessions


@posix
def test_a_constructor_that_ends_all_that_it_can_reach_costs_a_line(models, tmp_path):
    text = CONSTRUCTOR.format(function="kill(int process, int signal)", body="kill(0, 9);")
    bad = with_sources(models["wave"], tmp_path, text)
    export(alone(bad), tmp_path / "loop.ssp")
    command = [sys.executable, "-m", "harness", "export", "loop.ssp", "whole.fmu"]
    done = subprocess.run(
        command, cwd=tmp_path, check=False, capture_output=True, text=True, start_new_session=True
    )
    assert done.returncode == 1
    assert "the process of third-party FMUs crashed (SIGKILL" in done.stderr.splitlines()[-1]
    assert not (tmp_path / "whole.fmu").exists()


@pytest.mark.parametrize("name", ["../../../outside.c", "{folder}/outside.c", "missing.c", ""])
def test_a_listed_source_outside_the_archive_is_not_compiled(models, tmp_path, name):
    (tmp_path / "outside.c").write_text("int here;", encoding="utf-8")
    name = name.format(folder=tmp_path)
    path = tmp_path / "wave.fmu"
    files = read_all(models["wave"])
    xml = files["modelDescription.xml"]
    files["modelDescription.xml"] = xml.replace(
        b'File name="wave.c"', f'File name="{name}"'.encode()
    )
    assert files["modelDescription.xml"] != xml
    pack(path, files)
    with pytest.raises(FmuError, match=r"lists the source '.*', which the FMU lacks"):
        unpacked_sources(path, tmp_path / "unpacked")


@posix
def test_a_live_page_compiles_third_party_sources_in_a_child_process(models, monkeypatch):
    def compiled_by(*_):
        raise FmuError(str(os.getpid()))

    monkeypatch.setattr(live, "module_of", compiled_by)
    with pytest.raises(FmuError) as caught:
        live._page(None, alone(models["wave"]))
    assert int(str(caught.value)) != os.getpid()


def test_the_first_error_of_the_compiler_states_why_a_system_cannot_be_fused(
    models, tmp_path, caplog
):
    """With the name of the FMU, for errors of the compiler, of the linker, and of a program."""
    crash = CONSTRUCTOR.format(function="abort(void)", body="abort();")
    shout = CONSTRUCTOR.format(function="puts(const char *)", body='puts("row 1");')
    wrong = {
        '#include "deep.h"': r"deep\.h:2:11: error: .*soon.*",
        '#include "nowhere/none.h"': r"wave\.c:\d+:10: fatal error: none\.h: No such.*",
        "int nothing(void); int here(void) { return nothing(); }": (
            r".*undefined reference to `nothing'"
        ),
        crash: r"layout ended with status -6",
        shout: r"the memory layout of its model cannot be read; .* must print nothing themselves",
    }
    for text, reason in wrong.items():
        bad = with_sources(models["wave"], tmp_path, text, deep="int one;\nint two = soon;\n")
        caplog.clear()
        run(alone(bad), executor="fused")
        (found,) = [m for m in caplog.messages if "runs with the executor c" in m]
        head = "alone: cannot be fused, so it runs with the executor c: "
        assert re.fullmatch(rf"{head}wave\.fmu: {reason}", found)


# ---- the file


@pytest.mark.skipif(shutil.which("objdump") is None, reason="objdump is not installed")
def test_no_product_is_fused_with_a_sum(models, tmp_path):
    """A fused multiplication and addition rounds once, which gives other bits."""
    system = wired(models)
    file = fused.Whole(system, checked(system).graph).interface.path
    library = Path(extract(str(file), str(tmp_path))) / "binaries" / "linux64" / "whole.so"
    listing = subprocess.run(
        ["objdump", "-d", library], capture_output=True, text=True, check=True
    ).stdout
    assert "mulsd" in listing
    assert not re.search(r"\bvfn?m(add|sub)", listing)


@pytest.fixture(scope="module")
def whole(models, tmp_path_factory):
    return export(wired(models), tmp_path_factory.mktemp("whole") / "whole.fmu")


@pytest.fixture(scope="module")
def other(models, tmp_path_factory):
    """Equal rows, another order of execution, and the date of an epoch."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOURCE_DATE_EPOCH", "86400")
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
    one, two = (read_model_description(str(path)) for path in (whole, other))
    assert one.guid != two.guid
    assert two.generationDateAndTime == "1970-01-02T00:00:00Z" != one.generationDateAndTime


@pytest.mark.parametrize("fmi", [2, pytest.param(3, marks=pytest.mark.long)])
def test_the_file_states_its_version_date_system_and_what_it_was_made_of(
    fmi, tmp_path, monkeypatch
):
    monkeypatch.delenv("SOURCE_DATE_EPOCH", raising=False)
    changes = {"params": "circular", "set": {"joints.lock_from": 90.0}}
    file = export("space_robot", tmp_path / "my-name.fmu", fmi, **changes)
    model = read_model_description(str(file))
    ours = read_model_description(str(paths.fmus()["space_robot"]))
    assert model.modelName == model.coSimulation.modelIdentifier == "space_robot"
    assert model.version == ours.version == version("servicing-fmus")
    assert model.generationTool == f"servicing-fmus {model.version}"
    assert model.generationDateAndTime == ours.generationDateAndTime
    with load("space_robot") as system:
        assert model.description == " ".join(system.description.split())
        names = [(c.name, c.fmu.name) for c in system.components]
    made = json.loads(read_all(file)["extra/io.github.servicing-fmus/provenance.json"])
    assert (made["system"], made["params"]) == ("space_robot", "circular")
    assert made["set"] == [["joints.lock_from", 90.0]]
    assert [(part["component"], part["fmu"]) for part in made["fmus"]] == names
    robot = made["fmus"][[name for name, _ in names].index("robot")]
    assert (robot["guid"], robot["version"]) == (ours.guid, ours.version)
    assert robot["sha256"] == sha256(paths.fmus()["space_robot"].read_bytes()).hexdigest()


def test_any_master_gets_the_bits_in_steps_of_whole_macro_steps(models, whole, tmp_path):
    ours = simulate_case(wired(models), "c")
    names = list(ours.columns)
    made, reference = begun(whole, tmp_path)
    required = [reference[name] for name in names]
    at = 0
    for size in (1, 1, 4, 1, 3, 10):
        made.doStep(0.25 + at * 0.1, size * 0.1)
        at += size
        assert made.getReal(required) == ours.values[at].tolist()
    with pytest.raises(Exception, match="fmi2DoStep failed"):
        made.doStep(0.25 + at * 0.1, 0.05)
    made.doStep(0.25 + at * 0.1, 0.1)  # the rejected step has done nothing
    assert made.getReal(required) == ours.values[at + 1].tolist()


def test_parameters_and_open_inputs_are_there_and_driven_inputs_are_not(models, whole, tmp_path):
    values = {"b.rate": 0.9, "a.load[3]": 4.0, "b.load[2]": 0.5}
    made, reference = begun(whole, tmp_path, values)
    assert "a.load[1]" not in reference
    assert "b.hold" not in reference
    ours = simulate_case(wired(models), "c", set=values)
    for k in range(8):
        made.doStep(0.25 + k * 0.1, 0.1)
    required = [reference[name] for name in ours.columns]
    assert made.getReal(required) == ours.values[8].tolist()
    made.setReal([reference["a.load[3]"]], [40.0])
    made.doStep(0.25 + 0.8, 0.1)
    sum_now = made.getReal([reference["a.y[1]"]])[0]
    load = made.getReal([reference["b.y[2]"]])[0] * -0.01 + 0.3  # read before b steps again
    before = ours["a.y"][8][0] - load_of(ours, 8) / 3
    assert sum_now - load / 3 - before == pytest.approx(0.7 * 0.1 * (load + 40) + 1e-3, rel=1e-9)


def load_of(ours, row):
    """Value of a.load[1] over the macro step that ended in this row: b.y[2] then, changed."""
    return -0.01 * ours["b.y"][row - 1][1] + 0.3


def test_states_bring_a_run_back_and_other_systems_reject_them(whole, other, tmp_path):
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


def test_derivatives_match_one_macro_step(whole, tmp_path):
    made, reference = begun(whole, tmp_path)
    made.doStep(0.25, 0.1)
    found = made.getDirectionalDerivative([reference["a.y[2]"]], [reference["a.load[3]"]], [1.0])
    assert found[0] == pytest.approx(2 * 0.7 * 0.1, rel=1e-9)


# ---- campaigns


def test_a_campaign_has_the_same_dataset_with_every_executor(tmp_path):
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
                "pitch": "last(robot.pitch)",
                "mine": f"{tmp_path}/mine.py:sometimes",
            },
            "record": {"bands": ["robot.joint_angle"]},
        }
        sets.append(table)
    (tmp_path / "mine.py").write_text(MINE, encoding="utf-8")
    data = [
        campaign(table, tmp_path / f"{k}.zarr", workers=0).data.load()
        for k, table in enumerate(sets)
    ]
    assert set(data[0]) == set(data[1])
    for name in data[0]:
        one, two = (each[name].values for each in data)
        equal = (
            one.tolist() == two.tolist() if one.dtype == object else one.tobytes() == two.tobytes()
        )
        assert equal, name
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
        assert same_bits(simulation.run(stop=stop), run(system, stop=stop))
        assert [i.name for i in simulation.instances] == ["whole"]
        assert simulation._folder is None  # unpacked once for all, in the cache


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(paths.systems()))
def test_the_default_run_of_every_system_has_the_same_bits(name):
    with load(name) as system, Simulation(system, executor="fused") as simulation:
        assert same_bits(simulation.run(), run(name))
        assert [i.name for i in simulation.instances] == ["whole"]
