# SPDX-License-Identifier: BSD-2-Clause
"""Common properties of ppc_controller, pid_controller and theta_d_controller, beside the laws
themselves.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from hypothesis import given, settings
from scipy.spatial.transform import Rotation

from tests.each import each

from ..reference import los
from .cases import turned
from .driver import bits
from .los_cases import ANY_INPUTS, CONTROLLERS, ZERO3, Scene, bodies, random_scene, sample
from .motion import deviation
from .theory import dcm_of_quaternion

every = pytest.mark.parametrize("name", CONTROLLERS)
FREE = {"a_max": 0, "M_max": (0, 0, 0)}
WIDE = {f"{c}.alpha_0": 1e3 for c in ("range", "elevation", "azimuth", "attitude")}
"""No start is outside this funnel."""


def free(name):
    """Parameters under which nothing is cut and no start rejected."""
    return FREE | (WIDE if name == "ppc_controller" else {})


def near(rng, **changes):
    """Small errors: no limit acts and no start is rejected."""
    return replace(random_scene(rng, error=0.02), **changes)


def test_required_ports_match_the_adaptive_controller(kind):
    """Each can take the place of any other in any approach system."""

    def ports(name):
        variables = kind(name).description.modelVariables
        command = ("F_cmd_S", "M_cmd_S", "wheel_accel_cmd")
        inputs = {(v.name, v.unit) for v in variables if v.causality == "input"}
        outputs = {
            (v.name, v.unit)
            for v in variables
            if v.causality == "output" and v.name.startswith(command)
        }
        return inputs, outputs

    assert all(ports(name) == ports("adaptive_controller") for name in CONTROLLERS)


@pytest.mark.hypothesis
@every
def test_outputs_are_finite_for_every_finite_input(kind, fmu, name):
    """After initialization nothing may end a run: not a pole, not a range of zero, not 1e308 m, not
    four zeros as attitude.

    A result that is not finite would be rejected by the FMU: fmi2Error, an exception here.
    """
    unit = fmu(name)
    unit.step(0.1)

    @settings(max_examples=6 * settings().max_examples)
    @given(ANY_INPUTS)
    def simulated(u):
        unit.step(0.1, u)
        assert all(np.all(np.isfinite(value)) for value in unit.outputs().values())

    simulated()


@every
@each("up_axis", [1, 2, 3])
@each("rho", [0.0, 1e-9, 20.0])
def test_the_pole_and_the_target_itself_are_survived(fmu, name, up_axis, rho):
    unit, up = fmu(name, {"up_axis": up_axis}), np.eye(3)[up_axis - 1]
    unit.step(0.1)
    scene = Scene(up_axis=up_axis).inputs()
    unit.step(
        0.1, scene | {"r_SN_N": scene["r_TN_N"] - rho * up, "v_SN_N": scene["v_TN_N"] + (1, 2, 3)}
    )
    assert np.all(np.isfinite(unit.get("F_cmd_S")))


@every
def test_turning_the_whole_scene_about_up_changes_no_command(fmu, rng, name):
    """Everything in N turned about Y: azimuths shift, a_L and torque stay. In deep space, where
    nothing cancels.
    """
    scene, R = (
        near(rng, r_TN_N=ZERO3, v_TN_N=ZERO3),
        Rotation.from_rotvec((0, rng.uniform(-3, 3), 0)).as_matrix(),
    )
    p = free(name) | ({"mu": 0} if name.startswith("theta") else {})
    u = scene.inputs()
    out, moved = sample(fmu(name, p), u), sample(fmu(name, p), turned(u, R))
    for port in ("a_cmd_L", "M_cmd_S", "F_cmd_S"):
        assert deviation(moved[port], out[port], 1 + np.max(np.abs(out[port]))) < 1e-9, port


@every
@pytest.mark.parametrize("up_axis", [1, 2, 3])
def test_the_force_is_the_commanded_acceleration_in_servicer_axes(fmu, rng, name, up_axis):
    scene = replace(random_scene(rng, up_axis, error=0.02))
    out = sample(fmu(name, free(name) | {"up_axis": up_axis, "force_scale": 70}), scene.inputs())
    q = scene.ref + scene.x1
    a_N = los.triad(q[1], q[2], up_axis).T @ out["a_cmd_L"]
    C_SN = dcm_of_quaternion(scene.inputs()["q_SN"])
    assert deviation(out["F_cmd_S"], 70 * C_SN @ a_N, 1 + np.max(np.abs(out["F_cmd_S"]))) < 1e-9


@every
def test_acceleration_is_cut_per_los_axis_and_torque_per_body_axis(fmu, rng, name):
    scene = random_scene(rng, error=4.0).inputs()
    wide = WIDE if name == "ppc_controller" else {}
    whole = sample(fmu(name, FREE | wide), scene)
    cut = sample(fmu(name, {"a_max": 0.5, "M_max": (3, 1, 0)} | wide), scene)
    assert deviation(cut["a_cmd_L"], np.clip(whole["a_cmd_L"], -0.5, 0.5)) < 1e-12
    assert np.array_equal(cut["a_saturated"], np.abs(whole["a_cmd_L"]) > 0.5)
    limit = np.array((3, 1, np.inf))
    assert deviation(cut["M_cmd_S"], np.clip(whole["M_cmd_S"], -limit, limit)) < 1e-12
    assert np.array_equal(cut["M_saturated"], np.abs(whole["M_cmd_S"]) > limit)


@every
def test_published_errors_match_the_scene(fmu, rng, name):
    scene = near(rng)
    out = sample(fmu(name), scene.inputs())
    assert deviation(out["error"], scene.x1) < 3e-9  # positions of 7e6 m
    assert deviation(out["derror"], scene.x2) < 1e-9
    half = np.linalg.norm(scene.turn) / 2
    axis = np.sin(half) * scene.turn / np.linalg.norm(scene.turn)
    assert deviation(out["q_SD"], (np.cos(half), *axis)) < 1e-12
    C_SD = Rotation.from_rotvec(-scene.turn).as_matrix()
    assert deviation(out["domega_S"], scene.omega - C_SD @ scene.omega_D) < 1e-12


@every
def test_the_azimuth_error_takes_the_short_way(fmu, name):
    """From -179 to 179 deg it is -2 deg."""
    scene = Scene(
        ref=np.array((100.0, 0.1, np.radians(-179.0))), x1=np.array((0.0, 0.0, np.radians(358.0)))
    )
    assert abs(sample(fmu(name), scene.inputs())["error"][2] - np.radians(-2.0)) < 1e-10


@every
def test_both_signs_of_a_quaternion_are_the_same_attitude(fmu, rng, name):
    u = near(rng).inputs()
    plus, minus = fmu(name), fmu(name)
    plus.step(0.1, u)
    minus.step(0.1, u | {"q_SN": -u["q_SN"], "q_DN": -u["q_DN"]})
    assert bits(plus) == bits(minus)


@pytest.mark.verifies("C.5-4")
@every
def test_attitude_control_rests_before_t_att(fmu, rng, name):
    u = near(rng).inputs()
    resting, active = sample(fmu(name, {"t_att": 5.0}), u), sample(fmu(name), u)
    assert np.array_equal(resting["M_cmd_S"], ZERO3)
    assert np.array_equal(resting["F_cmd_S"], active["F_cmd_S"])
    assert np.any(active["M_cmd_S"])
    awake = fmu(name, {"t_att": 5.0}, u, 4.9)
    awake.step(0.1, u)
    assert np.array_equal(awake.get("M_cmd_S"), ZERO3)
    awake.step(0.1)
    assert np.any(awake.get("M_cmd_S"))


@every
def test_wheels_give_the_torque_that_thrusters_would(fmu, rng, name):
    """Opposite rate of the wheel momentum; nothing is left for the thrusters."""
    u, A = near(rng).inputs(), 7.0
    inertia = {"A_hat": A * np.eye(3)} if name.startswith("theta") else {"wheel_scale": A}
    thrusters = sample(fmu(name, inertia), u)
    wheels = sample(fmu(name, inertia | {"use_wheels": 1}), u)
    assert deviation(-A * wheels["wheel_accel_cmd"], thrusters["M_cmd_S"]) < 1e-12
    assert np.array_equal(wheels["M_cmd_S"], ZERO3)
    assert np.array_equal(thrusters["wheel_accel_cmd"], ZERO3)


@every
def test_the_command_is_held_between_the_sample_instants(fmu, rng, name):
    unit = fmu(name, {"sample_period": 0.3})
    unit.step(0.1, near(rng).inputs())
    held = bits(unit)
    for _ in range(2):
        unit.step(0.1, near(rng).inputs())
        assert bits(unit) == held
    unit.step(0.1)
    assert bits(unit) != held


def on_the_reference(scene):
    """The same reference with the servicer on it."""
    C_ND = dcm_of_quaternion(scene.q_DN).T
    return replace(
        scene, x1=np.zeros(3), x2=np.zeros(3), turn=np.zeros(3), omega=scene.omega_D
    ), C_ND


@pytest.mark.parametrize("name", CONTROLLERS[:2])
def test_without_errors_the_laws_without_model_command_nothing(fmu, rng, name):
    """1e-6 m/s2 and N.m are what 1e-9 m and rad/s of input rounding become."""
    scene, _ = on_the_reference(random_scene(rng))
    out = sample(fmu(name), scene.inputs())
    assert deviation(out["a_cmd_L"], 0) < 1e-6
    assert deviation(out["M_cmd_S"], 0) < 1e-6


@pytest.mark.verifies("C.5-10")
@pytest.mark.parametrize("rho", [100.0, 3e6])
def test_without_errors_theta_d_commands_the_motion_of_the_reference(fmu, rng, rho):
    """The force makes the servicer accelerate as the reference does, the torque turns J_hat as D
    turns. At 3000 km all terms of differential gravity count."""
    any_scene = random_scene(rng)
    scene, C_ND = on_the_reference(replace(any_scene, ref=any_scene.ref * (0, 1, 1) + (rho, 0, 0)))
    u, J = scene.inputs(), np.diag((50.0, 45.0, 60.0))
    mu = los.Guidance().mu
    out = sample(fmu("theta_d_controller", FREE), u)
    T, S = bodies(u)
    gravity = mu * (T.r / np.linalg.norm(T.r) ** 3 - S.r / np.linalg.norm(S.r) ** 3)
    assert deviation(out["F_cmd_S"], 100 * C_ND.T @ (u["ddrho_ref_N"] - gravity), rho / 100) < 1e-5
    w = scene.omega_D
    assert deviation(out["M_cmd_S"], J @ scene.alpha_D + np.cross(w, J @ w)) < 1e-8


@pytest.mark.verifies("C.5-6")
@every
@each("p", [{"up_axis": 4}, {"force_scale": 0}, {"a_max": -1}, {"sample_period": -1}])
def test_impossible_parameters_are_rejected(fmu, name, p):
    with pytest.raises(FMICallException):
        fmu(name, p)
