# SPDX-License-Identifier: BSD-2-Clause
"""Every FMU of the build: its file, what its description says, and the library, loaded once."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.compliance import description
from tests.compliance.fmus import ARCHIVES
from tests.compliance.probe import Fmu, Instance


@pytest.fixture(scope="session", params=ARCHIVES, ids=lambda path: path.stem)
def archive(request) -> Path:
    return request.param


@pytest.fixture(scope="session")
def about(archive) -> description.Description:
    return description.read(archive)


@pytest.fixture(scope="session")
def fmu(archive, tmp_path_factory) -> Fmu:
    return Fmu(archive, tmp_path_factory.mktemp(archive.stem))


@pytest.fixture
def instance(fmu):
    """A fresh instance."""
    with Instance(fmu) as one:
        yield one


@pytest.fixture
def flying(fmu):
    """An instance after five steps, at t = 0.5 s of an experiment that ends at 100 s."""
    with Instance(fmu) as one:
        one.start(stop=100.0)
        one.fly(5)
        yield one
