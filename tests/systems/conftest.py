# SPDX-License-Identifier: BSD-2-Clause
"""A browser, and pages of the systems that a module runs."""

from __future__ import annotations

import pytest

from harness import run
from harness.api import write_page
from tests.harness.chromium import browser
from tests.sketches import sketched


@pytest.fixture
def sketches():
    """The look of pictures does not matter."""
    with sketched():
        yield


@pytest.fixture(scope="module")
def chromium():
    with browser() as running:
        yield running


@pytest.fixture(scope="module")
def report_of(request, tmp_path_factory):
    """Page and result of a system of the module's RUNS, written once."""
    known = {}

    def written(system):
        if system not in known:
            result = run(system, **request.module.RUNS[system])
            page = tmp_path_factory.mktemp("report") / f"{system}.html"
            known[system] = write_page(result, page), result
        return known[system]

    return written
