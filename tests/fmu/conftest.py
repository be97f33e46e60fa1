# SPDX-License-Identifier: BSD-2-Clause
"""Fixture `fmu`: instances of the FMUs under test, freed when the test is over. Each archive is
unpacked once.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.each import Each

from .driver import Kind, Unit


@pytest.fixture(scope="session")
def kind(tmp_path_factory):
    kinds = {}

    def unpacked(name):
        if name not in kinds:
            kinds[name] = Kind(name, tmp_path_factory.mktemp(name))
        return kinds[name]

    return unpacked


@pytest.fixture
def fmu(kind):
    """fmu(name, parameters, inputs, start) -> Unit, initialized."""
    units = []

    def instance(name, parameters=None, inputs=None, start=0.0):
        units.append(Unit(kind(name), parameters or {}, inputs or {}, start))
        return units[-1]

    yield instance
    for unit in units:
        unit.close()


@pytest.fixture(params=[2, pytest.param(8, marks=pytest.mark.long)], ids="{} seeds".format)
def rng(request):
    return Each(range(request.param)).map(np.random.default_rng)
