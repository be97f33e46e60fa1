# SPDX-License-Identifier: BSD-2-Clause
"""Reader of .ssp files, which rejects unsafe archives, validates their XML by the schemas,
and calls no FMU.

XML prefixes may have any name, only the namespaces count. Nested systems are flattened. A file
with content that cannot be run is rejected: signal dictionaries, connections between parameters,
tables that transform signals.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from lxml import etree

from harness.errors import StructureError
from harness.files import cache
from harness.files.archive import XmlElement, unpack
from harness.files.output import PrivateFolder
from harness.files.paths import is_file
from harness.ssp import xml
from harness.ssp.elements import Tree
from harness.ssp.flatten import Flat
from harness.ssp.parameters import read_ssv
from harness.system.instants import date
from harness.system.model import (
    Alternative,
    Component,
    Experiment,
    Parameters,
    ParameterSet,
    System,
)

MAX_COMPONENTS = 10_000
"""Largest number of components of a system."""

MOST_KNOWN = 32
"""Largest number of systems that a process retains in memory after reading."""

_log = logging.getLogger("harness")


class Reading(NamedTuple):
    """System of an unpacked .ssp, with the problems that prevent a run, and notes, which do not."""

    system: System
    problems: tuple[str, ...]
    notes: tuple[str, ...]


@contextmanager
def opened(path: Path) -> Iterator[System]:
    """Yield the system in an .ssp. Its files exist until the end of the `with` block, in the cache
    or in a private temporary folder.

    Raises ArchiveError (damaged or unsafe archive) or StructureError (all problems of the
    description).
    """
    with examined(path) as (system, problems):
        if problems:
            raise StructureError(problems)
        yield system


@contextmanager
def examined(path: Path) -> Iterator[tuple[System, tuple[str, ...]]]:
    """Yield the system in an .ssp as far as it can be read, and the problems of its description.

    Unpacks like opened(). Raises ArchiveError or StructureError if nothing can be read.
    """
    cached = cache.unpacked(path)
    with PrivateFolder() if cached is None else nullcontext(cached) as folder:
        if cached is None:
            unpack(path, folder)
        try:  # the content of a folder in the cache never changes, so _known() reads it only once
            system, problems, notes = _of_folder(folder) if cached is None else _known(folder)
        except StructureError as error:
            raise StructureError(f"{path.name}: {problem}" for problem in error.problems) from error
        for note in notes:
            _log.warning("%s", note)
        yield system, tuple(f"{path.name}: {problem}" for problem in problems)


def _of_folder(folder: Path) -> Reading:
    """Return the system in an unpacked .ssp; raise StructureError if it cannot be read."""
    if not (folder / xml.SSD_FILE).is_file():
        raise StructureError([f"the archive contains no {xml.SSD_FILE}"])
    root = xml.parse(folder / xml.SSD_FILE, xml.SSD_SCHEMA)
    if (count := sum(1 for _ in root.iter(xml.tag("ssd:Component")))) > MAX_COMPONENTS:
        limit = f"more than the limit of {MAX_COMPONENTS}"
        raise StructureError([f"the system has {count} components, {limit}"])
    reader = _Reader(folder, root)
    system = reader.system()
    return Reading(system, tuple(reader.problems), tuple(reader.tree.notes))


@lru_cache(maxsize=MOST_KNOWN)
def _known(folder: Path) -> Reading:
    """Return the system of an .ssp that is unpacked in a folder of the cache. The system is read
    once, and its pickle is stored in the cache.
    """
    return cache.computed("system", str(folder).encode(), lambda: _of_folder(folder))


class _Reader:
    """Reader of SystemStructure.ssd. The class reads the experiment and the annotation of this
    project; Tree and Flat read the elements of the system.
    """

    def __init__(self, folder: Path, root: XmlElement) -> None:
        self.folder = folder
        self.root = root
        ours = f"ssd:System/ssd:Annotations/ssc:Annotation[@type='{xml.RUN_ANNOTATION}']/run:Run"
        found = xml.first(root, ours)
        self.run = etree.Element("none") if found is None else found
        """Annotation of this project with run settings, an empty element in a file of another tool.
        """
        self.schedule = {e.get("name"): e for e in self._own("Component")}
        self.tree = Tree(folder, root, own=found is not None)
        self.problems = self.tree.problems

    def system(self) -> System:
        flat = Flat(self.tree)
        experiment = self._experiment()
        components = tuple(
            Component(
                flat.names[place],
                leaf.fmu,
                flat.parameters[place],
                *self._schedule(flat.names[place], leaf.hint, experiment),
            )
            for place, leaf in self.tree.components.items()
        )
        mission = self.run.get("mission", "")
        return System(
            name=self.root.get("name"),
            description=self.root.get("description", ""),
            components=components,
            connections=tuple(flat.connections),
            experiment=experiment,
            sets=tuple(self._set(e, components) for e in self._own("ParameterSet")),
            alternatives=tuple(self._alternative(e, components) for e in self._own("Alternative")),
            requirements=self._texts("Requirement"),
            consistency=self._texts("Consistency"),
            strict=self.run.get("strict") == "true",
            compared=self._compared(),
            sliders={
                e.get("name", ""): (self._number(e, "low"), self._number(e, "high"))
                for e in self._own("Slider")
            },
            mission=mission if mission.isidentifier() else "",  # other texts name no mission
            declared=flat.declared(),
        )

    def _own(self, kind: str) -> Iterator[XmlElement]:
        """Yield the elements of one kind in our own annotation."""
        return xml.every(self.run, f"run:{kind}")

    def _texts(self, kind: str) -> dict[str, str]:
        return {e.get("name", ""): e.get("text", "") for e in self._own(kind)}

    def _compared(self) -> str:
        """Return the name of the parameter set that `harness compare` uses by default, "" for none;
        record a problem if the file has no such set.
        """
        name: str = self.run.get("compare", "")
        if name and name not in {e.get("name") for e in self._own("ParameterSet")}:
            self.problems.append(f"compare: there is no parameter set {name}")
            return ""
        return name

    def _experiment(self) -> Experiment:
        """Return the time span of the file, with the step from the OSP annotation and the algorithm
        from our annotation. A file without our annotation runs by Jacobi, in which the order of
        components does not matter.
        """
        default = xml.first(self.root, "ssd:DefaultExperiment")
        step = xml.first(self.root, "ssd:DefaultExperiment//osp:FixedStepAlgorithm")
        return Experiment(
            start=self._number(default, "startTime") or 0.0,
            stop=self._number(default, "stopTime"),
            step=self._number(step, "baseStepSize"),
            algorithm=self.run.get("algorithm", "jacobi"),
            every=max(1, round(self._number(self.run, "every") or 1)),
            epoch=self._epoch(),
        )

    def _epoch(self) -> str:
        """Return UTC at t = 0 as text, "" if the file does not state it; record a problem for a
        text that is no date.
        """
        text = self.run.get("epoch", "")
        try:
            return date(text)
        except ValueError as error:
            self.problems.append(f"epoch {text}: {error}")
            return ""

    def _schedule(self, name: str, hint: float | None, experiment: Experiment) -> tuple[int, int]:
        """Return period and latency of a component in macro steps: from our annotation, or else the
        period from the step size `hint` [s] of the OSP annotation.
        """
        own = self.schedule.get(name)
        if own is not None:
            return round(self._number(own, "every") or 1), round(self._number(own, "latency") or 0)
        if hint and not experiment.step:
            unused = f"the step size of {hint:g} s is not used, as the file gives no fixed step"
            self.tree.notes.append(f"{name}: {unused}")
        return max(1, round(hint / experiment.step)) if hint and experiment.step else 1, 0

    def _set(self, element: XmlElement, components: tuple[Component, ...]) -> ParameterSet:
        """Return a parameter set that an element of our annotation describes. Its values are in the
        archive, in one .ssv for every component that has some.
        """
        name = element.get("name", "")
        parameters = self._files(f"resources/sets/{name}", components)
        if not parameters:
            fault = "is listed, but the archive has no valid file with its values"
            self.problems.append(f"parameter set {name}: {fault}")
        stop, step = self._number(element, "stop"), self._number(element, "step")
        return ParameterSet(name, element.get("description", ""), parameters, stop, step)

    def _alternative(self, element: XmlElement, components: tuple[Component, ...]) -> Alternative:
        fmu = element.get("fmu", "")
        parameters = self._files(f"resources/alternatives/{fmu}", components)
        return Alternative(element.get("component", ""), fmu, parameters)

    def _files(self, place: str, components: tuple[Component, ...]) -> dict[str, Parameters]:
        """Return the parameters by component from the files COMPONENT.ssv in a folder of the
        archive; record the problems of unreadable files.
        """
        found: dict[str, Parameters] = {}
        for c in components:
            path = self.folder / place / f"{c.name}.ssv"
            if is_file(path) and path.resolve().is_relative_to(self.folder.resolve()):
                found[c.name] = {}
                try:
                    found[c.name] = read_ssv(path)
                except StructureError as error:
                    self.problems += error.problems
        return found

    def _number(self, element: XmlElement, attribute: str) -> float | None:
        return xml.number(element, attribute, self.problems)
