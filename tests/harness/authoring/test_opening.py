# SPDX-License-Identifier: BSD-2-Clause
"""Systems without components that another tool runs."""

from __future__ import annotations

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

from harness import export, load, run
from harness.errors import StructureError, UsageError
from harness.files import paths
from harness.master.remainder import remainder, rest
from harness.ssp.build import build

SYSTEM, STEPS = "sync_approach", 50


class Slave:
    """An FMU in FMPy, its variables by name."""

    def __init__(self, path, folder):
        model = read_model_description(str(path))
        self.references = {v.name: v.valueReference for v in model.modelVariables}
        self.fmu = FMU2Slave(
            guid=model.guid,
            unzipDirectory=extract(str(path), str(folder)),
            modelIdentifier=model.coSimulation.modelIdentifier,
            instanceName=path.stem,
        )
        self.fmu.instantiate()
        self.fmu.setupExperiment(startTime=0.0)

    def get(self, names):
        return self.fmu.getReal([self.references[name] for name in names])

    def set(self, values):
        self.fmu.setReal([self.references[name] for name in values], list(values.values()))


@pytest.mark.long
def test_a_controller_outside_gives_the_bits_of_the_whole_system(tmp_path):
    """Jacobi: all read, all step; the first inputs are start values of the open FMU."""
    with load(SYSTEM) as system:
        step = system.experiment.step
        own = [c for c in system.connections if "controller" in (c.source[0], c.target[0])]
        parameters = system.component("controller").parameters
    env = Slave(
        export(SYSTEM, tmp_path / "env.fmu", without=["controller"], algorithm="jacobi"),
        tmp_path / "env",
    )
    controller = Slave(paths.fmus()["adaptive_controller"], tmp_path / "controller")
    controller.set({name: float(p.value) for name, p in parameters.items()})
    to_controller = {c.target.variable: str(c.source) for c in own if c.target[0] == "controller"}
    to_env = {str(c.target): c.source.variable for c in own if c.source[0] == "controller"}
    names = [name for name in env.references if "." in name]
    outputs = [n for n in names if n in set(run(SYSTEM, stop=0.0 + step).columns)]

    def pass_on(slave, other, wires):
        slave.set(dict(zip(wires, other.get(list(wires.values())), strict=True)))

    for slave in (env, controller):
        slave.fmu.enterInitializationMode()
    pass_on(controller, env, to_controller)
    for slave in (env, controller):
        slave.fmu.exitInitializationMode()
    rows = [env.get(outputs)]
    for k in range(STEPS):
        pass_on(env, controller, to_env)
        pass_on(controller, env, to_controller)
        for slave in (env, controller):
            slave.fmu.doStep(k * step, step)
        rows.append(env.get(outputs))
    whole = run(SYSTEM, algorithm="jacobi", stop=STEPS * step)
    assert np.array_equal(rows, np.column_stack([whole[name] for name in outputs]))


def test_start_values_and_texts_follow_the_components_that_remain():
    first = run(SYSTEM, stop=0.1)
    with load(SYSTEM) as system:
        rest = remainder(system, ["controller"])
    names = [component.name for component in rest.components]
    assert "controller" not in names
    assert len(names) == len(system.components) - 1
    assert {c.source.component for c in rest.connections} <= {*names}
    start = rest.component("propulsion").parameters["F_cmd_S[1]"].value
    assert start == first["controller.F_cmd_S[1]"][0] != 0
    assert not any("controller" in s.parameters for s in rest.sets)
    assert all(s.parameters["propulsion"]["F_cmd_S[1]"].value == start for s in rest.sets)
    assert "controller.Gamma_m" in system.sliders
    assert set(rest.sliders) == {n for n in system.sliders if not n.startswith("controller.")}
    assert rest.requirements == system.requirements  # none of them reads the controller
    with load(SYSTEM) as system:
        assert set(remainder(system, ["guidance"]).requirements) < set(system.requirements)


def test_unknown_names_and_nothing_left_are_rejected():
    with load(SYSTEM) as system:
        with pytest.raises(UsageError, match=r"--open controlle: .* no such component.*controller"):
            remainder(system, ["controlle"])
        with pytest.raises(UsageError, match="no component of sync_approach remains"):
            remainder(system, [component.name for component in system.components])


def test_a_file_that_extends_leaves_out_what_it_sets_to_false(tmp_path):
    """A component comes back with an FMU in a further file."""
    file = tmp_path / "env.toml"
    file.write_text(f'extends = "{SYSTEM}"\nname = "{SYSTEM}"\n[components]\ncontroller = false\n')
    again = tmp_path / "again.toml"
    again.write_text(
        'extends = "env"\n[components]\nguidance = false\ncontroller = "adaptive_controller"\n'
    )
    with load(SYSTEM) as system, load(file) as env, load(again) as other:
        short, whole = rest(env), remainder(system, ["controller"])
        assert env.without == ("controller",)
        assert other.without == ("guidance",)
        assert other.component("controller").fmu == paths.fmus()["adaptive_controller"]
    assert [c.name for c in short.components] == [c.name for c in whole.components]
    assert short.connections == whole.connections
    parameters = [
        {
            c.name: c.parameters["F_cmd_S[1]"].value
            for c in each.components
            if "F_cmd_S[1]" in c.parameters
        }
        for each in (short, whole)
    ]
    assert parameters[0] == parameters[1]
    assert set(parameters[0]) == {"monitor", "propulsion"}
    with pytest.raises(StructureError, match=r"env.toml: leaves out controller; only"):
        build(file, paths.fmus()["target"].parent, tmp_path / "env.ssp")
    file.write_text(f'extends = "{SYSTEM}"\n[components]\nguidances = false\n')
    with pytest.raises(StructureError, match=r"components.guidances: .* leave out.*guidance"):
        load(file).__enter__()
