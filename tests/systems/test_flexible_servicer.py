# SPDX-License-Identifier: BSD-2-Clause
"""--swap servicer=flexible_servicer: starts everywhere, is the rigid servicer without panels and
slosh, bends and sloshes as much as the documentation states, and shows it in its outputs.
"""

from __future__ import annotations

import numpy as np
import pytest

from harness import run
from harness.mission import Limits
from harness.report.arrays import Arrays
from ssp.shared import flexible
from ssp.shared.approach_scene import pair
from ssp.shared.relative_motion import attitude_error
from tests.each import some

SWAP = ["servicer=flexible_servicer"]
SYSTEMS = {
    "sync_approach": 30.0,
    "sync_approach_navigated": 10.0,
    "sync_approach_thrusters": 20.0,
    "sync_approach_thrusters_guarded": 10.0,
    "sync_approach_thrusters_navigated": 10.0,
    "ppc_tracking": 20.0,
    "ppc_tracking_guarded": 10.0,
    "ppc_tracking_navigated": 10.0,
    "ppc_tracking_notched": 10.0,
    "relay_approach": 100.0,
    "relay_approach_navigated": 20.0,
    "arch_rendezvous": 600.0,
}
STILL = {"servicer.panel_mass": [0.0] * 4, "servicer.slosh_mass_0": [0.0] * 4}
ALARMED = ("ppc_controller", "pid_controller", "theta_d_controller")


@pytest.mark.parametrize("system", some(SYSTEMS, 3))
def test_the_swap_starts_and_both_executors_agree_bit_for_bit(system):
    stop = SYSTEMS[system] / 10
    found = [run(system, swap=SWAP, stop=stop, executor=e) for e in ("c", "python")]
    for name in found[0].vectors:
        assert np.array_equal(found[0][name], found[1][name]), name
    assert np.abs(found[0]["servicer.slosh_displacement"]).max() > 0


@pytest.mark.parametrize("system", some(SYSTEMS, 3, 1))
def test_without_panels_and_slosh_every_signal_matches_the_rigid_servicer(system):
    released = {"servicer.t_att": 0} if system.startswith("sync") else {}
    rigid = run(system, set=released, stop=SYSTEMS[system])
    flexible_one = run(system, swap=SWAP, set=STILL | released, stop=SYSTEMS[system])
    for name in rigid.vectors:
        assert np.array_equal(flexible_one[name], rigid[name]), name


I_H = 1.31 + 8 * 0.75**2
"""Of a wing about its hinge [kg m2]."""


def free_modes(hertz):
    """Antisymmetric (hub with J = 60 kg m2) and symmetric mode of two wings [rad/s]."""
    turning, shifting = 2 * (1.31 + 8 * 0.75 * 1.25) ** 2 / 60, 2 * (8 * 0.75) ** 2 / 100
    return tuple(2 * np.pi * hertz / np.sqrt(1 - share / I_H) for share in (turning, shifting))


def late(hertz, torque=0.0, force=0.0):
    """ppc_tracking with a controller a sample late: largest attitude error of the last quarter
    [deg], torque impulse [N m s], largest amplitude of each mode then [rad].
    """
    values = {
        "servicer.panel_frequency": [2 * np.pi * hertz] * 4,
        "filter.frequency": [torque, 0.0],
        "filter.force_frequency": [force, 0.0],
    }
    result = run("ppc_tracking_notched", swap=SWAP, set=values, latency={"controller": 1})
    last = result.time >= 0.75 * result.time[-1]
    error = np.degrees(attitude_error(result)[last].max())
    one, two = result["servicer.panel_angle"][last, :2].T
    modes = np.abs((one + two) / 2).max(), np.abs((one - two) / 2).max()
    return error, result["propulsion.torque_impulse"][-1].sum(), modes


def test_wings_of_3_hz_are_lost_to_a_sample_of_latency_and_a_notch_at_their_free_mode_saves_them():
    free, _ = free_modes(3)
    (lost, shaken, _), (held, quiet, _) = late(3), late(3, free)
    assert lost > 1
    assert shaken > 1000
    assert held < 0.01
    assert quiet < 2 * 93  # of the rigid servicer
    assert late(3, 0.9 * free)[0] < 0.01


def test_torque_excites_wings_that_swing_alike_and_force_wings_that_swing_apart():
    """4 Hz, both modes beyond 3.3 Hz: one notch leaves the mode of the other loop."""
    alike, apart = free_modes(4)
    turned, shifted, both = late(4, alike), late(4, 0, apart), late(4, alike, apart)
    assert turned[2][1] > 0.1
    assert shifted[2][0] > 0.01
    assert shifted[2][1] < 1e-3
    assert min(turned[0], shifted[0]) > 1
    assert both[0] < 0.01
    assert both[1] < 2 * 93
    assert max(both[2]) < 1e-4


@pytest.fixture(scope="module")
def approaches():
    return run("sync_approach"), run("sync_approach", swap=SWAP)


def test_the_adaptive_approach_hardly_notices(approaches):
    """Attitude error at 1800 s, panels, slosh; the tank holds."""
    rigid, bent = approaches
    errors = [np.degrees(attitude_error(result)[-1]) for result in approaches]
    assert abs(errors[0] - errors[1]) < 0.01
    assert np.abs(bent["servicer.panel_angle"]).max() < 6e-3
    assert 0.1 < np.abs(bent["servicer.slosh_displacement"]).max() < 0.12
    assert not bent["servicer.slosh_beyond_travel"].any()
    assert not list(flexible.notes(bent))
    assert not list(flexible.notes(rigid))


@pytest.mark.parametrize("controller", ALARMED)
def test_controllers_without_a_force_limit_push_the_propellant_out_of_its_tank(controller):
    result = run("sync_approach", swap=[*SWAP, f"controller={controller}"], stop=30)
    (note,) = flexible.notes(result)
    assert note.startswith("slosh alarm: ")
    assert np.abs(result["servicer.slosh_displacement"]).max() > 0.15


def test_soft_propellant_leaves_its_tank_under_hard_thrust():
    """ppc_tracking with the default frequencies: metres."""
    soft = {
        "servicer.panel_frequency": [np.pi / 2] * 4,
        "servicer.slosh_frequency": [np.pi / 10] * 4,
    }
    result = run("ppc_tracking", swap=SWAP, set=soft, stop=20)
    assert np.abs(result["servicer.slosh_displacement"]).max() > 1
    assert list(flexible.notes(result))


def test_metrics_of_panels_are_nan_where_the_servicer_is_rigid(approaches):
    rigid, bent = approaches
    found = {m.name: (m(rigid, Limits()), m(bent, Limits())) for m in flexible.METRICS}
    assert list(found) == ["panel angle", "residual vibration", "slosh", "elastic energy"]
    assert all(np.isnan(a) for a, _ in found.values())
    assert found["panel angle"][1] == 1e3 * np.abs(bent["servicer.panel_angle"]).max()
    assert 0 < found["residual vibration"][1] < found["panel angle"][1]
    assert found["elastic energy"][1] == bent["servicer.elastic_energy"][-1]


def test_figures_have_the_coordinates_that_exist(approaches):
    _, bent = approaches
    for figure in flexible.FIGURES:
        for curve in (c for panel in figure.panels for c in panel.curves):
            values = curve.history(bent)
            assert len(values) == len(bent.time)
            assert values.any()
    angles = flexible.FIGURES[0].panels[0].curves[0].history(bent)
    assert angles.shape[1] == 2


def test_panels_and_propellant_of_the_replay_are_data(approaches):
    """Panels turn about their hinges by panel_angle, masses slide by slosh_displacement in a
    tank.
    """
    _, bent = approaches
    arrays = Arrays()
    body = next(b for b in pair(bent, arrays)["bodies"] if b["name"] == "servicer")
    turning = [link for link in body["links"] if "angle" in link]
    sliding = [link for link in body["links"] if "slide" in link]
    assert [link["at"] for link in turning] == [[0, 0.5, 0], [0, -0.5, 0]]
    assert [link["at"] for link in sliding] == [[0, 0, 0.25], [0, 0, -0.25]]
    assert [link["axis"] for link in sliding] == [[1, 0, 0], [0, 1, 0]]
    plate = turning[0]["parts"][1]
    assert np.allclose(plate["size"], [0.087, 1.4, 0.8], atol=5e-3)
    looks = [part["look"] for link in body["links"] for part in link["parts"]]
    assert looks.count("tank") == 2
    assert looks.count("fluid") == 2
