# SPDX-License-Identifier: BSD-2-Clause
"""The documentation of every component of flight software names the system whose values are its
start values, and the parameters that are different there.
"""

from __future__ import annotations

import importlib.util
import zipfile
from pathlib import Path

import numpy as np
import pytest

from harness.files import paths
from harness.studies.show import Signal, show
from tests.each import Each

ROOT = Path(__file__).resolve().parents[2]
FLIGHT = sorted(p.stem for p in (ROOT / "fmus/flight").glob("*.c"))


def table():
    """Entry by FMU of the table that the build reads."""
    path = ROOT / "fmus/core/build/start_values.py"
    spec = importlib.util.spec_from_file_location("start_values", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.START_VALUES


@pytest.fixture
def fmu():
    return Each(FLIGHT, str)


def differing(name, place):
    """Parameters whose values in the system are not the start values of the FMU."""
    component = place.partition(".")[2]
    rows = show(place, swap={component: name}).rows
    given = [r for r in rows if isinstance(r, Signal) and r.causality == "parameter"]
    assert given
    return [r.name for r in given if not np.array_equal(*map(np.asarray, (r.value, r.default)))]


def test_every_component_of_flight_software_names_its_system(fmu):
    place, other = table()[fmu]
    assert differing(fmu, place) == list(other)


def test_the_documentation_in_the_fmu_has_the_line(fmu):
    place, other = table()[fmu]
    with zipfile.ZipFile(paths.fmus()[fmu]) as archive:
        page = archive.read("documentation/index.html").decode()
    assert f"Start values: of system {place.partition('.')[0]}" in page
    assert all(name in page for name in other)
