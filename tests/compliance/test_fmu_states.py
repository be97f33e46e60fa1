# SPDX-License-Identifier: BSD-2-Clause
"""Saved states: the future after a restore is the future that was, to the last bit, in any instance
and in any order.
"""

from __future__ import annotations

from ctypes import byref, c_double, c_void_p

import pytest

from tests.compliance import api
from tests.compliance.api import Status
from tests.compliance.fmus import ARCHIVES
from tests.compliance.probe import Fmu, Instance, excitation
from tests.compliance.states import STATES, bring


def time_of(instance):
    last = c_double()
    instance.ok("fmi2GetRealStatus", api.LAST_SUCCESSFUL_TIME, byref(last))
    return last.value


def test_a_restored_state_has_the_same_future_again_and_again(running):
    state = running.save()
    futures = set()
    for _ in range(3):
        futures.add(running.simulate(20, first=5))
        running.restore(state)
    running.drop(state)
    assert len(futures) == 1


def test_a_restored_state_has_the_outputs_and_the_time_of_the_saved_one(running):
    state, outputs = running.save(), running.outputs()
    running.simulate(5, first=5)
    running.restore(state)
    assert running.outputs() == outputs
    assert time_of(running) == 0.5
    assert running.call("fmi2DoStep", 1.0, 0.1, 0) is Status.ERROR
    running.step(0.5, 0.1)
    running.drop(state)


def test_a_restored_state_brings_its_inputs_back(running):
    state = running.save()
    running.step(0.5, 0.1)
    expected = running.outputs()
    running.restore(state)
    running.set(excitation(running.fmu.inputs, 99))
    running.restore(state)
    running.step(0.5, 0.1)
    assert running.outputs() == expected
    running.drop(state)


def test_several_states_are_retained_apart_and_restored_in_any_order(running):
    states, futures = [], []
    for k in range(5, 9):
        states.append(running.save())
        futures.append(running.simulate(1, first=k))
    for i in (2, 0, 3, 1, 1, 2):
        running.restore(states[i])
        assert running.simulate(1, first=5 + i) == futures[i]
    for state in states:
        running.drop(state)


def test_a_saved_state_is_not_touched_by_what_the_instance_does_later(running):
    state = running.save()
    before = running.serialize(state)
    running.simulate(5, first=5)
    running.ok("fmi2Reset")
    assert running.serialize(state) == before
    running.drop(state)


def test_saving_into_an_old_state_replaces_it(running):
    state = running.save()
    future = [running.simulate(1, first=5), running.simulate(1, first=6)]
    running.restore(state)
    running.simulate(1, first=5)
    place = c_void_p(state.value)
    running.ok("fmi2GetFMUstate", byref(place))
    assert place.value == state.value
    running.simulate(1, first=6)
    running.restore(place)
    assert running.simulate(1, first=6) == future[1]
    running.drop(place)


def test_freeing_a_state_forgets_its_address(running):
    state = running.save()
    running.drop(state)
    assert state.value is None


@pytest.mark.parametrize("phase", STATES)
def test_every_state_of_the_life_cycle_can_be_saved_and_restored(fmu, phase):
    with Instance(fmu) as instance, Instance(fmu) as other:
        if not bring(instance, phase):
            pytest.skip(f"no input makes a step of {fmu.name} fail")
        saved = instance.save()
        data = instance.serialize(saved)
        other.start()
        copy = other.deserialize(data)
        other.restore(copy)
        assert other.snapshot() == data
        instance.ok("fmi2Reset")
        instance.restore(saved)
        assert instance.snapshot() == data
        instance.drop(saved)
        other.drop(copy)


# ---- serialized


def test_a_serialized_state_can_be_restored_in_another_instance(running):
    data = running.snapshot()
    future = running.simulate(20, first=5)
    with Instance(running.fmu) as other:
        state = other.deserialize(data)
        assert other.serialize(state) == data
        other.restore(state)
        assert other.simulate(20, first=5) == future
        other.drop(state)


def test_equal_states_have_equal_bytes_and_different_ones_do_not(fmu):
    with Instance(fmu) as one, Instance(fmu) as other:
        assert one.snapshot() == other.snapshot()
        one.start()
        assert one.snapshot() != other.snapshot()
        other.start()
        assert one.simulate(5) == other.simulate(5)
        assert one.snapshot() == other.snapshot()


def assert_rejected(instance, data):
    state, blocks = c_void_p(), len(instance.host.live)
    instance.host.messages.clear()
    assert instance.try_deserialize(data, state) is Status.ERROR
    assert state.value is None
    assert len(instance.host.live) == blocks
    (message,) = instance.host.errors
    assert message.startswith("fmi2DeSerializeFMUstate: ")


def test_bytes_with_any_damage_are_rejected_and_change_nothing(running):
    """One bit in every byte of head and end, and in every seventh byte between them."""
    data = running.snapshot()
    end = len(data) - 100
    for i in [*range(100), *range(100, end, 7), *range(max(100, end), len(data))]:
        assert_rejected(running, data[:i] + bytes([data[i] ^ (1 << i % 8)]) + data[i + 1 :])
    assert running.snapshot() == data


def test_bytes_of_another_length_are_rejected(running):
    data = running.snapshot()
    for wrong in (b"", data[:1], data[:-1], data[:-8], data + b"\0", data + data):
        assert_rejected(running, wrong)


@pytest.fixture
def snapshots(tmp_path):
    """Of every FMU at the start, by name."""
    found = {}
    for archive in ARCHIVES:
        with Instance(Fmu(archive, tmp_path / archive.stem)) as instance:
            found[archive.stem] = instance.start().snapshot()
    return found


def test_bytes_of_another_fmu_are_rejected(running, snapshots):
    size = len(running.snapshot())
    for name, data in snapshots.items():
        if name == running.fmu.name:
            continue
        assert_rejected(running, data)
        assert_rejected(running, data[:size].ljust(size, b"\0"))


def test_a_rejected_state_leaves_an_old_one_alone(running):
    state = running.save()
    data, address = running.serialize(state), state.value
    assert running.try_deserialize(data[:-1], state) is Status.ERROR
    assert state.value == address
    assert running.serialize(state) == data
    running.drop(state)


def test_a_previous_state_at_the_place_of_the_result_is_replaced_and_released(running):
    """FMPy and the Reference FMUs take it for a state to use again; a master must start with a null
    pointer.
    """
    state = running.save()
    data, blocks = running.serialize(state), len(running.host.live)
    running.simulate(5, first=5)
    assert running.try_deserialize(data, state) is Status.OK
    assert len(running.host.live) == blocks
    assert running.serialize(state) == data
    running.drop(state)


# ---- identical to a run without any saving


def test_saving_and_serializing_leave_no_trace_in_a_run(fmu):
    with Instance(fmu) as quiet, Instance(fmu) as busy:
        quiet.start()
        busy.start()
        for k in range(10):
            busy.drop(busy.deserialize(busy.snapshot()))
            assert quiet.simulate(1, first=k) == busy.simulate(1, first=k)
