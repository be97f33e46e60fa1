# SPDX-License-Identifier: BSD-2-Clause
"""Transfers of values between the bus and an FMU. The arguments of fmi2SetReal, fmi3GetFloat64 and
similar functions are built once.

The bus carries doubles. In FMI 3.0 one value reference represents a whole array, so a buffer also
contains the unconnected elements of the array, whose values do not change.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from harness.master.calls import Calls, layout
from harness.system.graph import Wire
from harness.system.interface import Interface
from harness.system.units import IDENTITY
from harness.system.values import EXACT, Scalar, Variable, resting

WIDE = ("Int64", "UInt64")
"""FMI types that contain whole numbers which a double cannot represent."""


class Piece(ctypes.Structure):
    """Consecutive slots of the bus that are consecutive in the buffer of a transfer too (struct
    Piece of loop.c).
    """

    _fields_ = layout((ctypes.c_size_t, "slot count at"))


class Transfer:
    """Values of one FMI type that one call sets or gets.

    function: Get or Set with the type, such as SetReal; wires: variables with their slots on the
    bus; rows: in FMI 3.0, for every value reference, the names of all elements of the array and the
    value that each has if it is unconnected; in FMI 2.0 None, because every scalar variable has a
    value reference.
    """

    def __init__(
        self,
        calls: Calls,
        function: str,
        wires: Sequence[Wire],
        rows: Mapping[int, Mapping[str, Scalar]] | None = None,
    ) -> None:
        self.function, self.handle = calls.function(function), calls.handle
        self.access = function[len("Get") :]
        self.type = list(calls.in_c).index(self.access)
        names = [name for row in rows.values() for name in row] if rows else _names(wires)
        starts = [value for row in rows.values() for value in row.values()] if rows else []
        references = list(rows or (w.variable.reference for w in wires))
        self.references = (ctypes.c_uint * len(references))(*references)
        self.values = (calls.in_c[self.access] * len(names))(*starts)
        sizes = (len(names),) if calls.fmi == 3 else ()
        self._arguments = (self.references, len(references), self.values, *sizes)
        self.names = _names(wires)
        places = {name: i for i, name in enumerate(names)}
        self.at: NDArray[np.uintp] = np.array([places[n] for n in self.names], dtype=np.uintp)
        self.slots: NDArray[np.uintp] = np.array([w.slot for w in wires], dtype=np.uintp)
        self.view = np.frombuffer(self.values, dtype=np.ctypeslib.as_array(self.values).dtype)
        self.factors: NDArray[np.float64] = np.array([w.change.factor for w in wires])
        self.offsets: NDArray[np.float64] = np.array([w.change.offset for w in wires])
        self.plain = all(w.change == IDENTITY for w in wires)
        self.real = calls.in_c[self.access] is ctypes.c_double

    @cached_property
    def pieces(self) -> ctypes.Array[Piece]:
        """Return the slots of this transfer as pieces, which are consecutive on the bus and in the
        buffer.
        """
        apart = (np.diff(self.slots) != 1) | (np.diff(self.at) != 1)
        runs = np.split(np.arange(len(self.slots)), np.flatnonzero(apart) + 1)
        return (Piece * len(runs))(
            *(Piece(int(self.slots[run[0]]), len(run), int(self.at[run[0]])) for run in runs)
        )

    def write(self, bus: NDArray[np.float64]) -> int:
        """Set the inputs of the FMU to the values on the bus, with their units converted if
        necessary, and return the FMI status.
        """
        values = bus[self.slots]
        self.view[self.at] = values if self.plain else self.factors * values + self.offsets
        return int(self.function(self.handle, *self._arguments))

    def read(self, bus: NDArray[np.float64]) -> int:
        """Get the outputs of the FMU, copy them onto the bus, and return the FMI status."""
        status = int(self.function(self.handle, *self._arguments))
        bus[self.slots] = self.view[self.at]
        return status

    def problem(self) -> tuple[str, str | None] | None:
        """Return an error message about the values that were read last, and the name of the
        variable (None: the message contains the name): a value is not finite, or is a whole number
        that a double cannot represent. Return None if all values are valid.
        """
        values = zip(self.names, self.view[self.at], strict=True)
        if self.view.dtype.kind == "f" and not np.isfinite(self.view).all():
            first = next((name for name, value in values if not np.isfinite(value)), None)
            return "output is not a finite number", first
        for name, value in values if self.access in WIDE else ():
            if abs(int(value)) > EXACT and int(float(value)) != int(value):
                return f"{name} = {value}: is beyond 2^53 and not exact as a double", None
        return None


def _names(wires: Sequence[Wire]) -> list[str]:
    return [wire.variable.name for wire in wires]


def transfers(
    verb: str, calls: Calls, wires: Sequence[Wire], interface: Interface, held: Mapping[str, Scalar]
) -> Iterator[Transfer]:
    """Yield the transfers of an FMU, one per FMI type of its wires. In FMI 2.0, values whose unit
    is converted have a transfer of their own.

    verb: Set or Get; held: values of unconnected inputs, by name, where they differ from the start
    values. In FMI 3.0 a call transfers whole arrays: it sets unconnected elements to these values.
    """

    def row(variable: Variable) -> dict[str, Scalar]:
        return {v.name: held.get(v.name, resting(v)) for v in interface.row(variable)}

    for access in calls.in_c:
        chosen = [w for w in wires if w.variable.access == access]
        if chosen and calls.fmi == 3:
            rows = {w.variable.reference: row(w.variable) for w in chosen}
            yield Transfer(calls, verb + access, chosen, rows)
            continue
        for plain in (True, False):
            if some := [w for w in chosen if (w.change == IDENTITY) == plain]:
                yield Transfer(calls, verb + access, some)
