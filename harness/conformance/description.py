# SPDX-License-Identifier: BSD-2-Clause
"""Model description of an FMU of FMI 2.0 or FMI 3.0 for the conformance checks. For FMI 3.0 too,
variables have the types of FMI 2.0, such as Real for Float64, except Binary and Clock. Missing
attributes have the default values that the standard defines.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable, Iterable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

from harness.files.archive import XmlElement, serialized

TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration")

NUMBERS = {
    "Float64": "Real",
    "Float32": "Real",
    **{f"{u}Int{bits}": "Integer" for u in ("", "U") for bits in (8, 16, 32, 64)},
    "Boolean": "Boolean",
    "Enumeration": "Enumeration",
}
"""Types of FMI 3.0 that components can exchange because their values are numbers, each with the
corresponding type of FMI 2.0.
"""

KINDS = {**NUMBERS, "String": "String", "Binary": "Binary", "Clock": "Clock"}
"""All types of FMI 3.0, with the corresponding type of FMI 2.0, or their own name if there is none.
"""

_ANY, _FIXED = ("discrete", "continuous"), ("fixed", "tunable")
_COMPUTED, _FREE = ("calculated", "approx"), ("calculated", "exact", "approx")

INITIAL: Mapping[tuple[str, str], tuple[str, ...]] = {
    **{("parameter", v): ("exact",) for v in _FIXED},
    **{("calculatedParameter", v): _COMPUTED for v in _FIXED},
    **{("input", v): ("",) for v in _ANY},
    **{("output", v): _FREE for v in _ANY},
    **{("local", v): _FREE for v in _ANY},
    **{("local", v): _COMPUTED for v in _FIXED},
    ("output", "constant"): ("exact",),
    ("local", "constant"): ("exact",),
    ("independent", "continuous"): ("",),
}
"""Permitted values of the attribute `initial` by causality and variability, the default first; "":
the attribute must be missing (FMI 2.0, 2.2.7). Other pairs of causality and variability are not
permitted.
"""
INITIAL_3 = {
    **INITIAL,
    **{("structuralParameter", v): ("exact",) for v in _FIXED},
    **{("input", v): ("", "exact") for v in _ANY},
}
"""Permitted values of `initial` in FMI 3.0 (2.4.7.5), in the form of INITIAL; for an input the
attribute may be missing.
"""


@dataclass(frozen=True, eq=False)
class Declared:
    """Variable of a model description.

    type: Real, Integer, Boolean, String, Enumeration, Binary or Clock; written: the type as the
    file names it, such as Float64; own: attributes of the variable; all: attributes of the variable
    and of its declared type.
    """

    element: XmlElement
    type: str
    written: str
    fmi: int
    own: Mapping[str, str]
    all: Mapping[str, str]

    def __str__(self) -> str:
        return f"{self.name} (line {self.element.sourceline})"

    @property
    def name(self) -> str:
        """Return the name of the variable."""
        return self.own["name"]

    @property
    def reference(self) -> int:
        """Return the value reference."""
        return int(self.own["valueReference"])

    @property
    def access(self) -> str:
        """Return the name of the type in the FMI functions that get and set the variable, such as
        Float64 for fmi3GetFloat64.
        """
        if self.type == "Enumeration":
            return "Int64" if self.fmi == 3 else "Integer"
        return self.written

    @property
    def causality(self) -> str:
        """Return the causality, by default local."""
        return self.own.get("causality", "local")

    @property
    def variability(self) -> str:
        """Return the variability. The default is continuous; in FMI 3.0, fixed for a parameter and
        discrete for any other variable that is not Real.
        """
        default = "continuous"
        if self.fmi == 3 and self.causality.lower().endswith("parameter"):
            default = "fixed"
        elif self.fmi == 3 and self.type != "Real":
            default = "discrete"
        return self.own.get("variability", default)

    @property
    def initials(self) -> tuple[str, ...]:
        """Return the permitted values of `initial`, () if causality and variability are not
        compatible.
        """
        table = INITIAL_3 if self.fmi == 3 else INITIAL
        return table.get((self.causality, self.variability), ())

    @property
    def initial(self) -> str:
        """Return the attribute `initial`, or else its default for causality and variability."""
        return self.own.get("initial", (*self.initials, "")[0])

    @property
    def starts(self) -> list[str]:
        """Return the start values of the elements as text."""
        if self.fmi == 3:
            listed = [e.get("value") for e in self.element.iterfind("Start")]
            return listed or self.own.get("start", "").split()
        return [self.own["start"]] if "start" in self.own else []

    @property
    def type_name(self) -> str:
        """Return the name of the declared type, "" without one."""
        return self.own.get("declaredType", "")

    @property
    def clocks(self) -> list[int]:
        """Return the value references of the clocks in the attribute `clocks`, [] without it."""
        return list(map(int, self.own.get("clocks", "").split()))

    @property
    def derivative(self) -> int | None:
        """Return the number (in FMI 2.0 the index from 1, in FMI 3.0 the value reference) of the
        state of which this variable is the derivative; None if it is not a derivative.
        """
        return int(self.own["derivative"]) if "derivative" in self.own else None

    def number(self, name: str) -> float | None:
        """Return an attribute of the variable or its declared type as a number, None if missing."""
        return float(self.all[name]) if name in self.all else None


@dataclass(frozen=True)
class Description:
    """Model description of an FMU: its root element, the names of all files of the archive, and in
    FMI 3.0 the roots of sources/buildDescription.xml (`build`) and terminalsAndIcons.xml
    (`terminals`), None if they are missing.
    """

    root: XmlElement
    files: tuple[str, ...]
    build: XmlElement = None
    terminals: XmlElement = None

    @property
    def fmi(self) -> int:
        """Return the version of FMI, 2 or 3."""
        return 3 if self.root.get("fmiVersion").startswith("3.") else 2

    def every(self, path: str) -> list[XmlElement]:
        """Return the elements at a path below the root."""
        return list(self.root.iterfind(path))

    @property
    def identifiers(self) -> list[str]:
        """Return the name of the library (modelIdentifier) of each interface type of the FMU, such
        as CoSimulation.
        """
        return [e.get("modelIdentifier") for e in self.root if "modelIdentifier" in e.attrib]

    @cached_property
    def types(self) -> dict[str, XmlElement]:
        """Return the elements that define types (Real, Float64Type, ...) by the name of the type.
        Of two types with the same name the last is returned.
        """
        found = {e.get("name"): e for e in self.every("TypeDefinitions/*")}
        return found if self.fmi == 3 else {name: e[0] for name, e in found.items()}

    @cached_property
    def enumerations(self) -> dict[str, list[XmlElement]]:
        """Return the `Item` elements of every enumeration by the name of its type."""
        found = {name: e.findall("Item") for name, e in self.types.items()}
        return {name: items for name, items in found.items() if items}

    @cached_property
    def units(self) -> dict[str, set[str]]:
        """Return the names of the display units of every unit by the name of the unit."""
        return {
            e.get("name"): {d.get("name") for d in e.iterfind("DisplayUnit")}
            for e in self.every("UnitDefinitions/Unit")
        }

    @property
    def sources(self) -> list[str]:
        """Return the source files that the model description or buildDescription.xml lists."""
        in_build = () if self.build is None else self.build.iter("SourceFile")
        return [e.get("name") for e in (*self.every("*/SourceFiles/File"), *in_build)]

    @cached_property
    def variables(self) -> tuple[Declared, ...]:
        """Return all variables in the order of the file, without `Alias` elements of FMI 3.0."""
        return tuple(map(self._declared, self.every("ModelVariables/*")))

    def _declared(self, element: XmlElement) -> Declared:
        fmi, value = self.fmi, element
        if fmi == 2:
            value = next(child for child in element if child.tag in TYPES)
        kind = KINDS[value.tag] if fmi == 3 else value.tag
        own = {**value.attrib, **element.attrib}
        definition = self.types.get(own.get("declaredType", ""))
        both = own if definition is None else {**definition.attrib, **own}
        return Declared(element, kind, value.tag, fmi, own, both)

    @cached_property
    def _by_number(self) -> dict[int, Declared]:
        if self.fmi == 3:
            return {v.reference: v for v in self.variables}
        return dict(enumerate(self.variables, 1))

    def numbered(self, number: int) -> Declared | None:
        """Return the variable with a number: in FMI 2.0 its index from 1, in FMI 3.0 its value
        reference. Return None if there is no such variable.
        """
        return self._by_number.get(number)

    def aliases(self) -> list[list[Declared]]:
        """Return groups of variables with equal value references. In FMI 2.0 each type has its own
        value references, except that Integer and Enumeration share theirs.
        """
        found: dict[tuple[str, int], list[Declared]] = {}
        for v in self.variables:
            access = "" if self.fmi == 3 else v.access
            found.setdefault((access, v.reference), []).append(v)
        return [group for group in found.values() if len(group) > 1]

    # ---- arrays

    def shape(self, v: Declared) -> tuple[int, ...] | None:
        """Return the size of each dimension, () for a scalar, None if one size is unknown."""
        sizes = tuple(map(self._size, v.element.iterfind("Dimension")))
        return None if None in sizes else sizes  # type: ignore[return-value]

    def _size(self, dimension: XmlElement) -> int | None:
        if dimension.get("start") is not None:
            return int(dimension.get("start"))
        found = self.numbered(int(dimension.get("valueReference", "-1")))
        if found is None or found.causality != "structuralParameter" or len(found.starts) != 1:
            return None
        return int(found.starts[0])

    def count(self, v: Declared) -> int | None:
        """Return the number of elements, None if it is unknown."""
        shape = self.shape(v)
        return None if shape is None else math.prod(shape)

    def elements(self, v: Declared) -> list[tuple[int, ...]]:
        """Return the indices of the elements of an array in order, from 1; [()] for a scalar."""
        return list(product(*(range(1, size + 1) for size in self.shape(v) or ())))

    # ---- the model structure

    @property
    def lists(self) -> dict[str, str]:
        """Return the XML paths of the entries of the model structure, by the name of their list:
        outputs, derivatives, initial unknowns, and in FMI 3.0 clocked states.
        """
        if self.fmi == 3:
            kinds = ("Output", "ContinuousStateDerivative", "InitialUnknown", "ClockedState")
            return {kind: f"ModelStructure/{kind}" for kind in kinds}
        lists = ("Outputs", "Derivatives", "InitialUnknowns")
        return {kind: f"ModelStructure/{kind}/Unknown" for kind in lists}

    def entries(self) -> Iterator[tuple[str, XmlElement, int]]:
        """Yield all entries of the model structure: name of the list, element, and number of the
        variable as in numbered().
        """
        name = "valueReference" if self.fmi == 3 else "index"
        for kind, path in self.lists.items():
            yield from ((kind, e, int(e.get(name))) for e in self.every(path))

    def listed(self, name: str) -> list[Declared]:
        """Return the variables to which a list of the model structure refers. Entries that refer
        to a missing variable are left out.
        """
        found = (self.numbered(number) for kind, _, number in self.entries() if kind == name)
        return [v for v in found if v is not None]


# ---- helpers of the checks


def twice(values: Iterable[Hashable]) -> list[Any]:
    """Return the values that occur more than once."""
    return [value for value, count in Counter(values).items() if count > 1]


def repeated(root: XmlElement, attributes: Mapping[str, str]) -> Iterator[str]:
    """Yield a line for every element that has the same value of an attribute as an earlier sibling.

    attributes: name of the attribute by the XML path of the elements; root: root element, None if
    the file is missing.
    """
    for path, name in attributes.items():
        seen = set()
        for e in () if root is None else root.iterfind(path):
            key = e.getparent(), e.get(name)
            if key in seen:
                yield f"{e.tag} (line {e.sourceline}): the {name} {e.get(name)} is given twice"
            seen.add(key)


def without_variables(description: Description) -> bytes:
    """Return a model description without variables and model structure as XML in UTF-8, which FMPy
    can read regardless of faults in these parts.
    """
    copy = deepcopy(description.root)
    for name in ("ModelVariables", "ModelStructure"):
        for e in copy.iterfind(f"{name}/*"):
            e.getparent().remove(e)
    return serialized(copy)
