# SPDX-License-Identifier: BSD-2-Clause
"""Directional derivatives beside, at and behind a contact, against differences over distances so
short that the contact is on one side of them.
"""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from tests.close import close
from tests.compliance.api import Status
from tests.compliance.fmus import ARCHIVES
from tests.compliance.probe import Fmu, Instance
from tests.each import some
from tests.reference import docking as reference
from tests.reference.docking import PARAMETERS

from .test_docking_mechanism import docked

H = 0.01
STIFF = 3318.0
"""Derivative of the force 5 mm deep [N/m]."""


def elements(values):
    """Return scalars by the names of their elements."""
    named = {name: np.asarray(value, float) for name, value in values.items()}
    return {
        f"{name}[{','.join(str(k + 1) for k in index)}]" if index else name: float(array[index])
        for name, array in named.items()
        for index in np.ndindex(array.shape)
    }


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    """Return an FMU by name, for calls of FMI."""

    def load(name):
        path = next(path for path in ARCHIVES if path.stem == name)
        return Fmu(path, tmp_path_factory.mktemp(name))

    return load


class Slopes:
    """Derivatives of unknowns along one input and against it, and the slopes of both sides."""

    def __init__(self, fmu, values, known, unknowns, distance=1e-6):
        with Instance(fmu) as instance:
            names = {v.name for v in (*fmu.inputs, *fmu.parameters)}
            instance.start({name: value for name, value in values.items() if name in names})
            instance.step(0.0, H)
            knowns = [v for v in fmu.inputs if v.name == known]
            unknown = [v for v in fmu.outputs if v.name in unknowns]
            status, given = instance.derivative(knowns, [1.0], unknown)
            assert status is Status.OK
            self.given = np.array(given)
            self.messages = [m.text for m in instance.host.messages if "slopes" in m.text]
            self.opposite = np.array(instance.derivative(knowns, [-1.0], unknown)[1])
            state, here = instance.save(), instance.get(known)

            def after(moved):
                instance.restore(state)
                instance.set({known: here + moved})
                instance.step(H, H)
                return np.array(instance.values(unknown))

            ahead, middle, behind = after(distance), after(0), after(-distance)
            self.ahead, self.behind = (ahead - middle) / distance, (middle - behind) / distance
            self.central = (ahead - behind) / (2 * distance)
            instance.drop(state)


def bodies_at(depth):
    """Return bodies with the probe so deep in the floor of the drogue [m], at rest."""
    place = (-PARAMETERS["cone_depth"] - depth, 0.002, -0.003)
    return docked(PARAMETERS, np.random.default_rng(1), place, shift=False, rate=0)


def floor(depth):
    """Return the parameters and inputs of bodies_at(depth)."""
    return elements(PARAMETERS | bodies_at(depth).inputs())


FORCE = tuple(f"F_contact_S[{i}]" for i in (1, 2, 3))


@pytest.mark.parametrize("depth", [-8e-3, -1e-4, 3e-4, 5e-3])
def test_forces_above_and_in_the_floor_have_the_slope_of_short_differences(loaded, depth):
    slopes = Slopes(loaded("docking_mechanism"), floor(depth), "r_SN_N[1]", FORCE)
    close(slopes.given, slopes.central, rel=1e-5, of=STIFF)
    close(slopes.opposite, -slopes.given, rel=1e-9, of=STIFF)
    assert (abs(slopes.given[0]) > 100) == (depth > 0)


def test_the_force_at_the_edge_of_contact_has_hardly_a_slope(loaded):
    """The force is the depth to the power 1.5."""
    slopes = Slopes(loaded("docking_mechanism"), floor(0.0), "r_SN_N[1]", FORCE)
    close(slopes.given, np.zeros(3), rel=5e-3, of=STIFF)
    for distance in DISTANCES:
        assert np.all(np.abs(slopes.given) <= np.abs(reference_slope(0.0, "r", distance)).max())


DISTANCES = {1e-4: 1e-2, 1e-5: 1e-4, 1e-6: 1e-5}
"""Distances [m, m/s] of the differences of the reference, and the share by which they err: the
curvature of force and friction within 0.1 mm and 0.1 mm/s.
"""


def reference_slope(depth, quantity, distance):
    """Return the difference of the contact force of the independent derivation over one step."""

    def force(moved):
        bodies = bodies_at(depth)
        getattr(bodies, quantity)["S"] = getattr(bodies, quantity)["S"] + (moved, 0, 0)
        memory = reference.Memory(reference.CONTACT)
        return reference.step(PARAMETERS, memory, bodies, 0, H)["F_contact_S"]

    return (force(distance) - force(-distance)) / (2 * distance)


@pytest.mark.parametrize(("depth", "quantity"), some(product((-8e-3, 3e-4, 5e-3), "rv"), 3, 2))
def test_forces_and_friction_have_the_slope_of_the_reference(loaded, depth, quantity):
    """x of N points across and into the floor: a velocity causes friction, and damping."""
    known = f"{quantity}_SN_N[1]"
    slopes = Slopes(loaded("docking_mechanism"), floor(depth), known, FORCE)
    scale = max(1.0, np.abs(slopes.given).max())
    assert (np.abs(slopes.given).max() > 10) == (depth > 0)
    for distance, share in DISTANCES.items():
        close(slopes.given, reference_slope(depth, quantity, distance), rel=share, of=scale)


def test_a_kink_has_the_slope_ahead_of_the_seed_and_a_warning(loaded):
    """The impulse of thrusters grows by the magnitude of the force."""
    slopes = Slopes(loaded("ideal_propulsion"), {}, "F_cmd_S[1]", ["impulse[1]"], 1e-3)
    close(slopes.given, slopes.ahead, rel=1e-9)
    close(slopes.opposite, -slopes.behind, rel=1e-9)
    assert slopes.given[0] == pytest.approx(H)
    assert slopes.messages == [
        "fmi2GetDirectionalDerivative: impulse[1] has unequal one-sided slopes; "
        "the derivative is the slope along the seed"
    ]


def test_friction_of_a_joint_at_rest_has_the_slope_of_short_differences(loaded):
    """It changes within the friction rate of 5 mrad/s."""
    rates = [f"joint_rate[{i}]" for i in range(1, 8)]
    values = {f"joint_friction[{i}]": 5.0 for i in range(1, 8)}
    values |= {f"joint_lock[{i}]": 0.0 for i in range(1, 8)}
    slopes = Slopes(loaded("arm_servicer"), values, "joint_torque[1]", rates, 1e-4)
    close(slopes.given, slopes.central, rel=1e-4)
    wide = Slopes(loaded("arm_servicer"), values, "joint_torque[1]", rates, 1e2)
    assert np.abs(wide.central - slopes.central).max() > 0.1 * np.abs(slopes.central).max()
