# SPDX-License-Identifier: BSD-2-Clause
"""Directional derivatives against differences of whole steps, made here by restoring the state and
stepping again.

After initialization they are of the outputs at the end of the next step with respect to the inputs
held over it, the step being as long as the last one; in initialization mode of the first outputs
with respect to inputs and parameters.
"""

from __future__ import annotations

from functools import partial
from math import inf, nan

import numpy as np
import pytest

from tests.compliance.api import Status
from tests.compliance.probe import Instance, excitation
from tests.compliance.rejections import rejected

H = 0.1
EPSILON = np.finfo(float).eps
SLOW = {"transposition_guidance": 4}
"""FMUs that plan for 30 ms in every initialization: every n-th of their parameters is moved."""


def right(instance, known, seed):
    status, result = instance.derivative(known, seed)
    assert status is Status.OK, instance.host.errors[-1]
    return np.array(result)


def outputs_after_step(instance, state, t, values, h=H):
    instance.restore(state)
    instance.set(values)
    instance.step(t, h)
    return np.array(instance.values(instance.fmu.outputs))


def first_outputs(instance, state, _, values):
    instance.restore(state)
    instance.set(values)
    return np.array(instance.values(instance.fmu.outputs))


def differences(evaluate, v, value):
    """Central differences at one and at ten thousandths of the scale of the variable, each from two
    distances.
    """
    scale = abs(value) if v.causality == "parameter" and value else max(1, 1e-6 * abs(value))
    for d in (1e-3 * scale, 1e-2 * scale):
        wide, narrow = (
            (evaluate({v.name: value + s}) - evaluate({v.name: value - s})) / (2 * s)
            for s in (d, d / 2)
        )
        yield (4 * narrow - wide) / 3


def inner(variables):
    """Variables whose range allows a difference on both sides of the value."""
    return [v for v in variables if v.low < v.start < v.high]


def bends(evaluate, v, value):
    """The slope above the value less that below it, over a short distance and over its half: equal
    at a kink, halved where the model is smooth.
    """
    scale = abs(value) if v.causality == "parameter" and value else max(1, 1e-6 * abs(value))
    here = evaluate({v.name: value})
    for d in (1e-3 * scale, 5e-4 * scale):
        yield (evaluate({v.name: value + d}) - 2 * here + evaluate({v.name: value - d})) / d


def remembered(evaluate):
    """The same, which computes nothing twice: differences and bends have points in common."""
    known = {}

    def evaluated(values):
        point = tuple(values.items())
        if point not in known:
            known[point] = evaluate(values)
        return known[point]

    return evaluated


def smooth_difference(evaluate, v, value):
    """The difference, the rounding to expect in it, and for which outputs the model is smooth
    enough to have one.

    Rounding: a hundred units in the last place of the largest output or of the known itself, over
    the shortest distance.
    """
    evaluate = remembered(evaluate)
    near, far = differences(evaluate, v, value)
    slope = np.abs(far).max()
    rounding = 100 * EPSILON * (np.abs(evaluate({v.name: value})).max() + slope * abs(value)) / 5e-4
    wide, narrow = map(np.abs, bends(evaluate, v, value))
    kink = (narrow > 0.5 * wide) & (narrow > rounding)
    smooth = np.abs(near - far) <= rounding + 1e-4 * slope
    return near, rounding + 1e-5 * slope, smooth & ~kink


def compare(instance, variables, evaluator, t):
    """Variables whose derivatives differ from the differences, with the largest error and the
    tolerance.
    """
    return deviations(instance, {v: right(instance, [v], [1.0]) for v in variables}, evaluator, t)


def deviations(instance, derivatives, evaluator, t):
    """The same for derivatives that are known by variable."""
    state = instance.save()
    wrong = {}
    for v, given in derivatives.items():
        value = instance.get(v.name)
        expected, tolerance, smooth = smooth_difference(
            partial(evaluator, instance, state, t), v, value
        )
        instance.restore(state)
        error = np.abs(given - expected)[smooth]
        if not np.all(error <= tolerance):
            wrong[v.name] = (error.max(), tolerance)
    instance.drop(state)
    return wrong


def test_derivatives_are_the_differences_of_the_next_step(running):
    assert compare(running, inner(running.fmu.inputs), outputs_after_step, 0.5) == {}


def test_the_next_step_is_as_long_as_the_last(fmu):
    with Instance(fmu) as instance:
        instance.start()
        instance.simulate(2, h=0.4)
        after_step = partial(outputs_after_step, h=0.4)
        assert compare(instance, inner(fmu.inputs), after_step, 0.8) == {}


def test_before_the_first_step_the_next_step_is_a_tenth_of_a_second(fmu):
    with Instance(fmu) as instance:
        instance.start()
        assert compare(instance, inner(fmu.inputs), outputs_after_step, 0.0) == {}


def test_in_initialization_mode_derivatives_are_of_the_first_outputs(fmu):
    with Instance(fmu) as instance:
        instance.enter()
        assert compare(instance, inner(fmu.inputs), first_outputs, 0.0) == {}


def test_in_initialization_mode_there_are_derivatives_for_parameters(fmu):
    """A parameter is left out where a rule (unit vectors, symmetry) forbids to move it alone; then
    a message states it.
    """
    with Instance(fmu) as instance:
        instance.enter()
        movable = {}
        for v in inner(fmu.parameters)[:: SLOW.get(fmu.name, 1)]:
            instance.host.messages.clear()
            status, result = instance.derivative([v], [1.0])
            if status is Status.OK:
                movable[v] = np.array(result)
            else:
                assert instance.host.errors[0].startswith("fmi2GetDirectionalDerivative: ")
        assert deviations(instance, movable, first_outputs, 0.0) == {}


def test_derivatives_are_linear_in_the_direction(running):
    """Of outputs that are smooth in every input; a direction is followed until the first input has
    moved by its scale.
    """
    known = inner(running.fmu.inputs)
    state = running.save()
    evaluate = partial(outputs_after_step, running, state, 0.5)
    smooth = [
        smooth_difference(evaluate, v, running.get(v.name))[2]
        for v in known
        if not running.restore(state)
    ]
    running.restore(state)
    running.drop(state)
    if not known or not np.all(smooth, axis=0).any():
        pytest.skip(f"{running.fmu.name} has no output that is smooth in all inputs")
    seed = np.cos(np.arange(len(known)))
    columns = np.array([right(running, [v], [1.0]) for v in known])
    together, scale = right(running, known, seed), np.abs(columns).sum(axis=0)
    everywhere = np.all(smooth, axis=0)
    error = np.abs(together - seed @ columns)[everywhere]
    assert np.all(error <= 1e-3 * scale.max())
    opposite = right(running, known, -2 * seed)
    assert np.array_equal(opposite[everywhere], -2 * together[everywhere])


def test_evaluating_derivatives_changes_nothing(running):
    before = running.snapshot()
    right(running, inner(running.fmu.inputs), [1.0] * len(inner(running.fmu.inputs)))
    assert running.snapshot() == before


def test_a_zero_direction_has_zero_derivatives(running):
    known = running.fmu.inputs
    assert not right(running, known, [0.0] * len(known)).any()
    assert not right(running, [], []).any()


def test_every_output_can_be_requested_alone(running):
    known = inner(running.fmu.inputs)[:1]
    together = right(running, known, [1.0] * len(known))
    for v, expected in zip(running.fmu.outputs, together, strict=True):
        assert running.derivative(known, [1.0] * len(known), [v])[1] == expected


def test_directions_that_make_no_sense_are_rejected(running):
    fmu = running.fmu
    outputs, inputs, parameters = fmu.outputs[:1], inner(fmu.inputs)[:1], fmu.parameters[:1]
    wrong = [(outputs, outputs), (outputs, parameters), (inputs, inputs), (parameters, inputs)]
    for unknown, known in wrong:
        if unknown and known:
            with rejected(running, "fmi2GetDirectionalDerivative") as answer:
                answer.append(running.derivative(known, [1.0], unknown)[0])
    for bad in (nan, inf) if inputs else ():
        with rejected(running, "fmi2GetDirectionalDerivative", "finite") as answer:
            answer.append(running.derivative(inputs, [bad])[0])


def test_derivatives_after_a_failed_step_match_the_last_good_state(running):
    """The bad inputs are still set; good ones come back with a saved state."""
    known = inner(running.fmu.inputs)[:3]
    running.set(excitation(running.fmu.inputs, 9))
    before, good = right(running, known, [1.0] * len(known)), running.save()
    running.set({v.name: min(v.high, 1.7e308) for v in running.fmu.inputs})
    if running.call("fmi2DoStep", 0.5, 10.0, 0) is Status.OK:
        pytest.skip(f"no input makes a step of {running.fmu.name} fail")
    assert running.derivative(known, [1.0] * len(known))[0] in (Status.OK, Status.ERROR)
    running.restore(good)
    assert np.array_equal(right(running, known, [1.0] * len(known)), before)
    running.drop(good)
