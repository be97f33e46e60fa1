# SPDX-License-Identifier: BSD-2-Clause
"""Every FMU of the build: its file, what its description says, and the library, loaded once."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

import pytest

from tests.compliance import description
from tests.compliance.fmus import TESTED
from tests.compliance.probe import Fmu, Instance
from tests.each import Each


@pytest.fixture(scope="session")
def archive() -> Each:
    return Each(TESTED, lambda path: path.stem)


@pytest.fixture(scope="session")
def about(archive) -> Each:
    return archive.map(cache(description.read))


@pytest.fixture(scope="session")
def fmu(archive, tmp_path_factory) -> Each:
    folder = tmp_path_factory.mktemp("fmus")
    return archive.map(cache(lambda path: Fmu(path, folder / path.stem)))


@pytest.fixture(scope="session")
def instance(fmu) -> Each:
    """A fresh instance."""
    return fmu.within(Instance)


@pytest.fixture(scope="session")
def flying(fmu) -> Each:
    """An instance after five steps, at t = 0.5 s of an experiment that ends at 100 s."""
    return fmu.within(_flying)


@contextmanager
def _flying(fmu: Fmu) -> Iterator[Instance]:
    with Instance(fmu) as one:
        one.start(stop=100.0)
        one.fly(5)
        yield one
