# SPDX-License-Identifier: BSD-2-Clause
"""flexible_servicer.fmu: parameters that it rejects, each with one line, and the alarm of the
travel.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.compliance.probe import Fmu, Host, Instance

from .cases import DEEP_SPACE
from .driver import archive
from .flexible_cases import NO_PANELS, NO_SLOSH
from .rejections import rejection

START = {
    "panel_arm_S": ((0, 0.75, 0), (0, -0.75, 0), (0, 0.75, 0), (0, -0.75, 0)),
    "panel_axis_S": ((0, 0, 1),) * 4,
    "panel_inertia": ((0.43, 1.31, 1.73),) * 4,
    "slosh_axis_S": ((1, 0, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0)),
}


def row(name, k, values):
    """A matrix parameter with another row k."""
    return {name: [values if i == k - 1 else old for i, old in enumerate(START[name])]}


REJECTED = {
    "panel_mass[1] = -1": {"panel_mass": (-1, 8, 0, 0)},
    "panel_arm_S[2] = 0: must not have zero length": row("panel_arm_S", 2, (0, 0, 0)),
    "panel_axis_S[1] = 0: must not have zero length": row("panel_axis_S", 1, (0, 0, 0)),
    "panel_axis_S[1] = 1e-08: must be perpendicular to panel_arm_S": row(
        "panel_axis_S", 1, (0, 1e-8, 1)
    ),
    "panel_inertia[1] = 0: must be > 0": row("panel_inertia", 1, (0.43, 0, 1.73)),
    "panel_inertia[2] = 1.75": row("panel_inertia", 2, (0.43, 1.31, 1.75)),
    "panel_frequency[2] = -0.1: must be >= 0": {"panel_frequency": (1, -0.1, 1, 1)},
    "panel_damping_ratio[1] = 1.1: must be in [0, 1]": {"panel_damping_ratio": (1.1, 0, 0, 0)},
    "panel_damping_ratio[2] = -0.1: must be in [0, 1]": {"panel_damping_ratio": (0, -0.1, 0, 0)},
    "slosh_mass_0[2] = -1": {"slosh_mass_0": (3, -1, 0, 0)},
    "slosh_axis_S[2] = 0: must not have zero length": row("slosh_axis_S", 2, (0, 0, 0)),
    "slosh_frequency[1] = -1: must be >= 0": {"slosh_frequency": (-1, 0, 0, 0)},
    "slosh_damping_ratio[1] = 2: must be in [0, 1]": {"slosh_damping_ratio": (2, 0, 0, 0)},
    "slosh_travel[2] = -1: must be >= 0": {"slosh_travel": (0, -1, 0, 0)},
    "slosh_draw[1] = -0.1: must be >= 0": {"slosh_draw": (-0.1, 0, 0, 0)},
    "sum of slosh_draw = 1.1: must be at most 1": {"slosh_draw": (0.6, 0.5, 0, 0)},
    "mass of the hub, from mass_0, panel_mass, slosh_mass_0 = 0: must be > 0": {"mass_0": 22},
    "inertia of the hub, from J_S": {"J_S": np.diag([20, 25, 15]), "A_w": np.eye(3)},
    "inertia of the hub - A_w, from J_S": {"A_w": np.diag([180, 15, 10])},
    "substeps, from max_step, panel_frequency": {"panel_frequency": (4e3, 1, 1, 1)},
    "J_S = 400: must satisfy the triangle inequality": {"J_S": np.diag([400, 200, 150])},
    "e = 1: must be in [0, 1)": {"e": 1},
}


@pytest.mark.parametrize("message", REJECTED)
def test_a_parameter_that_breaks_a_rule_is_rejected_in_one_line(message, tmp_path):
    reported = rejection("flexible_servicer", REJECTED[message], tmp_path).partition(": ")[2]
    assert reported.startswith(message)
    assert "; " not in reported
    assert "\n" not in reported


def test_panels_that_leave_the_hub_no_inertia_are_reported_with_the_remedy(tmp_path):
    """Positive definite, but no body: the triangle inequality of I_hc."""

    def message_of(*J):
        p = {"J_S": np.diag(J), "A_w": np.eye(3)}
        return rejection("flexible_servicer", p, tmp_path / str(J[1]))

    assert message_of(50.0, 45.0, 60.0) == ""  # ppc_tracking
    reported = message_of(50.0, 90.0, 60.0)
    assert "inertia of the hub, from J_S" in reported
    assert "triangle inequality" in reported
    assert "enlarge J_S or shorten panel_hinge_S, panel_arm_S" in reported


def test_rules_of_panels_and_masses_that_do_not_exist_are_not_applied(tmp_path):
    bad = {
        "panel_arm_S": np.zeros((4, 3)),
        "panel_axis_S": np.zeros((4, 3)),
        "panel_inertia": np.zeros((4, 3)),
        "panel_frequency": -np.ones(4),
        "panel_damping_ratio": -np.ones(4),
        "slosh_axis_S": np.zeros((4, 3)),
        "slosh_frequency": -np.ones(4),
        "slosh_damping_ratio": -np.ones(4),
        "slosh_travel": -np.ones(4),
        "slosh_draw": np.full(4, 2.0),
    }
    assert rejection("flexible_servicer", NO_PANELS | NO_SLOSH | bad, tmp_path) == ""


def test_coordinates_that_do_not_exist_stay_zero(fmu):
    p = {
        "panel_angle_0": np.ones(4),
        "slosh_displacement_0": np.ones(4),
        "slosh_rate_0": np.ones(4),
    }
    unit = fmu("flexible_servicer", DEEP_SPACE | p | {"slosh_travel": np.full(4, 0.1)})
    unit.step(1)
    for name in ("panel_angle", "panel_rate", "slosh_displacement", "slosh_rate", "slosh_mass"):
        assert unit.get(name)[:2].all()
        assert not unit.get(name)[2:].any()
    assert list(unit.get("slosh_beyond_travel")) == [1, 1, 0, 0]


def test_the_motion_continues_linearly_beyond_the_travel(fmu):
    """Only the alarm shows it; 0 is no limit."""
    p = DEEP_SPACE | {"slosh_displacement_0": (0.2, -0.2, 0, 0)}
    narrow, wide = (fmu("flexible_servicer", p | {"slosh_travel": np.full(4, s)}) for s in (0.1, 0))
    assert list(narrow.get("slosh_beyond_travel")) == [1, 1, 0, 0]
    for unit in (narrow, wide):
        unit.step(3)
    assert np.array_equal(narrow.get("slosh_displacement"), wide.get("slosh_displacement"))
    assert not wide.get("slosh_beyond_travel").any()


def test_the_alarm_is_logged_when_it_comes_on(tmp_path):
    fmu, host = Fmu(archive("flexible_servicer"), tmp_path), Host()
    with Instance(fmu, host=host, logging=True) as instance:
        instance.set(
            fmu.settings(slosh_displacement_0=[0.14, 0, 0, 0], slosh_rate_0=[0.1, 0, 0, 0])
        )
        instance.enter()
        instance.ok("fmi2ExitInitializationMode")
        instance.ok("fmi2DoStep", 0.0, 0.5, 1)
    warnings = [m.text for m in host.messages if m.category == "logStatusWarning"]
    assert any("slosh_beyond_travel[1]" in text for text in warnings)
