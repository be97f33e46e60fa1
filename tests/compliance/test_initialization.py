# SPDX-License-Identifier: BSD-2-Clause
"""Before the first step: parameters at any time, outputs that follow the values set, and rejection
of impossible models.
"""

from __future__ import annotations

import math
import re
from functools import cache

import pytest

from tests.compliance import description
from tests.compliance.api import Status
from tests.compliance.fmus import ARCHIVES
from tests.compliance.probe import Fmu, Instance, excitation
from tests.each import each


def moved(v):
    """Another value of a parameter, near the start value; a time that was 0 becomes one that costs
    little.
    """
    if (v.low, v.high) == (0, 1):
        return 1.0 - v.start
    return min(v.start * (1 + 1e-10) or (0.01 if v.unit == "s" else 1e-10), v.high)


def is_accepted(fmu, values):
    with Instance(fmu) as instance:
        instance.set(values)
        instance.enter()
        return instance.call("fmi2ExitInitializationMode") is Status.OK


@pytest.fixture(scope="session")
def moves(fmu):
    return fmu.map(cache(moves_of))


def moves_of(fmu):
    """Other values of as many parameters as can be moved one after the other without breaking a
    rule of the model.
    """
    values = {}
    for v in fmu.parameters:
        if is_accepted(fmu, values | {v.name: moved(v)}):
            values[v.name] = moved(v)
    assert len(values) >= len(fmu.parameters) / 3
    return values


# ---- order of calls


def test_parameters_may_be_set_before_the_experiment_and_again_in_initialization_mode(fmu, moves):
    """As libcosim does it."""
    values = moves | excitation(fmu.inputs, 1)
    with Instance(fmu) as early, Instance(fmu) as late, Instance(fmu) as twice:
        early.start(values)
        late.enter()
        late.set(values)
        twice.set(values)
        twice.enter()
        twice.set(values)
        for instance in (late, twice):
            instance.ok("fmi2ExitInitializationMode")
        assert early.simulate(10) == late.simulate(10) == twice.simulate(10)


def test_the_last_value_set_counts(fmu, moves):
    """Also when start values and outputs have been read in between."""
    with Instance(fmu) as instance, Instance(fmu) as other:
        instance.enter()
        for name, value in moves.items():
            instance.set({name: value})
            instance.outputs()
        instance.set({v.name: v.start for v in fmu.parameters})
        instance.ok("fmi2ExitInitializationMode")
        assert instance.outputs() == other.start().outputs()
        assert instance.simulate(10) == other.simulate(10)


def test_the_last_experiment_set_up_counts(fmu):
    with Instance(fmu) as instance, Instance(fmu) as other:
        instance.set_up(start=2.0, stop=3.05)
        assert instance.start(start=3.0).outputs() == other.start(start=3.0).outputs()
        assert instance.call("fmi2DoStep", 2.0, 0.1, 0) is Status.ERROR
        instance.step(3.0, 0.1)


# ---- outputs in initialization mode


def first_outputs(fmu, values, start=0.0):
    with Instance(fmu) as instance:
        return instance.start(values, start).outputs()


def test_outputs_in_initialization_mode_follow_the_inputs(fmu):
    """A master propagates start values by rounds of get and set; the law at the last inputs is what
    counts.
    """
    with Instance(fmu) as instance:
        instance.enter()
        for k in (1, 2, 1, 3):
            instance.set(excitation(fmu.inputs, k))
            expected = first_outputs(fmu, excitation(fmu.inputs, k))
            assert instance.outputs() == expected
            assert instance.outputs() == expected, "reading advances nothing"
        instance.ok("fmi2ExitInitializationMode")
        assert instance.outputs() == expected


def test_outputs_in_initialization_mode_follow_every_parameter(fmu, moves):
    with Instance(fmu) as instance:
        instance.enter()
        so_far = {}
        for name, value in moves.items():
            instance.set({name: value})
            so_far[name] = value
            assert instance.outputs() == first_outputs(fmu, so_far), name


def test_a_master_may_begin_with_zeros_and_set_the_inputs_before_the_first_step(fmu):
    """As FMPy's simulate_ssp, fmucontainer and cofmupy do: a zero attitude or position has no
    direction, so the first outputs follow from start values.
    """
    values = excitation(fmu.inputs, 1)
    with Instance(fmu) as instance, Instance(fmu) as unset:
        for each_instance in (instance, unset):
            each_instance.enter()
            each_instance.set({v.name: 0.0 for v in fmu.inputs})
            assert all(map(math.isfinite, each_instance.values(fmu.outputs)))
            each_instance.ok("fmi2ExitInitializationMode")
            assert all(v == 0.0 for v in each_instance.values(fmu.inputs))
        instance.set(values)
        instance.step(0.0, 0.1)
        assert all(map(math.isfinite, instance.values(fmu.outputs)))
        if unset.call("fmi2DoStep", 0.0, 0.1, 0) is Status.ERROR:
            (message,) = unset.host.errors
            name = re.search(r"; the input (\w+) is zero$", message)[1]
            assert any(v.name.split("[")[0] == name and v.start != 0 for v in fmu.inputs)


def test_first_outputs_of_some_fmu_depend_on_inputs_and_start_time(tmp_path):
    """Else the tests of initialization would compare constants."""
    fmus = [Fmu(path, tmp_path / path.stem) for path in ARCHIVES]
    assert any(
        first_outputs(fmu, excitation(fmu.inputs, 1)) != first_outputs(fmu, {}) for fmu in fmus
    )
    assert any(first_outputs(fmu, {}, start=50.0) != first_outputs(fmu, {}) for fmu in fmus)


def test_reading_outputs_early_does_not_change_the_run(fmu):
    with Instance(fmu) as curious, Instance(fmu) as other:
        curious.enter()
        for _ in range(3):
            curious.outputs()
        curious.ok("fmi2ExitInitializationMode")
        assert curious.simulate(10) == other.start().simulate(10)


# ---- impossible parameters

SPOILED = [
    ("mass", 0, "> 0"),
    ("mass", -5, "> 0"),
    ("mass_0", 0, "> 0"),
    ("m_hat_0", 0, "> 0"),
    ("max_step", 0, "> 0"),
    ("max_step", -0.1, "> 0"),
    ("sample_period", -0.1, "must be >"),
    ("e", 1, "[0, 1)"),
    ("e", 1.5, "[0, 1)"),
    ("e", -0.1, ">= 0"),
    ("a", -7e6, "must be >"),
    ("use_J2", 0.5, "0 or 1"),
    ("use_wheels", 2, "0 or 1"),
    ("J_T", [-100, 0, 0, 0, 150, 0, 0, 0, 90], "positive definite"),
    ("J_T", [100, 0, 0, 0, 0, 0, 0, 0, 90], "positive definite"),
    ("J_T", [100, 120, 0, 120, 100, 0, 0, 0, 150], "positive definite"),
    ("J_T", [100, 0, 0, 0, 300, 0, 0, 0, 90], "triangle"),
    ("J_T", [100, 1, 0, 0, 150, 0, 0, 0, 90], "symmetric"),
    ("J_S", [200, 0, 0, 0, 250, 0, 0, 0, 20], "triangle"),
    ("A_w", [12, 0, 0, 0, -15, 0, 0, 0, 10], "positive definite"),
    ("A_w", [250, 0, 0, 0, 15, 0, 0, 0, 10], " - A_w"),
    ("p_T", [1, 1, 0], "unit vector"),
    ("p_T", [0, 0, 0], "unit vector"),
    ("rho_M", 0, "> 0"),
    ("guard_angle", 3, "1.5 rad"),
    ("eta_hat_0", [180, 0, 0, 240, 0, 160, -14, 0, 0, 16, 0, 12], "positive"),
    ("F_max", [-1, 1, 1], "must be >"),
    ("Isp", -1, "must be >"),
]


@each(("row", "value", "rule"), SPOILED)
def test_impossible_parameters_are_rejected_with_name_and_rule(fmu, row, value, rule):
    for needed in (row, "J_S") if rule == " - A_w" else (row,):
        if needed not in {v.row for v in fmu.parameters}:
            pytest.skip(f"{fmu.name} has no parameter {needed}")
    with Instance(fmu) as instance:
        instance.enter()
        instance.set(fmu.settings(**{row: value}))
        assert instance.call("fmi2ExitInitializationMode") is Status.ERROR
        (message,) = instance.host.errors
        assert message.startswith("fmi2ExitInitializationMode: ")
        assert row in message
        assert rule in message


def test_every_rule_is_tried_on_some_fmu():
    rows = {v.row for path in ARCHIVES for v in description.read(path).of("parameter")}
    assert {row for row, _, _ in SPOILED} <= rows


def beyond(v):
    """A value just outside the declared bounds of a parameter, None if it has none."""
    return -0.5 if v.low == 0 else v.high + 0.5 if v.high < 1e300 else None


def test_every_declared_bound_of_a_parameter_is_retained(fmu):
    for v in fmu.parameters:
        if beyond(v) is None:
            continue
        with Instance(fmu) as instance:
            instance.enter()
            instance.set({v.name: beyond(v)})
            assert instance.call("fmi2ExitInitializationMode") is Status.ERROR, v.name
            assert v.name in instance.host.errors[0]


def test_all_problems_are_named_in_one_message(fmu):
    bad = {v.name: beyond(v) for v in fmu.parameters if beyond(v) is not None}
    with Instance(fmu) as instance:
        instance.enter()
        instance.set(bad)
        assert instance.call("fmi2ExitInitializationMode") is Status.ERROR
        (message,) = instance.host.errors
        assert [name for name in bad if f"{name} = " not in message] == []


def test_outputs_of_an_impossible_model_are_rejected_in_initialization_mode(fmu):
    v = next(v for v in fmu.parameters if beyond(v) is not None)
    with Instance(fmu) as instance:
        instance.enter()
        instance.set({v.name: beyond(v)})
        output = fmu.outputs[0].name
        with pytest.raises(AssertionError, match="fmi2GetReal answered ERROR.*" + v.row):
            instance.get(output)


def test_initialization_can_be_repeated_after_a_correction(fmu):
    v = next(v for v in fmu.parameters if beyond(v) is not None)
    with Instance(fmu) as instance, Instance(fmu) as other:
        instance.enter()
        for _ in range(3):
            instance.set({v.name: beyond(v)})
            assert instance.call("fmi2ExitInitializationMode") is Status.ERROR
        instance.set({v.name: v.start})
        instance.ok("fmi2ExitInitializationMode")
        assert instance.outputs() == other.start().outputs()
        assert instance.simulate(10) == other.simulate(10)


def test_inputs_outside_their_declared_bounds_are_rejected(fmu):
    bounded = [v for v in fmu.inputs if beyond(v) is not None]
    for v in bounded:
        with Instance(fmu) as instance:
            instance.start()
            instance.try_set({v.name: beyond(v)})
            assert (
                instance.host.errors or instance.call("fmi2DoStep", 0.0, 0.1, 0) is Status.ERROR
            ), v.name
            assert v.name in instance.host.errors[0]
