# SPDX-License-Identifier: BSD-2-Clause
"""Margins of requirements against the robustness that rtamt computes for a formula of signal
temporal logic with the same meaning.
"""

from __future__ import annotations

import numpy as np
import pytest

from harness.results.requirements import margin
from harness.results.result import Result

pytestmark = pytest.mark.interop

FORMULAS = {
    "a.x <= 0.7 m": "always(x <= 0.7)",
    "a.x + 2 * a.y >= -1 and not (a.y > 90 cm)": "always((sum >= -1) and not(y > 0.9))",
    "always(a.x <= 1, 2 s)": "always[0,2](x <= 1)",
    "eventually(always(a.x >= 0, 1 s), 3 s)": "eventually[0,3](always[0,1](x >= 0))",
    "always(implies(a.x > 0.2, a.y > -0.5), 1 s, 4 s)": (
        "always[1,4](not(far >= 0) or (y > -0.5))"
    ),
    "always(eventually(a.y >= 50 cm, 0.5 s), 3 s) or always(a.x > -1, 1 s) and eventually(a.x > 1)":
        "always[0,3](eventually[0,0.5](y >= 0.5)) or (always[0,1](x > -1) and eventually(x > 1))",
    "time < 3 s or abs(a.y) <= 0.9 m": "always((early >= 0) or (size <= 0.9))",
    "implies(a.x > 0, sqrt(a.x**2 + a.y**2) <= 1.1)": "always(not(right >= 0) or (r <= 1.1))",
    "eventually(a.x == a.y, 0.2 s, 1 s)": "eventually[0.2,1](x == y)",
}  # fmt: skip
"""Formula of rtamt by requirement."""


def guard(holds):
    """A condition that states when another one applies, and has no margin of its own."""
    return np.where(holds, np.inf, -np.inf)


def signals(time, x, y):
    """The signals of the formulas by name."""
    return {
        "x": x,
        "y": y,
        "sum": x + 2 * y,
        "size": np.abs(y),
        "r": np.hypot(x, y),
        "far": guard(x > 0.2),
        "right": guard(x > 0),
        "early": guard(time < 3),
    }


def robustness(rtamt, formula, time, traces):
    spec = rtamt.StlDiscreteTimeSpecification()
    for name in (*traces, "out"):
        spec.declare_var(name, "float")
    spec.unit = "s"
    spec.set_sampling_period(100, "ms", 0.1)
    spec.spec = f"out = {formula}"
    spec.parse()
    rows = {"time": list(range(len(time)))}
    return spec.evaluate(rows | {name: values.tolist() for name, values in traces.items()})[0][1]


@pytest.mark.tool("rtamt", "rtamt")
def test_the_margin_is_the_robustness_of_rtamt_on_504_traces():
    rtamt = pytest.importorskip("rtamt")
    rng, time, finite = np.random.default_rng(7), 0.1 * np.arange(61), 0
    for text, formula in 56 * list(FORMULAS.items()):
        values = np.cumsum(rng.normal(scale=0.2, size=(len(time), 2)), axis=0)
        expected = margin(Result("test", time, ("a.x", "a.y"), ("m", "m"), values), text)
        if np.isnan(expected):  # not exercised here, infinitely robust there
            expected = np.inf
        found = robustness(rtamt, formula, time, signals(time, *values.T))
        near = found == expected or abs(found - expected) <= 1e-12 * max(1, abs(expected))
        assert near, (text, found, expected)
        finite += np.isfinite(expected)
    assert finite >= 450
