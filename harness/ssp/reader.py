# SPDX-License-Identifier: BSD-2-Clause
"""From an .ssp file to a System: safe unpacking, schema validation, and no FMI call.

Names are read by namespace, whatever the prefixes. Nested systems are flattened. What cannot be run
is refused, not ignored: model exchange, signal dictionaries, connections between parameters, tables
that transform signals.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from harness.errors import ArchiveError, StructureError
from harness.files import cache
from harness.files.archive import MAX_UNPACKED, XmlElement, unpack, unpacked_size
from harness.files.paths import is_file
from harness.files.temporary import PrivateFolder
from harness.ssp import xml
from harness.ssp.elements import ElementReader, Leaf
from harness.ssp.flatten import Flat
from harness.ssp.parameters import read_ssv
from harness.system.instants import moment, written
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

MOST_KNOWN = 16
"""Systems that a process remembers."""

Reading = Callable[[Path], tuple[System, list[str]]]

_log = logging.getLogger("harness")


@contextmanager
def opened(path: Path) -> Iterator[System]:
    """The system in an .ssp, whose files are there until the end of the `with` block: unpacked in
    the cache, else in a private temporary folder.

    Raises ArchiveError (damaged or unsafe archive) or StructureError (all problems of the
    description).
    """
    with examined(path) as (system, problems):
        if problems:
            raise StructureError(problems)
        yield system


@contextmanager
def _unpacked(path: Path) -> Iterator[tuple[Path, Reading]]:
    """The folder of an archive, and what its system is read by."""
    with cache.unpacked(path) as kept:
        if kept is not None:
            yield kept, _read_once
            return
        with PrivateFolder() as folder:
            unpack(path, folder)
            yield folder, _read


@contextmanager
def examined(path: Path) -> Iterator[tuple[System, tuple[str, ...]]]:
    """The system in an .ssp as far as it can be read, and what is wrong with its description.

    Unpacked as by opened(). Raises ArchiveError or StructureError if there is nothing to read.
    """
    with _unpacked(path) as (folder, reading):
        try:
            system, problems = reading(folder)
        except StructureError as error:
            raise StructureError(f"{path.name}: {problem}" for problem in error.problems) from error
        problems = [*problems, *_size_problems(path, system)]
        yield system, tuple(f"{path.name}: {problem}" for problem in problems)


def _size_problems(path: Path, system: System) -> Iterator[str]:
    """The limit of archive.py for the .ssp and the FMUs of all its components together."""
    size = unpacked_size(path)
    for fmu, count in Counter(c.fmu for c in system.components).items():
        with suppress(ArchiveError):  # which is said where the FMU is read
            size += count * unpacked_size(fmu)
    if size > MAX_UNPACKED:
        limit = f"more than the limit of {MAX_UNPACKED}"
        yield f"with the FMUs of all components it would unpack to {size} bytes, {limit}"


_known: dict[Path, System] = {}
"""Systems that were read without a note or a problem, by folders of the cache, whose names say
their content; the last ones.
"""


def _read_once(folder: Path) -> tuple[System, list[str]]:
    """As _read(), from a folder of the cache: a process that runs a system again need not read it
    again, unless there is something to be said of it.
    """
    if folder in _known:
        return _known[folder], []
    notes: list[logging.LogRecord] = []

    def note(record: logging.LogRecord) -> bool:
        notes.append(record)
        return True

    _log.addFilter(note)
    try:
        system, problems = _read(folder)
    finally:
        _log.removeFilter(note)
    if not notes and not problems and _log.isEnabledFor(logging.WARNING):
        while len(_known) >= MOST_KNOWN:
            del _known[next(iter(_known))]
        _known[folder] = system
    return system, problems


def _read(folder: Path) -> tuple[System, list[str]]:
    """The system in an unpacked .ssp and its problems; StructureError if it cannot be read."""
    if not (folder / xml.SSD_FILE).is_file():
        raise StructureError([f"it holds no {xml.SSD_FILE}"])
    root = xml.parse(folder / xml.SSD_FILE, xml.SSD_SCHEMA)
    if (count := sum(1 for _ in root.iter(xml.tag("ssd:Component")))) > MAX_COMPONENTS:
        limit = f"more than the limit of {MAX_COMPONENTS}"
        raise StructureError([f"it has {count} components, {limit}"])
    reader = _Reader(folder, root)
    return reader.system(), reader.problems


class _Reader:
    """What the root of SystemStructure.ssd says: time, order, parameter sets; the elements are read
    elsewhere.
    """

    def __init__(self, folder: Path, root: XmlElement) -> None:
        self.folder = folder
        self.root = root
        ours = f"ssd:Annotations/ssc:Annotation[@type='{xml.RUN_ANNOTATION}']/run:Run"
        self.run = xml.first(root, ours)
        self.schedule = {e.get("name"): e for e in self._own("run:Component")}
        self.elements = ElementReader(
            folder, root, own=self.run is not None, arrays=xml.is_version_2(root)
        )
        self.problems = self.elements.problems

    def system(self) -> System:
        flat = Flat(self.elements.group(xml.first(self.root, "ssd:System")))
        self.problems += flat.problems
        experiment = self._experiment()
        components = tuple(self._component(leaf, flat, experiment) for leaf in flat.leaves.values())
        mission = self._said("mission")
        return System(
            name=self.root.get("name"),
            description=self.root.get("description", ""),
            components=components,
            connections=flat.connections,
            experiment=experiment,
            sets=tuple(self._set(e, components) for e in self._own("run:ParameterSet")),
            alternatives=tuple(
                self._alternative(e, components) for e in self._own("run:Alternative")
            ),
            requirements=self._texts("run:Requirement"),
            consistency=self._texts("run:Consistency"),
            strict=self._said("strict") == "true",
            compared=self._compared(),
            sliders={
                e.get("name", ""): (self._number(e, "low"), self._number(e, "high"))
                for e in self._own("run:Slider")
            },
            mission=mission if mission.isidentifier() else "",  # what is no name says nothing
            declared=flat.declared(),
        )

    def _texts(self, path: str) -> dict[str, str]:
        return {e.get("name", ""): e.get("text", "") for e in self._own(path)}

    def _said(self, attribute: str) -> str:
        """An attribute of our own annotation; "" in a file of another tool."""
        return "" if self.run is None else self.run.get(attribute, "")

    def _compared(self) -> str:
        """Name of the set that a comparison takes; one that is not there is a problem."""
        name = self._said("compare")
        if name and name not in {e.get("name") for e in self._own("run:ParameterSet")}:
            self.problems.append(f"compare: there is no parameter set {name}")
            return ""
        return name

    def _own(self, path: str) -> list[XmlElement]:
        """Elements of our own annotation, none in a file of another tool."""
        return [] if self.run is None else list(xml.every(self.run, path))

    def _experiment(self) -> Experiment:
        """Time span of the file; the step is OSP's, the algorithm ours, without ours Jacobi, which
        needs no order.
        """
        default = xml.first(self.root, "ssd:DefaultExperiment")
        step = xml.first(self.root, "ssd:DefaultExperiment//osp:FixedStepAlgorithm")
        return Experiment(
            start=self._number(default, "startTime") or 0.0,
            stop=self._number(default, "stopTime"),
            step=self._number(step, "baseStepSize"),
            algorithm="jacobi" if self.run is None else self.run.get("algorithm"),
            every=max(1, round(self._number(self.run, "every") or 1)),
            epoch=self._epoch(),
        )

    def _epoch(self) -> str:
        """UTC of t = 0; what is no date says nothing and is a problem."""
        text = self._said("epoch")
        try:
            return written(moment(text)) if text else ""
        except ValueError as error:
            self.problems.append(f"epoch {text}: {error}")
            return ""

    def _component(self, leaf: Leaf, flat: Flat, experiment: Experiment) -> Component:
        name, parameters = flat.names[leaf.place], flat.parameters[leaf.place]
        timing = self._schedule(name, leaf.hint, experiment)
        return Component(name, leaf.fmu, parameters, *timing)

    def _schedule(self, name: str, hint: float | None, experiment: Experiment) -> tuple[int, int]:
        """Period and latency from our annotation, else every from OSP's hint of a longer step."""
        own = self.schedule.get(name)
        if own is not None:
            return round(self._number(own, "every") or 1), round(self._number(own, "latency") or 0)
        if hint and not experiment.step:
            note = "%s: its step of %g s is not used, the file does not say the macro step"
            _log.warning(note, name, hint)
        return max(1, round(hint / experiment.step)) if hint and experiment.step else 1, 0

    def _set(self, element: XmlElement, components: tuple[Component, ...]) -> ParameterSet:
        """A set that our annotation lists but nothing binds: one .ssv per component that has
        parameters.
        """
        name = element.get("name", "")
        parameters = self._files(f"resources/sets/{name}", components)
        if not parameters:
            fault = "is listed, but none of its files is in the archive"
            self.problems.append(f"parameter set {name}: {fault}")
        stop, step = self._number(element, "stop"), self._number(element, "step")
        return ParameterSet(name, element.get("description", ""), parameters, stop, step)

    def _alternative(self, element: XmlElement, components: tuple[Component, ...]) -> Alternative:
        fmu = element.get("fmu", "")
        parameters = self._files(f"resources/alternatives/{fmu}", components)
        return Alternative(element.get("component", ""), fmu, parameters)

    def _files(self, place: str, components: tuple[Component, ...]) -> dict[str, Parameters]:
        """Parameters by component from the .ssv files of a folder of the archive."""
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
