# SPDX-License-Identifier: BSD-2-Clause
"""Values on their way between the bus and an FMU: the arguments of fmi2SetReal, fmi2GetInteger,
..., built once.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.system.graph import Wire
from harness.system.units import IDENTITY

CValue = ctypes.c_double | ctypes.c_int
CFunction = Any
"""A function of a loaded library (ctypes has no public type for it)."""
ACCESS: dict[str, tuple[tuple[str, ...], type[CValue]]] = {
    "Real": (("Real",), ctypes.c_double),
    "Integer": (("Integer", "Enumeration"), ctypes.c_int),
    "Boolean": (("Boolean",), ctypes.c_int),
}
"""Types of variables by the functions fmi2SetX and fmi2GetX that access them, and the C type of
their values.
"""


class Piece(ctypes.Structure):
    """Neighbours on the bus (struct Piece of loop.c)."""

    _fields_ = [("slot", ctypes.c_size_t), ("count", ctypes.c_size_t)]


class Transfer:
    """Values of one FMI type: the arguments of one fmi2GetX or fmi2SetX call."""

    def __init__(
        self,
        function: CFunction,
        component: ctypes.c_void_p,
        wires: Sequence[Wire],
        ctype: type[CValue],
    ) -> None:
        n = len(wires)
        self.function = function
        self.component = component
        self.real = ctype is ctypes.c_double
        self.references = (ctypes.c_uint * n)(*(wire.variable.reference for wire in wires))
        self.values = (ctype * n)()
        self.slots: NDArray[np.uintp] = np.array([wire.slot for wire in wires], dtype=np.uintp)
        self.view = np.ctypeslib.as_array(self.values)
        self.names = [wire.variable.name for wire in wires]
        self.factors: NDArray[np.float64] = np.array([wire.change.factor for wire in wires])
        self.offsets: NDArray[np.float64] = np.array([wire.change.offset for wire in wires])
        self.plain = all(wire.change == IDENTITY for wire in wires)

    @cached_property
    def pieces(self) -> ctypes.Array[Piece]:
        """The slots as pieces of neighbours."""
        runs = np.split(self.slots, np.flatnonzero(np.diff(self.slots) != 1) + 1)
        return (Piece * len(runs))(*(Piece(int(run[0]), len(run)) for run in runs))

    def write(self, bus: NDArray[np.float64]) -> int:
        """From the bus into the inputs of the FMU; returns the FMI status."""
        values = bus[self.slots]
        self.view[:] = values if self.plain else self.factors * values + self.offsets
        return int(self.function(self.component, self.references, len(self.values), self.values))

    def read(self, bus: NDArray[np.float64]) -> int:
        """From the outputs of the FMU onto the bus; returns the FMI status."""
        status = int(self.function(self.component, self.references, len(self.values), self.values))
        bus[self.slots] = self.view
        return status

    def not_finite(self) -> str | None:
        """The first variable whose value is infinite or not a number."""
        return next(
            (
                name
                for name, value in zip(self.names, self.values, strict=True)
                if not np.isfinite(value)
            ),
            None,
        )


def transfers(
    verb: str, library: ctypes.CDLL, component: ctypes.c_void_p, wires: Sequence[Wire]
) -> Iterator[Transfer]:
    """One transfer per FMI type that occurs among the wires, and one for what is changed on the
    way; verb: Set, Get.
    """
    for (suffix, (types, ctype)), plain in product(ACCESS.items(), (True, False)):
        if chosen := [
            w for w in wires if w.variable.type in types and (w.change == IDENTITY) == plain
        ]:
            yield Transfer(getattr(library, f"fmi2{verb}{suffix}"), component, chosen, ctype)
