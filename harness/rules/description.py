# SPDX-License-Identifier: BSD-2-Clause
"""modelDescription.xml as the rules read it: XML elements with the defaults of FMI 2.0, and below
what is otherwise in FMI 3.0.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Iterable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any, ClassVar

from harness.files.archive import XmlElement, serialized

TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration")

_ANY, _FIXED = ("discrete", "continuous"), ("fixed", "tunable")

INITIAL = {
    **{("parameter", v): "exact" for v in _FIXED},
    **{("calculatedParameter", v): "calculated" for v in _FIXED},
    **{("input", v): "exact" for v in _ANY},
    **{("output", v): "calculated" for v in _ANY},
    **{("local", v): "calculated" for v in (*_FIXED, *_ANY)},
    ("output", "constant"): "exact",
    ("local", "constant"): "exact",
    ("independent", "continuous"): "",
}
"""Values of `initial` by causality and variability (FMI 2.0, 2.2.7); no other pairs are allowed."""


@dataclass(frozen=True)
class Declared:
    """One variable; value: its element Real, Integer, ...; definition: that of its type."""

    element: XmlElement
    value: XmlElement
    definition: XmlElement | None

    INITIAL: ClassVar[Mapping[tuple[str, str], str]] = INITIAL
    WITHOUT_INITIAL: ClassVar[tuple[str, ...]] = ("input", "independent")
    """Causalities that must not say what their start value is."""

    def __str__(self) -> str:
        return f"{self.name} (line {self.element.sourceline})"

    @property
    def name(self) -> str:
        """Name of the variable."""
        return str(self.element.get("name"))

    @property
    def type(self) -> str:
        """Real, Integer, Boolean, String or Enumeration."""
        return str(self.value.tag)

    @property
    def access(self) -> str:
        """The type of the functions of FMI that read and set it."""
        return "Integer" if self.type == "Enumeration" else self.type

    @property
    def type_name(self) -> str:
        """Name of its declared type; "" without one."""
        return str(self.value.get("declaredType", ""))

    @property
    def clocks(self) -> list[int]:
        """References of its clocks."""
        return list(map(int, str(self.element.get("clocks", "")).split()))

    @property
    def reference(self) -> int:
        """Value reference."""
        return int(self.element.get("valueReference"))

    @property
    def causality(self) -> str:
        """Causality, by default local."""
        return str(self.element.get("causality", "local"))

    @property
    def variability(self) -> str:
        """Variability, by default continuous."""
        return str(self.element.get("variability", "continuous"))

    @property
    def initial(self) -> str:
        """What it says of its start value, or the default of its causality and variability."""
        return str(self.element.get("initial", self.default or ""))

    @property
    def default(self) -> str | None:
        """What `initial` is by causality and variability; None: they do not fit each other."""
        return self.INITIAL.get((self.causality, self.variability))

    @property
    def needs_start(self) -> bool:
        """Whether it must have a start value whatever its `initial`."""
        return self.causality == "input"

    @property
    def starts(self) -> list[str]:
        """Start values of the elements, as they are written."""
        return [] if self.start is None else [self.start]

    @property
    def derivative(self) -> int | None:
        """Number of the state that it is the derivative of."""
        found = self.value.get("derivative")
        return None if found is None else int(found)

    @property
    def start(self) -> str | None:
        """Start value as it is written."""
        return self.value.get("start")  # type: ignore[no-any-return]

    def attribute(self, name: str) -> str | None:
        """An attribute of the variable, else that of its type."""
        found = self.value.get(name)
        if found is None and self.definition is not None:
            found = self.definition.get(name)
        return found  # type: ignore[no-any-return]

    def number(self, name: str) -> float | None:
        """A number in such an attribute."""
        text = self.attribute(name)
        return None if text is None else float(text)


@dataclass(frozen=True)
class Description:
    """The root element, and the names of all files of the archive."""

    root: XmlElement
    files: tuple[str, ...]

    LISTS: ClassVar[Mapping[str, str]] = {
        kind: f"ModelStructure/{kind}/Unknown"
        for kind in ("Outputs", "Derivatives", "InitialUnknowns")
    }
    """Elements of the model structure by their list: outputs, derivatives, initial unknowns."""

    GUID: ClassVar[str] = "guid"
    """Attribute by which binary and description recognise each other."""

    NUMBER: ClassVar[str] = "index"
    """Attribute by which an entry of the model structure names its variable."""

    TYPES: ClassVar[str] = "TypeDefinitions/SimpleType"
    """Definitions of types."""

    ROOT: ClassVar[tuple[str, ...]] = (
        "modelDescription.xml",
        "model.png",
        "documentation",
        "licenses",
        "sources",
        "binaries",
        "resources",
        "extra",
        "terminalsAndIcons",
    )
    """What may lie at the top of the archive."""

    @property
    def guid(self) -> str:
        """By which binary and description recognise each other."""
        return str(self.root.get(self.GUID, ""))

    def all(self, path: str) -> list[XmlElement]:
        """Elements by their path below the root."""
        return list(self.root.iterfind(path))

    @cached_property
    def types(self) -> dict[str, XmlElement]:
        """Elements Real, Integer, ... of the definitions of types by name; of two the last."""
        return {e.get("name"): e[0] for e in self.all(self.TYPES)}

    @property
    def type_names(self) -> list[str]:
        """Names of all types."""
        return [e.get("name") for e in self.all(self.TYPES)]

    @cached_property
    def enumerations(self) -> list[tuple[str, list[XmlElement]]]:
        """Items of the enumerations by name."""
        found = [(e.get("name"), e.findall(".//Item")) for e in self.all(self.TYPES)]
        return [(name, items) for name, items in found if items]

    @property
    def sources(self) -> list[str]:
        """Source files that are listed."""
        return [e.get("name") for e in self.all("*/SourceFiles/File")]

    def numbered(self, number: int) -> Declared | None:
        """The variable that a number in the model structure stands for: its place, from 1."""
        return self.variables[number - 1] if 1 <= number <= len(self.variables) else None

    def number(self, e: XmlElement) -> int:
        """The number of an entry of the model structure."""
        return int(e.get(self.NUMBER))

    def elements(self, _: Declared) -> list[tuple[int, ...]]:
        """Indices of the elements of an array in their order, from 1; [()] of a scalar."""
        return [()]

    @cached_property
    def items(self) -> dict[str, set[int]]:
        """Values of the items of every type by its name; none for one that is no enumeration."""
        return {
            name: {int(item.get("value")) for item in e.iterfind("Item")}
            for name, e in self.types.items()
        }

    @cached_property
    def units(self) -> dict[str, set[str]]:
        """Names of the display units by unit."""
        return {
            e.get("name"): {d.get("name") for d in e.iterfind("DisplayUnit")}
            for e in self.all("UnitDefinitions/Unit")
        }

    @cached_property
    def variables(self) -> tuple[Declared, ...]:
        """All variables in the order of the file."""
        return tuple(map(self._declared, self.all("ModelVariables/ScalarVariable")))

    def _declared(self, element: XmlElement) -> Declared:
        value = next(child for child in element if child.tag in TYPES)
        return Declared(element, value, self.types.get(value.get("declaredType")))

    @property
    def experiment(self) -> XmlElement:
        """The default experiment, or an empty one."""
        found = self.root.find("DefaultExperiment")
        return {} if found is None else found


# ---- FMI 3.0

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


@dataclass(frozen=True)
class Declared3(Declared):
    """One variable of FMI 3.0, which may be an array."""

    INITIAL: ClassVar[Mapping[tuple[str, str], str]] = {
        **INITIAL,
        **{("structuralParameter", v): "exact" for v in _FIXED},
    }
    """As in FMI 2.0, with one causality more (FMI 3.0, 2.4.7.5)."""
    WITHOUT_INITIAL: ClassVar[tuple[str, ...]] = ("independent",)

    @property
    def type(self) -> str:
        """Its type in the words of FMI 2.0, or Binary or Clock."""
        return KINDS[str(self.element.tag)]

    @property
    def access(self) -> str:
        """The type of the functions of FMI that read and set it."""
        return "Int64" if self.type == "Enumeration" else str(self.element.tag)

    @property
    def variability(self) -> str:
        """Variability, by default that of its causality and type."""
        default = "continuous" if self.type == "Real" else "discrete"
        if self.causality.lower().endswith("parameter"):
            default = "fixed"
        return str(self.element.get("variability", default))

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
    NUMBER: ClassVar[str] = "valueReference"
    TYPES: ClassVar[str] = "TypeDefinitions/*"
    ROOT: ClassVar[tuple[str, ...]] = tuple(
        name for name in Description.ROOT if name not in ("model.png", "licenses")
    )

    @cached_property
    def types(self) -> dict[str, XmlElement]:
        """Definitions of types by name; of two the last."""
        return {e.get("name"): e for e in self.all(self.TYPES)}

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

    def shape(self, v: Declared) -> tuple[int, ...] | None:
        """Sizes of an array, () of a scalar; None if one is that of a variable that gives none."""
        sizes = tuple(self._size(e) for e in v.element.findall("Dimension"))
        return None if None in sizes else sizes  # type: ignore[return-value]

    def _size(self, dimension: XmlElement) -> int | None:
        if dimension.get("start") is not None:
            return int(dimension.get("start"))
        found = self.by_reference.get(int(dimension.get("valueReference", "-1")))
        if found is None or found.causality != "structuralParameter" or len(found.starts) != 1:
            return None
        return int(found.starts[0])

    def elements(self, v: Declared) -> list[tuple[int, ...]]:
        """Indices of the elements of an array in their order, from 1; [()] of a scalar."""
        return list(product(*(range(1, size + 1) for size in self.shape(v) or ())))

    def count(self, v: Declared3) -> int | None:
        """Number of elements; None if it is not known."""
        shape = self.shape(v)
        return None if shape is None else math.prod(shape)


# ---- for the rules


def twice(values: Iterable[Hashable]) -> list[Any]:
    """Values that occur more than once."""
    return [value for value, count in Counter(values).items() if count > 1]


def without_variables(description: Description) -> bytes:
    """A description without variables and structure in UTF-8, as FMPy can read every one."""
    copy = deepcopy(description.root)
    for name in ("ModelVariables", "ModelStructure"):
        for e in copy.iterfind(f"{name}/*"):
            e.getparent().remove(e)
    return serialized(copy)
