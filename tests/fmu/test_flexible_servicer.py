# SPDX-License-Identifier: BSD-2-Clause
"""flexible_servicer.fmu against theory: Lagrange's equations, conservation laws, modes, symmetry,
impulse, the frozen phase, tides.
"""

from __future__ import annotations

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy.integrate import simpson

from ..reference import flexible_servicer as reference
from ..reference.servicer import Input
from .cases import DEEP_SPACE, ELEMENTS, random_wave
from .driver import bits
from .flexible_cases import (
    DEFAULT,
    FULL,
    NO_PANELS,
    NO_SLOSH,
    SMALL_PLANET,
    UNDAMPED,
    random_parts,
    random_vehicle,
)
from .motion import deviation
from .test_servicer import commands, everything
from .theory import EARTH, MU, dcm_of_mrp

PANEL = {"mu": 8.0, "d": 0.75, "I2": 1.31, "I_h": 1.31 + 8 * 0.75**2, "lever": 1.25, "w": np.pi / 2}


def attitude(unit):
    return dcm_of_mrp(unit.get("sigma_SN"))


# ---- the servicer that it is ----


def test_without_panels_and_slosh_every_output_matches_the_servicer(fmu, rng):
    """The same expressions, so the same bits."""
    p = everything(rng) | {"use_gravity_gradient": 1, "t_att": 4.0, "wheel_accel_max": 0.02}
    p |= {"velocity_follows_attitude": rng.integers(2)}
    u = commands(rng)
    rigid, flexible = fmu("servicer", p, u), fmu("flexible_servicer", p | NO_PANELS | NO_SLOSH, u)
    for _ in range(20):
        rigid.step(1)
        flexible.step(1)
        for name, value in rigid.outputs().items():
            assert np.array_equal(flexible.get(name), value), name
    assert deviation(flexible.get("r_CN_N"), rigid.get("r_SN_N")) == 0
    assert deviation(flexible.get("v_CN_N"), rigid.get("v_SN_N")) == 0
    assert not flexible.get("r_CS_S").any()
    assert not flexible.get("elastic_energy")


# ---- equations of motion ----


@pytest.mark.parametrize("t_att", [0.0, 5.0])
@pytest.mark.parametrize("tides", [0, 1])
def test_equations_of_motion_match_lagrange(fmu, rng, t_att, tides):
    """One step of the same Runge-Kutta, four panels and four slosh masses, free and held, with all
    loads: rounding only. The small planet makes tides as strong as springs.
    """
    p = random_vehicle(rng) | {"t_att": t_att, "max_step": 0.02}
    p |= {"use_gravity_gradient": tides} | (SMALL_PLANET if tides else {})
    u = commands(rng) | {"M_S": rng.normal(size=3)}
    q, unit = reference.Parameters(**p), fmu("flexible_servicer", p, u)
    y = reference.initial_state(q)
    for t in (0.0, 0.02):
        for name, expected in reference.outputs(t, y, q).items():
            scale = max(1.0, np.abs(expected).max())
            assert deviation(unit.get(name), expected, scale) < 1e-12, name
        unit.step(0.02)
        y = reference.step(q, y, t, 0.02, Input(**u))


def test_disturbances_of_torque_and_acceleration_act_as_on_a_rigid_body(fmu, rng):
    """On a free vehicle the disturbance acceleration moves everything alike, also in Hill axes."""
    p = random_vehicle(rng) | EARTH | {"r_0_N": (7e6, 1e5, 0), "v_0_N": (0, 5e3, 5e3)}
    p |= {"max_step": 0.02, "M_dist_S": random_wave(rng, 1), "use_J2": 0}
    wave = random_wave(rng, 1.0)
    still, moved = (
        fmu("flexible_servicer", p | {"a_dist": a, "a_dist_axes": 1}) for a in (wave, {})
    )
    calm = fmu("flexible_servicer", p | {"M_dist_S": {}})
    for unit in (still, moved, calm):
        unit.step(3)
    for name in ("omega_SN_S", "panel_angle", "slosh_rate", "r_CS_S"):
        assert deviation(still.get(name), moved.get(name)) < 1e-12, name
    assert deviation(still.get("v_CN_N"), moved.get("v_CN_N")) > 0.1
    assert deviation(calm.get("omega_SN_S"), moved.get("omega_SN_S")) > 1e-4


# ---- conservation ----


def free_motion(fmu, rng, max_step, extra, duration=60.0):
    """A tumbling vehicle with everything moving and nothing acting, and its outputs at the end."""
    p = random_vehicle(rng, 0.1) | {"wheel_speed_0": (0.3, -0.2, 0.1)} | extra
    unit = fmu("flexible_servicer", p | {"max_step": max_step, "slosh_draw": np.zeros(4)})
    first = unit.outputs()
    unit.step(duration)
    return first, unit.outputs()


def energy(outputs):
    names = ("kinetic_energy", "elastic_energy", "dissipated_energy")
    return sum(outputs[name] for name in names)


@pytest.mark.parametrize("extra", [UNDAMPED, {}], ids=["undamped", "damped"])
def test_momentum_and_energy_of_the_free_vehicle_are_conserved(fmu, rng, extra):
    slow = {"panel_frequency": np.full(4, 1.0), "slosh_frequency": np.full(4, 1.0)}
    first, last = free_motion(fmu, rng, 0.05, extra | slow)
    size = np.linalg.norm(first["h_N"])
    assert deviation(last["h_N"], first["h_N"], size) < 1e-8
    assert deviation(energy(last), energy(first), energy(first)) < 1e-6
    assert deviation(last["v_CN_N"], first["v_CN_N"]) < 1e-8
    assert bool(last["dissipated_energy"]) == (extra is not UNDAMPED)


def test_integration_error_is_of_fourth_order(fmu):
    """n of the sub-steps is 1 throughout."""

    def result(max_step):
        slow = {"panel_frequency": np.full(4, 1.0), "slosh_frequency": np.full(4, 1.0)}
        last = free_motion(fmu, np.random.default_rng(1), max_step, UNDAMPED | slow, 20.0)[1]
        names = ("omega_SN_S", "panel_angle", "slosh_displacement", "r_SN_N")
        return np.concatenate([last[name] for name in names])

    coarse, middle, fine = (result(h) for h in (0.1, 0.05, 0.025))
    ratio = np.linalg.norm(coarse - middle) / np.linalg.norm(middle - fine)
    assert 15 < ratio < 17


def test_the_centre_of_mass_follows_the_orbit_of_the_rigid_servicer_for_any_motion_inside(
    fmu,
):
    p = EARTH | ELEMENTS | {"max_step": 0.05, "use_J2": 1, "omega_SN_S_0": (1e-3, 2e-3, -1e-3)}
    swinging = {"panel_angle_0": (0.3, -0.1, 0, 0), "slosh_displacement_0": (0.1, -0.05, 0, 0)}
    flexible = fmu("flexible_servicer", p | swinging | UNDAMPED)
    start = {"a": 0, "r_0_N": flexible.get("r_CN_N"), "v_0_N": flexible.get("v_CN_N")}
    rigid = fmu("servicer", p | start)
    for unit in (flexible, rigid):
        unit.step(5800)
    assert deviation(flexible.get("r_CN_N"), rigid.get("r_SN_N")) < 1e-4
    assert deviation(flexible.get("r_SN_N"), rigid.get("r_SN_N")) > 1e-3
    assert np.abs(flexible.get("panel_angle")).max() > 0.05


# ---- modes ----


def test_a_step_of_torque_excites_the_antisymmetric_mode_of_the_closed_form(fmu):
    """th = -c M/(J I_h w^2) (1 - cos w_f t), c = I2 + mu d l, w_f^2 = w^2/(1 - 2 c^2/(J I_h)).
    Linear to th^2, Runge-Kutta to (w h)^5/120 a step.
    """
    c, J, M, w = PANEL["I2"] + PANEL["mu"] * PANEL["d"] * PANEL["lever"], 150.0, 1e-5, PANEL["w"]
    unit = fmu("flexible_servicer", DEEP_SPACE | NO_SLOSH | UNDAMPED | {"max_step": 0.01})
    unit.set({"M_S": (0, 0, M)})
    t, angle = unit.history(0.1, 100, "panel_angle")
    share = 2 * c**2 / (J * PANEL["I_h"])
    size = c * M / (J * PANEL["I_h"] * w**2)
    expected = -size * (1 - np.cos(w / np.sqrt(1 - share) * t))
    assert deviation(angle[:, 0], expected, size) < 1e-6
    assert deviation(angle[:, 1], expected, size) < 1e-6


@pytest.mark.parametrize(
    ("start", "coupling"),
    [
        ((1e-4, 1e-4, 0, 0), (PANEL["I2"] + PANEL["mu"] * PANEL["d"] * PANEL["lever"]) ** 2 / 150),
        ((1e-4, -1e-4, 0, 0), (PANEL["mu"] * PANEL["d"]) ** 2 / 100),
    ],
    ids=["antisymmetric", "symmetric"],
)
def test_a_free_pair_of_panels_decays_with_its_damping_ratio(fmu, start, coupling):
    """z w_f/w: successive maxima of the free mode, from its complex exponential."""
    w_f = PANEL["w"] / np.sqrt(1 - 2 * coupling / PANEL["I_h"])
    z = 0.02
    p = {"panel_damping_ratio": np.full(4, z), "max_step": 0.01, "panel_angle_0": start}
    unit = fmu("flexible_servicer", DEEP_SPACE | NO_SLOSH | p)
    _, angle = unit.history(0.05, 400, "panel_angle")
    # angle(k+2) = a angle(k+1) + b angle(k), the roots are exp((-z +- i) w h)
    a, b = np.linalg.lstsq(np.column_stack((angle[1:-1, 0], angle[:-2, 0])), angle[2:, 0])[0]
    root = np.log(np.roots([1, -a, -b])[0]) / 0.05
    assert deviation(np.abs(root), w_f, w_f) < 1e-6
    assert deviation(-root.real / np.abs(root), z * w_f / PANEL["w"], z) < 1e-3


# ---- symmetry ----


def test_panels_that_swing_symmetrically_never_turn_the_hub(fmu):
    p = DEEP_SPACE | NO_SLOSH | {"panel_angle_0": (0.4, -0.4, 0, 0)}
    unit = fmu("flexible_servicer", p)
    _, omega, angle = unit.history(0.1, 200, "omega_SN_S", "panel_angle")
    assert deviation(omega, 0) < 1e-15
    assert angle[:, 0].min() < -0.3


def test_a_slosh_mass_on_the_line_of_the_force_never_turns_the_hub(fmu):
    slosh = {"slosh_mass_0": (3, 0, 0, 0), "slosh_position_S": ((0.2, 0, 0), *np.zeros((3, 3)))}
    unit = fmu("flexible_servicer", DEEP_SPACE | NO_PANELS | slosh, {"F_S": (5, 0, 0)})
    _, omega, displacement = unit.history(0.1, 200, "omega_SN_S", "slosh_displacement")
    assert not omega.any()
    assert displacement[:, 0].min() < -0.1


def test_a_slosh_mass_beside_the_line_of_the_force_turns_the_hub_against_its_own_momentum(fmu):
    """It stays behind, r x m v along -y, so the hub turns about +y while h_N is still zero."""
    unit = fmu("flexible_servicer", DEEP_SPACE | NO_PANELS, {"F_S": (5, 0, 0)})
    unit.step(0.5)
    assert unit.get("slosh_displacement")[0] < 0
    assert unit.get("omega_SN_S")[1] > 1e-6
    assert np.linalg.norm(unit.get("h_N")) < 1e-2 * 250 * unit.get("omega_SN_S")[1]


# ---- loads ----


def test_angular_impulse_matches_moment_and_force_about_the_centre_of_mass(fmu, rng):
    """dh_N/dt = C_NS (M - c x F), by Simpson's rule on 0.01 s: (w h)^4/180."""
    p = random_vehicle(rng, 0.1) | {"max_step": 0.005, "slosh_draw": np.zeros(4)}
    F, M = 5 * rng.normal(size=3), rng.normal(size=3)
    unit = fmu("flexible_servicer", p, {"F_S": F, "M_S": M, "wheel_accel_cmd": (0.1, -0.2, 0.1)})
    _, h, sigma, c = unit.history(0.01, 400, "h_N", "sigma_SN", "r_CS_S")
    rate = [dcm_of_mrp(s).T @ (M - np.cross(x, F)) for s, x in zip(sigma, c, strict=True)]
    impulse = simpson(rate, dx=0.01, axis=0)
    assert deviation(h[-1] - h[0], impulse, np.linalg.norm(impulse)) < 1e-8


def test_propellant_leaves_hub_and_slosh_masses_by_their_shares(fmu):
    p = DEEP_SPACE | {"slosh_draw": (0.3, 0.1, 0, 0)}
    unit = fmu("flexible_servicer", p, {"mdot": 0.05})
    rigid = fmu("servicer", DEEP_SPACE, {"mdot": 0.05})
    for each in (unit, rigid):
        each.step(40)
    assert unit.get("mass") == rigid.get("mass")
    assert deviation(unit.get("slosh_mass"), (3 - 0.6, 3 - 0.2, 0, 0)) < 1e-12
    assert deviation(unit.get("hub_mass"), 100 - 22 - 0.6 * 2) < 1e-11


@pytest.mark.parametrize(
    ("draw", "what"), [(1.0, "slosh_mass"), (0.0, "hub_mass"), (0.5, "slosh_mass")]
)
def test_exhaustion_ends_the_run(fmu, draw, what):
    unit = fmu("flexible_servicer", DEEP_SPACE | {"slosh_draw": (draw, 0, 0, 0)}, {"mdot": 1.0})
    last = 3 / draw if what == "slosh_mass" else 78.0
    unit.step(last - 0.5)
    with pytest.raises(FMICallException):
        unit.step(1.0)


# ---- frozen phase ----


def test_before_the_release_the_hub_is_held_and_the_modes_move(fmu):
    """Symmetric mode of the held hub: w/sqrt(1 - 2 (mu d)^2/(m I_h)), and w if the mass is huge."""
    unit = fmu(
        "flexible_servicer",
        DEEP_SPACE
        | NO_SLOSH
        | UNDAMPED
        | {"t_att": 50.0, "panel_angle_0": (1e-4, -1e-4, 0, 0), "omega_SN_S_0": (0.01, 0, 0.02)}
        | {"max_step": 0.01, "sigma_SN_0": (0.1, 0.2, 0.3), "wheel_speed_0": (1, 2, 3)},
        {"M_S": (1, 2, 3), "wheel_accel_cmd": (0.1, 0.1, 0.1)},
    )
    t, angle, omega, wheels, sigma = unit.history(
        0.1, 499, "panel_angle", "omega_SN_S", "wheel_speed", "sigma_SN"
    )
    w = PANEL["w"] / np.sqrt(1 - 2 * (PANEL["mu"] * PANEL["d"]) ** 2 / (100 * PANEL["I_h"]))
    assert deviation(angle[:, 0], 1e-4 * np.cos(w * t), 1e-4) < 1e-6
    assert not omega.any()
    assert not wheels.any()
    assert deviation(sigma, (0.1, 0.2, 0.3)) == 0
    before = {name: unit.get(name) for name in ("r_SN_N", "v_SN_N", "panel_angle", "panel_rate")}
    unit.step(0.1)  # to t_att
    assert deviation(unit.get("omega_SN_S"), (0.01, 0, 0.02)) == 0
    assert deviation(unit.get("wheel_speed"), (1, 2, 3)) == 0
    for name, value in before.items():
        assert deviation(unit.get(name), value) < 1e-3, name


def test_a_panel_on_a_hub_of_huge_mass_swings_with_its_own_frequency(fmu):
    p = {"mass_0": 1e9, "J_S": 1e6 * np.eye(3), "t_att": 1e3, "panel_angle_0": (1e-4, 0, 0, 0)}
    unit = fmu("flexible_servicer", DEEP_SPACE | NO_SLOSH | UNDAMPED | p | {"max_step": 0.01})
    t, angle = unit.history(0.1, 300, "panel_angle")
    assert deviation(angle[:, 0], 1e-4 * np.cos(PANEL["w"] * t), 1e-4) < 1e-6


# ---- tides ----


def test_the_tide_turns_the_undeformed_vehicle_like_the_rigid_one(fmu, rng):
    """Stiff parts, so that nothing moves; over an hour the tide turns the body by degrees."""
    p = EARTH | ELEMENTS | {"use_gravity_gradient": 1, "sigma_SN_0": rng.uniform(-0.4, 0.4, 3)}
    stiff = {"panel_frequency": np.full(4, 20.0), "slosh_frequency": np.full(4, 20.0)}
    flexible, rigid = fmu("flexible_servicer", p | stiff), fmu("servicer", p)
    for unit in (flexible, rigid):
        unit.step(600)
    turned = np.linalg.norm(rigid.get("omega_SN_S"))
    assert turned > 1e-5
    assert deviation(flexible.get("omega_SN_S"), rigid.get("omega_SN_S"), turned) < 1e-5


def test_the_tide_pulls_a_slosh_mass_away_from_the_planet(fmu):
    """At rest in the Hill frame, x of the body outward: rho (w^2 - 3 n^2) = 3 n^2 r_0."""
    orbit = EARTH | {"a": 7e6, "e": 0, "inc": 0, "argp": 0, "raan": 0, "nu": 0, "use_J2": 0}
    n, w = np.sqrt(MU / 7e6**3), 0.05
    slosh = {"slosh_mass_0": (1e-3, 0, 0, 0), "slosh_position_S": ((5, 0, 0), *np.zeros((3, 3)))}
    slosh |= {"slosh_frequency": np.full(4, w), "slosh_damping_ratio": np.ones(4)}
    p = orbit | slosh | {"use_gravity_gradient": 1, "omega_SN_S_0": (0, 0, n), "rho_0_H": (0, 0, 0)}
    unit = fmu("flexible_servicer", p | NO_PANELS | {"slosh_travel": np.zeros(4), "max_step": 1})
    unit.step(600)
    expected = 3 * n**2 * 5 / (w**2 - 3 * n**2)
    assert deviation(unit.get("slosh_displacement")[0], expected, expected) < 1e-3


# ---- time ----


@pytest.mark.parametrize("h", [0.1, 0.3, 1.0])
def test_result_does_not_depend_on_how_the_step_is_cut(fmu, rng, h):
    p = (
        everything(rng)
        | {"wheel_speed_max": 1.0, "t_att": 2.0, "max_step": 0.1}
        | random_parts(rng)
    )
    p |= FULL
    u = commands(rng)
    whole, cut = (fmu("flexible_servicer", p, u) for _ in range(2))
    whole.step(6)
    for _ in range(round(6 / h)):
        cut.step(h)
    assert bits(cut) == bits(whole)


@pytest.mark.parametrize("hertz", [0.25, 2.0, 8.0])
def test_sub_steps_follow_from_the_highest_mode(fmu, hertz):
    """omega_top^2 = sum M_k w_k^2 (X^-1)_kk, (max_step/n) omega_top <= 0.3."""
    w = 2 * np.pi * hertz
    p = DEEP_SPACE | {"panel_frequency": np.full(4, w), "panel_angle_0": (0.1, 0.05, 0, 0)}
    q = reference.Parameters(**(DEFAULT | p))
    M = [part.M(0.0) for part in q.parts]
    compliance = np.diag(np.linalg.inv(reference.mass_matrix(q, np.zeros(4), 0.0).real))[6:]
    top = np.sqrt(sum(M * compliance * [part.w**2 for part in q.parts]))
    n = int(np.ceil(0.1 * top / 0.3))
    assert n == {0.25: 1, 2.0: 7, 8.0: 26}[hertz]
    units = [fmu("flexible_servicer", p | {"max_step": h}) for h in (0.1, 0.1 / n)]
    cut, whole = (unit.history(0.1, 80, "panel_angle")[1] for unit in units)
    assert deviation(cut, whole) < 1e-13


@pytest.mark.parametrize("hertz", [0.25, 2.0, 8.0])
def test_half_the_step_moves_ten_periods_by_less_than_half_a_percent(fmu, hertz):
    w = 2 * np.pi * hertz
    p = DEEP_SPACE | UNDAMPED | {"panel_frequency": np.full(4, w)}
    p |= {"slosh_frequency": np.full(4, w), "panel_angle_0": (0.01, 0.01, 0, 0)}
    h = 0.05 / hertz
    found = []
    for max_step in (0.1, 0.05):
        unit = fmu("flexible_servicer", p | {"max_step": max_step})
        found.append(unit.history(h, 200, "panel_angle")[1])
    assert deviation(*found, 0.01) < 5e-3
