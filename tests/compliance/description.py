# SPDX-License-Identifier: BSD-2-Clause
"""Content of a modelDescription.xml, read without FMPy and without the harness."""

from __future__ import annotations

import math
import zipfile
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple
from xml.etree import ElementTree


class Variable(NamedTuple):
    """A scalar variable; values that the description leaves out are None, bounds infinite, the
    nominal value 1.
    """

    name: str
    reference: int
    causality: str
    variability: str
    initial: str | None
    unit: str | None
    display_unit: str | None
    start: float | None
    low: float
    high: float
    nominal: float
    text: str

    @property
    def row(self) -> str:
        """Name without the index: elements of one vector or matrix share it."""
        return self.name.partition("[")[0]


def _number(attributes: dict[str, str], key: str, missing: float | None) -> float | None:
    return float(attributes[key]) if key in attributes else missing


def _variable(element: ElementTree.Element) -> Variable:
    (real,) = element.findall("Real")
    general, special = element.attrib, real.attrib
    return Variable(
        name=general["name"],
        reference=int(general["valueReference"]),
        causality=general.get("causality", "local"),
        variability=general.get("variability", "continuous"),
        initial=general.get("initial"),
        unit=special.get("unit"),
        display_unit=special.get("displayUnit"),
        start=_number(special, "start", None),
        low=_number(special, "min", -math.inf),
        high=_number(special, "max", math.inf),
        nominal=_number(special, "nominal", 1.0),
        text=general.get("description", ""),
    )


@dataclass(frozen=True)
class Description:
    """Root element and variables."""

    root: ElementTree.Element

    @cached_property
    def variables(self) -> list[Variable]:
        return [
            _variable(element) for element in self.root.findall("ModelVariables/ScalarVariable")
        ]

    @cached_property
    def by_name(self) -> dict[str, Variable]:
        return {variable.name: variable for variable in self.variables}

    def of(self, causality: str) -> list[Variable]:
        return [variable for variable in self.variables if variable.causality == causality]

    @cached_property
    def rows(self) -> set[str]:
        return {variable.row for variable in self.variables}

    @property
    def guid(self) -> str:
        return self.root.attrib["guid"]

    @property
    def co_simulation(self) -> ElementTree.Element:
        (element,) = self.root.findall("CoSimulation")
        return element

    @property
    def identifier(self) -> str:
        return self.co_simulation.attrib["modelIdentifier"]


def read(archive: Path) -> Description:
    """The model description inside an .fmu."""
    with zipfile.ZipFile(archive) as files:
        return Description(ElementTree.fromstring(files.read("modelDescription.xml")))
