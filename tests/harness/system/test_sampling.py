# SPDX-License-Identifier: BSD-2-Clause
"""A note when the macro step is no divisor of a sample period."""

from __future__ import annotations

import pytest

from harness import run
from harness.files import paths
from harness.master.changes import apply, choose_set, set_names
from harness.ssp.library import load
from harness.system.graph import checked
from tests.each import some


@pytest.mark.parametrize(
    ("period", "noted"),
    [(0, False), (0.1, False), (0.3, False), (0.1 + 1e-15, False), (0.25, True), (0.05, True)],
)
def test_a_sample_period_that_is_no_multiple_of_the_step_is_noted(caplog, period, noted):
    with load("sync_approach") as system:
        checked(apply(system, set=[f"controller.sample_period={period}"], step=0.1))
    note = (
        f"controller.sample_period = {period:g} s is not a multiple of the step of controller, "
        "0.1 s"
    )
    assert any(message.startswith(note) for message in caplog.messages) == noted


@pytest.mark.parametrize("period", ["1e308", "1e300", "1e16", "1e10", "4.9e-324"])
@pytest.mark.parametrize("step", [0.1, 1e-6])
def test_no_sample_period_is_too_long_or_too_short_to_be_reported(period, step):
    with load("sync_approach") as system:
        checked(apply(system, set=[f"controller.sample_period={period}"], step=step, stop=1.0))


def test_it_is_reported_once_per_run(caplog):
    run("sync_approach", set=["controller.sample_period=0.25"], stop=1.0)
    assert len(caplog.messages) == 1


@pytest.mark.parametrize("name", some(paths.systems(), 5))
def test_no_system_of_ours_has_one_in_any_set(caplog, name):
    with load(name) as system:
        for chosen in set_names(system):
            checked(choose_set(system, chosen))
    assert caplog.messages == []
