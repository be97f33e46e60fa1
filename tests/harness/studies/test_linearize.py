# SPDX-License-Identifier: BSD-2-Clause
"""Linear models of the FMUs against the theory they must agree with."""

import numpy as np
import pytest
from scipy.linalg import expm

from harness.errors import RunError, UsageError
from harness.files import paths
from harness.studies.linearize import linearize

MU = 3.986004415e14


def rows(model, name, kind="outputs"):
    return [i for i, n in enumerate(getattr(model, kind)) if n.partition("[")[0] == name]


def clohessy_wiltshire(n):
    """Continuous matrices of (rho, drho) in the rotating Hill frame and of the specific force."""
    a = np.zeros((6, 6))
    a[:3, 3:] = np.eye(3)
    a[3, 0], a[3, 4], a[4, 3], a[5, 2] = 3 * n**2, 2 * n, -2 * n, -(n**2)
    return a, np.vstack([np.zeros((3, 3)), np.eye(3)])


def hill(r, v):
    """Matrix from (dr, dv) in N to (rho, drho) in the Hill frame of a circular orbit."""
    x, z = r / np.linalg.norm(r), np.cross(r, v) / np.linalg.norm(np.cross(r, v))
    c = np.array([x, np.cross(z, x), z])
    w = np.linalg.norm(np.cross(r, v)) / (r @ r) * z
    skew = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
    return np.block([[c, np.zeros((3, 3))], [-c @ skew, c]])


@pytest.fixture(scope="module")
def servicer():
    values = {"a": 7.0e6, "e": 0.0, "use_J2": 0, "rho_0_H": [0, 0, 0], "mass_0": 120.0, "mu": MU}
    return linearize(paths.fmus()["servicer"], at=100.0, step=10.0, values=values)


def test_servicer_about_a_circular_orbit_is_clohessy_wiltshire(servicer):
    n = np.sqrt(MU / 7.0e6**3)
    state = rows(servicer, "r_SN_N", "states") + rows(servicer, "v_SN_N", "states")
    a = servicer.A[np.ix_(state, state)]
    point = np.array([servicer.point[servicer.states[i]] for i in state])
    # the motion of the reference over one step turns the Hill frame; Kepler's circular orbit is
    # known in closed form
    r, v = point[:3], point[3:]
    c, s = np.cos(n * 10), np.sin(n * 10)
    later = np.concatenate([c * r + s / n * v, -n * s * r + c * v])
    expected = np.linalg.solve(
        hill(later[:3], later[3:]), expm(clohessy_wiltshire(n)[0] * 10)
    ) @ hill(r, v)
    # rounding of r (1e-9 m) over differences of 700 m and 0.75 m/s; RK4 at 0.1 s adds less
    np.testing.assert_allclose(a, expected, rtol=0, atol=3e-8)


def test_force_enters_as_acceleration_over_mass(servicer):
    velocity, force = rows(servicer, "v_SN_N", "states"), rows(servicer, "F_S", "inputs")
    b = servicer.B[np.ix_(velocity, force)]
    # ten seconds of 1 N on 120 kg, turned by the attitude, which singular values do not see; tidal
    # terms are 1e-6
    np.testing.assert_allclose(np.linalg.svd(b)[1], 10 / 120, rtol=1e-4)


def test_outputs_that_are_states_are_selected_by_C_and_have_no_feedthrough(servicer):
    states = [servicer.outputs.index(name) for name in servicer.states]
    np.testing.assert_allclose(servicer.C[states], np.eye(len(states)), atol=1e-9)
    np.testing.assert_allclose(servicer.D[states], 0, atol=1e-9)


def test_a_stateless_fmu_is_pure_feedthrough():
    model = linearize(paths.fmus()["ideal_propulsion"])
    force, command = rows(model, "F_S"), rows(model, "F_cmd_S", "inputs")
    assert model.states == ()
    np.testing.assert_allclose(model.D[np.ix_(force, command)], np.eye(3), atol=1e-9)


def test_the_file_holds_matrices_names_units_and_operating_point(servicer, tmp_path):
    servicer.save(tmp_path / "m.npz")
    data = np.load(tmp_path / "m.npz")
    assert data["A"].shape == (len(data["x_names"]),) * 2
    assert list(data["u_units"][:3]) == ["N", "N", "N"]
    assert data["x_0"][0] == servicer.point[servicer.states[0]]


def test_a_time_off_the_steps_is_rejected():
    with pytest.raises(UsageError, match="multiple"):
        linearize(paths.fmus()["servicer"], at=0.15)


def test_an_unknown_value_is_rejected_with_close_names():
    with pytest.raises(UsageError, match="mass_0"):
        linearize(paths.fmus()["servicer"], values={"mas_0": 3})


def test_differences_that_overflow_are_one_reason(fmus):
    reason = "no linear model: derivatives with respect to u overflow"
    with pytest.raises(RunError, match=f"gain.*{reason}"):
        linearize(fmus["gain"], step=1.0, values={"k": 4.5e307})


# ---- panels and slosh


FLEXIBLE = {"a": 0, "mu": 0, "max_step": 0.01, "use_J2": 0}
W, I_H, MU_D, I_2, LEVER = np.pi / 2, 1.31 + 8 * 0.75**2, 8 * 0.75, 1.31, 1.25


@pytest.fixture(scope="module")
def modes():
    """Continuous eigenvalues of the default panels, undeformed at rest, no slosh."""
    values = FLEXIBLE | {"slosh_mass_0": [0, 0, 0, 0]}
    model = linearize(paths.fmus()["flexible_servicer"], step=0.1, values=values)
    return np.log(np.linalg.eigvals(model.A).astype(complex)) / model.h


@pytest.mark.parametrize(
    "share",
    [2 * (I_2 + MU_D * LEVER) ** 2 / (150 * I_H), 2 * MU_D**2 / (100 * I_H)],
    ids=["antisymmetric", "symmetric"],
)
def test_free_modes_of_panels_match_the_closed_form(modes, share):
    """Frequency w/sqrt(1 - share), damping ratio z w_free/w."""
    free = W / np.sqrt(1 - share)
    found = modes[np.argmin(np.abs(np.abs(modes) - free))]
    assert abs(abs(found) / free - 1) < 1e-6
    assert abs(-found.real / abs(found) / (0.003 * free / W) - 1) < 1e-3


def test_free_mode_of_a_slosh_mass_on_the_axis_matches_the_closed_form():
    slosh = {"slosh_mass_0": [3, 0, 0, 0], "slosh_position_S": [[0.2, 0, 0]] + 3 * [[0, 0, 0]]}
    values = FLEXIBLE | slosh | {"panel_mass": [0, 0, 0, 0]}
    model = linearize(paths.fmus()["flexible_servicer"], step=0.1, values=values)
    found = np.log(np.linalg.eigvals(model.A).astype(complex)) / model.h
    free = 0.3141592653589793 / np.sqrt(1 - 3 / 100)
    nearest = found[np.argmin(np.abs(np.abs(found) - free))]
    assert abs(abs(nearest) / free - 1) < 1e-6
    assert "slosh_displacement[2]" not in model.states
    assert "slosh_displacement[1]" in model.states
