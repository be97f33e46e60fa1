# SPDX-License-Identifier: BSD-2-Clause
"""Controllers that replace each other: four of the project in both systems, and one from
outside.
"""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from harness import run
from harness.cli.showing import listed
from harness.errors import StructureError, UsageError

from ..harness.third_party_fmu import Model, build, p, u, y
from .ppc_recordings import BAND, after, range_error, settled

ROOT = Path(__file__).resolve().parents[2]
OURS = ("adaptive_controller", "ppc_controller", "pid_controller", "theta_d_controller")


@cache
def recording(system, controller, params="default"):
    return run(system, swap={"controller": controller}, params=params)


def late_errors(result, seconds):
    """Distance [m] and angle [rad] from the reference after a time; a row holds the sample before
    its plant states.
    """
    rho = (result["servicer.r_SN_N"] - result["target.r_TN_N"])[:-1]
    position = np.linalg.norm(rho - result["guidance.rho_ref_N"][1:], axis=1)
    dots = np.sum(result["servicer.q_SN"][:-1] * result["guidance.q_DN"][1:], axis=1)
    angle = 2 * np.arccos(np.clip(np.abs(dots), 0, 1))
    late = result.time[:-1] > seconds
    return position[late].max(), angle[late].max()


@pytest.mark.parametrize("controller", OURS)
@pytest.mark.parametrize("system", ["sync_approach", "ppc_tracking"])
def test_an_exchange_needs_nothing_else(system, controller, caplog):
    """The systems know with which parameters each of the four runs: nothing is dropped in silence
    or with a warning.
    """
    assert recording(system, controller).complete
    assert caplog.messages == []


def test_naming_the_controller_that_is_there_already_changes_nothing():
    for system, controller in (("sync_approach", OURS[0]), ("ppc_tracking", OURS[1])):
        assert recording(system, controller).values.tobytes() == run(system).values.tobytes()


def test_the_list_shows_for_which_controllers_there_are_parameters():
    laws = "ppc_controller,pid_controller,theta_d_controller,optimal_controller"
    assert f"  swaps       controller={laws}" in listed("sync_approach").splitlines()


def test_a_shortened_name_is_completed():
    with pytest.raises(
        UsageError, match=r"theta: there is no such FMU \(close: theta_d_controller\)"
    ):
        run("sync_approach", swap={"controller": "theta"})


# ---- the synchronised approach


@pytest.mark.parametrize("params", ["default", "manoeuvre"])
@pytest.mark.parametrize("controller", OURS[1:])
def test_each_controller_follows_the_moving_reference_of_the_synchronised_approach(
    controller, params
):
    """20 m to 4 m, attitude by wheels from 1200 s on; within 2 mm, where the adaptive controller
    stays within 34 mm. With the manoeuvre within 15 mm, where the adaptive controller stays within
    0.4 m.
    """
    result = recording("sync_approach", controller, params)
    assert late_errors(result, 600)[0] < (2e-3 if params == "default" else 15e-3)
    assert late_errors(result, 1500)[1] < np.radians(0.15)
    assert result["guidance.range"].min() > 3.98
    assert not np.any(result["controller.M_cmd_S"])
    assert np.all(result["servicer.wheel_speed"][result.time < 1200] == 0)
    for flag in ("controller.violation", "controller.violation_att"):
        assert flag not in result or not np.any(result[flag])


def test_the_adaptive_controller_retains_its_distance_under_the_manoeuvre():
    """Unknown accelerations are not in its model: 4e-4 m/s2 over K = 2e-3 1/s2 are the 0.2 m that
    it must stay off, and 0.4 m it comes to with the wrong mass."""
    result = recording("sync_approach", "adaptive_controller", "manoeuvre")
    assert 0.1 < late_errors(result, 600)[0] < 0.6
    assert result["guidance.range"].min() > 3.5


def test_the_manoeuvre_of_the_target_is_what_the_set_states():
    """Its velocity less the velocity of the default case, over 10 s: the integral of bias and
    sinusoids, in N axes.
    """
    moved, calm = (
        recording("sync_approach", OURS[0], params)["target.v_TN_N"][100]
        for params in ("manoeuvre", "default")
    )
    bias, amplitude = np.array([2.5e-4, 1.5e-4, -2e-4]), np.array([1e-4, 0.8e-4, 1e-4])
    frequency, phase = np.array([0.02, 0.015, 0.025]), np.array([0, np.pi / 2, 0])
    gained = 10 * bias + amplitude / frequency * (np.cos(phase) - np.cos(frequency * 10 + phase))
    assert moved - calm == pytest.approx(gained, rel=1e-3)


# ---- the line-of-sight approach


def test_the_adaptive_controller_runs_the_line_of_sight_approach():
    """With gains of its own for 300 m, slow adaptation, estimates limited to their ranges, and 490
    N from the propulsion.
    """
    result = recording("ppc_tracking", "adaptive_controller")
    assert settled(result, range_error(result), BAND) < 35
    assert after(result, 60, range_error(result)) < 0.05
    assert late_errors(result, 60)[1] < np.radians(0.1)
    assert np.abs(result["propulsion.F_S"]).max() == 490


# ---- a controller from outside the project

PORTS = [
    *(
        u(f"{name}[{i}]", unit)
        for name, unit in (("r_TN_N", "m"), ("v_TN_N", "m/s"), ("r_SN_N", "m"))
        for i in (1, 2, 3)
    ),
    *(u(f"v_SN_N[{i}]", "m/s") for i in (1, 2, 3)),
    *(u(f"q_SN[{i}]", "1") for i in (1, 2, 3, 4)),
    *(
        u(f"{name}[{i}]", unit)
        for name, unit in (("rho_ref_N", "m"), ("drho_ref_N", "m/s"))
        for i in (1, 2, 3)
    ),
    *(y(f"F_cmd_S[{i}]", "N") for i in (1, 2, 3)),
    *(y(f"M_cmd_S[{i}]", "N.m") for i in (1, 2, 3)),
    *(y(f"wheel_accel_cmd[{i}]", "rad/s2") for i in (1, 2, 3)),
    p("K", 10.0, "N/m"),
    p("D", 60.0, "N.s/m"),
]
UNITS = ("1", "m", "m/s", "N", "N.m", "rad/s2", "N/m", "N.s/m")
LAW = """
    double e1 = r_SN_N_1 - r_TN_N_1 - rho_ref_N_1, e2 = r_SN_N_2 - r_TN_N_2 - rho_ref_N_2;
    double e3 = r_SN_N_3 - r_TN_N_3 - rho_ref_N_3;
    double F1 = -K * e1 - D * (v_SN_N_1 - v_TN_N_1 - drho_ref_N_1);
    double F2 = -K * e2 - D * (v_SN_N_2 - v_TN_N_2 - drho_ref_N_2);
    double F3 = -K * e3 - D * (v_SN_N_3 - v_TN_N_3 - drho_ref_N_3);
    double w = q_SN_1, x = q_SN_2, y = q_SN_3, z = q_SN_4;
    F_cmd_S_1 =
        (1 - 2 * (y * y + z * z)) * F1 + 2 * (x * y + w * z) * F2 + 2 * (x * z - w * y) * F3;
    F_cmd_S_2 =
        2 * (x * y - w * z) * F1 + (1 - 2 * (x * x + z * z)) * F2 + 2 * (y * z + w * x) * F3;
    F_cmd_S_3 =
        2 * (x * z + w * y) * F1 + 2 * (y * z - w * x) * F2 + (1 - 2 * (x * x + y * y)) * F3;
"""


def test_a_controller_built_elsewhere_is_simulated(tmp_path):
    """Proportional and derivative, 0.32 rad/s on 100 kg: it lags by the acceleration of the
    reference over K/m, in ppc_tracking 20 m at 1 deg/s. Its torque stays zero."""
    mine = build(Model("mine", PORTS, outputs=LAW, units=UNITS), tmp_path)
    result = run("ppc_tracking", swap={"controller": mine})
    assert late_errors(result, 100)[0] == pytest.approx(
        20 * np.radians(1) ** 2 * 100 / 10, rel=0.02
    )
    assert not np.any(result["controller.M_cmd_S"])
    assert late_errors(run("sync_approach", swap={"controller": mine}, stop=300.0), 200)[0] < 0.05


def test_the_controller_of_the_documentation_runs_as_it_states(tmp_path):
    """docs/own_controller.md: within 4 mm, which is the acceleration of the reference over K/m."""
    page = (ROOT / "docs/own_controller.md").read_text()
    source, fmu = tmp_path / "my_controller.c", tmp_path / "my_controller.fmu"
    source.write_text(page.split("```c\n")[1].split("```")[0])
    build_fmu = ROOT / "fmus/core/build/build_fmu.py"
    subprocess.run([sys.executable, build_fmu, source, "-o", fmu], check=True)
    position, _ = late_errors(run("sync_approach", swap={"controller": fmu}), 1440)
    assert position == pytest.approx(0.004, abs=5e-4)


def test_a_controller_without_the_ports_gets_a_list_of_what_is_missing(tmp_path):
    retained = [v for v in PORTS if not v.name.startswith(("M_cmd_S", "wheel"))]
    lame = build(Model("lame", [*retained, u("beacon", "m")], outputs=LAW, units=UNITS), tmp_path)
    with pytest.raises(StructureError) as caught:
        run("sync_approach", swap={"controller": lame})
    assert list(caught.value.problems) == [
        "--swap controller=lame.fmu: its input beacon: no output of this name drives it",
        "--swap controller=lame.fmu: it has no output M_cmd_S, which propulsion.M_cmd_S needs",
        "--swap controller=lame.fmu: it has no output wheel_accel_cmd, "
        "which servicer.wheel_accel_cmd needs",
        "--swap controller=lame.fmu: its ports beacon match no signal; connect each by --map "
        "PORT=SIGNAL",
    ]
