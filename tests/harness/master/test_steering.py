# SPDX-License-Identifier: BSD-2-Clause
"""Systems steered from outside: open components, ports, and the bits of their own outputs fed
back.
"""

import numpy as np
import pytest

from harness import Simulation, load, run
from harness.errors import RunError, UsageError
from harness.system.values import base

CASES = {
    "sync_approach": ("controller", 4.0, {}),
    "ppc_tracking": ("controller", 5.0, {}),
    "relay_approach": ("controller", 4.0, {}),
    "space_robot": ("joints", 100.0, {}),
    "transposition": ("steering", 60.0, {"params": "cluster"}),
    "sync_approach_navigated": ("relative_filter", 2.0, {}),
}
"""Component to remove and stop time [s] by system: controllers, an actuator, a slow filter."""


def fed_back(system, component, stop, executor="c", **changes):
    """Return the run with the component, and the run in which its recorded outputs are set."""
    with load(system) as found:
        every = found.component(component).every
        late = changes.get("latency", {}).get(component, 0)
        whole = run(found, stop=stop, every=1, **changes)
        with Simulation(
            found, stop=stop, every=1, executor=executor, open=[component], **changes
        ) as simulation:
            simulation.initialize()
            names = {base(c) for c in whole.columns if c.startswith(f"{component}.")}
            ports = {name: simulation.port(name) for name in names}
            for k in range(0, simulation.steps, every):
                row = min(k + 1 + late, simulation.steps)
                for name, port in ports.items():
                    port[...] = whole[name][row]
                simulation.advance(k + every)
            return whole, simulation.result()


@pytest.mark.parametrize("system", CASES)
def test_recorded_outputs_fed_back_give_the_bits_of_the_run(system):
    component, stop, changes = CASES[system]
    whole, steered = fed_back(system, component, stop, **changes)
    assert steered.columns == whole.columns
    assert steered.values.tobytes() == whole.values.tobytes()


@pytest.mark.parametrize("how", [{"executor": "python"}, {"algorithm": "jacobi"},
                                 {"latency": {"controller": 1}}])  # fmt: skip
def test_bits_do_not_depend_on_executor_algorithm_or_latency(how):
    whole, steered = fed_back("ppc_tracking", "controller", 1.0, **how)
    assert steered.values.tobytes() == whole.values.tobytes()


@pytest.fixture
def steered():
    with (
        load("ppc_tracking") as system,
        Simulation(system, open=["controller"], stop=1.0) as simulation,
    ):
        yield simulation


def test_a_port_shows_what_is_set_and_what_is_published(steered):
    port = steered.port("controller.F_cmd_S")
    seen = steered.port("servicer.r_SN_N")
    before = seen.copy()
    steered.set("controller.F_cmd_S", [1.0, 2.0, 3.0])
    assert port.tolist() == [1.0, 2.0, 3.0]
    steered.advance(1)
    assert steered.result()["controller.F_cmd_S"][1].tolist() == [1.0, 2.0, 3.0]
    assert not np.array_equal(seen, before)
    np.testing.assert_array_equal(steered.get("controller.r_SN_N"), seen)


def test_start_values_come_from_the_whole_system(steered):
    whole = run("ppc_tracking", stop=1.0, every=1)
    np.testing.assert_array_equal(steered.get("controller.F_cmd_S"), whole["controller.F_cmd_S"][0])


def test_an_unconnected_input_is_set_between_steps(steered):
    """Force on the target: its velocity differs from the free one by F h / m."""
    free = run("ppc_tracking", stop=1.0, every=1)["target.v_TN_N"][1]
    steered.set("target.F_T", [5.0, 0.0, 0.0])
    steered.advance(1)
    change = np.linalg.norm(steered.get("target.v_TN_N") - free)
    mass = run("ppc_tracking", stop=1.0).parameter("target.mass")
    assert change == pytest.approx(5.0 * 0.05 / mass, rel=1e-6)


def test_restoring_returns_to_what_was_set(steered):
    steered.set("controller.F_cmd_S", [1.0, 0.0, 0.0])
    steered.advance(3)
    saved = steered.save()
    steered.advance(8)
    first = steered.result().values[8].copy()
    steered.set("controller.F_cmd_S", [9.0, 0.0, 0.0])
    steered.restore(saved)
    assert steered.get("controller.F_cmd_S").tolist() == [1.0, 0.0, 0.0]
    steered.advance(8)
    np.testing.assert_array_equal(steered.result().values[8], first)


def test_names_and_shapes_that_do_not_fit_are_errors(steered):
    with pytest.raises(UsageError, match=r"open=..servicer.."):
        steered.set("servicer.r_SN_N", [0, 0, 0])
    with pytest.raises(UsageError, match="set the output that drives it"):
        steered.set("servicer.F_S", [0, 0, 0])
    with pytest.raises(UsageError, match=r"expected shape .3,., got .2,."):
        steered.set("controller.F_cmd_S", [0, 0])
    with pytest.raises(UsageError, match="close: F_cmd_S"):
        steered.port("controller.F_cmd")
    with pytest.raises(UsageError, match="no such component"):
        run("ppc_tracking", open=["control"])
    with load("ppc_tracking") as system, pytest.raises(UsageError, match="executor c or python"):
        Simulation(system, open=["controller"], executor="fused")


def test_a_value_that_is_not_finite_names_the_variable_and_the_time(steered):
    steered.advance(2)
    steered.set("controller.F_cmd_S", [0.0, np.nan, 0.0])
    with pytest.raises(RunError, match=r"controller.F_cmd_S\[2\].*not a finite.*0.1 s"):
        steered.advance(3)
