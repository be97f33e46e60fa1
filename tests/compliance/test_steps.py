# SPDX-License-Identifier: BSD-2-Clause
"""The result of a run does not depend on how the master cuts it into communication steps.

Plants integrate and software samples on a grid of their own (max_step, sample_period, T0), set to
0.1 s here.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.compliance.api import Status
from tests.compliance.fmus import ARCHIVES
from tests.compliance.probe import Fmu, Instance, excitation

GRID = 0.1


def simulate(fmu, points, grid=GRID, end=None):
    """Constant inputs; steps between the points of time; the outputs at the end as an array and as
    bits.
    """
    with Instance(fmu) as instance:
        instance.start(
            fmu.sampled_every(grid) | excitation(fmu.inputs, 3), start=points[0], stop=end
        )
        for t, after in zip(points, points[1:], strict=False):
            instance.step(t, after - t)
        return np.array(instance.values(fmu.outputs)), instance.outputs()


def multiples(h, count, start=0.0):
    return [start + k * h for k in range(count + 1)]


def accumulated(h, count, start=0.0):
    """Return the times of a master that adds up its steps."""
    points = [start]
    for _ in range(count):
        points.append(points[-1] + h)
    return points


@pytest.mark.parametrize(("h", "count"), [(0.1, 10), (0.2, 5), (0.5, 2), (0.1, 300)])
def test_many_steps_on_the_grid_are_one_long_step(fmu, h, count):
    total = round(h * count, 9)
    assert simulate(fmu, multiples(h, count))[1] == simulate(fmu, [0.0, total])[1]


def test_a_mixture_of_steps_on_the_grid_is_one_long_step(fmu):
    points = [round(GRID * k, 9) for k in (0, 1, 4, 5, 15, 16, 30)]
    assert simulate(fmu, points)[1] == simulate(fmu, [0.0, 3.0])[1]


@pytest.mark.parametrize("start", [-7.0, 100.0, 86400.0, 1.7e9])
def test_many_steps_are_one_long_step_from_any_start_on_the_grid(fmu, start):
    assert simulate(fmu, multiples(0.1, 30, start))[1] == simulate(fmu, [start, start + 3.0])[1]


@pytest.mark.parametrize("count", [10, 1000, pytest.param(20000, marks=pytest.mark.long)])
def test_time_may_be_accumulated_without_any_effect(fmu, count):
    """t += h drifts by up to 1e-8 s over 20000 steps; grid points are recognised within 1e-9 of
    their number.
    """
    points = accumulated(0.1, count)
    if count > 10:
        assert points[-1] != multiples(0.1, count)[-1]
    assert simulate(fmu, points)[1] == simulate(fmu, multiples(0.1, count))[1]


def test_a_communication_point_that_is_reached_with_a_rounding_error_is_the_same_point(fmu):
    exact, nearly = [0.0, 1.0, 2.0], [0.0, 1.0 + 5e-11, 2.0]
    assert simulate(fmu, exact)[1] == simulate(fmu, nearly)[1]


def row_scale(fmu, outputs):
    """The largest element of the row of every output: rounding errors come from there."""
    rows = np.array([v.row for v in fmu.outputs])
    return np.array([np.max(np.abs(outputs[rows == row])) for row in rows])


@pytest.mark.parametrize("h", [0.07, 0.03, 0.25, 1 / 3])
def test_communication_points_off_the_grid_change_no_more_than_the_error_of_the_integrator(fmu, h):
    """An internal step that a communication point cuts in two is integrated more accurately than
    before, so the change is below the integration error of the grid, for which the change from a
    grid half as wide stands (times 16/15, since the order is 4; times 2 to be safe). The floor of
    1e-12 covers 200 roundings."""
    count = round(21 / h)
    points = [*multiples(h, count - 1), 21.0]
    on, off, fine = (
        simulate(fmu, [0.0, 21.0])[0],
        simulate(fmu, points)[0],
        simulate(fmu, [0.0, 21.0], grid=GRID / 2)[0],
    )
    if "max_step" not in fmu.about.by_name:
        assert np.array_equal(on, off), "software samples at the same instants with every master"
    else:
        assert np.all(np.abs(off - on) <= 2 * np.abs(on - fine) + 1e-12 * row_scale(fmu, on))


def test_very_short_steps_are_not_lost(fmu):
    """A million times below the grid: together they are what one step over the same time is, up to
    the roundings.
    """
    h, count = 1e-7, 200
    many, one = simulate(fmu, multiples(h, count))[0], simulate(fmu, [0.0, h * count])[0]
    assert np.all(np.abs(many - one) <= 1e-12 * row_scale(fmu, one) + 1e-15)


def test_the_outputs_stay_as_they_are_until_the_next_step(fmu):
    with Instance(fmu) as instance:
        instance.start()
        instance.simulate(3)
        outputs = instance.outputs()
        instance.set(excitation(fmu.inputs, 50))
        assert instance.outputs() == outputs
        instance.step(0.3, 1.0)  # the slowest sensor samples once a second
        # the timeline has no inputs, and by default no event
        assert fmu.name == "timeline" or instance.outputs() != outputs


@pytest.mark.parametrize("prior", [0, 1])
def test_the_hint_about_rollback_changes_nothing(fmu, prior):
    with Instance(fmu) as instance, Instance(fmu) as other:
        instance.start()
        other.start()
        for k in range(5):
            instance.ok("fmi2DoStep", k * 0.1, 0.1, prior)
            other.step(k * 0.1, 0.1)
        assert instance.outputs() == other.outputs()


def test_a_step_of_too_many_internal_steps_is_rejected_and_not_begun(fmu, archive, elsewhere):
    """Called in a process of its own, since it would never come back."""
    grid = [v.reference for v in fmu.parameters if v.name in fmu.sampled_every(1.0)]
    if not grid:
        pytest.skip(f"{fmu.name} has neither internal steps nor samples of its own")
    outputs, inputs = [fmu.outputs[0].reference], [v.reference for v in fmu.inputs[:1]]
    begin = [[0, "new"], *([0, "set", [reference], 1e-12] for reference in grid)]
    begin += [[0, "call", "fmi2EnterInitializationMode"], [0, "call", "fmi2ExitInitializationMode"]]
    calls = [[0, "step", 0.0, 0.1], [0, "derivative", outputs, inputs, 1.0], [0, "step", 0.0, 1e-9]]
    answers = elsewhere.run(archive, begin + calls)
    assert [status for status, _ in answers[-3:]] == [Status.ERROR, Status.ERROR, Status.OK]


@pytest.mark.parametrize("name", ["ideal_propulsion"])
def test_ten_million_internal_steps_are_taken_and_no_more(name, tmp_path):
    fmu = Fmu(next(path for path in ARCHIVES if path.stem == name), tmp_path)
    for h, status in ((1.0, Status.OK), (1.001, Status.ERROR)):
        with Instance(fmu) as instance:
            instance.start({"max_step": 1e-7})
            assert instance.call("fmi2DoStep", 0.0, h, 0) is status
