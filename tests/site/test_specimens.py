# SPDX-License-Identifier: BSD-2-Clause
"""Specimens of FMI 3.0 for makers of tools: a small master with all that they need, and FMPy and
the harness where they can, get the expected traces.
"""

from __future__ import annotations

import zipfile
from contextlib import closing

import fmpy
import numpy as np
import pytest
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu

from harness import run
from harness.errors import FmuError
from harness.system.interface import read_interface
from harness.system.model import Component, Experiment, System
from tests.compiled import compiled
from tests.fmi3.odd import HEADERS
from tests.site.scripts import script

specimens = script("specimens")
NAMES = tuple(specimens.TRACES)
STEP = 0.25


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Path of every specimen, compiled with all warnings as errors."""
    folder = tmp_path_factory.mktemp("specimens")
    found = {}
    for name in NAMES:
        files = specimens.contents(name, {})
        for path, data in files.items():
            if path.startswith("sources/"):
                (folder / path.partition("/")[2]).write_bytes(data)
        library = folder / f"{name}{fmpy.sharedLibraryExtension}"
        flags = ("-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow")
        quiet = ("-Wno-unused-parameter", "-Werror", "-O1", f"-isystem{HEADERS}", f"-I{folder}")
        compiled(folder / f"{name}.c", library, *flags, *quiet)
        found[name] = folder / f"{name}.fmu"
        files[f"binaries/{fmpy.platform_tuple}/{library.name}"] = library.read_bytes()
        with zipfile.ZipFile(found[name], "w") as archive:
            for path, data in files.items():
                archive.writestr(path, data)
    return found


class Master:
    """Steps to the next multiple of the step, or to an event; outputs of the trace are recorded
    before and after the events of an instant.
    """

    def __init__(self, path, folder, *, events=True):
        self.about = read_model_description(str(path))
        self.vr = {v.name: v.valueReference for v in self.about.modelVariables}
        self.types = {v.name: v.type for v in self.about.modelVariables}
        self.fmu = FMU3Slave(
            guid=self.about.instantiationToken,
            unzipDirectory=extract(str(path), str(folder)),
            modelIdentifier=self.about.coSimulation.modelIdentifier,
            instanceName="one",
        )
        self.fmu.instantiate(eventModeUsed=events, earlyReturnAllowed=events)
        self.fmu.enterInitializationMode(startTime=0)
        self.fmu.exitInitializationMode()
        self.time, self.events, self.rows = 0.0, events, []

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()

    def values(self):
        """Return the outputs that are numbers, arrays element by element."""
        found = []
        for v in self.about.modelVariables:
            if v.causality == "output" and v.type in ("Float64", "Int32"):
                size = int(np.prod([int(d.start) for d in v.dimensions]))
                found += getattr(self.fmu, f"get{v.type}")([v.valueReference], size)
        return found

    def record(self):
        self.rows.append((self.time, *map(float, self.values())))

    def handle(self):
        """Go through Event Mode with the clocks of the instant."""
        if "sample" in self.vr and self.time % 0.5 == 0:
            self.fmu.setClock([self.vr["sample"]], [True])
        assert self.fmu.updateDiscreteStates()[:2] == (False, False)
        self.fmu.enterStepMode()

    def advance(self):
        """Make a step to the next multiple of the step, with the events there."""
        end = (np.floor(self.time / STEP) + 1) * STEP
        event, _, early, last = self.fmu.doStep(self.time, end - self.time)
        assert early == (last < end)
        self.time = last
        if event:
            self.record()
        if event or ("sample" in self.vr and self.time % 0.5 == 0):
            self.fmu.enterEventMode()
            self.handle()
        self.record()

    def run(self, stop):
        if self.events:
            self.handle()
        self.record()
        while self.time < stop:
            if "reply" in self.vr:
                (message,) = self.fmu.getBinary([self.vr["message"]])
                self.fmu.setBinary([self.vr["reply"]], [message])
            self.advance()
        return np.array(self.rows)


def expected(name):
    """Return the rows of a trace."""
    return np.array(specimens.trace(name)[1:])


@pytest.mark.parametrize("name", NAMES)
def test_a_specimen_is_valid_and_gives_its_trace(built, name, tmp_path):
    assert validate_fmu(str(built[name])) == []
    with closing(Master(built[name], tmp_path)) as master:
        rows = expected(name)
        found = master.run(rows[-1, 0])
    assert np.array_equal(found, rows)
    assert np.ptp(rows, axis=0).min() > 0


def test_edges_inside_of_steps_are_handled_without_event_mode(built, tmp_path):
    with closing(Master(built["event"], tmp_path, events=False)) as master:
        found = master.run(2.0)
    rows = {row[0]: row for row in expected("event")}
    assert np.array_equal(found, [rows[t] for t in found[:, 0]])
    assert len(found) == 9


def test_fmpy_gives_the_traces_of_what_it_can_do(built):
    """It has Event Mode and arrays, but neither clocks nor binary connections."""
    times = {"stop_time": 2.0, "step_size": STEP, "output_interval": STEP}
    found = simulate_fmu(str(built["event"]), **times)
    rows = {row[0]: row for row in expected("event")}
    assert np.array_equal(np.array(found.tolist()), [rows[t] for t in found["time"]])
    found = simulate_fmu(str(built["table"]), **times)
    for row, wanted in zip(found, expected("table"), strict=False):
        assert np.array_equal([row["time"], *row["r"], *row["pair"].ravel()], wanted)


def test_a_tool_that_forgets_event_mode_is_stopped(built, tmp_path):
    with closing(Master(built["event"], tmp_path)) as master:
        master.handle()
        for k in range(2):
            master.fmu.doStep(k * STEP, STEP)
        assert master.fmu.doStep(2 * STEP, STEP) == (True, False, True, 0.625)
        with pytest.raises(FMICallException, match="fmi3DoStep"):
            master.fmu.doStep(0.625, STEP)


@pytest.mark.parametrize("name", ["event", "table"])
def test_the_harness_gives_the_trace_without_event_mode(built, name):
    span = Experiment(stop=2.0, step=STEP, algorithm="jacobi")
    result = run(System("demo", (Component("one", built[name]),), (), span), in_process=True)
    rows = {row[0]: row[1:] for row in expected(name)}
    columns = [f"one.{column}" for column in specimens.NAMES[name]]
    for k, t in enumerate(result.time):
        assert np.array_equal([result[column][k] for column in columns], rows[t])


def test_the_harness_rejects_clocks(built):
    with pytest.raises(FmuError, match="sample: clocks are not supported"):
        read_interface(built["clock"])
