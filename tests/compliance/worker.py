# SPDX-License-Identifier: BSD-2-Clause
"""Runs sequences of FMI calls in a process of its own, so that a crash is the end of this process
only.

Usage: python -m tests.compliance.worker. Reads a line per sequence from the standard input (JSON:
[path of the FMU, list of calls], each call [slot, verb, arguments...]; two slots for instances,
saved states and bytes are shared between them) and answers with a line: for every call [status,
number of error messages], or null where there was nothing to call. A value that is read and is not
finite, and an fmi2OK for a damaged state, end the process with an exception.
"""

from __future__ import annotations

import json
import math
import sys
import tempfile
from ctypes import byref, c_double, c_int, c_void_p
from functools import cache
from pathlib import Path

from tests.compliance import api
from tests.compliance.api import Status
from tests.compliance.probe import Fmu, Host, Instance


class Session:
    """Two instances, up to four saved states, up to four arrays of bytes. Verbs are the methods
    called do_<verb>.
    """

    def __init__(self, fmu: Fmu) -> None:
        self.fmu, self.host = (
            fmu,
            Host(),
        )  # one host: a state may be released by another instance than the one that gave it
        self.slots: list[Instance | None] = [None, None]
        self.states: dict[int, c_void_p] = {}
        self.bytes: dict[int, bytes] = {}

    def do(self, slot, verb, *arguments):
        if verb == "new":
            return self.new(slot)
        instance = self.slots[slot]
        if instance is None:
            return None
        self.host.messages.clear()
        status = getattr(self, f"do_{verb}")(instance, *arguments)
        return None if status is None else (status, len(self.host.errors))

    def new(self, slot):
        if self.slots[slot]:
            self.slots[slot].free()
        self.slots[slot] = Instance(self.fmu, host=self.host)
        return (Status.OK if self.slots[slot].handle else Status.ERROR, 0)

    def end(self):
        for instance in filter(None, self.slots):
            for state in self.states.values():
                instance.drop(state)
            instance.free()

    # ---- life cycle and steps

    def do_call(self, instance, function, *arguments):
        return instance.call(function, *arguments)

    def do_setup(self, instance, start, stop):
        return instance.call("fmi2SetupExperiment", 0, 0.0, start, stop is not None, stop or 0.0)

    def do_step(self, instance, offset, h):
        now = c_double(0.0)
        instance.call("fmi2GetRealStatus", api.LAST_SUCCESSFUL_TIME, byref(now))
        self.host.messages.clear()  # that question is none of the sequence
        return instance.call("fmi2DoStep", now.value + offset, h, 0)

    # ---- values

    def do_set(self, instance, references, value):
        values = api.reals([value * (1 + 0.1 * i) for i in range(len(references))])
        return instance.call("fmi2SetReal", api.references(references), len(references), values)

    def do_get(self, instance, references):
        values = api.reals([0.0] * len(references))
        status = instance.call("fmi2GetReal", api.references(references), len(references), values)
        assert all(map(math.isfinite, values)), (status, references)
        return status

    def do_derivative(self, instance, unknown, known, seed):
        result = api.reals([0.0] * len(unknown))
        rows, columns = api.references(unknown), api.references(known)
        arguments = (
            rows,
            len(unknown),
            columns,
            len(known),
            api.reals([seed] * len(known)),
            result,
        )
        return instance.call("fmi2GetDirectionalDerivative", *arguments)

    def do_other(self, instance, function, count):
        values = (api.c_char_p if function.endswith("String") else c_int) * 2
        return instance.call(function, (api.c_uint * 2)(), count, values())

    def do_order(self, instance, function, count):
        return instance.call(
            function, (api.c_uint * 2)(), count, (c_int * 2)(), api.reals([0.0, 0.0])
        )

    def do_log(self, instance, on, categories):
        names = (api.c_char_p * len(categories))(*(name.encode() for name in categories))
        return instance.call("fmi2SetDebugLogging", on, len(names), names)

    def do_status(self, instance, function, kind):
        return instance.call(
            function, kind, api.ARGUMENTS[function][1](api.ARGUMENTS[function][1]._type_())
        )

    # ---- states

    def do_save(self, instance, k):
        state = self.states.get(k, c_void_p())
        status = instance.call("fmi2GetFMUstate", byref(state))
        self.states[k] = state
        return status

    def do_restore(self, instance, k):
        return instance.call("fmi2SetFMUstate", self.states[k]) if k in self.states else None

    def do_drop(self, instance, k):
        return (
            instance.call("fmi2FreeFMUstate", byref(self.states.pop(k)))
            if k in self.states
            else None
        )

    def do_serialize(self, instance, k, j):
        if k not in self.states:
            return None
        self.bytes[j] = instance.serialize(self.states[k])
        return Status.OK

    def do_deserialize(self, instance, j, k, damage):
        if j not in self.bytes:
            return None
        data = bytearray(self.bytes[j])
        if damage is not None:
            data[damage % len(data)] ^= 0x10
        state = self.states.get(k, c_void_p())
        status = instance.try_deserialize(bytes(data), state)
        assert (status is Status.OK) == (damage is None), "damage goes unnoticed"
        if state:
            self.states[k] = state
        return status


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        unpacked = cache(lambda path: Fmu(Path(path), Path(folder) / Path(path).stem))
        for line in sys.stdin:
            path, calls = json.loads(line)
            session = Session(unpacked(path))
            answers = [session.do(*call) for call in calls]
            session.end()
            print(json.dumps(answers), flush=True)


if __name__ == "__main__":
    main()
