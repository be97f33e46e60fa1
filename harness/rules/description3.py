# SPDX-License-Identifier: BSD-2-Clause
"""modelDescription.xml of FMI 3.0 as the rules read it: what is the same has the names of FMI
2.0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

from harness.files.archive import XmlElement
from harness.rules.description import Declared, Description

NUMBERS = {
    "Float64": "Real",
    "Float32": "Real",
    **{f"{u}Int{bits}": "Integer" for u in ("", "U") for bits in (8, 16, 32, 64)},
    "Boolean": "Boolean",
    "Enumeration": "Enumeration",
}
"""Types whose values fit on the bus, in the words of FMI 2.0."""

KINDS = {**NUMBERS, "String": "String", "Binary": "Binary", "Clock": "Clock"}
"""All types in the words of FMI 2.0, as far as it has one."""

_ANY, _FIXED = ("discrete", "continuous"), ("fixed", "tunable")

INITIAL = {
    **{(c, v): "exact" for c in ("structuralParameter", "parameter") for v in _FIXED},
    **{("calculatedParameter", v): "calculated" for v in _FIXED},
    **{("input", v): "exact" for v in _ANY},
    **{("output", v): "calculated" for v in _ANY},
    **{("local", v): "calculated" for v in (*_FIXED, *_ANY)},
    ("output", "constant"): "exact",
    ("local", "constant"): "exact",
    ("independent", "continuous"): "",
}
"""Values of `initial` by causality and variability (FMI 3.0, 2.4.7.5); no other pairs are
allowed.
"""


@dataclass(frozen=True)
class Declared3(Declared):
    """One variable of FMI 3.0, which may be an array."""

    @property
    def type(self) -> str:
        """Its type in the words of FMI 2.0, or Binary or Clock."""
        return KINDS[str(self.element.tag)]

    @property
    def reference(self) -> int:
        """Value reference."""
        return int(self.element.get("valueReference"))

    @property
    def variability(self) -> str:
        """Variability, by default that of its causality and type."""
        default = "continuous" if self.type == "Real" else "discrete"
        if self.causality.lower().endswith("parameter"):
            default = "fixed"
        return str(self.element.get("variability", default))

    @property
    def default(self) -> str | None:
        """What `initial` is by causality and variability; None: they do not fit each other."""
        return INITIAL.get((self.causality, self.variability))

    @property
    def needs_start(self) -> bool:
        """Clocks and Binaries need none."""
        return self.causality == "input" and self.type not in ("Clock", "Binary")

    @property
    def starts(self) -> list[str]:
        """Start values of the elements, as they are written."""
        if self.element.tag in ("String", "Binary"):
            return [str(e.get("value")) for e in self.element.iterfind("Start")]
        return str(self.element.get("start", "")).split()

    @property
    def start(self) -> str | None:
        """All start values; None: there are none."""
        return " ".join(self.starts) if self.starts else None

    @property
    def dimensions(self) -> list[XmlElement]:
        """Elements Dimension."""
        return self.element.findall("Dimension")  # type: ignore[no-any-return]

    @property
    def clocks(self) -> list[int]:
        """References of its clocks."""
        return list(map(int, str(self.element.get("clocks", "")).split()))


@dataclass(frozen=True)
class Description3(Description):
    """A description of FMI 3.0; build: sources/buildDescription.xml, terminals:
    terminalsAndIcons.xml, None if they are not there.
    """

    build: XmlElement = None
    terminals: XmlElement = None

    LISTS: ClassVar[Mapping[str, str]] = {
        kind: f"ModelStructure/{kind}"
        for kind in ("Output", "ContinuousStateDerivative", "InitialUnknown", "ClockedState")
    }
    GUID: ClassVar[str] = "instantiationToken"
    ROOT: ClassVar[tuple[str, ...]] = (
        "modelDescription.xml",
        "documentation",
        "sources",
        "binaries",
        "resources",
        "extra",
        "terminalsAndIcons",
    )

    @cached_property
    def types(self) -> dict[str, XmlElement]:
        """Definitions of types by name; of two the last."""
        return {e.get("name"): e for e in self.all("TypeDefinitions/*")}

    @property
    def type_names(self) -> list[str]:
        """Names of all types."""
        return [e.get("name") for e in self.all("TypeDefinitions/*")]

    @property
    def enumerations(self) -> list[tuple[str, list[XmlElement]]]:
        """Items of the enumerations by name."""
        found = self.all("TypeDefinitions/EnumerationType")
        return [(e.get("name"), e.findall("Item")) for e in found]

    @property
    def sources(self) -> list[str]:
        """Source files that the build description lists."""
        found = () if self.build is None else self.build.iter("SourceFile")
        return [e.get("name") for e in found]

    @cached_property
    def variables(self) -> tuple[Declared3, ...]:
        """All variables in the order of the file; aliases are no variables of their own."""
        return tuple(
            Declared3(e, e, self.types.get(e.get("declaredType")))
            for e in self.all("ModelVariables/*")
            if e.tag in KINDS
        )

    @cached_property
    def by_reference(self) -> dict[int, Declared3]:
        """Variables by value reference; of two the last."""
        return {v.reference: v for v in self.variables}

    def numbered(self, number: int) -> Declared | None:
        """The variable that a number in the model structure stands for: its value reference."""
        return self.by_reference.get(number)

    def number(self, e: XmlElement) -> int:
        """The number of an entry of the model structure."""
        return int(e.get("valueReference"))

    def shape(self, v: Declared3) -> tuple[int, ...] | None:
        """Sizes of an array, () of a scalar; None if one is that of a variable that gives none."""
        sizes = [self._size(e) for e in v.dimensions]
        known = [size for size in sizes if size is not None]
        return tuple(known) if len(known) == len(sizes) else None

    def _size(self, dimension: XmlElement) -> int | None:
        if dimension.get("start") is not None:
            return int(dimension.get("start"))
        found = self.by_reference.get(int(dimension.get("valueReference", "-1")))
        if found is None or found.causality != "structuralParameter" or len(found.starts) != 1:
            return None
        return int(found.starts[0])

    def elements(self, v: Declared3) -> list[tuple[int, ...]]:
        """Indices of the elements of an array in their order, from 1; [()] of a scalar."""
        return list(_indices(self.shape(v) or ()))

    def count(self, v: Declared3) -> int | None:
        """Number of elements; None if it is not known."""
        shape = self.shape(v)
        return None if shape is None else math.prod(shape)


def _indices(shape: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    if not shape:
        yield ()
        return
    for i in range(1, shape[0] + 1):
        yield from ((i, *rest) for rest in _indices(shape[1:]))
