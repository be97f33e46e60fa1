# SPDX-License-Identifier: BSD-2-Clause
"""ppc_controller.fmu: the funnel, the mapping, the three laws, rejections, what it must not
know.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.each import each

from ..reference import ppc
from .cases import random_bodies
from .driver import bits
from .los_cases import Scene, bodies, gathered, random_scene, reference_of, sample
from .motion import deviation

FREE = {"a_max": 0, "M_max": (0, 0, 0)}
RANGE, ANGLE, ATTITUDE = ppc.Ppc.range, ppc.Ppc.elevation, ppc.Ppc.attitude
CHANNELS = (RANGE, ANGLE, ANGLE)


def scene_of(z):
    """A scene with generalised position state z, entirely in the errors."""
    return Scene(x1=np.array(z))


def commanded(fmu, z, p=None):
    """Generalised control u for z at the moment of activation; a_L = Sigma u."""
    out = sample(fmu("ppc_controller", FREE | (p or {})), scene_of(z).inputs())
    return np.array((-1, -1, 1)) * out["a_cmd_L"], out


def settings(**channels):
    """Constants of channels by name: settings(range={"k": 2})."""
    return {
        f"{channel}.{name}": value
        for channel, table in channels.items()
        for name, value in table.items()
    }


def test_without_control_of_the_position_only_the_attitude_is_commanded(fmu, rng):
    """Outside the funnel of the range too: nothing is rejected and no flag is set."""
    near, far = random_scene(rng, error=0.02), scene_of((1e4, 0, 0))
    full = sample(fmu("ppc_controller", FREE), near.inputs())
    half = sample(fmu("ppc_controller", FREE | {"position": 0}), near.inputs())
    attitude = ("M_cmd_S", "z_att", "alpha_att", "theta_att", "kappa_att", "start_margin_att")
    for name in attitude:
        assert np.array_equal(full[name], half[name]), name
    assert np.any(full["F_cmd_S"]) and np.any(half["M_cmd_S"])
    for scene in (near, far):
        out = sample(fmu("ppc_controller", FREE | {"position": 0}), scene.inputs())
        assert not np.any([out["F_cmd_S"], out["a_cmd_L"]])
        assert (out["violation"], out["start_margin"]) == (0, 1)
    with pytest.raises(FMICallException):
        sample(fmu("ppc_controller", FREE), far.inputs())


# ---- against the reference ----


@pytest.mark.parametrize("law", [0, 1, 2])
@pytest.mark.parametrize("up_axis", [1, 2, 3])
def test_outputs_match_the_reference_over_three_samples(fmu, rng, law, up_axis):
    """Funnels begin at 2 s (position), 2.1 s (attitude) and shrink; 1e-7 relative: 1e-9 m of
    rounding by gains.
    """
    p = replace(
        ppc.Ppc(),
        law=law,
        law_att=law,
        up_axis=up_axis,
        t_att=2.1,
        wheel_scale=7.0,
        force_scale=80.0,
    )
    p = replace(
        p,
        range=replace(RANGE, delta=0.7),
        azimuth=replace(ANGLE, delta=0.6),
        attitude=replace(ATTITUDE, delta=0.9),
    )
    p = replace(p, use_wheels=rng.integers(2))
    unit, x = fmu("ppc_controller", ppc.settings(p), None, 2.0), (None, None)
    for k in range(3):
        u = random_scene(rng, up_axis, error=0.5).inputs()
        expected, x = ppc.ppc(2.0 + 0.1 * k, *bodies(u), reference_of(u), x, p)
        out = sample(unit, u)
        for name, value in expected.items():
            if name != "violation_att" or k > 0:  # not checked before t_att
                assert deviation(out[name], value, 1 + np.max(np.abs(value))) < 1e-7, (k, name)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("rising", [1, -1])
def test_outside_the_funnel_the_command_matches_a_thousandth_inside(fmu, rising, side):
    """On both sides of funnels that began on either side of zero."""
    narrow = {"elevation": replace(ANGLE, delta=0.6), "azimuth": replace(ANGLE, delta=0.8)}
    p = replace(ppc.Ppc(), a_max=0.0, M_max=(0.0,) * 3, **narrow)
    unit, x = fmu("ppc_controller", ppc.settings(p)), (None, None)
    for k, z in enumerate([(0, 0.1 * rising, 0.2 * rising), (0, 1.0 * side, 1.2 * side)]):
        u = scene_of(z).inputs()
        expected, x = ppc.ppc(0.1 * k, *bodies(u), reference_of(u), x, p)
        out = sample(unit, u)
    assert out["violation"] == 1
    assert out["a_cmd_L"] == pytest.approx(expected["a_cmd_L"], rel=1e-7)


# ---- funnel and mapping ----


def test_the_bound_shrinks_exponentially_from_the_first_sample_on(fmu):
    unit = fmu("ppc_controller", None, Scene().inputs(), 7.0)
    for k in range(5):
        unit.step(0.5)
        expected = [
            (c.alpha_0 - c.alpha_inf) * np.exp(-c.beta * 0.5 * k) + c.alpha_inf for c in CHANNELS
        ]
        assert deviation(gathered(unit.outputs())["alpha"], expected, 600) < 1e-14


@pytest.mark.verifies("C.4-3")
@pytest.mark.parametrize(("sign", "low", "high"), [(1, -0.5, 1.0), (-1, -1.0, 0.5)])
def test_the_side_of_the_narrow_bound_is_decided_once_by_the_start(fmu, sign, low, high):
    """delta = 0.5: the side away from the start is half as wide, also later. States in the rate: no
    range < 0.
    """
    unit = fmu("ppc_controller", settings(range={"delta": 0.5, "eta": 0.01}))

    def at(theta):
        rate = np.array((theta * RANGE.alpha_0 / RANGE.lambda_, 0, 0))
        return sample(unit, Scene(x2=rate).inputs(), 1e-9)

    at(0.1 * sign)
    for bound in (low, high):
        assert abs(at(0.99 * bound)["theta"][0] - 0.99 * bound) < 1e-6
        assert at(0.99 * bound)["violation"] == 0
        assert at(1.01 * bound)["violation"] == 1


def test_mapping_is_increasing_and_inverts(fmu):
    """theta = (U e^s + L)/(1 + e^s), ds/dz >= 4/((U - L) alpha)."""
    unit = fmu("ppc_controller", settings(elevation={"delta": 0.8}))
    rows = [sample(unit, scene_of((0, z, 0)).inputs(), 1e-9) for z in np.linspace(0.01, 0.79, 60)]
    theta, s = (np.array([row[name][1] for row in rows]) for name in ("theta", "s"))
    assert deviation((np.exp(s) - 0.8) / (1 + np.exp(s)), theta) < 1e-12
    assert np.all(np.diff(s) > 0)
    assert np.all(np.diff(s) / np.diff(theta) >= 4 / 1.8)


def test_kappa_is_the_weighted_square_of_the_mapped_state(fmu, rng):
    weights = {"range": {"eta": 0.2}, "elevation": {"eta": 0.3}, "azimuth": {"eta": 0.1}}
    out = sample(fmu("ppc_controller", settings(**weights)), random_scene(rng, error=0.5).inputs())
    assert abs(out["kappa"] - (0.2, 0.3, 0.1) @ out["s"] ** 2) < 1e-14
    assert abs(out["kappa_att"] - 0.1 * out["s_att"] @ out["s_att"]) < 1e-14


# ---- laws ----


@pytest.mark.parametrize("law", [1, 2])
@pytest.mark.parametrize("age", [0.0, 30.0])
def test_small_signal_gain_is_k_eta_for_any_bound(fmu, law, age):
    """Linear up to (z/alpha)^2 < 1e-8 and 1e-14 m of rounding in z."""
    unit = fmu(
        "ppc_controller",
        FREE | {"law": law, "law_att": law, "sample_period": 30.0},
        Scene().inputs(),
    )
    unit.step(age + 1.0)
    z = np.array((1e-4, 1e-6, 1e-6))
    out = sample(unit, scene_of(z).inputs(), 30.0)
    u = np.array((-1, -1, 1)) * out["a_cmd_L"]
    assert deviation(u / z, -np.array([c.k * c.eta for c in CHANNELS]), 30) < 1e-6


def test_small_signal_gain_of_the_literal_law_grows_as_the_bound_shrinks(fmu):
    """16 k eta/((U - L)^2 alpha^2)."""
    for delta in (1.0, 0.5):
        middle = (1 - delta) / 2 * 2.0  # between the bounds -delta and 1 times alpha_0
        literal = {"law": 0} | settings(range={"delta": delta, "alpha_0": 2.0})
        u, _ = commanded(fmu, (middle + 1e-3, 0, 0), literal)
        gain = 16 * RANGE.k * RANGE.eta / ((1 + delta) ** 2 * 2.0**2)
        assert abs(u[0] / (-gain * 1e-3) - 1) < 1e-6


@pytest.mark.parametrize("law", [0, 1, 2])
def test_the_command_is_odd_when_both_sides_are_alike(fmu, rng, law):
    z = rng.uniform(-1, 1, 3) * (50, 0.4, 0.4)
    (up, out), (down, _) = (commanded(fmu, sign * z, {"law": law}) for sign in (1, -1))
    assert deviation(up, -down, 1 + np.max(np.abs(up))) < 1e-12
    assert out["violation"] == 0


@pytest.mark.parametrize("law", [0, 2])
def test_the_command_grows_towards_the_bound_and_the_barrier_multiplies_it(fmu, law):
    """Against the same law without 1/(1 - kappa), from the published s and kappa."""
    previous = 0.0
    for z in np.linspace(0.05, 0.7, 14):
        u, out = commanded(fmu, (0, z, 0), {"law": law})
        theta, alpha, s, kappa = out["theta"][1], out["alpha"][1], out["s"][1], out["kappa"]
        r = 2 / ((1 - theta**2) * alpha)
        scale = r if law == 0 else (alpha / 2) ** 2 * r
        assert abs(u[1] * (1 - kappa) / (-ANGLE.k * ANGLE.eta * scale * s) - 1) < 1e-12
        assert -u[1] > previous
        previous = -u[1]
    assert kappa > 0.3


@pytest.mark.verifies("C.4-1")
def test_the_law_stays_finite_far_outside_and_points_back_inside(fmu):
    unit = fmu("ppc_controller", FREE, Scene().inputs())
    unit.step(0.1)
    for sign in (1, -1):
        out = sample(unit, scene_of((0, sign * 1.0, 0)).inputs())
        assert out["violation"] == 1
        assert np.isfinite(out["a_cmd_L"][1])
        assert sign * out["a_cmd_L"][1] > 0  # a_L = -u: the servicer follows the target
    assert sample(unit, Scene().inputs())["violation"] == 0


@pytest.mark.verifies("C.4-1")
@given(st.tuples(*[st.floats(-1e6, 1e6)] * 6))
def test_every_generalised_state_gives_a_bounded_command(kind, simulated, state):
    """Clamps of theta and kappa bound every channel: k eta p s/(1 - kappa) at theta = 0.998, kappa
    = 0.98.
    """
    out = sample(
        simulated, Scene(x1=np.array((abs(state[0]), 0, 0)), x2=np.array(state[3:])).inputs(), 1e-9
    )
    s = np.log(0.999 / 0.001)
    for i, c in enumerate(CHANNELS):
        r = 1 / (2 * 0.999 * 0.001 * c.alpha_0)
        assert abs(out["a_cmd_L"][i]) <= 1.001 * c.k * c.eta * (c.alpha_0 / 2) ** 2 * r * s / 0.02


@pytest.fixture
def simulated(fmu):
    unit = fmu("ppc_controller", FREE, Scene().inputs())
    unit.step(1e-9)
    return unit


def test_attitude_torque_carries_the_transpose_of_the_kinematics(fmu, rng):
    """M = T' u, so that the power of the proof, (R Q s)' T J^-1 T' (R Q s), is positive: with z
    along x1 it is -k eta z to first order and without the transpose the parts normal to q_vec would
    turn the wrong way."""
    turn = 1.2 * np.array((0.6, -0.8, 0.0))
    z_rate = np.array((0.1, 0.2, 0.3))
    out = sample(fmu("ppc_controller", FREE), Scene(turn=turn, omega=z_rate).inputs())
    q0, v = out["q_SD"][0], out["q_SD"][1:]
    s, alpha = out["s_att"], ATTITUDE.alpha_0
    r = 2 / ((1 - out["theta_att"] ** 2) * alpha)
    u = -ATTITUDE.k * ATTITUDE.eta * (alpha / 2) ** 2 * r * s / (1 - out["kappa_att"])
    assert deviation(out["M_cmd_S"], q0 * u - np.cross(v, u), np.max(np.abs(u))) < 1e-12
    assert deviation(out["M_cmd_S"], q0 * u + np.cross(v, u), np.max(np.abs(u))) > 0.1
    T = q0 * np.eye(3) + np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    z = v + ATTITUDE.lambda_ / 2 * T @ z_rate
    assert deviation(out["z_att"], z) < 1e-12


def test_the_attitude_error_vector_falls_at_the_rate_that_z_states(fmu, rng):
    """x2 = T w/2 is the derivative of x1 = q_vec: two scenes 1 ms apart."""
    w, turn = 0.3 * rng.normal(size=3), rng.normal(size=3)
    first = sample(fmu("ppc_controller"), Scene(turn=turn, omega=w).inputs())
    rate = (first["z_att"] - first["q_SD"][1:]) / ATTITUDE.lambda_

    def moved(t):
        return (Rotation.from_rotvec(turn) * Rotation.from_rotvec(w * t)).as_quat()[:3]

    sign = np.sign(moved(0.0) @ first["q_SD"][1:])
    assert deviation((moved(1e-4) - moved(-1e-4)) / 2e-4, sign * rate) < 1e-8


# ---- model-free ----


def test_it_has_no_parameter_of_mass_inertia_or_gravity(kind):
    """Apart from the two scales that turn a command into newton and rad/s2."""
    variables = kind("ppc_controller").description.modelVariables
    heavy = {
        v.name
        for v in variables
        if v.causality == "parameter" and ("kg" in (v.unit or "") or v.unit == "m3/s2")
    }
    assert heavy == {"force_scale", "wheel_scale"}


@pytest.mark.verifies("C.4-5")
def test_commands_do_not_change_by_a_bit_with_what_guidance_believes_of_target_mass_and_gravity(
    fmu, rng
):
    """The references that reach the laws without model depend on geometry and rates only."""
    u = random_bodies(rng, distance=60.0) | {"F_cmd_S": 50 * rng.normal(size=3)}
    beliefs = ({}, {"mu": 0}, {"J_T": np.diag((300, 200, 400))}, {"force_scale": 500})
    commands = set()
    for p in beliefs:
        guidance = fmu("los_guidance", p)
        guidance.step(0.1, u)
        ref = {
            name: guidance.get(name) for name in ("rho_ref_N", "drho_ref_N", "ddrho_ref_N", "q_DN")
        }
        ref |= {name: guidance.get(name) for name in ("omega_DN_D", "alpha_DN_D")}
        wide = settings(
            **{c: {"alpha_0": 1e3} for c in ("range", "elevation", "azimuth", "attitude")}
        )
        bodies_only = {name: value for name, value in u.items() if name != "F_cmd_S"}
        unit = fmu("ppc_controller", wide)
        unit.step(0.1, bodies_only | ref | {"wheel_speed": (0, 0, 0)})
        commands.add(bits(unit))
    assert len(commands) == 1


# ---- rejections ----

REJECTED_STARTS = {
    "outside the funnel": ((0, 0.9, 0), {}),
    "outside the narrow side": ((-5.0, 0, 0), settings(range={"alpha_0": 4.0})),
    "inside, but kappa >= 1": ((0, 0.6, 0), settings(elevation={"eta": 0.6})),
    "so near the bound that kappa >= 1": (
        (40.0, 0, 0),
        settings(range={"alpha_0": 40 / (1 - 1e-6), "eta": 0.01}),
    ),
}


@pytest.mark.verifies("C.4-2")
@pytest.mark.parametrize(("z", "p"), REJECTED_STARTS.values(), ids=REJECTED_STARTS)
def test_a_start_without_the_guarantee_is_rejected_in_the_first_step(fmu, z, p):
    """Not before: while start values propagate the first inputs may be anything."""
    unit = fmu("ppc_controller", p, scene_of(z).inputs())
    assert np.all(np.isfinite(unit.get("F_cmd_S")))
    with pytest.raises(FMICallException):
        unit.step(0.1)


@pytest.mark.verifies("C.4-2")
def test_a_start_is_checked_with_the_unclamped_kappa(fmu):
    """theta = 1 - 1e-6: s = 14.5, kappa = 0.84 with eta = 0.004; the law itself never sees more
    than s = 6.9.
    """
    near = settings(range={"alpha_0": 40 / (1 - 1e-6), "eta": 0.004})
    out = sample(
        fmu("ppc_controller", near, scene_of((40.0, 0, 0)).inputs()),
        scene_of((40.0, 0, 0)).inputs(),
    )
    assert out["start_margin"] == pytest.approx(1e-6, rel=1e-3)
    assert out["kappa"] == pytest.approx(0.004 * np.log(999) ** 2, rel=1e-6)


@pytest.mark.verifies("C.4-4")
def test_the_attitude_is_checked_when_its_control_begins(fmu):
    tumbling = Scene(omega=np.array((3.0, 0, 0))).inputs()
    unit = fmu("ppc_controller", {"t_att": 1.0}, tumbling)
    for _ in range(2):
        unit.step(0.5)
    assert unit.get("violation_att") == 0
    with pytest.raises(FMICallException):
        unit.step(0.5)


@pytest.mark.verifies("C.4-6")
def test_a_good_start_is_accepted_and_a_later_violation_is_flagged_only(fmu):
    unit = fmu("ppc_controller")
    assert sample(unit, Scene().inputs())["start_margin"] > 0
    assert sample(unit, scene_of((0, 0.9, 0)).inputs())["violation"] == 1
    tumbling = sample(unit, Scene(omega=np.array((3.0, 0, 0))).inputs())
    assert tumbling["violation_att"] == 1
    assert tumbling["violation"] == 0


@pytest.mark.verifies("C.4-7")
@each(
    "p",
    [
        settings(range={"lambda": 5.0}),  # lambda beta = 1
        settings(attitude={"beta": 0.7}),  # lambda beta = 1.05
        settings(elevation={"delta": 0.0}),
        settings(elevation={"delta": 1.01}),
        settings(azimuth={"eta": 0.0}),
        settings(azimuth={"eta": -0.1}),
        settings(range={"k": 0.0}),
        settings(range={"alpha_inf": 0.0}),
        settings(range={"alpha_inf": 601.0}),
        {"law": 3},
        {"law_att": 0.5},
        {"wheel_scale": 0},
    ],
)
def test_parameters_outside_the_theory_are_rejected(fmu, p):
    with pytest.raises(FMICallException):
        fmu("ppc_controller", p)
