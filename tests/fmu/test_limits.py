# SPDX-License-Identifier: BSD-2-Clause
"""Limits of parameters from both sides: the last value that is taken and the first that is not."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from tests.compliance.api import Status
from tests.compliance.probe import Fmu, Instance
from tests.each import each

from .driver import archive, flat

UP, DOWN = 1 + 1e-12, 1 - 1e-12
NEAR, OFF = 0.9e-9, 1.1e-9
"""Largest deviation of a unit vector from length 1, and one that is too large."""


def lengths(name, row, direction):
    """A unit vector may be a little too short or too long."""
    for sign in (1, -1):
        sizes = [1 + sign * off for off in (NEAR, OFF)]
        yield name, row, *({row: size * np.array(direction)} for size in sizes)


def first_row(vector, rows=16):
    return np.concatenate((np.atleast_1d(vector), np.zeros((rows - 1) * np.size(vector))))


def thruster(name):
    """One thruster; the others have no thrust and no direction."""
    one = {"thruster_position": np.zeros((16, 3)), "thrust_nominal": first_row(1.0)}
    for sign in (1, -1):
        sizes = [1 + sign * off for off in (NEAR, OFF)]
        turned = [{"thruster_direction": first_row(np.array((0.6, 0, 0.8)) * s)} for s in sizes]
        yield name, "|thruster_direction[1]|", one | turned[0], one | turned[1]


def whole(name, row, low, high, shared=None):
    """A whole number from low to high."""
    shared = shared or {}
    yield name, row, shared | {row: low}, shared | {row: low - 1}
    yield name, row, shared | {row: high}, shared | {row: high + 1}
    yield name, row, shared | {row: low + 1}, shared | {row: low + 0.5}


def at_most(name, row, limit, shared=None):
    shared = shared or {}
    yield name, row, shared | {row: limit}, shared | {row: limit * UP}


def below(name, row, limit, shared=None):
    shared = shared or {}
    yield name, row, shared | {row: limit * DOWN}, shared | {row: limit}


PLAN = {"nodes": 8, "use_plan": 0}
SENSORS = ("star_tracker", "gyro", "pose_sensor", "orbit_sensor", "range_sensor")
PULSED = {"pulsed": 1, "pulse_period": 0.5, "sample_period": 0.1}
ROWS = [
    *at_most("assembly", "eps_0", 1.0),
    *at_most("assembly", "h_0_S", 1500.0),
    ("pose_sensor", "latency", {"latency": 3.5 * (1 + NEAR)}, {"latency": 3.5 * (1 + OFF)}),
    ("pose_sensor", "range_max", {"range_min": 100 * DOWN}, {"range_min": 100}),
    ("range_sensor", "latency", {"latency": 3.5 * (1 + NEAR)}, {"latency": 3.5 * (1 + OFF)}),
    ("range_sensor", "range_max", {"range_min": 5000 * DOWN}, {"range_min": 5000}),
    *at_most("range_sensor", "p_drop", 1),
    *(row for name in ("p_drop", "p_flip", "p_outlier") for row in at_most("pose_sensor", name, 1)),
    *((name, "seed", {"seed": 2**32 - 1}, {"seed": 2**32}) for name in SENSORS),
    *((name, "stream", {"stream": 2**32 - 1}, {"stream": 2**32}) for name in SENSORS),
    *whole("propulsion", "fault_kind", 0, 3),
    *at_most("propulsion", "fault_factor", 1),
    *thruster("propulsion"),
    *thruster("thruster_allocation"),
    *lengths("los_guidance", "p_T", (0.6, 0, 0.8)),
    *below("los_guidance", "guard_angle", 1.5),
    *lengths("sync_guidance", "p_T", (0, 0.6, 0.8)),
    *below("sync_guidance", "guard_angle", 1.5),
    *lengths("switched_controller", "axis_H", (0.8, 0.6, 0)),
    *lengths("safety_monitor", "corridor_axis", (0, 0.8, 0.6)),
    *below("safety_monitor", "corridor_half_angle", 1.5707963267948966),
    *below("safety_monitor", "plume_half_angle", 1.5707963267948966),
    *at_most("safety_monitor", "passive_time", 6e6),
    *whole("safety_monitor", "keep_out_shape", 0, 2),
    *lengths("safety_filter", "corridor_axis", (0, 0.8, 0.6)),
    *below("safety_filter", "corridor_half_angle", 1.5707963267948966),
    *below("safety_filter", "mass_error", 1.0),
    *whole("safety_filter", "filter", 0, 3),
    *whole("safety_filter", "passive_points", 2, 32),
    *whole("ppc_controller", "law", 0, 2),
    *whole("ppc_controller", "law_att", 0, 2),
    *whole("ppc_controller", "up_axis", 1, 3),
    *at_most("ppc_controller", "range.delta", 1.0),
    *below("ppc_controller", "range.lambda", 8.0, {"range.beta": 0.125}),
    ("ppc_controller", "range.alpha_0", {"range.alpha_0": 0.5}, {"range.alpha_0": 0.5 * DOWN}),
    *below("pursuit_guidance", "rho1", 5e-3),
    *below("pursuit_guidance", "zeta2", 50.0),
    *at_most("pursuit_guidance", "zhys", 50.0),
    *below("pursuit_guidance", "alpha_fire", 1.5),
    *below("relay_controller", "rho1", 5e-3),
    *below("relay_controller", "xi1", 5e-2),
    *at_most("thruster_allocation", "min_on_time", 0.5, PULSED),
    ("transposition_guidance", "swing_start", {"swing_start": 0}, {"swing_start": -1e-9}),
    ("transposition_guidance", "window", PLAN | {"window": 3600}, PLAN | {"window": 3600 * DOWN}),
    *whole("transposition_guidance", "nodes", 8, 120, {"use_plan": 0}),
    *whole("transposition_guidance", "weight", 0, 8, PLAN),
    *whole("transposition_guidance", "iterations_max", 0, 30, PLAN),
    *whole("transposition_guidance", "scheme", 0, 2, PLAN),
    *at_most("transposition_guidance", "momentum_share", 1.0, PLAN),
    *at_most("transposition_guidance", "rotation_max", 3.05, PLAN),
    *at_most("transposition_guidance", "h_0_S", 1500.0, PLAN),
    *(row for name in ("target", "servicer") for row in below(name, "e", 1.0)),
]  # fmt: skip


@pytest.fixture(scope="module")
def rejection(tmp_path_factory):
    """rejection(fmu, parameters): the message with which they are rejected, or ""."""
    unpacked = cache(lambda name: Fmu(archive(name), tmp_path_factory.mktemp(name)))

    def requested(name, parameters):
        fmu = unpacked(name)
        with Instance(fmu) as instance:
            rows = {row: values.tolist() for row, values in flat(parameters).items()}
            instance.set(fmu.settings(**rows))
            instance.enter()
            status = instance.call("fmi2ExitInitializationMode")
            return instance.host.errors[-1] if status is Status.ERROR else ""

    return requested


@each(("name", "row", "taken", "rejected"), ROWS)
def test_the_last_value_is_taken_and_the_first_one_beyond_is_not(
    rejection, name, row, taken, rejected
):
    assert rejection(name, taken) == ""
    assert row in rejection(name, rejected)
