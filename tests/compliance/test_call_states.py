# SPDX-License-Identifier: BSD-2-Clause
"""Every function in every state: accepted where FMI 2.0 allows it, else rejected with a message and
without effect.
"""

from __future__ import annotations

import math
from ctypes import byref, c_double

import pytest

from tests.compliance import api
from tests.compliance.api import Status
from tests.compliance.fmus import ARCHIVES
from tests.compliance.probe import Fmu, Instance
from tests.compliance.rejections import assert_readable, rejected
from tests.compliance.states import RULES, STATES, allowed, attempt, bring, overflow, right_answer

NOTHING = {api.c_int: 0, api.c_double: 0.0, api.c_size_t: 0}
"""Values of arguments that are not pointers."""

in_every_state = pytest.mark.parametrize("state", STATES)


def brought(fmu, state):
    instance = Instance(fmu)
    if not bring(instance, state):
        instance.free()
        pytest.skip(f"no input makes a step of {fmu.name} fail")
    return instance


def test_the_table_covers_every_function():
    assert set(RULES) == set(api.ARGUMENTS)


@in_every_state
def test_calls_are_accepted_exactly_where_the_standard_allows_them(fmu, state):
    wrong = {}
    for function in RULES:
        with brought(fmu, state) as instance:
            status = attempt(instance, function)
            if status is not (right_answer(function) if allowed(function, state) else Status.ERROR):
                wrong[function] = status.name
    assert wrong == {}


@in_every_state
def test_a_call_in_the_wrong_state_names_function_and_state_and_changes_nothing(fmu, state):
    with brought(fmu, state) as instance:
        before = instance.snapshot()
        for function in (name for name in RULES if not allowed(name, state)):
            instance.host.messages.clear()
            attempt(instance, function)
            (message,) = instance.host.errors
            assert message.startswith(f"{function}: ")
            assert f"'{state}'" in message
            assert instance.snapshot() == before, function


@in_every_state
def test_functions_of_model_exchange_are_rejected_with_one_line(fmu, state):
    with brought(fmu, state) as instance:
        before = instance.snapshot()
        for function, kinds in api.EXCHANGE.items():
            instance.host.messages.clear()
            assert instance.call(function, *(NOTHING.get(kind) for kind in kinds)) is Status.ERROR
            (message,) = instance.host.errors
            assert message == f"{function}: this FMU supports co-simulation only"
            assert instance.snapshot() == before, function
    assert getattr(fmu.library, function)(None, None, 0) == Status.ERROR


def test_version_and_platform_match_fmi_2(fmu):
    assert fmu.library.fmi2GetVersion() == b"2.0"
    assert fmu.library.fmi2GetTypesPlatform() == b"default"


def test_a_missing_instance_is_rejected_and_freeing_it_does_nothing(fmu):
    with Instance(fmu) as instance:
        arguments = {name: [kind() for kind in kinds] for name, kinds in api.ARGUMENTS.items()}
        instance.handle, handle = None, instance.handle
        answers = {name: instance.call(name, *arguments[name]) for name in RULES}
        fmu.library.fmi2FreeInstance(None)
        instance.handle = handle
    assert {
        name: answer.name for name, answer in answers.items() if answer is not Status.ERROR
    } == {}


# ---- a step that fails


def test_a_step_ends_with_finite_outputs_or_with_an_error(fmu):
    with Instance(fmu) as instance:
        instance.start()
        status = overflow(instance)
        assert status in (Status.OK, Status.ERROR)
        assert all(map(math.isfinite, instance.values(fmu.outputs)))


def test_a_failed_step_retains_the_last_good_state_and_states_what_happened(fmu):
    with Instance(fmu) as instance:
        instance.start()
        instance.simulate(5)
        outputs, count = instance.outputs(), len(instance.host.errors)
        instance.set({v.name: min(v.high, 1.7e308) for v in fmu.inputs})
        if instance.call("fmi2DoStep", 0.5, 10.0, 0) is Status.OK:
            pytest.skip(f"no input makes a step of {fmu.name} fail")
        assert instance.outputs() == outputs
        last = c_double()
        instance.ok("fmi2GetRealStatus", api.LAST_SUCCESSFUL_TIME, byref(last))
        assert last.value == 0.5
        (message,) = instance.host.errors[count:]
        assert message.startswith("fmi2DoStep: ")
        assert "finite" in message or "must be" in message
        assert "t = 10.5 s" in message
        assert_readable(message)


def test_numbers_in_messages_have_no_sign_that_states_nothing(fmu):
    with Instance(fmu) as instance:
        instance.start()
        instance.simulate(5)
        with rejected(instance, "fmi2DoStep", "t = nan s", "step = 0 s") as answer:
            answer.append(instance.call("fmi2DoStep", -math.nan, -0.0, 0))


def test_a_failed_step_can_be_undone_by_a_saved_state(fmu):
    with Instance(fmu) as instance, Instance(fmu) as other:
        state = instance.start().save()
        if overflow(instance) is Status.OK:
            pytest.skip(f"no input makes a step of {fmu.name} fail")
        instance.restore(state)
        assert instance.simulate(10) == other.start().simulate(10)
        instance.drop(state)


@pytest.mark.parametrize("name", ["servicer"])
def test_a_step_to_an_output_out_of_its_bounds_fails(name, tmp_path):
    """All propellant burnt, and more: finite, but the mass would be negative."""
    fmu = Fmu(next(path for path in ARCHIVES if path.stem == name), tmp_path)
    with Instance(fmu) as instance:
        instance.start({"mdot": 41.0}).step(0.0, 2.0)
        assert instance.call("fmi2DoStep", 2.0, 1.0, 0) is Status.ERROR
        (message,) = instance.host.errors
        assert "result at t = 3 s rejected: mass = -23: must be >= 0" in message
        assert instance.get("mass") == pytest.approx(18)
