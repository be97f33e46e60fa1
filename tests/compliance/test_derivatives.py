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
from tests.compliance.refusals import refused

H = 0.1
EPSILON = np.finfo(float).eps


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
    """Those with room for a difference on both sides of the value."""
    return [v for v in variables if v.low < v.start < v.high]


def smooth_difference(evaluate, v, value):
    """The difference, the rounding to expect in it, and for which outputs the model is smooth
    enough to have one.

    Rounding: a hundred units in the last place of the largest output or of the known itself, over
    the shortest distance.
    """
    near, far = differences(evaluate, v, value)
    slope = np.abs(far).max()
    rounding = 100 * EPSILON * (np.abs(evaluate({v.name: value})).max() + slope * abs(value)) / 5e-4
    return far, rounding + 1e-5 * slope, np.abs(near - far) <= rounding + 1e-4 * slope


def compare(instance, variables, evaluator, t):
    """Variables whose derivatives differ from the differences, with the largest error and the
    tolerance.
    """
    state = instance.save()
    wrong = {}
    for v in variables:
        value = instance.get(v.name)
        given = right(instance, [v], [1.0])
        expected, tolerance, smooth = smooth_difference(
            partial(evaluator, instance, state, t), v, value
        )
        instance.restore(state)
        error = np.abs(given - expected)[smooth]
        if not np.all(error <= tolerance):
            wrong[v.name] = (error.max(), tolerance)
    instance.drop(state)
    return wrong


def test_derivatives_are_the_differences_of_the_next_step(flying):
    assert compare(flying, inner(flying.fmu.inputs), outputs_after_step, 0.5) == {}


def test_the_next_step_is_as_long_as_the_last(fmu):
    with Instance(fmu) as instance:
        instance.start()
        instance.fly(2, h=0.4)
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
    a message says so.
    """
    with Instance(fmu) as instance:
        instance.enter()
        movable = []
        for v in inner(fmu.parameters):
            instance.host.messages.clear()
            if instance.derivative([v], [1.0])[0] is Status.OK:
                movable.append(v)
            else:
                assert instance.host.errors[0].startswith("fmi2GetDirectionalDerivative: ")
        assert compare(instance, movable, first_outputs, 0.0) == {}


def test_derivatives_are_linear_in_the_direction(flying):
    """Of outputs that are smooth in every input; a direction is followed until the first input has
    moved by its scale.
    """
    known = inner(flying.fmu.inputs)
    state = flying.save()
    evaluate = partial(outputs_after_step, flying, state, 0.5)
    smooth = [
        smooth_difference(evaluate, v, flying.get(v.name))[2]
        for v in known
        if not flying.restore(state)
    ]
    flying.restore(state)
    flying.drop(state)
    if not known or not np.all(smooth, axis=0).any():
        pytest.skip(f"{flying.fmu.name} has no output that is smooth in all inputs")
    seed = np.cos(np.arange(len(known)))
    columns = np.array([right(flying, [v], [1.0]) for v in known])
    together, scale = right(flying, known, seed), np.abs(columns).sum(axis=0)
    error = np.abs(together - seed @ columns)[np.all(smooth, axis=0)]
    assert np.all(error <= 1e-3 * scale.max())
    assert np.array_equal(right(flying, known, -2 * seed), -2 * together)


def test_asking_for_derivatives_changes_nothing(flying):
    before = flying.snapshot()
    right(flying, inner(flying.fmu.inputs), [1.0] * len(inner(flying.fmu.inputs)))
    assert flying.snapshot() == before


def test_a_zero_direction_has_zero_derivatives(flying):
    known = flying.fmu.inputs
    assert not right(flying, known, [0.0] * len(known)).any()
    assert not right(flying, [], []).any()


def test_every_output_can_be_asked_for_alone(flying):
    known = inner(flying.fmu.inputs)[:1]
    together = right(flying, known, [1.0] * len(known))
    for v, expected in zip(flying.fmu.outputs, together, strict=True):
        assert flying.derivative(known, [1.0] * len(known), [v])[1] == expected


def test_directions_that_make_no_sense_are_refused(flying):
    fmu = flying.fmu
    outputs, inputs, parameters = fmu.outputs[:1], inner(fmu.inputs)[:1], fmu.parameters[:1]
    wrong = [(outputs, outputs), (outputs, parameters), (inputs, inputs), (parameters, inputs)]
    for unknown, known in wrong:
        if unknown and known:
            with refused(flying, "fmi2GetDirectionalDerivative") as answer:
                answer.append(flying.derivative(known, [1.0], unknown)[0])
    for bad in (nan, inf) if inputs else ():
        with refused(flying, "fmi2GetDirectionalDerivative", "finite") as answer:
            answer.append(flying.derivative(inputs, [bad])[0])


def test_derivatives_after_a_failed_step_are_those_of_the_last_good_state(flying):
    """The bad inputs are still set; good ones come back with a saved state."""
    known = inner(flying.fmu.inputs)[:3]
    flying.set(excitation(flying.fmu.inputs, 9))
    before, good = right(flying, known, [1.0] * len(known)), flying.save()
    flying.set({v.name: min(v.high, 1.7e308) for v in flying.fmu.inputs})
    if flying.call("fmi2DoStep", 0.5, 10.0, 0) is Status.OK:
        pytest.skip(f"no input makes a step of {flying.fmu.name} fail")
    assert flying.derivative(known, [1.0] * len(known))[0] in (Status.OK, Status.ERROR)
    flying.restore(good)
    assert np.array_equal(right(flying, known, [1.0] * len(known)), before)
    flying.drop(good)
