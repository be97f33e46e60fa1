# SPDX-License-Identifier: BSD-2-Clause
"""Values on their way between the bus and an FMU: the arguments of fmi2SetReal, fmi3GetFloat64 and
so on, built once.

The bus carries doubles. In FMI 3.0 one value reference stands for a whole array: elements that
nobody drives keep their value in the buffer.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.master.calls import CTYPES_3, Calls
from harness.system.graph import Wire
from harness.system.interface import Interface
from harness.system.units import IDENTITY
from harness.system.values import EXACT, Scalar, Variable, resting

CFunction = Any
"""A function of a loaded library (ctypes has no public type for it)."""

TYPES = ("Real", "Integer", "Boolean")
"""Types of FMI 2.0 whose values fit on the bus, in the order in which they are transferred."""

TYPES_3 = tuple(kind for kind in CTYPES_3 if kind != "String")
"""Those of FMI 3.0; loop.c counts them from 0 in this order."""

WIDE = ("Int64", "UInt64")
"""Types with whole numbers that no double holds."""


class Piece(ctypes.Structure):
    """Neighbours on the bus that are neighbours in the buffer too (struct Piece of loop.c)."""

    _fields_ = [("slot", ctypes.c_size_t), ("count", ctypes.c_size_t), ("at", ctypes.c_size_t)]


class Transfer:
    """Values of one FMI type: the arguments of one fmiXGetY or fmiXSetY call.

    rows: of FMI 3.0, all elements of every array of which one is wired, with what stands there
    where nobody drives it; access: its type.
    """

    def __init__(  # noqa: PLR0913, PLR0917 - the arguments of a call
        self,
        function: CFunction,
        component: ctypes.c_void_p,
        wires: Sequence[Wire],
        ctype: Any,
        rows: Sequence[Sequence[tuple[Variable, Scalar]]] = (),
        access: str = "",
    ) -> None:
        self.function, self.component, self.access = function, component, access
        self.real = ctype is ctypes.c_double
        elements = [element for row in rows for element in row]
        references = [w.variable.reference for w in wires]
        if rows:
            references = [row[0][0].reference for row in rows]
        self.references = (ctypes.c_uint * len(references))(*references)
        self.values = (ctype * (len(elements) or len(wires)))(*(value for _, value in elements))
        self.arguments: tuple[int, ...] = (len(self.values),) if rows else ()
        self.slots: NDArray[np.uintp] = np.array([wire.slot for wire in wires], dtype=np.uintp)
        places = {variable.name: i for i, (variable, _) in enumerate(elements)}
        found = [places[w.variable.name] if rows else i for i, w in enumerate(wires)]
        self.at: NDArray[np.uintp] = np.array(found, dtype=np.uintp)
        self.view = np.frombuffer(self.values, dtype=np.ctypeslib.as_array(self.values).dtype)
        self.names = [wire.variable.name for wire in wires]
        self.factors: NDArray[np.float64] = np.array([wire.change.factor for wire in wires])
        self.offsets: NDArray[np.float64] = np.array([wire.change.offset for wire in wires])
        self.plain = all(wire.change == IDENTITY for wire in wires)
        self.wide = access in WIDE

    @cached_property
    def pieces(self) -> ctypes.Array[Piece]:
        """The slots as pieces of neighbours."""
        apart = (np.diff(self.slots) != 1) | (np.diff(self.at) != 1)
        runs = np.split(np.arange(len(self.slots)), np.flatnonzero(apart) + 1)
        return (Piece * len(runs))(
            *(Piece(int(self.slots[run[0]]), len(run), int(self.at[run[0]])) for run in runs)
        )

    def _call(self) -> int:
        count = len(self.references)
        arguments = (self.references, count, self.values, *self.arguments)
        return int(self.function(self.component, *arguments))

    def write(self, bus: NDArray[np.float64]) -> int:
        """From the bus into the inputs of the FMU; returns the FMI status."""
        values = bus[self.slots]
        self.view[self.at] = values if self.plain else self.factors * values + self.offsets
        return self._call()

    def read(self, bus: NDArray[np.float64]) -> int:
        """From the outputs of the FMU onto the bus; returns the FMI status."""
        status = self._call()
        bus[self.slots] = self.view[self.at]
        return status

    def not_finite(self) -> str | None:
        """The first variable whose value is infinite or not a number."""
        values = zip(self.names, self.view[self.at], strict=True)
        return next((name for name, value in values if not np.isfinite(value)), None)

    def too_wide(self) -> tuple[str, int] | None:
        """The first variable, with its value, whose whole number the bus would change."""
        for name, value in zip(self.names, map(int, self.view[self.at]), strict=True):
            if abs(value) > EXACT and int(float(value)) != value:
                return name, value
        return None


def transfers(
    verb: str,
    calls: Calls,
    wires: Sequence[Wire],
    interface: Interface,
    held: Mapping[str, Scalar] | None = None,
) -> Iterator[Transfer]:
    """One transfer per FMI type that occurs among the wires, and one for what is changed on the
    way; in FMI 3.0 what is changed and what is not go together.

    verb: Set, Get; held: values by name of inputs that nobody drives, where they are not the start
    values.
    """
    for access in TYPES if interface.fmi == 2 else TYPES_3:
        chosen = [w for w in wires if w.variable.access == access]
        if interface.fmi == 2:
            for plain in (True, False):
                if some := [w for w in chosen if (w.change == IDENTITY) == plain]:
                    function = calls.function(verb, access)
                    yield Transfer(function, calls.handle, some, calls.in_c[access])
        elif chosen:
            rows = {w.variable.reference: interface.row(w.variable) for w in chosen}
            filled = [[(v, _held(v, held or {})) for v in row] for row in rows.values()]
            function = calls.function(verb, access)
            ctype = calls.in_c[access]
            yield Transfer(function, calls.handle, chosen, ctype, filled, access)


def _held(variable: Variable, held: Mapping[str, Scalar]) -> Scalar:
    return held.get(variable.name, resting(variable))
