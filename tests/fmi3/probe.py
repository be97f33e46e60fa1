# SPDX-License-Identifier: BSD-2-Clause
"""Demands of FMI 3.0 on an FMU for co-simulation, by raw calls: no FMPy, no harness.

    python tests/fmi3/probe.py [--third-party] FILE.fmu...

Every function of `PROBES` is one demand; `OWN` are demands that FMI leaves open and this project
makes: a rejected call leaves the instance alive, nothing that is not finite gets in, damaged states
are rejected. --third-party: only what the standard demands.
"""

from __future__ import annotations

import ctypes
import math
import sys
import tempfile
import zipfile
from collections.abc import Callable
from ctypes import byref, c_bool, c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree import ElementTree

PLATFORMS = {
    "linux": ("x86_64-linux", ".so"),
    "darwin": ("x86_64-darwin", ".dylib"),
    "win32": ("x86_64-windows", ".dll"),
}
FOLDER, ENDING = PLATFORMS[sys.platform]
OK, WARNING, DISCARD, ERROR = range(4)
LOGGER = ctypes.CFUNCTYPE(None, c_void_p, c_int, c_char_p, c_char_p)
FLAGS = (c_bool * 3, c_double)
POINTER, SIZE = ctypes.c_void_p, c_size_t

ARGUMENTS = {
    "SetDebugLogging": (c_bool, SIZE, POINTER),
    "EnterInitializationMode": (c_bool, c_double, c_double, c_bool, c_double),
    "ExitInitializationMode": (),
    "Terminate": (),
    "Reset": (),
    "GetFloat64": (POINTER, SIZE, POINTER, SIZE),
    "SetFloat64": (POINTER, SIZE, POINTER, SIZE),
    "GetInt32": (POINTER, SIZE, POINTER, SIZE),
    "SetBoolean": (POINTER, SIZE, POINTER, SIZE),
    "GetClock": (POINTER, SIZE, POINTER),
    "GetFMUState": (POINTER,),
    "SetFMUState": (POINTER,),
    "FreeFMUState": (POINTER,),
    "SerializedFMUStateSize": (POINTER, POINTER),
    "SerializeFMUState": (POINTER, POINTER, SIZE),
    "DeserializeFMUState": (POINTER, SIZE, POINTER),
    "GetDirectionalDerivative": (POINTER, SIZE) * 4,
    "GetAdjointDerivative": (POINTER, SIZE) * 4,
    "DoStep": (c_double, c_double, c_bool, POINTER, POINTER, POINTER, POINTER),
    "EnterEventMode": (),
    "EnterConfigurationMode": (),
    "GetNumberOfContinuousStates": (POINTER,),
}


@dataclass(frozen=True)
class Variable:
    """A variable of the description; size: its elements."""

    name: str
    reference: int
    causality: str
    size: int
    start: tuple[float, ...]
    low: float
    high: float


class Fmu:
    """An unpacked FMU with its library loaded."""

    def __init__(self, archive: Path, folder: Path) -> None:
        with zipfile.ZipFile(archive) as files:
            files.extractall(folder)
        self.folder, self.name = folder, archive.stem
        self.root = ElementTree.parse(folder / "modelDescription.xml").getroot()
        self.token = self.root.attrib["instantiationToken"].encode()
        about = self.root.find("CoSimulation")
        assert about is not None
        self.about = about
        file = folder / "binaries" / FOLDER / (about.attrib["modelIdentifier"] + ENDING)
        self.library = ctypes.CDLL(str(file))
        for name, arguments in ARGUMENTS.items():
            getattr(self.library, f"fmi3{name}").argtypes = (c_void_p, *arguments)
        self.library.fmi3GetVersion.restype = c_char_p
        self.library.fmi3FreeInstance.argtypes = (c_void_p,)
        self.library.fmi3FreeInstance.restype = None
        new = self.library.fmi3InstantiateCoSimulation
        new.restype = c_void_p
        new.argtypes = (c_char_p, c_char_p, c_char_p, c_bool, c_bool, c_bool, c_bool, POINTER, SIZE,
                        c_void_p, LOGGER, c_void_p)  # fmt: skip
        for kind in ("ModelExchange", "ScheduledExecution"):
            getattr(self.library, f"fmi3Instantiate{kind}").restype = c_void_p

    def able(self, what: str) -> bool:
        """A capability flag of the description."""
        return self.about.get(what, "false") == "true"

    @cached_property
    def variables(self) -> list[Variable]:
        """Variables of type Float64; an array is as large as its dimensions and structural
        parameters say.
        """
        table = self.root.find("ModelVariables")
        assert table is not None
        sizes = {e.get("valueReference"): e.get("start", "1") for e in table}
        found = []
        for e in table.iter("Float64"):
            shape = [
                int(d.get("start") or sizes[d.get("valueReference")]) for d in e.iter("Dimension")
            ]
            start = tuple(map(float, e.get("start", "").split()))
            found.append(
                Variable(
                    e.attrib["name"], int(e.attrib["valueReference"]), e.get("causality", "local"),
                    math.prod(shape), start, float(e.get("min", -math.inf)),
                    float(e.get("max", math.inf)),
                )
            )  # fmt: skip
        return found

    def of(self, causality: str) -> list[Variable]:
        """Variables of one causality."""
        return [v for v in self.variables if v.causality == causality]


class Instance:
    """One instance of an FMU. Frees itself at the end of a `with` block."""

    def __init__(self, fmu: Fmu, *, token: bytes | None = None, name: bytes = b"probe",
                 event_mode: bool = False, early: bool = False) -> None:  # fmt: skip
        self.fmu, self.messages = fmu, []
        self.logger = LOGGER(lambda _, status, category, text: self.messages.append(text.decode()))
        self.handle = fmu.library.fmi3InstantiateCoSimulation(
            name, fmu.token if token is None else token, str(fmu.folder / "resources/").encode(),
            False, True, event_mode, early, None, 0, None, self.logger, None,
        )  # fmt: skip

    def __enter__(self) -> Instance:
        assert self.handle, self.messages
        return self

    def __exit__(self, *_: object) -> None:
        self.fmu.library.fmi3FreeInstance(self.handle)

    def call(self, function: str, *arguments: object) -> int:
        """The status of one call."""
        return getattr(self.fmu.library, f"fmi3{function}")(self.handle, *arguments)

    def ok(self, function: str, *arguments: object) -> None:
        """One call that must be OK."""
        status = self.call(function, *arguments)
        assert status == OK, f"{function} answered {status}: {self.messages[-1:]}"

    def set(self, variables: list[Variable], values: list[float], count: int | None = None) -> int:
        """Status of SetFloat64."""
        where = (c_uint * len(variables))(*(v.reference for v in variables))
        buffer = (c_double * max(len(values), 1))(*values)
        length = len(values) if count is None else count
        return self.call("SetFloat64", where, len(variables), buffer, length)

    def get(self, variables: list[Variable]) -> bytes:
        """The bits of variables."""
        where = (c_uint * len(variables))(*(v.reference for v in variables))
        buffer = (c_double * sum(v.size for v in variables))()
        self.ok("GetFloat64", where, len(variables), buffer, len(buffer))
        return bytes(buffer)

    def outputs(self) -> bytes:
        """The bits of all outputs."""
        return self.get(self.fmu.of("output"))

    def enter(self, start: float = 0.0, stop: float | None = None) -> None:
        """To initialization mode."""
        span = (False, 0.0, start, stop is not None, stop or 0.0)
        self.ok("EnterInitializationMode", *span)

    def start(self, start: float = 0.0, stop: float | None = None) -> Instance:
        """To step mode."""
        self.enter(start, stop)
        self.ok("ExitInitializationMode")
        return self

    def step(self, t: float, h: float = 0.1) -> tuple[int, bool, bool, bool, float]:
        """Status of a step, and what it reports: event, terminate, early return, last time."""
        reported, last = (c_bool * 3)(True, True, True), c_double(math.nan)
        places = [ctypes.addressof(reported) + i for i in range(3)]
        status = self.call("DoStep", t, h, False, *places, byref(last))
        return (status, *reported, last.value)

    def simulate(self, steps: int, h: float = 0.1, first: int = 0) -> bytes:
        """The bits of all outputs after each of so many steps that must be OK."""
        record = b""
        for k in range(first, first + steps):
            status = self.step(k * h, h)[0]
            assert status == OK, f"step {k} answered {status}: {self.messages[-1:]}"
            record += self.outputs()
        return record

    def save(self) -> c_void_p:
        """The state now."""
        state = c_void_p()
        self.ok("GetFMUState", byref(state))
        return state

    def serialize(self, state: c_void_p) -> bytes:
        """Its bytes."""
        size = c_size_t()
        self.ok("SerializedFMUStateSize", state, byref(size))
        buffer = ctypes.create_string_buffer(size.value)
        self.ok("SerializeFMUState", state, buffer, size)
        return buffer.raw

    def restored(self, data: bytes) -> int:
        """Status of making a state of bytes, which is then dropped."""
        state = c_void_p()
        status = self.call("DeserializeFMUState", data, len(data), byref(state))
        self.call("FreeFMUState", byref(state))
        return status

    def derivative(self, unknown: list[Variable], known: list[Variable], seed: list[float],
                   sensitivities: int | None = None) -> tuple[int, list[float]]:  # fmt: skip
        """Status and sensitivity along the seed."""
        rows, columns = ((c_uint * len(vs))(*(v.reference for v in vs)) for vs in (unknown, known))
        count = sum(v.size for v in unknown) if sensitivities is None else sensitivities
        result = (c_double * max(count, 1))()
        given = (c_double * max(len(seed), 1))(*seed)
        status = self.call("GetDirectionalDerivative", rows, len(unknown), columns, len(known),
                           given, len(seed), result, count)  # fmt: skip
        return status, list(result)


PROBES: list[Callable[[Fmu], None]] = []
OWN: list[Callable[[Fmu], None]] = []


def demand(probe: Callable[[Fmu], None]) -> Callable[[Fmu], None]:
    """Register a demand of the standard."""
    PROBES.append(probe)
    return probe


def own_demand(probe: Callable[[Fmu], None]) -> Callable[[Fmu], None]:
    """Register a demand of this project."""
    OWN.append(probe)
    return probe


# ---- life
@demand
def version(fmu: Fmu) -> None:
    assert fmu.library.fmi3GetVersion().startswith(b"3.")


@demand
def wrong_token(fmu: Fmu) -> None:
    assert not Instance(fmu, token=b"{00000000}").handle


@own_demand
def event_mode_is_rejected(fmu: Fmu) -> None:
    one = Instance(fmu, event_mode=True)
    assert not one.handle
    assert "this FMU has no event mode" in one.messages[0]


@own_demand
def an_instance_has_a_name(fmu: Fmu) -> None:
    assert not Instance(fmu, name=b"").handle


@demand
def early_return_may_be_allowed(fmu: Fmu) -> None:
    with Instance(fmu, early=True) as one:
        assert one.start().step(0.0)[:4] == (OK, False, False, False)


@demand
def other_interfaces_give_no_instance(fmu: Fmu) -> None:
    for kind in ("ModelExchange", "ScheduledExecution"):
        if fmu.root.find(kind) is None:
            new = getattr(fmu.library, f"fmi3Instantiate{kind}")
            nothing = [None] * (2 if kind == "ModelExchange" else 5)
            logger = ctypes.cast(LOGGER(), c_void_p)
            assert not new(b"x", fmu.token, b"", False, False, None, logger, *nothing[2:])


@demand
def a_life(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.start(stop=10.0).simulate(5)
        one.ok("Terminate")


@demand
def two_lives_are_equal(fmu: Fmu) -> None:
    with Instance(fmu) as one, Instance(fmu) as other:
        assert one.start().simulate(10) == other.start().simulate(10)


@demand
def instances_do_not_disturb_each_other(fmu: Fmu) -> None:
    with Instance(fmu) as alone:
        expected = alone.start().simulate(6)
    with Instance(fmu) as one, Instance(fmu) as other:
        one.start(), other.start()
        record = b""
        for k in range(6):
            record += one.simulate(1, first=k)
            other.simulate(1, first=k)
        assert record == expected


@demand
def reset_begins_anew(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        first = one.start().simulate(5)
        one.ok("Terminate")
        one.ok("Reset")
        assert one.start().simulate(5) == first


@demand
def reset_while_stepping(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        first = one.start().simulate(5)
        one.ok("Reset")
        assert one.start().simulate(5) == first


@demand
def outputs_can_be_read_in_initialization_mode(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.enter()
        before = one.outputs()
        one.ok("ExitInitializationMode")
        assert one.outputs() == before


@demand
def outputs_can_be_read_after_the_end(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        last = one.start().simulate(3)[-len(one.outputs()) :]
        one.ok("Terminate")
        assert one.outputs() == last


@own_demand
def calls_out_of_order_are_rejected_and_harmless(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        assert one.call("ExitInitializationMode") == ERROR
        assert one.step(0.0)[0] == ERROR
        assert one.call("Terminate") == ERROR
        one.enter()
        assert one.step(0.0)[0] == ERROR
        one.ok("ExitInitializationMode")
        assert one.call("EnterInitializationMode", False, 0.0, 0.0, False, 0.0) == ERROR
        record = one.simulate(4)
    with Instance(fmu) as other:
        assert other.start().simulate(4) == record


@own_demand
def a_start_time_that_is_not_finite_is_rejected(fmu: Fmu) -> None:
    for start in (math.nan, math.inf):
        with Instance(fmu) as one:
            assert one.call("EnterInitializationMode", False, 0.0, start, False, 0.0) == ERROR
            one.start().simulate(1)


@own_demand
def a_stop_before_the_start_is_rejected(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        assert one.call("EnterInitializationMode", False, 0.0, 5.0, True, 5.0) == ERROR
        one.start().simulate(1)


# ---- steps
@demand
def a_step_states_what_it_did(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        status, event, terminate, early, last = one.start().step(0.0, 0.1)
        assert (status, event, terminate, early) == (OK, False, False, False)
        assert math.isclose(last, 0.1)


@own_demand
def a_step_without_memory_for_results_is_rejected(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.start()
        assert one.call("DoStep", 0.0, 0.1, False, None, None, None, None) == ERROR
        one.simulate(1)


@own_demand
def impossible_steps_are_rejected_and_harmless(fmu: Fmu) -> None:
    with Instance(fmu) as one, Instance(fmu) as other:
        one.start(stop=10.0), other.start(stop=10.0)
        wrong = ((0.0, 0.0), (0.0, -0.1), (0.0, math.nan), (1.0, 0.1), (0.0, 11.0))
        for t, h in wrong:
            assert one.step(t, h)[0] == ERROR
        assert one.simulate(5) == other.simulate(5)


@demand
def time_is_a_variable(fmu: Fmu) -> None:
    (time,) = fmu.of("independent")
    with Instance(fmu) as one:
        one.start(start=2.0)
        assert one.get([time]) == bytes(c_double(2.0))
        assert one.step(2.0, 0.5)[0] == OK
        assert one.get([time]) == bytes(c_double(2.5))
        mixed = one.get([time, *fmu.of("output")])
        assert mixed == bytes(c_double(2.5)) + one.outputs()


# ---- values
@demand
def start_values_are_those_declared(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.enter()
        for v in fmu.of("parameter") + fmu.of("input"):
            assert one.get([v]) == bytes((c_double * v.size)(*v.start)), v.name


@demand
def what_is_set_is_read(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.enter()
        for v in fmu.of("input"):
            values = list(v.start)
            assert one.set([v], values) == OK
            assert one.get([v]) == bytes((c_double * v.size)(*values)), v.name


@demand
def several_variables_in_any_order(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.start().simulate(2)
        together = list(reversed(fmu.of("output")))
        assert one.get(together) == b"".join(one.get([v]) for v in together)
        assert one.get(together[:1] * 3) == one.get(together[:1]) * 3


@demand
def nothing_can_be_read_and_set(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.start()
        one.ok("GetFloat64", None, 0, None, 0)
        one.ok("SetFloat64", None, 0, None, 0)


@own_demand
def a_wrong_number_of_values_is_rejected(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.start()
        output = fmu.of("output")[0]
        where, buffer = (c_uint * 1)(output.reference), (c_double * (output.size + 1))()
        for count in (output.size + 1, output.size - 1):
            assert one.call("GetFloat64", where, 1, buffer, count) == ERROR
        for v in fmu.of("input")[:1]:
            assert one.set([v], [0.0] * (v.size + 1)) == ERROR
        one.simulate(2)


@own_demand
def a_known_call_with_a_wrong_number_of_values_is_rejected(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.start().simulate(2)
        outputs = fmu.of("output")
        where = (c_uint * len(outputs))(*(v.reference for v in outputs))
        size = sum(v.size for v in outputs)
        buffer = (c_double * (size + 1))()
        one.ok("GetFloat64", where, len(outputs), buffer, size)
        for wrong in (size - 1, size + 1):
            assert one.call("GetFloat64", where, len(outputs), buffer, wrong) == ERROR


@own_demand
def references_between_variables_are_rejected(fmu: Fmu) -> None:
    known = {v.reference for v in fmu.variables}
    with Instance(fmu) as one:
        one.start()
        for reference in (1, 999, max(known) + 1, 2**32 - 1):
            where = (c_uint * 1)(reference)
            assert one.call("GetFloat64", where, 1, (c_double * 1)(), 1) == ERROR, reference
        assert "no variable with value reference" in one.messages[-1]


@own_demand
def outputs_and_time_cannot_be_set(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        for v in (*fmu.of("output")[:1], *fmu.of("independent")):
            assert one.set([v], [0.0] * v.size) == ERROR
            assert f"{v.name}: is " in one.messages[-1]


@own_demand
def parameters_are_fixed_after_initialization(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.start()
        for v in fmu.of("parameter"):
            assert one.set([v], list(v.start)) == ERROR


@own_demand
def values_that_are_not_finite_are_rejected(fmu: Fmu) -> None:
    with Instance(fmu) as one, Instance(fmu) as other:
        one.start(), other.start()
        for v in fmu.of("input"):
            for wrong in (math.nan, math.inf, -math.inf):
                assert one.set([v], [*v.start[:-1], wrong]) == ERROR
        assert one.simulate(3) == other.simulate(3)


@own_demand
def nothing_is_set_where_one_value_is_rejected(fmu: Fmu) -> None:
    inputs = fmu.of("input")
    with Instance(fmu) as one:
        one.start()
        if len(inputs) > 1:
            before = one.get(inputs)
            values = [x + 1.0 for v in inputs[:-1] for x in v.start]
            assert one.set(inputs, [*values, *[math.nan] * inputs[-1].size]) == ERROR
            assert one.get(inputs) == before


@own_demand
def bounds_of_inputs_hold(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.start()
        for v in fmu.of("input"):
            for wrong in (v.low - 1.0, v.high + 1.0):
                if math.isfinite(wrong):
                    assert one.set([v], [wrong] * v.size) == ERROR


@demand
def other_types_have_no_variables(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.start()
        one.ok("GetInt32", None, 0, None, 0)
        one.ok("SetBoolean", None, 0, None, 0)
        one.ok("GetClock", None, 0, None)


@own_demand
def other_types_are_rejected(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.start()
        where, space = (c_uint * 1)(0), (c_double * 1)()
        assert one.call("GetInt32", where, 1, space, 1) == ERROR
        assert one.call("GetClock", where, 1, space) == ERROR
        for function in ("EnterEventMode", "EnterConfigurationMode"):
            assert one.call(function) == ERROR
        assert one.call("GetNumberOfContinuousStates", byref(c_size_t())) == ERROR
        one.simulate(2)


# ---- states
@demand
def a_state_brings_back_the_past(fmu: Fmu) -> None:
    if fmu.able("canGetAndSetFMUState"):
        with Instance(fmu) as one:
            one.start().simulate(3)
            state = one.save()
            future = one.simulate(5, first=3)
            one.ok("SetFMUState", state)
            assert one.simulate(5, first=3) == future
            one.ok("FreeFMUState", byref(state))
            assert state.value is None


@demand
def a_state_is_retained_in_the_place_of_an_old_one(fmu: Fmu) -> None:
    if fmu.able("canGetAndSetFMUState"):
        with Instance(fmu) as one:
            state = one.start().save()
            one.simulate(3)
            later = one.outputs()
            one.ok("GetFMUState", byref(state))
            one.simulate(3, first=3)
            one.ok("SetFMUState", state)
            assert one.outputs() == later
            one.ok("FreeFMUState", byref(state))


@demand
def bytes_of_a_state_bring_it_back(fmu: Fmu) -> None:
    if fmu.able("canSerializeFMUState"):
        with Instance(fmu) as one, Instance(fmu) as other:
            one.start().simulate(3)
            state = one.save()
            data = one.serialize(state)
            one.ok("FreeFMUState", byref(state))
            made = c_void_p()
            other.ok("DeserializeFMUState", data, len(data), byref(made))
            other.ok("SetFMUState", made)
            other.ok("FreeFMUState", byref(made))
            assert one.simulate(4, first=3) == other.simulate(4, first=3)


@own_demand
def damaged_bytes_of_a_state_are_rejected(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.start().simulate(2)
        state = one.save()
        data = one.serialize(state)
        one.ok("FreeFMUState", byref(state))
        assert one.restored(data) == OK
        for place in (0, 9, len(data) // 2, len(data) - 1):
            damaged = bytearray(data)
            damaged[place] ^= 1
            assert one.restored(bytes(damaged)) == ERROR, place
        assert one.restored(data[:-1]) == ERROR
        assert one.restored(b"") == ERROR


@own_demand
def a_state_for_no_one_is_rejected(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        assert one.call("SetFMUState", None) == ERROR
        assert one.call("GetFMUState", None) == ERROR
        one.ok("FreeFMUState", byref(c_void_p()))


# ---- derivatives
@demand
def derivatives_agree_with_differences(fmu: Fmu) -> None:
    """Also of rows of several elements, whose seeds follow one another."""
    inputs = [v for v in fmu.of("input") if v.high == math.inf and v.low == -math.inf]
    if not fmu.able("providesDirectionalDerivatives") or not inputs:
        return
    outputs, known = fmu.of("output"), inputs[:1]
    with Instance(fmu) as one:
        one.start().simulate(2)
        seed = [0.0] * (known[0].size - 1) + [1.0]
        status, along = one.derivative(outputs, known, seed)
        assert status == OK
        status, twice = one.derivative(outputs, known, [2 * x for x in seed])
        assert status == OK
        for a, b in zip(along, twice, strict=True):
            assert math.isclose(2 * a, b, rel_tol=1e-3, abs_tol=1e-6 * (1 + max(map(abs, along))))


@own_demand
def wrong_lengths_of_derivatives_are_rejected(fmu: Fmu) -> None:
    outputs, known = fmu.of("output"), fmu.of("input")[:1]
    with Instance(fmu) as one:
        one.start()
        size = sum(v.size for v in known)
        assert one.derivative(outputs, known, [0.0] * (size + 1))[0] == ERROR
        assert one.derivative(outputs, known, [0.0] * size, 0)[0] == ERROR
        assert one.derivative(known or outputs, outputs, [])[0] == ERROR
        assert one.derivative(outputs, known, [0.0] * size)[0] == OK


@own_demand
def adjoint_derivatives_are_rejected(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.start()
        assert one.call("GetAdjointDerivative", *(None, 0) * 4) == ERROR


# ---- log
@demand
def log_categories_are_those_declared(fmu: Fmu) -> None:
    names = [e.attrib["name"].encode() for e in fmu.root.iterfind("LogCategories/Category")]
    with Instance(fmu) as one:
        one.ok("SetDebugLogging", True, len(names), (c_char_p * max(len(names), 1))(*names))
        one.ok("SetDebugLogging", False, 0, None)


@own_demand
def unknown_log_categories_are_rejected(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        assert one.call("SetDebugLogging", True, 1, (c_char_p * 1)(b"logNonsense")) == ERROR


@own_demand
def a_rejection_states_which_function(fmu: Fmu) -> None:
    with Instance(fmu) as one:
        one.call("Terminate")
        assert one.messages[-1].startswith("fmi3Terminate: ")


def failures(archive: Path, *, third_party: bool = False) -> list[str]:
    """Return the demands that an FMU does not fulfil, one line each."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        fmu = Fmu(archive, Path(folder))
        for probe in PROBES if third_party else [*PROBES, *OWN]:
            try:
                probe(fmu)
            except AssertionError as error:
                text = " ".join(str(error).split())
                found.append(f"{archive.name}: {probe.__name__}: {text or 'is not so'}")
    return found


def main() -> None:
    """Command line, see the docstring of the module."""
    words = sys.argv[1:]
    third_party = "--third-party" in words
    archives = [Path(word) for word in words if word != "--third-party"]
    found = [line for path in archives for line in failures(path, third_party=third_party)]
    probes = len(PROBES) if third_party else len(PROBES) + len(OWN)
    print(*found, f"{len(archives)} FMUs, {probes} probes each: {len(found)} fail", sep="\n")
    sys.exit(bool(found))


if __name__ == "__main__":
    main()
