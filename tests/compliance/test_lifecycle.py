# SPDX-License-Identifier: BSD-2-Clause
"""Instances do not know of each other, a reset one is a fresh one, and what is freed is gone. Equal
means: equal bits.
"""

from __future__ import annotations

import ctypes
import gc
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from threading import Barrier

import pytest

from tests.compliance.probe import LIBC, Host, Instance, excitation
from tests.compliance.states import STATES, bring


def alone(fmu, wave, steps=10):
    with Instance(fmu) as instance:
        return instance.start().simulate(steps, wave=wave)


def test_the_start_values_are_a_valid_state_to_run_from(fmu):
    with Instance(fmu) as instance:
        instance.start()
        for k in range(20):
            instance.step(0.1 * k, 0.1)
        assert instance.host.errors == []


def test_inputs_and_start_values_match_the_description(instance):
    instance.enter()
    for v in (*instance.fmu.inputs, *instance.fmu.parameters):
        assert instance.get(v.name) == v.start, v.name


@pytest.mark.parametrize("many", [12, pytest.param(100, marks=pytest.mark.long)])
def test_interleaved_instances_run_like_each_alone(fmu, many):
    """All of the same name, as ecos gives them, and each with inputs of its own."""
    with ExitStack() as stack:
        fleet = [stack.enter_context(Instance(fmu, "slave")).start() for _ in range(many)]
        records = [bytearray() for _ in fleet]
        for k in range(10):
            for wave, (instance, record) in enumerate(zip(fleet, records, strict=True)):
                record += instance.simulate(1, first=k, wave=wave)
    assert len(set(map(bytes, records))) == (many if fmu.inputs else 1)
    assert [wave for wave, record in enumerate(records) if record != alone(fmu, wave)] == []


def test_instances_on_four_threads_run_like_each_alone(fmu):
    """Steps of many internal steps and samples, so that the threads really are inside the FMU at
    the same time.
    """
    fine, barrier = fmu.sampled_every(1e-3), Barrier(4)

    def simulate(wave, together):
        with Instance(fmu, "slave") as instance:
            instance.start(fine)
            if together:
                barrier.wait(timeout=60)
            return instance.simulate(5, h=0.5, wave=wave)

    with ThreadPoolExecutor(4) as pool:
        parallel = list(pool.map(lambda wave: simulate(wave, together=True), range(4)))
    assert parallel == [simulate(wave, together=False) for wave in range(4)]


# ---- reset


@pytest.mark.parametrize("state", STATES)
def test_a_reset_instance_is_a_fresh_one_from_every_state(fmu, state):
    with Instance(fmu) as instance, Instance(fmu) as fresh:
        if not bring(instance, state):
            pytest.skip(f"no input makes a step of {fmu.name} fail")
        instance.ok("fmi2Reset")
        assert instance.snapshot() == fresh.snapshot()
        assert instance.start().simulate(10) == fresh.start().simulate(10)


def test_a_reset_forgets_parameters_inputs_start_time_and_stop_time(fmu):
    changed = {v.name: min(v.start * 1.01 + 0.001, v.high) for v in fmu.parameters if v.high > 1}
    with Instance(fmu) as instance, Instance(fmu) as fresh:
        instance.set(changed | excitation(fmu.inputs, 5))
        instance.set_up(start=3.0, stop=4.0)
        instance.ok("fmi2Reset")
        assert instance.snapshot() == fresh.snapshot()
        assert instance.start().simulate(60) == fresh.start().simulate(60)


def test_a_run_can_be_repeated_on_one_instance(fmu):
    with Instance(fmu) as instance:
        recordings = set()
        for _ in range(5):
            recordings.add(instance.start().simulate(10))
            instance.ok("fmi2Terminate")
            instance.ok("fmi2Reset")
    assert len(recordings) == 1


# ---- memory


def life(fmu, host):
    """Everything that could allocate."""
    with Instance(fmu, name="n" * 200, host=host, logging=False) as instance:
        state = instance.start().save()
        instance.step(0.0, 0.1)
        instance.drop(instance.deserialize(instance.serialize(state)))
        instance.derivative(fmu.inputs, [1.0] * len(fmu.inputs))
        instance.restore(state)
        instance.drop(state)
        instance.ok("fmi2Reset")


def test_every_block_of_memory_is_given_back(fmu):
    host = Host()
    for _ in range(10):
        life(fmu, host)
    assert host.requests > 0
    assert host.live == set()


class MallocStatistics(ctypes.Structure):
    """Result of mallinfo2 of the GNU C library."""

    _fields_ = tuple(
        (name, ctypes.c_size_t)
        for name in [
            "arena",
            "ordblks",
            "smblks",
            "hblks",
            "hblkhd",
            "usmblks",
            "fsmblks",
            "uordblks",
            "fordblks",
            "keepcost",
        ]
    )


def bytes_in_use():
    """Memory that malloc has allocated and not got back. The size of the process shows less: freed
    memory stays with it.
    """
    LIBC.mallinfo2.restype = MallocStatistics
    statistics = LIBC.mallinfo2()
    return statistics.uordblks + statistics.hblkhd


@pytest.mark.skipif(
    not hasattr(LIBC, "mallinfo2"), reason="memory in use is read from the GNU C library"
)
@pytest.mark.parametrize("lives", [60, pytest.param(10_000, marks=pytest.mark.long)])
def test_memory_does_not_grow_with_repeated_instances(fmu, lives):
    """Less than 10 bytes per life, with the memory management of the FMU itself: not even a name is
    left behind.
    """
    if "libasan" in Path("/proc/self/maps").read_text(encoding="ascii"):
        pytest.skip("the address sanitizer has a malloc of its own, without statistics")

    def live(times):
        for _ in range(times):
            with Instance(fmu, name="n" * 200, host=host, logging=False) as instance:
                instance.start()
                instance.call("fmi2DoStep", 0.0, 0.1, 0)

    host = Host(allocate=False, free=False)
    live(20)
    gc.freeze()  # all that other tests have left is not looked through again
    gc.collect()
    before = bytes_in_use()
    live(lives)
    gc.collect()
    assert bytes_in_use() - before < 10 * lives
