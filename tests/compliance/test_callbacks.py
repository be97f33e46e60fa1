# SPDX-License-Identifier: BSD-2-Clause
"""The FMU and the callbacks of its master: a log that helps, memory that may run out, and optional
callbacks that may be missing.
"""

from __future__ import annotations

import re
from ctypes import byref, c_void_p

import pytest

from tests.compliance import api
from tests.compliance.api import Status
from tests.compliance.probe import Host, Instance

CATEGORIES = ("logStatusError", "logStatusWarning", "logEvents")


def recording(fmu, host):
    """A life with saving, restoring and rejected calls in it; the bits of its outputs."""
    retained = []
    with Instance(fmu, host=host) as instance:
        try:
            retained.append(instance.start().save())
            instance.simulate(3)
            retained.append(instance.deserialize(instance.serialize(retained[0])))
            instance.restore(retained[1])
            assert instance.call("fmi2DoStep", 17.0, 0.1, 0) is Status.ERROR
            assert instance.call("fmi2GetStatus", 0, byref(api.c_int())) is Status.DISCARD
            assert (
                instance.call("fmi2GetReal", api.references([10**6]), 1, api.reals([0.0]))
                is Status.ERROR
            )
            return instance.simulate(10)
        finally:
            for state in retained:
                instance.drop(state)


@pytest.mark.parametrize(
    "missing",
    [
        {"logger": False},
        {"allocate": False, "free": False},
        {"allocate": False},
        {"free": False},
        {"logger": False, "allocate": False, "free": False},
    ],
    ids=lambda missing: "+".join(missing),
)
def test_missing_callbacks_change_nothing(fmu, missing):
    host = Host(**missing)
    assert recording(fmu, host) == recording(fmu, Host())
    assert host.live == set()


def test_missing_callbacks_altogether_and_a_missing_location_change_nothing(fmu):
    arguments = (b"probe", api.CO_SIMULATION, fmu.about.guid.encode(), None, None, 0, 1)
    with Instance(fmu) as instance, Instance(fmu) as other:
        full, instance.handle = instance.handle, fmu.library.fmi2Instantiate(*arguments)
        assert instance.handle
        assert instance.call("fmi2DoStep", 17.0, 0.1, 0) is Status.ERROR
        assert instance.start().simulate(10) == other.start().simulate(10)
        instance.free()
        instance.handle = full


def test_a_rejection_without_a_logger_does_no_harm(fmu):
    for arguments in (None, byref(Host(logger=False).callbacks)):
        assert fmu.library.fmi2Instantiate(b"probe", 1, b"wrong", None, arguments, 0, 1) is None


def test_the_memory_of_the_master_is_used_for_everything(fmu):
    host = Host()
    recording(fmu, host)
    assert host.requests > 2
    assert host.live == set()


def test_every_request_for_memory_may_fail(fmu):
    """Instantiation then fails as a whole, a later call alone; each is reported and nothing is
    lost.
    """
    needed = Host()
    recording(fmu, needed)
    for n in range(1, needed.requests + 1):
        host = Host(out_of_memory_at=n)
        with pytest.raises(AssertionError, match="out of memory"):
            recording(fmu, host)
        assert host.requests >= n
        assert host.live == set()


def test_a_failed_instantiation_gives_all_memory_back(fmu):
    with Instance(fmu) as instance:
        needed = instance.host.requests
    for n in range(1, needed + 1):
        host = Host(out_of_memory_at=n)
        assert Instance(fmu, host=host).handle is None
        assert host.live == set()
        assert host.errors == ["fmi2Instantiate: out of memory"]


# ---- the log


def test_messages_carry_the_name_of_the_instance_and_the_environment(fmu):
    with Instance(fmu, "one") as one, Instance(fmu, "two", host=one.host):
        assert one.call("fmi2Terminate") is Status.ERROR
    (error,) = [m for m in one.host.messages if m.category == "logStatusError"]
    assert (error.instance, error.environment) == ("one", Host.ENVIRONMENT)
    assert {m.instance for m in one.host.messages} == {"one", "two"}
    assert {m.environment for m in one.host.messages} == {Host.ENVIRONMENT}


def test_the_name_of_the_instance_is_copied(fmu):
    with Instance(fmu, "before") as instance:
        name = api.ctypes.create_string_buffer(b"before")
        arguments = (name, 1, fmu.about.guid.encode(), None, byref(instance.host.callbacks), 0, 1)
        other = fmu.library.fmi2Instantiate(*arguments)
        name.value = b"after!"
        fmu.library.fmi2Terminate(other)
        fmu.library.fmi2FreeInstance(other)
    assert instance.host.messages[-1].instance == "before"


def provoke(instance):
    """An event, a warning, an error; the categories of the messages about them."""
    instance.ok("fmi2Reset")
    instance.host.messages.clear()
    instance.start()
    instance.call("fmi2GetStatus", 0, byref(api.c_int()))
    instance.call("fmi2DoStep", 17.0, 0.1, 0)
    return [m.category for m in instance.host.messages]


def categories(*names):
    return 1, len(names), (api.c_char_p * len(names))(*(name.encode() for name in names))


def test_debug_logging_starts_as_requested(fmu):
    with Instance(fmu, logging=True) as loud, Instance(fmu, logging=False) as quiet:
        assert provoke(loud) == ["logEvents", "logStatusWarning", "logStatusError"]
        assert provoke(quiet) == ["logStatusError"], "the reason of a rejection is always reported"


@pytest.mark.parametrize("chosen", CATEGORIES)
def test_exactly_the_requested_categories_are_logged_and_errors_always(fmu, chosen):
    with Instance(fmu) as instance:
        for _ in range(2):
            instance.ok("fmi2SetDebugLogging", *categories(chosen))
            assert set(provoke(instance)) == {chosen, "logStatusError"}
            instance.ok("fmi2SetDebugLogging", *categories(*CATEGORIES))
            assert set(provoke(instance)) == set(CATEGORIES)


def test_debug_logging_can_be_switched_off_and_on_as_a_whole(fmu):
    with Instance(fmu) as instance:
        instance.ok("fmi2SetDebugLogging", 0, 0, None)
        assert set(provoke(instance)) == {"logStatusError"}
        instance.ok("fmi2SetDebugLogging", 1, 0, None)
        assert set(provoke(instance)) == set(CATEGORIES)


def test_unknown_categories_are_rejected_and_change_nothing(fmu):
    with Instance(fmu) as instance:
        instance.ok("fmi2SetDebugLogging", *categories("logStatusWarning"))
        for wrong in (("logAll",), ("logEvents", "nonsense"), ("",), ("logevents",)):
            instance.host.messages.clear()
            assert instance.call("fmi2SetDebugLogging", *categories(*wrong)) is Status.ERROR
            assert instance.host.errors[0].startswith("fmi2SetDebugLogging: ")
        assert set(provoke(instance)) == {"logStatusWarning", "logStatusError"}


def test_messages_are_no_format_strings(fmu):
    """The logger reads its text as a printf format: a percent sign in it must be doubled or not be
    there at all.
    """
    host = Host()
    assert Instance(fmu, host=host, guid="{100%s%n%5000d}").handle is None
    assert re.search(r"(?<!%)%(?:%%)*(?!%)", host.errors[0]) is None


def test_declared_categories_are_those_in_use(fmu):
    declared = {c.attrib["name"] for c in fmu.about.root.findall("LogCategories/Category")}
    with Instance(fmu) as instance:
        assert set(provoke(instance)) == declared


# ---- allocation behind the back of an instance


def test_states_outlive_neither_more_nor_less_than_they_should(fmu):
    """A state may be freed through another instance of the same master, as masters with one heap
    do.
    """
    host = Host()
    with Instance(fmu, host=host) as one, Instance(fmu, host=host) as other:
        state = one.start().save()
        other.start()
        other.drop(state)
        assert state == c_void_p() or state.value is None
    assert host.live == set()
