# SPDX-License-Identifier: BSD-2-Clause
"""Arguments that make no sense are rejected: with a message that states the reason, and with the
instance unchanged and usable.
"""

from __future__ import annotations

from ctypes import byref, c_int
from math import inf, nan

import pytest

from tests.compliance import api
from tests.compliance.api import Status
from tests.compliance.probe import Host, Instance, excitation
from tests.compliance.rejections import assert_usable, rejected

# ---- instantiation


@pytest.mark.parametrize(
    ("wrong", "word"),
    [
        ({"guid": "{00000000-0000-0000-0000-000000000000}"}, "guid"),
        ({"guid": ""}, "guid"),
        ({"guid": "{%n%s%x" + "0" * 5000}, "guid"),
        ({"kind": api.MODEL_EXCHANGE}, "co-simulation"),
        ({"name": ""}, "name"),
    ],
    ids=["other guid", "empty guid", "endless guid", "model exchange", "no name"],
)
def test_an_instance_with_wrong_arguments_is_rejected(fmu, wrong, word):
    rejection = Instance(fmu, host=Host(), **wrong)
    assert rejection.handle is None
    (message,) = rejection.host.errors
    assert message.startswith("fmi2Instantiate: ")
    assert word in message
    assert rejection.host.live == set()


def message_of_rejected_instance(fmu, name, guid):
    host = Host()
    assert (
        fmu.library.fmi2Instantiate(
            name, api.CO_SIMULATION, guid, None, byref(host.callbacks), 0, 0
        )
        is None
    )
    (message,) = host.errors
    return message


def test_a_missing_name_or_guid_is_rejected(fmu):
    guid = fmu.about.guid.encode()
    assert "name" in message_of_rejected_instance(fmu, None, guid)
    for wrong in (None, b"", b"wrong"):
        assert fmu.about.guid in message_of_rejected_instance(fmu, b"probe", wrong), (
            "the guid that was expected"
        )


# ---- experiment


@pytest.mark.parametrize(
    ("start", "stop", "word"),
    [
        (nan, None, "start"),
        (inf, None, "start"),
        (-inf, None, "start"),
        (0, -1, "stop"),
        (5, 5, "stop"),
        (0, nan, "stop"),
    ],
)
def test_impossible_experiments_are_rejected(instance, start, stop, word):
    with rejected(instance, "fmi2SetupExperiment", word) as answer:
        answer.append(
            instance.call("fmi2SetupExperiment", 0, 0.0, start, stop is not None, stop or 0.0)
        )
    instance.start()


# ---- steps


@pytest.mark.parametrize(
    ("t", "h", "word"),
    [
        (0.4, 0.1, "communication point"),
        (0.6, 0.1, "communication point"),
        (0.0, 0.1, "communication point"),
        (0.5 + 1e-8, 0.1, "communication point"),
        (0.5 - 1e-8, 0.1, "communication point"),
        (0.5, 0.0, "> 0"),
        (0.5, -0.1, "> 0"),
        (nan, 0.1, "finite"),
        (inf, 0.1, "finite"),
        (0.5, nan, "finite"),
        (0.5, inf, "finite"),
        (0.5, 1e300, "step size"),
        (0.5, 99.5 + 1e-6, "stop time"),
    ],
)
def test_impossible_steps_are_rejected_with_the_expected_time(running, t, h, word):
    with rejected(running, "fmi2DoStep", word, "expected t = 0.5") as answer:
        answer.append(running.call("fmi2DoStep", t, h, 0))
    assert_usable(running)


def test_the_last_step_may_end_at_the_stop_time_within_rounding(fmu):
    for excess in (0.0, 1e-12, 1e-9):
        with Instance(fmu) as instance:
            instance.start(stop=1.0)
            instance.step(0.0, 1.0 + excess)


@pytest.mark.parametrize(("stop", "h", "tolerated"), [(9.0, 1.0, 1e-8), (9.0, 1e-7, 1e-9)])
def test_rounding_is_a_billionth_of_the_time_or_a_hundredth_of_a_short_step(
    fmu, stop, h, tolerated
):
    """1e-9 (1 + t), of the stop time and of the end of the last step."""
    for share, status in ((0.9, Status.OK), (1.1, Status.ERROR)):
        with Instance(fmu) as instance:
            instance.start(stop=stop)
            instance.step(0.0, stop - h)
            assert instance.call("fmi2DoStep", stop - h, h + share * tolerated, 0) is status
        with Instance(fmu) as instance:
            instance.start().step(0.0, stop)
            assert instance.call("fmi2DoStep", stop - share * tolerated, h, 0) is status


@pytest.mark.parametrize("start", [-5.0, 0.0, 1e6])
def test_a_communication_point_may_be_off_by_rounding(fmu, start):
    tolerated = 0.9e-9 * max(1, abs(start))
    with Instance(fmu) as instance:
        instance.start(start=start)
        instance.step(start + tolerated, 0.1)
        instance.step(start + 0.1, 0.1)


@pytest.mark.parametrize(
    ("start", "step", "word"),
    [
        (1.7e9, (1.7e9 + 0.01, 0.1), "communication point"),
        (1.7e9, (1.7e9 + 1.6, 0.1), "communication point"),
        (1.7e9, (1.7e9, 1e-8), "rounding error of the time"),
        (1e17, (1e17, 200.0), "2^53"),
    ],
)
def test_steps_at_late_times_are_rejected_where_time_is_wrong_lost_or_too_fine(
    fmu, start, step, word
):
    with Instance(fmu) as instance:
        if word == "2^53" and not fmu.sampled_every(1.0):
            pytest.skip(f"{fmu.name} has neither internal steps nor samples of its own")
        instance.start(fmu.sampled_every(1.0), start=start)
        with rejected(instance, "fmi2DoStep", word) as answer:
            answer.append(instance.call("fmi2DoStep", *step, 0))
        instance.step(start, 100.0) if word != "2^53" else None


# ---- values


@pytest.mark.parametrize("value", [nan, inf, -inf])
@pytest.mark.parametrize("phase", ["instantiated", "initialization mode", "step complete"])
def test_values_that_are_not_numbers_are_rejected(fmu, phase, value):
    with Instance(fmu) as instance:
        if phase != "instantiated":
            instance.enter() if phase == "initialization mode" else instance.start()
        settable = fmu.inputs + (fmu.parameters if phase != "step complete" else [])
        for v in settable[:: max(1, len(settable) // 10)]:
            with rejected(instance, "fmi2SetReal", v.name, "finite") as answer:
                answer.append(instance.try_set({v.name: value}))


def unknown_references(fmu):
    """Next to the known ones, between rows, and far away."""
    known = {v.reference for v in fmu.about.variables}
    near = {r + 1 for r in known} | {
        max(known) + 1000,
        1000 * (max(known) // 1000 + 1),
        999,
        2**31 - 1,
        2**31,
        2**32 - 1,
    }
    return sorted(near - known)


@pytest.mark.parametrize("function", ["fmi2SetReal", "fmi2GetReal"])
def test_unknown_value_references_are_rejected(running, function):
    for reference in unknown_references(running.fmu):
        with rejected(running, function, str(reference)) as answer:
            answer.append(running.call(function, api.references([reference]), 1, api.reals([1.0])))
    assert_usable(running)


def test_outputs_cannot_be_set(instance):
    for phase in ("instantiated", "initialization mode", "step complete"):
        for v in instance.fmu.outputs[::5]:
            with rejected(instance, "fmi2SetReal", v.name, "output") as answer:
                answer.append(instance.try_set({v.name: 1.0}))
        if phase != "step complete":
            instance.enter() if phase == "instantiated" else instance.ok(
                "fmi2ExitInitializationMode"
            )


def test_no_parameter_can_be_set_after_initialization(running):
    for v in running.fmu.parameters:
        with rejected(running, "fmi2SetReal", v.name, "parameter") as answer:
            answer.append(running.try_set({v.name: v.start}))
    assert_usable(running)


def test_one_bad_value_among_good_ones_leaves_all_as_they_were(running):
    good = excitation(running.fmu.inputs, 77)
    for bad in ({running.fmu.outputs[0].name: 1.0}, {running.fmu.parameters[0].name: 1.0}):
        with rejected(running, "fmi2SetReal", *bad) as answer:
            answer.append(running.try_set(good | bad))
    assert_usable(running)


@pytest.mark.parametrize("kind", ["Integer", "Boolean", "String"])
@pytest.mark.parametrize("verb", ["Set", "Get"])
def test_there_are_no_variables_of_other_types(running, verb, kind):
    function = f"fmi2{verb}{kind}"
    values = (api.c_char_p * 1)(b"1") if kind == "String" else (c_int * 1)(1)
    with rejected(running, function, "Real") as answer:
        answer.append(running.call(function, api.references([0]), 1, values))
    running.ok(function, None, 0, None)


def test_derivatives_of_inputs_and_outputs_are_not_provided(running):
    one = (
        api.references([running.fmu.about.variables[0].reference]),
        1,
        (c_int * 1)(1),
        api.reals([1.0]),
    )
    for function in ("fmi2SetRealInputDerivatives", "fmi2GetRealOutputDerivatives"):
        with rejected(running, function, "derivatives") as answer:
            answer.append(running.call(function, *one))
