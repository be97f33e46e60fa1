# SPDX-License-Identifier: BSD-2-Clause
"""Reference traces in the archives (FMI-LS-REF): the bits of an unconnected FMU."""

from __future__ import annotations

import csv
import zipfile
from xml.etree import ElementTree

import numpy as np
import pytest

from harness.master.simulation import Simulation
from harness.system.model import Component, Experiment, System
from tests.compliance.fmus import BUILD
from tests.each import Each
from tests.fmi3.fmus import ARCHIVES

FOLDER = "extra/org.fmi-standard.fmi-ls-ref"
SPACE = "{http://fmi-standard.org/fmi-ls-manifest}fmi-ls-"


@pytest.fixture(scope="module")
def archive():
    return Each(ARCHIVES, lambda path: path.stem)


def contents(path):
    with zipfile.ZipFile(path) as opened:
        return {n: opened.read(n) for n in opened.namelist() if n.startswith(FOLDER)}


def twin(archive):
    """The archive of FMI 2.0."""
    return BUILD / "fmus" / archive.name


def test_the_manifest_names_the_trace(archive):
    files = contents(archive)
    root = ElementTree.fromstring(files[f"{FOLDER}/fmi-ls-manifest.xml"])
    assert root.tag == "fmiReferences"
    assert root.attrib[f"{SPACE}name"] == "org.fmi-standard.fmi-ls-ref"
    assert root.attrib[f"{SPACE}description"]
    (related,) = root
    assert (related.tag, related.get("role"), related.get("type")) == (
        "Related", "result", "text/csv",
    )  # fmt: skip
    assert set(files) == {f"{FOLDER}/{n}" for n in ("fmi-ls-manifest.xml", related.get("source"))}
    assert files == contents(twin(archive))


def test_the_trace_has_the_bits_of_a_run(archive):
    names, *lines = csv.reader(contents(archive)[f"{FOLDER}/reference.csv"].decode().splitlines())
    trace = np.array(lines, dtype=float)
    assert names[0] == "time"
    assert len(trace) == 21
    for fmu in (archive, twin(archive)):
        system = System("x", (Component("x", fmu),), (), Experiment(0.0, 100.0, 0.1, every=50))
        with Simulation(system) as simulation:
            simulation.advance()
            result = simulation.result()
        assert sorted(names[1:]) == sorted(s.name.partition(".")[2] for s in simulation.graph.slots)
        for name, column in zip(names, trace.T, strict=True):
            found = result.time if name == "time" else result[f"x.{name}"]
            np.testing.assert_array_equal(found.ravel(), column, err_msg=name)
